"""How the words for a reality gap are read: "none", or "jammed=0.85"."""

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


def parse_gap(words: Iterable[str]) -> RealityGap:
    """A reality gap from words; those that come later win, "none" closes the gap for those before it.

    Raises:
        BadInput: a word that is neither "none" nor NAME=VALUE with a known name and a usable value.
    """
    gap = RealityGap()
    for word in words:
        name, _, text = word.partition("=")
        if word == "none":
            gap = NO_GAP
            continue
        if name not in _FIELDS:
            raise BadInput(f"reality gap {word!r}: use 'none' or NAME=VALUE with {', '.join(_FIELDS)}")
        try:
            change: dict[str, Any] = {_FIELDS[name]: int(text) if name == "seed" else float(text)}
        except ValueError as error:
            raise BadInput(f"reality gap {word!r}: {text!r} is not a number") from error
        gap = replace(gap, **change)
    return gap
