"""`labctl watch`: what a command in another terminal does with its rig, until it lets go of it."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from labctl.cli.options import held_rig_option
from labctl.cli.output import SIMULATED
from labctl.errors import NoAnswer
from labctl.next_command import next_command
from labctl.plain_json import to_json

if TYPE_CHECKING:
    from labctl.clock import Clock
    from labctl.holder.interfaces import Held
    from labctl.holder.records import RigState

_ANSWER_S = 1.0
_PERIOD_S = 0.2


@click.command()
@held_rig_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line, five a second.")
def watch(rig_path: Path | None, as_json: bool) -> int:
    """Follow what a command in another terminal does with its rig: step, pressure, valves, markers.

    Ends when that command lets go of the rig. Touches no instrument; Ctrl-C ends the watching only. Exit code 1 when
    the rig was not SAFE at the end, as far as could be seen.
    """
    from labctl.cli.held import held_rigs, one_held_rig
    from labctl.cli.main import leave_streams
    from labctl.cli.outcome import Outcome
    from labctl.interrupts import stop_on_signals

    outcome = Outcome.current()
    held = one_held_rig(held_rigs(rig_path), rig_path, "name one with --rig")
    outcome.simulated = held.entry.holder.simulated
    show = _Lines(held, as_json)
    with stop_on_signals(None) as stop:
        try:
            while not stop.requested:
                ended = _follow(held, show, outcome.platform.scheduler, lambda: stop.requested)
                if ended:
                    return show.finish()
        except BrokenPipeError:
            # Whoever watched has seen enough.
            leave_streams()
            return 0
    return 0


def _follow(held: "Held", show: "_Lines", clock: "Clock", is_over: Callable[[], bool]) -> bool:
    """Show states until the holder is gone (true), is silent (false), or it is over."""
    conversation = None
    try:
        conversation = held.ask("watch", _ANSWER_S)
        while not is_over():
            state = conversation.next_state(_ANSWER_S)
            if state is None:
                return True
            show.state(state)
            if state.ended:
                return True
            clock.sleep(_PERIOD_S)
    except NoAnswer as error:
        if not held.is_held():
            return True
        show.silence(str(error))
        clock.sleep(_ANSWER_S)
    finally:
        if conversation is not None:
            conversation.close()
    return False


class _Lines:
    """What is shown: a line a state as JSON, one line that is rewritten on a terminal, else a line a step."""

    def __init__(self, held: "Held", as_json: bool) -> None:
        self._held = held
        self._as_json = as_json
        self._live = sys.stdout.isatty() and not as_json
        self._step = ""
        self._width = 0
        self._silent = False
        self._last: RigState | None = None
        holder = held.entry.holder
        if not as_json:
            click.echo(f"{SIMULATED if holder.simulated else holder.rig_name}\nheld by {holder.describe()}")

    def state(self, state: "RigState") -> None:
        """Show a state."""
        self._last, self._silent = state, False
        if self._as_json:
            click.echo(json.dumps(to_json(state, lossy=True), allow_nan=False))
        elif self._live:
            text = _in_one_line(state)
            click.echo(f"\r{text.ljust(self._width)}", nl=False)
            self._width = len(text)
        elif state.step != self._step:
            self._step = state.step
            click.echo(_in_one_line(state))

    def silence(self, why: str) -> None:
        """Say, once, that no state comes."""
        from labctl.cli.held import silent

        if not self._silent:
            self._silent = True
            self._new_line()
            click.echo(f"labctl: {why}; {silent(self._held)}", err=True)

    def finish(self) -> int:
        """Say how it ended; returns the exit code."""
        from labctl.cli.held import condition

        if self._last is None:
            holder = self._held.entry.holder
            self._new_line()
            click.echo(
                f"labctl: process {holder.pid} let go of the rig and had told nothing: see {next_command('status')}",
                err=True,
            )
            return 1
        safe = self._last.read_back or self._last.safe
        if not self._as_json:
            self._new_line()
            ended = "let go of the rig" if self._last.ended else "is gone"
            click.echo(f"process {self._last.holder.pid} {ended}; last seen: {condition(self._last)}")
        closed = self._last.ended and self._last.phase == "closed" and safe is None
        return 0 if closed or (safe is not None and safe.safe) else 1

    def _new_line(self) -> None:
        if self._width:
            click.echo("")
            self._width = 0


def _in_one_line(state: "RigState") -> str:
    from labctl.cli.held import format_age

    trial = f"trial {state.trial} of {state.trials}, " if state.trial is not None else ""
    step = state.step.removeprefix(f"trial {state.trial}: ")
    parts = [f"{state.elapsed_s:5.0f} s  {trial}{step or state.holder.command}"]
    if state.pressure_psi is not None:
        age = format_age(state.reading_age_s, "the regulator does")
        parts.append(f"{state.pressure_psi:.2f} psi (setpoint {state.setpoint_psi:.2f}){age}")
    if state.channels_on is not None:
        parts.append(f"{len(state.channels_on)} valves on")
    if state.markers is not None:
        age = format_age(state.marker_age_s, "their source does")
        parts.append(f"{state.markers_seen} of {state.markers} markers{age}")
    if state.asked_by is not None:
        parts.append(state.asked_by)
    return "  ".join(parts)
