"""What an Alicat double answers to questions about itself, and the settings behind them.

Sources: serial primer; captures of a 10v20 (`LV`, `FPF`, `DCU`, `DV`, `VD`); the two clients that use the rest:
numat's (registers, `LSRC`) and alicatlib (`NCS`, `LCDB`, `DCZ`). docs/reference/hardware.md, 1a.
"""

from collections.abc import Callable
from dataclasses import dataclass

from labctl.doubles.alicat_variants import Unit, Variant
from labctl.doubles.plant import Pneumatics

GAUGE, GAUGE_SETPOINT = 6, 38
_REGISTER_CONTROL_POINT, _REGISTER_STREAM_MS = 122, 91
#: Seconds in the time units of `SR`, and their names.
_TIME_UNITS = {3: (0.001, "ms"), 4: (1.0, "s"), 5: (60.0, "m"), 6: (3600.0, "h"), 7: (86400.0, "d")}
_FULL_DRIVE_PSI = 1.0


@dataclass
class DeviceSettings:
    """What a client can set and read back; a zero band is in percent of full scale.

    `gains` are registers 21 to 23 and 85: they are kept, and the plant's loop stays as it is.
    """

    stream_ms: int = 50
    zero_band: float = 0.0
    ramp: float = 0.0
    ramp_unit: int = 4
    ramp_when: tuple[bool, bool, bool, bool] = (True, True, True, True)

    @property
    def ramp_per_s(self) -> float:
        """How fast the device moves its setpoint, in its unit; 0 is at once."""
        return self.ramp / _TIME_UNITS[self.ramp_unit][0]

    def ramps(self, setpoint_psi: float, now_psi: float) -> bool:
        """Whether the device ramps to this setpoint (`LSRC`: up, down, to zero)."""
        up, down, zero, _ = self.ramp_when
        if setpoint_psi == 0:
            return zero
        return up if setpoint_psi > now_psi else down


class AlicatAnswers:
    """Answers without their unit id and CR; None is `?`.

    Each question is known from the firmware that introduced it on.
    """

    def __init__(
        self, plant: Pneumatics, variant: Variant, settings: DeviceSettings, unit: Callable[[], Unit]
    ) -> None:
        self._plant = plant
        self._unit_now = unit
        self._variant = variant
        self._settings = settings
        self._gains = {21: 500, 22: 5000, 23: 0, 85: 2}
        self._questions: dict[str, tuple[tuple[int, int], Callable[[list[str]], str | None]]] = {
            "LV": ((9, 0), self._control_point),
            "SR": ((7, 11), self._ramp),
            "LSRC": ((10, 5), self._ramp_when),
            "FPF": ((6, 0), self._full_scale),
            "DCU": ((10, 5), self._unit),
            "VD": ((8, 18), self._valve_drive),
            "NCS": ((10, 5), self._stream_ms),
            "LCDB": ((10, 5), self._dead_band),
            "DCZ": ((10, 5), self._zero_band),
        }

    def answer(self, command: str) -> str | None:
        """The answer to a command such as "SR 0.5 4"."""
        word, *values = command.split()
        if word in self._questions:
            first, answer = self._questions[word]
            try:
                return answer(values) if self._variant.knows(first) else None
            except ValueError:
                return None
        return self._register(command)

    def data(self, values: list[str]) -> str | None:
        """The answer to `DV`, which has no unit id: an averaging time in ms, then statistics."""
        if not self._variant.knows((5, 0)) or len(values) < 2 or not all(map(str.isdecimal, values)):
            return None
        if int(values[0]) < 1:
            return None
        state = self._plant.state()
        shown = {
            GAUGE: self._variant.pressure.format(state.measured_psi / self._unit_now().psi),
            GAUGE_SETPOINT: self._variant.setpoint.format(state.setpoint_psi / self._unit_now().psi),
        }
        return " ".join(shown.get(int(value), "-------") for value in values[1:])

    def _control_point(self, values: list[str]) -> str | None:
        return None if values and int(values[0]) != GAUGE_SETPOINT else str(GAUGE_SETPOINT)

    def _ramp(self, values: list[str]) -> str | None:
        it, unit_now = self._settings, self._unit_now()
        if values:
            rate, unit = float(values[0]), int(values[1]) if len(values) == 2 else 0
            if not 0 <= rate < 1e6 or unit not in _TIME_UNITS:
                return None
            it.ramp, it.ramp_unit = rate, unit
        return f"{it.ramp:.2f} {unit_now.code} {it.ramp_unit} {unit_now.label}/{_TIME_UNITS[it.ramp_unit][1]}"

    def _ramp_when(self, values: list[str]) -> str | None:
        if values:
            if len(values) != 4 or not set(values) <= {"0", "1"}:
                return None
            up, down, zero, power = (value == "1" for value in values)
            self._settings.ramp_when = (up, down, zero, power)
        return " ".join(str(int(when)) for when in self._settings.ramp_when)

    def _full_scale(self, values: list[str]) -> str | None:
        if len(values) != 1 or int(values[0]) not in (GAUGE, GAUGE_SETPOINT):
            return "+0 1 ---" if len(values) == 1 else None
        unit = self._unit_now()
        full_scale = self._variant.pressure.format(self._plant.full_scale_psi / unit.psi)
        return f"{full_scale} {unit.code} {unit.label}"

    def _unit(self, values: list[str]) -> str | None:
        if not values or int(values[0]) not in (GAUGE, GAUGE_SETPOINT):
            return None
        unit = self._unit_now()
        if len(values) > 1 and int(values[1]) != unit.code:
            return None
        return f"{unit.code} {unit.label}"

    def _valve_drive(self, values: list[str]) -> str | None:
        """Of four valves, in percent: the inlet, the exhaust, and two that the device does not have."""
        state = self._plant.state()
        inlet = exhaust = 0.0
        if state.exhausting:
            exhaust = 1.0
        elif not state.holding:
            wanted = (state.setpoint_psi - state.measured_psi) / _FULL_DRIVE_PSI
            inlet = min(1.0, max(0.0, wanted))
            exhaust = 0.0 if self._plant.settings.single_valve else min(1.0, max(0.0, -wanted))
        return None if values else f"{100 * inlet:06.2f} {100 * exhaust:06.2f} 000.00 000.00"

    def _stream_ms(self, values: list[str]) -> str | None:
        if values:
            if int(values[0]) < 1:
                return None
            self._settings.stream_ms = int(values[0])
        return str(self._settings.stream_ms)

    def _dead_band(self, values: list[str]) -> str | None:
        # The plant's loop has none, so none can be set.
        return (
            None
            if values and float(values[-1]) != 0
            else f"0.00 {self._unit_now().code} {self._unit_now().label}"
        )

    def _zero_band(self, values: list[str]) -> str | None:
        if values:
            band = float(values[-1])
            if len(values) != 2 or values[0] != "0" or not 0 <= band <= 6.38:
                return None
            self._settings.zero_band = band
        return f"0 {self._settings.zero_band:.2f}"

    def _register(self, command: str) -> str | None:
        """`R122`, `W122=38`: registers by number."""
        name, equals, value = command[1:].partition("=")
        if command[:1] not in ("R", "W") or not name.isdecimal() or bool(equals) != (command[0] == "W"):
            return None
        number = int(name)
        if equals and not (value.isdecimal() and self._write_register(number, int(value))):
            return None
        values = {
            **self._gains,
            _REGISTER_CONTROL_POINT: GAUGE_SETPOINT,
            _REGISTER_STREAM_MS: self._settings.stream_ms,
        }
        return f"  {number:03d} = {values[number]}" if number in values else None

    def _write_register(self, number: int, value: int) -> bool:
        if number == _REGISTER_STREAM_MS and value > 0:
            self._settings.stream_ms = value
        elif number in self._gains:
            self._gains[number] = value
        else:
            return number == _REGISTER_CONTROL_POINT and value == GAUGE_SETPOINT
        return True
