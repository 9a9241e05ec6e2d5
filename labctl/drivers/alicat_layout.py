"""The table by which an Alicat describes its own data frame (`??D*`), in both of its forms.

From 6v on a row has a statistic number, a type and a width; before (5v12, GP) a name, a range and a unit. Columns are
bound to that table and never guessed. Sources: serial primer; captures of devices from 5v12 to 10v20
(docs/reference/hardware.md, 1a). No capture of a gauge pressure controller with the older table is known: there the
unit's trailing G is what says gauge.
"""

import re
from dataclasses import dataclass
from typing import Literal

from labctl.config.rig import PressureUnit
from labctl.errors import GarbledReply, InstrumentRefused

GAUGE_PRESSURE, GAUGE_SETPOINT = "006", "038"
ABSOLUTE_PRESSURE, ABSOLUTE_SETPOINT = "002", "034"
UNIT_ID = "700"
#: GP firmware moves the cursor of its display back within its tables.
CURSOR_BACK = "\b"

# Status words that a rig acts on: none may be lost among the columns.
SAFETY_WORDS = frozenset({"ADC", "EXH", "HLD", "OPL", "POV"})
Sign = Literal["always", "never", "either"]

_HEADING = re.compile(r"[A-Z] +D0?0 +(?P<first>ID_|NAME)")
_ROW = re.compile(r"(?P<unit>[A-Z]) +D(?P<row>\d\d?) (?P<statistic>\d{3}) (?P<starred>\*?)(?P<rest>.+)")
_DECIMAL = re.compile(
    r".*?(?P<signed>\bs )? *\bdecimal\s+(?P<width>\d+)/(?P<decimals>\d+)\s+\d+\s+\d+\s+(?P<label>\S+)"
)
_OLDER_ROW = re.compile(
    r"(?P<unit>[A-Z]) +D(?P<row>\d\d?) +(?P<name>\S.*?) +(?P<type>char|signed|unsigned|string) +(?P<low>\S+) +"
    r"(?P<high>\S+) +(?P<label>\S+)"
)
_RANGE_END = re.compile(r"[+-]?\d+(?:\.(?P<decimals>\d+))?")
# In the older table these rows describe words that may follow.
_OLDER_WORDS = ("error", "status")
_OLDER_STATISTICS = {"unit id": UNIT_ID, "pressure": GAUGE_PRESSURE, "setpoint": GAUGE_SETPOINT}


@dataclass(frozen=True)
class Column:
    """A number in the data frame.

    `index` is its place, `width` its characters with their sign, `decimals` those behind the point, `label` its unit;
    `sign` says whether it has one. With "either" a number without a sign is one character shorter.
    """

    index: int
    width: int
    decimals: int
    label: str
    sign: Sign = "always"

    @property
    def resolution(self) -> float:
        """One unit of the last decimal."""
        return 10.0**-self.decimals


@dataclass(frozen=True)
class FrameLayout:
    """The data frame of one device; `columns` counts the unit id. `is_gp`: the table is one of GP firmware."""

    columns: int
    pressure: Column
    setpoint: Column
    is_gp: bool = False


@dataclass(frozen=True)
class _Row:
    """A column as its row describes it; `width` is 0 where it is no number."""

    statistic: str
    text: str
    width: int = 0
    decimals: int = 0
    label: str = ""
    sign: Sign = "always"


def parse_layout(name: str, lines: list[str], unit_id: str, unit: PressureUnit) -> FrameLayout:
    """The data frame's layout from the lines of `??D*`; what came before the table's heading is left out.

    Raises:
        GarbledReply: a row is missing or cannot be read.
        InstrumentRefused: the device measures absolute pressure only, or in another unit.
    """
    is_gp = any(CURSOR_BACK in line for line in lines)
    lines = [line.replace(CURSOR_BACK, "").rstrip() for line in lines]
    form, rows = _table(lines)
    columns: list[_Row] = []
    for number, line in enumerate(rows, start=1):
        row = _older_row(line, unit_id, number) if form == "older" else _row(line, unit_id, number)
        if row is None:
            raise GarbledReply(f"{name}: row {number} of the data frame table reads {line!r}; ask again")
        if row.statistic:
            if not row.width and line.split()[-1] in SAFETY_WORDS:
                # Its star was lost: a column for it would swallow the word.
                raise GarbledReply(
                    f"{name}: row {number} of the data frame table has no star: {line!r}; ask again"
                )
            columns.append(row)
    if not columns or columns[0].statistic != UNIT_ID:
        raise GarbledReply(f"{name}: the data frame table does not start with the unit id; ask again")
    if form == "older":
        _check_gauge(name, columns)
    return FrameLayout(
        len(columns),
        _bind(name, columns, GAUGE_PRESSURE, unit),
        _bind(name, columns, GAUGE_SETPOINT, unit),
        is_gp,
    )


def is_table_line(line: bytes, unit_id: str) -> bool:
    """A line of `??D*`, which no other answer looks like."""
    return re.match(rb"%b +D\d\d? " % unit_id.encode("ascii"), line) is not None


def _table(lines: list[str]) -> tuple[Literal["numbered", "older"], list[str]]:
    """The table's form, and the rows behind its last heading."""
    for place in range(len(lines) - 1, -1, -1):
        if heading := _HEADING.match(lines[place]):
            return "older" if heading["first"] == "NAME" else "numbered", lines[place + 1 :]
    return "numbered", lines


def _row(line: str, unit_id: str, number: int) -> _Row | None:
    row = _ROW.fullmatch(line)
    if row is None or row["unit"] != unit_id or int(row["row"]) != number:
        return None
    if row["starred"]:
        return _Row("", row["rest"])
    found = _DECIMAL.fullmatch(row["rest"])
    if found is None:
        return _Row(row["statistic"], row["rest"])
    return _Row(
        row["statistic"],
        row["rest"],
        int(found["width"]),
        int(found["decimals"]),
        found["label"],
        "always" if found["signed"] else "never",
    )


def _older_row(line: str, unit_id: str, number: int) -> _Row | None:
    row = _OLDER_ROW.fullmatch(line)
    if row is None or row["unit"] != unit_id or int(row["row"]) != number:
        return None
    plain = row["name"].casefold().replace("_", " ")
    if plain in _OLDER_WORDS:
        return _Row("", line)
    statistic = _OLDER_STATISTICS.get(plain, plain)
    low, high = _RANGE_END.fullmatch(row["low"]), _RANGE_END.fullmatch(row["high"])
    if row["type"] not in ("signed", "unsigned") or low is None or high is None:
        return _Row(statistic, line)
    sign: Sign = "always" if row["high"][0] in "+-" else "never"
    if statistic == GAUGE_SETPOINT and sign == "always":
        # The captured frame shows it without a sign, one character shorter, though its row has one.
        sign = "either"
    return _Row(statistic, line, len(row["high"]), len(high["decimals"] or ""), row["label"], sign)


def _check_gauge(name: str, columns: list[_Row]) -> None:
    labels = {row.statistic: row.label for row in columns}
    label = labels.get(GAUGE_PRESSURE, "")
    if label and not label.upper().endswith("G"):
        raise InstrumentRefused(
            f"{name}: the older data frame table of this firmware gives the pressure in {label}, which does not say "
            "gauge (a trailing G); use a gauge controller, or set the device's unit to one of gauge pressure"
        )
    if label and labels.get(GAUGE_SETPOINT, label) != label:
        raise InstrumentRefused(
            f"{name}: the device controls in {labels[GAUGE_SETPOINT]} and measures in {label}; let it control its "
            "gauge pressure"
        )


def _bind(name: str, columns: list[_Row], statistic: str, unit: PressureUnit) -> Column:
    index = next((place for place, row in enumerate(columns) if row.statistic == statistic), None)
    if index is None:
        raise InstrumentRefused(f"{name}: {_what_is_missing(columns)}")
    row = columns[index]
    if row.width == 0:
        raise GarbledReply(f"{name}: the data frame table describes a number as {row.text!r}; ask again")
    _check_unit(name, row.label, unit)
    return Column(index, row.width, row.decimals, row.label, row.sign)


def _what_is_missing(columns: list[_Row]) -> str:
    there = {row.statistic for row in columns}
    if GAUGE_PRESSURE in there and not there & {ABSOLUTE_SETPOINT, GAUGE_SETPOINT}:
        return (
            "the data frame carries gauge pressure and no setpoint of it (statistic 038): it is no controller"
        )
    what = "absolute pressure" if there & {ABSOLUTE_PRESSURE, ABSOLUTE_SETPOINT} else "no pressure"
    return (
        f"the data frame carries {what}, not gauge pressure and its setpoint (statistics 006 and "
        "038); use a gauge controller, or set its data frame"
    )


def _check_unit(name: str, label: str, unit: PressureUnit) -> None:
    # PSIG, PSI and psig are one unit: the trailing G means gauge.
    plain = label.casefold()
    if plain not in (unit.casefold(), unit.casefold() + "g"):
        raise InstrumentRefused(
            f"{name}: the device is set to {label}, the configuration says {unit}; change the device's unit "
            "or its pressure_unit in rig.toml, so that both agree"
        )
