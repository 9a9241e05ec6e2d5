"""Frames and pressures on their way to a recorder, on a rig of doubles in virtual time."""

import numpy as np
import pytest

from labctl.instruments.readings import MarkerFrames
from labctl.mocap.marker_frames import concatenate, select_frames
from labctl.rig import Rig
from labctl.stop import OperatorStop


def open_rig(virtual):
    return Rig(virtual.config, stop=OperatorStop(), notify=lambda _: None, platform=virtual.platform)


class Notes:
    """A recorder that keeps what it is given; `broken` raises on every call."""

    def __init__(self, broken=False):
        self.batches, self.samples, self.errors = [], [], []
        self.broken = broken

    def take_frames(self, frames):
        self.batches.append(frames)
        if self.broken:
            raise OSError("no space left")

    def take_pressure(self, sample):
        self.samples.append(sample)
        if self.broken:
            raise OSError("no space left")

    def fail(self, error):
        self.errors.append(error)


def test_every_frame_and_pressure_between_two_verbs_is_handed_over(rig_with):
    virtual = rig_with()
    notes = Notes()
    with open_rig(virtual) as rig:
        rig.wait(1)
        begin_s = rig.clock.now_s()
        with rig.recording(notes):
            mark = rig._instruments.feed.mark()
            rig.wait(2)
            frames, _ = rig.capture(1)
            rig.wait(2)
            known = rig._instruments.feed.since(mark)
        end_s = rig.clock.now_s()
        given = concatenate(notes.batches)
        rig.wait(1)
    # Nothing is missing, nothing came twice, and nothing came after the end.
    assert len(concatenate(notes.batches)) == len(given)
    first = int(np.searchsorted(given.time_s, known.time_s[0]))
    found = select_frames(given, first, first + len(known))
    for name in MarkerFrames.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(found, name), getattr(known, name))
    assert (np.diff(given.time_s) > 0).all()
    assert set(frames.time_s) <= set(given.time_s)
    assert begin_s <= given.arrival_s[0] <= given.arrival_s[-1] <= end_s
    assert (np.diff(given.arrival_s) >= 0).all()
    # 20 Hz, of which an exchange with the valves takes one now and then.
    due = 20 * (end_s - begin_s)
    assert due * 0.9 < len(notes.samples) < due + 3
    for sample in notes.samples:
        assert begin_s <= sample.asked_s <= sample.came_s <= end_s
        assert sample.reading.gauge_psi == pytest.approx(0, abs=0.1)


def test_the_pressures_of_a_vent_are_recorded_too(rig_with):
    virtual = rig_with()
    notes = Notes()
    with open_rig(virtual) as rig, rig.recording(notes):
        rig.make_safe()
        rig.jam({4})
        rig.start_control()
        rig.ramp_to(2.0, lambda _: None)
        rig.settle(2.0, lambda _: None)
        held = len(notes.samples)
        rig.make_safe()
        falling = [sample.reading.gauge_psi for sample in notes.samples[held:]]
    assert falling[0] > 0.5
    # SAFE takes half a second of readings without pressure.
    assert len(falling) > 10
    assert falling[-1] < virtual.config.limits.safe_pressure_psi
    came_s = [sample.came_s for sample in notes.samples]
    assert came_s == sorted(came_s)


def test_a_recorder_that_fails_ends_neither_the_stream_nor_the_watch(rig_with):
    virtual = rig_with()
    notes = Notes(broken=True)
    with open_rig(virtual) as rig:
        with rig.recording(notes):
            rig.wait(2)
        frames, trace = rig.capture(1)
    assert len(frames) > 200
    assert len(trace.pressures_psi) > 1
    assert len(notes.errors) == len(notes.batches) + len(notes.samples) > 10


def test_two_recorders_may_overlap(rig_with):
    virtual = rig_with()
    one, other = Notes(), Notes()
    with open_rig(virtual) as rig, rig.recording(one):
        with rig.recording(other):
            rig.wait(1)
        rig.wait(1)
    assert len(one.samples) > len(other.samples) > 0
    assert len(concatenate(one.batches)) > len(concatenate(other.batches)) > 0
