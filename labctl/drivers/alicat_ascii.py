"""Alicat PC and PCD pressure controllers over ASCII lines (serial primer; docs/reference/hardware.md)."""

import re
from collections.abc import Callable
from typing import Literal, TypeVar

from labctl.config.rig import PressureUnit
from labctl.drivers.alicat_lines import (
    FrameLayout,
    find_fact,
    find_version,
    is_refusal,
    is_version_line,
    parse_frame,
    parse_layout,
    request_line,
    setpoint_command,
)
from labctl.drivers.pressure_unit import from_psi, to_psi
from labctl.drivers.setpoint_limit import check_setpoint
from labctl.errors import BadInput, GarbledReply, InstrumentRefused, NoAnswer, ReadBackMismatch
from labctl.instruments.readings import Identity, PressureReading
from labctl.links.deadline import Deadline
from labctl.links.interfaces import LineLink

T = TypeVar("T")

# Replies of several lines have no end mark; USB adapters hold bytes back for up to 16 ms.
IDLE_S = 0.1
# The two tables of an identification take 0.7 s at 19200 baud.
IDENTIFY_S = 3.0
# The device may confirm a command before its status shows it.
READ_BACKS = 3


class AlicatAscii:
    """A gauge pressure controller in polling mode.

    Its data frame is bound to its own table (`??D*`) at first use.

    Args:
        link: lines ending in CR.
        unit_id: one letter, A to Z.
        pressure_unit: the unit that the device is set to; checked against the device's table.
        max_setpoint_psi: setpoints above are refused before a byte is sent.
        dual_valve: the device has an exhaust valve (PCD).
        name: for messages.
        timeout_s: of a call that names none; where the tables have to be read, `IDENTIFY_S` if that is more.
        plausible_psi: a pressure or setpoint outside is taken for a transmission error. The default is full
            vacuum to one and a half times a 15 psi full scale.

    Raises:
        BadInput: the unit id is not one letter.
    """

    def __init__(
        self,
        link: LineLink,
        *,
        unit_id: str,
        pressure_unit: PressureUnit,
        max_setpoint_psi: float,
        dual_valve: bool,
        name: str,
        timeout_s: float,
        plausible_psi: tuple[float, float] = (-15.0, 22.5),
    ) -> None:
        if not re.fullmatch(r"[A-Z]", unit_id):
            raise BadInput(f"{name}: unit id {unit_id!r} is not one letter from A to Z (regulator.unit_id)")
        self.name = name
        self.can_exhaust = dual_valve
        self.max_setpoint_psi = max_setpoint_psi
        self.timeout_s = timeout_s
        self._link = link
        self._unit_id = unit_id
        self._unit = pressure_unit
        self._plausible_psi = plausible_psi
        self._layout: FrameLayout | None = None

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Ask for manufacturing data (`??M*`), firmware (`VE`), setpoint source (`LSS`) and a reading.

        What the device does not answer is None in the identity.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`.
        """
        deadline = self._deadline(timeout_s)
        self._bound(deadline)
        facts = self._optional(lambda part: self._ask_lines("??M*", part), deadline) or []
        version = self._optional(lambda part: self._ask_line("VE", part), deadline)
        if version is not None and is_version_line(version.encode("ascii"), self._unit_id):
            self._link.resync_by(
                request_line(self._unit_id, "VE"), lambda line: is_version_line(line, self._unit_id)
            )
        source = self._setpoint_source(deadline)
        self._poll(deadline)
        return Identity(
            model=find_fact(facts, "Model Number") or "Alicat pressure controller",
            serial_number=find_fact(facts, "Serial Number"),
            firmware=find_version(version or "") or find_fact(facts, "Software Revision"),
            setpoint_source=source,
            notes=self._link.noticed,
        )

    def read(self, timeout_s: float | None = None) -> PressureReading:
        """Poll a data frame.

        Raises:
            NoAnswer: no complete reply before the deadline.
            GarbledReply: the reply is not the data frame of the device's table, or cannot be true.
            InstrumentRefused: `?`; also a device without gauge pressure, or in another unit.
            LinkDown: the port is gone.
        """
        return self._poll(self._deadline(timeout_s))

    def write_setpoint(self, setpoint_psi: float, timeout_s: float | None = None) -> PressureReading:
        """Write the setpoint (`S`), to the device's last decimal; returns the reading that confirmed it.

        Raises:
            SetpointOutOfRange: below 0 or above `max_setpoint_psi`; no byte was sent.
            ReadBackMismatch: the device kept another setpoint.
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`; the setpoint may have been taken.
        """
        check_setpoint(self.name, setpoint_psi, self.max_setpoint_psi)
        deadline = self._deadline(timeout_s)
        if setpoint_psi == 0:
            self._urge(setpoint_command(0.0, 1), deadline)
        column = self._bound(deadline).setpoint
        value = self._to_device(setpoint_psi, column.resolution)
        tolerance_psi = to_psi(0.5 * column.resolution, self._unit) + 1e-6
        reading = self._command(
            setpoint_command(value, column.decimals),
            lambda it: abs(it.setpoint_psi - to_psi(value, self._unit)) <= tolerance_psi,
            deadline,
        )
        if abs(reading.setpoint_psi - to_psi(value, self._unit)) > tolerance_psi:
            raise ReadBackMismatch(
                f"{self.name}: setpoint {setpoint_psi:g} psi was written, {reading.setpoint_psi:g} psi was "
                "read back; the device ignores writes unless its setpoint source is serial: set that at the "
                "device"
            )
        return reading

    def exhaust(self, timeout_s: float | None = None) -> PressureReading:
        """Open the exhaust valve (`E`; two valves only) and read EXH back.

        No manual at hand shows `E`, so it counts only where the device itself reports EXH.

        Raises:
            InstrumentRefused: the device has one valve only (no byte was sent), or refused the command.
            ReadBackMismatch: the device does not report EXH.
            NoAnswer, GarbledReply, LinkDown: as `read`; the valve may have opened.
        """
        if not self.can_exhaust:
            raise InstrumentRefused(
                f"{self.name}: a single-valve controller cannot exhaust; write setpoint 0 and open the "
                "dump valve"
            )
        deadline = self._deadline(timeout_s)
        self._urge("E", deadline)
        reading = self._command("E", lambda it: it.exhausting, deadline)
        if not reading.exhausting:
            raise ReadBackMismatch(
                f"{self.name}: exhaust was commanded and EXH was not read back (status "
                f"{sorted(reading.status)}); treat the sheet as inflated and vent it by hand"
            )
        return reading

    def cancel_hold(self, timeout_s: float | None = None) -> PressureReading:
        """Return from hold or exhaust to control (`C`) and read back that neither is left.

        Raises:
            ReadBackMismatch: the device still reports HLD or EXH.
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`.
        """
        deadline = self._deadline(timeout_s)
        reading = self._command("C", lambda it: not (it.holding or it.exhausting), deadline)
        if reading.holding or reading.exhausting:
            raise ReadBackMismatch(
                f"{self.name}: hold was cancelled and the device still reports {sorted(reading.status)}; "
                "cancel it at the device"
            )
        return reading

    def setpoint_source(self, timeout_s: float | None = None) -> Literal["serial", "analog"] | None:
        """Where the device takes its setpoint from (`LSS`); None where the firmware does not report it.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`.
        """
        deadline = self._deadline(timeout_s)
        source = self._setpoint_source(deadline)
        if source is None:
            # Silence is also what a dead link gives; a frame distinguishes the two.
            self._poll(deadline)
        return source

    def close(self) -> None:
        """Give the link back; may be called twice. The device keeps its setpoint."""
        self._link.close()

    def _setpoint_source(self, deadline: Deadline) -> Literal["serial", "analog"] | None:
        line = self._optional(lambda part: self._ask_line("LSS", part), deadline)
        if line is None:
            return None
        sources: dict[str, Literal["serial", "analog"]] = {"A": "analog", "S": "serial", "U": "serial"}
        word = line.removeprefix(self._unit_id).strip()
        if word not in sources:
            raise self._garbled(f"{line!r} does not name a setpoint source (A, S or U)")
        return sources[word]

    def _to_device(self, setpoint_psi: float, resolution: float) -> float:
        """The setpoint in the device's unit, on its last decimal, never above the maximum by rounding."""
        steps = round(from_psi(setpoint_psi, self._unit) / resolution)
        if to_psi(steps * resolution, self._unit) > self.max_setpoint_psi + 1e-9:
            steps -= 1
        return steps * resolution

    def _urge(self, command: str, deadline: Deadline) -> None:
        """While replies do not come through, send a command that vents before waiting for any."""
        if self._link.suspect:
            self._link.send_unheard(request_line(self._unit_id, command), deadline)

    def _command(
        self, command: str, agrees: Callable[[PressureReading], bool], deadline: Deadline
    ) -> PressureReading:
        """Send a command; the first reading that agrees with it, or the last of `READ_BACKS`."""
        reading = self._frame(command, deadline)
        for _ in range(READ_BACKS - 1):
            if agrees(reading):
                break
            reading = self._poll(deadline)
        return reading

    def _poll(self, deadline: Deadline) -> PressureReading:
        return self._frame("", deadline)

    def _frame(self, command: str, deadline: Deadline) -> PressureReading:
        layout = self._bound(deadline)
        line = self._ask_line(command, deadline)
        try:
            reading = parse_frame(self.name, line, layout, self._unit)
        except GarbledReply:
            self._link.mark_suspect()
            raise
        lowest, highest = self._plausible_psi
        for value_psi in (reading.gauge_psi, reading.setpoint_psi):
            if not lowest <= value_psi <= highest:
                raise self._garbled(
                    f"{value_psi:g} psi in {line!r} is not between {lowest:g} and {highest:g} psi"
                )
        return reading

    def _bound(self, deadline: Deadline) -> FrameLayout:
        if self._layout is None:
            try:
                lines = self._ask_layout(deadline)
                self._layout = parse_layout(self.name, lines, self._unit_id, self._unit)
            except GarbledReply:
                self._link.mark_suspect()
                raise
        return self._layout

    def _ask_layout(self, deadline: Deadline) -> list[str]:
        try:
            return self._ask_lines("??D*", deadline)
        except InstrumentRefused:
            # Half a line that another program left in the device is refused together with the first request.
            return self._ask_lines("??D*", deadline)

    def _ask_line(self, command: str, deadline: Deadline) -> str:
        reply = self._link.exchange_line(request_line(self._unit_id, command), deadline)
        return self._checked(command, reply)

    def _ask_lines(self, command: str, deadline: Deadline) -> list[str]:
        replies = self._link.exchange_lines(request_line(self._unit_id, command), deadline, IDLE_S)
        return [self._checked(command, reply) for reply in replies]

    def _checked(self, command: str, reply: bytes) -> str:
        """The reply as text, if it is this device's and not an error."""
        try:
            line = reply.decode("ascii")
        except UnicodeDecodeError as error:
            raise self._garbled(f"{reply!r} is not text; check the baud rate") from error
        if is_refusal(line, self._unit_id):
            raise InstrumentRefused(
                f"{self.name}: the device does not know {self._unit_id + command!r}; check model and firmware"
            )
        if line.split(" ", 1)[0] != self._unit_id:
            raise self._garbled(f"{line!r} is not an answer of unit {self._unit_id}; check regulator.unit_id")
        return line

    def _garbled(self, what: str) -> GarbledReply:
        self._link.mark_suspect()
        return GarbledReply(f"{self.name}: {what}")

    def _optional(self, ask: Callable[[Deadline], T], deadline: Deadline) -> T | None:
        """What older firmware refuses or leaves unanswered; it may take half of the time that is left."""
        try:
            return ask(deadline.share(0.5))
        except (InstrumentRefused, NoAnswer):
            return None

    def _deadline(self, timeout_s: float | None) -> Deadline:
        if timeout_s is None:
            timeout_s = self.timeout_s if self._layout else max(self.timeout_s, IDENTIFY_S)
        return Deadline(self._link.clock, timeout_s)
