"""Targets of known equations: sphere cap, cylinder, saddle, monkey saddle.

x and y are counted from the sheet's centre along the sheet frame's axes, r is the distance from it.
"""

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.errors import SimError
from sim.geometry import PITCH_M, RADIUS_PITCHES, Geometry
from sim.targets.target import MAX_HEIGHT_M, Target, target_from_function

Axis = Literal["x", "y"]
Floats = NDArray[np.float64]
RIM_M = RADIUS_PITCHES * PITCH_M


def sphere_cap(geometry: Geometry, radius_m: float) -> Target:
    """A cap of a sphere: z = sqrt(R^2 - r^2) - sqrt(R^2 - a^2), in metres, with a = 70 mm.

    z is 0 at the rim of the 140 mm disc. A negative radius is the bowl, the same with the sign of z changed.

    Raises:
        SimError: the radius is not finite, or shorter than a.
    """
    arc_m = _arc(radius_m)
    return target_from_function(
        f"sphere cap of radius {1e3 * radius_m:g} mm", "equation", geometry, lambda x, y: arc_m(x**2 + y**2)
    )


def cylinder(geometry: Geometry, curved_along: Axis, radius_m: float) -> Target:
    """A cylinder curved along x: z = sqrt(R^2 - x^2) - sqrt(R^2 - a^2), in metres, with a = 70 mm; or along y.

    Its straight lines run along the other axis. A negative radius is the trough.

    Raises:
        SimError: the radius is not finite, or shorter than a; or there is no such axis.
    """
    if curved_along not in ("x", "y"):
        raise SimError(f"a cylinder curved along {curved_along!r}: use 'x' or 'y'")
    arc_m = _arc(radius_m)
    return target_from_function(
        f"cylinder curved along {curved_along}, radius {1e3 * radius_m:g} mm",
        "equation",
        geometry,
        lambda x, y: arc_m((x if curved_along == "x" else y) ** 2),
    )


def radius_of_rise_m(rise_m: float) -> float:
    """The radius R = (a^2 + h^2) / (2 h) of the arc that stands h higher in the middle than at a = 70 mm from it.

    A negative rise, the middle lower than the rim, has a negative radius. All in metres.

    Raises:
        SimError: the rise is 0, not finite, or more than a half circle's.
    """
    if not 0 < abs(rise_m) <= RIM_M:
        raise SimError(
            f"a rise of {1e3 * rise_m:g} mm: the middle of the arc must stand at most {1e3 * RIM_M:g} mm above or "
            "below the rim, and not level with it"
        )
    return (RIM_M**2 + rise_m**2) / (2 * rise_m)


def saddle(geometry: Geometry, peak_m: float) -> Target:
    """The saddle, z proportional to x^2 - y^2, scaled so that the columns span -peak to +peak.

    The peak in metres; with 20 mm: the published target. A negative peak changes the sign: low along x instead
    of high.

    Raises:
        SimError: the peak is 0, not finite or beyond 1 m.
    """
    return _scaled("saddle", geometry, peak_m, lambda x, y: x**2 - y**2)


def monkey_saddle(geometry: Geometry, peak_m: float) -> Target:
    """The monkey saddle, z proportional to x^3 - 3 x y^2, scaled so that the columns span -peak to +peak.

    The peak in metres; with 20 mm: the published target. It is high at +x and low at -x; a negative peak
    changes the sign.

    Raises:
        SimError: the peak is 0, not finite or beyond 1 m.
    """
    return _scaled("monkey saddle", geometry, peak_m, lambda x, y: x**3 - 3 * x * y**2)


def _arc(radius_m: float) -> Callable[[Floats], Floats]:
    """The height of the arc above its ends, at a squared distance from its middle."""
    if not (math.isfinite(radius_m) and abs(radius_m) >= RIM_M):
        raise SimError(
            f"a radius of {1e3 * radius_m:g} mm: use one of at least {1e3 * RIM_M:g} mm, half the sheet's width; "
            "negative for a bowl or trough"
        )

    def height_m(distance_squared: Floats) -> Floats:
        middle, end = np.sqrt(radius_m**2 - distance_squared), math.sqrt(radius_m**2 - RIM_M**2)
        # The difference of the two roots, without losing the digits of a very flat arc.
        return math.copysign(1.0, radius_m) * (RIM_M**2 - distance_squared) / (middle + end)

    return height_m


def _scaled(name: str, geometry: Geometry, peak_m: float, form: Callable[[Floats, Floats], Floats]) -> Target:
    if not 0 < abs(peak_m) <= MAX_HEIGHT_M:
        raise SimError(
            f"a {name} with a peak of {1e3 * peak_m:g} mm: use one other than 0, of at most "
            f"{1e3 * MAX_HEIGHT_M:g} mm either way"
        )
    return target_from_function(
        f"{name} of peak {1e3 * peak_m:g} mm",
        "equation",
        geometry,
        lambda x, y: peak_m * form(x, y) / np.abs(form(x, y)).max(),
    )
