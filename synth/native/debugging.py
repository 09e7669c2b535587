"""JAWARI_DEBUG=1 in the environment: kernels run as the Python that they are written in (`interpreted`)."""

from __future__ import annotations

import os

#: whether this process interprets its kernels; decided before Numba is imported
INTERPRETED = os.environ.get("JAWARI_DEBUG", "") not in ("", "0")
if INTERPRETED:
    os.environ["NUMBA_DISABLE_JIT"] = "1"
