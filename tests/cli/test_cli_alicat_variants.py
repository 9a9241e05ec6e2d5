"""Regulators of other firmwares, and regulators as other programs leave them, from `doctor` to SAFE."""

import pytest

SPHERE = ("inflate", "--pattern", "sphere", "--rig")


@pytest.mark.parametrize(
    ("firmware", "revision", "source"),
    [
        ("gp", "GP07R100", "unknown"),
        ("5v12", "5v12.0-R22", "unknown"),
        ("6v21", "6v21.0-R22", "unknown"),
        ("8v17", "8v17.0-R23", "unknown"),
        ("10v05", "10v05.0-R24", "ok"),
    ],
)
def test_a_firmware_is_named_and_its_rig_inflates(lab_with, firmware, revision, source):
    lab = lab_with(regulator_firmware=firmware)
    doctor = lab("doctor", "--rig", lab.rig)
    assert doctor.code == 0, doctor.err
    assert f"PCD-15PSIG-D, serial number 123456, firmware {revision}" in doctor.out
    assert any(line.split()[:3] == [source, "setpoint", "source:"] for line in doctor.out.splitlines())
    done = lab(*SPHERE, lab.rig)
    assert done.code == 0, done.err
    lab.virtual.assert_safe()
    assert lab.plant.highest_psi < 4.1


def test_a_regulator_that_ramps_its_own_setpoint_is_named_by_doctor_and_refused_before_it_inflates(lab_with):
    lab = lab_with("regulator=own-ramp:0.5")
    assert "ramps its own setpoint by 0.5 PSIG/s" in lab("doctor", "--rig", lab.rig).out
    done = lab(*SPHERE, lab.rig)
    assert done.code == 1
    assert "the device ramps its own setpoint (SR: 0.5 PSIG/s)" in done.err
    assert "SR 0 4" in done.err
    assert "ignores writes" not in done.err
    lab.virtual.assert_safe()
    assert lab.plant.highest_psi < 0.5


@pytest.mark.parametrize(
    ("fault", "note"), [("streaming", "was streaming and has been set to polling"), ("half-line", "ok")]
)
def test_a_regulator_as_another_program_left_it_is_taken_over(lab_with, fault, note):
    lab = lab_with(f"regulator={fault}")
    doctor = lab("doctor", "--rig", lab.rig)
    assert doctor.code == 0, doctor.err
    assert note in doctor.out
    assert lab(*SPHERE, lab.rig).code == 0
    lab.virtual.assert_safe()


def test_a_regulator_whose_answer_comes_late_is_vented_and_read_back(lab_with):
    lab = lab_with("regulator=late-once:1.5@3psi", "regulator=silent-version")
    done = lab(*SPHERE, lab.rig)
    assert done.code == 1
    assert "no answer" in done.err or "old answer" in done.err
    assert "SAFE, as read back" in done.err
    lab.virtual.assert_safe()


def test_doubles_of_a_firmware_that_modbus_does_not_show_are_refused(labctl):
    done = labctl("doubles", "serve", "--regulator", "alicat-modbus", "--regulator-firmware", "6v21")
    assert done.code == 2
    assert "firmware 6v21 shows on the ASCII protocol alone" in done.err


@pytest.mark.parametrize("word", ["own-ramp:0.5", "streaming", "silent-version"])
def test_faults_of_the_ascii_protocol_are_refused_on_modbus(labctl, word):
    done = labctl("doubles", "serve", "--regulator", "alicat-modbus", "--fault", f"regulator={word}")
    assert done.code == 2
    assert "is one of the ASCII protocol" in done.err
