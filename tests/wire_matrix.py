"""Every driver, every fault of a wire, every verb: what comes of it, against the plant's truth.

In a cell one driver is asked some times on a wire with one fault, and the truth is another one each time: an old
answer is a wrong one. Virtual time; the drivers, links and doubles are those that labctl runs with.
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from bowl import DESIGN, Bowl
from virtual_time import VirtualTime

from labctl.config.load import rig_from_text
from labctl.doubles.chamber import Mode
from labctl.doubles.faults import parse_faults
from labctl.doubles.in_process import InProcessDoubles
from labctl.doubles.markers import LabFrame, MarkerSettings
from labctl.doubles.settings import DoublesSettings
from labctl.drivers.alicat_ascii import AlicatAscii
from labctl.drivers.opening import open_markers, open_regulator, open_valves
from labctl.errors import InstrumentError

CALLS = 4
# A call that ends its wait by 20 ms of the marker wire's own look-out is in time.
MARGIN_S = 0.025
TIMEOUT_S = 0.5
# A board whose way of being read is not known yet may be asked in three ways, one after 2 s of silence.
IDENTIFY_S = 3.9

FAULTS = {
    "echo of every byte": "echo",
    "0x00 0xFF before replies": "stray-before",
    "0x00 0xFF between replies": "stray-between",
    "0x00 0xFF after replies": "stray-after",
    "NUL after CR": "nul",
    "CR LF": "crlf",
    "blank lines": "blank-lines",
    "halves, 30 ms apart": "split:0.03",
    "byte by byte": "trickle:0.002",
    "escape sequences": "escapes",
    "late, in time": "late:0.05",
    "late, beyond the time-out": "late:0.7",
    "late once, beyond the time-out": "late-once:0.7",
    "answer of the previous question": "previous",
    "silence": "silent",
    "reboot": "reboot",
    "garbage": "garbage",
    "half of each reply": "truncated",
    "another device's address": "wrong-address",
}
OF_MARKERS = {
    "halves, 30 ms apart",
    "late, in time",
    "late, beyond the time-out",
    "late once, beyond the time-out",
}
OF_MARKERS |= {"silence", "garbage", "half of each reply"}

REGULATOR_VERBS = ("identify", "read", "write_setpoint", "exhaust", "cancel_hold", "tare")
DRIVERS = {
    "alicat-ascii": ("regulator", {"regulator": "alicat-ascii"}, REGULATOR_VERBS),
    "alicat-modbus": ("regulator", {"regulator": "alicat-modbus"}, REGULATOR_VERBS),
    "waveshare-relay on RTU": (
        "valves",
        {"valve_transport": "rtu"},
        ("identify", "read", "write", "all off"),
    ),
    "waveshare-relay on TCP": (
        "valves",
        {"valve_transport": "tcp"},
        ("identify", "read", "write", "all off"),
    ),
    "phasespace": ("markers", {}, ("identify", "start", "next_frames", "stop")),
}


@dataclass(frozen=True)
class Cell:
    """One driver, fault and verb; `from_start`: the fault was there before the port was opened."""

    driver: str
    fault: str
    verb: str
    from_start: bool


def cells():
    return [
        Cell(driver, fault, verb, from_start)
        for driver, (instrument, _, verbs) in DRIVERS.items()
        for fault in FAULTS
        if instrument != "markers" or fault in OF_MARKERS
        for verb in verbs
        for from_start in (False, True)
    ]


class Wrong(AssertionError):
    """A value that is not the truth, or a call that ended late."""


class Bench:
    """One instrument of a rig of doubles, the driver at its wire, and the plant's truth."""

    def __init__(self, driver):
        self.instrument, settings, _ = DRIVERS[driver]
        self.time = VirtualTime()
        still = MarkerSettings(noise_sd_mm=0.0, occlusion_hz=0.0, dropout=0.0)
        self.doubles = InProcessDoubles(
            DoublesSettings(DESIGN, relay_channels=8, markers=still, **settings), self.time, Bowl()
        )
        self.plant = self.doubles.plant
        self.config = rig_from_text(self.doubles.rig_toml(), "rig.toml")
        self.device = None
        self.is_new = False
        self._seen = []
        self._state = self.plant.state
        self.plant.state = self._state_kept

    def open(self):
        wires, config = self.doubles.wires, self.config
        if self.instrument == "regulator":
            self.device = open_regulator(config.regulator, config.limits, self.time, wires)
        elif self.instrument == "valves":
            self.device = open_valves(config.valves, self.time, wires)
        else:
            self.device = open_markers(config.markers, self.time, self.time, wires)

    def close(self):
        if self.device is not None:
            self.device.close()
        self.doubles.close()

    def break_wire(self, fault):
        self.doubles.inject(parse_faults([f"{self.instrument}={FAULTS[fault]}"]))

    def call(self, verb, n):
        """Ask once, the `n`-th time: "right", or the error's name."""
        before = self._prepare(verb, n)
        self.time.sleep(0.15)
        start_s = self.time.now_s()
        # An ASCII regulator is bound to its tables, a relay board to its way of reading, at first use.
        binds = verb == "identify" or self.is_new or isinstance(self.device, AlicatAscii)
        timeout_s = IDENTIFY_S if binds else TIMEOUT_S
        try:
            getattr(self, "_" + verb.replace(" ", "_"))(IDENTIFY_S if verb == "identify" else None, n, before)
            outcome = "right"
        except InstrumentError as error:
            if type(error) is InstrumentError:
                raise Wrong(f"an error of no kind: {error}") from error
            if not str(error).isprintable():
                raise Wrong(f"an error that is not printable: {error!r}") from error
            outcome = type(error).__name__
        took_s = self.time.now_s() - start_s
        if took_s > timeout_s + MARGIN_S:
            raise Wrong(f"ended after {took_s:.3f} s, and not within {timeout_s} s")
        return outcome

    def _prepare(self, verb, n):
        """A truth of its own for each question."""
        if self.instrument == "valves":
            on = set(range(1 + n % 3, 9, 2 + n % 2))
            self.plant.write_coils({channel: channel in on for channel in range(1, 9)})
            return frozenset(on)
        if self.instrument == "markers":
            self.plant.write_setpoint(1.0 + n % 2)
            return None
        chamber = self.plant._chamber
        chamber.pressure_psi = 0.5 + 0.7 * (n % 5)
        chamber.setpoint_psi = 0.25 * (n % 7 + 1)
        chamber.mode = Mode.HOLD_CLOSED if verb in ("read", "cancel_hold", "tare") else Mode.CONTROL
        return None

    def _identify(self, timeout_s, n, before):
        identity = self.device.identify(timeout_s)
        texts = (identity.model, identity.serial_number or "", identity.firmware or "", *identity.notes)
        if not all(text.isprintable() for text in texts):
            raise Wrong(f"not printable: {texts}")
        for found, truth in (
            (identity.serial_number, "123456"),
            (identity.firmware, "2.00" if self.instrument == "valves" else "10v20.0-R24"),
            (identity.setpoint_source, "serial"),
        ):
            # A firmware with an escape sequence behind it is shown as it came.
            if found is not None and not found.startswith(truth):
                raise Wrong(f"{found!r} for {truth!r}")

    def _read(self, timeout_s, n, before):
        reading = self.device.read(timeout_s)
        if self.instrument == "valves":
            # A board that reboots meanwhile has nothing on.
            if reading != (on := self.plant.state().coils):
                raise Wrong(f"reads {sorted(reading)}, on are {sorted(on)}")
            return
        truth = self.plant.state()
        if (
            abs(reading.gauge_psi - truth.pressure_psi) > 0.05
            or abs(reading.setpoint_psi - truth.setpoint_psi) > 0.006
        ):
            raise Wrong(f"reads {reading}, the truth is {truth.pressure_psi:.2f} and {truth.setpoint_psi}")
        if reading.status != {"HLD"}:
            raise Wrong(f"reads {reading.status} of a regulator that holds")

    def _write_setpoint(self, timeout_s, n, before):
        wanted_psi = 3.9 - 0.5 * (n % 7)
        reading = self.device.write_setpoint(wanted_psi, timeout_s)
        found = self.plant.state().setpoint_psi
        if max(abs(reading.setpoint_psi - wanted_psi), abs(found - wanted_psi)) > 0.006:
            raise Wrong(f"{wanted_psi} confirmed by {reading}, the device has {found}")

    def _exhaust(self, timeout_s, n, before):
        reading = self.device.exhaust(timeout_s)
        if not reading.exhausting or not self.plant.state().exhausting:
            raise Wrong(f"{reading} of a regulator in {self.plant.state().mode}")

    def _cancel_hold(self, timeout_s, n, before):
        reading = self.device.cancel_hold(timeout_s)
        if reading.holding or reading.exhausting or self.plant.state().mode is not Mode.CONTROL:
            raise Wrong(f"{reading} of a regulator in {self.plant.state().mode}")

    def _tare(self, timeout_s, n, before):
        reading = self.device.tare(timeout_s)
        chamber = self.plant._chamber
        if max(abs(reading.gauge_psi), abs(chamber.pressure_psi - chamber.tare_psi)) > 0.05:
            raise Wrong(
                f"tared to {reading}, {chamber.pressure_psi} psi are called {chamber.tare_psi} psi less"
            )

    def _write(self, timeout_s, n, before):
        on = frozenset({1 + n % 4, 5 + n % 3})
        self._written(on, self.device.write(on, timeout_s))

    def _all_off(self, timeout_s, n, before):
        self._written(frozenset(), self.device.write((), timeout_s))

    def _written(self, wanted, found):
        if not wanted == found == self.plant.state().coils:
            raise Wrong(f"{sorted(wanted)} confirmed as {sorted(found)}, on are {self.plant.state().coils}")

    def _start(self, timeout_s, n, before):
        self.device.start(timeout_s)

    def _stop(self, timeout_s, n, before):
        self.device.stop(timeout_s)

    def _next_frames(self, timeout_s, n, before):
        frames = self.device.next_frames(timeout_s)
        times_s = np.array([time_s for time_s, _ in self._seen])
        positions = frames.positions_mm.reshape(len(frames), -1, 3)
        # What the cameras saw when they sent a frame is what was there when they next looked.
        for time_s, found_mm in zip(frames.time_s, positions, strict=True):
            looked = min(int(np.searchsorted(times_s, time_s - 1e-6)), len(times_s) - 1)
            near = self._seen[max(0, looked - 1) : looked + 3]
            truths = [LabFrame().from_sheet(points_mm) for _, points_mm in near]
            # Between two looks the cameras take the markers to move in a straight line.
            moved_mm = max(float(np.abs(truth - truths[0]).max()) for truth in truths)
            if min(float(np.abs(found_mm - truth).max()) for truth in truths) > moved_mm + 0.01:
                raise Wrong(f"the frame of {time_s:.3f} s shows the markers elsewhere")

    def _state_kept(self):
        state = self._state()
        if self.instrument == "markers":
            self._seen.append((state.time_s, state.points_mm.copy()))
        return state


def outcomes_of(cell):
    """What came of each call of a cell, in order.

    Raises:
        Wrong: anything but the truth or a specific error, in time.
    """
    bench = Bench(cell.driver)
    try:
        if cell.from_start:
            bench.is_new = True
            bench.break_wire(cell.fault)
        bench.open()
        if not cell.from_start:
            bench.device.identify()
            if cell.verb in ("next_frames", "stop"):
                bench.device.start()
            bench.break_wire(cell.fault)
        elif cell.verb in ("next_frames", "stop"):
            with suppress(InstrumentError):
                bench.device.start(TIMEOUT_S)
        return [bench.call(cell.verb, n) for n in range(CALLS)]
    except Wrong as wrong:
        raise Wrong(f"{cell}: {wrong}") from wrong
    finally:
        bench.close()


def in_words(outcomes):
    """Outcomes as text: "NoAnswer or GarbledReply, then right"."""
    errors = " or ".join(dict.fromkeys(name for name in outcomes if name != "right"))
    if not errors:
        return "right"
    if "right" not in outcomes:
        return errors
    recovers = "right" not in outcomes[: len(outcomes) - outcomes[::-1].index(errors.split(" or ")[-1])]
    return f"{errors}, then right" if recovers and outcomes[-1] == "right" else f"right or {errors}"


def tables(words_of):
    """The matrix as Markdown, a table a driver; `words_of` gives the words of a cell."""
    parts = []
    for driver, (instrument, _, verbs) in DRIVERS.items():
        lines = [f"## {driver}", "", "| | " + " | ".join(verbs) + " |", "|---" * (len(verbs) + 1) + "|"]
        for fault in FAULTS:
            if instrument == "markers" and fault not in OF_MARKERS:
                continue
            row = []
            for verb in verbs:
                both = [words_of(Cell(driver, fault, verb, from_start)) for from_start in (False, True)]
                row.append(" / ".join(dict.fromkeys(both)))
            lines.append(f"| {fault} (`{FAULTS[fault]}`) | " + " | ".join(row) + " |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"
