import made_measurement as made
import numpy as np
import pytest

from labctl.errors import LabError
from labctl.export.motion import motion_of
from labctl.instruments.readings import MarkerFrames, PressureSamples
from labctl.measurement.recording import lay_out
from labctl.measurement.windows import Window


def recording_of(run, frames=None, pressures=None, **gaps):
    frames = made.frames(run, **gaps) if frames is None else frames
    return lay_out(frames, made.pressures() if pressures is None else pressures, run.basis("sphere"))


def test_frames_that_never_came_leave_gaps_and_shift_nothing():
    run = made.run()
    whole = motion_of(recording_of(run), made.windows())
    gappy = motion_of(recording_of(run, lost=(100, 101, 102, 900)), made.windows())

    missing = np.isnan(gappy.positions_mm).all(axis=(1, 2))
    assert np.flatnonzero(missing).tolist() == [100, 101, 102, 900]
    assert gappy.positions_mm[~missing] == pytest.approx(whole.positions_mm[~missing], abs=1e-3)


def test_what_was_not_seen_stays_not_seen():
    motion = motion_of(recording_of(made.run(), hidden=((7, 3), (8, 3))), made.windows())

    assert np.argwhere(np.isnan(motion.positions_mm[:, :, 0])).tolist() == [[7, 3], [8, 3]]


def test_positions_are_in_the_sheet_frame_and_heights_are_those_of_the_sheet():
    run = made.run()
    motion = motion_of(recording_of(run), made.windows())
    flat, held = motion.positions_mm[600], motion.positions_mm[round(16.5 * made.FREQUENCY_HZ)]

    assert motion.in_sheet_frame
    assert flat[:, :2] == pytest.approx(
        np.array([(point.x_mm, point.y_mm) for point in made.POINTS]), abs=1e-3
    )
    assert flat[:, 2] == pytest.approx(np.zeros(16), abs=1e-3)
    assert held[:, 2] == pytest.approx(made.heights_mm(run, "sphere", 3.9, seed=1), abs=1e-3)


def test_without_a_baseline_positions_stay_in_the_instruments_frame():
    run = made.run()
    motion = motion_of(recording_of(run), [window for window in made.windows() if window.kind == "level"])

    assert not motion.in_sheet_frame
    first_mm = made.to_instrument(np.array([(point.x_mm, point.y_mm, 0.0) for point in made.POINTS]))
    assert motion.positions_mm[0] == pytest.approx(first_mm, abs=1e-3)


def test_pressure_and_events_are_on_the_frames_own_time():
    pressures = made.pressures()
    motion = motion_of(recording_of(made.run(), pressures=pressures), made.windows())
    times_s = made.OFFSET_S + 0.002 + np.arange(len(motion.gauge_psi)) / made.FREQUENCY_HZ

    assert motion.gauge_psi == pytest.approx(
        np.interp(times_s, pressures.time_s, pressures.gauge_psi), abs=1e-4
    )
    assert motion.setpoint_psi[round(12 * made.FREQUENCY_HZ)] == 3.9
    # The frames arrive 2 ms after they were taken by the laboratory's clock.
    assert motion.events == (
        (pytest.approx(1.998, abs=1e-4), "baseline begins"),
        (pytest.approx(2.998, abs=1e-4), "baseline ends"),
        (pytest.approx(15.998, abs=1e-4), "level 3.9 psi begins"),
        (pytest.approx(16.998, abs=1e-4), "level 3.9 psi ends"),
    )


def test_two_frames_for_one_place_keep_the_first():
    run = made.run()
    frames = made.frames(run, seconds=4.0)
    double = MarkerFrames(
        np.insert(frames.time_s, 11, frames.time_s[10] + 1e-4),
        np.insert(frames.arrival_s, 11, frames.arrival_s[10] + 1e-4),
        np.insert(frames.starts, 11, frames.starts[11]),
        frames.ids,
        frames.positions_mm,
        frames.cond,
    )
    motion = motion_of(
        recording_of(run, frames=double), [Window("baseline", made.OFFSET_S + 2, made.OFFSET_S + 3)]
    )

    assert len(motion.positions_mm) == len(frames)
    assert np.isfinite(motion.positions_mm).all() == (double.starts[11] > double.starts[10])


def test_no_pressure_is_no_pressure():
    empty = PressureSamples(*(np.zeros(0) for _ in range(4)), ())
    assert len(motion_of(recording_of(made.run(), pressures=empty), made.windows()).gauge_psi) == 0


def test_a_clock_that_leaps_is_refused_rather_than_filled():
    run = made.run()
    frames = made.frames(run, seconds=4.0)
    frames.time_s[500:] += 3600.0
    frames.arrival_s[500:] += 3600.0
    with pytest.raises(LabError, match="leaps by 3600 s after frame 500"):
        motion_of(recording_of(run, frames=frames), made.windows())
