"""What is wrong with a configuration file: every mistake with its file, line, key and value."""

from collections.abc import Sequence
from dataclasses import dataclass

from labctl.errors import BadInput


@dataclass(frozen=True)
class Problem:
    """One mistake. `line` counts from 1; `value` is as the file has it, None where there is none."""

    source: str
    line: int
    key: str
    value: str | None
    message: str

    def __str__(self) -> str:
        """`rig.toml:12: limits.ramp = "3 mm": is a length, not ...`."""
        subject = self.key if self.value is None else f"{self.key} = {self.value}"
        where = f"{self.source}:{self.line}"
        return f"{where}: {subject}: {self.message}" if subject else f"{where}: {self.message}"


class ConfigError(BadInput):
    """A configuration file that cannot be used; `problems` holds all of its mistakes, in the file's order."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda problem: problem.line))
        lines = [str(problem) for problem in self.problems]
        if len(lines) > 1:
            lines.insert(0, f"{self.problems[0].source} has {len(lines)} mistakes:")
        super().__init__("\n".join(lines))
