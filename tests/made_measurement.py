"""Runs as a ledger holds them, made up: synthetic heights, pressures and marker frames, all from plain functions."""

import json
import math
from dataclasses import asdict, replace

import numpy as np

from labctl.config.load import design_text
from labctl.config.rig import (
    Limits,
    MarkerPoint,
    MarkersConfig,
    MeasurementConfig,
    RegulatorConfig,
    RigConfig,
    ValvesConfig,
)
from labctl.instruments.readings import (
    Identity,
    MarkerFrames,
    PressureReading,
    PressureSample,
    PressureSamples,
)
from labctl.ledger.moment import Moment
from labctl.ledger.raw.recording import RawRecorder
from labctl.ledger.records import (
    EventRecord,
    RawFile,
    RunRecord,
    RunRequest,
    SafeReadBack,
    SimulatedHeights,
    TrialRecord,
)
from labctl.ledger.writer import LedgerWriter
from labctl.measurement.result import ClockFit, LevelResult, RelaxationResult, TrialResult
from labctl.measurement.windows import Window
from labctl.mocap.transfer_error import transfer_error

_INNER_MM = (52.5, 87.5)
_ALL_MM = (17.5, 52.5, 87.5, 122.5)
POINTS = tuple(
    MarkerPoint(number, x_mm, y_mm)
    for number, (x_mm, y_mm) in enumerate(
        (x_mm, y_mm)
        for x_mm in (17.5, 35.0, 70.0, 105.0, 122.5)
        for y_mm in (_INNER_MM if x_mm in (17.5, 122.5) else _ALL_MM)
    )
)
FREQUENCY_HZ = 240.0
# A recording's beginning on the laboratory's clock and on the marker server's.
OFFSET_S = 5000.0
SERVER_S = 70.0
BEGUN_S = 100.0
BASELINE = Window("baseline", OFFSET_S + 2.0, OFFSET_S + 3.0)
DEFAULT_PRESSURES_PSI = (3.9,)
# Frames that never came, and (frame, marker) that were not seen.
GAPS = {"lost": (1000, 1001, 1002, 3000), "hidden": ((500, 3), (501, 3))}


def grid_points(count):
    """So many marker points in a spiral over the sheet."""
    turns = np.arange(count)
    radius_mm = 62.0 * np.sqrt((turns + 0.5) / count)
    angle = turns * math.pi * (3 - math.sqrt(5))
    return tuple(
        MarkerPoint(number, round(70 + float(r * np.cos(a)), 2), round(70 + float(r * np.sin(a)), 2))
        for number, (r, a) in enumerate(zip(radius_mm, angle, strict=True))
    )


def rig(points=POINTS, frequency_hz=FREQUENCY_HZ):
    """A rig's configuration as a record holds it: nested dicts."""
    config = RigConfig(
        name="simulated rig",
        source="the doubles' own rig.toml",
        simulated=True,
        speed=20.0,
        regulator=RegulatorConfig(
            "regulator A", "alicat-ascii", "PCD", "/dev/pts/3", 19200, "A", 1, "psi", 0.5
        ),
        valves=ValvesConfig(
            "valve bank", "waveshare-relay", "rtu", "/dev/pts/4", 9600, "", 502, 1, 32, None, 0.5
        ),
        markers=MarkersConfig(
            "marker stream", "phasespace", "127.0.0.1", 30, frequency_hz, "+z", 1.0, points, 0.5
        ),
        limits=Limits(),
        measurement=MeasurementConfig(min_points=12),
    )
    return json.loads(json.dumps(asdict(config)))


def moment(seconds=0.0):
    minutes, rest = divmod(seconds, 60)
    return Moment(f"2026-11-20T14:{int(minutes):02d}:{rest:09.6f}+00:00", BEGUN_S + seconds, "boot-1")


def dome_mm(points, pressure_psi, flat=0.0):
    """A simulator's heights of a sphere: a dome, flatter the larger `flat`."""
    xy = np.array([(point.x_mm - 70, point.y_mm - 70) for point in points])
    across = (xy[:, 0] ** 2 + (1 - flat) * xy[:, 1] ** 2) / 70**2
    return pressure_psi / 3.9 * 18.0 * (1 - 0.9 * across)


def run(
    protocol="five-trial", patterns=("sphere",), pressures_psi=DEFAULT_PRESSURES_PSI, points=POINTS, **more
):
    """A run as it was begun; `more` replaces any field."""
    placements = more.pop("placements", ("neat",))
    request = RunRequest(
        protocol=protocol,
        patterns=tuple(patterns),
        pressures_psi=tuple(pressures_psi),
        trials=more.pop("planned", 5),
        attempts=3,
        placements=tuple(placements),
        watch_s=more.pop("watch_s", None),
    )
    record = RunRecord(
        number=7,
        protocol=protocol,
        begun=moment(),
        request=request,
        planned_trials=request.trials,
        design_name="known",
        design_source="labctl/designs/known.toml",
        design_text=design_text("known"),
        rig_name="simulated rig",
        rig=rig(points),
        simulated=True,
        identities={
            "regulator": Identity("PCD-30PSIG-D", "218899", "10v06"),
            "valves": Identity("Modbus RTU Relay 32CH", None, "2.00"),
            "markers": Identity("PhaseSpace X2E", None, "5.2"),
        },
        simulated_heights=tuple(
            SimulatedHeights(
                pattern, pressure_psi, tuple(dome_mm(points, pressure_psi, flat=0.8 * index).tolist())
            )
            for index, pattern in enumerate(patterns)
            for pressure_psi in pressures_psi
        ),
        versions={"labctl": "0.1.0", "python": "3.11.2", "numpy": "2.3.1"},
        commit="16abf08c7fc5fe262f4b4",
        operator="Ada",
        note="Sheet 12, after a night at rest.",
    )
    return replace(record, **more)


def windows(pressures_psi=DEFAULT_PRESSURES_PSI):
    """The baseline, and a second at every level, 12 s apart."""
    return (
        BASELINE,
        *(
            Window("level", OFFSET_S + 16.0 + 12 * n, OFFSET_S + 17.0 + 12 * n, pressure_psi)
            for n, pressure_psi in enumerate(pressures_psi)
        ),
    )


def heights_mm(of, pattern, pressure_psi, seed, hidden=()):
    """Measured heights: the simulated ones, a bit off in a way of the sheet's own and of the trial's."""
    points = of.points
    simulated_mm = simulated(of, pattern, pressure_psi)
    rng = np.random.default_rng(1000 * seed + round(100 * pressure_psi))
    if simulated_mm is None:
        simulated_mm = np.linspace(2, 18, len(points))
    lean = np.array([0.08 * (point.x_mm - 70) / 70 for point in points])
    measured = simulated_mm * (0.9 + lean) + 0.25 * rng.standard_normal(len(points))
    measured[list(hidden)] = np.nan
    return measured


def simulated(of, pattern, pressure_psi):
    for each in of.simulated_heights:
        if (each.pattern, each.pressure_psi) == (pattern, pressure_psi):
            return np.array(each.heights_mm)
    return None


def _numbers(values):
    return tuple(None if not math.isfinite(value) else float(value) for value in values)


def level(of, pattern, pressure_psi, seed=1, hidden=()):
    """One level's result."""
    measured_mm = heights_mm(of, pattern, pressure_psi, seed, hidden)
    simulated_mm = simulated(of, pattern, pressure_psi)
    error = None if simulated_mm is None else transfer_error(measured_mm, simulated_mm)
    nothing = (None,) * len(measured_mm)
    return LevelResult(
        pressure_psi=pressure_psi,
        mean_psi=pressure_psi + 0.003,
        lowest_psi=pressure_psi - 0.02,
        highest_psi=pressure_psi + 0.03,
        frames=240,
        heights_mm=_numbers(measured_mm),
        height_sd_mm=_numbers(np.where(np.isfinite(measured_mm), 0.1, np.nan)),
        seen=tuple(0 if math.isnan(height) else 238 for height in measured_mm),
        points_compared=0 if error is None else error.points,
        per_point_percent=nothing if error is None else _numbers(error.per_point),
        e_t_percent=None if error is None else error.percent,
    )


def relaxing(tau_s=1.6):
    """A relaxation's result: a fall from 12 mm."""
    time_s = np.arange(0.125, 20, 0.25)
    height_mm = 0.3 + 12 * np.exp(-time_s / tau_s)
    return RelaxationResult(_numbers(time_s), _numbers(height_mm), tau_s, 0.02, 12.0, 0.3, 0.05)


def result(of, pattern="sphere", pressures_psi=None, seed=1, hidden=(), relaxation=None, problems=()):
    """A trial's result."""
    pressures_psi = of.request.pressures_psi if pressures_psi is None else pressures_psi
    return TrialResult(
        clock=ClockFit(OFFSET_S - SERVER_S, 1.2, 0.0021, 0.0074, 9600, 9),
        frame_residual_mm=0.31,
        levels=tuple(level(of, pattern, pressure_psi, seed, hidden) for pressure_psi in pressures_psi),
        relaxation=relaxation,
        problems=tuple(problems),
    )


def trial(of, number=1, attempt=1, pattern="sphere", placement="neat", outcome="good", reason="", **more):
    """A trial that was measured; `more` replaces any field, `derived=None` stands for no result."""
    at_s = 60.0 * (2 * number + attempt - 2)
    pressures_psi = tuple(more.get("pressures_psi", of.request.pressures_psi))
    derived = more.pop("derived", "made")
    if derived == "made":
        derived = result(of, pattern, pressures_psi, seed=10 * number + attempt)
    record = TrialRecord(
        run=of.number,
        number=number,
        attempt=attempt,
        placement=placement,
        pattern=pattern,
        pressures_psi=pressures_psi,
        begun=moment(at_s),
        ended=moment(at_s + 45.5),
        outcome=outcome,
        reason=reason,
        windows=windows(pressures_psi),
        raw={
            kind: RawFile(
                f"raw/0007-{of.protocol}/trial-{number:02d}-{attempt}.{kind}.parquet", 64 * "a", 123456
            )
            for kind in ("frames", "pressures")
        },
        result=derived,
        safe=SafeReadBack(safe=True, words="SAFE, as read back"),
    )
    return replace(record, **more)


def five_trials(of, failed=True):
    """Five good trials; the third at its second attempt, unless `failed` is false."""
    trials = [trial(of, number, 2 if failed and number == 3 else 1) for number in range(1, 6)]
    if failed:
        reason = "the pressure left 3.90 ± 0.10 psi while the markers were captured (3.71 to 3.92 psi)"
        trials.insert(2, trial(of, 3, 1, outcome="failed", reason=reason))
    return tuple(trials)


def events(of, *kinds):
    """Events of a run, a minute apart."""
    return tuple(EventRecord(of.number, kind, moment(60.0 * n), {}) for n, kind in enumerate(kinds))


def pressures(pressures_psi=DEFAULT_PRESSURES_PSI, rate_hz=20.0, seed=1):
    """The regulator's readings of a trial: 4 s flat, a ramp and a hold a level, then a vent."""
    marks = windows(pressures_psi)
    time_s = np.arange(OFFSET_S, marks[-1].end_s + 10.0, 1 / rate_hz)
    setpoint_psi = np.zeros(len(time_s))
    for window in marks[1:]:
        setpoint_psi[time_s >= window.start_s - 11] = window.pressure_psi
    setpoint_psi[time_s > marks[-1].end_s + 0.5] = 0.0
    gauge_psi = np.zeros(len(time_s))
    noise = 0.006 * np.random.default_rng(seed).standard_normal(len(time_s))
    for n in range(1, len(time_s)):
        step = np.clip(setpoint_psi[n] - gauge_psi[n - 1], -1.5 / rate_hz, 1.0 / rate_hz)
        gauge_psi[n] = gauge_psi[n - 1] + step
    return PressureSamples(
        time_s - 0.008, time_s + 0.008, gauge_psi + noise, setpoint_psi, ("",) * len(time_s)
    )


def frames(of, pattern="sphere", pressures_psi=None, seconds=None, seed=1, lost=(), hidden=()):
    """A recording of the markers in a frame that is turned and shifted against the sheet's.

    Frame n of the server's has the time SERVER_S + n / frequency; those in `lost` never came; `hidden` are (frame,
    marker) that were not seen. The sheet is flat before the first level's window is 5 s away.
    """
    pressures_psi = tuple(of.request.pressures_psi if pressures_psi is None else pressures_psi)
    marks = windows(pressures_psi)
    points, rate_hz = of.points, of.rig["markers"]["frequency_hz"]
    seconds = marks[-1].end_s - OFFSET_S + 3.0 if seconds is None else seconds
    numbers = np.setdiff1d(np.arange(round(seconds * rate_hz)), lost)
    time_s = numbers / rate_hz
    flat_mm = np.array([(point.x_mm, point.y_mm, 0.0) for point in points])
    sheet_mm = np.repeat(flat_mm[None], len(numbers), axis=0)
    for window in marks[1:]:
        up = (time_s >= window.start_s - OFFSET_S - 5) & (time_s <= window.end_s - OFFSET_S + 0.5)
        sheet_mm[up, :, 2] = heights_mm(of, pattern, window.pressure_psi, seed)
    positions_mm = to_instrument(sheet_mm)
    cond = np.full(positions_mm.shape[:2], 2.0, dtype=np.float32)
    for frame, marker in hidden:
        cond[np.flatnonzero(numbers == frame), marker] = -1.0
    ids = np.tile(np.array([point.id for point in points], dtype=np.int32), len(numbers))
    return MarkerFrames(
        time_s=SERVER_S + time_s,
        arrival_s=OFFSET_S + time_s + 0.002,
        starts=np.arange(len(numbers) + 1, dtype=np.int64) * len(points),
        ids=ids,
        positions_mm=positions_mm.reshape(-1, 3).astype(np.float32),
        cond=cond.ravel(),
    )


def to_instrument(sheet_mm):
    """Points (..., 3) of the sheet frame in the instrument's: turned by 30 degrees about z and shifted."""
    cosine, sine = math.cos(math.pi / 6), math.sin(math.pi / 6)
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return sheet_mm @ rotation.T + np.array([400.0, -200.0, 600.0])


def ledger(folder, *runs_with_trials, recorded=True, event_kinds=("trial-begun", "finished")):
    """A ledger in a folder: runs (numbered as they come) with their trials, and the trials' raw files.

    Every trial is recorded as `frames` and `pressures` give, with the gaps and occlusions of `GAPS`.
    """
    with LedgerWriter.open(folder, lambda _: None) as writer:
        for run_asked, trials in runs_with_trials:
            begun = writer.begin_run(replace(run_asked, number=0))
            for each in trials:
                raw = record(folder, begun, each) if recorded and each.raw else each.raw
                writer.add_trial(replace(each, run=begun.number, raw=raw))
            for event in events(begun, *event_kinds):
                writer.add_event(event)
    return folder


def record(folder, of, each):
    """A trial's raw files, by the ledger's own recorder."""
    stem = f"raw/{of.number:04d}-{of.protocol}/trial-{each.number:02d}-{each.attempt}"
    recorder = RawRecorder(folder, stem)
    recorder.take_frames(
        frames(of, each.pattern, each.pressures_psi, seed=10 * each.number + each.attempt, **GAPS)
    )
    samples = pressures(each.pressures_psi, seed=each.number)
    readings = zip(samples.gauge_psi, samples.setpoint_psi, samples.asked_s, samples.came_s, strict=True)
    for gauge_psi, setpoint_psi, asked_s, came_s in readings:
        reading = PressureReading(float(gauge_psi), float(setpoint_psi))
        recorder.take_pressure(PressureSample(reading, float(asked_s), float(came_s)))
    return recorder.finish()
