"""A reality gap from text: "none", or "jammed=0.85"."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from labctl.doubles.reality_gap import NO_GAP, RealityGap
from labctl.errors import BadInput

_FIELDS = {
    "passive": "passive_factor",
    "expanding": "expanding_factor",
    "jammed": "jammed_factor",
    "unjammed": "unjammed_factor",
    "ends": "end_sd_mm",
    "seed": "seed",
}


def parse_gap(texts: Iterable[str]) -> RealityGap:
    """A reality gap from texts; later ones win, "none" closes the gap for those before it.

    Raises:
        BadInput: a text that is neither "none" nor NAME=VALUE with a known name and a usable value.
    """
    gap = RealityGap()
    for text in texts:
        name, _, value = text.partition("=")
        if text == "none":
            gap = NO_GAP
            continue
        if name not in _FIELDS:
            raise BadInput(f"reality gap {text!r}: use 'none' or NAME=VALUE with {', '.join(_FIELDS)}")
        try:
            change: dict[str, Any] = {_FIELDS[name]: int(value) if name == "seed" else float(value)}
        except ValueError as error:
            raise BadInput(f"reality gap {text!r}: {value!r} is not a number") from error
        gap = replace(gap, **change)
    return gap
