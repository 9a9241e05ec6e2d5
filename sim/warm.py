"""Compiling the simulator's kernels ahead of their first use, and saying so."""

from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any, Protocol

import numpy as np

from sim.dynamic import dynamic, march
from sim.equilibrium import equilibrium, relax
from sim.geometry import GRID
from sim.inflation import RampAndHold
from sim.materials import EXPANDING
from sim.sheet import Sheet

ABOUT_S = 5


class _Dispatcher(Protocol):
    """What a compiled function tells about itself, in Numba's names."""

    signatures: list[object]
    py_func: FunctionType
    stats: Any


def compile_kernels(say: Callable[[str], None]) -> None:
    """Make both solvers ready to run: compiled on this machine's first use, read from the disk after that.

    Calls `say` with one line before a wait for the compiler, and not otherwise.
    """
    kernels: tuple[Any, ...] = (march, relax)
    if not all(map(_is_cached, kernels)):
        say(f"compiling the sheet simulator, once per machine, about {ABOUT_S} s")
    material = np.zeros(GRID, np.int8)
    material[0, 0, :2] = EXPANDING
    pair = Sheet(material)
    dynamic(pair, RampAndHold(strain=0.0, read_at_s=1e-4))
    equilibrium(pair, 0.0)


def _is_cached(compiled: _Dispatcher) -> bool:
    """Whether a kernel is compiled in this process or on this machine's disk.

    The cache folder belongs to exactly these sources, so an index there is one that counts.
    """
    if compiled.signatures:
        return True
    function = compiled.py_func
    index = f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}-*.nbi"
    return any(Path(compiled.stats.cache_path).glob(index))
