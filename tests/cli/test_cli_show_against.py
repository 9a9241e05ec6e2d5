"""`labctl show` on runs that are compared: with each other, and placement by placement."""

import json

import made_measurement as made
import pytest
from made_ledger import a_run, a_trial, no_notice

from labctl.cli.main import run as labctl
from labctl.config.rig import MarkerPoint
from labctl.ledger.writer import LedgerWriter
from labctl.measurement.result import LevelResult, TrialResult

PLACES_MM = ((35.0, 35.0), (70.0, 70.0), (105.0, 35.0), (70.0, 105.0))
RIG = made.rig(tuple(MarkerPoint(number, x, y) for number, (x, y) in enumerate(PLACES_MM)))


def good(run, number, e_t_percent, heights_mm=(4.0, 8.0, 2.0, 1.0), **changes):
    errors = tuple(e_t_percent + off for off in (-4.0, -1.0, 2.0, 3.0))
    level = LevelResult(3.9, 3.9, 3.89, 3.91, 960, heights_mm, (0.1,) * 4, (960,) * 4, 4, errors, e_t_percent)
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
    at = lines.index("placements compared (first less second): e_t in percentage points, heights in mm")
    assert lines[at + 1 : at + 3] == [
        "run 2, cylinder on sphere, sphere at 3.9 psi",
        "  less run 2, sphere on cylinder, sphere at 3.9 psi",
    ]
    assert lines[at + 3].startswith("    e_t over 3 and 3 trials: -6.00, p = 0.0")
    assert lines[at + 5 : at + 7] == [
        "    e_t over 4 points, each with itself: -6.00, p = 0.125 (Wilcoxon)",
        "      95 % -6.00 to -6.00 (t), -6.00 to -6.00 (bootstrap)",
    ]


def test_one_placement_is_compared_with_nothing(folder, capsys):
    assert " compared (" not in said(capsys, "show", "1").out


def test_a_run_against_itself_and_against_one_without_trials(folder, capsys):
    itself = said(capsys, "show", "1", "--against", "1").out
    assert "e_t over 3 and 3 trials: +0.00, p = 1.000 (Welch)" in itself
    assert "95 % -2.27 to +2.27 (Welch), " in itself
    nothing = said(capsys, "show", "1", "--against", "3").out.splitlines()
    at = nothing.index("runs compared (first less second): e_t in percentage points, heights in mm")
    assert nothing[at + 1 : at + 3] == [
        "nothing in the two can be compared",
        "without its like: run 1, neat, sphere at 3.9 psi",
    ]


def test_machines_are_told_the_same(folder, capsys):
    told = json.loads(said(capsys, "show", "2", "--against", "1", "--json").out)
    (group,) = told["placements_compared"]
    assert group["over_trials"]["difference_percent"] == pytest.approx(-6)
    assert told["against"]["groups"] == []
    assert [name["run"] for name in told["against"]["unmatched"]] == [2, 2, 1]
    assert json.loads(said(capsys, "show", "1", "--json").out)["against"] is None


def test_another_run_that_is_not_there_is_bad_input(folder, capsys):
    assert "no run 9" in said(capsys, "show", "1", "--against", "9", code=2).err


@pytest.fixture
def halved(tmp_path, monkeypatch):
    """Run 1, and run 2 of the same e_t whose sheet rose half as high."""
    monkeypatch.setenv("LABCTL_LEDGER", str(tmp_path / "ledger"))
    with LedgerWriter.open(tmp_path / "ledger", no_notice) as ledger:
        for heights_mm in ((4.0, 7.84, 2.0, 1.0), (2.0, 4.13, None, 0.5)):
            run = ledger.begin_run(a_run(rig=RIG, simulated_heights=())).number
            for number, e_t_percent in enumerate((0.4, 0.5, 0.6), start=1):
                ledger.add_trial(good(run, number, e_t_percent, heights_mm, pattern="sphere"))


def test_a_sheet_that_halved_shows_in_its_heights_point_by_point(halved, capsys):
    lines = said(capsys, "show", "2", "--against", "1").out.splitlines()
    at = next(n for n, line in enumerate(lines) if line.startswith("runs compared"))
    assert lines[at + 3] == "    e_t over 3 and 3 trials: +0.00, p = 1.000 (Welch)"
    assert "    heights over 3 points, each with itself: -2.07 mm" in lines
    assert "    root mean square 2.45 mm; greatest 4.13 and 7.84 mm" in lines
    head = next(n for n, line in enumerate(lines) if "first less second mm" in line)
    assert [line.split() for line in lines[head : head + 5]] == [
        ["marker", "x", "mm", "y", "mm", "run", "2", "run", "1", "first", "less", "second", "mm"],
        ["0", "35", "35", "2.00", "4.00", "-2.00"],
        ["1", "70", "70", "4.13", "7.84", "-3.71"],
        ["2", "105", "35", "-", "2.00", "-"],
        ["3", "70", "105", "0.50", "1.00", "-0.50"],
    ]
    assert max(map(len, lines[at:])) <= 80


def test_the_report_has_the_same_sign_as_show(halved, capsys, tmp_path):
    shown = json.loads(said(capsys, "show", "2", "--against", "1", "--json").out)
    (group,) = shown["against"]["groups"]
    difference_mm = group["heights"]["mean_difference_mm"]
    said(capsys, "report", "2", "1", "--out", str(tmp_path / "page.html"))
    page = (tmp_path / "page.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    assert difference_mm == pytest.approx(-2.07, abs=0.005)
    assert "Heights differ by \u22122.07 mm on average, 2.45 mm root mean square, over the 3 points" in page
    assert "4.13 less 7.84" in page
