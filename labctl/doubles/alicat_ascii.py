"""An Alicat PC/PCD pressure controller on its ASCII protocol.

Sources: Alicat PC series manual and serial primer (commands, data frame, legacy integer setpoint); public captures of
devices with firmware 5v12 to 10v20 (`alicat_variants`); a public program of a test stand with PCDs (`E` and `C`). See
docs/reference/hardware.md.
"""

import re
from collections.abc import Callable

from labctl.clock import Clock
from labctl.doubles.alicat_answers import AlicatAnswers, DeviceSettings
from labctl.doubles.alicat_tables import layout_table, manufacturing_table
from labctl.doubles.alicat_variants import BARG, NEWEST, PSIG, VARIANTS, FirmwareName, Unit
from labctl.doubles.chamber import Mode
from labctl.doubles.faults import FaultPanel
from labctl.doubles.plant import Pneumatics

STREAMING_ID = "@"
#: The legacy integer setpoint that means full scale.
LEGACY_FULL_SCALE = 64000
LEGACY_MAX = 65535
_CR = "\r"
_PREFIX = "$$"
_NUMBER = re.compile(r"\s*([+-]?\d+(?:\.\d*)?|[+-]?\.\d+)\s*")
_HALF_A_LINE = b"A +"


class AlicatAscii:
    """The device: state of its own (unit id, setpoint source, streaming, lock) and the plant behind it.

    Letters count the same in either case. A line for another unit gets no answer, a command that it does not
    know gets "?" (none, by GP firmware). Bare digits behind the unit id are a legacy setpoint in 64000ths of full
    scale. With the setpoint source "A" (analog) a setpoint is answered by an ordinary frame and not taken over.
    """

    def __init__(
        self,
        plant: Pneumatics,
        faults: FaultPanel,
        clock: Clock,
        unit_id: str = "A",
        firmware: FirmwareName = NEWEST,
    ) -> None:
        self._plant = plant
        self._faults = faults
        self._clock = clock
        self.unit_id = unit_id.upper()
        self._variant = VARIANTS[firmware]
        self._settings = DeviceSettings()
        self._answers = AlicatAnswers(plant, self._variant, self._settings, self._unit)
        self._source = "S"
        self._locked = False
        self._stream_due_s = 0.0
        self._left_behind: set[str] = set()

    @property
    def streaming(self) -> bool:
        """The device sends data frames unasked."""
        if self._left("streaming"):
            self.unit_id = STREAMING_ID
        return self.unit_id == STREAMING_ID

    def streamed(self) -> str:
        """The data frame that is due now, or nothing."""
        now_s = self._clock.now_s()
        if not self.streaming or now_s < self._stream_due_s:
            return ""
        self._stream_due_s = now_s + self._settings.stream_ms / 1000
        # A captured 10v20 leaves the unit id out.
        return self._frame().removeprefix(STREAMING_ID if self._variant.knows((10, 0)) else "")

    def half_a_line(self) -> bytes:
        """What another program has left of a line that it did not end."""
        return _HALF_A_LINE if self._left("half-line") else b""

    def answer(self, line: str) -> str | None:
        """The reply to one line (without its CR); None or nothing where the device stays silent."""
        line = line.strip().upper()
        if self.streaming:
            return self._readdress(line[3:]) if line.startswith(("@@=", "@@ ")) else None
        if not line or line[0] != self.unit_id:
            return None
        reply = self._command(line[1:].removeprefix(_PREFIX), line[1:].startswith(_PREFIX))
        if reply is None:
            return None if self._variant.is_gp else "?" + _CR
        return reply

    def _command(self, command: str, prefixed: bool) -> str | None:
        questions: dict[str, Callable[[], str | None]] = {
            "": self._frame,
            "VE": self._version,
            "??D*": lambda: _lines(
                layout_table(self._variant, self.unit_id, self._plant.full_scale_psi, self._unit())
            ),
            "??M*": lambda: _lines(
                manufacturing_table(
                    self._variant, self.unit_id, self._plant.settings.single_valve, self._plant.full_scale_psi
                )
            ),
        }
        if command in questions:
            return questions[command]()
        if command.startswith(("@=", "@ ")):
            return self._readdress(command[2:])
        if self._variant.is_gp and not prefixed:
            return ""
        return self._obey(command)

    def _obey(self, command: str) -> str | None:
        self._find_ramp()
        actions: dict[str, Callable[[], str | None]] = {
            "HP": lambda: self._switch(Mode.HOLD_CURRENT),
            "HC": lambda: self._switch(Mode.HOLD_CLOSED),
            "H": lambda: self._switch(
                Mode.HOLD_CURRENT if self._plant.settings.single_valve else Mode.HOLD_CLOSED
            ),
            "C": lambda: self._switch(Mode.CONTROL),
            "E": self._exhaust,
            "P": self._tare,
            "TP": self._tare,
            "L": lambda: self._lock(True),
            "U": lambda: self._lock(False),
        }
        if command in actions:
            return actions[command]()
        if command.startswith("L") and self._variant.locks_by_l:
            return self._lock(True)
        if command.startswith("LSS"):
            return self._setpoint_source(command[3:])
        if command.startswith("DV"):
            data = self._answers.data(command[2:].split())
            return None if data is None else data + _CR
        answer = self._answers.answer(command)
        if answer is not None:
            return f"{self.unit_id} {answer}{_CR}"
        if command.startswith("LS"):
            return self._loop_setpoint(command[2:])
        if command.startswith("S"):
            return self._frame() if self._take_setpoint(command[1:]) else None
        if command.isdecimal() and int(command) <= LEGACY_MAX:
            self._hand_over(int(command) / LEGACY_FULL_SCALE * self._plant.full_scale_psi)
            return self._frame()
        return None

    def _frame(self) -> str:
        state = self._plant.state()
        pressure_psi = state.measured_psi
        if abs(pressure_psi) < self._settings.zero_band / 100 * self._plant.full_scale_psi:
            pressure_psi = 0.0
        words = {
            "P2O": self._faults.active("second-sensor") is not None,
            "HLD": state.holding,
            "EXH": state.exhausting,
            "LCK": self._locked,
        }
        blank = "" if self._faults.active("no-blank") else " "
        shown = (
            self._variant.pressure.format(pressure_psi / self._unit().psi),
            self._variant.setpoint.format(state.setpoint_psi / self._unit().psi),
        )
        status = (word for word, on in words.items() if on)
        return " ".join((self.unit_id + blank + shown[0], shown[1], *status)) + _CR

    def _version(self) -> str:
        if self._variant.version_date is None or self._faults.active("silent-version"):
            return ""
        return f"{self.unit_id}   {self._variant.revision} {self._variant.version_date}{_CR}"

    def _unit(self) -> Unit:
        return BARG if self._faults.active("unit-bar") else PSIG

    def _switch(self, mode: Mode) -> str:
        self._plant.switch_mode(mode)
        return self._frame()

    def _lock(self, locked: bool) -> str:
        self._locked = locked
        return self._frame()

    def _exhaust(self) -> str | None:
        return None if self._plant.settings.single_valve else self._switch(Mode.EXHAUST)

    def _tare(self) -> str:
        self._plant.tare()
        return self._frame()

    def _take_setpoint(self, text: str) -> bool:
        number = _NUMBER.fullmatch(text)
        if number is None or not 0 <= float(number[1]) * self._unit().psi <= self._plant.full_scale_psi:
            return False
        self._hand_over(float(number[1]) * self._unit().psi)
        return True

    def _hand_over(self, setpoint_psi: float) -> None:
        if self._setpoint_source_now() == "A" or self._faults.active("stuck-setpoint"):
            return
        ramps = self._settings.ramps(setpoint_psi, self._plant.state().setpoint_psi)
        self._plant.write_setpoint(
            setpoint_psi, self._settings.ramp_per_s * self._unit().psi if ramps else 0.0
        )

    def _find_ramp(self) -> None:
        """Take over the ramp that the device is found with."""
        fault = self._faults.active("own-ramp")
        if fault is not None and self._left("own-ramp"):
            self._settings.ramp, self._settings.ramp_unit = fault.value / self._unit().psi, 4

    def _loop_setpoint(self, text: str) -> str | None:
        if not self._variant.knows((9, 0)) or (text and not self._take_setpoint(text)):
            return None
        state = self._plant.state()
        now, requested = (
            self._variant.setpoint.format(psi / self._unit().psi)
            for psi in (state.setpoint_psi, state.requested_psi)
        )
        return f"{self.unit_id} {now} {requested} {self._unit().code} {self._unit().label}{_CR}"

    def _setpoint_source_now(self) -> str:
        return "A" if self._faults.active("ignored-setpoint") else self._source

    def _setpoint_source(self, text: str) -> str | None:
        source, *save = text.split() or [""]
        if (
            not self._variant.knows((10, 5))
            or source not in ("", "A", "S", "U")
            or save not in ([], ["0"], ["1"])
        ):
            return None
        self._source = source or self._source
        return f"{self.unit_id} {self._setpoint_source_now()}{_CR}"

    def _readdress(self, value: str) -> str | None:
        if value != STREAMING_ID and not (len(value) == 1 and value.isalpha()):
            return None
        self.unit_id = value
        self._stream_due_s = self._clock.now_s()
        return "" if self.streaming else self._frame()

    def _left(self, kind: str) -> bool:
        """Whether a fault that a device is found with has begun, once."""
        if kind in self._left_behind or self._faults.active(kind) is None:
            return False
        self._left_behind.add(kind)
        return True


def _lines(lines: list[str]) -> str:
    return "".join(line + _CR for line in lines)


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
        self._buffer += self._device.half_a_line() + data
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
