"""What `labctl doctor` says of gauges: which are not to be trusted, and why a zero is not seen."""

import json
from dataclasses import replace

import pytest

from labctl.drivers.alicat_ascii import AlicatAscii
from labctl.safety.safe_state import SETPOINT_ZERO_PSI


def findings_of(lab):
    done = lab("doctor", "--rig", lab.rig, "--json")
    return done.code, [
        (each["subject"], each["verdict"], each["text"]) for each in json.loads(done.out)["findings"]
    ]


def zero_of(lab):
    (found,) = [each[1:] for each in findings_of(lab)[1] if each[0] == "gauge zero"]
    return found


def flag(monkeypatch, name, flags):
    """The device of this name marks its readings with these flags."""
    read = AlicatAscii.read

    def flagged(gauge, timeout_s=None):
        reading = read(gauge, timeout_s)
        return replace(reading, status=reading.status | flags) if gauge.name == name else reading

    monkeypatch.setattr(AlicatAscii, "read", flagged)


@pytest.mark.parametrize("name", ["regulator A", "gauge B"])
@pytest.mark.parametrize("faulty", ["ADC", "POV", "OPL"])
def test_a_gauge_that_does_not_trust_itself_is_a_fault(lab_with, monkeypatch, name, faulty):
    lab = lab_with(second_gauge="alicat-ascii")
    flag(monkeypatch, name, {faulty})

    code, findings = findings_of(lab)

    assert code == 2
    assert any(
        subject == name
        and verdict == "fault"
        and f"reports {faulty}: its reading is not to be trusted" in text
        for subject, verdict, text in findings
    )


def test_the_way_out_of_a_vented_rig_is_not_called_shut_for_a_gauge_that_does_not_trust_itself(
    lab, monkeypatch
):
    lab("vent", "--rig", lab.rig)
    flag(monkeypatch, "regulator A", {"ADC"})

    verdict, text = zero_of(lab)

    assert verdict == "unknown"
    assert "reports ADC" in text
    assert "not open" not in text


def test_nor_for_a_valve_that_is_on(lab):
    lab("vent", "--rig", lab.rig)
    lab.plant.write_coils({3: True})

    verdict, text = zero_of(lab)

    assert verdict == "unknown"
    assert "valve channels still on: 3" in text
    assert "not open" not in text


def test_a_rig_in_control_has_its_way_out_shut(lab):
    verdict, text = zero_of(lab)

    assert verdict == "unknown"
    assert "the way out is not open" in text


def test_a_setpoint_that_safe_calls_0_hides_no_pressure(lab_with):
    lab = lab_with("regulator=offset:0.4")
    lab.plant.write_setpoint(0.01)
    assert SETPOINT_ZERO_PSI > 0.01

    verdict, text = zero_of(lab)

    assert verdict == "fault"
    assert "pressure is left, or the gauge's zero is off" in text
