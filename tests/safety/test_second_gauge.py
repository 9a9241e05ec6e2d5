"""Two gauges of one pressure: what they may differ by, and what is said where they differ by more."""

import pytest

from labctl.config.rig import Limits
from labctl.errors import NoAnswer
from labctl.instruments.readings import PressureReading, PressureSample
from labctl.safety.second_gauge import SecondGauge, disagreement_psi
from labctl.safety.trip_rules import Expected

CONTROL = Expected(setpoint_psi=3.9, mode="control")


class Gauge:
    name = "gauge B"

    def __init__(self, reads):
        self.reads = reads
        self.closed = False
        self.silent = False
        self.flags = frozenset()

    def read(self, timeout_s=None):
        if self.silent:
            raise NoAnswer("gauge B: no answer")
        return PressureReading(self.reads(), 0.0, self.flags)

    def close(self):
        self.closed = True


@pytest.fixture
def watch(clock):
    """Judge a first gauge, each 50 ms for `seconds`, beside a second one; the first reason to trip."""
    made = []

    def run(gauge, first, seconds=2.0, expected=CONTROL):
        second = SecondGauge(gauge, "regulator A", Limits(), clock, clock)
        made.append(second)
        second.start()
        end_s = clock.now_s() + seconds
        while clock.now_s() < end_s:
            asked_s = clock.now_s()
            clock.sleep(0.02)
            reason = second.judge(
                PressureSample(PressureReading(first(), 3.9), asked_s, clock.now_s()), expected
            )
            if reason is not None:
                return reason
            clock.sleep(0.03)
        return None

    yield run
    for second in made:
        second.close()


@pytest.mark.parametrize(
    ("second_psi", "differs_psi"), [(1.0, 0.0), (1.25, 0.0), (1.5, 0.0), (1.8, 0.3), (0.6, 0.4)]
)
def test_a_reading_between_two_of_the_other_gauge_agrees(second_psi, differs_psi):
    assert disagreement_psi(second_psi, 1.0, 1.5) == pytest.approx(differs_psi)
    assert disagreement_psi(second_psi, 1.5, 1.0) == pytest.approx(differs_psi)


def test_gauges_that_agree_say_nothing(watch):
    assert watch(Gauge(lambda: 3.75), lambda: 3.9) is None


def test_the_fastest_rise_is_no_disagreement(watch, clock):
    start_s = clock.now_s()

    def rising():
        return 3.0 * (clock.now_s() - start_s)

    assert watch(Gauge(rising), rising, seconds=1.3) is None


@pytest.mark.parametrize("second_psi", [4.2, 3.6])
def test_gauges_that_differ_are_both_named_with_their_values(watch, second_psi):
    reason = watch(Gauge(lambda: second_psi), lambda: 3.9)

    assert f"regulator A reads 3.90 psi and gauge B {second_psi:.2f} psi" in reason
    assert "limits.gauge_agreement" in reason
    assert all(cause in reason for cause in ("zero", "gain", "unit", "frozen"))


def test_one_reading_alone_is_no_disagreement(watch):
    readings = iter([3.9] * 10 + [2.0] + [3.9] * 1000)

    assert watch(Gauge(lambda: next(readings)), lambda: 3.9) is None


def test_the_second_gauge_has_the_trip_limit_too(watch):
    reason = watch(Gauge(lambda: 4.31), lambda: 4.2)

    assert reason.startswith("over-pressure: gauge B reads 4.31 psi")


def test_a_second_gauge_that_falls_silent_under_pressure_is_no_witness(watch):
    gauge = Gauge(lambda: 3.9)
    gauge.silent = True

    reason = watch(gauge, lambda: 3.9)

    assert "gauge B has not been read for 0.5" in reason
    assert "no answer" in reason


def test_nor_is_one_that_does_not_trust_itself(watch):
    gauge = Gauge(lambda: 3.9)
    gauge.flags = frozenset({"ADC"})

    assert "it reports ADC" in watch(gauge, lambda: 3.9)


def test_a_vented_sheet_may_do_without_it(watch):
    gauge = Gauge(lambda: 0.0)
    gauge.silent = True

    assert watch(gauge, lambda: 0.0, expected=Expected(mode="vented")) is None


def test_a_defect_in_reading_it_is_told_as_the_last_error_and_ends_no_thread(watch):
    failing = [True] * 3

    def reads():
        if failing:
            failing.pop()
            raise RuntimeError("cannot schedule new futures after shutdown")
        return 3.9

    assert watch(Gauge(reads), lambda: 3.9) is None

    def broken():
        raise RuntimeError("cannot schedule new futures after shutdown")

    reason = watch(Gauge(broken), lambda: 3.9)

    assert "gauge B has not been read for 0.5" in reason
    assert "RuntimeError: cannot schedule new futures after shutdown" in reason
