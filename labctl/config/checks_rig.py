"""What the keys of rig.toml mean together, across its tables.

These look at the file as TOML has it, so that they speak up even where another key is wrong; a value that
the schema refuses already is passed over here.
"""

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from labctl.config.errors import Problem
from labctl.config.quantity import LENGTH
from labctl.config.rules import Quantity, Range, Whole, read_or_none
from labctl.config.source import Document
from labctl.config.validate import problem_at

FEWEST_POINTS = 4
# Two markers cannot sit closer than this, nor show which way the sheet lies from a strip narrower than it.
SAME_PLACE_MM = 1.0


@dataclass(frozen=True)
class _Point:
    index: int
    id: int | None
    place_mm: tuple[float, float] | None


def rig_problems(document: Document) -> list[Problem]:
    """Every mistake that shows only when keys are seen together."""
    return [
        *_missing_addresses(document),
        *_shared_port(document),
        *_no_way_to_vent(document),
        *_modbus_keys_elsewhere(document),
        *_repeated_points(document),
        *_too_little_spread(document),
    ]


def _missing_addresses(document: Document) -> Iterator[Problem]:
    """A simulated rig brings its own instruments, and so their addresses; a real one must name them."""
    if document.table.get("simulated", False) is not False:
        return
    transport = _section(document, "valves").get("transport")
    valves_key = {"rtu": "port", "tcp": "host"}.get(transport) if isinstance(transport, str) else None
    for section, key in (
        ("regulator", "port"),
        ("valves", valves_key),
        ("markers", "host"),
        ("gauge", "port"),
    ):
        if key is not None and section in document.table and key not in _section(document, section):
            because = f' with transport = "{transport}"' if section == "valves" else ""
            yield problem_at(document, (section, key), f"is missing{because}; a real rig needs its address")


def _shared_port(document: Document) -> Iterator[Problem]:
    serial = ["regulator"]
    if _section(document, "valves").get("transport") == "rtu":
        serial.append("valves")
    serial.append("gauge")
    ports = [(section, _section(document, section).get("port")) for section in serial]
    taken: list[tuple[str, str]] = []
    for section, port in ports:
        if not isinstance(port, str) or not port:
            continue
        other = next((name for name, theirs in taken if _same_device(theirs, port)), None)
        if other is not None:
            theirs = _section(document, other)["port"]
            message = f'is the port of {other}.port = "{theirs}" too; give each instrument its own'
            yield problem_at(document, (section, "port"), message)
        taken.append((section, port))


def _same_device(one: str, other: str) -> bool:
    # /dev/serial/by-id/... are links to /dev/ttyUSB...
    try:
        return os.path.realpath(one) == os.path.realpath(other)
    except (OSError, ValueError):
        return one == other


def _no_way_to_vent(document: Document) -> Iterator[Problem]:
    if _section(document, "regulator").get("model") != "PC" or "valves" not in document.table:
        return
    if "dump_channel" not in _section(document, "valves"):
        yield problem_at(
            document,
            ("regulator", "model"),
            "hold-closed is not vent: a single-valve PC cannot exhaust; "
            "buy a PCD or add a normally-open dump valve (valves.dump_channel)",
        )


def _modbus_keys_elsewhere(document: Document) -> Iterator[Problem]:
    reasons = {
        "pressure_unit_proven": "the device tells its unit itself over ASCII, and it is compared",
        "word_order": "ASCII has no words",
    }
    for section in ("regulator", "gauge"):
        instrument = _section(document, section)
        if instrument.get("driver") != "alicat-ascii":
            continue
        for key, reason in reasons.items():
            if key in instrument:
                yield problem_at(
                    document, (section, key), f'is for driver = "alicat-modbus" only ({reason}); leave it out'
                )


def _repeated_points(document: Document) -> Iterator[Problem]:
    seen: list[_Point] = []
    for point in _points(document):
        path = ("markers", "points", point.index)
        for earlier in seen:
            if point.id is not None and point.id == earlier.id:
                yield problem_at(document, (*path, "id"), f"is the id of point #{earlier.index + 1} too")
            if (
                point.place_mm is not None
                and earlier.place_mm is not None
                and math.dist(point.place_mm, earlier.place_mm) < SAME_PLACE_MM
            ):
                x, y = point.place_mm
                message = f"({x:g}, {y:g}) mm is the place of point #{earlier.index + 1} too"
                yield problem_at(document, path, message)
        seen.append(point)


def _too_little_spread(document: Document) -> Iterator[Problem]:
    points = _section(document, "markers").get("points")
    path = ("markers", "points")
    if not isinstance(points, list):
        return
    if len(points) < FEWEST_POINTS:
        yield problem_at(
            document, path, f"has {len(points)} points; the sheet's frame needs at least {FEWEST_POINTS}"
        )
        return
    places = [point.place_mm for point in _points(document)]
    known = [place for place in places if place is not None]
    if len(known) == len(points) and _off_line_mm(known) < SAME_PLACE_MM:
        yield problem_at(document, path, "all lie on one line; the sheet's frame needs points beside it")


def _off_line_mm(places: list[tuple[float, float]]) -> float:
    """The root mean square distance of places from the straight line that fits them best."""
    count = len(places)
    mean_x, mean_y = sum(x for x, _ in places) / count, sum(y for _, y in places) / count
    xx = sum((x - mean_x) ** 2 for x, _ in places) / count
    yy = sum((y - mean_y) ** 2 for _, y in places) / count
    xy = sum((x - mean_x) * (y - mean_y) for x, y in places) / count
    smaller = (xx + yy) / 2 - math.hypot((xx - yy) / 2, xy)
    return math.sqrt(max(0.0, smaller))


def _points(document: Document) -> Iterator[_Point]:
    points = _section(document, "markers").get("points")
    marker_id, length = Whole(0, 2**31 - 1), Quantity(LENGTH, Range())
    for index, point in enumerate(points if isinstance(points, list) else []):
        if not isinstance(point, Mapping):
            continue
        x, y = (read_or_none(length, point.get(axis)) for axis in "xy")
        place = None if x is None or y is None else (x, y)
        yield _Point(index, read_or_none(marker_id, point.get("id")), place)


def _section(document: Document, name: str) -> Mapping[str, Any]:
    section = document.table.get(name)
    return section if isinstance(section, Mapping) else {}
