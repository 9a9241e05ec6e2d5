"""What a person gave to a command that measures, beside what is to be measured."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class SessionOptions:
    """The rig, how fast its doubles run, who measures, a note, and whether a machine reads the output."""

    rig_path: Path | None
    as_json: bool
    speed: float = 1.0
    operator: str | None = None
    note: str = ""
