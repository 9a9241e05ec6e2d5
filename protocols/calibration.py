"""One pattern up a staircase of pressures: the table of heights that the simulator is fitted to.

Source: Parsa et al., RoboSoft 2023, section II.A: calibrated on a sheet with three parallel fibers; the published
table has 16 points at 2, 2.5, 3 and 3.5 psi. `labctl export RUN --format csv` writes it, `labctl compare` reads it.
"""

from labctl.config.design import Design
from labctl.config.rig import RigConfig
from labctl.ledger.records import RunRequest
from labctl.session.contract import AllowedCounts, Checklist, Protocol, Step, Trial
from protocols.five_trial import repeated_trials
from protocols.steps import (
    capture_baseline,
    capture_level,
    hold_until_settled,
    jam,
    ramp,
    vent_and_unjam,
    wait_until_relaxed,
)


def _staircase(pressures_psi: tuple[float, ...], hold_s: float | None, rig: RigConfig) -> tuple[Step, ...]:
    steps: list[Step] = []
    below_psi = 0.0
    for pressure_psi in pressures_psi:
        steps += [
            ramp(pressure_psi, rig, below_psi),
            hold_until_settled(pressure_psi, rig, hold_s),
            capture_level(pressure_psi, rig),
        ]
        below_psi = pressure_psi
    return tuple(steps)


def _plan(request: RunRequest, design: Design, rig: RigConfig) -> tuple[Trial, ...]:
    (pattern,) = request.patterns
    pressures_psi = tuple(sorted(request.pressures_psi))
    checklist = Checklist(
        setup=(wait_until_relaxed(rig), capture_baseline(rig)),
        main=(jam(design.channels(pattern), pattern), *_staircase(pressures_psi, request.hold_s, rig)),
        teardown=(vent_and_unjam(rig),),
    )
    return repeated_trials(request, pressures_psi, checklist)


CALIBRATION = Protocol(
    name="calibration",
    summary="one pattern up a staircase of 2, 2.5, 3 and 3.5 psi: the table that the simulator is fitted to",
    pressures_psi=(2.0, 2.5, 3.0, 3.5),
    trials=5,
    plan=_plan,
    can_hold=True,
    allowed=AllowedCounts(pressures=(1, 20)),
)
