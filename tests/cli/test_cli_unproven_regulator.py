"""A regulator on Modbus whose unit or order of words is not what rig.toml says: nothing is energised, vent works."""

import json
import re

import pytest

from labctl.errors import BadInput

SPHERE = ("inflate", "--pattern", "sphere", "--rig")
PROOF = 'pressure_unit_proven = "the double is made in psi"\n'


def without_proof(text):
    assert PROOF in text
    return text.replace(PROOF, "")


def low_first(text):
    return text.replace(PROOF, PROOF + 'word_order = "low-first"\n')


@pytest.fixture
def modbus_with(lab_with):
    return lambda *faults, **settings: lab_with(*faults, regulator="alicat-modbus", **settings)


# Fault, and what doctor, inflate and vent say of it.
NO_READINGS = [
    (
        "swapped-words",
        "with the words low-first: set the gateway's order, or this instrument's word_order in rig.toml",
    ),
    ("swapped-bytes", "with the words high-first, bytes exchanged: set the gateway's order"),
    ("unknown-status-bit", "status bit 20 is set, which the map does not have"),
]


@pytest.mark.parametrize(("fault", "words"), NO_READINGS)
def test_what_is_no_reading_energises_nothing_and_is_not_called_safe(modbus_with, fault, words):
    lab = modbus_with(f"regulator={fault}")
    lab.time.sleep(1)
    doctor = lab("doctor", "--rig", lab.rig)
    assert doctor.code == 2
    assert "registers 0000" in doctor.out or "registers 0010" in doctor.out

    inflated = lab(*SPHERE, lab.rig)
    assert inflated.code == 2, inflated.err
    assert re.search("Nothing was energised|labctl energised nothing", inflated.err)
    assert lab.plant.highest_psi == 0
    assert lab.last()["setpoint_psi"] == 0
    assert lab.last()["coils"] == []

    vented = lab("vent", "--rig", lab.rig)
    assert vented.code == 1
    assert "UNSAFE" in vented.out
    assert words in doctor.out + inflated.err + vented.out


@pytest.mark.parametrize("fault", ["swapped-words", "swapped-bytes", "unknown-status-bit"])
def test_what_stops_being_a_reading_under_pressure_is_vented(modbus_with, fault):
    lab = modbus_with(f"regulator={fault}@2psi")
    ended = lab(*SPHERE, lab.rig)
    assert ended.code == 1
    assert "no credible pressure reading" in ended.err
    assert lab.last()["setpoint_psi"] == 0
    assert lab.plant.highest_psi < 4.1


def test_a_gateway_that_exchanges_words_can_be_used_by_word_order(modbus_with):
    lab = modbus_with("regulator=swapped-words", change=low_first)
    done = lab(*SPHERE, lab.rig, "--json")
    assert done.code == 0, done.err
    assert lab.plant.highest_psi == pytest.approx(3.9, abs=0.1)
    lab.virtual.assert_safe()
    assert "words low-first, as readings have shown" in lab("doctor", "--rig", lab.rig).out


def test_a_second_gauge_behind_such_a_gateway_can_be_used_too(lab_with):
    faults, gauge = "gauge=swapped-words", {"second_gauge": "alicat-modbus"}
    in_vain = lab_with(faults, **gauge)
    refused = in_vain(*SPHERE, in_vain.rig)
    assert refused.code == 2
    assert "gauge B" in refused.err
    assert "this instrument's word_order in rig.toml" in refused.err
    assert "regulator" not in refused.err

    def low_first_gauge(text):
        return text.replace("[gauge]\n", '[gauge]\nword_order = "low-first"\n')

    lab = lab_with(faults, change=low_first_gauge, **gauge)
    done = lab(*SPHERE, lab.rig, "--json")
    assert done.code == 0, done.err


def test_word_order_low_first_is_refused_where_the_words_are_not_exchanged(modbus_with):
    lab = modbus_with(change=low_first)
    lab.time.sleep(1)
    refused = lab(*SPHERE, lab.rig)
    assert refused.code == 2
    assert "psi with the words high-first" in refused.err
    assert "word_order" in refused.err
    assert lab.plant.highest_psi == 0


@pytest.mark.parametrize(
    ("faults", "change"), [((), without_proof), (("regulator=unit-bar",), lambda text: text)]
)
def test_an_unproven_unit_is_not_energised_and_vent_works(modbus_with, faults, change):
    lab = modbus_with(*faults, change=change)
    refused = lab(*SPHERE, lab.rig)
    assert refused.code == 2
    assert "a device in bar would take 3.9 for 57 psi" in refused.err
    assert "regulator.pressure_unit_proven" in refused.err
    assert lab.plant.highest_psi == 0

    doctor = lab("doctor", "--rig", lab.rig)
    assert doctor.code == 2
    assert "psi by rig.toml, NOT PROVEN" in doctor.out

    vented = lab("vent", "--rig", lab.rig)
    assert vented.code == 0, vented.out
    assert "NOT PROVEN" in vented.out
    lab.virtual.assert_safe()


def test_a_device_in_bar_says_so_over_ascii(lab_with):
    lab = lab_with("regulator=unit-bar")
    refused = lab(*SPHERE, lab.rig)
    assert refused.code == 2
    assert "the device is set to BARG, the configuration says psi" in refused.err
    assert lab.plant.highest_psi == 0


def test_a_device_in_bar_is_used_as_what_it_is(modbus_with):
    def in_bar(text):
        return text.replace(
            'pressure_unit = "psi"', 'pressure_unit = "bar"\npressure_unit_proven = "read off its display"'
        )

    lab = modbus_with("regulator=unit-bar", change=in_bar)
    done = lab(*SPHERE, lab.rig, "--json")
    assert done.code == 0, done.err
    assert lab.plant.highest_psi == pytest.approx(3.9, abs=0.1)
    lab.virtual.assert_safe()
    said = json.loads(done.out)
    assert (said["pressure_unit"], said["pressure_unit_proven"]) == ("bar", "read off its display")


def test_the_users_word_is_printed_with_every_output(modbus_with, tmp_path):
    lab = modbus_with()
    word = "pressure unit psi, proven: the double is made in psi"
    for command in ("status", "vent"):
        assert word in lab(command, "--rig", lab.rig).out
        assert json.loads(lab(command, "--rig", lab.rig, "--json").out)["pressure_unit_proven"]
    assert "pressure unit: psi, proven: the double is made in psi" in lab("doctor", "--rig", lab.rig).out
    ledger = tmp_path / "ledger"
    inflated = lab(*SPHERE, lab.rig, "--keep", "--ledger", ledger)
    assert word in inflated.out
    shown = lab("show", "1", "--ledger", ledger).out
    assert "psi as configured, proven: the double is made in psi" in shown


@pytest.mark.parametrize("where", [{}, {"second_gauge": "alicat-ascii"}])
def test_a_fault_of_the_modbus_protocol_is_no_fault_of_one_on_ascii(lab_with, where):
    instrument = "gauge" if where else "regulator"
    with pytest.raises(BadInput, match=f"{instrument}=swapped-words is one of the Modbus protocol"):
        lab_with(f"{instrument}=swapped-words", **where)
