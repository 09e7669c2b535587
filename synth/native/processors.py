"""Which processors there are, and what they can do."""

from __future__ import annotations

import os
from pathlib import Path


def model(system: Path = Path("/")) -> str:
    """What the processor is called, as the system below a folder has it; empty where it does not tell."""
    try:
        lines = (system / "proc" / "cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def cores() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


#: what x86-64 processors have at each of the levels that its psABI names, beyond that of the level below
_LEVELS = {
    "x86-64-v2": ("cx16", "popcnt", "sse3", "ssse3", "sse4.1", "sse4.2"),
    "x86-64-v3": ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"),
    "x86-64-v4": ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"),
}


def level() -> str | None:
    """The highest level of x86-64 that this processor has, from v3 on ("x86-64-v3", "x86-64-v4"); None: another processor,
    or an older one. Code for a level computes the same bits on all processors that have it."""
    from llvmlite import binding

    if not binding.get_process_triple().startswith("x86_64"):
        return None
    try:
        features = binding.get_host_cpu_features()
    except RuntimeError:  # LLVM cannot tell
        return None
    found = None
    for name, needed in _LEVELS.items():
        if not all(features.get(each) for each in needed):
            break
        found = name
    return None if found == "x86-64-v2" else found
