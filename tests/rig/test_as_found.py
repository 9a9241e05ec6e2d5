"""A rig that was left energised, and of which not every instrument answers: by the plant's truth."""

import pytest

from labctl.errors import LinkDown, RigUnavailable, Unsafe
from labctl.rig import Rig
from labctl.stop import OperatorStop


def open_rig(virtual, notify=lambda _: None):
    return Rig(virtual.config, stop=OperatorStop(), notify=notify, platform=virtual.platform)


def leave_energised(virtual, setpoint_psi=3.9, channels=()):
    virtual.plant.write_setpoint(setpoint_psi)
    virtual.plant.write_coils(dict.fromkeys(channels, True))
    virtual.time.sleep(5)


def pull(virtual, monkeypatch, *instruments):
    """The ports of these instruments are not there."""
    wires = virtual.doubles.wires
    open_serial = wires.open_serial

    def without(port, baudrate, name):
        if name in instruments:
            raise LinkDown(f"{name} on {port}: no such port; check the cable")
        return open_serial(port, baudrate, name)

    monkeypatch.setattr(wires, "open_serial", without)


def test_pressure_behind_a_valve_board_that_is_not_there_is_let_out_and_told(rig_with, monkeypatch):
    virtual, notes = rig_with(), []
    leave_energised(virtual)
    pull(virtual, monkeypatch, "valve bank")

    with pytest.raises(Unsafe) as caught:
        open_rig(virtual, notes.append)

    assert virtual.plant.state().setpoint_psi == 0
    assert virtual.plant.state().exhausting
    assert virtual.plant.state().pressure_psi < 0.3
    words = str(caught.value)
    assert "found energised (setpoint 3.90 psi, pressure 3.9" in words
    assert "regulator A reads setpoint 0.00 psi and 0.0" in words
    assert "valve bank could not be read" in words
    assert "no such port; check the cable" in words
    assert "othing was energised" not in words
    assert "was found energised" in notes[0]


@pytest.mark.parametrize("fault", ["silent", "garbage"])
def test_pressure_behind_a_valve_board_that_does_not_answer_is_let_out(rig_with, fault):
    virtual = rig_with(f"valves={fault}")
    leave_energised(virtual)

    with pytest.raises(Unsafe, match=r"found energised \(setpoint 3\.90 psi.*valve bank could not be read"):
        open_rig(virtual)

    assert virtual.plant.state().setpoint_psi == 0
    assert virtual.plant.state().pressure_psi < 0.3


def test_valves_that_are_on_beside_a_regulator_that_is_not_there_are_switched_off(rig_with, monkeypatch):
    virtual = rig_with()
    leave_energised(virtual, 0.0, [3, 4])
    pull(virtual, monkeypatch, "regulator A")

    with pytest.raises(Unsafe) as caught:
        open_rig(virtual)

    assert not virtual.plant.state().coils
    assert "found energised (channels 3, 4 on)" in str(caught.value)
    assert "regulator A could not be read, valve bank reads no channel on" in str(caught.value)


def test_valves_that_are_on_beside_a_regulator_that_is_silent_are_switched_off(rig_with):
    virtual = rig_with("regulator=silent")
    leave_energised(virtual, 0.0, [3, 4])

    with pytest.raises(Unsafe, match="regulator A could not be read, valve bank reads no channel on"):
        open_rig(virtual)

    assert not virtual.plant.state().coils


@pytest.mark.parametrize(
    ("absent", "reads"),
    [
        (
            "valve bank",
            r"regulator A reads setpoint 0\.00 psi and 0\.0\d psi, valve bank could not be read",
        ),
        ("regulator A", r"regulator A could not be read, valve bank reads no channel on"),
    ],
)
def test_one_that_is_at_rest_beside_an_absent_one_is_left_alone_and_told(
    rig_with, monkeypatch, absent, reads
):
    virtual = rig_with()
    pull(virtual, monkeypatch, absent)

    with pytest.raises(RigUnavailable, match=rf"no such port.*labctl energised nothing: {reads}"):
        open_rig(virtual)

    assert not virtual.plant.state().exhausting
    assert virtual.guards[0].ended(1.0)


def test_a_gauge_that_is_off_on_a_rig_found_energised_is_told_with_what_was_done(rig_with):
    virtual = rig_with("regulator=offset:0.3")
    leave_energised(virtual, 2.0)

    with pytest.raises(RigUnavailable, match="labctl tare") as caught:
        open_rig(virtual)

    assert "was found energised (setpoint 2.00 psi" in str(caught.value)
    assert "othing was energised" not in str(caught.value)
    virtual.assert_safe()


def test_what_fails_after_it_was_taken_to_safe_does_not_call_it_never_energised(rig_with):
    virtual = rig_with("markers=silent")
    leave_energised(virtual, 2.0)

    with pytest.raises(RigUnavailable) as caught:
        open_rig(virtual)

    assert "was found energised (setpoint 2.00 psi" in str(caught.value)
    assert "SAFE, which was read back" in str(caught.value)
    assert "othing was energised" not in str(caught.value)
    virtual.assert_safe()
