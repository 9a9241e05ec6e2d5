"""What the ledger holds: runs, trials and events, each written once and never changed."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Json = Mapping[str, Any]
Outcome = Literal["good", "failed", "aborted"]


@dataclass(frozen=True)
class Moment:
    """One moment on both clocks.

    `wall` is ISO 8601 with the time zone; `mono_s` the machine's monotonic clock, which no one can set back and
    which counts from the boot that `boot` names.
    """

    wall: str
    mono_s: float
    boot: str


@dataclass(frozen=True)
class RunRecord:
    """A run as it was begun.

    `number` counts runs from 1. `request` is what was asked for, enough to make the same plan again (protocol,
    patterns, pressures_psi, trials, attempts, placements, watch_s), `planned_trials` how many trials that plan has.
    `design_text` is the whole design file, `rig` the whole configuration. `identities` maps "regulator", "valves" and
    "markers" to model, serial_number, firmware and notes. `simulated_heights` is the simulator's word: a list of
    {pattern, pressure_psi, heights_mm}. `versions` maps
    programs to versions, `commit` is the checkout's, with "+changes" where it had any; None where there is none.
    """

    number: int
    protocol: str
    begun: Moment
    request: Json
    planned_trials: int
    design_name: str
    design_source: str
    design_text: str
    rig_name: str
    rig: Json
    simulated: bool
    identities: Json
    simulated_heights: tuple[Json, ...]
    versions: Json
    commit: str | None
    operator: str
    note: str


@dataclass(frozen=True)
class RawFile:
    """A file of raw samples beside the ledger: its path relative to the ledger's folder, SHA-256 and size."""

    path: str
    sha256: str
    size_bytes: int


@dataclass(frozen=True)
class TrialRecord:
    """One attempt at one of a run's trials.

    `number` is the planned trial's, from 1; `attempt` counts from 1. `outcome` "good" counts; "failed" and
    "aborted" never do, and `reason` says why. `windows` are the stretches of the recording that the numbers come from
    (`labctl.measurement.windows`), `raw` the files ("frames" and "pressures"; empty where nothing was recorded),
    `result` what was derived from them (`labctl.measurement.result`); None where nothing could be. `safe` is what was
    read back after the teardown: {safe, words}.
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
    windows: tuple[Json, ...]
    raw: Mapping[str, RawFile]
    result: Json | None
    safe: Json


@dataclass(frozen=True)
class EventRecord:
    """Something that happened to a run (`run` None: to the ledger itself).

    `kind`: "trial-begun", "paused", "resumed", "abort-asked", "interrupted", "continued", "finished", "failed",
    "clock-set-back", "restored", ... `detail` says more.
    """

    run: int | None
    kind: str
    at: Moment
    detail: Json = field(default_factory=dict)
