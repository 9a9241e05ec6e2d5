import pytest

from labctl.config.rig import Limits
from labctl.errors import Tripped
from labctl.safety.supervisor import Supervisor

LIMITS = Limits()


@pytest.fixture
def supervise(regulator, valves, guard, clock, notify):
    """Make a supervisor of the rig in hand."""

    def make(**changes):
        parts = {"dump_channel": None, "scheduler": clock, "clock": clock, "guard": guard, "notify": notify}
        return Supervisor(regulator, valves, LIMITS, **{**parts, **changes})

    return make


def expect_held(supervisor):
    supervisor.expect(setpoint_psi=3.9, channels_on=frozenset({1, 2}), mode="control")


@pytest.fixture
def supervisor(supervise):
    """One that is armed, its thread not running: the test looks by `poll` and `watch`."""
    watching = supervise()
    with watching.energising(lambda: None):
        expect_held(watching)
    return watching


def test_a_rig_that_is_as_it_must_be_is_left_alone(supervisor):
    assert supervisor.poll(with_valves=True) is None


def test_over_pressure_trips_at_the_limit_and_not_below(supervisor, regulator, notes):
    regulator.pressure_psi = LIMITS.trip_pressure_psi - 0.01
    assert supervisor.poll(with_valves=True) is None
    assert "warning" in notes[0]
    regulator.pressure_psi = LIMITS.trip_pressure_psi
    assert "over-pressure: 4.30 psi" in supervisor.poll(with_valves=True)


def test_the_warning_is_reported_once(supervisor, regulator, notes):
    regulator.pressure_psi = 4.2
    supervisor.poll(with_valves=False)
    supervisor.poll(with_valves=False)
    assert len(notes) == 1


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
    supervisor.make_safe()
    clock.sleep(LIMITS.heartbeat_s + 0.1)
    assert supervisor.poll(with_valves=False) is None


def test_losing_the_guard_trips(supervisor, guard):
    guard.lives = False
    assert "guard process has ended" in supervisor.poll(with_valves=False)


def test_a_defect_while_polling_trips(supervisor, regulator):
    regulator.read = lambda timeout_s=None: 1 / 0
    assert "unexpected failure" in supervisor.poll(with_valves=False)


@pytest.fixture
def running(supervise):
    watching = supervise()
    watching.start()
    yield watching
    watching.stop()


def test_a_trip_vents_at_once_and_latches_until_reset(running, regulator, valves, clock, notes):
    expect_held(running)
    clock.sleep(0.1)
    assert running.latest() is not None
    running.check()

    regulator.pressure_psi = 4.4
    clock.sleep(1.0)

    assert regulator.setpoint_psi == 0.0
    assert regulator.exhausting
    assert valves.on == frozenset()
    assert running.safe_report.safe
    assert any(line.startswith("TRIP: over-pressure") for line in notes)
    with pytest.raises(Tripped, match="over-pressure"):
        running.check()

    running.reset()
    running.check()


def test_polls_at_20_hz_and_beats_the_guard(running, calls, guard, clock):
    clock.sleep(0.01)
    before, beats = calls.count("read pressure"), guard.beats
    clock.sleep(1.0)

    assert calls.count("read pressure") - before == 20
    assert min(running.late_s) >= 0
    assert len(running.late_s) == calls.count("read pressure")
    assert guard.beats - beats == 20


def test_a_hang_with_the_bus_held_is_not_covered_up(supervise, guard, clock):
    watching = supervise()
    with watching.energising(lambda: None):
        watching.start()
        clock.sleep(0.4)
        assert guard.beats == 0, "the guard must end a program that hangs"
    clock.sleep(0.1)
    assert guard.beats > 0
    watching.stop()


def test_a_thread_that_has_died_is_a_trip(running, clock, guard):
    guard.beat = lambda: 1 / 0
    clock.sleep(0.1)
    assert [type(error) for error in clock.failures] == [ZeroDivisionError]
    with pytest.raises(Tripped, match="thread has ended"):
        running.check()


def test_what_may_not_be_energised_is_not(supervise, guard):
    """It is called again once the instruments are ours: a trip may have come while we waited."""
    answers = iter([None, Tripped("vented meanwhile")])

    def check():
        if (answer := next(answers)) is not None:
            raise answer

    with pytest.raises(Tripped, match="meanwhile"), supervise().energising(check):
        pytest.fail("it was energised")
    assert guard.orders == []


def test_safe_is_reported_to_the_guard_and_what_was_energised_before_it(supervisor, guard):
    assert guard.orders == ["energised"]
    assert supervisor.safe_report is None
    assert supervisor.make_safe().safe
    assert guard.orders == ["energised", "safe"]
    assert supervisor.safe_report.safe


def test_after_safe_the_exhaust_must_stay_open_and_every_valve_off(supervisor, regulator, valves):
    assert supervisor.make_safe().safe
    assert supervisor.poll(with_valves=True) is None

    valves.on = frozenset({2})
    assert "valves read back 2 on, none were switched on" in supervisor.poll(with_valves=True)
    valves.on = frozenset()
    regulator.exhausting = False
    assert "exhaust reads back closed" in supervisor.poll(with_valves=True)


def test_readings_on_the_way_to_safe_are_observed_too(supervisor, clock):
    seen = []
    with supervisor.observing(seen.append):
        supervisor.poll(with_valves=False)
        polled = len(seen)
        supervisor.make_safe()
    observed = len(seen)
    supervisor.poll(with_valves=False)

    assert polled == 1
    assert [sample.reading.exhausting for sample in seen[1:]] == [True] * (observed - 1)
    assert len(seen) == observed > 5


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
    assert "commanded to follow its setpoint" in supervisor.poll(with_valves=False)


def test_an_exhaust_that_closes_by_itself_after_safe_is_noticed(supervisor, regulator):
    regulator.setpoint_psi = regulator.pressure_psi = 0.0
    supervisor.expect(setpoint_psi=0.0, channels_on=frozenset(), mode="vented")
    assert "exhaust reads back closed" in supervisor.poll(with_valves=False)


def test_a_pressure_that_does_not_follow_its_setpoint_trips_after_a_while(supervisor, regulator, clock):
    regulator.pressure_psi = 2.0
    for _ in range(100):
        supervisor.beat()
        # It moves, but not enough.
        regulator.pressure_psi += 0.015
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
    assert not supervisor.safe_report.safe

    regulator.exhaust_works = True
    supervisor.watch(with_valves=True)
    assert not supervisor.safe_report.safe, "not before its time"
    clock.sleep(2.0)
    supervisor.watch(with_valves=True)

    assert supervisor.safe_report.safe
    assert regulator.exhausting


def test_a_valve_that_comes_on_after_the_vent_is_switched_off_again(supervisor, regulator, valves, clock):
    regulator.pressure_psi = 4.4
    supervisor.watch(with_valves=True)
    assert supervisor.safe_report.safe

    valves.on = frozenset({7})
    clock.sleep(2.0)
    supervisor.watch(with_valves=True)

    assert valves.on == frozenset()


def test_the_vent_comes_before_any_message(supervise, regulator, calls):
    watching = supervise(notify=lambda text: calls.append("notify"))
    regulator.pressure_psi = 4.4
    watching.watch(with_valves=False)

    assert calls.index("exhaust") < calls.index("notify")
    assert calls.index("valves []") < calls.index("notify")


def test_what_came_nearer_before_safe_says_nothing_of_the_next_inflation(supervisor, regulator, clock):
    """No look need fall between SAFE and the next setpoint: what was asked before is forgotten with it."""
    regulator.pressure_psi = 2.0
    assert supervisor.poll(with_valves=False) is None
    supervisor.make_safe()
    clock.sleep(10.0)

    regulator.setpoint_psi, regulator.exhausting = 3.9, False
    with supervisor.energising(lambda: None):
        expect_held(supervisor)
    for pressure_psi in (0.2, 0.4, 0.6, 0.8, 1.0, 1.2):
        regulator.pressure_psi = pressure_psi
        assert supervisor.poll(with_valves=False) is None
        clock.sleep(0.05)
