"""Numba with its first compilation behind it, which takes seconds: what `tests.forkserver.compiler` forks."""

import numpy as np
from numba import njit


@njit
def increased(x):
    return x + 1


@njit
def doubled(x):
    return 2.0 * increased(x[0])


increased(1)
doubled(np.zeros(1))
