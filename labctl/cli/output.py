"""Output for people and for machines: tables, the SIMULATED RIG banner, JSON without NaN, live progress."""

import itertools
import json
import math
import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any

import click

from labctl.next_command import next_command
from labctl.nonblocking_output import NonBlockingOutput
from labctl.plain_json import to_json

if TYPE_CHECKING:
    from labctl.config.rig import RegulatorConfig

SIMULATED = "SIMULATED RIG: byte-level doubles answer; no real instrument is connected"


_GAP = "  "
# A command of labctl with its options, as `labctl.next_command` writes them.
_COMMAND = re.compile(r"labctl [a-z]+(?: \d+)?(?: --[a-z-]+ (?:'[^']*'|\S+))*")
_KEPT_BLANK = "\x1f"
# What a text that is queued begins with: one that takes the live line's place, one for standard output.
_ERASE, _RESULT = "\r", "\0"


def emit_json(result: Mapping[str, Any]) -> None:
    """Print one JSON object; NaN and infinity become null, because JSON has neither."""
    click.echo(json.dumps(to_json(result, lossy=True), allow_nan=False))


def banner(simulated: bool) -> None:
    """Print that the rig is simulated, where it is."""
    if simulated:
        click.echo(SIMULATED)


def unit_line(regulator: "RegulatorConfig") -> None:
    """Print what vouches for the pressure unit, where the device itself does not."""
    if regulator.driver == "alicat-modbus":
        click.echo(f"pressure unit {regulator.unit_word()}")


def unit_json(regulator: "RegulatorConfig") -> dict[str, str | None]:
    """The unit that the regulator is set to, and what vouches for it."""
    return {"pressure_unit": regulator.pressure_unit, "pressure_unit_proven": regulator.unit_proof()}


def terminal_columns() -> int | None:
    """How many letters a line of standard output holds; None where it is no terminal, and lines are of any length."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows under a head, every column set to the right.

    On a terminal that is too narrow for them the widest columns are broken at their blanks, as far as that goes.
    """
    cells = [list(head), *[list(row) for row in rows]]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    columns = terminal_columns()
    if columns is not None:
        widths = _narrowed(widths, cells, columns - len(_GAP) * (len(head) - 1))
    for row in cells:
        broken = [
            textwrap.wrap(text, width, break_on_hyphens=False) or [""]
            for text, width in zip(row, widths, strict=True)
        ]
        for line in itertools.zip_longest(*broken, fillvalue=""):
            click.echo(_GAP.join(text.rjust(width) for text, width in zip(line, widths, strict=True)))


def _narrowed(widths: Sequence[int], cells: Sequence[Sequence[str]], columns: int) -> list[int]:
    """The widths, the widest taken down until all fit, or none can be broken any more."""
    least = [
        max((len(word) for row in cells for word in row[column].split()), default=0)
        for column in range(len(widths))
    ]
    narrow = list(widths)
    while sum(narrow) > columns:
        widest = max(range(len(narrow)), key=lambda column: (narrow[column] > least[column], narrow[column]))
        if narrow[widest] <= least[widest]:
            break
        narrow[widest] -= 1
    return narrow


def paragraph(text: str, indent: str = "") -> None:
    """Print text, on a terminal broken at its blanks, `indent` before later lines; commands to paste stay whole."""
    columns = terminal_columns()
    if columns is not None:
        whole = _COMMAND.sub(lambda found: found[0].replace(" ", _KEPT_BLANK), text)
        lines = textwrap.wrap(
            whole, columns, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
        )
        text = "\n".join(lines).replace(_KEPT_BLANK, " ")
    click.echo(text)


def number(value: float, decimals: int = 2) -> str:
    """A number for a table; a dash where there is none."""
    return "-" if math.isnan(value) else f"{value:.{decimals}f}"


def counted(number: int, noun: str) -> str:
    """How many there are, as text: "1 trial", "2 trials"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def print_look_at_it(run: int) -> None:
    """Print how a run is looked at, a command a line."""
    click.echo("look at it:")
    for name in ("show", "report"):
        click.echo(f"  {next_command(name, run)}")


class ProgressLine:
    """Live progress on standard error: one line, rewritten, on a terminal; one line a step elsewhere.

    On a terminal it is cut to the width that is there, and gives way to every other line: nothing is glued to it, and
    nothing is left of it at the end. Nothing here waits for the terminal: whoever shows progress may be holding a
    pressure. A context manager; leaving it lets what is queued be written, for a second at most.
    """

    def __init__(self, *, quiet: bool) -> None:
        self._live = sys.stderr.isatty()
        self._quiet = quiet and not self._live
        self._step = ""
        self._width = 0
        self._output = NonBlockingOutput(self._write)
        # One terminal shows both: one queue keeps them apart. Elsewhere a reader that waits must not stop progress.
        same = self._live and sys.stdout.isatty()
        self._results = self._output if same else NonBlockingOutput(self._write)

    def __enter__(self) -> "ProgressLine":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._output.write(_ERASE)
        for output in {id(each): each for each in (self._results, self._output)}.values():
            output.finish()

    @property
    def live(self) -> bool:
        """Whether the line is rewritten in place."""
        return self._live

    def show(self, step: str, detail: str = "") -> None:
        """Show the present step, and its progress."""
        if self._quiet:
            return
        if self._live:
            self._output.write(f"{_ERASE}{step} {detail}".rstrip())
        elif step != self._step:
            self._output.write(f"... {step}")
        self._step = step

    def notify(self, text: str) -> None:
        """Print a line of its own on standard error, which is not rewritten."""
        self._output.write(f"labctl: {text}")

    def result(self, text: str) -> None:
        """Print a line on standard output."""
        self._results.write(f"{_RESULT}{text}")

    def give_way(self) -> None:
        """Take the line away, and wait until all is written, for a second at most: others print now."""
        self._output.write(_ERASE)
        for output in (self._results, self._output):
            output.flush()

    def _write(self, text: str) -> None:
        if text.startswith(_RESULT):
            if self._results is self._output:
                self._erase()
            click.echo(text.removeprefix(_RESULT))
            return
        self._erase()
        if text.startswith(_ERASE):
            shown = text.removeprefix(_ERASE)[: shutil.get_terminal_size().columns - 1]
            sys.stderr.write(shown)
            self._width = len(shown)
        else:
            sys.stderr.write(f"{text}\n")
        sys.stderr.flush()

    def _erase(self) -> None:
        if self._width:
            sys.stderr.write(f"\r{' ' * self._width}\r")
            sys.stderr.flush()
            self._width = 0
