"""How the oracle's loops are compiled: plain scalar double precision, not cached: nothing of it can be stale."""

import numba

kernel = numba.njit(nogil=True, error_model="numpy")
