"""The lines of the Alicat ASCII protocol, written and read (serial primer; docs/reference/hardware.md).

A device describes its own data frame: the table of `??D*` has a row for each column, numbered by statistic, and
starred rows for the status words that may follow. Columns are bound to that table and never guessed.
"""

import re
from dataclasses import dataclass

from labctl.config.rig import PressureUnit
from labctl.drivers.pressure_unit import to_psi
from labctl.errors import GarbledReply, InstrumentRefused
from labctl.instruments.readings import PressureReading

GAUGE_PRESSURE, GAUGE_SETPOINT = "006", "038"
ABSOLUTE_PRESSURE, ABSOLUTE_SETPOINT = "002", "034"
UNIT_ID = "700"

_ROW = re.compile(r"(?P<unit>[A-Z]) D(?P<row>\d\d) (?P<statistic>\d{3}) (?P<starred>\*?)(?P<rest>.+)")
_DECIMAL = re.compile(r".*\b(?:s )?decimal\s+(?P<width>\d+)/(?P<decimals>\d+)\s+\d+\s+\d+\s+(?P<label>\S+)")
_COMMAND = re.compile(r"[A-Z](?:[A-Z?][ -~]*)?")
_BARE_SETPOINT = re.compile(r"[A-Z]L?S\s*[+-]?\d+")
_STATUS_WORD = re.compile(r"[A-Z]{3}")
_VERSION = re.compile(r"\d+v\d+\S*")


@dataclass(frozen=True)
class Column:
    """A number in the data frame: its place, its width in characters, its decimals and its unit's label."""

    index: int
    width: int
    decimals: int
    label: str

    @property
    def resolution(self) -> float:
        """One unit of the last decimal."""
        return 10.0**-self.decimals


@dataclass(frozen=True)
class FrameLayout:
    """The data frame of one device; `columns` counts the unit id."""

    columns: int
    pressure: Column
    setpoint: Column


def request_line(unit_id: str, command: str) -> bytes:
    """The bytes of a command: the one place where bytes for the device are made.

    A unit id that a number follows is a setpoint in counts (64000 is full scale), whatever was meant; a
    setpoint command whose number has no decimal point comes too close to that.

    Raises:
        ValueError: a line that the device could read so, or that is more than one line.
    """
    line = unit_id + command
    if len(unit_id) != 1 or not _COMMAND.fullmatch(line) or _BARE_SETPOINT.fullmatch(line):
        raise ValueError(
            f"{line!r} is not a command: a unit id, then letters; a setpoint has a decimal point"
        )
    return line.encode("ascii") + b"\r"


def setpoint_command(value: float, decimals: int) -> str:
    """`S` and a setpoint in the device's unit, always with a decimal point.

    Raises:
        ValueError: below 0, or not finite.
    """
    if not 0.0 <= value < 1e6:
        raise ValueError(f"{value} is not a setpoint")
    return f"S{abs(value):.{max(1, decimals)}f}"


def is_refusal(line: str, unit_id: str) -> bool:
    """The device did not understand: `?`, by some firmwares with the unit id."""
    return line.strip() in ("?", f"{unit_id} ?")


def is_version_line(line: bytes, unit_id: str) -> bool:
    """The reply to `VE`, which no other reply looks like."""
    text = line.decode("ascii", "replace")
    return text.startswith(f"{unit_id} ") and _VERSION.match(text[1:].lstrip()) is not None


def parse_layout(name: str, lines: list[str], unit_id: str, unit: PressureUnit) -> FrameLayout:
    """The data frame's layout from the lines of `??D*`.

    Raises:
        GarbledReply: a row is missing or cannot be read.
        InstrumentRefused: the device measures absolute pressure only, or in another unit.
    """
    places: dict[str, tuple[int, str]] = {}
    columns = 0
    for number, line in enumerate(_table_rows(lines), start=1):
        row = _ROW.fullmatch(line)
        if row is None or row["unit"] != unit_id or int(row["row"]) != number:
            raise GarbledReply(f"{name}: row {number} of the data frame table reads {line!r}; ask again")
        if not row["starred"]:
            places[row["statistic"]] = (columns, row["rest"])
            columns += 1
    if places.get(UNIT_ID, (-1,))[0] != 0:
        raise GarbledReply(f"{name}: the data frame table does not start with the unit id; ask again")
    if not {GAUGE_PRESSURE, GAUGE_SETPOINT} <= places.keys():
        absolute = {ABSOLUTE_PRESSURE, ABSOLUTE_SETPOINT} & places.keys()
        what = "absolute pressure" if absolute else "no pressure"
        raise InstrumentRefused(
            f"{name}: the data frame carries {what}, not gauge pressure and its setpoint (statistics 006 and "
            "038); use a gauge controller, or set its data frame"
        )
    pressure = _column(name, *places[GAUGE_PRESSURE])
    setpoint = _column(name, *places[GAUGE_SETPOINT])
    for column in (pressure, setpoint):
        _check_unit(name, column.label, unit)
    return FrameLayout(columns, pressure, setpoint)


def parse_frame(name: str, line: str, layout: FrameLayout, unit: PressureUnit) -> PressureReading:
    """A reading from a data frame such as `A +003.90 +003.90 EXH`.

    Raises:
        GarbledReply: another number of columns, another format, or words that are no status.
    """
    words = line.split()
    values, status = words[: layout.columns], words[layout.columns :]
    if len(values) < layout.columns or not all(_STATUS_WORD.fullmatch(word) for word in status):
        raise GarbledReply(f"{name}: {line!r} is not a data frame of {layout.columns} columns; ask again")
    return PressureReading(
        gauge_psi=to_psi(_number(name, line, values, layout.pressure), unit),
        setpoint_psi=to_psi(_number(name, line, values, layout.setpoint), unit),
        status=frozenset(status),
    )


def find_fact(lines: list[str], label: str) -> str | None:
    """What follows `label` in the lines of `??M*`; None when no line has it."""
    for line in lines:
        _, found, value = line.partition(label)
        if found and value.strip():
            return value.strip()
    return None


def find_version(text: str) -> str | None:
    """The firmware version in a line, such as `10v20.0-R24`."""
    found = _VERSION.search(text)
    return found[0] if found else None


def _table_rows(lines: list[str]) -> list[str]:
    """The rows without the heading, whose statistic is the word ID_."""
    return [line for line in lines if not re.match(r"[A-Z] D00 ID_", line)]


def _column(name: str, index: int, rest: str) -> Column:
    found = _DECIMAL.fullmatch(rest.rstrip())
    if found is None:
        raise GarbledReply(f"{name}: the data frame table describes a number as {rest!r}; ask again")
    return Column(index, int(found["width"]), int(found["decimals"]), found["label"])


def _check_unit(name: str, label: str, unit: PressureUnit) -> None:
    # PSIG, PSI and psig are one unit: the trailing G means gauge.
    plain = label.casefold()
    if plain not in (unit.casefold(), unit.casefold() + "g"):
        raise InstrumentRefused(
            f"{name}: the device is set to {label}, the configuration says {unit}; change the device's unit "
            "or regulator.pressure_unit, so that both agree"
        )


def _number(name: str, line: str, values: list[str], column: Column) -> float:
    word = values[column.index]
    # A lost or doubled character would still be a number: the width is what shows it.
    if len(word) != column.width or not re.fullmatch(
        rf"[+-]\d+\.\d{{{column.decimals}}}" if column.decimals else r"[+-]\d+\.?", word
    ):
        raise GarbledReply(
            f"{name}: {word!r} in {line!r} is not a signed number of {column.width} characters with "
            f"{column.decimals} decimals; ask again"
        )
    return float(word)
