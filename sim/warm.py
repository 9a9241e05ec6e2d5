"""Compiling the simulator's kernels ahead of their first use, with notice."""

import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
import numpy as np

from sim.dynamic import march
from sim.equilibrium import settle
from sim.geometry import GRID
from sim.inflation import RampAndHold
from sim.kernel import KERNEL_FOLDER, Precision
from sim.materials import EXPANDING
from sim.sheet import Sheet
from sim.solver import Dynamic, Equilibrium, SolverName

ABOUT_S = 8
_COMPILE_TIMEOUT_S = 300.0
# What reading a damaged cache raises.
_DAMAGED = (EOFError, pickle.UnpicklingError, ValueError, AttributeError, ImportError)


def compile_kernels(
    notify: Callable[[str], None], solver: SolverName = "equilibrium", precision: Precision = "float32"
) -> None:
    """Make a solver ready to run: compiled on this machine's first use, read from the disk after that.

    Calls `notify` with one line before it compiles, and not otherwise. It compiles in a process of its own, whose
    memory goes back with it. Where nothing can be kept on the disk, each process compiles for itself.
    """
    if KERNEL_FOLDER is None:
        compiled: Any = march if solver == "dynamic" else settle
        if not compiled.signatures:
            notify(
                f"compiling the sheet simulator, about {ABOUT_S} s every time: set NUMBA_CACHE_DIR to keep it"
            )
        solve_a_pair(solver, precision)
        return
    # What compiled code depends on beside the sources, which name the folder.
    processor = "".join(c if c.isalnum() else "-" for c in llvmlite.binding.get_host_cpu_name())
    marker = KERNEL_FOLDER / f"{solver}-{precision}-numba-{numba.__version__}-{processor}.compiled"
    if not marker.exists():
        notify(f"compiling the sheet simulator ({solver}, {precision}), once per machine, about {ABOUT_S} s")
        _compile_apart(solver, precision)
    try:
        solve_a_pair(solver, precision)
    except _DAMAGED:
        notify(f"the compiled simulator in {KERNEL_FOLDER} is damaged: compiling it again, about {ABOUT_S} s")
        shutil.rmtree(KERNEL_FOLDER, ignore_errors=True)
        KERNEL_FOLDER.mkdir(parents=True, exist_ok=True)
        solve_a_pair(solver, precision)
    marker.touch()


def solve_a_pair(solver: SolverName, precision: Precision) -> None:
    """Solve the smallest sheet, which compiles what is not compiled."""
    material = np.zeros(GRID, np.int8)
    material[0, 0, :2] = EXPANDING
    if solver == "dynamic":
        Dynamic(RampAndHold(strain=0.0, read_at_s=1e-4), precision).solve([Sheet(material)])
    else:
        Equilibrium(0.0, precision).solve([Sheet(material)])


def _compile_apart(solver: SolverName, precision: Precision) -> None:
    """Fill the cache from another process; should that fail, this one compiles for itself."""
    root = str(Path(__file__).parents[1])
    code = (
        f"import sys; sys.path.insert(0, {root!r}); "
        f"from sim.warm import solve_a_pair; solve_a_pair({solver!r}, {precision!r})"
    )
    try:
        subprocess.run(  # noqa: S603 this interpreter on this package
            [sys.executable, "-c", code],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=_COMPILE_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return
