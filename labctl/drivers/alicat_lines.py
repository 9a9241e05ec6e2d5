"""The lines of the Alicat ASCII protocol, written and read (serial primer; docs/reference/hardware.md).

The layout of a data frame is the device's own table's (`alicat_layout`).
"""

import re

from labctl.config.rig import PressureUnit
from labctl.drivers.alicat_firmware import find_firmware
from labctl.drivers.alicat_layout import CURSOR_BACK, SAFETY_WORDS, Column, FrameLayout
from labctl.drivers.pressure_unit import to_psi
from labctl.errors import GarbledReply
from labctl.instruments.readings import PressureReading

#: What a command begins with where GP firmware is to read it.
GP_PREFIX = "$$"
END_OF_STREAM = "@@="

_COMMAND = re.compile(r"[A-Z](?:[A-Z?][ -~]*|\$\$[A-Z][ -~]*)?")
_BARE_SETPOINT = re.compile(r"[A-Z](?:\$\$)?L?S\s*[+-]?\d+")
_STATUS_WORD = re.compile(r"(?=.*[A-Z])[A-Z0-9]{3}")
_STREAMED = re.compile(rb"(?:@| ) *[+-]?\d")


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


def end_of_stream_line(unit_id: str) -> bytes:
    """The bytes that give a streaming device, whose unit id is @, its unit id back."""
    return (END_OF_STREAM + unit_id).encode("ascii") + b"\r"


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


def is_of_unit(line: str, unit_id: str) -> bool:
    """The line is this unit's; some devices set no blank between their id and the first number."""
    return line[:1] == unit_id and re.fullmatch(r"(?:[ +\-.\d].*)?", line[1:]) is not None


def is_version_line(line: bytes, unit_id: str) -> bool:
    """The reply to `VE`, which no other reply looks like."""
    text = line.decode("ascii", "replace")
    if not text.startswith(f"{unit_id} "):
        return False
    firmware = find_firmware(text)
    return firmware is not None and text[1:].lstrip().startswith(firmware.text)


def is_manufacturing_line(line: bytes, unit_id: str) -> bool:
    """A line of `??M*`, which no other reply looks like."""
    return re.match(rb"%b +M\d\d? " % unit_id.encode("ascii"), line + b" ") is not None


def is_full_scale_line(line: bytes, unit_id: str, label: str) -> bool:
    """The reply to `FPF 6`: the gauge pressure's full scale, the number of its unit, and the unit's `label`."""
    words = line.decode("ascii", "replace").split()
    return len(words) == 4 and words[0] == unit_id and words[2].isdecimal() and words[3] == label


def is_streamed_line(line: bytes) -> bool:
    """A data frame of a streaming device: its unit id is @, or left out."""
    return _STREAMED.match(line) is not None


def parse_frame(name: str, line: str, layout: FrameLayout, unit: PressureUnit) -> PressureReading:
    """A reading from a data frame such as `A +003.90 +003.90 EXH`.

    Raises:
        GarbledReply: another number of columns, another format, or words that are no status.
    """
    words = [line[:1], *line[1:].split()]
    values, status = words[: layout.columns], words[layout.columns :]
    if taken := SAFETY_WORDS & set(values):
        raise GarbledReply(
            f"{name}: {line!r} has {' '.join(sorted(taken))} in a column of the device's table, where no status is; "
            "the table or the line was spoilt on its way: ask again"
        )
    if len(values) < layout.columns or not all(_STATUS_WORD.fullmatch(word) for word in status):
        raise GarbledReply(f"{name}: {line!r} is not a data frame of {layout.columns} columns; ask again")
    return PressureReading(
        gauge_psi=to_psi(_number(name, line, values, layout.pressure), unit),
        setpoint_psi=to_psi(_number(name, line, values, layout.setpoint), unit),
        status=frozenset(status),
    )


def find_fact(lines: list[str], *labels: str) -> str | None:
    """What follows the first of `labels` that is there, in the lines of `??M*`; None when no line has one."""
    for label in labels:
        for line in lines:
            _, found, value = line.replace(CURSOR_BACK, "").partition(label)
            if found and value.strip():
                return value.strip()
    return None


def _number(name: str, line: str, values: list[str], column: Column) -> float:
    word = values[column.index]
    digits = rf"\d+\.\d{{{column.decimals}}}" if column.decimals else r"\d+\.?"
    width = column.width
    if column.sign == "always":
        digits = f"[+-]{digits}"
    elif column.sign == "either":
        width -= word[:1] not in ("+", "-")
        digits = f"[+-]?{digits}"
    # A lost or doubled character would still be a number: the width is what shows it.
    if len(word) != width or not re.fullmatch(digits, word):
        signed = {"always": "a signed number", "never": "a number without sign", "either": "a number"}
        raise GarbledReply(
            f"{name}: {word!r} in {line!r} is not {signed[column.sign]} of {width} characters with "
            f"{column.decimals} decimals, as the device's own table says; ask again"
        )
    return float(word)
