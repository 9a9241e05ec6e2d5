"""The stretches of a recording that a trial's numbers come from, marked by the protocol's steps."""

from dataclasses import dataclass
from typing import Literal

WindowKind = Literal["baseline", "level", "relaxing"]


@dataclass(frozen=True)
class Window:
    """From `start_s` to `end_s` on the laboratory's clock.

    "baseline": the uninflated sheet, which fixes the sheet frame; "level": held at `pressure_psi`; "relaxing": after
    venting. `pressure_psi` is the nominal gauge pressure of a level, None for the others.
    """

    kind: WindowKind
    start_s: float
    end_s: float
    pressure_psi: float | None = None
