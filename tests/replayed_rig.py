"""A rig that replays a recorded trial: its verbs move its clock, and what was recorded by then is what it says."""

from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from labctl.instruments.readings import (
    Identity,
    MarkerFrames,
    PressureReading,
    PressureSample,
    PressureSamples,
)
from labctl.measurement.windows import Window
from labctl.mocap.marker_frames import between, select_frames
from labctl.rig.instruments import Identities
from labctl.rig.trace import PressureTrace
from labctl.safety.safe_state import SafeReport

# The clock after a look is a sum; a window begins to the last bit where the recorded one did.
_SNAP_S = 1e-6
NOBODY = Identity("a recording")


@dataclass(frozen=True)
class RecordedTrial:
    """One baseline window, one level window, and all that was recorded around them."""

    frames: MarkerFrames
    pressures: PressureSamples
    windows: tuple[Window, ...]

    def window(self, kind):
        (found,) = (window for window in self.windows if window.kind == kind)
        return found


@dataclass
class ReplayedRig:
    """The verbs of `labctl.rig.Rig` on a recording.

    `looks_s` is how long the protocol looks whether the sheet is still: the clock waits so long before a window for
    it. A capture that begins where a recorded window does is that window's.
    """

    config: object
    recorded: RecordedTrial
    stop: object
    looks_s: float
    at_settle: object = lambda: None
    safe_report: SafeReport | None = None
    identities = Identities(NOBODY, NOBODY, NOBODY)
    _recorder: object = None
    _handed_frames: int = 0
    _handed_pressures: int = 0

    def __post_init__(self):
        self.time_s = float(self.recorded.frames.arrival_s[0])

    @property
    def clock(self):
        return self

    def now_s(self):
        return self.time_s

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.make_safe()

    def check(self):
        self.stop.check()

    def wait(self, seconds):
        self._go_to(self.time_s + seconds)

    def fall_below(self, _pressure_psi):
        self._go_to(self.recorded.window("baseline").start_s - self.looks_s)

    def jam(self, channels):
        self.check()
        return frozenset(channels)

    def start_control(self):
        self.check()

    def ramp_to(self, pressure_psi, watch, _from_psi=0.0):
        self.check()
        watch(PressureReading(pressure_psi, pressure_psi))

    def settle(self, _pressure_psi, _watch):
        self.at_settle()
        self._go_to(self.recorded.window("level").start_s - self.looks_s)

    def capture(self, seconds):
        start_s, end_s = self.time_s, self.time_s + seconds
        for window in self.recorded.windows:
            if window.start_s == start_s:
                end_s = window.end_s
        self._go_to(end_s)
        frames, pressures = self.recorded.frames, self.recorded.pressures
        read = (pressures.time_s >= start_s) & (pressures.time_s <= end_s)
        trace = PressureTrace(tuple(pressures.time_s[read]), tuple(pressures.gauge_psi[read]))
        return between(frames, frames.arrival_s, start_s, end_s), trace

    @contextmanager
    def recording(self, recorder):
        self._recorder = recorder
        yield
        self._hand(np.inf)
        self._recorder = None

    def make_safe(self):
        self.safe_report = SafeReport(0.0, 0.0, "exhaust", frozenset(), ())
        return self.safe_report

    def _go_to(self, time_s):
        self.check()
        assert time_s >= self.time_s, "a recording goes one way"
        starts_s = [window.start_s for window in self.recorded.windows]
        self.time_s = next((start_s for start_s in starts_s if abs(start_s - time_s) < _SNAP_S), time_s)
        self._hand(self.time_s)

    def _hand(self, until_s):
        """Give the recorder what came since the last time."""
        if self._recorder is None:
            return
        frames, pressures = self.recorded.frames, self.recorded.pressures
        first, end = self._handed_frames, int(np.searchsorted(frames.arrival_s, until_s, "right"))
        self._recorder.take_frames(select_frames(frames, first, end))
        self._handed_frames = end
        first, end = self._handed_pressures, int(np.searchsorted(pressures.came_s, until_s, "right"))
        for row in range(first, end):
            reading = PressureReading(
                float(pressures.gauge_psi[row]),
                float(pressures.setpoint_psi[row]),
                frozenset(pressures.status[row].split()),
            )
            asked_s, came_s = float(pressures.asked_s[row]), float(pressures.came_s[row])
            self._recorder.take_pressure(PressureSample(reading, asked_s, came_s))
        self._handed_pressures = end
