"""A trial's recording on the laboratory's clock: what fell into a window, and whether that is enough."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.errors import LabError
from labctl.instruments.readings import MarkerFrames, PressureSamples
from labctl.measurement.basis import Basis
from labctl.measurement.clock_fit import fit_clock, lab_times_s
from labctl.measurement.law import NEWEST, PLAIN_MEANS
from labctl.measurement.result import ClockFit
from labctl.measurement.sight import Sight, gated_sight, plain_sight
from labctl.mocap.marker_frames import select_frames
from labctl.mocap.tracks import Tracks, follow

# A stream that brought less than this share of what was due had stalled.
FEWEST_FRAMES = 0.5
# Cameras keep their frequency far better; a time in another unit is off by more.
STEP_TOLERANCE = 0.02

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording whose frames (k) have times on the laboratory's clock: `lab_s` float64 (k,), rising.

    `law` is the one by which heights are made of it (`labctl.measurement.law`).
    """

    frames: MarkerFrames
    lab_s: Floats
    pressures: PressureSamples
    basis: Basis
    clock: ClockFit
    law: int = NEWEST

    @cached_property
    def tracks(self) -> Tracks:
        """The markers followed through the whole recording."""
        ids = [point.id for point in self.basis.points]
        return follow(self.frames, self.lab_s, ids, self.basis.frequency_hz)

    def frames_between(self, start_s: float, end_s: float) -> MarkerFrames:
        """The frames from `start_s` to before `end_s` of the laboratory's clock."""
        first, last = np.searchsorted(self.lab_s, [start_s, end_s])
        return select_frames(self.frames, int(first), int(last))

    def sight_between(self, start_s: float, end_s: float, slack_mm: ArrayLike = 0.0) -> Sight | None:
        """The markers from `start_s` to before `end_s`, averaged; None where no frame came.

        `slack_mm`, one or (m,), is how far the sheet itself moves meanwhile.
        """
        frames = self.frames_between(start_s, end_s)
        if not len(frames):
            return None
        if self.law == PLAIN_MEANS:
            return plain_sight(frames, self.basis)
        first, last = np.searchsorted(self.lab_s, [start_s, end_s])
        return gated_sight(frames, self.basis, slack_mm, self.tracks.astray(self.lab_s[first:last]))

    def gauge_psi_between(self, start_s: float, end_s: float) -> Floats:
        """The finite pressure readings from `start_s` to `end_s`, (n,)."""
        time_s, gauge_psi = self.pressures.time_s, self.pressures.gauge_psi
        return gauge_psi[(time_s >= start_s) & (time_s <= end_s) & np.isfinite(gauge_psi)]

    def flow_problem(self, frames: int, start_s: float, end_s: float) -> str | None:
        """What is wrong where a stream brought too few frames; None where it brought enough."""
        due = (end_s - start_s) * self.basis.frequency_hz
        if frames and frames >= FEWEST_FRAMES * due:
            return None
        return (
            f"{frames} of about {due:.0f} frames came in {end_s - start_s:.3g} s, and at least "
            f"{FEWEST_FRAMES:.0%} are needed; check the marker server and the network"
        )

    def left_out_problem(self, sight: Sight) -> str | None:
        """What is wrong where too many samples of a window were left out; None where they were few enough."""
        if sight.share_left_out <= self.basis.max_left_out_of_all:
            return None
        return (
            f"{sight.share_left_out:.1%} of all that the markers showed is far from their medians, and at most "
            f"{self.basis.max_left_out_of_all:.0%} may be (measurement.max_left_out_of_all): look for mirrors, "
            "sunlight and a marker system that needs calibrating"
        )


def lay_out(
    frames: MarkerFrames, pressures: PressureSamples, basis: Basis, law: int = NEWEST
) -> Recording | str:
    """The recording on the laboratory's clock, or why it cannot be laid on it."""
    try:
        clock = fit_clock(frames.time_s, frames.arrival_s, basis.frequency_hz)
    except LabError as error:
        return str(error)
    # Of frames that are missing the steps are integer numbers of periods too.
    steps_s = np.diff(frames.time_s) if len(frames) > 1 else np.ones(1) / basis.frequency_hz
    periods = float(np.percentile(steps_s, 50, method="lower")) * basis.frequency_hz
    if abs(periods - max(round(periods), 1)) > STEP_TOLERANCE:
        return (
            f"the marker server's frames are {periods:.3g} periods of {basis.frequency_hz:g} Hz apart by its own "
            "time: its timebase or its frequency is not what it told; start it anew, and repeat the trial"
        )
    return Recording(frames, lab_times_s(clock, frames.time_s), pressures, basis, clock, law)
