"""Rows whose numbers are known and whose time is chosen."""

from __future__ import annotations

import hashlib
import time
from typing import Any

import numpy as np


def nap(settings: dict[str, Any]) -> dict[str, Any]:
    """Sleeps `seconds`; numbers of every kind that depend on x alone."""
    time.sleep(settings["seconds"])
    x = int(settings["x"])
    if x % 97 == 96:
        raise ValueError(f"x = {x} is one of those that fail")
    generator = np.random.default_rng(x)
    return {
        "whole": x * x, "real": float(generator.normal()), "text": hashlib.sha256(str(x).encode()).hexdigest()[:8],
        "none": None if x % 3 else 1.0 / (x + 1), "nested": [x, {"half": x / 2}],
    }  # fmt: skip


def work(settings: dict[str, Any]) -> dict[str, Any]:
    """Computes for about 0.2 s, the same number of operations every time."""
    a = np.arange(20000.0) + settings["x"]
    for _ in range(int(settings["times"])):
        a = np.sqrt(a * a + 1.0)
    return {"sum": float(a.sum())}
