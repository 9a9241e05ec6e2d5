"""An Alicat PC/PCD pressure controller on its ASCII protocol.

Sources: Alicat PC series manual and serial primer (commands, data frame, legacy integer setpoint);
public captures of a PCD with firmware 10v20 (the tables of ??D* and ??M*). See docs/reference/hardware.md.
"""

import re
from collections.abc import Callable

from labctl.clock import Clock
from labctl.doubles.chamber import Mode
from labctl.doubles.faults import FaultPanel
from labctl.doubles.plant import PlantState, Pneumatics

STREAMING_ID = "@"
#: The legacy integer setpoint that means full scale.
LEGACY_FULL_SCALE = 64000
LEGACY_MAX = 65535
FIRMWARE = "10v20.0-R24"
PSI_PER_BAR = 14.503773773
_CR = "\r"
_NUMBER = re.compile(r"\s*([+-]?\d+(?:\.\d*)?|[+-]?\.\d+)\s*")

_LAYOUT = (
    "D00 ID_ NAME______________________ TYPE_______ WIDTH NOTES___________________",
    "D01 700 Unit ID                    string          1",
    "D02 006 Gauge Press                s decimal     7/2 010 02 PSIG",
    "D03 038 Ga Press Setpt             s decimal     7/2 010 02 PSIG",
    "D04 701 *Error                     string          3 ADC",
    "D05 702 *Status                    string          3 EXH",
    "D06 703 *Status                    string          3 HLD",
    "D07 704 *Status                    string          3 LCK",
    "D08 705 *Status                    string          3 OPL",
    "D09 706 *Status                    string          3 POV",
    "D10 707 *Status                    string          3 COM",
)


class AlicatAscii:
    """The device: state of its own (unit id, setpoint source, streaming) and the plant behind it.

    Letters count the same in either case. A line for another unit gets no answer, a command that it does not
    know gets "?". Bare digits behind the unit id are a legacy setpoint in 64000ths of full scale. With the
    setpoint source "A" (analog) a setpoint is answered by an ordinary frame and not taken over.
    """

    def __init__(self, plant: Pneumatics, faults: FaultPanel, clock: Clock, unit_id: str = "A") -> None:
        self._plant = plant
        self._faults = faults
        self._clock = clock
        self.unit_id = unit_id.upper()
        self._source = "S"
        self._stream_interval_s = 0.05
        self._stream_due_s = 0.0

    @property
    def streaming(self) -> bool:
        """The device sends data frames unasked."""
        return self.unit_id == STREAMING_ID

    def streamed(self) -> str:
        """The data frame that is due now, or nothing."""
        now_s = self._clock.now_s()
        if not self.streaming or now_s < self._stream_due_s:
            return ""
        self._stream_due_s = now_s + self._stream_interval_s
        return self._frame()

    def answer(self, line: str) -> str | None:
        """The reply to one line (without its CR); None or nothing where the device stays silent."""
        line = line.strip().upper()
        if self.streaming:
            return self._readdress(line[3:]) if line.startswith("@@=") else None
        if not line or line[0] != self.unit_id:
            return None
        reply = self._command(line[1:])
        return "?" + _CR if reply is None else reply

    def _command(self, command: str) -> str | None:
        verbs: dict[str, Callable[[], str | None]] = {
            "": self._frame,
            "HP": lambda: self._switch(Mode.HOLD_CURRENT),
            "HC": lambda: self._switch(Mode.HOLD_CLOSED),
            "C": lambda: self._switch(Mode.CONTROL),
            "E": self._exhaust,
            "P": self._tare,
            "TP": self._tare,
            "VE": lambda: f"{self.unit_id}   {FIRMWARE} Jan  9 2025,15:04:07{_CR}",
            "??D*": lambda: self._table(self._layout()),
            "??M*": lambda: self._table(self._manufacturer()),
            "LS": self._loop_setpoint,
        }
        if command in verbs:
            return verbs[command]()
        if command.startswith("@="):
            return self._readdress(command[2:])
        if command.startswith("W91="):
            return self._stream_interval(command[4:])
        if command.startswith("LSS"):
            return self._setpoint_source(command[3:])
        if command.startswith("LS"):
            return self._loop_setpoint() if self._take_setpoint(command[2:]) else None
        if command.startswith("S"):
            return self._frame() if self._take_setpoint(command[1:]) else None
        if command.isdecimal() and int(command) <= LEGACY_MAX:
            self._hand_over(int(command) / LEGACY_FULL_SCALE * self._plant.full_scale_psi)
            return self._frame()
        return None

    def _frame(self) -> str:
        state = self._plant.state()
        # Adding 0 makes a rounded -0.0 a plain zero.
        pressure = round(state.measured_psi / self._unit_psi(), 2) + 0.0
        values = f"{self.unit_id} {pressure:+07.2f} {state.setpoint_psi / self._unit_psi():+07.2f}"
        return values + "".join(f" {token}" for token in _status(state)) + _CR

    def _unit_psi(self) -> float:
        """One of the unit that the device is set to, in psi."""
        return PSI_PER_BAR if self._faults.active("unit-bar") else 1.0

    def _layout(self) -> tuple[str, ...]:
        if not self._faults.active("unit-bar"):
            return _LAYOUT
        return tuple(row.replace("010 02 PSIG", "007 02 BARG") for row in _LAYOUT)

    def _switch(self, mode: Mode) -> str:
        self._plant.switch_mode(mode)
        return self._frame()

    def _exhaust(self) -> str | None:
        return None if self._plant.settings.single_valve else self._switch(Mode.EXHAUST)

    def _tare(self) -> str:
        self._plant.tare()
        return self._frame()

    def _take_setpoint(self, text: str) -> bool:
        number = _NUMBER.fullmatch(text)
        if number is None or not 0 <= float(number[1]) * self._unit_psi() <= self._plant.full_scale_psi:
            return False
        self._hand_over(float(number[1]) * self._unit_psi())
        return True

    def _hand_over(self, setpoint_psi: float) -> None:
        if self._setpoint_source_now() != "A" and not self._faults.active("stuck-setpoint"):
            self._plant.write_setpoint(setpoint_psi)

    def _loop_setpoint(self) -> str:
        setpoint = self._plant.state().setpoint_psi / self._unit_psi()
        unit = "7 BARG" if self._faults.active("unit-bar") else "10 PSIG"
        return f"{self.unit_id} {setpoint:+07.2f} {setpoint:+07.2f} {unit}{_CR}"

    def _setpoint_source_now(self) -> str:
        return "A" if self._faults.active("ignored-setpoint") else self._source

    def _setpoint_source(self, text: str) -> str | None:
        value = text.strip()
        if value not in ("", "A", "S", "U"):
            return None
        self._source = value or self._source
        return f"{self.unit_id} {self._setpoint_source_now()}{_CR}"

    def _readdress(self, value: str) -> str | None:
        if value != STREAMING_ID and not (len(value) == 1 and value.isalpha()):
            return None
        self.unit_id = value
        self._stream_due_s = self._clock.now_s()
        return "" if self.streaming else self._frame()

    def _stream_interval(self, text: str) -> str | None:
        if not text.isdecimal() or int(text) == 0:
            return None
        self._stream_interval_s = int(text) / 1000
        return f"{self.unit_id} 091 = {int(text)}{_CR}"

    def _table(self, rows: tuple[str, ...]) -> str:
        return "".join(f"{self.unit_id} {row}{_CR}" for row in rows)

    def _manufacturer(self) -> tuple[str, ...]:
        model = "PC" if self._plant.settings.single_valve else "PCD"
        valves = "" if self._plant.settings.single_valve else "-D"
        return (
            "M00 Alicat Scientific",
            "M01 www.alicat.com",
            "M02 Ph   520-290-6060",
            "M03 info@alicat.com",
            f"M04 Model Number {model}-{self._plant.full_scale_psi:.0f}PSIG{valves}",
            "M05 Serial Number 123456",
            "M06 Date Manufactured 01/09/2025",
            "M07 Date Calibrated   01/09/2025",
            "M08 Calibrated By     SIM",
            f"M09 Software Revision {FIRMWARE}",
        )


def _status(state: PlantState) -> list[str]:
    flags = {"EXH": state.exhausting, "HLD": state.holding}
    return [token for token, shown in flags.items() if shown]


class AsciiLine:
    """The device's end of a serial line: commands end in CR, replies too."""

    is_text = True

    def __init__(self, device: AlicatAscii) -> None:
        self._device = device
        self._buffer = bytearray()

    @property
    def waiting(self) -> bool:
        """A streaming device sends frames unasked."""
        return self._device.streaming

    def receive(self, data: bytes) -> list[bytes]:
        """Replies to the lines that `data` completes; a line for another unit gets none."""
        self._buffer += data
        *lines, rest = self._buffer.split(b"\r")
        self._buffer = bytearray(rest)
        replies = (self._device.answer(line.decode("ascii", "replace")) for line in lines)
        return [reply.encode("ascii") for reply in replies if reply is not None]

    def idle(self) -> list[bytes]:
        """A pause means nothing: only CR ends a command."""
        return []

    def unprompted(self) -> bytes:
        """The data frame that a streaming device is due to send."""
        return self._device.streamed().encode("ascii")

    def readdressed(self, reply: bytes) -> bytes:
        """The reply as the unit with the next letter would send it."""
        other = "B" if self._device.unit_id == "A" else "A"
        mine = self._device.unit_id.encode("ascii")
        rows = reply.split(b"\r")
        return b"\r".join(other.encode("ascii") + row[1:] if row.startswith(mine) else row for row in rows)
