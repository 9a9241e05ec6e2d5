"""How the simulator's inner loops are compiled: Numba, cached on disk, without the GIL.

No fused multiply-add and no reordered sum: a result is the same, bit for bit, whatever the width of the
machine's vectors. Constants are np.float32 values that are exact in single precision, so that they take the
precision of whatever they are combined with.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

import numba
import numpy as np

# Numba fills its configuration in at run time, where no type checker sees it.
_config: Any = numba.config
Kernel = TypeVar("Kernel", bound=Callable[..., object])

Precision = Literal["float32", "float64"]
# A type checker takes a number of either precision for a float.
ZERO, HALF, ONE, TWO, FOUR = (cast(float, np.float32(number)) for number in (0.0, 0.5, 1.0, 2.0, 4.0))


def real_of(precision: Precision) -> type[float]:
    """The type of a precision's numbers."""
    return cast(type[float], np.dtype(precision).type)


def _cache_folder() -> str:
    """The cache folder of exactly these sources; Numba's own choice where the package cannot be written to.

    Numba notices a change of a kernel's own file, but not of the functions that it calls from other files:
    an edited link law would go on running as it was. So the folder is named by the whole package's text.
    """
    package = Path(__file__).parent
    if os.environ.get("NUMBA_CACHE_DIR") or not os.access(package, os.W_OK):
        return str(_config.CACHE_DIR)
    text = hashlib.sha256()
    for source in sorted(package.glob("*.py")):
        text.update(source.read_bytes())
    return str(package / "__pycache__" / f"kernels-{text.hexdigest()[:12]}")


_FOLDER = _cache_folder()


def kernel(function: Kernel) -> Kernel:
    """Compile a loop at its first call, once for each precision, keeping its signature for the type checker.

    Division by zero gives infinity as in NumPy: the solvers look for it, an exception would cost every step.
    """
    before = _config.CACHE_DIR
    _config.CACHE_DIR = _FOLDER
    try:
        return cast(Kernel, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
    finally:
        _config.CACHE_DIR = before


def inlined(function: Kernel) -> Kernel:
    """Compile a function into the loops that call it: only then can the compiler vectorise them."""
    return cast(Kernel, numba.njit(forceinline=True, nogil=True, error_model="numpy")(function))
