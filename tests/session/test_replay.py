"""What `labctl inflate` and `labctl run` report of one and the same recorded rig: the same, to the last bit."""

import errno
import json
import os
import signal
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_recording import FREQUENCY_HZ, hide, made_pressures, made_trial, pressure_at
from replayed_rig import RecordedTrial, ReplayedRig

from labctl.cli.main import run as labctl
from labctl.config.load import load_design
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.ledger.ledger import Ledger
from labctl.ledger.raw.parquet_writer import ParquetWriter
from labctl.ledger.raw.recording import read_frames, read_pressures

# Two looks of a second each are what a sheet that stands still takes with `still_over` at 1 s.
LOOKS_S = 2.0
MEASUREMENT = '[measurement]\nstill_over = "1 s"\n'
TEXT = rig_toml(DoublesSettings(design=load_design("known")), "/dev/null", "/dev/zero", "127.0.0.1", 0)


def made(hold_psi=3.9, highest_psi=None, hidden=(), share_hidden=1.0):
    """A made recording; in its level one reading at `highest_psi`, and markers hidden in a share of the frames."""
    trial = made_trial()
    asked_s = np.arange(0, 40, 0.05)
    gauge_psi = pressure_at(asked_s) * hold_psi / 3.9
    if highest_psi is not None:
        gauge_psi[np.searchsorted(asked_s, 15.5)] = highest_psi
    frames = trial.frames
    if hidden:
        first, end = (int(time_s * FREQUENCY_HZ) for time_s in (15, 16))
        frames = hide(frames, hidden, slice(first, first + round((end - first) * share_hidden)))
    return RecordedTrial(frames, made_pressures(asked_s, gauge_psi), trial.windows[:2])


def left_in(temporary):
    """What is left of a recording; who held a rig stands beside it, where the system names no other place."""
    return [each for each in temporary.iterdir() if each.name != f"labctl-{os.getuid()}"]


@pytest.fixture
def bench(tmp_path, monkeypatch, capsys):
    """Both commands on a rig that replays a recording: what each printed, and the trial that it committed."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    text = TEXT.replace("frequency_hz = 240", f"frequency_hz = {FREQUENCY_HZ:g}")
    lab = SimpleNamespace(
        rig_text=text.replace('"4.0 psi"', '"4.1 psi"\nwarn_pressure = "4.2 psi"'),
        measurement=MEASUREMENT,
        temporary=temporary,
    )

    def command(recorded, looks_s, *arguments, at_settle=lambda: None):
        path = tmp_path / "rig.toml"
        path.write_text(lab.rig_text + lab.measurement)

        def replay(config, *, stop, notify, platform, venting):
            return ReplayedRig(config, recorded, stop, looks_s, at_settle)

        monkeypatch.setattr("labctl.session.measure.Rig", replay)
        code = labctl([*arguments, "--pattern", "sphere", "--rig", str(path)])
        shown = capsys.readouterr()
        assert "Traceback" not in shown.err
        return SimpleNamespace(code=code, out=shown.out, err=shown.err)

    def trial(ledger):
        with Ledger.open(ledger, print) as read:
            (found,) = read.trials(1)
            return read.run(1), found

    def inflate(recorded, *arguments, **more):
        return command(recorded, 0.0, "inflate", *arguments, **more)

    def both(recorded, *arguments):
        """Of each command how it ended and its trial; inflate both kept and thrown away."""
        kept, run = tmp_path / "kept", tmp_path / "run"
        thrown = inflate(recorded, *arguments, "--json")
        inflated = inflate(recorded, *arguments, "--keep", "--ledger", str(kept), "--json")
        one = ("--trials", "1", "--attempts", "1")
        ran = command(
            recorded, LOOKS_S, "run", "five-trial", *one, *arguments, "--ledger", str(run), "--json"
        )
        assert not left_in(temporary)
        return SimpleNamespace(
            thrown=thrown,
            inflated=inflated,
            ran=ran,
            inflate_run=trial(kept)[0],
            inflate_trial=trial(kept)[1],
            run_trial=trial(run)[1],
        )

    lab.both, lab.inflate = both, inflate
    return lab


def assert_agree(found, recorded):
    """Every number of both trials, and what each command printed of them."""
    assert (found.thrown.code, found.inflated.code, found.ran.code) == (0, 0, 0), found.ran.err
    assert found.inflate_trial.outcome == found.run_trial.outcome == "good"
    assert found.inflate_trial.windows == found.run_trial.windows
    assert found.run_trial.windows == recorded.windows
    assert found.inflate_trial.result == found.run_trial.result
    (level,) = found.run_trial.levels
    (reported,) = json.loads(found.ran.out)["trials"]
    assert reported["heights_mm"] == [list(level.heights_mm)]
    assert reported["e_t_percent"] == [level.e_t_percent]
    inflated = json.loads(found.inflated.out)
    assert inflated.pop("run") == found.inflate_run.number
    assert inflated == json.loads(found.thrown.out)
    assert inflated["heights_mm"] == [None if mm is None else round(mm, 3) for mm in level.heights_mm]
    assert inflated["transfer_error_percent"] == round(level.e_t_percent, 3)
    assert inflated["points"] == level.points_compared
    assert inflated["pressure_psi"] == round(level.mean_psi, 4)
    assert inflated["pressure_range_psi"] == [level.lowest_psi, level.highest_psi]
    assert inflated["frames"] == level.frames
    assert inflated["occluded_samples"] == [level.frames - seen for seen in level.seen]
    assert inflated["channels_on"] == [1, 2, 3, 4, 5, 6]
    assert inflated["safe"] is True


def assert_both_refuse(found, reason):
    """With the same reason, and without a number."""
    assert (found.thrown.code, found.inflated.code, found.ran.code) == (1, 1, 1)
    assert found.inflate_trial.outcome == found.run_trial.outcome == "failed"
    assert found.inflate_trial.reason == found.run_trial.reason
    assert reason in found.run_trial.reason
    assert json.loads(found.thrown.out) == {
        "error": found.run_trial.reason,
        "simulated": True,
        "safe": True,
    }
    for ended in (found.inflated, found.ran):
        assert found.run_trial.reason in json.loads(ended.out)["error"]
        assert "heights_mm" not in ended.out


def test_one_recording_gives_both_commands_the_same_numbers(bench):
    recorded = made(hidden=(3,), share_hidden=0.25)

    assert_agree(bench.both(recorded), recorded)


def test_a_recording_of_the_doubles_gives_both_commands_the_numbers_that_it_was_made_with(bench, laboratory):
    lab = laboratory()
    lab.run(lab.prepared(trials=1))
    with Ledger.open(lab.folder, print) as ledger:
        (trial,) = ledger.trials(1)
    (window,) = (window for window in trial.windows if window.kind == "level")
    recorded = RecordedTrial(
        read_frames(lab.folder / trial.raw["frames"].path),
        read_pressures(lab.folder / trial.raw["pressures"].path),
        trial.windows,
    )
    bench.rig_text, bench.measurement = lab.rig.text, ""

    found = bench.both(recorded, "--pressure", f"{window.pressure_psi} psi")

    assert found.inflate_trial.outcome == found.run_trial.outcome == "good", found.run_trial.reason
    assert found.inflate_trial.result == found.run_trial.result
    (level,), (first,) = found.inflate_trial.levels, trial.levels
    assert replace(level, per_point_percent=(), e_t_percent=None) == replace(
        first, per_point_percent=(), e_t_percent=None
    )


def test_a_reading_on_the_edge_of_the_band_is_inside_for_both(bench):
    recorded = made(hold_psi=4.1, highest_psi=4.2)
    recorded = replace(
        recorded, windows=(recorded.windows[0], replace(recorded.windows[1], pressure_psi=4.1))
    )

    assert_agree(bench.both(recorded, "--pressure", "4.1 psi"), recorded)


def test_a_reading_beyond_the_edge_is_outside_for_both(bench):
    found = bench.both(made(hold_psi=4.1, highest_psi=4.21), "--pressure", "4.1 psi")

    assert_both_refuse(
        found, "the pressure left 4.1 +- 0.1 psi while the markers were captured (4.100 to 4.210"
    )


@pytest.mark.parametrize(("min_points", "good"), [(6, True), (7, False)])
def test_min_points_of_the_rig_rules_both(bench, min_points, good):
    bench.measurement += f"min_points = {min_points}\n"
    recorded = made(hidden=range(10))

    found = bench.both(recorded)

    if good:
        assert_agree(found, recorded)
    else:
        assert_both_refuse(found, "6 of 16 markers were seen in at least 50% of the frames")


@pytest.mark.parametrize(("min_share", "good"), [(0.39, True), (0.5, False)])
def test_min_share_of_the_rig_rules_both(bench, min_share, good):
    bench.measurement += f"min_points = 16\nmin_share = {min_share}\n"
    recorded = made(hidden=(2, 5), share_hidden=0.6)

    found = bench.both(recorded)

    if good:
        assert_agree(found, recorded)
    else:
        assert_both_refuse(found, "14 of 16 markers were seen in at least 50% of the frames")


def test_a_person_reads_how_to_look_at_what_was_kept(bench, tmp_path, monkeypatch):
    monkeypatch.setenv("LABCTL_OPERATOR", "Ada")
    ended = bench.inflate(made(), "--keep", "--ledger", str(tmp_path / "kept"))

    lines = ended.out.splitlines()
    assert lines[-4].startswith("SAFE, as read back")
    assert lines[-3:] == [
        "look at it:",
        f"  labctl show 1 --ledger {tmp_path / 'kept'}",
        f"  labctl report 1 --ledger {tmp_path / 'kept'}",
    ]
    with Ledger.open(tmp_path / "kept", print) as ledger:
        assert ledger.run(1).protocol == "inflate"
        assert ledger.run(1).operator == "Ada"
        assert [event.kind for event in ledger.events(1)] == ["trial-begun", "finished"]


def test_what_is_not_measured_is_not_claimed(bench):
    ended = bench.inflate(made(hidden=(0, 9)))

    assert ended.code == 0
    assert "not measured, too rarely seen: markers 0, 9" in ended.out
    rows = {line.split()[0]: line.split() for line in ended.out.splitlines() if line[:6].strip().isdigit()}
    assert rows["9"][3] == "-"
    assert rows["9"][5:] == ["0", "0", "100"]
    assert " over 14 points" in ended.out


@pytest.mark.parametrize("keep", [False, True])
def test_ctrl_c_leaves_no_temporary_folder_and_no_success(bench, tmp_path, keep):
    ledger = ("--keep", "--ledger", str(tmp_path / "kept")) if keep else ()
    ended = bench.inflate(made(), *ledger, "--json", at_settle=lambda: os.kill(os.getpid(), signal.SIGINT))

    assert ended.code == 130
    assert json.loads(ended.out)["safe"] is True
    assert not left_in(bench.temporary)
    if keep:
        with Ledger.open(tmp_path / "kept", print) as read:
            assert [trial.outcome for trial in read.trials(1)] == ["aborted"]


def test_a_full_temporary_folder_is_reported_after_safe(bench, monkeypatch):
    def full(writer, _table):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(writer.unfinished))

    monkeypatch.setattr(ParquetWriter, "write", full)
    ended = bench.inflate(made(), "--json")

    assert ended.code == 1
    reported = json.loads(ended.out)
    assert reported["safe"] is True
    assert reported["error"] == (
        f"the temporary recording in {bench.temporary} could not be written: No space left on device; free some "
        "space there, name another place by the environment's TMPDIR, or keep the run with --keep"
    )
    assert not left_in(bench.temporary)


def test_without_a_place_for_a_temporary_folder_nothing_is_opened(bench, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(bench.temporary / "nowhere"))
    ended = bench.inflate(made(), "--json")

    assert ended.code == 2
    assert "no temporary folder for the recording can be made" in json.loads(ended.out)["error"]


def test_a_ledger_that_nothing_is_kept_in_is_refused(bench, tmp_path):
    ended = bench.inflate(made(), "--ledger", str(tmp_path / "kept"))

    assert ended.code == 2
    assert "give both, or neither" in ended.err
    assert not (tmp_path / "kept").exists()
