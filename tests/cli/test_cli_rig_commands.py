"""`labctl vent`, `labctl status` and `labctl doctor` on rigs in virtual time."""

import json

import pytest


def test_vent_takes_a_rig_that_was_left_energised_to_safe(lab):
    lab.leave_energised()

    done = lab("vent", "--rig", lab.rig)

    assert done.code == 0, done.err
    assert done.out.splitlines()[0].startswith("SIMULATED RIG")
    assert done.out.splitlines()[1].startswith("simulated rig: SAFE, as read back: setpoint 0.00 psi")
    lab.virtual.assert_safe()


def test_vent_says_what_it_could_not_read_back(lab_with):
    lab = lab_with("valves=silent")

    done = lab("vent", "--rig", lab.rig, "--json")

    assert done.code == 1
    result = json.loads(done.out)
    assert (result["safe"], result["channels_on"], result["vented_by"]) == (False, None, "exhaust")
    assert result["problems"][0] == "the valves could not be read back"
    assert all("no answer" in problem for problem in result["problems"][1:])
    assert lab.plant.state().exhausting


def test_status_tells_what_is_read_and_writes_nothing(lab):
    assert json.loads(lab("status", "--rig", lab.rig, "--json").out)["safe"] is False
    lab.assert_untouched()

    lab.leave_energised()
    done = lab("status", "--rig", lab.rig)

    assert done.code == 0, done.err
    assert "simulated rig: NOT SAFE: " in done.out
    assert "setpoint 2.00 psi" in done.out
    assert lab.last()["setpoint_psi"] == 2.0


@pytest.mark.parametrize(("instrument", "name"), [("regulator", "regulator A"), ("valves", "valve bank")])
def test_status_of_an_instrument_that_is_silent_gives_the_ports_back(lab_with, instrument, name):
    lab = lab_with(f"{instrument}=silent")

    for _ in range(2):
        done = lab("status", "--rig", lab.rig)
        assert done.code == 2
        assert name in done.err
        assert "no answer" in done.err


def test_the_doctor_finds_every_instrument_and_energises_nothing(lab):
    done = lab("doctor", "--rig", lab.rig, "--json")

    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result["ok"] is True
    answering = {found["subject"] for found in result["findings"] if found["verdict"] == "ok"}
    assert answering >= {"regulator A", "valve bank", "marker stream", "guard process", "setpoint source"}
    missing = {found["subject"] for found in result["findings"] if found["verdict"] == "missing"}
    assert missing == {"dump valve", "valve board watchdog"}
    lab.assert_untouched()


def test_the_doctor_states_who_bears_witness_to_the_gauge_and_what_remains(lab, lab_with):
    done = lab("doctor", "--rig", lab.rig)
    assert "ok      witness of the gauge: the sheet, by 16 markers" in done.out
    assert "fill the sheet up to its supply pressure" in done.out

    blind = lab_with("markers=blind")
    done = blind("doctor", "--rig", blind.rig)
    assert "missing witness of the gauge: 0 markers are seen and 3 are needed" in done.out


@pytest.mark.parametrize("instrument", ["regulator", "valves", "markers"])
def test_the_doctor_names_an_instrument_that_does_not_answer(lab_with, instrument):
    lab = lab_with(f"{instrument}=silent")

    done = lab("doctor", "--rig", lab.rig, "--json")

    assert done.code == 2
    faults = [found for found in json.loads(done.out)["findings"] if found["verdict"] == "fault"]
    assert [found["subject"] for found in faults] == [instrument]
