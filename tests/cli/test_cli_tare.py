"""`labctl tare`, and what the commands say of a gauge whose zero is off, on rigs in virtual time."""

import json
import signal

import pytest

from labctl.cli.output import ProgressLine
from labctl.cli.rigs import chosen_rig
from labctl.doubles.faults import parse_faults
from labctl.drivers.alicat_ascii import AlicatAscii
from labctl.ledger.ledger import Ledger
from labctl.ledger.writer import LedgerWriter

INFLATE = ("inflate", "--pattern", "sphere")


@pytest.mark.parametrize(
    "settings", [{}, {"regulator": "alicat-modbus"}, {"single_valve": True, "dump_channel": 32}]
)
@pytest.mark.parametrize("offset_psi", [0.4, -0.4])
def test_a_gauge_that_is_off_is_refused_tared_and_then_measures(lab_with, tmp_path, settings, offset_psi):
    lab = lab_with(f"regulator=offset:{offset_psi}", **settings)
    refused = lab(*INFLATE, "--rig", lab.rig)
    assert refused.code == 2
    assert "labctl tare" in refused.err

    done = lab("tare", "--rig", lab.rig, "--ledger", tmp_path / "ledger", "--json")

    assert done.code == 0, done.err
    tared = json.loads(done.out)
    assert tared["before_psi"] == pytest.approx(offset_psi, abs=0.02)
    assert tared["after_psi"] == pytest.approx(0, abs=0.02)
    assert tared["simulated"] is True
    with Ledger.open(tmp_path / "ledger", lambda _: None) as ledger:
        (event,) = ledger.events(None)
    assert event.kind == "tared"
    assert event.detail["before_psi"] == tared["before_psi"]
    assert lab.plant.highest_psi < 0.3
    assert lab(*INFLATE, "--rig", lab.rig).code == 0
    assert 3.9 < lab.plant.highest_psi < 3.99


def test_the_list_of_runs_shows_a_tare(lab_with, tmp_path):
    lab = lab_with("regulator=offset:0.2")
    assert lab("tare", "--rig", lab.rig, "--ledger", tmp_path).code == 0

    listed = lab("runs", "--ledger", tmp_path)

    assert "tared: simulated rig (SIMULATED), which read 0.20 psi at 0" in listed.out
    assert json.loads(lab("runs", "--ledger", tmp_path, "--json").out)["tared"][0]["rig"] == "simulated rig"


@pytest.mark.parametrize("falls", ["silent", "garbage"])
def test_a_tare_that_was_commanded_is_recorded_whatever_comes_after_it(
    lab_with, tmp_path, monkeypatch, falls
):
    lab = lab_with("regulator=offset:0.2")
    take = AlicatAscii.tare

    def then_fall_silent(regulator, timeout_s=None):
        reading = take(regulator, timeout_s)
        lab.virtual.doubles.inject(parse_faults([f"regulator={falls}"]))
        return reading

    monkeypatch.setattr(AlicatAscii, "tare", then_fall_silent)

    done = lab("tare", "--rig", lab.rig, "--ledger", tmp_path)

    assert done.code == 1, done.err
    assert "the tare was commanded: regulator A read 0.20 psi before it and was not read after it" in done.err
    with Ledger.open(tmp_path, lambda _: None) as ledger:
        (event,) = ledger.events(None)
    assert event.kind == "tared"
    assert event.detail["before_psi"] == pytest.approx(0.2, abs=0.02)
    assert event.detail["after_psi"] is None
    assert "regulator A" in event.detail["error"]
    assert "which read 0.20 psi at 0 (after the command: regulator A" in lab("runs", "--ledger", tmp_path).out


def test_a_tare_that_does_not_read_back_is_recorded(lab_with, tmp_path, monkeypatch):
    lab = lab_with("regulator=offset:0.2")
    monkeypatch.setattr(AlicatAscii, "tare", AlicatAscii.read)

    done = lab("tare", "--rig", lab.rig, "--ledger", tmp_path)

    assert done.code == 1
    assert "reads 0.20 psi after it" in done.err
    with Ledger.open(tmp_path, lambda _: None) as ledger:
        (event,) = ledger.events(None)
    assert event.detail["after_psi"] == pytest.approx(0.2, abs=0.02)


def test_ctrl_c_after_the_command_leaves_a_record(lab_with, tmp_path, monkeypatch):
    lab = lab_with("regulator=offset:0.2")
    take = AlicatAscii.tare

    def then_ctrl_c(regulator, timeout_s=None):
        reading = take(regulator, timeout_s)
        signal.raise_signal(signal.SIGINT)
        return reading

    monkeypatch.setattr(AlicatAscii, "tare", then_ctrl_c)

    done = lab("tare", "--rig", lab.rig, "--ledger", tmp_path)

    assert done.code == 130
    assert "the tare was commanded" in done.err
    with Ledger.open(tmp_path, lambda _: None) as ledger:
        (event,) = ledger.events(None)
    assert "Ctrl-C" in event.detail["error"]


def test_who_asks_for_a_vent_is_not_answered_by_way_of_the_terminal(lab_with, tmp_path, monkeypatch):
    lab = lab_with("regulator=offset:0.2")
    given = []
    monkeypatch.setattr(
        "labctl.cli.tare.chosen_rig", lambda *arguments: given.append(arguments[3]) or chosen_rig(*arguments)
    )

    assert lab("tare", "--rig", lab.rig, "--ledger", tmp_path).code == 0

    assert isinstance(given[0].__self__, ProgressLine)


@pytest.mark.parametrize("offset_psi", [0.7, -0.7])
def test_an_offset_that_may_be_a_pressure_is_not_tared(lab_with, tmp_path, offset_psi):
    lab = lab_with(f"regulator=offset:{offset_psi}")

    done = lab("tare", "--rig", lab.rig, "--ledger", tmp_path)

    assert done.code == 2
    assert "0.5 psi at most (limits.tare_within)" in done.err
    with Ledger.open(tmp_path, lambda _: None) as ledger:
        assert ledger.events(None) == ()


def test_a_rig_that_is_energised_is_not_tared(lab, tmp_path):
    lab.leave_energised()

    done = lab("tare", "--rig", lab.rig, "--ledger", tmp_path)

    assert done.code == 2
    assert "setpoint reads 2.00 psi" in done.err
    assert "labctl vent" in done.err
    assert lab.last()["setpoint_psi"] == 2.0


def test_what_cannot_be_recorded_is_not_done(lab_with, tmp_path):
    lab = lab_with("regulator=offset:0.4")
    with LedgerWriter.open(tmp_path, lambda _: None):
        done = lab("tare", "--rig", lab.rig, "--ledger", tmp_path)

    assert done.code == 2
    assert "writes to it since" in done.err
    lab.assert_untouched()
    lab.time.sleep(0.1)
    assert lab.plant.state().measured_psi == pytest.approx(0.4, abs=0.05)


@pytest.mark.parametrize("offset_psi", [-1.0, -0.3, -0.15, -0.08, 0.05, 0.15, 1.0])
def test_the_truth_stays_below_4_1_psi_whatever_the_offset(lab_with, offset_psi):
    """A sample of `make bench-gauge`, which takes every 0.05 psi."""
    lab = lab_with(f"regulator=offset:{offset_psi}")

    done = lab(*INFLATE, "--rig", lab.rig)

    assert (done.code == 0) == (abs(offset_psi) <= 0.1), done.err
    assert done.code == 0 or "tare" in done.err
    assert lab.plant.highest_psi < (4.1 if done.code == 0 else 0.3)


def test_the_highest_pressure_is_one_in_truth(lab_with):
    lab = lab_with("regulator=offset:-0.08")

    done = lab(*INFLATE, "--rig", lab.rig, "--pressure", "4 psi")

    assert done.code == 1
    assert "above limits.max_pressure" in done.err
    assert lab.plant.highest_psi < 0.1


@pytest.mark.parametrize("fault", ["offset:-0.3@3psi", "offset:0.3@3psi", "drift:-0.02@2psi"])
def test_a_trial_during_which_the_zero_moved_is_not_good(lab_with, kinds_of, trials_of, tmp_path, fault):
    lab = lab_with(f"regulator={fault}")

    done = lab(*INFLATE, "--rig", lab.rig, "--keep", "--ledger", tmp_path)

    assert done.code == 1
    assert "labctl tare" in done.err
    assert "zero-moved" in kinds_of(tmp_path)
    (trial,) = trials_of(tmp_path)
    assert trial.outcome == "failed"
    assert trial.safe.safe is False
    assert "zero is off" in trial.reason
    lab.virtual.assert_safe()


@pytest.mark.parametrize(("offset_psi", "verdict"), [(0.0, "ok"), (0.4, "fault"), (-0.4, "fault")])
def test_the_doctor_sees_a_zero_once_the_way_out_is_open(lab_with, offset_psi, verdict):
    lab = lab_with(f"regulator=offset:{offset_psi}")
    before = _zero_of(lab)
    lab("vent", "--rig", lab.rig)

    assert _zero_of(lab) == verdict
    # A regulator in control steers its reading to 0 where the gauge reads too little: that shows nothing.
    assert before == ("fault" if offset_psi > 0 else "unknown")


def _zero_of(lab):
    done = lab("doctor", "--rig", lab.rig, "--json")
    (found,) = [each for each in json.loads(done.out)["findings"] if each["subject"] == "gauge zero"]
    assert (done.code == 2) == (found["verdict"] == "fault")
    return found["verdict"]


def test_the_doctor_compares_a_second_gauge(lab_with):
    lab = lab_with("gauge=offset:0.4", second_gauge="alicat-ascii")

    done = lab("doctor", "--rig", lab.rig)

    assert done.code == 2
    assert "regulator A reads 0.00 psi and gauge B 0.40 psi" in done.out
    assert lab.virtual.doubles.gauge_writes == 0


@pytest.mark.parametrize(("second_gauge", "code"), [(None, 0), ("alicat-ascii", 1)])
def test_a_wrong_gain_is_seen_with_a_second_gauge_only(lab_with, second_gauge, code):
    lab = lab_with("regulator=gain:0.9", second_gauge=second_gauge)

    done = lab(*INFLATE, "--rig", lab.rig)

    assert done.code == code, done.err
    assert ("apart" in done.err) == bool(code)
    assert (lab.plant.highest_psi > 4.1) == (second_gauge is None)
