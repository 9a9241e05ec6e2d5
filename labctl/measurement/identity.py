"""Is every marker of a window still the one of the uninflated sheet, at the point that it stood for there?"""

import numpy as np
from numpy.typing import NDArray

from labctl.measurement.law import PLAIN_MEANS
from labctl.measurement.recording import Recording
from labctl.measurement.sight import Sight
from labctl.measurement.uninflated import UninflatedSheet
from labctl.mocap.places import misplaced, named, torn_off
from labctl.mocap.tracks import OFF_MM

Floats = NDArray[np.float64]


def identified(
    recording: Recording, sheet: UninflatedSheet, sight: Sight, start_s: float, end_s: float
) -> Sight:
    """What was seen from `start_s` to `end_s` without the markers that are not the baseline's any more.

    By law 1, which knows no identity, all of it. A marker is doubted where it is nearer to another point of the sheet
    than it can get, is farther from its neighbours than the sheet can stretch, or has jumped since the baseline while
    the sheet around it did not.
    """
    if recording.law == PLAIN_MEANS:
        return sight
    basis = recording.basis
    ids = [point.id for point in basis.points]
    points_mm = sheet.points_mm([(point.x_mm, point.y_mm) for point in basis.points])
    # Those that were never to be trusted must not pull the others' fit.
    trusted = [marker not in sheet.sight.doubts for marker in range(len(ids))]
    places_mm = np.where(np.array(trusted)[:, None], sheet.frame.to_sheet(sight.window.mean_mm), np.nan)
    doubts: dict[int, str] = {}
    for each in misplaced(points_mm[:, :2], places_mm[:, :2]):
        doubts[each.index] = (
            f"it is {each.off_mm:.1f} mm from where its point can be, seen from above{named(each.taken, ids)}; it "
            "changed places, or is seen in a mirror"
        )
    kept = np.array([marker not in doubts for marker in range(len(ids))])
    for each in torn_off(points_mm, np.where(kept[:, None], places_mm, np.nan)):
        doubts[each.index] = (
            f"it is {each.off_mm:.1f} mm farther from its neighbours than the sheet can stretch; look for a mirror, "
            "or a marker that came loose"
        )
    return sight.doubting({**_jumped(recording, sheet, start_s, end_s), **doubts})


def _jumped(recording: Recording, sheet: UninflatedSheet, start_s: float, end_s: float) -> dict[int, str]:
    tracks, before = recording.tracks, sheet.taken_in
    off_mm = tracks.off_between(start_s, end_s) - tracks.off_between(before.start_s, before.end_s)
    lengths_mm = np.sqrt((off_mm**2).sum(axis=1))
    return {
        int(marker): (
            f"it has jumped by {lengths_mm[marker]:.1f} mm since the uninflated sheet was captured, while the sheet "
            "around it did not; look for a mirror, a marker that came loose, or one that changed places"
        )
        for marker in np.flatnonzero(lengths_mm > OFF_MM)
    }
