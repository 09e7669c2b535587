"""The linear complementarity solvers of Siconos (Acary, Brémond, Huber, 2018) through their C interface, where installed.

On Debian and its like: apt-get install libsiconos-numerics-dev, and cffi for Python. Nothing here needs them to be
there; they are an independent implementation, to compare with.
"""

from __future__ import annotations

import ctypes.util
import time
import weakref
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: solver → its number in Siconos's lcp_cst.h and the tolerance asked of it on the scaled problem (‖min(z, w)‖/‖b‖);
#: the Newton methods go on to the end of their iterations where less is asked
SOLVERS: dict[str, tuple[int, float]] = {
    "lemke": (200, 1e-14),
    "pivot": (215, 1e-14),
    "newton-min": (208, 1e-12),
    "newton-fb": (209, 1e-12),
    "pgs": (202, 1e-13),
    "enum": (213, 1e-12),
}
#: the enumeration tries up to 2ⁿ sets
MOST_ENUMERATED = 12
MISSING = "Siconos is not installed: apt-get install libsiconos-numerics-dev (Debian, Ubuntu) and pip install cffi"
_ITERATIONS, _DONE, _TOLERANCE = 0, 1, 0  # places in its integer and real parameters
_DENSE = 0
# of each structure only the head, which is all that is read and written here
_DECLARATIONS = """
typedef struct { int size; void *M; double *q; } Problem;
typedef struct { int solver; bool ready; int integers; int *iparam; int reals; double *dparam; } Options;
void *NM_create_from_data(int storage, int rows, int columns, void *data);
void numerics_set_verbose(int verbose);
Options *solver_options_create(int solver);
void solver_options_delete(Options *options);
int linearComplementarity_driver(Problem *problem, double *z, double *w, Options *options);
void lcp_enum_init(Problem *problem, Options *options, int allocate);
void lcp_enum_reset(Problem *problem, Options *options, int free);
"""


@cache
def _library() -> tuple[Any, Any] | None:
    """(cffi's interface, the library)."""
    try:
        from cffi import FFI
    except ImportError:
        return None
    ffi = FFI()
    ffi.cdef(_DECLARATIONS)
    for name in (ctypes.util.find_library("siconos_numerics"), "libsiconos_numerics.so"):
        try:
            if name:
                return ffi, ffi.dlopen(name)
        except OSError:
            continue
    return None


def available() -> bool:
    """Whether the library and cffi are there."""
    return _library() is not None


class Siconos:
    """One of `SOLVERS` for problems of one matrix a (n, n), symmetric, positive semidefinite with a positive diagonal.

    Problems are handed over with a unit diagonal and max|b| = 1: newtons and metres differ by ten decades, and
    tolerances are absolute there. Raises RuntimeError where the library is missing or is built otherwise,
    ValueError for an unknown solver or more contacts than `MOST_ENUMERATED` for "enum".
    """

    def __init__(self, solver: str, a: Array, iterations: int = 10_000) -> None:
        found = _library()
        if found is None:
            raise RuntimeError(MISSING)
        if solver not in SOLVERS:
            raise ValueError(f"Siconos solver must be one of {', '.join(SOLVERS)}, got {solver!r}")
        n = a.shape[0]
        if solver == "enum" and n > MOST_ENUMERATED:
            raise ValueError(f"enum takes up to {MOST_ENUMERATED} contacts, got {n}; use lemke")
        self._ffi, self._lib = found
        self._unit = 1.0 / np.sqrt(np.diag(a))
        self._a = np.asfortranarray(a * np.outer(self._unit, self._unit))
        self._b, self._z, self._w = np.zeros(n), np.zeros(n), np.zeros(n)
        self._lib.numerics_set_verbose(0)
        self._options = self._lib.solver_options_create(SOLVERS[solver][0])
        weakref.finalize(self, self._lib.solver_options_delete, self._options)
        if self._options.solver != SOLVERS[solver][0] or min(self._options.integers, self._options.reals) < 4:
            raise RuntimeError("this version of Siconos lays out its solver options in an unknown way")
        self._options.iparam[_ITERATIONS] = iterations
        self._options.dparam[_TOLERANCE] = SOLVERS[solver][1]
        self._problem = self._ffi.new("Problem *")
        self._problem.size = n
        self._problem.M = self._lib.NM_create_from_data(_DENSE, n, n, self._pointer(self._a))
        self._problem.q = self._pointer(self._b)
        self._enumerates = solver == "enum"
        #: this thread's seconds of the last solve inside the library, the call included
        self.seconds = 0.0
        #: iterations or pivots of the last solve, as the library counts them
        self.iterations = 0

    def _pointer(self, array: Array) -> Any:
        return self._ffi.cast("double *", array.ctypes.data)

    def solve(self, b: Array, z: Array, warm: bool = False) -> int:
        """z (n,) of the problem with b (n,), from the z given if `warm`; Siconos's status, 0 is solved."""
        scale = float(np.abs(b).max())
        scale = scale if scale > 0.0 else 1.0
        self._b[:] = b * self._unit / scale
        self._z[:] = z / self._unit / scale if warm else 0.0
        self._w[:] = 0.0
        pointers = self._pointer(self._z), self._pointer(self._w)
        if self._enumerates:
            self._lib.lcp_enum_init(self._problem, self._options, 1)
        started = time.thread_time()
        status = self._lib.linearComplementarity_driver(self._problem, *pointers, self._options)
        self.seconds = time.thread_time() - started
        self.iterations = int(self._options.iparam[_DONE])
        if self._enumerates:
            self._lib.lcp_enum_reset(self._problem, self._options, 1)
        z[:] = self._z * self._unit * scale
        return int(status)
