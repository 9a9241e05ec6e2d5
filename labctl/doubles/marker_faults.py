"""What marker systems show that is not so: wrong places with a good condition, changed identities, ghosts.

Kinds as users of such systems report them: places at the origin, reflections, ids that are exchanged when markers
come near each other, one id twice in a frame, records of ids that no marker has.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labctl.config.rig import MarkerPoint
from labctl.doubles.faults import Fault, FaultPanel

VISIBLE_COND = 2.0
HIDDEN_COND = -1.0
GARBAGE_MM = 3000.0
#: A burst begins so often; while it lasts the marker is so far off, along any direction.
BURST_EVERY_S = 2.0
BURST_MM = (20.0, 200.0)
#: Ids of ghosts begin here.
GHOST_ID = 900_000


@dataclass(frozen=True)
class MarkerBatch:
    """Frames in the order of their times.

    `times_s` (k,); `numbers` (k,) counting every frame from 0, sent or not; `positions_mm` (k, n, 3) in the
    laboratory's frame; `cond` (k, n), at most 0 where a marker is hidden and its position garbage; `ids` (k, n).
    """

    times_s: NDArray[np.float64]
    numbers: NDArray[np.int64]
    positions_mm: NDArray[np.float64]
    cond: NDArray[np.float64]
    ids: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.times_s)


class MarkerFaults:
    """The faults of a panel on markers, frame by frame; what is random is drawn in the frames' order."""

    def __init__(self, panel: FaultPanel, points: Iterable[MarkerPoint], rng: np.random.Generator) -> None:
        self._panel = panel
        self._column = {point.id: column for column, point in enumerate(points)}
        self._rng = rng
        self._swapped_s: dict[Fault, float] = {}
        self._bursts: dict[Fault, tuple[int, NDArray[np.float64]]] = {}

    def shown(self, batch: MarkerBatch) -> MarkerBatch:
        """The frames as the faults that have begun show them."""
        if not len(batch):
            return batch
        positions_mm, cond = batch.positions_mm.copy(), batch.cond.copy()
        for fault in self._panel.all_active("swapped"):
            self._swap(fault, batch.times_s, positions_mm, cond)
        for fault in self._panel.all_active("mirrored"):
            positions_mm[:, self._columns(fault), 2] += fault.value
        for fault in self._panel.all_active("burst"):
            self._burst(fault, batch.times_s, positions_mm)
        for kind in ("outliers", "scattered", "not-a-number"):
            for fault in self._panel.all_active(kind):
                self._misplace(fault, positions_mm, cond)
        for fault in self._panel.all_active("hidden"):
            self._hide(fault, positions_mm, cond)
        wrong = replace(batch, positions_mm=positions_mm, cond=cond)
        for fault in self._panel.all_active("twice"):
            wrong = self._twice(fault, wrong)
        for fault in self._panel.all_active("ghosts"):
            wrong = self._ghosts(fault, wrong)
        return wrong

    def _columns(self, fault: Fault) -> list[int]:
        return [self._column[each] for each in fault.ids or [next(iter(self._column))]]

    def _swap(
        self,
        fault: Fault,
        times_s: NDArray[np.float64],
        positions_mm: NDArray[np.float64],
        cond: NDArray[np.float64],
    ) -> None:
        since_s = self._swapped_s.setdefault(fault, float(times_s[0]))
        rows = (times_s < since_s + fault.value) if fault.value else np.ones(len(times_s), dtype=bool)
        columns = np.array(self._columns(fault))
        taken = np.roll(columns, -1)
        at = np.flatnonzero(rows)[:, None]
        positions_mm[at, columns], cond[at, columns] = positions_mm[at, taken], cond[at, taken]

    def _burst(self, fault: Fault, times_s: NDArray[np.float64], positions_mm: NDArray[np.float64]) -> None:
        within = times_s % BURST_EVERY_S < fault.value
        for number in np.unique(np.floor(times_s[within] / BURST_EVERY_S)).astype(int).tolist():
            rows = within & (np.floor(times_s / BURST_EVERY_S) == number)
            columns = self._columns(fault)
            if fault not in self._bursts or self._bursts[fault][0] != number:
                self._bursts[fault] = (number, self._away_mm(len(columns)))
            positions_mm[np.flatnonzero(rows)[:, None], columns] += self._bursts[fault][1]

    def _away_mm(self, count: int) -> NDArray[np.float64]:
        """So many ways (count, 3) off, each in a direction of its own."""
        directions = self._rng.standard_normal((count, 3))
        lengths_mm = self._rng.uniform(*BURST_MM, (count, 1))
        away_mm: NDArray[np.float64] = (
            lengths_mm * directions / np.sqrt((directions**2).sum(axis=1, keepdims=True))
        )
        return away_mm

    def _misplace(self, fault: Fault, positions_mm: NDArray[np.float64], cond: NDArray[np.float64]) -> None:
        columns = self._columns(fault)
        hit = self._hit(fault, (len(positions_mm), len(columns)))
        places_mm: NDArray[np.float64] = np.zeros((*hit.shape, 3))
        if fault.kind == "scattered":
            places_mm = self._rng.uniform(-GARBAGE_MM, GARBAGE_MM, places_mm.shape)
        elif fault.kind == "not-a-number":
            places_mm[:] = self._rng.choice([np.nan, np.inf, -np.inf], places_mm.shape)
        some_mm, some_cond = positions_mm[:, columns], cond[:, columns]
        some_mm[hit], some_cond[hit] = places_mm[hit], VISIBLE_COND
        positions_mm[:, columns], cond[:, columns] = some_mm, some_cond

    def _hide(self, fault: Fault, positions_mm: NDArray[np.float64], cond: NDArray[np.float64]) -> None:
        for column in self._columns(fault):
            hit = self._hit(fault, cond[:, column].shape)
            cond[hit, column] = HIDDEN_COND
            positions_mm[hit, column] = self._rng.uniform(-GARBAGE_MM, GARBAGE_MM, (int(hit.sum()), 3))

    def _twice(self, fault: Fault, batch: MarkerBatch) -> MarkerBatch:
        columns = self._columns(fault)
        hit = self._hit(fault, (len(batch), len(columns)))
        # A record that is not a second one has to be somebody's.
        ids = np.where(hit, batch.ids[:, columns], GHOST_ID + np.arange(len(columns)))
        return self._with_records(batch, ids)

    def _ghosts(self, fault: Fault, batch: MarkerBatch) -> MarkerBatch:
        ids = np.broadcast_to(GHOST_ID + 100 + np.arange(int(fault.value)), (len(batch), int(fault.value)))
        return self._with_records(batch, ids)

    def _with_records(self, batch: MarkerBatch, ids: NDArray[np.int64]) -> MarkerBatch:
        """The batch with records of `ids` (k, g) at places near the sheet."""
        middle_mm = np.nanmedian(batch.positions_mm.reshape(-1, 3), axis=0)
        places_mm = middle_mm + self._rng.uniform(-BURST_MM[1], BURST_MM[1], (*ids.shape, 3))
        return replace(
            batch,
            positions_mm=np.concatenate([batch.positions_mm, places_mm], axis=1),
            cond=np.concatenate([batch.cond, np.full(ids.shape, VISIBLE_COND)], axis=1),
            ids=np.concatenate([batch.ids, ids], axis=1),
        )

    def _hit(self, fault: Fault, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        hit: NDArray[np.bool_] = self._rng.random(shape) < fault.value / 100
        return hit
