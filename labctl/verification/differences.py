"""Two records compared number by number: where they differ, and by what."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Difference:
    """One place where a record and its recomputation differ; `where` reads like "levels[0].heights_mm[3]"."""

    where: str
    stored: Any
    recomputed: Any

    def describe(self) -> str:
        """The difference for a person; of two numbers also how far they are apart."""
        text = f"{self.where}: stored {self.stored!r}, recomputed {self.recomputed!r}"
        if _is_number(self.stored) and _is_number(self.recomputed):
            text += f" ({self.recomputed - self.stored:+.3g})"
        return text


def differences(stored: object, recomputed: object, where: str = "") -> tuple[Difference, ...]:
    """Every place where two JSON values differ, to the last bit and by kind: 3 is not 3.0."""
    if isinstance(stored, Mapping) and isinstance(recomputed, Mapping):
        found: list[Difference] = []
        for key in dict.fromkeys([*stored, *recomputed]):
            inside = f"{where}.{key}" if where else str(key)
            found += differences(stored.get(key), recomputed.get(key), inside)
        return tuple(found)
    if (
        isinstance(stored, (list, tuple))
        and isinstance(recomputed, (list, tuple))
        and len(stored) == len(recomputed)
    ):
        return tuple(
            difference
            for index, (one, other) in enumerate(zip(stored, recomputed, strict=True))
            for difference in differences(one, other, f"{where}[{index}]")
        )
    if repr(stored) == repr(recomputed):
        return ()
    return (Difference(where, stored, recomputed),)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
