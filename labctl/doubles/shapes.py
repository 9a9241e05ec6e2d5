"""The sheet's shapes from the simulator: one ladder of equilibria for each jam state, made when needed."""

import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from labctl.config.design import Design
from labctl.config.rig import MarkerPoint
from labctl.doubles.reality_gap import RealityGap, misplaced, real_materials
from labctl.doubles.sheet import Ladder
from labctl.errors import LabError
from labctl.simulation.sheets import materials_of, sheet_with_jammed
from sim.errors import SimError
from sim.geometry import geometry
from sim.shape import Failure, Shape
from sim.sheet import Sheet
from sim.solve import solve_registered
from sim.solver import Equilibrium

RUNGS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.15)
_CLOSE_TIMEOUT_S = 30.0


class SimulatedShapes:
    """Ladders of a design with its reality gap; the same design, gap and points give the same ladders.

    Rungs are `RUNGS` of the design's rated strain, each equilibrium starting from the one below. The sheet
    lies on a table: it is raised until its lowest voxels touch it. `prepare` makes ladders at once; a
    ladder asked for later is made on a thread of its own, the most recently asked for alone: one that is
    no longer wanted is given up. A jam state that does not settle has no ladder, ever; `failures` has the reason.

    Raises:
        BadInput: a fiber that the simulator cannot place.
    """

    def __init__(self, design: Design, gap: RealityGap, points: Sequence[MarkerPoint]) -> None:
        self._geometry = geometry(design.sheet.geometry)
        self._materials = real_materials(gap, materials_of(design))
        rng = np.random.default_rng(gap.seed)
        # The design as the gap has it built.
        self._real = replace(design, fibers=misplaced(design.fibers, gap, self._geometry, rng))
        self._points_m = np.array([(point.x_mm, point.y_mm) for point in points]) / 1000
        self._ladders: dict[frozenset[str], Ladder] = {}
        self.failures: dict[frozenset[str], str] = {}
        self._changed = threading.Condition()
        self._wanted: frozenset[str] | None = None
        self._closed = False
        self._thread: threading.Thread | None = None
        self._sheet(frozenset())

    def prepare(self, states: Iterable[frozenset[str]], workers: int) -> None:
        """Make the ladders of these jam states on `workers` threads; returns when all are there.

        Raises:
            LabError: the sheet does not settle in one of them.
        """
        missing = [state for state in dict.fromkeys(states) if state not in self._ladders]
        with ThreadPoolExecutor(workers) as pool:
            for state, ladder in zip(missing, pool.map(self._make, missing), strict=True):
                self._ladders[state] = ladder

    def ladder(self, jammed: frozenset[str]) -> Ladder | None:
        """The ladder of a jam state; None while it is being made, which this call begins."""
        with self._changed:
            ladder = self._ladders.get(jammed)
            self._wanted = None if ladder is not None or jammed in self.failures else jammed
            if self._wanted is not None and self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._work, name="sheet shapes", daemon=True)
                self._thread.start()
            self._changed.notify_all()
        return ladder

    def close(self) -> None:
        """End the thread; may be called twice."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join(_CLOSE_TIMEOUT_S)

    def _work(self) -> None:
        while True:
            with self._changed:
                while self._wanted is None and not self._closed:
                    self._changed.wait()
                if self._closed or self._wanted is None:
                    return
                state = self._wanted
            try:
                ladder = self._make(state, partial(self._unwanted, state))
            except _AbandonedError:
                continue
            except (LabError, SimError) as error:
                with self._changed:
                    self.failures[state] = str(error)
                    self._wanted = None if self._wanted == state else self._wanted
                continue
            with self._changed:
                self._ladders[state] = ladder
                self._wanted = None if self._wanted == state else self._wanted

    def _unwanted(self, state: frozenset[str]) -> bool:
        return self._closed or self._wanted != state

    def _sheet(self, jammed: frozenset[str]) -> Sheet:
        return sheet_with_jammed(self._real, jammed, self._materials)

    def _make(self, jammed: frozenset[str], unwanted: Callable[[], bool] = lambda: False) -> Ladder:
        sheet = self._sheet(jammed)
        flat = np.column_stack([self._points_m * 1000, np.zeros(len(self._points_m))])
        strains, points = [0.0], [flat]
        start: Shape | None = None
        for share in RUNGS[1:]:
            if unwanted():
                raise _AbandonedError
            strain = share * self._real.sheet.rated_strain
            settled = solve_registered(sheet, Equilibrium(strain), start)
            if isinstance(settled, Failure):
                fibers = ", ".join(sorted(jammed)) or "nothing"
                raise LabError(
                    f"simulated sheet with {fibers} jammed does not settle at strain {strain:.3f}: "
                    f"{settled.reason}; lower the design's rated_strain or the reality gap"
                )
            start = settled.raw
            strains.append(strain)
            points.append(settled.points_on_table_m(self._geometry, self._points_m) * 1000)
        return Ladder(np.array(strains), np.array(points))


class _AbandonedError(Exception):
    """The ladder being made is no longer wanted."""
