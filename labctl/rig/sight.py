"""The newest of what a rig reads, for whoever looks on; nobody who looks on makes the rig wait."""

import numpy as np

from labctl.clock import Clock
from labctl.config.rig import MarkersConfig
from labctl.instruments.readings import PressureReading, PressureSample
from labctl.rig.marker_feed import MarkerFeed


class Sight:
    """The newest pressure, the way to SAFE's too, and how many markers the newest frame has.

    Args:
        markers: whose points are counted.
        feed: the marker stream.
        wall: the wall's clock, by which ages are told.
    """

    def __init__(self, markers: MarkersConfig, feed: MarkerFeed, wall: Clock) -> None:
        self._ids = [point.id for point in markers.points]
        self._feed = feed
        self._wall = wall
        self._pressure: tuple[PressureReading, float] | None = None

    def take_pressure(self, sample: PressureSample) -> None:
        """Keep a reading in place of the last one."""
        self._pressure = (sample.reading, self._wall.now_s())

    def pressure(self) -> tuple[PressureReading, float] | None:
        """The newest reading and its age in s; None before the first."""
        if self._pressure is None:
            return None
        reading, came_s = self._pressure
        return reading, self._wall.now_s() - came_s

    def markers(self) -> tuple[int, int, float] | None:
        """Of the rig's markers, how many the newest frame has, of how many, and its age in s; None before it."""
        batch = self._feed.newest()
        if batch is None or not len(batch):
            return None
        samples = slice(int(batch.starts[-2]), int(batch.starts[-1]))
        seen = batch.ids[samples][batch.cond[samples] > 0]
        return int(np.isin(self._ids, seen).sum()), len(self._ids), self._feed.last_frame_age_s()
