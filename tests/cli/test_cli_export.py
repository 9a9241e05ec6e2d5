"""`labctl export` on a small ledger."""

import hashlib
import json

import ezc3d
import made_measurement as made
import numpy as np
import pandas as pd
import pytest

from labctl.cli.main import run as labctl
from labctl.simulation.measured_heights import read_measured

PRESSURES_PSI = (2.0, 2.5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A ledger of a calibration with a good trial and an aborted one of which nothing was recorded."""
    run = made.run("calibration", pressures_psi=PRESSURES_PSI)
    trials = [made.trial(run), made.trial(run, 2, outcome="aborted", reason="stopped", derived=None, raw={})]
    return made.ledger(tmp_path_factory.mktemp("export") / "ledger", (run, trials))


@pytest.fixture
def export(folder, tmp_path):
    """Export run 1 into a folder."""

    def exported(kind, *more):
        code = labctl(
            ["export", "1", "--format", kind, "--ledger", str(folder), "--out", str(tmp_path / kind), *more]
        )
        assert code == 0
        return tmp_path / kind

    return exported


def test_csv_has_the_tables_and_says_what_their_columns_are(export):
    out = export("csv")

    assert sorted(path.name for path in out.iterdir()) == [
        *("README.txt", "calibration.csv", "points.csv", "pressures.csv", "trials.csv"),
    ]
    trials = pd.read_csv(out / "trials.csv")
    assert trials["pressure_psi"].dropna().tolist() == list(PRESSURES_PSI)
    assert trials["outcome"].tolist() == ["good", "good", "aborted"]
    expected = (
        made.result(made.run("calibration", pressures_psi=PRESSURES_PSI), seed=11).levels[0].e_t_percent
    )
    assert trials["e_t_percent"][0] == expected
    readme = (out / "README.txt").read_text(encoding="utf-8")
    assert "SIMULATED RIG" in readme
    assert all(column in readme for column in trials.columns)


def test_the_calibration_table_is_one_that_compare_reads(export):
    measured = read_measured(export("csv") / "calibration.csv", points=16)

    assert measured.pressures_psi == PRESSURES_PSI
    assert measured.points_mm == pytest.approx(np.array([(point.x_mm, point.y_mm) for point in made.POINTS]))


def test_parquet_has_the_tables_and_the_raw_files_as_they_are(export, folder):
    out = export("parquet")

    assert len(pd.read_parquet(out / "points.parquet")) == 2 * 16
    for name in ("trial-01-1.frames.parquet", "trial-01-1.pressures.parquet"):
        (original,) = folder.rglob(name)
        copied = (out / "raw" / name).read_bytes()
        assert hashlib.sha256(copied).digest() == hashlib.sha256(original.read_bytes()).digest()


def test_c3d_has_a_file_a_recorded_trial_and_names_the_others(export, capsys):
    out = export("c3d", "--json")

    assert json.loads(capsys.readouterr().out) == {
        "folder": str(out),
        "files": ["trial-01-1.c3d"],
        "left_out": ["trial 2, attempt 1: nothing was recorded"],
    }
    read = ezc3d.c3d(str(out / "trial-01-1.c3d"))
    residuals = read["data"]["meta_points"]["residuals"][0]
    assert np.flatnonzero((residuals < 0).all(axis=0)).tolist() == list(made.GAPS["lost"])
    assert np.argwhere(residuals[:, :1000] < 0).tolist() == [[3, 500], [3, 501]]
    said = read["parameters"]["LABCTL"]
    assert said["FRAME"]["value"] == ["sheet"]
    assert said["RIG"]["value"] == ["simulated rig, SIMULATED"]
    events = read["parameters"]["EVENT"]["LABELS"]["value"]
    assert events == [
        f"{name} {which}"
        for name in ("baseline", "level 2 psi", "level 2.5 psi")
        for which in ("begins", "ends")
    ]


def test_nothing_is_overwritten(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run-0001-csv").mkdir()

    assert labctl(["export", "last", "--format", "csv", "--ledger", str(folder)]) == 2
    assert "run-0001-csv: is there already, and nothing is overwritten" in capsys.readouterr().err
    assert list((tmp_path / "run-0001-csv").iterdir()) == []


@pytest.mark.parametrize("kind", ["csv", "parquet", "c3d"])
def test_a_raw_file_that_is_gone_is_named_and_nothing_is_left(kind, tmp_path, capsys):
    run = made.run()
    folder = made.ledger(tmp_path / "ledger", (run, [made.trial(run)]))
    for path in folder.rglob("*.parquet"):
        path.unlink()

    arguments = ["export", "1", "--format", kind, "--ledger", str(folder), "--out", str(tmp_path / "out")]
    assert labctl(arguments) == 1
    assert "trial-01-1." in capsys.readouterr().err
    assert [entry.name for entry in tmp_path.iterdir()] == ["ledger"]


@pytest.mark.parametrize("kind", ["csv", "parquet", "c3d"])
@pytest.mark.parametrize("stream", ["frames", "pressures"])
def test_another_trials_raw_file_is_not_handed_on_as_this_ones(kind, stream, tmp_path, capsys):
    run = made.run()
    folder = made.ledger(tmp_path / "ledger", (run, [made.trial(run), made.trial(run, 2)]))
    one, other = (folder / f"raw/0001-five-trial/trial-0{n}-1.{stream}.parquet" for n in (1, 2))
    one.write_bytes(other.read_bytes())

    arguments = ["export", "1", "--format", kind, "--ledger", str(folder), "--out", str(tmp_path / "out")]
    if (kind, stream) == ("csv", "frames"):
        # The tables hold nothing of the frames themselves.
        assert labctl(arguments) == 0
        return
    assert labctl(arguments) == 1
    assert f"{one.relative_to(folder)}: changed" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_no_export_lands_among_the_raw_recordings(folder, capsys):
    out = folder / "raw" / "0009-mine"

    assert labctl(["export", "1", "--format", "csv", "--ledger", str(folder), "--out", str(out)]) == 2
    assert "is where ledger" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("outcomes", "words"), [((), "no trial yet"), (("aborted",), "trial 1, attempt 1: nothing was recorded")]
)
def test_no_empty_folder_stands_for_the_motion_of_a_run_without_any(outcomes, words, tmp_path, capsys):
    run = made.run()
    trials = [
        made.trial(run, outcome=outcome, reason="stopped", derived=None, raw={}) for outcome in outcomes
    ]
    folder = made.ledger(tmp_path / "ledger", (run, trials))

    arguments = ["export", "1", "--format", "c3d", "--ledger", str(folder), "--out", str(tmp_path / "out")]
    assert labctl(arguments) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
