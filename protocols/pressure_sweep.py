"""One pattern at several pressures, each reached from rest: how e_t depends on the pressure.

Source: Parsa et al., RoboSoft 2023, section III.A: the neat sphere at 2.6, 3.0 and 3.5 psi beside 3.9.
"""

from itertools import product

from labctl.config.design import Design
from labctl.config.rig import RigConfig
from labctl.ledger.records import RunRequest
from labctl.session.contract import AllowedCounts, Protocol, Trial
from protocols.five_trial import inflate_once


def _plan(request: RunRequest, design: Design, rig: RigConfig) -> tuple[Trial, ...]:
    """All pressures once, then all again: what drifts over the hour affects every pressure equally."""
    (pattern,), (placement,) = request.patterns, request.placements
    rounds = product(range(request.trials), request.pressures_psi)
    return tuple(
        Trial(
            number,
            placement,
            pattern,
            (pressure_psi,),
            inflate_once(request, pattern, pressure_psi, design, rig),
        )
        for number, (_, pressure_psi) in enumerate(rounds, start=1)
    )


PRESSURE_SWEEP = Protocol(
    name="pressure-sweep",
    summary="one pattern at 2.6, 3.0, 3.5 and 3.9 psi, five trials each",
    pressures_psi=(2.6, 3.0, 3.5, 3.9),
    trials=5,
    plan=_plan,
    can_hold=True,
    allowed=AllowedCounts(pressures=(1, 20)),
)
