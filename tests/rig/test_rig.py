"""The rig on doubles in virtual time: real bytes, a sheet without the simulator's cost."""

import pytest

from labctl.doubles.faults import Faults, parse_faults
from labctl.errors import InstrumentError, RigUnavailable, Stopped, Tripped, Unsafe
from labctl.instruments.readings import PressureReading
from labctl.rig import Rig
from labctl.stop import OperatorStop


def open_rig(virtual, stop=None, notify=lambda _: None):
    return Rig(virtual.config, stop=stop or OperatorStop(), notify=notify, platform=virtual.platform)


def pressurise(rig, pressure_psi=2.0):
    rig.make_safe()
    rig.jam({4})
    rig.start_control()
    rig.ramp_to(pressure_psi, lambda _: None)


def test_opening_energises_nothing(rig_with):
    virtual = rig_with()
    with open_rig(virtual) as rig:
        assert rig.identities.regulator.serial_number == "123456"
        state = virtual.plant.state()
        assert state.setpoint_psi == 0
        assert not state.coils


def test_what_was_read_back_is_what_the_plant_does(rig_with):
    virtual = rig_with()
    with open_rig(virtual) as rig:
        pressurise(rig)
        trace = rig.settle(2.0, lambda _: None)
        assert virtual.plant.state().coils == {4}
        assert trace.times_s[-1] - trace.times_s[0] >= virtual.config.limits.settle_s
        assert trace.mean_psi == pytest.approx(2.0, abs=0.1)


def test_a_rig_that_was_vented_for_somebody_is_energised_by_nobody_again(rig_with):
    virtual = rig_with()
    # In a teardown no stop is looked at: this one never is.
    with open_rig(virtual) as rig:
        pressurise(rig)
        assert rig.vent_for("labctl vent from another terminal").safe
        virtual.assert_safe()
        for energise in (lambda: rig.jam({4}), rig.start_control, lambda: rig.write_setpoint(1.0)):
            with pytest.raises(Stopped, match="stopped by labctl vent from another terminal"):
                energise()
        virtual.assert_safe()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_leaving_the_block_in_any_way_ends_in_safe(rig_with, error):
    virtual = rig_with()
    with pytest.raises(error), open_rig(virtual) as rig:
        pressurise(rig)
        raise error

    assert rig.safe_report.safe
    virtual.assert_safe()
    with pytest.raises(InstrumentError, match="closed"):
        rig.jam({4})


def test_a_stop_is_seen_by_the_next_verb(rig_with):
    virtual = rig_with()
    stop = OperatorStop()
    with pytest.raises(Stopped, match="Ctrl-C"), open_rig(virtual, stop) as rig:
        pressurise(rig)
        stop.set("Ctrl-C")
        rig.wait(10)

    virtual.assert_safe()


def test_a_trip_latches_until_reset_and_reset_does_not_energise(rig_with):
    virtual = rig_with("regulator=overpressure@1psi")
    with open_rig(virtual) as rig:
        with pytest.raises(Tripped, match="moves away from its setpoint"):
            pressurise(rig, 1.5)
            rig.wait(20)
        virtual.doubles.inject(Faults())
        for energise in (lambda: rig.jam({4}), lambda: rig.write_setpoint(1.0), rig.start_control):
            with pytest.raises(Tripped):
                energise()

        rig.reset()

        virtual.assert_safe()
        rig.jam({4})
        assert virtual.plant.state().coils == {4}


def test_a_protocol_that_hangs_is_vented(rig_with):
    virtual = rig_with()
    with open_rig(virtual) as rig:
        pressurise(rig)
        virtual.time.sleep(virtual.config.limits.heartbeat_s + 1.5)
        virtual.assert_safe()
        with pytest.raises(Tripped, match="not beaten"):
            rig.check()


def test_a_guard_that_is_killed_is_noticed(rig_with):
    virtual = rig_with()
    with open_rig(virtual) as rig:
        pressurise(rig)
        virtual.guards[0].killed = True
        with pytest.raises(Tripped, match="guard process has ended"):
            rig.wait(20)

    virtual.assert_safe()


def test_a_broken_terminal_does_not_keep_the_supervisor_from_venting(rig_with):
    def notify(text):
        raise BrokenPipeError

    virtual = rig_with("regulator=overpressure@1psi")
    with pytest.raises(Tripped), open_rig(virtual, notify=notify) as rig:
        pressurise(rig, 1.5)
        rig.wait(20)

    assert virtual.plant.state().setpoint_psi == 0


def test_a_relay_that_falls_off_by_itself_is_noticed(rig_with):
    virtual = rig_with()
    with open_rig(virtual) as rig:
        pressurise(rig)
        virtual.plant.write_coils({4: False})
        with pytest.raises(Tripped, match="valves read back none on, 4 were switched on"):
            rig.wait(20)

    virtual.assert_safe()


def test_a_marker_stream_that_stalls_is_not_a_short_measurement(rig_with):
    virtual = rig_with()
    with open_rig(virtual) as rig:
        assert len(rig.capture(1.0)[0]) > 200
        virtual.doubles.inject(parse_faults(["markers=silent"]))
        with pytest.raises(InstrumentError, match="frames came in"):
            rig.capture(4.0)


def test_a_stream_that_loses_the_odd_frame_is_fine(rig_with):
    virtual = rig_with()
    with open_rig(virtual) as rig:
        frames, trace = rig.capture(2.0)
    assert len(frames) > 400
    assert len(trace.pressures_psi) > 3


def test_a_dump_valve_is_closed_with_the_fibers_and_open_in_safe(rig_with):
    virtual = rig_with(single_valve=True, dump_channel=32)
    with open_rig(virtual) as rig:
        pressurise(rig)
        assert virtual.plant.state().coils == {4, 32}
        report = rig.make_safe()
        assert report.vented_by == "dump"
        assert not virtual.plant.state().coils


def test_a_regulator_that_takes_its_setpoint_elsewhere_is_refused(rig_with):
    virtual = rig_with("regulator=ignored-setpoint")
    with pytest.raises(RigUnavailable, match="analog"):
        open_rig(virtual)


def test_a_rig_in_use_is_refused_and_left_alone(rig_with):
    virtual = rig_with()
    with open_rig(virtual) as rig:
        pressurise(rig)
        with pytest.raises(RigUnavailable, match="labctl energised nothing"):
            open_rig(virtual)
        rig.wait(1.0)
        assert virtual.plant.state().coils == {4}


def test_a_rig_found_energised_that_stays_unsafe_is_left_to_the_guard(rig_with):
    virtual = rig_with()
    virtual.plant.write_setpoint(2.0)
    virtual.doubles.inject(parse_faults(["regulator=stuck-setpoint"]))
    with pytest.raises(Unsafe, match="was found energised"):
        open_rig(virtual)
    assert virtual.plant.state().setpoint_psi == 2.0

    virtual.doubles.inject(Faults())

    end_s = virtual.time.now_s() + 10
    while virtual.plant.state().setpoint_psi != 0:
        assert virtual.time.now_s() < end_s, "the guard did not try"
        virtual.time.sleep(0.05)
    virtual.time.sleep(2)
    virtual.assert_safe()


@pytest.mark.parametrize(("reading_psi", "settles"), [(4.2, True), (4.0, True), (4.21, False), (3.99, False)])
def test_a_pressure_on_the_edge_of_its_band_has_settled(rig_with, monkeypatch, reading_psi, settles):
    """The law by which a recording is measured (labctl.instruments.readings.in_band) is the one that is waited by."""
    virtual = rig_with()

    def reads():
        virtual.time.sleep(0.05)
        return PressureReading(reading_psi, 4.1)

    with open_rig(virtual) as rig:
        monkeypatch.setattr(rig, "pressure", reads)
        if settles:
            assert rig.settle(4.1, lambda _: None).mean_psi == pytest.approx(reading_psi)
        else:
            with pytest.raises(InstrumentError, match="did not stay within"):
                rig.settle(4.1, lambda _: None)


def test_closing_gives_every_link_back_once_safe_was_read(rig_with):
    virtual = rig_with()
    with open_rig(virtual) as rig:
        pressurise(rig)
    assert rig.safe_report.safe

    with open_rig(virtual) as again:
        assert again.identities == rig.identities
