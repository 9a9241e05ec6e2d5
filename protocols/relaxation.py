"""Inflate, vent, and watch the sheet come back: its time constant, which the published work left for later.

Source: Parsa et al., RoboSoft 2023, section III.A, which names the effect and gives no figure.
"""

from dataclasses import replace

from labctl.config.design import Design
from labctl.config.rig import RigConfig
from labctl.errors import BadInput
from labctl.ledger.records import RunRequest
from labctl.session.contract import Protocol, Trial
from protocols.five_trial import inflate_once, repeated_trials
from protocols.steps import vent_and_unjam, watch_the_sheet_relax


def _plan(request: RunRequest, design: Design, rig: RigConfig) -> tuple[Trial, ...]:
    (pattern,), (pressure_psi,) = request.patterns, request.pressures_psi
    if request.watch_s is None:
        raise BadInput("relaxation needs a time to watch the sheet for after venting: --watch '2 min'")
    once = inflate_once(request, pattern, pressure_psi, design, rig)
    checklist = replace(once, main=(*once.main, vent_and_unjam(rig), watch_the_sheet_relax(request.watch_s)))
    return repeated_trials(request, request.pressures_psi, checklist)


RELAXATION = Protocol(
    name="relaxation",
    summary="inflate, vent, record the height for two minutes: the sheet's time constant",
    pressures_psi=(3.9,),
    trials=5,
    plan=_plan,
    can_hold=True,
    watch_s=120.0,
)
