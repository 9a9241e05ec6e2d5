"""Runs and trials as a ledger holds them, with e_t and heights chosen by hand."""

from dataclasses import replace

import pytest

from labctl.ledger.moment import Moment
from labctl.ledger.records import RunRecord, RunRequest, SafeReadBack, SimulatedHeights, TrialRecord
from labctl.measurement.result import LevelResult, RelaxationResult, TrialResult

THEN = Moment("2026-11-20T14:00:00+00:00", 100.0, "boot-1")
PLACES_MM = ((35.0, 35.0), (70.0, 70.0), (105.0, 35.0), (70.0, 105.0))


def run_record(number=7, points=PLACES_MM, simulated=((3.9, (4.0, 8.0, 2.0, 1.0)),)):
    """A run of "sphere" and "cylinder"; `simulated` holds (pressure, heights) of the sphere."""
    rig = {
        "markers": {
            "points": [{"id": 10 + i, "x_mm": x, "y_mm": y} for i, (x, y) in enumerate(points)],
            "up": "+z",
            "frequency_hz": 240.0,
        },
        "limits": {"hold_tolerance_psi": 0.1},
        "measurement": {"min_points": 3, "min_share": 0.5},
    }
    heights = tuple(
        SimulatedHeights("sphere", pressure_psi, heights_mm) for pressure_psi, heights_mm in simulated
    )
    empty = {name: {} for name in ("identities", "versions")}
    texts = dict.fromkeys(("design_name", "design_source", "design_text", "rig_name", "operator", "note"), "")
    return RunRecord(
        number=number,
        protocol="five-trial",
        begun=THEN,
        request=RunRequest("five-trial", (), (), 5, 1, (), None),
        rig=rig,
        planned_trials=5,
        simulated=True,
        simulated_heights=heights,
        commit=None,
        **empty,
        **texts,
    )


def level(e_t_percent=None, heights_mm=(4.0, 8.0, 2.0, 1.0), errors=None, pressure_psi=3.9):
    """A level; its per-point errors are all e_t where none are given."""
    count = len(heights_mm)
    return LevelResult(
        pressure_psi=pressure_psi,
        mean_psi=pressure_psi,
        lowest_psi=pressure_psi - 0.01,
        highest_psi=pressure_psi + 0.01,
        frames=240,
        heights_mm=tuple(heights_mm),
        height_sd_mm=(0.02,) * count,
        seen=(240,) * count,
        points_compared=count if e_t_percent is not None else 0,
        per_point_percent=(e_t_percent,) * count if errors is None else tuple(errors),
        e_t_percent=e_t_percent,
    )


def trial_record(number, *levels, tau_s=None, **changes):
    """A good trial of the neat sphere."""
    relaxation = None if tau_s is None else RelaxationResult((), (), tau_s, 0.01, 5.0, 0.1, 0.01)
    record = TrialRecord(
        run=7,
        number=number,
        attempt=1,
        placement="neat",
        pattern="sphere",
        pressures_psi=tuple(level.pressure_psi for level in levels),
        begun=THEN,
        ended=THEN,
        outcome="good",
        reason="",
        windows=(),
        raw={},
        result=TrialResult(None, 0.1, levels, relaxation, ()),
        safe=SafeReadBack(safe=True, words="SAFE"),
    )
    return replace(record, **changes)


@pytest.fixture
def run():
    return run_record()


@pytest.fixture
def make_run():
    return run_record


@pytest.fixture
def make_level():
    return level


@pytest.fixture
def make_trial():
    return trial_record
