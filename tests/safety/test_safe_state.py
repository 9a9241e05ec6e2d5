import pytest

from labctl.config.rig import Limits
from labctl.errors import NoAnswer
from labctl.instruments.readings import PressureReading
from labctl.safety.safe_state import judge, make_safe, reach_and_make_safe

LIMITS = Limits()


def vent(regulator, valves, clock, dump_channel=None, **more):
    return make_safe(
        regulator, valves, limits=LIMITS, dump_channel=dump_channel, clock=clock, scheduler=clock, **more
    )


def test_setpoint_goes_before_the_exhaust_and_everything_is_read_back(regulator, valves, clock, calls):
    report = vent(regulator, valves, clock)

    assert report.safe
    assert report.vented_by == "exhaust"
    assert report.channels_on == frozenset()
    commands = [call for call in calls if not call.startswith("read")]
    assert sorted(commands) == ["exhaust", "setpoint 0", "valves []"]
    assert calls.index("setpoint 0") < calls.index("exhaust") < _last(calls, "read pressure")
    assert calls.index("valves []") < _last(calls, "read valves")


def _last(calls, call):
    return len(calls) - 1 - calls[::-1].index(call)


def test_a_silent_regulator_does_not_make_the_valves_wait(regulator, valves, clock):
    valves_off = clock.event()
    switch = valves.write

    def write(on, timeout_s=None):
        valves_off.set()
        return switch(on)

    def silent(*_, **__):
        # The regulator's deadline runs out only after the valves were switched, or this would never end.
        assert valves_off.wait(5)
        raise NoAnswer("regulator A: no answer")

    valves.write, regulator.write_setpoint = write, silent

    report = vent(regulator, valves, clock)

    assert report.channels_on == frozenset()


def test_waits_until_the_pressure_is_gone(regulator, valves, clock):
    regulator.fall_psi = 0.1
    start_s = clock.now_s()

    report = vent(regulator, valves, clock)

    assert report.safe
    assert report.pressure_psi <= LIMITS.safe_pressure_psi
    assert clock.now_s() > start_s


def test_pressure_that_stays_is_unsafe_after_the_vent_timeout(regulator, valves, clock):
    regulator.fall_psi = 0.0
    start_s = clock.now_s()

    report = vent(regulator, valves, clock)

    assert not report.safe
    assert "pressure reads 3.90 psi" in report.describe()
    assert report.describe().startswith("UNSAFE")
    assert LIMITS.vent_timeout_s <= clock.now_s() - start_s < LIMITS.vent_timeout_s + 0.2


def test_a_dead_regulator_does_not_keep_the_valves_on(regulator, valves, clock):
    regulator.dead = True

    report = vent(regulator, valves, clock)

    assert valves.on == frozenset()
    assert not report.safe
    assert "regulator could not be read back" in report.describe()
    assert "setpoint 0 failed: regulator A: no answer" in report.describe()
    assert "exhaust failed: regulator A: no answer" in report.describe()


def test_a_dead_valve_bank_does_not_keep_the_pressure_up(regulator, valves, clock):
    valves.dead = True

    report = vent(regulator, valves, clock)

    assert regulator.exhausting
    assert not report.safe
    assert "valves could not be read back" in report.describe()


def test_instruments_that_could_not_be_opened_are_unsafe(clock):
    report = reach_and_make_safe(
        lambda: None, lambda: None, limits=LIMITS, dump_channel=None, clock=clock, scheduler=clock
    )

    assert not report.safe


def test_a_valve_that_stays_on_is_named(regulator, valves, clock):
    valves.stuck = frozenset({2})

    report = vent(regulator, valves, clock)

    assert not report.safe
    assert "channels still on: 2" in report.describe()


def test_zero_setpoint_without_an_open_way_out_is_not_safe(regulator, valves, clock):
    regulator.exhaust_works = False
    regulator.pressure_psi = 0.0

    report = vent(regulator, valves, clock)

    assert not report.safe
    assert "neither the exhaust nor a dump valve" in report.describe()


def test_a_dump_valve_that_reads_off_vents_a_regulator_that_cannot(regulator, valves, clock, calls):
    regulator.can_exhaust = False
    regulator.pressure_psi = 0.0

    report = vent(regulator, valves, clock, dump_channel=8)

    assert report.safe
    assert report.vented_by == "dump"
    assert "exhaust" not in calls


def test_one_garbled_exchange_does_not_make_a_rig_unsafe(regulator, valves, clock):
    real, failures = regulator.write_setpoint, iter([True])

    def once_garbled(setpoint_psi, timeout_s=None):
        regulator.dead = next(failures, False)
        try:
            return real(setpoint_psi)
        finally:
            regulator.dead = False

    regulator.write_setpoint = once_garbled

    assert vent(regulator, valves, clock).safe


def test_a_defect_in_a_driver_does_not_stop_the_next_step(regulator, valves, clock):
    regulator.write_setpoint = lambda setpoint_psi, timeout_s=None: 1 / 0

    report = vent(regulator, valves, clock)

    assert regulator.exhausting
    assert valves.on == frozenset()
    assert "setpoint reads 3.90" in report.describe()


def test_a_setpoint_left_up_is_not_safe(regulator):
    regulator.exhausting = True
    report = judge(regulator.read(), frozenset(), LIMITS, None)

    assert not report.safe
    assert "setpoint reads 3.90 psi" in report.describe()


@pytest.mark.parametrize(
    ("pressure_psi", "flags", "words"),
    [(-12.0, (), "cannot be true"), (0.0, ("ADC",), "reports ADC"), (0.0, ("POV", "OPL"), "reports OPL POV")],
)
def test_a_reading_that_cannot_be_trusted_is_not_safe(pressure_psi, flags, words):
    reading = PressureReading(pressure_psi, 0.0, frozenset({"EXH", *flags}))

    report = judge(reading, frozenset(), LIMITS, None)

    assert not report.safe
    assert words in report.describe()


def test_a_pressure_that_comes_back_is_waited_for(regulator, valves, clock):
    regulator.fall_psi = 0.0
    pressures = iter([2.0, 0.1, 1.5, 1.0, *[0.1] * 50])
    read = regulator.read

    def breathing(timeout_s=None):
        regulator.pressure_psi = next(pressures)
        return read()

    regulator.read = breathing

    report = vent(regulator, valves, clock)

    assert report.safe
    assert next(pressures) == 0.1
    assert regulator.pressure_psi == 0.1


def test_a_slow_instrument_does_not_stop_the_ticks(regulator, valves, clock):
    gate = clock.event()
    ticks = []

    def slow(timeout_s=None):
        assert gate.wait(5)
        return frozenset()

    def tick():
        ticks.append(1)
        if len(ticks) == 3:
            gate.set()

    valves.read = slow

    assert make_safe(
        regulator, valves, limits=LIMITS, dump_channel=None, clock=clock, scheduler=clock, tick=tick
    ).safe
