"""What a protocol is: a plan of trials, each a checklist of steps in setup, main and teardown.

Steps are data before they are deeds: the same checklist is printed by `--dry-run`, checked against the rig's limits,
and done. Teardown is always done, every step of it, whatever happened before. A laboratory's own package adds
protocols by the entry point group "labctl.protocols" (docs/how-to/write-a-protocol.md).
"""

from collections.abc import Callable
from dataclasses import dataclass

from labctl.config.design import Design
from labctl.config.rig import RigConfig
from labctl.ledger.records import RunRequest
from labctl.measurement.windows import Window
from labctl.rig import Rig


@dataclass(frozen=True)
class Bench:
    """What a step works with: the rig, where to mark windows of the recording, where to show progress as text."""

    rig: Rig
    mark_window: Callable[[Window], None]
    show_progress: Callable[[str], None]


@dataclass(frozen=True)
class Step:
    """One line of a checklist.

    `description` is the checklist's text; `lasts_s` usually, `deadline_s` at most, on the rig's clock: a step that
    waits by the rig's verbs is ended then. `pressure_psi` is the gauge pressure that it takes the sheet to and
    `channels` the valves that it opens, for the check of the limits before anything moves.
    """

    description: str
    lasts_s: float
    deadline_s: float
    do: Callable[[Bench], None]
    pressure_psi: float | None = None
    channels: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Checklist:
    """Setup and main in order, until one fails; teardown always, each of its steps."""

    setup: tuple[Step, ...]
    main: tuple[Step, ...]
    teardown: tuple[Step, ...]

    @property
    def steps(self) -> tuple[Step, ...]:
        """All of them in order."""
        return (*self.setup, *self.main, *self.teardown)


@dataclass(frozen=True)
class Trial:
    """One planned trial; `number` counts from 1. `sheet` describes the sheet that must lie on the rig; "" for any."""

    number: int
    placement: str
    pattern: str
    pressures_psi: tuple[float, ...]
    checklist: Checklist
    sheet: str = ""


@dataclass(frozen=True)
class AllowedCounts:
    """How many patterns and pressures a protocol takes and how many trials of each kind, at least and at most."""

    patterns: tuple[int, int] = (1, 1)
    pressures: tuple[int, int] = (1, 1)
    trials: tuple[int, int] = (1, 1000)


@dataclass(frozen=True)
class Protocol:
    """A scripted measurement.

    `summary` is one line for a person. `pressures_psi` and `trials` are used where the options name none; `watch_s`
    is how long the sheet is watched after venting, None where it is not. `can_hold`: its plan holds each pressure for
    `RunRequest.hold_s`, where that is given. `placements` makes the orders of the
    sheets from the patterns, None where the sheet stays. `plan` makes the trials; it contacts no instrument.
    """

    name: str
    summary: str
    pressures_psi: tuple[float, ...]
    trials: int
    plan: Callable[[RunRequest, Design, RigConfig], tuple[Trial, ...]]
    allowed: AllowedCounts = AllowedCounts()
    watch_s: float | None = None
    can_hold: bool = False
    placements: Callable[[tuple[str, ...]], tuple[str, ...]] | None = None
