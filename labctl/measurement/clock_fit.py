"""The marker server's clock on the laboratory's.

Every frame carries the server's time and the laboratory's clock when it was read. The way between can only delay it,
so the true line lies under all points (server, laboratory), and of all such lines the one with the least delay in sum
is taken: an edge of the points' lower convex hull, the one over their mean time. It is exact, and a burst of late
frames does not move it.
"""

import numpy as np
from numpy.typing import NDArray

from labctl.errors import LabError
from labctl.measurement.result import ClockFit

Times = NDArray[np.float64]

# The least delays scatter by tenths of a millisecond: over seconds that would pass for hundreds of parts per million,
# while no true drift comes to more than a few milliseconds in half a minute.
SHORTEST_FOR_DRIFT_S = 30.0
# No quartz is so far off: such a slope comes from delays that grew or shrank.
LARGEST_DRIFT_PPM = 200.0
# Frames that wait come closer together than they were made, and none is missing between them.
LARGEST_LEAP_S = 0.25


def fit_clock(time_s: Times, arrival_s: Times, frequency_hz: float) -> ClockFit:
    """Fit the clock of n frames, in the order sent: `time_s` the server's, `arrival_s` the laboratory's, both (n,).

    Below `SHORTEST_FOR_DRIFT_S`, or where it would be above `LARGEST_DRIFT_PPM`, the drift is taken to be 0.

    Raises:
        LabError: there is no frame, or the server's time does not grow from frame to frame, or leaps.
    """
    if not len(time_s):
        raise LabError("no marker frame was recorded: there is nothing to fit the marker server's clock to")
    steps_s = np.diff(time_s)
    if not (steps_s > 0).all():
        back = int(np.argmin(steps_s > 0))
        raise LabError(
            f"the marker server's time goes from {time_s[back]:.6f} s to {time_s[back + 1]:.6f} s at frame "
            f"{back + 1}; it was started anew, or its clock was set: repeat the trial"
        )
    leaps_s = steps_s - np.diff(arrival_s)
    if (leaps_s > LARGEST_LEAP_S + 1 / frequency_hz).any():
        ahead = int(np.argmax(leaps_s))
        raise LabError(
            f"the marker server's time goes {leaps_s[ahead]:.3f} s further than the laboratory's from frame {ahead} "
            f"to frame {ahead + 1}; its clock was set, or frames that waited were lost: repeat the trial"
        )
    # Relative to the first frame, so that the small differences keep their digits.
    elapsed_s = time_s - time_s[0]
    delay_s = (arrival_s - arrival_s[0]) - elapsed_s
    # Of the frames that were read at once, all but the last only waited longer; the first of all ends the hull.
    is_last_of_read = np.append(np.diff(arrival_s) != 0, True)
    is_last_of_read[0] = True
    drift, least_s = _floor(elapsed_s[is_last_of_read], delay_s[is_last_of_read], float(elapsed_s.mean()))
    if elapsed_s[-1] < SHORTEST_FOR_DRIFT_S or abs(drift) > LARGEST_DRIFT_PPM / 1e6:
        drift, least_s = 0.0, float(delay_s.min())
    left_s = delay_s - (least_s + drift * elapsed_s)
    return ClockFit(
        offset_s=float(arrival_s[0] + least_s - (1 + drift) * time_s[0]),
        drift_ppm=drift * 1e6,
        delay_p50_s=float(np.percentile(left_s, 50)),
        delay_p99_s=float(np.percentile(left_s, 99)),
        frames=len(time_s),
        lost=int(np.maximum(np.rint(steps_s * frequency_hz) - 1, 0).sum()),
    )


def lab_times_s(fit: ClockFit, time_s: Times) -> Times:
    """The server's times (n,) on the laboratory's clock."""
    return fit.offset_s + (1 + fit.drift_ppm / 1e6) * time_s


def _floor(x: Times, y: Times, middle: float) -> tuple[float, float]:
    """Slope, and value at 0, of the edge of the lower convex hull that is over `middle`; `x` rises.

    Source: A. M. Andrew, Information Processing Letters 9 (1979) 216.
    """
    hull: list[tuple[float, float]] = []
    for point in zip(x.tolist(), y.tolist(), strict=True):
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    right = next((number for number, point in enumerate(hull) if point[0] >= middle), 0)
    if right == 0:
        return 0.0, hull[0][1]
    (x0, y0), (x1, y1) = hull[right - 1 : right + 1]
    slope = (y1 - y0) / (x1 - x0)
    return slope, y0 - slope * x0


def _turns_down(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether `b` lies on or above the line from `a` to `c`."""
    return (b[0] - a[0]) * (c[1] - a[1]) <= (c[0] - a[0]) * (b[1] - a[1])
