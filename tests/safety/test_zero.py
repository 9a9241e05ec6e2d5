"""What is known to be zero: looked at from both sides, by readings at rest, in words that name every cause."""

import pytest

from labctl.config.rig import Limits
from labctl.instruments.readings import PressureReading
from labctl.safety.zero import RestingGauge, wait_for_zero, zero_problem

LIMITS = Limits()


@pytest.mark.parametrize("gauge_psi", [0.0, 0.1, -0.1, 0.04])
def test_a_gauge_within_the_hold_tolerance_reads_zero(gauge_psi):
    assert zero_problem(gauge_psi, LIMITS) is None


@pytest.mark.parametrize(
    ("gauge_psi", "words"),
    [
        (
            0.4,
            ("reads 0.40 psi, not 0 +- 0.1 psi", "zero is off", "trapped", "blocked exhaust", "labctl tare"),
        ),
        (
            -0.4,
            ("reads -0.40 psi, not 0 +- 0.1 psi", "zero is off", "0.40 psi more", "vacuum", "labctl tare"),
        ),
        (0.11, ("reads 0.11 psi", "labctl tare")),
        (0.8, ("reads 0.80 psi", "trapped", "its own panel", "0.5 psi at most (limits.tare_within)")),
        (-1.0, ("cannot be true (below -0.5 psi)", "regulator.pressure_unit", "its own panel")),
    ],
)
def test_one_that_does_not_is_told_with_reading_limit_and_every_cause(gauge_psi, words):
    problem = zero_problem(gauge_psi, LIMITS)

    assert [each for each in words if each not in problem] == []


def test_the_second_gauge_is_never_told_to_be_tared_by_labctl():
    problem = zero_problem(-0.4, LIMITS, section="gauge")

    assert "labctl tare" not in problem
    assert "gauge.pressure_unit" in problem


@pytest.mark.parametrize(("tolerance_psi", "within_psi"), [(0.05, 0.05), (0.1, 0.1), (0.5, 0.1)])
def test_a_wide_hold_band_lets_no_zero_be_further_off(tolerance_psi, within_psi):
    assert Limits(hold_tolerance_psi=tolerance_psi).zero_within_psi == within_psi


def test_limits_come_down_with_a_gauge_that_reads_too_little_and_never_go_up():
    lowered = LIMITS.for_zero(-0.08)

    assert lowered.max_pressure_psi == pytest.approx(3.92)
    assert lowered.warn_pressure_psi == pytest.approx(4.02)
    assert lowered.trip_pressure_psi == pytest.approx(4.22)
    assert LIMITS.for_zero(0.08) == LIMITS
    assert LIMITS.for_zero(-0.01) == LIMITS


def test_a_pressure_that_falls_slowly_is_not_at_rest():
    gauge = RestingGauge()
    for number in range(40):
        gauge.take(0.5 - 0.004 * number, 0.05 * number)
        assert not gauge.at_rest

    for number in range(40, 60):
        gauge.take(0.34 + 0.01 * (number % 2), 0.05 * number)

    assert gauge.at_rest
    assert gauge.mean_psi == pytest.approx(0.345, abs=0.002)


def test_five_readings_at_least_make_a_mean():
    gauge = RestingGauge()
    for number in range(4):
        gauge.take(0.0, 1.0 * number)
    assert not gauge.at_rest

    gauge.take(0.0, 4.0)

    assert gauge.at_rest


def test_waits_until_the_sheet_is_empty_and_returns_the_mean(clock):
    start_s = clock.now_s()

    def read():
        return PressureReading(max(-0.05, 2.0 - 2.0 * (clock.now_s() - start_s)), 0.0)

    reading = wait_for_zero(read, LIMITS, clock)

    assert reading.gauge_psi == pytest.approx(-0.05, abs=0.01)
    assert 1.4 < clock.now_s() - start_s < 2.5


def test_a_single_reading_does_not_decide(clock):
    noise = iter([0.0, 0.14, -0.13, 0.12] * 1000)
    reading = wait_for_zero(lambda: PressureReading(0.2 + next(noise) / 10, 0.0), LIMITS, clock)

    assert reading.gauge_psi == pytest.approx(0.2, abs=0.01)
