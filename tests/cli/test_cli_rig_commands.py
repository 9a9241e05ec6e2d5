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


def test_a_silent_valve_bank_does_not_hide_the_pressure_from_status(lab_with):
    lab = lab_with("valves=silent")
    lab.leave_energised()

    done = lab("status", "--rig", lab.rig)

    assert done.code == 2
    assert "setpoint 2.00 psi" in done.err
    assert "valve bank" in done.err


def test_the_doctor_finds_every_instrument_and_energises_nothing(lab):
    done = lab("doctor", "--rig", lab.rig, "--json")

    assert done.code == 0, done.err
    result = json.loads(done.out)
    assert result["ok"] is True
    answering = {found["subject"] for found in result["findings"] if found["verdict"] == "ok"}
    assert answering >= {"regulator A", "valve bank", "marker stream", "guard process", "setpoint source"}
    missing = {found["subject"] for found in result["findings"] if found["verdict"] == "missing"}
    # In virtual time nobody asks for a priority.
    assert missing == {"dump valve", "valve board watchdog", "real-time priority", "second gauge"}
    assert "this computer" in answering
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


@pytest.mark.parametrize(
    ("fault", "note"),
    [
        ("bad-checksum:5", "packets had a wrong checksum and were skipped"),
        ("split:0.01", None),
        ("interleaved", None),
        ("filter-frames", "frames of 'name 64' were left out"),
        ("payload-in-close", None),
        ("initialized-on-initialize-only", None),
        ("initialized-on-id-0-only", None),
        ("odd-greeting", None),
        (
            "error-events",
            "errors were reported by the server while it sent frames, last 'camera 3 does not answer'",
        ),
        ("repeated-times", "frames were left out because they repeat the time of the one before"),
        ("times-back", "frames were left out because their time goes back"),
        ("partial-record", None),
    ],
)
def test_the_doctor_reads_a_marker_stream_as_servers_send_it_and_names_what_was_passed_over(
    lab_with, fault, note
):
    lab = lab_with(f"markers={fault}")

    done = lab("doctor", "--rig", lab.rig, "--json")

    assert done.code == 0, done.out
    found = {
        (one["verdict"], one["text"])
        for one in json.loads(done.out)["findings"]
        if one["subject"] == "marker stream"
    }
    (seen,) = (text for verdict, text in found if verdict == "ok" and " frames in 1 s" in text)
    assert seen.endswith("16 of 16 markers seen")
    assert int(seen.split()[0]) > 200
    passed_over = [text for verdict, text in found if verdict == "missing"]
    assert any(note in text for text in passed_over) if note else not passed_over


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("bad-checksum:100", "packets had a wrong checksum"),
        ("impossible-size", "announces 4194305 bytes; 4194304 is the most"),
    ],
)
def test_the_doctor_names_why_a_marker_stream_was_given_up(lab_with, fault, cause):
    done = (lab := lab_with(f"markers={fault}"))("doctor", "--rig", lab.rig)

    assert done.code == 2
    assert cause in done.out
    assert "open the rig again" in done.out
