"""How the simulator's inner loops are compiled: Numba, double precision, cached on disk, without the GIL."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

# Numba fills its configuration in at run time, where no type checker sees it.
_config: Any = numba.config
Kernel = TypeVar("Kernel", bound=Callable[..., object])


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
    """Compile a function at its first call, keeping its Python signature for the type checker.

    Division by zero gives infinity as in NumPy: the solvers look for it, an exception would cost every step.
    """
    before = _config.CACHE_DIR
    _config.CACHE_DIR = _FOLDER
    try:
        return cast(Kernel, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
    finally:
        _config.CACHE_DIR = before
