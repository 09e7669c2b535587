"""Flush subnormal numbers to zero while a block is computed.

A vibration that fades for minutes ends among the subnormal numbers (below 2.2e−308), where one product costs
as much as twenty-five ordinary ones. Processors can treat them as zero instead. That switch belongs to the
thread, so native code that renders sets it on entry and puts back what it found on exit: the host's
arithmetic is not ours to change.

==========  ==========================================================================
x86         MXCSR: FTZ (results become zero) and DAZ (operands count as zero)
AArch64     FPCR: FZ (both)
elsewhere   no such switch is known; nothing happens, and pruning is the only guard
==========  ==========================================================================

Both functions may be called from jitted code and from Python, where they act on the calling thread. The
compiler knows nothing of the switch and may move plain arithmetic across it: keep the work in a loop over
arrays, or in a function of its own, between the two calls::

    previous = enable_ftz()
    render(state, out)
    restore(previous)

Python has `with flushed():` for the same.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import llvmlite.binding
from llvmlite import ir
from numba import config, njit, types
from numba.extending import intrinsic

_MXCSR_FTZ_DAZ = 0x8040
_FPCR_FZ = 1 << 24

_I32 = ir.IntType(32)
_I64 = ir.IntType(64)


def machine() -> str:
    """'x86', 'aarch64' or '' for the processor that jitted code of this process runs on."""
    name = llvmlite.binding.get_process_triple().split("-", 1)[0].lower()
    if name in ("x86_64", "amd64", "i386", "i486", "i586", "i686"):
        return "x86"
    return "aarch64" if name.startswith(("aarch64", "arm64")) else ""


def _declare(builder, name, result, arguments):
    module = builder.module
    if name in module.globals:
        return module.globals[name]
    return ir.Function(module, ir.FunctionType(result, arguments), name)


def _mxcsr_access(builder, name, slot):
    pointer = ir.IntType(8).as_pointer()
    function = _declare(builder, name, ir.VoidType(), [pointer])
    builder.call(function, [builder.bitcast(slot, pointer)])


@intrinsic
def _read_control(typingctx):
    """The floating-point control register of this thread, as int64."""

    def generate(context, builder, signature, arguments):
        kind = machine()
        if kind == "x86":
            slot = builder.alloca(_I32)
            _mxcsr_access(builder, "llvm.x86.sse.stmxcsr", slot)
            return builder.zext(builder.load(slot), _I64)
        if kind == "aarch64":
            return builder.call(_declare(builder, "llvm.aarch64.get.fpcr", _I64, []), [])
        return _I64(0)

    return types.int64(), generate


@intrinsic
def _write_control(typingctx, value):
    def generate(context, builder, signature, arguments):
        kind = machine()
        if kind == "x86":
            slot = builder.alloca(_I32)
            builder.store(builder.trunc(arguments[0], _I32), slot)
            _mxcsr_access(builder, "llvm.x86.sse.ldmxcsr", slot)
        elif kind == "aarch64":
            builder.call(_declare(builder, "llvm.aarch64.set.fpcr", ir.VoidType(), [_I64]), [arguments[0]])
        return context.get_dummy_value()

    return types.void(types.int64), generate


# Without the JIT (NUMBA_DISABLE_JIT) the intrinsics cannot run either.
_JIT_DISABLED = config.DISABLE_JIT  # type: ignore[attr-defined]
_FLUSH_BITS = 0 if _JIT_DISABLED else {"x86": _MXCSR_FTZ_DAZ, "aarch64": _FPCR_FZ}.get(machine(), 0)

SUPPORTED = _FLUSH_BITS != 0
"""Whether :func:`enable_ftz` has an effect on this processor and in this process."""


@njit(cache=True, nogil=True)
def enable_ftz():
    """Flush subnormals to zero in this thread. Returns the register as it was, for :func:`restore`."""
    if _FLUSH_BITS == 0:
        return 0
    previous = _read_control()  # type: ignore
    _write_control(previous | _FLUSH_BITS)
    return previous


@njit(cache=True, nogil=True)
def restore(previous):
    """Put back the control register that :func:`enable_ftz` returned."""
    if _FLUSH_BITS != 0:
        _write_control(previous)  # type: ignore


@contextmanager
def flushed() -> Iterator[None]:
    """Subnormals flush to zero in this thread as long as the block runs."""
    previous = enable_ftz()
    try:
        yield
    finally:
        restore(previous)
