"""`labctl report` on a small ledger."""

import json

import made_measurement as made
import pytest

from labctl.cli.main import run as labctl


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A ledger of a run with one trial, and of one that has not come to any."""
    run = made.run()
    ledger = tmp_path_factory.mktemp("report") / "ledger"
    return made.ledger(ledger, (run, [made.trial(run)]), (run, []))


def test_a_page_is_written_and_a_page_that_was_there_is_said_to_be_replaced(
    folder, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LABCTL_LEDGER", str(folder))

    assert labctl(["report", "last"]) == 0
    assert capsys.readouterr().out == "written: report-0002.html\n"
    assert "Run 2: five-trial" in (tmp_path / "report-0002.html").read_text(encoding="utf-8")
    assert labctl(["report", "2"]) == 0
    assert capsys.readouterr().out == "replaced: report-0002.html\n"


def test_several_runs_go_onto_one_page_each_once(folder, tmp_path, capsys):
    page = tmp_path / "both.html"
    arguments = ["report", "2", "0001", "last", "--ledger", str(folder), "--out", str(page), "--json"]

    assert labctl(arguments) == 0
    assert json.loads(capsys.readouterr().out) == {"page": str(page), "runs": [2, 1], "replaced": False}
    assert "Runs 2 and 1" in page.read_text(encoding="utf-8")


def test_a_pressure_file_that_is_gone_is_said_on_the_page(tmp_path, capsys):
    run = made.run()
    folder = made.ledger(tmp_path / "ledger", (run, [made.trial(run)]))
    for path in folder.rglob("*.pressures.parquet"):
        path.unlink()

    assert labctl(["report", "1", "--ledger", str(folder), "--out", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "trial-01-1.pressures.parquet" in page.partition("<h2>Pressure</h2>")[2].partition("</section>")[0]


def test_another_trials_pressures_are_not_drawn_as_this_ones(tmp_path, capsys):
    run = made.run()
    folder = made.ledger(tmp_path / "ledger", (run, [made.trial(run), made.trial(run, 2)]))
    one, other = (folder / f"raw/0001-five-trial/trial-0{n}-1.pressures.parquet" for n in (1, 2))
    one.write_bytes(other.read_bytes())

    assert labctl(["report", "1", "--ledger", str(folder), "--out", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    pressures = page.partition("<h2>Pressure</h2>")[2].partition("</section>")[0]
    assert "trial-01-1.pressures.parquet: changed" in pressures
    told = capsys.readouterr().err
    assert "run 1, trial 1: raw/0001-five-trial/trial-01-1.pressures.parquet: changed" in told
    assert "trial 2" not in told


@pytest.mark.parametrize("arguments", [["report", "9"], ["report", "latest"], ["report"]])
def test_a_run_that_is_not_there_is_bad_input(folder, arguments, capsys):
    assert labctl([*arguments, "--ledger", str(folder)]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_a_page_that_cannot_be_written_is_bad_input(folder, tmp_path, capsys):
    assert labctl(["report", "1", "--ledger", str(folder), "--out", str(tmp_path)]) == 2
    assert "is there already and is not a file" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["ledger.sqlite", "ledger.journal", "raw/page.html", "raw"])
def test_no_page_takes_the_place_of_what_was_measured(folder, name, capsys):
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    assert labctl(["report", "1", "--ledger", str(folder), "--out", str(folder / name)]) == 2
    assert "is where ledger" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_a_page_may_lie_beside_the_ledgers_own_files(tmp_path):
    run = made.run()
    folder = made.ledger(tmp_path / "ledger", (run, [made.trial(run)]))

    assert labctl(["report", "1", "--ledger", str(folder), "--out", str(folder / "page.html")]) == 0


@pytest.mark.parametrize("option", ["--out", "--ledger"])
def test_a_path_of_an_empty_variable_is_refused(folder, option, capsys):
    assert labctl(["report", "1", "--ledger", str(folder), option, ""]) == 2
    assert "it is empty: write a name" in capsys.readouterr().err
