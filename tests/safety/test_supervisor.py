import threading
import time

import pytest

from labctl.clock import WallClock
from labctl.config.rig import Limits
from labctl.errors import Tripped
from labctl.safety.safe_state import make_safe
from labctl.safety.supervisor import Expected, Supervisor

LIMITS = Limits()
HELD = Expected(3.9, frozenset({1, 2}), "control")


@pytest.fixture
def supervisor(regulator, valves, guard, clock, tell):
    def vent():
        return make_safe(regulator, valves, limits=LIMITS, dump_channel=None, clock=clock)

    watching = Supervisor(
        regulator,
        valves,
        LIMITS,
        clock=clock,
        rig_clock=clock,
        bus=threading.RLock(),
        vent=vent,
        guard=guard,
        tell=tell,
    )
    watching.reset()
    watching.expect(HELD)
    watching.arm()
    return watching


def test_a_rig_that_is_as_it_must_be_is_left_alone(supervisor):
    assert supervisor.poll(with_valves=True) is None


def test_over_pressure_trips_at_the_limit_and_not_below(supervisor, regulator, said):
    regulator.pressure_psi = LIMITS.trip_pressure_psi - 0.01
    assert supervisor.poll(with_valves=True) is None
    assert "warning" in said[0]
    regulator.pressure_psi = LIMITS.trip_pressure_psi
    assert "over-pressure: 4.30 psi" in supervisor.poll(with_valves=True)


def test_the_warning_is_said_once(supervisor, regulator, said):
    regulator.pressure_psi = 4.2
    supervisor.poll(with_valves=False)
    supervisor.poll(with_valves=False)
    assert len(said) == 1


def test_a_silent_regulator_trips_when_its_last_reading_is_stale(supervisor, regulator, clock):
    supervisor.poll(with_valves=False)
    regulator.dead = True
    clock.sleep(LIMITS.stale_after_s - 0.01)
    supervisor.beat()
    assert supervisor.poll(with_valves=False) is None
    clock.sleep(0.02)
    assert "no credible pressure reading" in supervisor.poll(with_valves=False)


def test_silent_valves_trip(supervisor, valves, clock):
    valves.dead = True
    clock.sleep(LIMITS.stale_after_s + 0.6)
    assert "valves could not be read" in supervisor.poll(with_valves=True)


def test_a_valve_that_reads_other_than_written_trips(supervisor, valves):
    valves.on = frozenset({1})
    assert "valves read back 1 on, 1, 2 were switched on" in supervisor.poll(with_valves=True)


def test_a_setpoint_that_reads_other_than_written_trips(supervisor, regulator):
    regulator.setpoint_psi = 3.8
    assert "setpoint reads back 3.80 psi" in supervisor.poll(with_valves=False)


def test_a_protocol_that_stops_beating_trips_only_while_armed(supervisor, clock):
    clock.sleep(LIMITS.heartbeat_s + 0.1)
    assert "not beaten" in supervisor.poll(with_valves=False)
    supervisor.disarm()
    assert supervisor.poll(with_valves=False) is None


def test_losing_the_guard_trips(supervisor, guard):
    guard.lives = False
    assert "guard process has ended" in supervisor.poll(with_valves=False)


def test_a_defect_while_polling_trips(supervisor, regulator):
    regulator.read = lambda timeout_s=None: 1 / 0
    assert "unexpected failure" in supervisor.poll(with_valves=False)


@pytest.fixture
def running(regulator, valves, guard, tell):
    bus = threading.RLock()
    wall = WallClock()

    def vent():
        return make_safe(regulator, valves, limits=LIMITS, dump_channel=None, clock=wall)

    watching = Supervisor(
        regulator, valves, LIMITS, clock=wall, rig_clock=wall, bus=bus, vent=vent, guard=guard, tell=tell
    )
    watching.start()
    yield watching
    watching.stop()


def wait_until(condition, timeout_s=3.0):
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s, "did not happen in time"
        time.sleep(0.005)


def test_a_trip_vents_at_once_and_latches_until_reset(running, regulator, valves, said):
    running.expect(HELD)
    wait_until(lambda: running.latest() is not None)
    running.check()

    regulator.pressure_psi = 4.4
    wait_until(lambda: running.trip_report is not None)

    assert regulator.setpoint_psi == 0.0
    assert regulator.exhausting
    assert valves.on == frozenset()
    assert running.trip_report.safe
    wait_until(lambda: any(line.startswith("TRIP: over-pressure") for line in said))
    with pytest.raises(Tripped, match="over-pressure"):
        running.check()

    running.reset()
    running.check()


def test_polls_at_20_hz_and_beats_the_guard(running, calls, guard):
    wait_until(lambda: running.latest() is not None)
    before, beats, start_s = calls.count("read pressure"), guard.beats, time.monotonic()
    time.sleep(1.0)
    rate_hz = (calls.count("read pressure") - before) / (time.monotonic() - start_s)

    assert 15 <= rate_hz <= 21
    assert min(running.late_s) >= 0
    assert len(running.late_s) == pytest.approx(calls.count("read pressure"), abs=1)
    assert guard.beats > beats


def test_a_hang_with_the_bus_held_is_not_covered_up(regulator, valves, guard, tell):
    bus = threading.RLock()
    watching = Supervisor(
        regulator,
        valves,
        LIMITS,
        clock=WallClock(),
        rig_clock=WallClock(),
        bus=bus,
        vent=lambda: None,
        guard=guard,
        tell=tell,
    )
    with bus:
        watching.start()
        time.sleep(0.4)
        assert guard.beats == 0, "the guard must end a program that hangs"
    wait_until(lambda: guard.beats > 0)
    watching.stop()


@pytest.mark.parametrize("pressure_psi", [-12.0, -1.0, -0.6])
def test_a_pressure_that_cannot_be_true_trips(supervisor, regulator, pressure_psi):
    regulator.pressure_psi = pressure_psi
    assert "cannot be true" in supervisor.poll(with_valves=False)


@pytest.mark.parametrize("flag", ["ADC", "POV", "OPL"])
def test_the_devices_own_fault_flags_trip(supervisor, regulator, flag):
    regulator.flags = frozenset({flag})
    assert f"reports {flag}" in supervisor.poll(with_valves=False)


@pytest.mark.parametrize("flag", ["HLD", "EXH"])
def test_a_regulator_that_stopped_following_its_setpoint_trips(supervisor, regulator, flag):
    regulator.flags = frozenset({flag})
    assert "told to follow its setpoint" in supervisor.poll(with_valves=False)


def test_an_exhaust_that_closes_by_itself_after_safe_is_noticed(supervisor, regulator):
    regulator.setpoint_psi = regulator.pressure_psi = 0.0
    supervisor.expect(Expected(0.0, frozenset(), "vented"))
    assert "exhaust reads back closed" in supervisor.poll(with_valves=False)


def test_a_pressure_that_does_not_follow_its_setpoint_trips_after_a_while(supervisor, regulator, clock):
    regulator.pressure_psi = 2.0
    for _ in range(100):
        supervisor.beat()
        reason = supervisor.poll(with_valves=False)
        if reason is not None:
            break
        clock.sleep(0.1)
    assert "away from its setpoint (3.90 psi) for 5 s" in reason
    assert clock.now_s() - 100.0 == pytest.approx(5.1, abs=0.2)


def test_a_vent_that_did_not_end_in_safe_is_tried_again_until_it_does(supervisor, regulator, valves, clock):
    regulator.pressure_psi = 4.4
    regulator.exhaust_works = False
    supervisor.watch(with_valves=True)
    assert not supervisor.trip_report.safe

    regulator.exhaust_works = True
    supervisor.watch(with_valves=True)
    assert not supervisor.trip_report.safe, "not before its time"
    clock.sleep(2.0)
    supervisor.watch(with_valves=True)

    assert supervisor.trip_report.safe
    assert regulator.exhausting


def test_a_valve_that_comes_on_after_the_vent_is_switched_off_again(supervisor, regulator, valves, clock):
    regulator.pressure_psi = 4.4
    supervisor.watch(with_valves=True)
    assert supervisor.trip_report.safe
    supervisor.expect(Expected(0.0, frozenset(), "vented"))
    supervisor.disarm()

    valves.on = frozenset({7})
    clock.sleep(2.0)
    supervisor.watch(with_valves=True)

    assert valves.on == frozenset()


def test_the_vent_comes_before_anything_is_said(regulator, valves, guard, clock):
    order = []

    def vent():
        order.append("vent")
        return make_safe(regulator, valves, limits=LIMITS, dump_channel=None, clock=clock)

    watching = Supervisor(
        regulator,
        valves,
        LIMITS,
        clock=clock,
        rig_clock=clock,
        bus=threading.RLock(),
        vent=vent,
        guard=guard,
        tell=lambda text: order.append("tell"),
    )
    watching.reset()
    regulator.pressure_psi = 4.4
    watching.watch(with_valves=False)

    assert order == ["vent", "tell"]
