"""How the simulator's inner loops are compiled: Numba, cached on disk, without the GIL.

No fused multiply-add and no reordered sum: a result is the same, bit for bit, whatever the width of the
machine's vectors. Constants are np.float32 values that are exact in single precision, so that they take the
precision of whatever they are combined with.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeVar, cast, get_args

import numba
import numpy as np

from sim.errors import SimError

# Numba fills its configuration in at run time, where no type checker sees it.
_config: Any = numba.config
Kernel = TypeVar("Kernel", bound=Callable[..., object])

Precision = Literal["float32", "float64"]
# A type checker takes a number of either precision for a float.
ZERO, HALF, ONE, TWO, FOUR = (cast(float, np.float32(number)) for number in (0.0, 0.5, 1.0, 2.0, 4.0))


def real_of(precision: Precision) -> type[float]:
    """The type of a precision's numbers.

    Raises:
        SimError: there is none of that name.
    """
    if precision not in get_args(Precision):
        raise SimError(f"unknown precision {precision!r}: use {' or '.join(map(repr, get_args(Precision)))}")
    return cast(type[float], np.dtype(precision).type)


def _cache_folder() -> Path | None:
    """The cache folder of exactly these sources; None where no folder can be written to.

    Numba notices a change of a kernel's own file, but not of the functions that it calls from other files:
    an edited link law would keep running as it was. So the folder is named by the whole package's text.
    """
    package = Path(__file__).parent
    text = hashlib.sha256()
    for source in sorted(package.glob("*.py")):
        text.update(source.read_bytes())
    for base in (
        os.environ.get("NUMBA_CACHE_DIR"),
        package / "__pycache__",
        Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "labctl",
    ):
        folder = Path(base or package / "__pycache__") / f"kernels-{text.hexdigest()[:12]}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return None


KERNEL_FOLDER = _cache_folder()


def kernel(function: Kernel) -> Kernel:
    """Compile a loop at its first call, once for each precision, keeping its signature for the type checker.

    Division by zero gives infinity as in NumPy: the solvers look for it, an exception would cost every step.
    """
    cached = KERNEL_FOLDER is not None
    before = _config.CACHE_DIR
    _config.CACHE_DIR = str(KERNEL_FOLDER) if cached else before
    try:
        return cast(Kernel, numba.njit(cache=cached, nogil=True, error_model="numpy")(function))
    finally:
        _config.CACHE_DIR = before


def inlined(function: Kernel) -> Kernel:
    """Compile a function into the loops that call it: only then can the compiler vectorise them."""
    return cast(Kernel, numba.njit(forceinline=True, nogil=True, error_model="numpy")(function))
