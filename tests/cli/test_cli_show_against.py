"""`labctl show` on runs that are compared: with each other, and placement by placement."""

import json

import pytest
from made_ledger import a_run, a_trial, no_notice

from labctl.cli.main import run as labctl
from labctl.ledger.writer import LedgerWriter
from labctl.measurement.result import LevelResult, TrialResult

PLACES_MM = ((35.0, 35.0), (70.0, 70.0), (105.0, 35.0), (70.0, 105.0))
RIG = {
    "markers": {
        "points": [{"id": number, "x_mm": x, "y_mm": y} for number, (x, y) in enumerate(PLACES_MM)],
        "up": "+z",
        "frequency_hz": 960.0,
    },
    "limits": {"hold_tolerance_psi": 0.1},
    "measurement": {"min_points": 3, "min_share": 0.5},
}


def good(run, number, e_t_percent, **changes):
    errors = tuple(e_t_percent + off for off in (-4.0, -1.0, 2.0, 3.0))
    level = LevelResult(
        3.9, 3.9, 3.89, 3.91, 960, (4.0, 8.0, 2.0, 1.0), (0.1,) * 4, (960,) * 4, 4, errors, e_t_percent
    )
    result = TrialResult(None, 0.2, (level,), None, ())
    return a_trial(run, number, result=result, pressures_psi=(3.9,), windows=(), **changes)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Run 1 neat; run 2 in both orders of layering; run 3 without a trial."""
    monkeypatch.setenv("LABCTL_LEDGER", str(tmp_path / "ledger"))
    with LedgerWriter.open(tmp_path / "ledger", no_notice) as ledger:
        first, second, _ = (ledger.begin_run(a_run(rig=RIG, simulated_heights=())).number for _ in range(3))
        for number, e_t_percent in enumerate((16.0, 17.0, 18.0), start=1):
            ledger.add_trial(good(first, number, e_t_percent, placement="neat", pattern="sphere"))
        for placement, e_t, start in (
            ("cylinder on sphere", (26.0, 27.0, 28.0), 1),
            ("sphere on cylinder", (30.0, 33.0, 36.0), 4),
        ):
            for number, e_t_percent in enumerate(e_t, start=start):
                ledger.add_trial(good(second, number, e_t_percent, placement=placement, pattern="sphere"))
    return tmp_path / "ledger"


def said(capsys, *arguments, code=0):
    assert labctl(list(arguments)) == code
    return capsys.readouterr()


def test_the_placements_of_a_run_are_compared(folder, capsys):
    lines = said(capsys, "show", "2").out.splitlines()
    at = lines.index("placements compared (second less first, in percentage points of e_t)")
    assert lines[at + 1] == (
        "run 2, cylinder on sphere, sphere at 3.9 psi; run 2, sphere on cylinder, sphere at 3.9 psi"
    )
    assert lines[at + 2].startswith("    over 3 and 3 trials: +6.00, 95 % ")
    assert lines[at + 3] == (
        "    over 4 points, each with itself: +6.00, 95 % +6.00 to +6.00 (t), 95 % +6.00 to +6.00 (bootstrap), "
        "p = 0.125 (Wilcoxon)"
    )


def test_one_placement_is_compared_with_nothing(folder, capsys):
    assert " compared (" not in said(capsys, "show", "1").out


def test_a_run_against_itself_and_against_one_without_trials(folder, capsys):
    itself = said(capsys, "show", "1", "--against", "1").out
    assert "over 3 and 3 trials: +0.00, 95 % -2.27 to +2.27 (Welch)" in itself
    nothing = said(capsys, "show", "1", "--against", "3").out.splitlines()
    at = nothing.index("runs compared (second less first, in percentage points of e_t)")
    assert nothing[at + 1 : at + 3] == [
        "nothing in the two can be compared",
        "without its like: run 1, neat, sphere at 3.9 psi",
    ]


def test_machines_are_told_the_same(folder, capsys):
    told = json.loads(said(capsys, "show", "2", "--against", "1", "--json").out)
    (group,) = told["placements_compared"]
    assert group["over_trials"]["difference_percent"] == pytest.approx(6)
    assert told["against"]["groups"] == []
    assert [name["run"] for name in told["against"]["unmatched"]] == [2, 2, 1]
    assert json.loads(said(capsys, "show", "1", "--json").out)["against"] is None


def test_another_run_that_is_not_there_is_bad_input(folder, capsys):
    assert "no run 9" in said(capsys, "show", "1", "--against", "9", code=2).err
