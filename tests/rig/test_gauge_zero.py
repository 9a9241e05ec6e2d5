"""A rig whose gauge does not read 0 where the pressure must be 0: by the double's truth, from both sides."""

import pytest

from labctl.doubles.faults import parse_faults
from labctl.drivers.alicat_ascii import AlicatAscii
from labctl.errors import InstrumentError, RigUnavailable, Tripped, Unsafe
from labctl.rig import Rig
from labctl.stop import OperatorStop


def open_rig(virtual, notes=None):
    return Rig(
        virtual.config,
        stop=OperatorStop(),
        notify=[].append if notes is None else notes.append,
        platform=virtual.platform,
    )


def pressurise(rig, pressure_psi):
    rig.make_safe()
    rig.jam({4})
    rig.start_control()
    rig.ramp_to(pressure_psi, lambda _: None)


@pytest.mark.parametrize(
    "settings", [{}, {"regulator": "alicat-modbus"}, {"single_valve": True, "dump_channel": 32}]
)
@pytest.mark.parametrize("offset_psi", [-1.0, -0.4, -0.15, 0.15, 0.25, 0.4])
def test_a_zero_that_is_off_is_refused_before_anything_is_energised(rig_with, settings, offset_psi):
    virtual = rig_with(f"regulator=offset:{offset_psi}", **settings)

    with pytest.raises(RigUnavailable, match="tare") as caught:
        open_rig(virtual)

    assert f"the pressure reads {offset_psi:.2f} psi" in str(caught.value)
    assert "not 0 +- 0.1 psi" in str(caught.value)
    # By its reading alone it may hold a pressure.
    told = "was found energised (pressure 0.4" if offset_psi > 0.25 else "Nothing was energised"
    assert told in str(caught.value)
    assert virtual.plant.state().setpoint_psi == 0
    assert not virtual.plant.state().coils
    # A regulator in control lets in what its gauge lacks, until its exhaust is opened.
    assert virtual.plant.highest_psi < 0.25
    # The guard gave the ports back: the tare can be done.
    assert virtual.guards[0].ended(1.0)
    with pytest.raises(RigUnavailable, match="tare"):
        open_rig(virtual)


def test_a_reading_far_above_zero_is_unsafe_and_names_both_causes(rig_with):
    virtual = rig_with("regulator=offset:0.8")

    with pytest.raises(Unsafe, match="zero is off, or pressure is trapped"):
        open_rig(virtual)


@pytest.mark.parametrize("offset_psi", [-0.09, 0.0, 0.09])
def test_one_within_the_tolerance_is_opened_and_told(rig_with, offset_psi):
    virtual, notes = rig_with(f"regulator=offset:{offset_psi}"), []

    with open_rig(virtual, notes) as rig:
        assert rig.zero_psi == pytest.approx(offset_psi, abs=0.02)
        pressurise(rig, 3.9)
        rig.settle(3.9, lambda _: None)

    assert virtual.plant.highest_psi < 4.05
    assert bool(notes) == (offset_psi < -0.02)
    assert not notes or "trip at 4.2" in notes[0]


def test_the_trip_is_by_the_true_pressure(rig_with):
    virtual = rig_with("regulator=offset:-0.09", "regulator=overpressure@3.9psi")

    with pytest.raises(Tripped, match="over-pressure"), open_rig(virtual) as rig:
        pressurise(rig, 3.85)
        rig.wait(20)

    assert virtual.plant.highest_psi < 4.37


def test_a_setpoint_that_would_be_too_much_in_truth_is_refused(rig_with):
    virtual = rig_with("regulator=offset:-0.08")

    with open_rig(virtual) as rig:
        rig.make_safe()
        with pytest.raises(InstrumentError, match=r"4 psi on it are 4\.0\d psi in the sheet, above"):
            rig.ramp_to(4.0, lambda _: None)
        with pytest.raises(InstrumentError, match="tare"):
            rig.write_setpoint(4.0)

    assert virtual.plant.highest_psi < 0.1


def test_a_sheet_that_is_still_emptying_is_waited_for(rig_with):
    virtual = rig_with()
    virtual.plant.write_setpoint(3.0)
    virtual.time.sleep(5)
    virtual.plant.write_setpoint(0.0)

    with open_rig(virtual) as rig:
        assert rig.zero_psi == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("offset_psi", [-0.3, 0.3])
def test_a_zero_that_moves_under_pressure_is_no_safe_state(rig_with, offset_psi):
    virtual = rig_with(f"regulator=offset:{offset_psi}@1.5psi")

    with pytest.raises(Unsafe, match="labctl tare") as caught, open_rig(virtual) as rig:
        pressurise(rig, 2.0)

    report = rig.safe_report
    assert report.only_zero_is_off
    assert f"the pressure reads {offset_psi:.2f} psi, not 0" in str(caught.value)
    assert "setpoint 0, exhaust open and every valve off were read back" in str(caught.value)
    virtual.assert_safe()
    assert virtual.guards[0].ended(1.0), "the guard keeps the port from a tare"


def test_the_uninflated_sheet_is_not_measured_by_a_gauge_that_reads_too_little(rig_with):
    virtual = rig_with()
    with pytest.raises(Unsafe), open_rig(virtual) as rig:
        rig.make_safe()
        virtual.doubles.inject(parse_faults(["regulator=offset:-0.3"]))
        with pytest.raises(InstrumentError, match=r"-0\.\d\d psi are left.*labctl tare"):
            rig.fall_below(0.1)


@pytest.mark.parametrize("kind", ["alicat-ascii", "alicat-modbus"])
@pytest.mark.parametrize(("gain", "highest_psi"), [(0.9, 3.4), (1.1, 3.5)])
def test_a_second_gauge_shows_a_wrong_gain(rig_with, kind, gain, highest_psi):
    virtual = rig_with(f"regulator=gain:{gain}", second_gauge=kind)

    with pytest.raises(Tripped, match=r"regulator A reads .* and gauge B .* apart"), open_rig(virtual) as rig:
        pressurise(rig, 3.9)
        rig.wait(5)

    assert virtual.plant.highest_psi < highest_psi
    assert virtual.doubles.gauge_writes == 0


def test_without_one_a_wrong_gain_goes_by_unseen(rig_with):
    """What safety.md says of it."""
    virtual = rig_with("regulator=gain:0.9")

    with open_rig(virtual) as rig:
        pressurise(rig, 3.9)
        rig.wait(5)

    assert 4.3 < virtual.plant.highest_psi < 4.4


@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_two_good_gauges_agree_through_a_whole_inflation(rig_with, speed):
    virtual = rig_with(second_gauge="alicat-ascii", speed=speed)

    with open_rig(virtual) as rig:
        assert rig.identities.by_instrument()["gauge"].model.startswith("PC")
        pressurise(rig, 3.9)
        rig.settle(3.9, lambda _: None)

    assert rig.safe_report.safe
    assert virtual.doubles.gauge_writes == 0


@pytest.mark.parametrize(
    ("fault", "words"), [("offset:-0.3", r"gauge B: .* -0\.30 psi"), ("silent", "gauge B")]
)
def test_a_second_gauge_that_is_off_or_silent_is_refused_at_opening(rig_with, fault, words):
    virtual = rig_with(f"gauge={fault}", second_gauge="alicat-ascii")

    with pytest.raises(RigUnavailable, match=words):
        open_rig(virtual)


def test_a_second_gauge_that_falls_silent_under_pressure_vents(rig_with):
    virtual = rig_with("gauge=silent@1.5psi", second_gauge="alicat-ascii")

    with pytest.raises(Tripped, match="gauge B has not been read"), open_rig(virtual) as rig:
        pressurise(rig, 3.9)

    virtual.assert_safe()


@pytest.mark.parametrize("settings", [{}, {"single_valve": True, "dump_channel": 32}])
def test_the_zero_of_the_second_gauge_is_looked_at_while_no_gas_comes_in(rig_with, monkeypatch, settings):
    virtual = rig_with("regulator=offset:-0.09", second_gauge="alicat-ascii", **settings)
    read, seen = AlicatAscii.read, []

    def look(gauge, timeout_s=None):
        if gauge.name == "gauge B":
            state = virtual.plant.state()
            seen.append(state.exhausting or state.holding)
        return read(gauge, timeout_s)

    monkeypatch.setattr(AlicatAscii, "read", look)
    with open_rig(virtual):
        pass

    # Half a second's readings at the least; the supervisor's come after them.
    assert seen[:5] == [True] * 5
