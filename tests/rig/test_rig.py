"""The rig on doubles in this process: real bytes, a sheet without the simulator's cost."""

import time

import pytest

from labctl.doubles.chamber import Mode
from labctl.doubles.faults import Faults, parse_faults
from labctl.errors import InstrumentError, RigUnavailable, Stopped, Tripped, Unsafe
from labctl.rig import Rig
from labctl.stop import OperatorStop


def open_rig(config, stop=None, tell=lambda _: None):
    return Rig(config, stop=stop or OperatorStop(), tell=tell)


def pressurise(rig, pressure_psi=2.0):
    rig.make_safe()
    rig.jam({4})
    rig.start_control()
    rig.ramp_to(pressure_psi, lambda _: None)


def assert_plant_is_safe(doubles):
    state = doubles.plant.state()
    assert state.setpoint_psi == 0
    assert state.mode is Mode.EXHAUST
    assert state.pressure_psi < 0.3
    assert not state.coils


def test_opening_energises_nothing(serve):
    doubles, config = serve()
    with open_rig(config) as rig:
        assert rig.identities.regulator.serial_number == "123456"
        state = doubles.plant.state()
        assert state.setpoint_psi == 0
        assert not state.coils


def test_what_was_read_back_is_what_the_plant_does(serve):
    doubles, config = serve()
    with open_rig(config) as rig:
        pressurise(rig)
        trace = rig.settle(2.0, lambda _: None)
        assert doubles.plant.state().coils == {4}
        assert trace.times_s[-1] - trace.times_s[0] >= config.limits.settle_s
        assert trace.mean_psi == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_leaving_the_block_in_any_way_ends_in_safe(serve, error):
    doubles, config = serve()
    with pytest.raises(error), open_rig(config) as rig:
        pressurise(rig)
        raise error

    assert rig.safe_report.safe
    assert_plant_is_safe(doubles)
    with pytest.raises(InstrumentError, match="closed"):
        rig.jam({4})


def test_a_stop_is_seen_by_the_next_verb(serve):
    doubles, config = serve()
    stop = OperatorStop()
    with pytest.raises(Stopped, match="Ctrl-C"), open_rig(config, stop) as rig:
        pressurise(rig)
        stop.set("Ctrl-C")
        rig.wait(10)

    assert_plant_is_safe(doubles)


def test_a_trip_latches_until_reset_and_reset_does_not_energise(serve):
    doubles, config = serve("regulator=overpressure@1psi", speed=1.0)
    with open_rig(config) as rig:
        with pytest.raises(Tripped, match="over-pressure"):
            pressurise(rig, 1.5)
            rig.wait(20)
        doubles.inject(Faults())
        for energise in (lambda: rig.jam({4}), lambda: rig.write_setpoint(1.0), rig.start_control):
            with pytest.raises(Tripped):
                energise()

        rig.reset()

        assert_plant_is_safe(doubles)
        rig.jam({4})
        assert doubles.plant.state().coils == {4}


def test_a_protocol_that_hangs_is_vented(serve):
    doubles, config = serve()
    with open_rig(config) as rig:
        pressurise(rig)
        time.sleep(config.limits.heartbeat_s + 1.5)
        assert_plant_is_safe(doubles)
        with pytest.raises(Tripped, match="not beaten"):
            rig.check()


def test_a_guard_that_is_killed_is_noticed(serve):
    doubles, config = serve()
    with open_rig(config) as rig:
        pressurise(rig)
        rig._guard._process.kill()
        with pytest.raises(Tripped, match="guard process has ended"):
            rig.wait(20)

    assert_plant_is_safe(doubles)


def test_a_broken_terminal_does_not_keep_the_supervisor_from_venting(serve):
    def tell(text):
        raise BrokenPipeError

    doubles, config = serve("regulator=overpressure@1psi", speed=1.0)
    with pytest.raises(Tripped), open_rig(config, tell=tell) as rig:
        pressurise(rig, 1.5)
        rig.wait(20)

    assert doubles.plant.state().setpoint_psi == 0


def test_a_relay_that_falls_off_by_itself_is_noticed(serve):
    doubles, config = serve()
    with open_rig(config) as rig:
        pressurise(rig)
        doubles.plant.write_coils({4: False})
        with pytest.raises(Tripped, match="valves read back none on, 4 were switched on"):
            rig.wait(20)

    assert_plant_is_safe(doubles)


def test_a_marker_stream_that_stalls_is_not_a_short_measurement(serve):
    doubles, config = serve()
    with open_rig(config) as rig:
        assert len(rig.capture(1.0)[0]) > 200
        doubles.inject(parse_faults(["markers=silent"]))
        with pytest.raises(InstrumentError, match="frames came in"):
            rig.capture(4.0)


def test_a_stream_that_loses_the_odd_frame_is_fine(serve):
    _, config = serve()
    with open_rig(config) as rig:
        frames, trace = rig.capture(2.0)
    assert len(frames) > 400
    assert len(trace.pressures_psi) > 3


def test_a_dump_valve_is_closed_with_the_fibers_and_open_in_safe(serve):
    doubles, config = serve(single_valve=True, dump_channel=32)
    with open_rig(config) as rig:
        pressurise(rig)
        assert doubles.plant.state().coils == {4, 32}
        report = rig.make_safe()
        assert report.vented_by == "dump"
        assert not doubles.plant.state().coils


def test_a_regulator_that_takes_its_setpoint_elsewhere_is_refused(serve):
    _, config = serve("regulator=ignored-setpoint")
    with pytest.raises(RigUnavailable, match="analog"):
        open_rig(config)


def test_a_rig_in_use_is_refused_and_left_alone(serve):
    doubles, config = serve()
    with open_rig(config) as rig:
        pressurise(rig)
        with pytest.raises(RigUnavailable, match="Nothing was energised"):
            open_rig(config)
        rig.wait(1.0)
        assert doubles.plant.state().coils == {4}


def test_a_rig_found_energised_that_stays_unsafe_is_left_to_the_guard(serve):
    doubles, config = serve()
    doubles.plant.write_setpoint(2.0)
    doubles.inject(parse_faults(["regulator=stuck-setpoint"]))
    with pytest.raises(Unsafe, match="was found energised"):
        open_rig(config)
    assert doubles.plant.state().setpoint_psi == 2.0

    doubles.inject(Faults())

    end_s = time.monotonic() + 10
    while doubles.plant.state().setpoint_psi != 0:
        assert time.monotonic() < end_s, "the guard did not try"
        time.sleep(0.05)
    assert_plant_is_safe(doubles)
