"""The steps of a checklist on a rig of the test's own: what each waits for, what it marks, when it gives up."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from labctl.config.load import load_design, rig_from_text
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.errors import InstrumentError, Unsafe
from labctl.instruments.readings import MarkerFrames
from labctl.measurement.windows import Window
from labctl.mocap.marker_frames import concatenate
from labctl.session.contract import Bench
from protocols.steps import (
    capture_baseline,
    capture_level,
    hold_pressure,
    hold_until_settled,
    vent_and_unjam,
    wait_until_relaxed,
    wait_until_uninflated,
    watch_the_sheet_relax,
)

TEXT = rig_toml(DoublesSettings(design=load_design("known")), "/dev/null", "/dev/zero", "127.0.0.1", 0)
CONFIG = rig_from_text(TEXT, "rig.toml")
STILL = CONFIG.measurement


class RigInHand:
    """Its time goes by in its verbs only; `height_mm` is where the sheet is, `seen` how many markers are."""

    def __init__(self, height_mm=lambda _: 0.0, seen=16):
        self.config = CONFIG
        self.clock = self
        self.height_mm, self.seen = height_mm, seen
        self.time_s = 100.0
        self.done = []
        self.safe = True

    def now_s(self):
        return self.time_s

    def wait(self, seconds):
        self.done.append("wait")
        self.time_s += seconds

    def fall_below(self, pressure_psi):
        self.done.append(f"fall below {pressure_psi:g}")

    def settle(self, pressure_psi, _watch):
        self.done.append(f"settle at {pressure_psi:g}")

    def capture(self, seconds):
        self.done.append("capture")
        self.time_s += seconds
        ids = np.array([point.id for point in CONFIG.markers.points], dtype=np.int32)
        cond = np.where(np.arange(len(ids)) < self.seen, 3.0, -1.0).astype(np.float32)
        places_mm = np.column_stack(
            [CONFIG.markers.points_mm(), np.full(len(ids), self.height_mm(self.time_s))]
        )
        time_s = np.array([self.time_s])
        frames = MarkerFrames(
            time_s, time_s, np.array([0, len(ids)]), ids, places_mm.astype(np.float32), cond
        )
        return frames, SimpleNamespace(mean_psi=1.5)

    def make_safe(self):
        self.done.append("make safe")
        return SimpleNamespace(safe=self.safe, describe=lambda: "UNSAFE: the exhaust reads closed")


def do(step, rig):
    """The windows that a step marked."""
    marked = []
    step.do(Bench(rig, marked.append, lambda _: None))
    return marked


def still_from(end_s):
    """A sheet that sinks by 1 mm/s until then."""
    return lambda time_s: max(0.0, end_s - time_s)


def test_an_uninflated_sheet_and_a_held_pressure_are_not_looked_at_for_stillness():
    rig = RigInHand(still_from(1e9))

    do(wait_until_uninflated(CONFIG), rig)
    do(hold_pressure(1.5, CONFIG), rig)

    assert rig.done == ["fall below 0.1", "settle at 1.5"]


def test_a_sheet_has_relaxed_when_there_is_no_pressure_and_it_has_stood_still_for_so_long():
    rig = RigInHand(still_from(110.0))

    do(wait_until_relaxed(CONFIG), rig)

    assert rig.done[:2] == ["fall below 0.1", "capture"]
    assert 110 + STILL.still_over_s - 1 <= rig.time_s <= 110 + STILL.still_over_s + 2


def test_a_level_has_settled_when_the_pressure_has_and_then_the_shape():
    rig = RigInHand(still_from(108.0))

    do(hold_until_settled(1.5, CONFIG), rig)

    assert rig.done[:2] == ["settle at 1.5", "capture"]
    assert rig.time_s >= 108 + STILL.still_over_s - 1


@pytest.mark.parametrize(
    ("step", "timeout_s", "setting"),
    [
        (wait_until_relaxed(CONFIG), STILL.relax_timeout_s, "relax_timeout"),
        (hold_until_settled(1.5, CONFIG), STILL.shape_timeout_s, "shape_timeout"),
    ],
)
def test_a_sheet_that_creeps_on_is_given_up(step, timeout_s, setting):
    """It moves by less than the limit from look to look, and by more in the time that counts."""
    creep_mm_per_s = 1.5 * STILL.still_mm / STILL.still_over_s
    rig = RigInHand(lambda time_s: -creep_mm_per_s * time_s)

    with pytest.raises(InstrumentError, match=f"not still within.*measurement.{setting}"):
        do(step, rig)

    assert rig.time_s == pytest.approx(100 + timeout_s, abs=2)


def test_a_sheet_that_is_not_seen_is_not_waited_for():
    rig = RigInHand(seen=STILL.min_points - 1)

    with pytest.raises(InstrumentError, match=f"{STILL.min_points - 1} of 16 markers were seen at most"):
        do(hold_until_settled(1.5, CONFIG), rig)

    assert rig.time_s <= 100 + STILL.still_over_s + 2


@pytest.mark.parametrize(("min_share", "is_seen"), [(0.4, True), (0.5, False)])
def test_a_look_sees_a_marker_by_the_share_of_frames_that_the_rig_asks_for(min_share, is_seen):
    rig = RigInHand()
    rig.config = replace(CONFIG, measurement=replace(STILL, min_share=min_share))
    capture, gone = rig.capture, RigInHand(seen=0)

    def mostly_hidden(seconds):
        frames, hold = capture(seconds)
        hidden, _ = gone.capture(seconds)
        return concatenate([frames, frames, hidden, hidden, hidden]), hold

    rig.capture = mostly_hidden
    if is_seen:
        do(hold_until_settled(1.5, CONFIG), rig)
        return
    with pytest.raises(InstrumentError, match="0 of 16 markers were seen at most"):
        do(hold_until_settled(1.5, CONFIG), rig)


def test_a_window_is_the_time_of_its_capture():
    capture_s = CONFIG.limits.capture_s
    end_s = 100 + capture_s
    assert do(capture_baseline(CONFIG), RigInHand()) == [Window("baseline", 100.0, end_s)]
    assert do(capture_level(1.5, CONFIG), RigInHand()) == [Window("level", 100.0, end_s, 1.5)]
    assert do(watch_the_sheet_relax(30.0), RigInHand()) == [Window("relaxing", 100.0, 130.0)]


def test_a_capture_that_fails_marks_nothing():
    rig = RigInHand()
    rig.capture = lambda _: (_ for _ in ()).throw(InstrumentError("the stream stalled"))
    marked = []
    for step in (capture_baseline(CONFIG), capture_level(1.5, CONFIG)):
        with pytest.raises(InstrumentError, match="stalled"):
            step.do(Bench(rig, marked.append, lambda _: None))
    assert marked == []


def test_a_rig_that_does_not_read_back_safe_is_no_vented_one():
    rig = RigInHand()
    do(vent_and_unjam(CONFIG), rig)
    rig.safe = False
    with pytest.raises(Unsafe, match="exhaust reads closed"):
        do(vent_and_unjam(CONFIG), rig)


def test_every_step_may_last_longer_than_what_it_waits_for():
    slow = replace(STILL, relax_timeout_s=1000.0, shape_timeout_s=2000.0)
    config = replace(CONFIG, measurement=slow, limits=replace(CONFIG.limits, capture_s=30.0))
    assert wait_until_relaxed(config).deadline_s > 1000 + config.limits.vent_timeout_s
    assert hold_until_settled(1.5, config).deadline_s > 2000 + config.limits.settle_timeout_s
    assert capture_level(1.5, config).deadline_s > 30
    assert watch_the_sheet_relax(500.0).deadline_s > 500
