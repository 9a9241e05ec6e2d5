"""Output for people and for machines: tables, the SIMULATED RIG banner, JSON without NaN, live progress."""

import json
import math
import sys
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


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows under a head, every column set to the right."""
    cells = [list(head), *[list(row) for row in rows]]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    for row in cells:
        click.echo("  ".join(text.rjust(width) for text, width in zip(row, widths, strict=True)))


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

    Nothing here waits for the terminal: whoever shows progress may be holding a pressure. A context manager;
    leaving it lets what is queued be written, for a second at most.
    """

    def __init__(self, *, quiet: bool) -> None:
        self._live = sys.stderr.isatty()
        self._quiet = quiet and not self._live
        self._step = ""
        self._width = 0
        self._output = NonBlockingOutput(self._write)

    def __enter__(self) -> "ProgressLine":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live and self._step:
            self._output.write("")
        self._output.finish()

    @property
    def live(self) -> bool:
        """Whether the line is rewritten in place."""
        return self._live

    def show(self, step: str, detail: str = "") -> None:
        """Show the present step, and its progress."""
        if self._quiet:
            return
        if self._live:
            self._output.write(f"\r{step} {detail}".rstrip())
        elif step != self._step:
            self._output.write(f"... {step}")
        self._step = step

    def notify(self, text: str) -> None:
        """Print a line of its own, which is not rewritten."""
        self._output.write(f"labctl: {text}")

    def _write(self, text: str) -> None:
        if text.startswith("\r"):
            sys.stderr.write(text.ljust(self._width))
            self._width = len(text)
        else:
            sys.stderr.write(("\n" if self._width else "") + (text + "\n" if text else ""))
            self._width = 0
        sys.stderr.flush()
