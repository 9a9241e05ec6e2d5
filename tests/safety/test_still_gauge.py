"""A reading that stands still while its setpoint asks it to move, and all that may look like it."""

import numpy as np
import pytest

from labctl.config.rig import Limits
from labctl.instruments.readings import PressureReading
from labctl.safety.still_gauge import StillGauge
from labctl.safety.trip_rules import Expected

LIMITS = Limits()
POLL_S = 0.05


def first_reason(gauge_psi, setpoint_psi, seconds, mode="control", can_exhaust=True, poll_s=POLL_S):
    """When it trips and why, for a reading and a setpoint that are functions of time; None where it does not."""
    watch = StillGauge(LIMITS, can_exhaust=can_exhaust)
    for time_s in np.arange(0, seconds, poll_s):
        setpoint = setpoint_psi(time_s)
        reading = PressureReading(gauge_psi(time_s), setpoint)
        reason = watch.judge(reading, Expected(setpoint, mode=mode), time_s)
        if reason is not None:
            return float(time_s), reason
    return None


def lagging(rate_psi_per_s, lag_s, to_psi=3.9):
    """A ramp, and a first-order regulator behind it."""

    def setpoint(time_s):
        return min(rate_psi_per_s * time_s, to_psi)

    def gauge(time_s):
        end_s = to_psi / rate_psi_per_s
        behind = rate_psi_per_s * lag_s * (1 - np.exp(-min(time_s, end_s) / lag_s))
        return setpoint(time_s) - behind * np.exp(-max(0.0, time_s - end_s) / lag_s)

    return gauge, setpoint


@pytest.mark.parametrize("frozen_psi", [0.2, 1.0, 2.0, 3.5, 3.8])
def test_a_gauge_that_freezes_in_a_ramp_trips_within_a_second(frozen_psi):
    gauge, setpoint = lagging(1.0, 0.13)
    when_s = next(time_s for time_s in np.arange(0, 5, 0.01) if gauge(time_s) >= frozen_psi)
    tripped_s, reason = first_reason(lambda t: min(round(gauge(t), 2), frozen_psi), setpoint, 6)
    assert tripped_s - when_s < 0.9
    assert f"stands still at {frozen_psi:.2f} psi" in reason
    for cause in ("frozen gauge", "closed or low supply", "blocked line", "leak"):
        assert cause in reason


@pytest.mark.parametrize("digit_psi", [0.01, 0.1])
def test_a_frozen_gauge_that_jitters_by_a_digit_trips(digit_psi):
    rng = np.random.default_rng(3)
    gauge = [2.0 + digit_psi * int(rng.integers(-1, 2)) for _ in range(200)]
    tripped_s, _ = first_reason(lambda t: gauge[round(t / POLL_S)], lambda t: 3.0, 5)
    assert tripped_s < 2.0


@pytest.mark.parametrize("digit_psi", [0.001, 0.01, 0.1])
@pytest.mark.parametrize("rate_psi_per_s", [0.01, 0.05, 0.2, 1.0, 3.0])
@pytest.mark.parametrize("lag_s", [0.05, 0.13, 0.5])
def test_a_healthy_ramp_does_not_trip(digit_psi, rate_psi_per_s, lag_s):
    gauge, setpoint = lagging(rate_psi_per_s, lag_s, to_psi=min(3.9, 40 * rate_psi_per_s))

    def shown(value):
        return digit_psi * round(value / digit_psi)

    rng = np.random.default_rng(1)
    seconds = 50 if rate_psi_per_s < 0.2 else 25
    assert (
        first_reason(lambda t: shown(gauge(t) + rng.normal(0, 0.005)), lambda t: shown(setpoint(t)), seconds)
        is None
    )


def test_a_bleed_down_and_a_zero_that_is_a_little_high_are_not_judged():
    assert first_reason(lambda t: 3.0 * np.exp(-t / 20), lambda t: 0.5, 30, can_exhaust=False) is None
    assert first_reason(lambda t: 0.09, lambda t: 0.0, 10) is None
    assert first_reason(lambda t: 2.0, lambda t: 0.0, 10, mode="vented") is None


def test_an_overshoot_that_takes_its_time_is_none():
    def overshooting(time_s):
        return 3.9 + 0.08 * np.sin(np.pi * min(time_s, 4.0) / 4.0)

    assert first_reason(overshooting, lambda t: 3.9, 10) is None


def test_a_reading_that_stays_above_its_setpoint_trips_where_the_regulator_can_let_it_down():
    _, reason = first_reason(lambda t: 2.0, lambda t: 1.0, 5)
    assert "blocked exhaust" in reason
    _, reason = first_reason(lambda t: 2.0 + t, lambda t: 1.0, 5)
    assert "moves away from its setpoint" in reason


def test_rig_time_that_runs_fast_is_no_standstill():
    """At 20 times the wall's time a look comes once a second of the rig's."""
    gauge, setpoint = lagging(1.0, 0.13)
    assert first_reason(gauge, setpoint, 20, poll_s=1.0) is None
