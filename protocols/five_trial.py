"""Five trials of one pattern at one pressure: the published measurement.

Source: Parsa et al., RoboSoft 2023, sections II.C and II.E: held at 3.9 +- 0.1 psi (3.6 for the neat sphere, whose
markers hide at more), heights at 16 points, averaged over five trials.
"""

from labctl.config.design import Design
from labctl.config.rig import RigConfig
from labctl.ledger.records import RunRequest
from labctl.session.contract import Checklist, Protocol, Trial
from protocols.steps import (
    capture_baseline,
    capture_level,
    hold_until_settled,
    jam,
    ramp,
    vent_and_unjam,
    wait_until_relaxed,
)


def inflate_once(
    request: RunRequest, pattern: str, pressure_psi: float, design: Design, rig: RigConfig
) -> Checklist:
    """The checklist of one trial of a pattern at a pressure."""
    return Checklist(
        setup=(
            wait_until_relaxed(rig),
            capture_baseline(rig),
        ),
        main=(
            jam(design.channels(pattern), pattern),
            ramp(pressure_psi, rig),
            hold_until_settled(pressure_psi, rig, request.hold_s),
            capture_level(pressure_psi, rig),
        ),
        teardown=(vent_and_unjam(rig),),
    )


def repeated_trials(
    request: RunRequest, pressures_psi: tuple[float, ...], checklist: Checklist
) -> tuple[Trial, ...]:
    """The requested number of trials of one pattern, each by the same checklist."""
    (pattern,), (placement,) = request.patterns, request.placements
    numbers = range(1, request.trials + 1)
    return tuple(Trial(number, placement, pattern, pressures_psi, checklist) for number in numbers)


def _plan(request: RunRequest, design: Design, rig: RigConfig) -> tuple[Trial, ...]:
    (pattern,), (pressure_psi,) = request.patterns, request.pressures_psi
    once = inflate_once(request, pattern, pressure_psi, design, rig)
    return repeated_trials(request, request.pressures_psi, once)


FIVE_TRIAL = Protocol(
    name="five-trial",
    summary="one pattern, one pressure, five trials: e_t as mean +- sd",
    pressures_psi=(3.9,),
    trials=5,
    plan=_plan,
    can_hold=True,
)
