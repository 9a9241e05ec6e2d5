"""The sheet frame as the markers fix it: from the instrument's coordinates to the sheet's.

Sheet frame: origin at the lower-left corner of the sheet's bounding square seen from the top face, x to the
right, y up the page, z out of the top face; z = 0 is the uninflated sheet.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from labctl.config.rig import Axis
from labctl.mocap.errors import FrameRefused

FEWEST_MARKERS = 4
MAX_RESIDUAL_MM = 4.0
MAX_TILT_DEG = 30.0
# Markers that lie this close to one line leave the turn about it open.
MIN_SPREAD_MM = 1.0
# A length unit that is wrong is off by far more; a sheet that was laid out badly by less.
SCALE_TOLERANCE = 0.2

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SheetFrame:
    """A rigid motion from the instrument's frame to the sheet's: `rotation` (3, 3) @ lab + `translation_mm`.

    `translation_mm` is (3,); `residual_rms_mm` is the root mean square distance between the markers that
    fixed the motion and their sheet points.
    """

    rotation: Floats
    translation_mm: Floats
    residual_rms_mm: float

    def to_sheet(self, lab_mm: ArrayLike) -> Floats:
        """Positions (..., 3) of the instrument's frame in the sheet's, in mm; NaN stays NaN."""
        return np.asarray(lab_mm, dtype=np.float64) @ self.rotation.T + self.translation_mm


def fit_sheet_frame(
    ids: Sequence[int],
    sheet_mm: ArrayLike,
    baseline_mm: ArrayLike,
    up: Axis,
    max_residual_mm: float = MAX_RESIDUAL_MM,
    max_tilt_deg: float = MAX_TILT_DEG,
) -> SheetFrame:
    """The rigid motion that lays the uninflated markers onto their sheet points, by least squares (Kabsch).

    Args:
        ids: the m markers.
        sheet_mm: their points of the uninflated sheet, (m, 2) in the sheet frame.
        baseline_mm: where they were on the uninflated sheet, (m, 3) in the instrument's frame; NaN: not seen.
        up: the instrument's axis that points away from the table.
        max_residual_mm: the largest root mean square residual that is accepted.
        max_tilt_deg: the largest angle between the sheet's normal and `up` that is accepted.

    Raises:
        FrameRefused: fewer than 4 markers seen, all on one line, not in the shape of their sheet points, or
            the sheet's top face not up.
        ValueError: the arrays' shapes do not fit together.
    """
    points_mm, seen_mm = np.asarray(sheet_mm, dtype=np.float64), np.asarray(baseline_mm, dtype=np.float64)
    if points_mm.shape != (len(ids), 2) or seen_mm.shape != (len(ids), 3):
        raise ValueError(f"{len(ids)} ids need sheet points ({len(ids)}, 2) and baseline ({len(ids)}, 3)")
    is_seen: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(seen_mm), axis=1)
    _require_enough(ids, is_seen)
    target_mm = np.column_stack([points_mm[is_seen], np.zeros(int(is_seen.sum()))])
    lab_mm = seen_mm[is_seen]
    for name, place_mm in (("sheet points", target_mm), ("positions", lab_mm)):
        _require_spread(name, place_mm)

    target_mean_mm, lab_mean_mm = target_mm.mean(axis=0), lab_mm.mean(axis=0)
    rotation = Rotation.align_vectors(target_mm - target_mean_mm, lab_mm - lab_mean_mm)[0].as_matrix()
    translation_mm = target_mean_mm - rotation @ lab_mean_mm
    misses_mm = np.linalg.norm(lab_mm @ rotation.T + translation_mm - target_mm, axis=1)
    residual_rms_mm = float(np.sqrt(np.mean(misses_mm**2)))
    if residual_rms_mm > max_residual_mm:
        seen_ids = np.asarray(ids)[is_seen]
        raise FrameRefused(
            f"the uninflated markers are {residual_rms_mm:.2f} mm (root mean square) off their sheet points, "
            f"above the limit of {max_residual_mm:g} mm; the worst is marker {seen_ids[misses_mm.argmax()]}, "
            f"{misses_mm.max():.1f} mm off. {_likely_cause(target_mm - target_mean_mm, lab_mm - lab_mean_mm)}"
        )
    _require_top_up(rotation, up, max_tilt_deg)
    return SheetFrame(rotation, translation_mm, residual_rms_mm)


def _require_enough(ids: Sequence[int], is_seen: NDArray[np.bool_]) -> None:
    if is_seen.sum() < FEWEST_MARKERS:
        missing = ", ".join(str(marker) for marker, seen in zip(ids, is_seen, strict=True) if not seen)
        raise FrameRefused(
            f"{is_seen.sum()} of {len(ids)} markers were seen on the uninflated sheet, and the sheet frame "
            f"needs at least {FEWEST_MARKERS}; not seen: {missing or 'none'}. Clear the cameras' view of them"
        )


def _require_spread(name: str, place_mm: Floats) -> None:
    spread_mm = np.linalg.svd(place_mm - place_mm.mean(axis=0), compute_uv=False) / np.sqrt(len(place_mm))
    if spread_mm[1] < MIN_SPREAD_MM:
        raise FrameRefused(
            f"the {name} of the {len(place_mm)} markers that were seen lie on one line (within "
            f"{spread_mm[1]:.2f} mm), which leaves the sheet's tilt open; clear the view of markers beside it"
        )


def _likely_cause(target_mm: Floats, lab_mm: Floats) -> str:
    scale = float(np.linalg.norm(lab_mm) / np.linalg.norm(target_mm))
    if abs(scale - 1) > SCALE_TOLERANCE:
        return f"They span {scale:.3g} times the size of their sheet points: check markers.length_unit"
    return "Check markers.points (ids, x and y) against the sheet, and that it lies flat"


def _require_top_up(rotation: Floats, up: Axis, max_tilt_deg: float) -> None:
    normal = rotation[2]
    cosine = float(normal["xyz".index(up[1])]) * (1 if up[0] == "+" else -1)
    tilt_deg = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    if tilt_deg > max_tilt_deg:
        # A flat set of markers fits its own mirror image exactly, by lying on its face.
        raise FrameRefused(
            f"the sheet's top face points {tilt_deg:.0f} degrees away from markers.up = {up}, above the "
            f"limit of {max_tilt_deg:g}: marker ids or x and y in markers.points are mirrored or swapped, "
            "markers.up names the wrong axis, or the sheet lies face down"
        )
