"""Recordings made up: 16 markers on a sheet that rises at 10 s, is vented at 20 s, and relaxes with 1.5 s."""

from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from labctl.config.rig import MarkerPoint
from labctl.instruments.readings import MarkerFrames, PressureReading, PressureSample, PressureSamples
from labctl.ledger.moment import Moment
from labctl.ledger.raw.recording import RawRecorder
from labctl.ledger.records import RunRecord, RunRequest, SafeReadBack, SimulatedHeights, TrialRecord
from labctl.measurement.basis import Basis
from labctl.measurement.derive import derive
from labctl.measurement.windows import Window

SHEET_MM = np.array(
    [
        *((17.5, y) for y in (52.5, 87.5)),
        *((x, y) for x in (35.0, 70.0, 105.0) for y in (17.5, 52.5, 87.5, 122.5)),
        *((122.5, y) for y in (52.5, 87.5)),
    ]
)
# Far from even, so that a marker taken for another is noticed.
SHAPE_MM = 12.0 * np.exp(-(((SHEET_MM[:, 0] - 60) / 50) ** 2) - ((SHEET_MM[:, 1] - 80) / 45) ** 2)
TURN = Rotation.from_euler("xyz", [9, -6, 140], degrees=True).as_matrix()
SHIFT_MM = np.array([812.0, -93.0, 450.0])
FREQUENCY_HZ = 100.0
SERVER_START_S = 5000.0
TAU_S = 1.5
THEN = Moment("2026-11-20T14:00:00+00:00", 100.0, "boot-1")
TIME_S = np.arange(0, 40, 1 / FREQUENCY_HZ)


@dataclass(frozen=True)
class MadeTrial:
    """What `derive` takes."""

    frames: MarkerFrames
    pressures: PressureSamples
    windows: tuple[Window, ...]
    basis: Basis

    def but(self, **changes):
        """The same trial with something changed."""
        return replace(self, **changes)

    @property
    def parts(self):
        return self.frames, self.pressures, self.windows, self.basis


def pressure_at(time_s):
    """0 psi to 10 s, 3.9 psi to 20 s, then a vent with a time constant of 0.17 s."""
    held = (time_s >= 10) & (time_s < 20)
    return np.where(
        held, 3.9, np.where(time_s < 10, 0.0, 3.9 * np.exp(-(np.maximum(time_s, 20) - 20) / 0.17))
    )


def sheet_heights_mm(time_s):
    """Heights (k, 16) at times (k,): flat, the shape from 10 s on, from 20.5 s on the way back from it."""
    share = np.where(time_s < 10, 0.0, np.exp(-np.maximum(time_s - 20.5, 0) / TAU_S))
    return share[:, None] * SHAPE_MM


def made_frames(time_s, heights_mm, noise_mm=0.0, seed=1, drift_ppm=0.0):
    """All 16 markers in every frame; the server's clock is 5000 s off the laboratory's."""
    rng = np.random.default_rng(seed)
    flat_mm = np.column_stack([SHEET_MM, np.zeros(len(SHEET_MM))])
    sheet_mm = np.repeat(flat_mm[None], len(time_s), axis=0)
    sheet_mm[:, :, 2] = heights_mm
    sheet_mm += rng.normal(0, noise_mm, sheet_mm.shape)
    count = len(SHEET_MM)
    return MarkerFrames(
        time_s=SERVER_START_S + time_s * (1 - drift_ppm / 1e6),
        arrival_s=time_s + 0.002 + rng.exponential(0.001, len(time_s)),
        starts=np.arange(len(time_s) + 1, dtype=np.int64) * count,
        ids=np.tile(np.arange(count, dtype=np.int32), len(time_s)),
        positions_mm=(sheet_mm @ TURN.T + SHIFT_MM).reshape(-1, 3).astype(np.float32),
        cond=np.full(len(time_s) * count, 3.0, dtype=np.float32),
    )


def made_pressures(time_s, gauge_psi):
    """Readings requested 5 ms before and come 5 ms after."""
    return PressureSamples(
        asked_s=time_s - 0.005,
        came_s=time_s + 0.005,
        gauge_psi=gauge_psi,
        setpoint_psi=np.round(gauge_psi),
        status=("",) * len(time_s),
    )


def made_trial(seed=1):
    """40 s at 100 Hz: baseline 5 to 6 s, level 15 to 16 s, vented at 20 s, relaxing from 20 to 38 s."""
    asked_s = np.arange(0, 40, 0.05)
    return MadeTrial(
        frames=made_frames(TIME_S, sheet_heights_mm(TIME_S), noise_mm=0.05, seed=seed),
        pressures=made_pressures(asked_s, pressure_at(asked_s)),
        windows=(
            Window("baseline", 5.0, 6.0),
            Window("level", 15.0, 16.0, 3.9),
            Window("relaxing", 20.0, 38.0),
        ),
        basis=Basis(
            points=tuple(MarkerPoint(i, x, y) for i, (x, y) in enumerate(SHEET_MM.tolist())),
            up="+z",
            frequency_hz=FREQUENCY_HZ,
            tolerance_psi=0.1,
            min_points=8,
            min_share=0.5,
            simulated_mm={3.9: tuple((SHAPE_MM * 1.5).tolist())},
        ),
    )


def run_of(trial, **changes):
    """A run that has no number yet, with the trial's basis in its record."""
    basis = trial.basis
    record = RunRecord(
        number=0,
        protocol="five-trial",
        begun=THEN,
        request=RunRequest("five-trial", (), (), 1, 1, (), None),
        planned_trials=1,
        design_name="known",
        design_source="known.toml",
        design_text="",
        rig_name="made rig",
        rig={
            "markers": {
                "points": [asdict(point) for point in basis.points],
                "up": basis.up,
                "frequency_hz": basis.frequency_hz,
            },
            "limits": {"hold_tolerance_psi": basis.tolerance_psi},
            "measurement": {"min_points": basis.min_points, "min_share": basis.min_share},
        },
        simulated=True,
        identities={},
        simulated_heights=tuple(
            SimulatedHeights("sphere", pressure_psi, heights_mm)
            for pressure_psi, heights_mm in basis.simulated_mm.items()
        ),
        versions={},
        commit=None,
        operator="",
        note="",
    )
    return replace(record, **changes)


def derived(trial, run):
    """What the trial's recording gives by the run's record."""
    return derive(trial.frames, trial.pressures, trial.windows, run.basis("sphere"))


def recorded(trial, ledger, run, number, attempt, outcome="good"):
    """The record of an attempt, its samples written to the ledger's folder."""
    stem = f"{ledger.raw_folder(run).relative_to(ledger.folder)}/trial-{number:02d}-{attempt}"
    recorder = RawRecorder(ledger.folder, stem)
    recorder.take_frames(trial.frames)
    for asked_s, gauge_psi in zip(trial.pressures.asked_s, trial.pressures.gauge_psi, strict=True):
        reading = PressureReading(float(gauge_psi), float(round(gauge_psi)))
        recorder.take_pressure(PressureSample(reading, float(asked_s), float(asked_s) + 0.01))
    return TrialRecord(
        run=run.number,
        number=number,
        attempt=attempt,
        placement="neat",
        pattern="sphere",
        pressures_psi=(3.9,),
        begun=THEN,
        ended=THEN,
        outcome=outcome,
        reason="" if outcome == "good" else "a valve was not read back",
        windows=trial.windows,
        raw=recorder.finish(),
        result=derived(trial, run),
        safe=SafeReadBack(safe=True, words="SAFE"),
    )


def hide(frames, markers, hidden=slice(None)):
    """The frames with these markers not seen in the frames `hidden`."""
    count = len(SHEET_MM)
    cond = frames.cond.reshape(-1, count).copy()
    rows = np.arange(len(frames))[hidden]
    cond[np.ix_(rows, list(markers))] = -1.0
    return replace(frames, cond=cond.ravel())
