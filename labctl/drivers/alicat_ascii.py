"""Alicat PC and PCD pressure controllers over ASCII lines (serial primer; docs/reference/hardware.md)."""

import re
from collections.abc import Callable

from labctl.config.rig import PressureUnit
from labctl.drivers.alicat_firmware import Firmware, find_firmware
from labctl.drivers.alicat_layout import FrameLayout, parse_layout
from labctl.drivers.alicat_lines import (
    GP_PREFIX,
    find_fact,
    parse_frame,
    request_line,
    setpoint_command,
)
from labctl.drivers.alicat_probes import FULL_SCALE, IDENTITY, LAYOUT, VERSION, probe, stream
from labctl.drivers.alicat_setpoint import (
    NotTaken,
    OwnRamp,
    SetpointSource,
    parse_own_ramp,
    parse_setpoint_source,
    why_not_taken,
)
from labctl.drivers.alicat_talk import AlicatTalk
from labctl.drivers.pressure_unit import from_psi, to_psi
from labctl.drivers.setpoint_limit import check_setpoint
from labctl.errors import BadInput, GarbledReply, InstrumentRefused, NoAnswer, ReadBackMismatch
from labctl.instruments.readings import Identity, PressureReading
from labctl.links.deadline import Deadline
from labctl.links.interfaces import LineLink
from labctl.links.line_resync import Probe

# The two tables of an identification take 0.7 s at 19200 baud.
IDENTIFY_S = 3.0
# The device may confirm a command before its status shows it.
READ_BACKS = 3
# How often a setpoint that the device moves by itself is looked at.
LOOK_S = 0.05


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
            raise BadInput(f"{name}: unit id {unit_id!r} is not one letter from A to Z (unit_id)")
        self.name = name
        self.can_exhaust = dual_valve
        self.max_setpoint_psi = max_setpoint_psi
        self.timeout_s = timeout_s
        self._link = link
        self._unit_id = unit_id
        self._unit = pressure_unit
        self._plausible_psi = plausible_psi
        self._talk = AlicatTalk(link, unit_id, name)
        self._layout: FrameLayout | None = None
        self._layout_fits = False
        self._firmware: Firmware | None = None
        self._setpoint_psi: float | None = None
        link.expect_stream(stream(unit_id))
        link.resync_by([probe(question, unit_id) for question in (VERSION, IDENTITY, LAYOUT)])

    def identify(self, timeout_s: float | None = None) -> Identity:
        """Ask for manufacturing data (`??M*`), firmware (`VE`), setpoint source (`LSS`), own ramp (`SR`), a reading.

        What the device does not answer is None in the identity. `LSS` and `SR` are left out where the firmware is
        too old to take them for questions, or not known. What is answered and cannot be mistaken for anything else
        becomes what the link resynchronises by.

        Raises:
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`.
        """
        deadline = self._deadline(timeout_s)
        layout = self._bound(deadline)
        answered = [LAYOUT]
        facts = self._talk.optional(lambda part: self._talk.ask_lines(IDENTITY, part), deadline) or []
        if facts:
            answered.insert(0, IDENTITY)
        version = self._recognised(VERSION, deadline)
        if version is not None:
            answered.insert(0, VERSION)
        elif not layout.is_gp and self._recognised(FULL_SCALE, deadline) is not None:
            answered.insert(0, FULL_SCALE)
        self._link.resync_by([self._probe(question) for question in answered])
        software = find_fact(facts, "Software Revision", "Software") or version or ""
        self._firmware = find_firmware(version or "") or find_firmware(software)
        source = self._setpoint_source(deadline)
        ramp = self._own_ramp(deadline)
        self._poll(deadline)
        return Identity(
            model=find_fact(facts, "Model Number", "Mdl") or "Alicat pressure controller",
            serial_number=find_fact(facts, "Serial Number", "Serial No."),
            firmware=self._firmware.text if self._firmware else None,
            setpoint_source=source,
            notes=self._notes(ramp),
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

        def agrees(reading: PressureReading) -> bool:
            return abs(reading.setpoint_psi - to_psi(value, self._unit)) <= tolerance_psi

        before_psi = self._setpoint_psi
        reading = self._command(setpoint_command(value, column.decimals), agrees, deadline)
        moving = False
        # A setpoint of 0 vents: nothing waits for the device's own ramp then.
        if not agrees(reading) and value > 0:
            reading, moving = self._follow(reading, to_psi(value, self._unit), agrees, deadline)
        if agrees(reading):
            return reading
        raise ReadBackMismatch(
            why_not_taken(
                self.name,
                NotTaken(
                    setpoint_psi,
                    reading,
                    moving,
                    before_psi,
                    self._setpoint_source(deadline),
                    self._own_ramp(deadline),
                    to_psi(column.resolution, self._unit),
                ),
            )
        )

    def exhaust(self, timeout_s: float | None = None) -> PressureReading:
        """Open the exhaust valve (`E`; two valves only) and read EXH back.

        It counts only where the device itself reports EXH. `E` and the `C` that ends it are sent by a public program
        of a test stand with PCDs (Wasco-Engineering/Stinger), which shows the reply `A +013.53 +014.70 EXH`.

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

    def hold_closed(self, timeout_s: float | None = None) -> PressureReading:
        """Shut the valves (`HC`) and read HLD back. This is no vent: what is in the sheet stays there.

        Raises:
            ReadBackMismatch: the device does not report HLD.
            NoAnswer, GarbledReply, InstrumentRefused, LinkDown: as `read`; the valves may have shut.
        """
        reading = self._command("HC", lambda it: it.holding, self._deadline(timeout_s))
        if not reading.holding:
            raise ReadBackMismatch(
                f"{self.name}: its valves were commanded shut and HLD was not read back (status "
                f"{sorted(reading.status)}); check model and firmware"
            )
        return reading

    def tare(self, timeout_s: float | None = None) -> PressureReading:
        """Tare the gauge pressure (`P`; `TP` where that is not known); returns a reading from after it.

        The manual of the PC series has `P`, the serial primer and the client alicatlib `TP`.

        Raises:
            InstrumentRefused: the device knows neither.
            NoAnswer, GarbledReply, LinkDown: as `read`; the tare may have been done.
        """
        deadline = self._deadline(timeout_s)
        self._bound(deadline)
        if self._talk.optional(lambda part: self._frame(self._spelled("P"), part), deadline) is None:
            self._frame(self._spelled("TP"), deadline)
        return self._poll(deadline)

    def close(self) -> None:
        """Give the link back; may be called twice. The device keeps its setpoint."""
        self._link.close()

    def _setpoint_source(self, deadline: Deadline) -> SetpointSource | None:
        if self._firmware is None or not self._firmware.tells_setpoint_source:
            return None
        return self._talk.told("LSS", lambda line: parse_setpoint_source(line, self._unit_id), deadline)

    def _own_ramp(self, deadline: Deadline) -> OwnRamp | None:
        if self._firmware is None or not self._firmware.tells_own_ramp:
            return None
        return self._talk.told("SR", parse_own_ramp, deadline)

    def _notes(self, ramp: OwnRamp | None) -> tuple[str, ...]:
        notes = []
        if ramp is not None and ramp.rate:
            notes.append(
                f"ramps its own setpoint by {ramp} (SR): turn that off, labctl relies on setpoints taken at once"
            )
        if self._link.ended_stream:
            notes.append("was streaming and has been set to polling")
        return (*notes, *self._link.noticed)

    def _follow(
        self,
        reading: PressureReading,
        target_psi: float,
        agrees: Callable[[PressureReading], bool],
        deadline: Deadline,
    ) -> tuple[PressureReading, bool]:
        """While the setpoint read back moves towards its target, wait for it; the last reading, and if it moved."""
        moving, stood = False, 0
        while stood < 2 and not agrees(reading) and deadline.remaining_s() > 4 * LOOK_S:
            self._link.clock.sleep(LOOK_S)
            latest = self._poll(deadline)
            nearer = abs(latest.setpoint_psi - target_psi) < abs(reading.setpoint_psi - target_psi)
            moving, stood = moving or nearer, 0 if nearer else stood + 1
            reading = latest
        return reading, moving

    def _to_device(self, setpoint_psi: float, resolution: float) -> float:
        """The setpoint in the device's unit, on its last decimal, never above the maximum by rounding."""
        steps = round(from_psi(setpoint_psi, self._unit) / resolution)
        if to_psi(steps * resolution, self._unit) > self.max_setpoint_psi + 1e-9:
            steps -= 1
        return steps * resolution

    def _urge(self, command: str, deadline: Deadline) -> None:
        """While replies do not come through, send a command that vents before waiting for any."""
        if self._link.suspect:
            self._link.send_unheard(request_line(self._unit_id, self._spelled(command)), deadline)

    def _spelled(self, command: str) -> str:
        """The command as this device's firmware reads it."""
        is_gp = self._layout is not None and self._layout.is_gp
        is_gp = is_gp or (self._firmware is not None and self._firmware.is_gp)
        return GP_PREFIX + command if is_gp else command

    def _command(
        self, command: str, agrees: Callable[[PressureReading], bool], deadline: Deadline
    ) -> PressureReading:
        """Send a command; the first reading that agrees with it, or the last of `READ_BACKS`."""
        reading = self._frame(self._spelled(command), deadline)
        for _ in range(READ_BACKS - 1):
            if agrees(reading):
                break
            reading = self._poll(deadline)
        return reading

    def _poll(self, deadline: Deadline) -> PressureReading:
        return self._frame("", deadline)

    def _frame(self, command: str, deadline: Deadline) -> PressureReading:
        layout = self._bound(deadline)
        line = self._talk.ask_line(command, deadline)
        try:
            reading = parse_frame(self.name, line, layout, self._unit)
        except GarbledReply:
            self._link.mark_suspect()
            if not self._layout_fits:
                # The table has no checksum either.
                self._layout = None
            raise
        self._layout_fits = True
        lowest, highest = self._plausible_psi
        for value_psi in (reading.gauge_psi, reading.setpoint_psi):
            if not lowest <= value_psi <= highest:
                raise self._talk.garbled(
                    f"{value_psi:g} psi in {line!r} is not between {lowest:g} and {highest:g} psi"
                )
        self._setpoint_psi = reading.setpoint_psi
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
            return self._talk.ask_lines(LAYOUT, deadline.share(0.6))
        except (InstrumentRefused, NoAnswer):
            # Half a line that another program left in the device spoils the first request.
            return self._talk.ask_lines(LAYOUT, deadline)

    def _recognised(self, question: str, deadline: Deadline) -> str | None:
        """The reply to a question that may resynchronise; None where it is not answered as such."""
        accepts = self._probe(question).accepts
        return self._talk.told(
            question, lambda line: line if accepts(line.encode("ascii")) else None, deadline
        )

    def _probe(self, question: str) -> Probe:
        return probe(question, self._unit_id, self._layout.pressure.label if self._layout else "")

    def _deadline(self, timeout_s: float | None) -> Deadline:
        if timeout_s is None:
            timeout_s = self.timeout_s if self._layout else max(self.timeout_s, IDENTIFY_S)
        return Deadline(self._link.clock, timeout_s)
