"""`labctl runs` and `labctl show` on a small ledger."""

import json
from dataclasses import replace

import pytest
from made_ledger import ENDED, REQUEST, a_run, a_trial, an_event, changed_bytes, no_notice

from labctl.cli.main import run as labctl
from labctl.ledger.records import EventRecord
from labctl.ledger.writer import LedgerWriter
from labctl.measurement.result import LevelResult, RelaxationResult, TrialResult

RIG = {
    "markers": {"points": [{"id": 4, "x_mm": 70.0, "y_mm": 70.0}], "up": "+z", "frequency_hz": 960.0},
    "limits": {"hold_tolerance_psi": 0.1},
    "measurement": {"min_points": 1, "min_share": 0.5},
}


def a_result(e_t_percent, tau_s=None, pressure_psi=3.9):
    level = LevelResult(
        pressure_psi, 3.9, 3.89, 3.91, 960, (6.5,), (0.1,), (960,), 1, (e_t_percent,), e_t_percent
    )
    relaxation = None if tau_s is None else RelaxationResult((), (), tau_s, 0.1, 3.0, 0.2, 0.05)
    return TrialResult(None, 0.2, (level,), relaxation, ())


def good(run, number, e_t_percent, **changes):
    tau_s = changes.pop("tau_s", None)
    return a_trial(
        run, number, result=a_result(e_t_percent, tau_s), pressures_psi=(3.9,), windows=(), **changes
    )


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A finished run, one that was interrupted, and one on real instruments that failed."""
    folder = tmp_path / "ledger"
    monkeypatch.setenv("LABCTL_LEDGER", str(folder))
    with LedgerWriter.open(folder, no_notice) as ledger:
        first = ledger.begin_run(a_run(rig=RIG, simulated_heights=())).number
        ledger.add_event(EventRecord(first, "trial-begun", ENDED, {"number": 1, "attempt": 1}))
        ledger.add_trial(good(first, 1, 17.0))
        ledger.add_trial(
            a_trial(
                first, 2, result=None, outcome="failed", reason="7 of 16 points seen", pressures_psi=(3.9,)
            )
        )
        for number, e_t_percent in enumerate((18.0, 17.5, 16.5, 17.0), start=2):
            ledger.add_trial(good(first, number, e_t_percent, attempt=2, tau_s=1.5))
        ledger.add_event(an_event(first, "finished", summary={"groups": []}))
        ledger.begin_run(
            a_run(rig=RIG, request=replace(REQUEST, patterns=("cylinder",)), simulated_heights=())
        )
        third = ledger.begin_run(a_run(rig=RIG, simulated=False, protocol="relaxation", simulated_heights=()))
        ledger.add_event(an_event(third.number, "failed", reason="trial 1 was not good in 3 attempts"))
    return folder


def said(capsys, *arguments, code=0):
    assert labctl([str(argument) for argument in arguments]) == code
    return capsys.readouterr()


def test_runs_has_a_line_for_each(folder, capsys):
    out = said(capsys, "runs").out

    head, *lines = [line.split() for line in out.splitlines()]
    assert head[:3] == ["run", "begun", "protocol"]
    note = "typed in another code page: \\udcfc"
    assert [" ".join(line) for line in lines] == [
        f"1 2026-03-01 09:00 five-trial known sphere SIMULATED 5 of 5 17.2 finished {note}",
        f"2 2026-03-01 09:00 five-trial known cylinder SIMULATED 0 of 5 - interrupted {note}",
        f"3 2026-03-01 09:00 relaxation known sphere bench 0 of 5 - failed {note}",
    ]


@pytest.mark.parametrize(
    ("options", "numbers"),
    [
        (("--pattern", "sphere"), ["1", "3"]),
        (("--protocol", "relaxation"), ["3"]),
        (("--state", "interrupted"), ["2"]),
        (("--note", "CODE page", "--pattern", "cylinder"), ["2"]),
        (("--design", "known", "--state", "finished"), ["1"]),
    ],
)
def test_runs_are_chosen_by_what_they_are(folder, capsys, options, numbers):
    assert [line.split()[0] for line in said(capsys, "runs", *options).out.splitlines()[1:]] == numbers
    listed = json.loads(said(capsys, "runs", *options, "--json").out)["runs"]
    assert [str(run["number"]) for run in listed] == numbers


def test_no_run_that_fits_is_said(folder, capsys):
    assert "no such run" in said(capsys, "runs", "--note", "nowhere").out


def test_runs_for_machines(folder, capsys):
    told = json.loads(said(capsys, "runs", "--json").out)

    first = told["runs"][0]
    assert (first["number"], first["state"], first["simulated"]) == (1, "finished", True)
    assert (first["good_trials"], first["planned_trials"], first["attempts"]) == (5, 5, 6)
    assert first["e_t_mean_percent"] == [pytest.approx(17.2)]
    assert told["lost"] == []


def test_a_run_is_running_while_it_is_written(folder, capsys):
    with LedgerWriter.open(folder, no_notice) as ledger:
        ledger.add_event(an_event(2, "continued"))

        told = json.loads(said(capsys, "runs", "--json").out)

    assert [run["state"] for run in told["runs"]] == ["finished", "running", "failed"]


def test_runs_says_what_is_lost(folder, capsys):
    for name, mark in (
        ("ledger.journal", b'"kind":"run","run":2'),
        ("ledger.sqlite", b'{"number":2,"protocol"'),
    ):
        with changed_bytes(folder / name) as data:
            data[data.index(mark) + 400] ^= 1

    before = said(capsys, "runs")
    assert "gone from both files: row 10 (the beginning of run 2)" in before.err
    LedgerWriter.open(folder, lambda text: None).close()

    after = said(capsys, "runs")
    assert "lost when both files of the ledger were damaged: row 10 (the beginning of run 2)" in after.out
    assert after.err == ""


def test_show_tells_how_a_run_was_made_and_what_came_of_it(folder, capsys):
    out = said(capsys, "show", "1").out

    assert out.startswith("SIMULATED RIG: measured on byte-level doubles")
    assert "run 1: five-trial, finished" in out
    assert "by Ada" in out
    assert "request    patterns sphere; pressures_psi 3.9; trials 5; attempts 3; placements neat" in out
    assert "regulator  PCD, serial number not reported, firmware not reported" in out
    assert "none: it ran outside of a checkout" in out
    assert "trial 2, attempt 1, failed: 7 of 16 points seen" in out
    lines = [line.split() for line in out.splitlines()]
    assert ["2", "2", "neat", "sphere", "3.9", "good", "18.00", "09:00:00", "60", "SAFE"] in lines
    (group,) = [line for line in lines if line[:4] == ["neat", "sphere", "3.9", "5"]]
    assert group[4:6] == ["17.20", "0.57"]
    assert float(group[6]) < 17.2 < float(group[7])
    # Nothing was simulated to be off from.
    assert group[8:] == ["-", "1.50", "0.00"]
    assert "finished" in lines[-1]
    assert not any("trial-begun" in line for line in lines)


def test_show_for_machines_has_all_of_it(folder, capsys):
    told = json.loads(said(capsys, "show", "0001", "--ledger", folder, "--json").out)

    assert told["state"] == "finished"
    assert told["run"]["begun"] == {
        "wall": "2026-03-01T09:00:00.000001+01:00",
        "mono_s": 1234.000000001,
        "boot": "boot-a",
    }
    assert [trial["outcome"] for trial in told["trials"]] == [
        "good",
        "failed",
        "good",
        "good",
        "good",
        "good",
    ]
    assert told["trials"][0]["raw"]["frames"]["sha256"] == "ab" * 32
    assert [event["kind"] for event in told["events"]] == ["trial-begun", "finished"]
    assert told["summary"]["groups"][0]["e_t_mean_percent"] == pytest.approx(17.2)
    assert told["raw_folder"] == str(folder / "raw" / "0001-five-trial")


def test_show_the_last_run_which_has_nothing_yet(folder, capsys):
    out = said(capsys, "show", "last").out

    assert "run 3: relaxation, failed" in out
    assert "SIMULATED" not in out
    assert "no trial has been recorded yet" in out
    assert "failed  reason trial 1 was not good in 3 attempts" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("show", "4"), "has no run 4; it has runs 1 to 3"),
        (("show", "first"), "a run is named by its number or 'last'"),
        (("runs", "--ledger", "nowhere"), "there is no ledger in nowhere"),
    ],
)
def test_a_run_or_ledger_that_is_not_there(folder, capsys, arguments, words):
    told = said(capsys, *arguments, code=2)

    assert words in told.err
    assert told.out == ""


def test_an_empty_ledger(tmp_path, capsys):
    LedgerWriter.open(tmp_path, no_notice).close()

    assert "no runs yet" in said(capsys, "runs", "--ledger", tmp_path).out


def test_a_note_does_not_steer_the_terminal(tmp_path, capsys):
    with LedgerWriter.open(tmp_path, no_notice) as ledger:
        ledger.begin_run(a_run(rig=RIG, simulated_heights=(), note="two\nlines \x1b[2J\r ü"))

    assert labctl(["show", "1", "--ledger", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "two\nlines \ufffd[2J\ufffd ü" in told
