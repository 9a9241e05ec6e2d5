"""Markers as a witness: a sheet that moves on while the pressure reading stands."""

from dataclasses import replace

import numpy as np
import pytest
from virtual_time import VirtualTime

from labctl.config.rig import Limits, MarkerPoint, MarkersConfig
from labctl.doubles.markers import DEFAULT_POINTS
from labctl.instruments.readings import MarkerFrames, PressureReading, PressureSample
from labctl.safety.sheet_witness import SheetWitness
from labctl.safety.trip_rules import Expected

FREQUENCY_HZ = 240.0
POLL_S = 0.05
MM_PER_PSI = 1.5
FLAT_MM = np.array([(point.x_mm, point.y_mm, 0.0) for point in DEFAULT_POINTS])
SHAPE = np.hypot(FLAT_MM[:, 0] - 70, FLAT_MM[:, 1] - 70) / 40


def markers_config(points=DEFAULT_POINTS):
    points = tuple(MarkerPoint(point.id, point.x_mm, point.y_mm) for point in points)
    return MarkersConfig("marker stream", "phasespace", "", 0, FREQUENCY_HZ, "+z", 1.0, points, 0.5)


class Inflation:
    """A sheet that follows a true pressure with a time constant, and a reading of whatever is said."""

    def __init__(self, limits=None, seed=0):
        self.clock = VirtualTime(start_s=0.0)
        self.witness = SheetWitness(markers_config(), limits or Limits(), self.clock)
        self.rng = np.random.default_rng(seed)
        self.height_psi = 0.0
        self.creep_psi = 0.0

    def frames(self, spoil):
        count = round(POLL_S * FREQUENCY_HZ)
        times_s = self.clock.now_s() + (np.arange(count) + 1) / FREQUENCY_HZ - POLL_S
        ids = np.tile([point.id for point in DEFAULT_POINTS], count)
        rise_mm = MM_PER_PSI * (self.height_psi + self.creep_psi) * SHAPE
        places = np.tile(FLAT_MM + rise_mm[:, None] * [0, 0, 1], (count, 1, 1))
        places = places + self.rng.normal(0, 0.1, places.shape)
        cond = np.full(places.shape[:2], 2.0)
        spoil(places, cond, self.clock.now_s())
        return MarkerFrames(
            times_s,
            np.full(count, self.clock.now_s()),
            np.arange(count + 1) * len(DEFAULT_POINTS),
            ids.astype(np.int32),
            places.reshape(-1, 3).astype(np.float32),
            cond.reshape(-1).astype(np.float32),
        )

    def run(
        self,
        true_psi,
        seconds,
        *,
        reading_psi=None,
        to_psi=3.9,
        rate_psi_per_s=1.0,
        follows_s=1.5,
        creep=0.02,
        spoil=lambda places, cond, now_s: None,
        silent=lambda now_s: False,
        late=0.0,
    ):
        """When the witness trips and why; the ramp begins after a second of rest.

        `late` is the share of looks that a busy computer misses: what came meanwhile is taken at the next one.
        """
        begins_s, waiting, delays = 1.0, [], np.random.default_rng(7)
        while self.clock.now_s() < seconds:
            self.clock.sleep(POLL_S)
            now_s = self.clock.now_s()
            ramp_s = now_s - begins_s
            setpoint = min(max(0.0, rate_psi_per_s * ramp_s), to_psi)
            truth = true_psi(ramp_s, setpoint)
            self.height_psi += (truth - self.height_psi) * POLL_S / follows_s
            self.creep_psi = creep * truth * np.log10(max(1.0, ramp_s))
            if not silent(now_s):
                waiting.append(self.frames(spoil))
            if delays.random() < late:
                continue
            for frames in waiting:
                self.witness.take(replace(frames, arrival_s=np.full(len(frames), now_s)))
            waiting = []
            shown = truth if reading_psi is None else reading_psi(ramp_s, truth)
            sample = PressureSample(PressureReading(round(shown, 2), setpoint), now_s, now_s)
            mode = "control" if ramp_s >= 0 else None
            reason = self.witness.judge(sample, Expected(setpoint, mode=mode))
            if reason is not None:
                return ramp_s, truth, reason
        return None


def held(ramp_s, setpoint):
    return max(0.0, setpoint - 0.1 * (ramp_s < 3.9))


def climbing_from(when_s, rate_psi_per_s):
    return lambda ramp_s, setpoint: held(ramp_s, setpoint) + rate_psi_per_s * max(0.0, ramp_s - when_s)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3, 4))])
@pytest.mark.parametrize("follows_s", [0.1, 0.5, 1.5])
def test_a_sheet_that_comes_to_rest_is_left_alone(seed, follows_s):
    assert Inflation(seed=seed).run(held, 40, follows_s=follows_s) is None


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.long) for seed in range(2, 8))]
)
@pytest.mark.parametrize("late", [0.5, 0.8])
def test_what_a_busy_computer_takes_late_is_no_motion_of_the_sheet(seed, late):
    assert Inflation(seed=seed).run(held, 20, follows_s=1.5, late=late) is None
    tripped = Inflation(seed=seed).run(
        climbing_from(6.0, 0.1), 60, reading_psi=lambda ramp_s, truth: min(truth, 3.9), late=late
    )
    assert tripped[1] < 4.6


@pytest.mark.parametrize("rate_psi_per_s", [0.02, 0.05, 0.1, 0.2, 0.25])
@pytest.mark.parametrize("when_s", [3.9, 6.0, 15.0])
def test_a_pressure_that_climbs_behind_a_reading_that_stands_is_seen(rate_psi_per_s, when_s):
    tripped = Inflation().run(
        climbing_from(when_s, rate_psi_per_s), 60, reading_psi=lambda ramp_s, truth: min(truth, 3.9)
    )
    _, truth_psi, reason = tripped
    assert truth_psi < 4.45
    assert "moves on while the pressure reading stands at 3.90 psi" in reason
    for cause in ("frozen or drifting gauge", "tears", "limits.sheet_response"):
        assert cause in reason


def outliers(share):
    rng = np.random.default_rng(5)

    def spoil(places, cond, now_s):
        places[rng.random(places.shape[:2]) < share] = 0.0

    return spoil


def occluded(markers):
    def spoil(places, cond, now_s):
        if 4.0 < now_s < 4.0 + 20:
            cond[:, :markers] = -1.0

    return spoil


def swapped(places, cond, now_s):
    if now_s > 8.0:
        places[:, [2, 9]] = places[:, [9, 2]]


def swapped_while_one_is_hidden(places, cond, now_s):
    swapped(places, cond, now_s)
    cond[:, 4] = -1.0


def in_a_circle(places, cond, now_s):
    if now_s > 3.0:
        places[:, [2, 9, 12]] = places[:, [9, 12, 2]]


SPOILS = (
    *(outliers(0.01), outliers(0.2), occluded(4), occluded(12)),
    *(swapped, swapped_while_one_is_hidden, in_a_circle),
)


@pytest.mark.parametrize("spoil", SPOILS)
def test_spoilt_frames_neither_trip_nor_blind_it(spoil):
    assert Inflation().run(held, 20, spoil=spoil) is None
    tripped = Inflation().run(
        climbing_from(9.0, 0.1), 60, reading_psi=lambda ramp_s, truth: min(truth, 3.9), spoil=spoil
    )
    assert tripped[1] < 4.5


def test_a_reading_that_moves_is_not_contradicted():
    """A setpoint that is lowered by somebody lowers the sheet too."""
    falling = Inflation().run(
        lambda ramp_s, setpoint: setpoint,
        30,
        reading_psi=lambda ramp_s, truth: truth - 0.1 * max(0, ramp_s - 6),
    )
    assert falling is None


@pytest.mark.parametrize("at_s", [2.0, 4.0, 12.0])
def test_a_stream_that_falls_silent_under_pressure_trips_within_its_limit(at_s):
    ramp_s, _, reason = Inflation().run(held, 20, silent=lambda now_s: now_s > at_s)
    assert ramp_s + 1.0 - at_s == pytest.approx(Limits().unseen_after_s, abs=0.15)
    assert "no frame with 3 markers or more came" in reason


def test_markers_that_are_all_hidden_are_no_stream():
    def hide(places, cond, now_s):
        if now_s > 4.0:
            cond[:] = -1.0

    ramp_s, _, reason = Inflation().run(held, 20, spoil=hide)
    assert ramp_s < 4.3
    assert "nobody measures" in reason


def test_without_pressure_nobody_needs_markers():
    assert Inflation().run(lambda *_: 0.0, 10, to_psi=0.0, silent=lambda now_s: now_s > 2) is None


def test_a_witness_that_saw_nothing_is_absent():
    clock = VirtualTime(start_s=0.0)
    witness = SheetWitness(markers_config(), Limits(), clock)
    assert "since the rig was opened" in witness.absence()


def test_a_slower_sheet_takes_its_own_time_constant():
    slow = {"follows_s": 5.0, "seconds": 40}
    assert Inflation().run(held, **slow) is not None
    assert Inflation(Limits(sheet_response_s=6.0)).run(held, **slow) is None
