import shutil
from dataclasses import replace

import pytest
from made_recording import THEN, derived, made_trial, recorded, run_of

from labctl.ledger.ledger import Ledger
from labctl.ledger.raw.recording import read_frames, read_pressures
from labctl.ledger.records import EventRecord
from labctl.ledger.writer import LedgerWriter
from labctl.measurement.derive import derive
from labctl.measurement.law import PLAIN_MEANS
from labctl.plain_json import to_json
from labctl.statistics.summary import summarise
from labctl.verification.differences import Difference, differences
from labctl.verification.verify_run import verify_run, verify_trial


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A ledger with a finished run of two good trials and a failed attempt between them."""
    folder = tmp_path_factory.mktemp("ledger")
    with LedgerWriter.open(folder, print) as writer:
        run = writer.begin_run(run_of(made_trial()))
        for seed, (number, attempt, outcome) in enumerate(
            [(1, 1, "good"), (2, 1, "failed"), (2, 2, "good")], start=1
        ):
            writer.add_trial(recorded(made_trial(seed), writer, run, number, attempt, outcome=outcome))
        summary = to_json(summarise(run, writer.trials(run.number)))
        writer.add_event(EventRecord(run.number, "finished", THEN, {"summary": summary}))
    return folder


@pytest.fixture
def kept(finished, tmp_path):
    """A copy of that ledger to do harm to."""
    return shutil.copytree(finished, tmp_path / "ledger")


def verified(folder):
    with Ledger.open(folder, print) as ledger:
        return verify_run(ledger, ledger.find("last"))


def test_a_run_left_as_it_was_agrees_to_the_last_bit(kept):
    found = verified(kept)
    assert found.agrees
    assert [(trial.number, trial.attempt, trial.recomputed) for trial in found.trials] == [
        (1, 1, True),
        (2, 1, True),
        (2, 2, True),
    ]
    assert found.trials[0].files == (
        "raw/0001-five-trial/trial-01-1.frames.parquet",
        "raw/0001-five-trial/trial-01-1.pressures.parquet",
    )
    assert found.summary == ()


@pytest.mark.parametrize("stream", ["frames", "pressures"])
@pytest.mark.parametrize("where", [0, 0.5, -1])
def test_one_changed_bit_in_a_raw_file_is_found(kept, stream, where):
    path = kept / f"raw/0001-five-trial/trial-02-2.{stream}.parquet"
    data = bytearray(path.read_bytes())
    data[where if where != 0.5 else len(data) // 2] ^= 1
    path.write_bytes(data)
    found = verified(kept)
    assert not found.agrees
    assert [trial.agrees for trial in found.trials] == [True, True, False]
    (problem,) = found.trials[2].problems
    assert problem.startswith(f"raw/0001-five-trial/trial-02-2.{stream}.parquet: changed: SHA-256 ")
    assert not found.trials[2].recomputed


def test_a_file_that_grew_or_is_gone_is_found(kept):
    with (kept / "raw/0001-five-trial/trial-01-1.frames.parquet").open("ab") as file:
        file.write(b"\0")
    (kept / "raw/0001-five-trial/trial-02-1.pressures.parquet").unlink()
    first, second, third = verified(kept).trials
    assert "bytes, and" in first.problems[0]
    assert second.problems == (
        "raw/0001-five-trial/trial-02-1.pressures.parquet: the file is gone; bring it back from a copy",
    )
    assert third.agrees


@pytest.fixture
def one_trial(kept):
    """The folder, the run and its first trial."""
    with Ledger.open(kept, print) as ledger:
        run = ledger.find("last")
        return kept, run, ledger.trials(run.number)[0]


def test_a_number_that_is_not_in_the_recording_is_named(one_trial):
    folder, run, trial = one_trial
    was = trial.levels[0].e_t_percent
    level = replace(trial.levels[0], e_t_percent=was * (1 + 2**-52))
    changed = replace(trial, result=replace(trial.result, levels=(level,)))
    found = verify_trial(folder, run, changed)
    assert not found.agrees
    assert found.differences == (Difference("levels[0].e_t_percent", level.e_t_percent, was),)
    assert f"stored {level.e_t_percent!r}, recomputed {was!r} (-" in found.differences[0].describe()


def test_windows_that_were_changed_change_the_numbers(one_trial):
    folder, run, trial = one_trial
    windows = list(trial.windows)
    windows[1] = replace(windows[1], end_s=windows[1].end_s - 0.1)
    found = verify_trial(folder, run, replace(trial, windows=tuple(windows)))
    assert "levels[0].frames" in {difference.where for difference in found.differences}


def test_a_good_trial_without_a_recording_does_not_agree(one_trial):
    folder, run, trial = one_trial
    found = verify_trial(folder, run, replace(trial, raw={}))
    assert found.problems == ("recorded as good, and there is no recording or no result to recompute",)


def test_a_failed_attempt_without_a_recording_agrees(one_trial):
    folder, run, trial = one_trial
    found = verify_trial(folder, run, replace(trial, raw={}, result=None, outcome="failed"))
    assert found.agrees
    assert not found.recomputed


def test_a_trial_with_problems_cannot_be_good(one_trial, trial):
    folder, run, record = one_trial
    # Judged by a stricter run, the same recording has too few markers.
    strict = replace(run, rig={**run.rig, "measurement": {"min_points": 17, "min_share": 0.5}})
    result = derived(trial, strict)
    found = verify_trial(folder, strict, replace(record, result=result))
    assert found.differences == ()
    assert found.problems[0].startswith("recorded as good, although: 3.9 psi: 16 of 16 markers")


def test_a_summary_of_other_numbers_is_found(trial, tmp_path):
    with LedgerWriter.open(tmp_path, print) as writer:
        run = writer.begin_run(run_of(trial))
        writer.add_trial(recorded(trial, writer, run, 1, 1))
        summary = to_json(summarise(run, writer.trials(run.number)))
        summary["groups"][0]["e_t_mean_percent"] = 1.0
        writer.add_event(EventRecord(run.number, "finished", THEN, {"summary": summary}))
    found = verified(tmp_path)
    assert not found.agrees
    assert [difference.where for difference in found.summary] == ["groups[0].e_t_mean_percent"]


def test_a_run_that_is_not_finished_has_no_summary_to_agree(trial, tmp_path):
    with LedgerWriter.open(tmp_path, print) as writer:
        run = writer.begin_run(run_of(trial))
        writer.add_trial(recorded(trial, writer, run, 1, 1))
    found = verified(tmp_path)
    assert found.summary is None
    assert found.agrees


@pytest.mark.parametrize(
    ("stored", "recomputed", "where"),
    [
        ({"a": [1, {"b": 2.0}]}, {"a": [1, {"b": 2.5}]}, ["a[1].b"]),
        ({"a": 1}, {"a": 1.0}, ["a"]),
        ({"a": 0.0}, {"a": -0.0}, ["a"]),
        ({"a": None}, {"a": 1.0}, ["a"]),
        ({"a": [1, 2]}, {"a": [1]}, ["a"]),
        ({"a": 1, "b": 2}, {"b": 3, "c": 4}, ["a", "b", "c"]),
        ({"a": (1, 2)}, {"a": [1, 2]}, []),
    ],
)
def test_differences_are_named_by_where_they_are(stored, recomputed, where):
    assert [difference.where for difference in differences(stored, recomputed)] == where


def test_files_that_no_attempt_is_recorded_with_are_named_and_count_nowhere(kept):
    raw = next((kept / "raw").iterdir())
    for name in ("trial-03-1.frames.parquet", "trial-03-2.pressures.parquet.unfinished"):
        (raw / name).write_bytes(b"left by an end within a trial")

    found = verified(kept)

    assert found.unrecorded == (
        f"raw/{raw.name}/trial-03-1.frames.parquet",
        f"raw/{raw.name}/trial-03-2.pressures.parquet.unfinished",
    )
    assert found.agrees


def test_a_result_of_the_first_law_is_verified_by_it(kept):
    """It agrees as ever, and what is said of it now is no disagreement."""
    with Ledger.open(kept, print) as ledger:
        run = ledger.find("last")
        trial = ledger.trials(run.number)[0]
    pressures = read_pressures(kept / trial.raw["pressures"].path)
    frames = read_frames(kept / trial.raw["frames"].path)
    old = replace(trial, result=derive(frames, pressures, trial.windows, run.basis("sphere"), PLAIN_MEANS))
    assert old.result.law == 1
    found = verify_trial(kept, run, old)
    assert found.agrees
    assert found.recomputed
    (note,) = found.notes
    assert "made by law 1 of measurement" in note
    assert "every height would be the same to 0 mm" in note


def test_what_the_newest_law_would_say_of_an_old_result_is_told(tmp_path, trial):
    frames = trial.frames.positions_mm.reshape(-1, 16, 3).copy()
    frames[1530:1540, 7] = 0
    trial = trial.but(frames=replace(trial.frames, positions_mm=frames.reshape(-1, 3)))
    with LedgerWriter.open(tmp_path, print) as writer:
        run = writer.begin_run(run_of(trial))
        record = recorded(trial, writer, run, 1, 1)
    pressures = read_pressures(tmp_path / record.raw["pressures"].path)
    old = derive(trial.frames, pressures, record.windows, run.basis("sphere"), PLAIN_MEANS)
    found = verify_trial(tmp_path, run, replace(record, result=old))
    assert found.agrees
    assert "every height would be the same to" in found.notes[0]
    assert "same to 0 mm" not in found.notes[0]


def test_a_result_of_a_law_that_is_not_known_is_not_judged(one_trial):
    folder, run, trial = one_trial
    found = verify_trial(folder, run, replace(trial, result=replace(trial.result, law=3)))
    assert not found.agrees
    assert "made by law 3 of measurement, and this version knows 1, 2" in found.problems[0]
