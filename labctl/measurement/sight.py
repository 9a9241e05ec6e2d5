"""Which markers a window shows well enough for a height, and why not the others."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.instruments.readings import MarkerFrames
from labctl.measurement.basis import Basis
from labctl.mocap.gate import GatedFrames, gate
from labctl.mocap.window import MarkerWindow, average

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sight:
    """A window's markers: `window` has no mean for those in `doubts`, which maps a marker's place (from 0) to why.

    `frames` are those of the window, with what was left out not seen; `left_out` (m,) counts it, None where every
    frame counts. `share_left_out` is of all samples of all markers.
    """

    frames: MarkerFrames
    window: MarkerWindow
    left_out: NDArray[np.int64] | None
    share_left_out: float
    doubts: Mapping[int, str]

    def doubting(self, doubts: Mapping[int, str]) -> "Sight":
        """The same with more markers that are not taken for seen; a reason that is there stays."""
        mean_mm = self.window.mean_mm.copy()
        mean_mm[list(doubts)] = np.nan
        window = replace(self.window, mean_mm=mean_mm)
        return replace(self, window=window, doubts={**doubts, **self.doubts})


def plain_sight(frames: MarkerFrames, basis: Basis) -> Sight:
    """Every frame counts."""
    return Sight(frames, average(frames, _ids(basis), basis.min_share), None, 0.0, {})


def gated_sight(frames: MarkerFrames, basis: Basis, slack_mm: ArrayLike, astray: NDArray[np.bool_]) -> Sight:
    """Single frames far from the median, and those `astray` (k, m), are left out; too many of them are a doubt."""
    gated = gate(frames, _ids(basis), slack_mm, astray)
    window = average(gated.frames, _ids(basis), basis.min_share)
    shown = int(gated.shown.sum())
    sight = Sight(
        frames=gated.frames,
        window=window,
        left_out=gated.left_out,
        share_left_out=float(gated.left_out.sum() / shown) if shown else 0.0,
        doubts={},
    )
    return sight.doubting(_unsteady(gated, basis))


def _unsteady(gated: GatedFrames, basis: Basis) -> dict[int, str]:
    doubts = {}
    for marker, (shown, left_out) in enumerate(
        zip(gated.shown.tolist(), gated.left_out.tolist(), strict=True)
    ):
        if gated.is_scattered[marker]:
            doubts[marker] = (
                f"its place scatters by {gated.scatter_mm[marker]:.1f} mm from frame to frame, so that even the "
                "median is not to be trusted"
            )
        elif left_out > basis.max_left_out * shown:
            doubts[marker] = (
                f"{left_out} of the {shown} frames that showed it are far from its median, more than "
                f"{basis.max_left_out:.0%} (measurement.max_left_out)"
            )
    return doubts


def _ids(basis: Basis) -> list[int]:
    return [point.id for point in basis.points]
