"""What the ledger holds: runs, trials and events, each written once and never changed."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from labctl.config.rig import MarkerPoint
from labctl.instruments.readings import Identity
from labctl.ledger.moment import Moment
from labctl.measurement.basis import Basis
from labctl.measurement.result import LevelResult, RelaxationResult, TrialResult
from labctl.measurement.windows import Window
from labctl.plain_json import UNWRITTEN

Json = Mapping[str, Any]
Outcome = Literal["good", "failed", "aborted"]
_LEFT_OUT = ("max_left_out", "max_left_out_of_all")


@dataclass(frozen=True)
class RunRequest:
    """The request of a run, complete: from it, the design and the rig the same plan follows again.

    `placements` are the orders in which the patterns' fibers lie on the sheet, one sheet each; a protocol that
    needs one sheet has one. `trials` is how many of each kind, `attempts` how often each may be tried. `hold_s` is
    how long each pressure is held at least before it is measured, None for as long as it takes to settle.
    """

    protocol: str
    patterns: tuple[str, ...]
    pressures_psi: tuple[float, ...]
    trials: int
    attempts: int
    placements: tuple[str, ...]
    watch_s: float | None
    hold_s: float | None = field(default=None, metadata={UNWRITTEN: "0.2.0"})


@dataclass(frozen=True)
class SimulatedHeights:
    """The simulator's heights (m,) in mm of a pattern at a gauge pressure, over the rig's measuring points."""

    pattern: str
    pressure_psi: float
    heights_mm: tuple[float, ...]


@dataclass(frozen=True)
class RunRecord:
    """A run as it was started.

    `number` counts runs from 1. `planned_trials` is how many trials the plan of the `request` has. `design_text` is
    the text of the design file. `rig` is the configuration (`labctl.config.rig.RigConfig`) as plain JSON: a run must
    stay readable when a configuration has other fields; what its recordings are judged by is typed in `basis`.
    `identities` maps "regulator", "valves" and "markers" to who answered. `versions` maps programs to versions,
    `commit` is the checkout's, with "+changes" where it had any; None where there is none.
    """

    number: int
    protocol: str
    begun: Moment
    request: RunRequest
    planned_trials: int
    design_name: str
    design_source: str
    design_text: str
    rig_name: str
    rig: Json
    simulated: bool
    identities: Mapping[str, Identity]
    simulated_heights: tuple[SimulatedHeights, ...]
    versions: Mapping[str, str]
    commit: str | None
    operator: str
    note: str

    @property
    def points(self) -> tuple[MarkerPoint, ...]:
        """The m measuring points in the rig's order."""
        return tuple(MarkerPoint(**point) for point in self.rig["markers"]["points"])

    @property
    def tolerance_psi(self) -> float:
        """How far the pressure may be from the one to hold."""
        return float(self.rig["limits"]["hold_tolerance_psi"])

    def basis(self, pattern: str) -> Basis:
        """What the run's recordings of a pattern are judged by."""
        markers, measurement = self.rig["markers"], self.rig["measurement"]
        return Basis(
            points=self.points,
            up=markers["up"],
            frequency_hz=float(markers["frequency_hz"]),
            tolerance_psi=self.tolerance_psi,
            min_points=int(measurement["min_points"]),
            min_share=float(measurement["min_share"]),
            simulated_mm={
                float(simulated.pressure_psi): tuple(map(float, simulated.heights_mm))
                for simulated in self.simulated_heights
                if simulated.pattern == pattern
            },
            # Runs recorded before these limits were known have their defaults.
            **{name: float(measurement[name]) for name in _LEFT_OUT if name in measurement},
        )


@dataclass(frozen=True)
class RawFile:
    """A file of raw samples beside the ledger: its path relative to the ledger's folder, SHA-256 and size."""

    path: str
    sha256: str
    size_bytes: int


@dataclass(frozen=True)
class SafeReadBack:
    """Whether SAFE was read back after the teardown, and what was read, as text in `words`."""

    safe: bool
    words: str


@dataclass(frozen=True)
class TrialRecord:
    """One attempt at one of a run's trials.

    `number` is the planned trial's, from 1; `attempt` counts from 1. `outcome` "good" counts; "failed" and
    "aborted" never do, and `reason` is why. `windows` are the stretches of the recording that the numbers come
    from, `raw` the files ("frames" and "pressures"; empty where nothing was recorded), `result` what was derived from
    them; None where nothing could be.
    """

    run: int
    number: int
    attempt: int
    placement: str
    pattern: str
    pressures_psi: tuple[float, ...]
    begun: Moment
    ended: Moment
    outcome: Outcome
    reason: str
    windows: tuple[Window, ...]
    raw: Mapping[str, RawFile]
    result: TrialResult | None
    safe: SafeReadBack

    @property
    def levels(self) -> tuple[LevelResult, ...]:
        """The results at its pressures, in the order measured; empty where there is no result."""
        return () if self.result is None else self.result.levels

    @property
    def relaxation(self) -> RelaxationResult | None:
        """The sheet's way back after venting; None where it was not watched or there is no result."""
        return None if self.result is None else self.result.relaxation


@dataclass(frozen=True)
class EventRecord:
    """Something that happened to a run (`run` None: to the ledger itself, or to a rig).

    `kind`: "trial-begun", "paused", "resumed", "interrupted", "continued", "finished", "failed", "zero-moved",
    "clock-set-back", "restored", "tared", ... `detail` holds the rest.
    """

    run: int | None
    kind: str
    at: Moment
    detail: Json = field(default_factory=dict)
