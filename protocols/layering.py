"""Two sheets with the same two patterns, glued in either order: does it matter which lies on top?

Source: Parsa et al., RoboSoft 2023, section II.D, question 2, and Table III.
"""

from itertools import product

from labctl.config.design import Design
from labctl.config.rig import RigConfig
from labctl.ledger.records import RunRequest
from labctl.session.contract import AllowedCounts, Protocol, Trial
from protocols.five_trial import inflate_once


def both_orders(patterns: tuple[str, ...]) -> tuple[str, ...]:
    """The two placements of two patterns, named as Table III does."""
    first, second = patterns
    return f"{first} on {second}", f"{second} on {first}"


def _plan(request: RunRequest, design: Design, rig: RigConfig) -> tuple[Trial, ...]:
    """One sheet after the other; on each, the patterns take turns."""
    (pressure_psi,) = request.pressures_psi
    kinds = product(request.placements, range(request.trials), request.patterns)
    return tuple(
        Trial(
            number,
            placement,
            pattern,
            (pressure_psi,),
            inflate_once(request, pattern, pressure_psi, design, rig),
            sheet=f"the sheet of {design.name} glued {placement}",
        )
        for number, (placement, _, pattern) in enumerate(kinds, start=1)
    )


LAYERING = Protocol(
    name="layering",
    summary="two patterns on two sheets, glued in either order, five trials each, compared",
    pressures_psi=(3.9,),
    trials=5,
    plan=_plan,
    can_hold=True,
    allowed=AllowedCounts(patterns=(2, 2)),
    placements=both_orders,
)
