"""Output for people and for machines: tables, the SIMULATED RIG banner, JSON without NaN, live progress."""

import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import click

SIMULATED = "SIMULATED RIG: byte-level doubles answer; no real instrument is connected"


def emit_json(result: Mapping[str, Any]) -> None:
    """Print one JSON object; NaN and infinity become null, because JSON has neither."""
    click.echo(json.dumps(_plain(result), allow_nan=False))


def banner(simulated: bool) -> None:
    """Say that the rig is simulated, where it is."""
    if simulated:
        click.echo(SIMULATED)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows under a head, numbers and text alike set to the right."""
    cells = [list(head), *[list(row) for row in rows]]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    for row in cells:
        click.echo("  ".join(text.rjust(width) for text, width in zip(row, widths, strict=True)))


def number(value: float, decimals: int = 2) -> str:
    """A number for a table; a dash where there is none."""
    return "-" if math.isnan(value) else f"{value:.{decimals}f}"


class ProgressLine:
    """Live progress on standard error: one line that is rewritten on a terminal, one line a step elsewhere."""

    def __init__(self, *, quiet: bool) -> None:
        self._live = sys.stderr.isatty()
        self._quiet = quiet and not self._live
        self._step = ""
        self._width = 0

    def show(self, step: str, detail: str = "") -> None:
        """Show where things are."""
        if self._quiet:
            return
        if self._live:
            text = f"{step} {detail}".rstrip()
            click.echo("\r" + text.ljust(self._width), nl=False, err=True)
            self._width = len(text)
        elif step != self._step:
            click.echo(f"... {step}", err=True)
        self._step = step

    def note(self, text: str) -> None:
        """Say something that must stay readable."""
        self.end()
        click.echo(f"labctl: {text}", err=True)

    def end(self) -> None:
        """Leave the live line, so that what follows starts on its own."""
        if self._live and self._width:
            click.echo("", err=True)
            self._width = 0


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever JSON can hold
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
