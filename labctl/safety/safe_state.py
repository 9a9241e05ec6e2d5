"""SAFE: setpoint 0, exhaust or dump open, every valve off, the gauge at zero: all of it read back.

`make_safe` is the one way to SAFE; the protocols' teardown, the supervisor, the guard and `labctl vent` all
call it. It never raises for an instrument's sake: what could not be done or read is in the report.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, TypeVar

from labctl.clock import Clock, Scheduler
from labctl.config.rig import Limits
from labctl.instruments.interfaces import PressureRegulator, ValveBank
from labctl.instruments.readings import PressureReading, PressureSample, in_band
from labctl.next_command import next_command
from labctl.safety.zero import wait_for_zero, zero_problem

# Two decimals is what an Alicat frame carries; half of the last one is rounding, not a setpoint.
SETPOINT_ZERO_PSI = 0.015

T = TypeVar("T")

_TRIES = 3
_TICK_S = 0.1


@dataclass(frozen=True)
class SafeReport:
    """What was read back after the commands to SAFE; None is what could not be read.

    `vented_by` is "exhaust" or "dump" as read back, `pressure_psi` the mean of half a second. `problems` holds every
    reason why the rig is not SAFE; it is empty exactly when `safe` is true. `only_zero_is_off`: all that can be
    commanded was read back, and the gauge alone, by less than a tare takes away, does not read 0.
    """

    pressure_psi: float | None
    setpoint_psi: float | None
    vented_by: str | None
    channels_on: frozenset[int] | None
    problems: tuple[str, ...]
    only_zero_is_off: bool = False

    @property
    def safe(self) -> bool:
        """SAFE was read back, all of it."""
        return not self.problems

    def describe(self) -> str:
        """One line for people, beginning with SAFE or UNSAFE."""
        if self.only_zero_is_off:
            return (
                f"UNSAFE: setpoint 0, {self.vented_by} open and every valve off were read back, but "
                f"{'; '.join(self.problems)}"
            )
        if not self.safe:
            return (
                f"UNSAFE: {'; '.join(self.problems)}. Close the supply, vent by hand, then run "
                f"{next_command('vent')}"
            )
        return (
            f"SAFE, as read back: setpoint {self.setpoint_psi:.2f} psi, {self.vented_by} open, "
            f"pressure {self.pressure_psi:z.2f} psi, every valve off"
        )


def make_safe(
    regulator: PressureRegulator,
    valves: ValveBank,
    *,
    limits: Limits,
    dump_channel: int | None,
    clock: Clock,
    scheduler: Scheduler,
    tick: Callable[[], None] = lambda: None,
    on_reading: Callable[[PressureSample], None] = lambda _: None,
) -> SafeReport:
    """Command SAFE on open instruments and read it back; see `reach_and_make_safe`."""
    return reach_and_make_safe(
        lambda: regulator,
        lambda: valves,
        limits=limits,
        dump_channel=dump_channel,
        clock=clock,
        scheduler=scheduler,
        tick=tick,
        on_reading=on_reading,
    )


def reach_and_make_safe(
    reach_regulator: Callable[[], PressureRegulator | None],
    reach_valves: Callable[[], ValveBank | None],
    *,
    limits: Limits,
    dump_channel: int | None,
    clock: Clock,
    scheduler: Scheduler,
    tick: Callable[[], None] = lambda: None,
    on_reading: Callable[[PressureSample], None] = lambda _: None,
    step_timeout_s: float | None = None,
) -> SafeReport:
    """Command SAFE and read it back, within `limits.vent_timeout_s` plus the instruments' own deadlines.

    Regulator and valves are reached and commanded at once, so that neither waits for the other's silence; the
    regulator's setpoint goes to 0 before its exhaust opens, which a setpoint that is still up could undo. Every
    step is tried whether or not the one before it worked. An instrument that cannot be reached (None) makes the
    rig UNSAFE. `clock` is the rig's, `scheduler` the wall's. `tick` is called throughout, so that a caller can show
    that it is alive; `on_reading` gets each pressure that is read on the way, on another thread, and must neither
    wait nor raise; `step_timeout_s` bounds each exchange, by the driver's own when None.
    """
    regulator_side = _Side(step_timeout_s)
    valve_side = _Side(step_timeout_s)

    def vent() -> PressureReading | None:
        regulator = reach_regulator()
        if regulator is None:
            return None
        regulator_side.attempt("setpoint 0", lambda timeout_s: regulator.write_setpoint(0.0, timeout_s))
        if regulator.can_exhaust:
            regulator_side.attempt("exhaust", regulator.exhaust)
        return wait_for_zero(
            lambda: regulator_side.attempt(
                "reading the pressure", partial(_read, regulator, clock, on_reading)
            ),
            limits,
            clock,
        )

    def switch_off() -> frozenset[int] | None:
        valves = reach_valves()
        if valves is None:
            return None
        valve_side.attempt("valves off", lambda timeout_s: valves.write((), timeout_s))
        return valve_side.attempt("reading the valves", valves.read)

    venting = _Aside(vent, scheduler, "to SAFE: regulator")
    switching = _Aside(switch_off, scheduler, "to SAFE: valves")
    report = judge(venting.result(tick), switching.result(tick), limits, dump_channel)
    # Failed commands are reasons why a rig is not SAFE; alone they do not count against a state that reads SAFE.
    failures = (*regulator_side.failures, *valve_side.failures)
    return report if report.safe else replace(report, problems=(*report.problems, *failures))


def _read(
    regulator: PressureRegulator,
    clock: Clock,
    on_reading: Callable[[PressureSample], None],
    timeout_s: float | None,
) -> PressureReading:
    asked_s = clock.now_s()
    reading = regulator.read(timeout_s)
    on_reading(PressureSample(reading, asked_s, clock.now_s()))
    return reading


class _Aside(Generic[T]):
    """Something that is done on a thread of its own."""

    def __init__(self, do: Callable[[], T], scheduler: Scheduler, name: str) -> None:
        self._do = do
        self._done: T | None = None
        self._error: BaseException | None = None
        self._thread = scheduler.start_thread(self._run, name)

    def _run(self) -> None:
        try:
            self._done = self._do()
        # Raised again for whoever waits for it.
        except BaseException as error:
            self._error = error

    def result(self, tick: Callable[[], None]) -> T | None:
        """Wait for it, ticking all the while."""
        tick()
        while not self._thread.join(_TICK_S):
            tick()
        if self._error is not None:
            raise self._error
        return self._done


class _Side:
    """One instrument's steps and what became of them."""

    def __init__(self, timeout_s: float | None) -> None:
        self._timeout_s = timeout_s
        self.failures: list[str] = []

    def attempt(self, step: str, action: Callable[[float | None], T]) -> T | None:
        error: Exception | None = None
        for _ in range(_TRIES):
            try:
                return action(self._timeout_s)
            # A defect in one driver must not keep the next step from being taken.
            except Exception as caught:
                error = caught
        self.failures.append(f"{step} failed: {error}")
        return None


def judge(
    reading: PressureReading | None,
    channels_on: frozenset[int] | None,
    limits: Limits,
    dump_channel: int | None,
) -> SafeReport:
    """Whether what was read back is SAFE; None is what could not be read."""
    problems: list[str] = []
    vented_by = None
    if reading is None:
        problems.append("the pressure regulator could not be read back")
    else:
        if abs(reading.setpoint_psi) > SETPOINT_ZERO_PSI:
            problems.append(f"the setpoint reads {reading.setpoint_psi:.2f} psi, not 0")
        if reading.faults:
            problems.append(
                f"the regulator reports {' '.join(sorted(reading.faults))}: its reading is not to be trusted"
            )
        if reading.exhausting:
            vented_by = "exhaust"
        elif dump_channel is not None and channels_on is not None and dump_channel not in channels_on:
            vented_by = "dump"
        else:
            problems.append("neither the exhaust nor a dump valve reads open")
    if channels_on is None:
        problems.append("the valves could not be read back")
    elif channels_on:
        problems.append(f"valve channels still on: {', '.join(map(str, sorted(channels_on)))}")
    off_zero = None if reading is None else _off_zero(reading, limits, vented=vented_by is not None)
    may_be_tared = reading is not None and abs(reading.gauge_psi) <= limits.tare_within_psi
    only_zero_is_off = off_zero is not None and not problems and may_be_tared
    return SafeReport(
        pressure_psi=reading.gauge_psi if reading else None,
        setpoint_psi=reading.setpoint_psi if reading else None,
        vented_by=vented_by,
        channels_on=channels_on,
        problems=tuple(problems) if off_zero is None else (off_zero, *problems),
        only_zero_is_off=only_zero_is_off,
    )


def _off_zero(reading: PressureReading, limits: Limits, *, vented: bool) -> str | None:
    """Why a pressure is not that of a vented sheet."""
    if in_band(reading.gauge_psi, 0.0, limits.zero_within_psi):
        return None
    if vented and abs(reading.setpoint_psi) <= SETPOINT_ZERO_PSI:
        return zero_problem(reading.gauge_psi, limits)
    untrue = ""
    if reading.gauge_psi < limits.min_pressure_psi:
        untrue = f", which cannot be true (below {limits.min_pressure_psi:g} psi)"
    return f"the pressure reads {reading.gauge_psi:.2f} psi{untrue}, not 0 +- {limits.zero_within_psi:g} psi"
