"""Random things that markers do, on recordings whose true heights are known, and what `derive` makes of them.

The sheet is the double's, relaxing and creeping, the cameras and their faults are the double's too; only the shapes
are plain functions, on points of several rigs.
"""

from collections import Counter
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from made_recording import made_pressures

from labctl.config.rig import MarkerPoint
from labctl.doubles.faults import FaultPanel, parse_faults
from labctl.doubles.marker_faults import MarkerBatch, MarkerFaults
from labctl.doubles.markers import DEFAULT_POINTS, Cameras, LabFrame, MarkerSettings
from labctl.doubles.sheet import Ladder, Relaxation, RelaxingSheet
from labctl.instruments.readings import MarkerFrames
from labctl.measurement.basis import Basis
from labctl.measurement.derive import derive
from labctl.measurement.windows import Window

FREQUENCY_HZ = 240.0
STEP_S = 0.025
BASELINE = Window("baseline", 1.0, 2.0)
RAMP_S = (2.5, 6.5)
PLATEAU_S = (16.0, 17.0)
VENT_S = 17.5
END_S = 22.0
ALLOWED_MM = 0.1
SHEETS = 32


def _square(side, size_mm):
    steps = np.linspace(0.1, 0.9, side) * size_mm
    return tuple(
        MarkerPoint(10 + n, float(x), float(y))
        for n, (x, y) in enumerate((x, y) for x in steps for y in steps)
    )


RIGS = {
    "16 points of the laboratory": DEFAULT_POINTS,
    "9 points on 300 mm": _square(3, 300.0),
    "36 points on 200 mm": _square(6, 200.0),
    "8 points, in no order": tuple(
        MarkerPoint(n, x, y)
        for n, (x, y) in enumerate(
            [
                (10.0, 60.0),
                (35.0, 17.5),
                (105.0, 20.0),
                (122.5, 87.5),
                (60.0, 130.0),
                (70.0, 70.0),
                (30, 100),
                (95, 110),
            ]
        )
    ),
}
SHAPES = ("dome", "saddle", "ridge", "tilted")


@dataclass(frozen=True)
class Rest:
    """Shapes of one sheet at rising strains, whatever is jammed."""

    points_mm: np.ndarray

    def ladder(self, jammed):
        return Ladder(np.linspace(0, 1, len(self.points_mm)), self.points_mm)


def ladder_of(points, shape, height_mm):
    """A sheet that rises to so much, and draws in at its rim as a sheet does that does not stretch."""
    flat = np.array([(point.x_mm, point.y_mm) for point in points])
    middle = (flat.max(axis=0) + flat.min(axis=0)) / 2
    x, y = ((flat - middle) / np.abs(flat - middle).max()).T
    unit = {
        "dome": 1 - 0.6 * (x**2 + y**2),
        "saddle": 0.5 + 0.5 * (x**2 - y**2),
        "ridge": 1 - 0.9 * x**2,
        "tilted": 0.5 + 0.4 * x + 0.1 * y,
    }
    span_mm = float(np.abs(flat - middle).max())
    rungs = []
    for share in np.linspace(0, 1, 5):
        z = share * height_mm * unit[shape]
        drawn = 1 + 0.02 * share - 0.6 * (share * height_mm / span_mm) ** 2 * (x**2 + y**2)
        rungs.append(np.column_stack([middle + (flat - middle) * drawn[:, None], z]))
    return np.array(rungs)


@dataclass(frozen=True, eq=False)
class Clean:
    """A recording without faults: batches of frames, and the true places at each frame, (k, m, 3)."""

    points: tuple
    batches: tuple
    true_mm: np.ndarray
    pressure_psi: float


@cache
def clean(rig, shape, height_mm, pressure_psi, seed):
    """A trial of the double's sheet and cameras; at 0 psi the sheet stays flat."""
    points = RIGS[rig]
    return recorded(points, ladder_of(points, shape, height_mm), pressure_psi, seed)


def recorded(points, rungs_mm, pressure_psi, seed):
    """The cameras' frames of a sheet that takes these shapes, and the truth."""
    settings = MarkerSettings(points=points, frame=LabFrame(yaw_deg=33.0 + 40 * seed))
    sheet = RelaxingSheet(Rest(rungs_mm), Relaxation())
    cameras = Cameras(settings, np.random.default_rng(seed), 0.0)
    batches, true_mm = [], []
    before_s, before_mm = 0.0, sheet.points_mm
    for now_s in np.arange(0, END_S, STEP_S):
        ramp = np.clip((now_s - RAMP_S[0]) / (RAMP_S[1] - RAMP_S[0]), 0, 1)
        share = ramp * pressure_psi / 3.9 * (now_s < VENT_S)
        sheet.step(STEP_S, frozenset(), float(share))
        batch = cameras.frames_until(now_s, sheet.points_mm, FREQUENCY_HZ)
        part = np.clip((batch.times_s - before_s) / max(now_s - before_s, 1e-9), 0, 1)[:, None, None]
        true_mm.append(before_mm + part * (sheet.points_mm - before_mm))
        batches.append(batch)
        before_s, before_mm = now_s, sheet.points_mm
    return Clean(points, tuple(batches), np.concatenate(true_mm), pressure_psi)


class _Now:
    """A clock that is set."""

    time_s = 0.0

    def now_s(self):
        return self.time_s


def shown(recording, words, seed):
    """The recording as the double's faults have it; `words` as for `labctl doubles serve --fault`."""
    now = _Now()
    panel = FaultPanel(now, parse_faults(words).markers)
    faults = MarkerFaults(panel, recording.points, np.random.default_rng(seed))
    found = []
    for batch in recording.batches:
        if len(batch):
            now.time_s = float(batch.times_s[0])
            found.append(faults.shown(batch))
    return as_frames(found)


def as_frames(batches: list[MarkerBatch]):
    """What a driver makes of them."""
    counts = np.concatenate([np.full(len(batch), batch.ids.shape[1]) for batch in batches])
    time_s = np.concatenate([batch.times_s for batch in batches])
    with np.errstate(invalid="ignore"):
        positions_mm = np.concatenate([batch.positions_mm.reshape(-1, 3) for batch in batches]).astype(
            np.float32
        )
    return MarkerFrames(
        time_s=70.0 + time_s,
        arrival_s=time_s + 0.002,
        starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        ids=np.concatenate([batch.ids.ravel() for batch in batches]).astype(np.int32),
        positions_mm=positions_mm,
        cond=np.concatenate([batch.cond.ravel() for batch in batches]).astype(np.float32),
    )


def windows(pressure_psi):
    """A sheet that was not inflated has no way back."""
    marked = (BASELINE, Window("level", *PLATEAU_S, pressure_psi))
    return (*marked, Window("relaxing", VENT_S, END_S - 0.5)) if pressure_psi else marked


def measured(recording, frames, law=2):
    """What `derive` makes of these frames."""
    asked_s = np.arange(0, END_S, 0.05)
    held = (asked_s >= RAMP_S[1]) & (asked_s < VENT_S)
    pressures = made_pressures(asked_s, np.where(held, recording.pressure_psi, 0.0))
    basis = Basis(
        points=tuple(recording.points),
        up="+z",
        frequency_hz=FREQUENCY_HZ,
        tolerance_psi=0.1,
        min_points=int(np.ceil(0.75 * len(recording.points))),
        min_share=0.5,
        simulated_mm={},
    )
    return derive(frames, pressures, windows(recording.pressure_psi), basis, law)


def true_heights_mm(recording):
    """The mean height of each point over the plateau, above its mean over the baseline."""
    time_s = np.concatenate([batch.times_s for batch in recording.batches])
    z_mm = recording.true_mm[:, :, 2]

    def mean(start_s, end_s):
        return z_mm[(time_s >= start_s) & (time_s < end_s)].mean(axis=0)

    return mean(*PLATEAU_S) - mean(BASELINE.start_s, BASELINE.end_s)


@dataclass(frozen=True)
class Scenario:
    """A recording's key, the faults, and the markers that have them."""

    rig: str
    shape: str
    height_mm: float
    pressure_psi: float
    noise: int
    words: tuple
    faulty: frozenset
    seed: int

    @property
    def recording(self):
        return clean(self.rig, self.shape, self.height_mm, self.pressure_psi, self.noise)


@dataclass
class Judged:
    """What came of a scenario: words for what is wrong with it (none where all is well), and counts."""

    wrong: list = field(default_factory=list)
    counts: Counter = field(default_factory=Counter)
    farthest_mm: float = 0.0
    from_clean_mm: float = 0.0


def random_scenario(rng, kind=None):
    """One of the kinds, on one of 32 sheets."""
    rig, shape, height_mm, pressure_psi, noise = sheet(int(rng.integers(SHEETS)))
    kind = kind or str(rng.choice(list(KINDS)))
    words, faulty = KINDS[kind](rng, [point.id for point in RIGS[rig]])
    seed = int(rng.integers(1 << 30))
    return kind, Scenario(rig, shape, height_mm, pressure_psi, noise, tuple(words), frozenset(faulty), seed)


def sheet(number):
    """A rig, a shape, its height, the pressure and the seed of the noise; every rig, every eighth sheet flat."""
    rng = np.random.default_rng(number)
    rig = list(RIGS)[number % len(RIGS)]
    pressure_psi = 0.0 if number % 8 == 7 else float(rng.choice([1.0, 2.6, 3.9, 3.9]))
    return rig, str(rng.choice(SHAPES)), float(rng.choice([4.0, 12.0, 22.0])), pressure_psi, number


def _some(rng, ids, count):
    return sorted(int(each) for each in rng.choice(ids, count, replace=False))


def _names(ids):
    return "+".join(map(str, ids))


def _moment(rng):
    return f"@{rng.uniform(0, VENT_S):.3f}"


def _share_of_frames(kind, percent, count):
    def make(rng, ids):
        some = _some(rng, ids, count)
        when = _moment(rng) if rng.random() < 0.3 else ""
        return [f"markers={kind}:{percent}%,{_names(some)}{when}"], some

    return make


def _swap(count, *, back):
    def make(rng, ids):
        some = _some(rng, ids, count)
        rng.shuffle(some)
        lasts = f",{rng.uniform(0.05, 12):.3f}" if back else ""
        return [f"markers=swapped:{_names(some)}{lasts}{_moment(rng)}"], some

    return make


def _burst(count):
    def make(rng, ids):
        some = _some(rng, ids, count)
        return [f"markers=burst:{rng.uniform(0.02, 0.9):.3f},{_names(some)}{_moment(rng)}"], some

    return make


def _mirror(low_mm, high_mm):
    def make(rng, ids):
        some = _some(rng, ids, 1)
        return [f"markers=mirrored:{rng.uniform(low_mm, high_mm):.2f},{_names(some)}{_moment(rng)}"], some

    return make


def _several(rng, ids):
    kinds = rng.choice([each for each in KINDS if each != "several at once"], 2, replace=False)
    words, faulty = [], set()
    for kind in kinds:
        more, some = KINDS[str(kind)](rng, ids)
        words += more
        faulty |= set(some)
    return words, faulty


def _ghosts(rng, ids):
    return [f"markers=ghosts:{rng.integers(1, 6)}"], []


KINDS = {
    **{
        f"{percent} % of {count} at {where}": _share_of_frames(kind, percent, count)
        for percent in (1, 5, 20)
        for count in (1, 3)
        for kind, where in (("outliers", "0, 0, 0"), ("scattered", "anywhere"))
    },
    "60 % of one at 0, 0, 0": _share_of_frames("outliers", 60, 1),
    "60 % of one anywhere": _share_of_frames("scattered", 60, 1),
    "90 % of one at 0, 0, 0": _share_of_frames("outliers", 90, 1),
    "20 % of three not a number": _share_of_frames("not-a-number", 20, 3),
    "20 % of three twice": _share_of_frames("twice", 20, 3),
    "two swapped for good": _swap(2, back=False),
    "two swapped and back": _swap(2, back=True),
    "three in a circle": _swap(3, back=False),
    "three in a circle and back": _swap(3, back=True),
    "bursts of one": _burst(1),
    "bursts of three": _burst(3),
    "one in a mirror": _mirror(5.0, 40.0),
    "one in a near mirror": _mirror(1.0, 5.0),
    "ghosts": _ghosts,
    "several at once": _several,
}


def judge(scenario, law=2):
    """Each height within 0.1 mm of the truth, or the point named; none that had no fault is lost."""
    recording = scenario.recording
    result = measured(recording, shown(recording, scenario.words, scenario.seed), law)
    undisturbed = _undisturbed(scenario.recording)
    truth_mm = true_heights_mm(recording)
    judged = Judged()
    (level,) = result.levels
    named = {each.marker_id for each in result.doubted}
    good = not result.problems
    judged.counts["trials good" if good else "trials that do not count"] += 1
    for index, point in enumerate(recording.points):
        height_mm, clean_mm = level.heights_mm[index], undisturbed.levels[0].heights_mm[index]
        if height_mm is None:
            is_named = (
                point.id in named
                or level.seen[index] < 0.5 * level.frames
                or any("baseline: " in problem for problem in result.problems)
            )
            judged.counts["heights not seen, named" if is_named else "heights not seen, NOT named"] += 1
            if not is_named:
                judged.wrong.append(f"marker {point.id} has no height and is not named")
            if point.id not in scenario.faulty and clean_mm is not None:
                judged.counts["faultless points lost"] += 1
            continue
        off_mm = abs(height_mm - truth_mm[index])
        judged.farthest_mm = max(judged.farthest_mm, off_mm)
        if clean_mm is not None:
            judged.from_clean_mm = max(judged.from_clean_mm, abs(height_mm - clean_mm))
        judged.counts["heights within 0.1 mm" if off_mm <= ALLOWED_MM else "heights WRONG"] += 1
        if off_mm > ALLOWED_MM:
            judged.wrong.append(
                f"marker {point.id} is {off_mm:.3f} mm off, trial {'good' if good else 'not good'}"
            )
            judged.counts["wrong heights in good trials"] += good
    return judged


@cache
def _undisturbed(recording):
    return measured(recording, as_frames([batch for batch in recording.batches if len(batch)]))
