"""Relay boards that answer otherwise than the manual's: a whole inflation on each, by the plant's truth."""

import pytest

ODD_BOARDS = [
    (("bytes-reversed",), "rtu"),
    (("bytes-reversed", "write-bytes-reversed"), "tcp"),
    (("no-all-coil",), "rtu"),
    (("single-coils-only",), "rtu"),
    (("single-coils-only",), "tcp"),
]


@pytest.mark.parametrize(("faults", "transport"), ODD_BOARDS)
def test_each_fiber_is_stiffened_and_released(lab_with, faults, transport):
    lab = lab_with(*(f"valves={fault}" for fault in faults), valve_transport=transport)
    seen: set[int] = set()
    lab.when(lambda: lab.plant.state().pressure_psi > 1, lambda: seen.update(lab.plant.state().coils))
    ended = lab("inflate", "--rig", lab.rig, "--pattern", "sphere", "--json")
    assert ended.code == 0, ended.err
    assert f'"channels_on": {sorted(seen)}' in ended.out
    assert seen
    lab.virtual.assert_safe()


# What a board forgets while a pattern is on, and one coil that is stuck off beside it.
@pytest.mark.parametrize("fault", ["no-multiple-write", "single-coils-only"])
def test_what_a_board_no_longer_answers_under_pressure_does_not_keep_a_valve_on(lab_with, fault):
    lab = lab_with(f"valves={fault}@2psi", "valves=stuck-coil:32")
    lab("inflate", "--rig", lab.rig, "--pattern", "sphere")
    lab.virtual.assert_safe()


@pytest.mark.parametrize("fault", ["no-all-coil", "no-multiple-write", "single-coils-only", "bytes-reversed"])
def test_vent_switches_off_what_somebody_left_on(lab_with, fault):
    lab = lab_with(f"valves={fault}")
    lab.plant.write_coils({12: True, 32: True})
    ended = lab("vent", "--rig", lab.rig)
    assert ended.code == 0, ended.out
    assert "SAFE, as read back" in ended.out
    lab.virtual.assert_safe()


def test_an_old_firmware_of_eight_channels(lab_with):
    lab = lab_with("valves=old-firmware", relay_channels=8)
    lab.plant.write_coils({3: True})
    assert lab("vent", "--rig", lab.rig).code == 0
    lab.virtual.assert_safe()
    assert lab("inflate", "--rig", lab.rig, "--pattern", "sphere").code == 0
    lab.virtual.assert_safe()
    assert "an old firmware: its coils are read as one byte at 0x00FF" in lab("doctor", "--rig", lab.rig).out


def test_doctor_says_how_a_board_is_driven(lab_with):
    said = {
        "bytes-reversed": "last byte first, as eight at a time have shown",
        "no-all-coil": "first byte first, as eight at a time have shown",
        "single-coils-only": "read one by one, because it does not answer for more",
    }
    for fault, words in said.items():
        lab = lab_with(f"valves={fault}")
        lab.plant.write_coils({12: True})
        assert words in lab("doctor", "--rig", lab.rig).out, fault
