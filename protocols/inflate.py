"""Inflate once: one trial of one pattern at one pressure, without waiting for the sheet to come to rest.

For a look at a shape. What counts towards e_t is measured by five-trial, on a sheet that has relaxed.
"""

from labctl.config.design import Design
from labctl.config.rig import RigConfig
from labctl.ledger.records import RunRequest
from labctl.session.contract import AllowedCounts, Checklist, Protocol, Trial
from protocols.five_trial import repeated_trials
from protocols.steps import (
    capture_baseline,
    capture_level,
    hold_pressure,
    jam,
    ramp,
    vent_and_unjam,
    wait_until_uninflated,
)


def _plan(request: RunRequest, design: Design, rig: RigConfig) -> tuple[Trial, ...]:
    (pattern,), (pressure_psi,) = request.patterns, request.pressures_psi
    checklist = Checklist(
        setup=(wait_until_uninflated(rig), capture_baseline(rig)),
        main=(
            jam(design.channels(pattern), pattern),
            ramp(pressure_psi, rig),
            hold_pressure(pressure_psi, rig, request.hold_s),
            capture_level(pressure_psi, rig),
        ),
        teardown=(vent_and_unjam(rig),),
    )
    return repeated_trials(request, request.pressures_psi, checklist)


INFLATE = Protocol(
    name="inflate",
    summary="one pattern, one pressure, once, without waiting for the sheet to come to rest",
    pressures_psi=(3.9,),
    trials=1,
    plan=_plan,
    can_hold=True,
    allowed=AllowedCounts(trials=(1, 1)),
)
