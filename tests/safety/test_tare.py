"""A tare: only where the pressure is known to be 0, looked at before and after."""

import pytest

from labctl.config.rig import Limits
from labctl.errors import InstrumentError, NoAnswer, ReadBackMismatch, Stopped
from labctl.instruments.readings import PressureReading
from labctl.safety.tare import tare_at_rest

LIMITS = Limits()


@pytest.fixture
def at_rest(regulator, valves):
    """A rig that is vented, with a gauge that reads 0.4 psi too much."""
    regulator.pressure_psi = regulator.setpoint_psi = 0.0
    regulator.offset_psi = 0.4
    valves.on = frozenset()
    return regulator


def tare(regulator, valves, clock, *, dump_channel=None, check=lambda: None, second=None):
    return tare_at_rest(
        regulator,
        valves,
        limits=LIMITS,
        dump_channel=dump_channel,
        clock=clock,
        check=check,
        second=second,
    )


def test_the_exhaust_is_opened_before_and_zero_read_after(at_rest, valves, clock, calls):
    tared = tare(at_rest, valves, clock)

    assert (tared.before_psi, tared.after_psi) == (pytest.approx(0.4), pytest.approx(0.0))
    assert calls.index("exhaust") < calls.index("tare") < len(calls) - 5
    assert not [call for call in calls if call.startswith(("setpoint", "valves"))]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"setpoint_psi": 2.0}, "setpoint reads 2.00 psi"),
        ({"offset_psi": 0.8}, "0.5 psi at most"),
        ({"offset_psi": -0.7}, "cannot be true"),
        ({"exhaust_works": False}, "neither the exhaust nor a dump valve"),
        ({"flags": frozenset({"ADC"})}, "reports ADC"),
    ],
)
def test_where_it_is_not_known_that_the_pressure_is_0_nothing_is_tared(
    at_rest, valves, clock, calls, change, words
):
    for name, value in change.items():
        setattr(at_rest, name, value)

    with pytest.raises(InstrumentError, match="not tared") as caught:
        tare(at_rest, valves, clock)

    assert words in str(caught.value)
    assert "tare" not in calls


def test_nothing_is_tared_while_a_valve_is_on(at_rest, valves, clock, calls):
    valves.on = frozenset({3})

    with pytest.raises(InstrumentError, match="still on: 3"):
        tare(at_rest, valves, clock)

    assert "tare" not in calls


def test_a_sheet_that_is_still_emptying_is_waited_for_and_then_refused(at_rest, valves, clock, calls):
    at_rest.read = lambda timeout_s=None: PressureReading(
        0.45 - 0.03 * (clock.now_s() - 100), 0.0, frozenset({"EXH"})
    )

    with pytest.raises(InstrumentError, match="still moving after 10 s"):
        tare(at_rest, valves, clock)

    assert "tare" not in calls


def test_a_tare_that_does_not_take_is_an_error(at_rest, valves, clock):
    at_rest.tare = lambda timeout_s=None: at_rest.read()

    tared = tare(at_rest, valves, clock)

    assert isinstance(tared.error, ReadBackMismatch)
    assert "reads 0.40 psi after it" in str(tared.error)
    assert (tared.before_psi, tared.after_psi) == (pytest.approx(0.4), pytest.approx(0.4))


def test_a_tare_whose_answer_is_lost_was_commanded_and_what_it_did_is_read(at_rest, valves, clock):
    take = at_rest.tare

    def lost(timeout_s=None):
        take()
        raise NoAnswer("regulator A: no answer")

    at_rest.tare = lost

    tared = tare(at_rest, valves, clock)

    assert (tared.before_psi, tared.after_psi) == (pytest.approx(0.4), pytest.approx(0.0))
    assert isinstance(tared.error, NoAnswer)


def test_a_gauge_that_falls_silent_after_the_command_has_no_reading_after_it(at_rest, valves, clock):
    take = at_rest.tare

    def die(timeout_s=None):
        take()
        at_rest.dead = True

    at_rest.tare = die

    tared = tare(at_rest, valves, clock)

    assert tared.before_psi == pytest.approx(0.4)
    assert tared.after_psi is None
    assert isinstance(tared.error, NoAnswer)


def test_a_regulator_that_does_not_control_again_after_a_tare_was_tared(at_rest, valves, clock):
    at_rest.can_exhaust = False
    at_rest.hold_closed = lambda timeout_s=None: at_rest.read()

    def stuck(timeout_s=None):
        raise NoAnswer("regulator A: no answer to C")

    at_rest.cancel_hold = stuck

    tared = tare(at_rest, valves, clock, dump_channel=32)

    assert tared.after_psi == pytest.approx(0.0)
    assert "no answer to C" in str(tared.error)


def test_a_stop_after_the_command_is_no_tare_that_was_not_done(at_rest, valves, clock, calls):
    def check():
        if "tare" in calls:
            raise Stopped("Ctrl-C")

    tared = tare(at_rest, valves, clock, check=check)

    assert tared.after_psi is None
    assert isinstance(tared.error, Stopped)


def test_a_setpoint_that_safe_calls_0_may_be_tared(at_rest, valves, clock):
    at_rest.setpoint_psi = 0.01

    assert tare(at_rest, valves, clock).error is None


def test_a_second_gauge_that_reads_pressure_too_forbids_it(at_rest, valves, clock, calls):
    class Second:
        name = "gauge B"

        def read(self, timeout_s=None):
            return PressureReading(0.38, 0.0)

    with pytest.raises(InstrumentError, match=r"gauge B reads 0\.38 psi too"):
        tare(at_rest, valves, clock, second=Second())

    assert "tare" not in calls
