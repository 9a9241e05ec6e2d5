"""Compiling the simulator's kernels ahead of their first use, and saying so."""

import threading
from collections.abc import Callable

import numpy as np

from sim.geometry import GRID
from sim.inflation import RampAndHold
from sim.kernel import Precision
from sim.materials import EXPANDING
from sim.sheet import Sheet
from sim.solver import Dynamic, Equilibrium, SolverName

ABOUT_S = 8
# Reading a compiled kernel from the disk takes a fraction of this.
_PATIENCE_S = 1.0


def compile_kernels(
    say: Callable[[str], None], solver: SolverName = "equilibrium", precision: Precision = "float32"
) -> None:
    """Make a solver ready to run: compiled on this machine's first use, read from the disk after that.

    Calls `say` with one line once the wait gets noticeable, from a thread of its own, and not otherwise.
    """
    line = f"compiling the sheet simulator, once per machine, about {ABOUT_S} s"
    timer = threading.Timer(_PATIENCE_S, say, [line])
    timer.daemon = True
    timer.start()
    try:
        material = np.zeros(GRID, np.int8)
        material[0, 0, :2] = EXPANDING
        pair = Sheet(material)
        if solver == "dynamic":
            Dynamic(RampAndHold(strain=0.0, read_at_s=1e-4), precision).solve([pair])
        else:
            Equilibrium(0.0, precision).solve([pair])
    finally:
        timer.cancel()
        timer.join()
