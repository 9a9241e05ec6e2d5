import json
import os
import shutil
from dataclasses import replace

import pytest
from made_recording import SHEET_MM, THEN, made_trial, recorded, run_of

from labctl.cli.main import run as labctl
from labctl.config.load import design_text, load_design
from labctl.ledger.records import EventRecord, SimulatedHeights
from labctl.ledger.writer import LedgerWriter
from labctl.plain_json import to_json
from labctl.simulation.simulate import simulate_pattern
from labctl.statistics.summary import summarise

FRAMES = "raw/0001-five-trial/trial-02-1.frames.parquet"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A ledger with a run of two good trials, simulated as `labctl run` does, and a run of none."""
    folder = tmp_path_factory.mktemp("ledger")
    design = load_design("known")
    simulated = simulate_pattern(design, "sphere", design.sheet.strain_at(3.9))
    heights_mm = tuple(simulated.points_mm(SHEET_MM)[:, 2].tolist())
    levels = (SimulatedHeights("sphere", 3.9, heights_mm),)
    record = run_of(made_trial(), design_text=design_text("known"), simulated_heights=levels)
    with LedgerWriter.open(folder, print) as writer:
        run = writer.begin_run(record)
        for number in (1, 2):
            writer.add_trial(recorded(made_trial(number), writer, run, number, 1))
        summary = to_json(summarise(run, writer.trials(run.number)))
        writer.add_event(EventRecord(run.number, "finished", THEN, {"summary": summary}))
        moved = SimulatedHeights("sphere", 3.9, tuple(height + 0.01 for height in heights_mm))
        writer.begin_run(replace(record, simulated_heights=(moved,)))
    return folder


@pytest.fixture
def ledger(finished, tmp_path):
    """A copy of that ledger to do harm to."""
    return shutil.copytree(finished, tmp_path / "ledger")


def test_a_run_that_agrees_says_so_of_every_part(ledger, capsys):
    assert labctl(["verify", "1", "--ledger", str(ledger)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "SIMULATED RIG: byte-level doubles answer; no real instrument is connected",
        "run 1: five-trial, design known",
        "trial 1, attempt 1 (good): 2 files as recorded, every number the same again",
        "trial 2, attempt 1 (good): 2 files as recorded, every number the same again",
        "summary: every number the same again",
        "simulated heights: the same again, to the last bit (1 shape)",
        "run 1: all agree (2 attempts, 4 raw files)",
    ]


def test_a_changed_raw_file_is_named_with_its_trial(ledger, capsys):
    with (ledger / FRAMES).open("r+b") as file:
        file.seek(-100, os.SEEK_END)
        byte = file.read(1)
        file.seek(-100, os.SEEK_END)
        file.write(bytes([byte[0] ^ 1]))
    assert labctl(["verify", "1", "--ledger", str(ledger)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[3] == "trial 2, attempt 1 (good): DISAGREES"
    assert lines[4].startswith(f"    {FRAMES}: changed: SHA-256")
    assert lines[-1] == "run 1 DOES NOT AGREE with its recording: trial 2, attempt 1"


def test_numbers_that_do_not_come_out_again_are_named_with_what_made_them(ledger, capsys):
    with LedgerWriter.open(ledger, print) as writer:
        record = run_of(made_trial(), versions={"labctl": "0.0.9", "numpy": "2.0.0"}, simulated_heights=())
        run = writer.begin_run(record)
        trial = recorded(made_trial(), writer, run, 1, 1)
        writer.add_trial(replace(trial, result=replace(trial.result, frame_residual_mm=0.5)))
    assert labctl(["verify", "last", "--ledger", str(ledger)]) == 1
    lines = capsys.readouterr().out.splitlines()
    residual_mm = trial.result.frame_residual_mm
    assert lines[3] == (
        f"    frame_residual_mm: stored 0.5, recomputed {residual_mm!r} ({residual_mm - 0.5:+.3g})"
    )
    assert lines[5] == (
        "the recorded numbers were made by labctl 0.0.9, numpy 2.0.0, commit unknown; another version may derive "
        "otherwise"
    )


def test_json_says_the_same(ledger, capsys):
    (ledger / FRAMES).unlink()
    assert labctl(["verify", "1", "--ledger", str(ledger), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert (told["run"], told["agrees"], told["summary"]) == (1, False, [])
    assert [trial["agrees"] for trial in told["trials"]] == [True, False]
    assert told["trials"][1]["problems"] == [f"{FRAMES}: the file is gone; bring it back from a copy"]
    assert told["simulated_heights"] == {
        "agree": True,
        "shapes": 1,
        "greatest_difference_mm": 0,
        "problems": [],
    }


def test_simulated_heights_that_are_off_are_found(ledger, capsys):
    assert labctl(["verify", "last", "--ledger", str(ledger)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == "summary: none is recorded, since the run is not finished"
    assert lines[3].startswith("simulated heights: DISAGREE, 0.01 mm apart at most")
    assert lines[4] == "run 2 DOES NOT AGREE with its recording: the simulated heights"


def test_verifying_writes_nothing(ledger, capsys):
    before = {path: path.stat().st_mtime_ns for path in ledger.rglob("*")}
    assert labctl(["verify", "1", "--ledger", str(ledger)]) == 0
    assert {path: path.stat().st_mtime_ns for path in ledger.rglob("*")} == before


@pytest.mark.parametrize("arguments", [["verify", "9"], ["verify", "nine"], ["verify"]])
def test_a_run_that_is_not_there_is_bad_input(ledger, capsys, arguments):
    assert labctl([*arguments, "--ledger", str(ledger)]) == 2
    assert "labctl: " in capsys.readouterr().err


def test_a_ledger_that_is_not_there_is_bad_input(tmp_path, capsys):
    assert labctl(["verify", "1", "--ledger", str(tmp_path / "none")]) == 2
    assert "none" in capsys.readouterr().err
