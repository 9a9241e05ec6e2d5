"""Instruments without a wire, for what safety does with what instruments report."""

from collections.abc import Callable, Collection

import pytest
from virtual_time import VirtualTime

from labctl.errors import NoAnswer
from labctl.instruments.readings import Identity, PressureReading


class FakeRegulator:
    """Follows its setpoint at once, and its exhaust at `fall_psi` a reading."""

    name = "regulator A"
    can_exhaust = True

    def __init__(self, calls: list[str]) -> None:
        self.calls = calls
        self.pressure_psi = 3.9
        self.setpoint_psi = 3.9
        self.exhausting = False
        self.fall_psi = 4.0
        self.dead = False
        self.exhaust_works = True
        self.flags: frozenset[str] = frozenset()
        self.offset_psi = 0.0

    def identify(self, timeout_s: float | None = None) -> Identity:
        return Identity("fake")

    def read(self, timeout_s: float | None = None) -> PressureReading:
        self._answer("read pressure")
        if self.exhausting:
            self.pressure_psi = max(0.0, self.pressure_psi - self.fall_psi)
        status = self.flags | ({"EXH"} if self.exhausting else set())
        return PressureReading(self.pressure_psi + self.offset_psi, self.setpoint_psi, status)

    def tare(self, timeout_s: float | None = None) -> PressureReading:
        self._answer("tare")
        self.offset_psi = -self.pressure_psi
        return self.read()

    def write_setpoint(self, setpoint_psi: float, timeout_s: float | None = None) -> PressureReading:
        self._answer(f"setpoint {setpoint_psi:g}")
        self.setpoint_psi = setpoint_psi
        return PressureReading(self.pressure_psi, setpoint_psi)

    def exhaust(self, timeout_s: float | None = None) -> PressureReading:
        self._answer("exhaust")
        self.exhausting = self.exhaust_works
        return self.read()

    def cancel_hold(self, timeout_s: float | None = None) -> PressureReading:
        self._answer("cancel hold")
        self.exhausting = False
        return self.read()

    def close(self) -> None:
        self.calls.append("close regulator")

    def _answer(self, call: str) -> None:
        self.calls.append(call)
        if self.dead:
            raise NoAnswer("regulator A: no answer")


class FakeValves:
    """Relays that follow commands, unless stuck."""

    name = "valve bank"
    channels = 8

    def __init__(self, calls: list[str]) -> None:
        self.calls = calls
        self.on = frozenset({1, 2})
        self.stuck: frozenset[int] = frozenset()
        self.dead = False

    def identify(self, timeout_s: float | None = None) -> Identity:
        return Identity("fake")

    def read(self, timeout_s: float | None = None) -> frozenset[int]:
        self.calls.append("read valves")
        if self.dead:
            raise NoAnswer("valve bank: no answer")
        return self.on

    def look(self, timeout_s: float | None = None) -> frozenset[int]:
        return self.read(timeout_s)

    def write(self, on: Collection[int], timeout_s: float | None = None) -> frozenset[int]:
        self.calls.append(f"valves {sorted(on)}")
        if self.dead:
            raise NoAnswer("valve bank: no answer")
        self.on = frozenset(on) | self.stuck
        return self.on

    def close(self) -> None:
        self.calls.append("close valves")


class FakeGuard:
    """A guard that can be made to have died."""

    def __init__(self) -> None:
        self.lives = True
        self.beats = 0
        self.orders: list[str] = []

    def alive(self) -> bool:
        return self.lives

    def beat(self) -> None:
        self.beats += 1

    def energised(self) -> None:
        self.orders.append("energised")

    def safe(self) -> None:
        self.orders.append("safe")


@pytest.fixture
def calls() -> list[str]:
    return []


@pytest.fixture
def clock() -> VirtualTime:
    return VirtualTime(start_s=100.0)


@pytest.fixture
def regulator(calls: list[str]) -> FakeRegulator:
    return FakeRegulator(calls)


@pytest.fixture
def valves(calls: list[str]) -> FakeValves:
    return FakeValves(calls)


@pytest.fixture
def guard() -> FakeGuard:
    return FakeGuard()


@pytest.fixture
def notes() -> list[str]:
    return []


@pytest.fixture
def notify(notes: list[str]) -> Callable[[str], None]:
    return notes.append
