"""`--bits portable`: sound that is the same to the bit on every processor.

The command starts itself anew with the portable native library (`plugin.one_rounding`) and with all that prepares presets,
the packages and the C library included, held to instructions that every x86-64 processor has.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

from synth.cli.common import warner
from synth.plugin.platforms import BITS

#: instructions that the C library's exp, sin, … may take where a processor has them, by the names of its versions
_INSTRUCTIONS = ("AVX", "AVX2", "FMA", "FMA4", "AVX_Usable", "AVX2_Usable", "FMA_Usable", "FMA4_Usable")
#: the plainest kernels of OpenBLAS, and one thread: a product's sums are then in one order
_OPENBLAS = {"OPENBLAS_CORETYPE": "Prescott", "OPENBLAS_NUM_THREADS": "1"}
#: settings for other kernels than a library has, and for instructions of the packages
_LEFT_OUT = ("NUMBA_DISABLE_JIT", "NUMBA_BOUNDSCHECK", "NPY_ENABLE_CPU_FEATURES")


def add_bits(group: Any) -> None:
    """The option of commands that render; the parser itself, or a group of it."""
    group.set_defaults(renders=True)
    group.add_argument(
        "--bits",
        choices=BITS,
        default=BITS[0],
        help="fast (default): the processor's own instructions; portable: the same bits on every processor, slower",
    )


def settle(options: argparse.Namespace, arguments: Sequence[str], ends: bool) -> int | None:
    """Start the command anew where its options ask for portable bits and this process computes others.

    ends: the process ends with the command, and may become the new one. None: this process does the work; else the exit code
    of the one that did. Raises ValueError where portable bits cannot be had, OSError.
    """
    from synth.jit import prebuilt

    if not getattr(options, "renders", False):
        return None
    if prebuilt.bits() == "portable":
        options.bits = "portable"
    if options.bits == "fast" or (prebuilt.bits() == "portable" and os.environ.get("JAWARI_NATIVE")):
        return None
    environment = _environment(warner(getattr(options, "quiet", False)))
    sys.stdout.flush()
    if ends:
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], environment)
    return subprocess.run([sys.executable, "-m", "synth", *arguments], env=environment, check=False).returncode


def _environment(say: Callable[[str], None] | None) -> dict[str, str]:
    """That of a process whose bits are portable."""
    import numpy._core._multiarray_umath as umath  # type: ignore[import-not-found]

    from synth.jit import kernel_cache
    from synth.plugin import retarget, shelf
    from synth.plugin.platforms import host

    target = host()
    if target is None or target.name != "linux-x86-64":
        raise ValueError(
            "--bits portable prepares presets on Linux on x86-64 only; a plugin or page that was exported there with "
            "--bits portable gives the same bits on every system"
        )
    tunables = [os.environ.get("GLIBC_TUNABLES", ""), "glibc.cpu.hwcaps=" + ",".join(f"-{each}" for each in _INSTRUCTIONS)]
    environment = {name: value for name, value in kernel_cache.environment().items() if name not in _LEFT_OUT} | _OPENBLAS
    environment |= {
        "JAWARI_NATIVE": os.fspath(shelf.library_for(target, "portable", say)),
        "JAWARI_BITS": "portable",
        "JAWARI_LANES": str(retarget.FROM_LANES),
        "NUMBA_CPU_NAME": retarget.FROM_LEVEL,
        "NUMBA_CPU_FEATURES": "",
        "NPY_DISABLE_CPU_FEATURES": " ".join(umath.__cpu_dispatch__),
        "GLIBC_TUNABLES": ":".join(filter(None, tunables)),
    }
    return environment
