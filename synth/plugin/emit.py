"""The engine's kernels as one object for the linker, which needs no Python.

    emit("x86-64-v3", Path("kernels.o"))
    emit("portable", Path("kernels.o"), TARGETS["macos-arm64"])

What is compiled lies in many libraries of Numba's, one for each kernel, which name each other (`jit.kernel_linking`). Here
they become one module, of which one symbol is seen: a table of functions by name, `struct kernels` of c/core.h.

A kernel is called there like a function of C: numbers are int64_t and double, an array is the address of its first element
and its extents, and what comes back is an int64_t or nothing. Numba's own way to call takes places for the result and for an
exception besides, and the wrapper that `cfunc` makes takes Python's lock; so each has a wrapper of its own.

Level and lanes are the process's (`NUMBA_CPU_NAME`, `JAWARI_LANES`): `intermediate` starts one with what a level needs, and
keeps LLVM's text of it, from which `retarget` makes objects for every target.
"""

from __future__ import annotations

import gzip
import hashlib
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from synth.files.targets import write_whole
from synth.jit.kernel_sources import sources_id, users_cache
from synth.jit.prebuilt import name_of
from synth.native import processors
from synth.plugin import retarget
from synth.plugin.platforms import TARGETS, Target

#: levels of processors, and how many lanes their vectors have
LANES: Mapping[str, int] = {"x86-64-v3": 4, "x86-64-v4": 8}
LEVELS = tuple(LANES)
#: what is made from the plainest x86-64 (`retarget`)
FOREIGN = ("aarch64", "portable", "relaxed")


class EmitError(ValueError):
    """The kernels did not become an object."""


def table_symbol(level: str) -> str:
    """The one symbol that an object has."""
    return "jawari_kernels_" + level.replace("-", "_")


def names() -> list[str]:
    """The functions of the table, for what checks that a bank names no other."""
    return [
        *(name_of(row[0]) for row in _called_by_address()),
        *(name_of(getattr(row[0], "py_func", row[0])) for row in _called_with_arrays()),
    ]


def emit(level: str, place: Path, target: Target = TARGETS["linux-x86-64"]) -> None:
    """Write the object for a level and a target. Takes a minute where the level is not kept yet.

    Raises ValueError for a level that there is not, or that the target's processor does not have, EmitError where the
    process that compiles fails.
    """
    if level not in (*LEVELS, *FOREIGN):
        raise ValueError(f"there is no level {level!r}; use one of {', '.join((*LEVELS, *FOREIGN))}")
    place.write_bytes(retarget.object_of(intermediate(level).replace(_SYMBOL, table_symbol(level)), level, target))


#: the table's name in the intermediate text, before its level is known
_SYMBOL = "jawari_kernels_of_level"


def intermediate(level: str) -> str:
    """LLVM's text of all kernels for a level, kept in the user's cache from then on. Raises EmitError."""
    name = retarget.FROM_LEVEL if level in FOREIGN else level
    kept = _kept(name)
    if kept is not None:
        try:
            return gzip.decompress(kept.read_bytes()).decode()
        except (OSError, EOFError, ValueError):  # there is none yet, or it is damaged: it is made again
            pass
    text = _compiled(level)
    if kept is not None:
        with suppress(OSError):  # where nothing can be kept, it is made again
            kept.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_whole(kept, lambda file: file.write(gzip.compress(text.encode(), 1)), 0o600)
    return text


def _kept(name: str) -> Path | None:
    """Where the text for a level of x86-64 is kept; None: there is no home directory."""
    own = hashlib.blake2b(Path(__file__).read_bytes(), digest_size=4).hexdigest()
    try:
        return users_cache() / f"native-{sources_id()}" / f"{name}-{own}.ll.gz"
    except RuntimeError:
        return None


def _compiled(level: str) -> str:
    """The text from a process that compiles for a level."""
    environment = {**os.environ, **_settings(level)}
    # the kernels of this very processor are those that Python uses, and kept; others' are kept apart
    apart = ["JAWARI_LANES"] if level == processors.level() else []
    for name in ("NUMBA_CACHE_DIR", "JAWARI_BITS", "JAWARI_DEBUG", "NUMBA_DISABLE_JIT", *apart):
        environment.pop(name, None)
    root = str(Path(__file__).resolve().parents[2])
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (root, environment.get("PYTHONPATH"))))
    done = subprocess.run(
        [sys.executable, "-m", __name__, level], env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        raise EmitError(f"the kernels for {level} could not be compiled: {last[0]}")
    return done.stdout


def _settings(level: str) -> dict[str, str]:
    """What the environment of a process that compiles for a level has."""
    name, lanes = (retarget.FROM_LEVEL, retarget.FROM_LANES) if level in FOREIGN else (level, LANES[level])
    return {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": "", "JAWARI_LANES": str(lanes), "JAWARI_NATIVE": "0"}


def _called_by_address() -> list[tuple[Callable[..., Any], int, bool]]:
    """(function, int64 that it takes, whether it answers): what banks name, and what PortAudio, JACK and tapes call."""
    from synth.dsp.body_effect import BODY
    from synth.dsp.delay_effect import DELAY
    from synth.dsp.limiter_effect import LIMITER
    from synth.engine.advance import make_steps, make_steps_of_two
    from synth.engine.board_steps import make_steps_on_boards
    from synth.engine.hands import respond
    from synth.engine.tasks import work_on
    from synth.engine.together import work_together
    from synth.engine.voices.policy import decide
    from synth.host.frames_tape import taped_together
    from synth.host.string_tape import taped_steps
    from synth.live.callback import serve_portaudio
    from synth.live.jackcallback import CALLED

    effects = [row for each in (BODY, DELAY, LIMITER) for row in ((each.process, 4, False), (each.silent, 1, True))]
    engine: list[Any] = [(each, 4, False) for each in (work_on, make_steps, work_together, make_steps_on_boards)]
    engine.append((make_steps_of_two, 5, False))
    engine += [(respond, 5, False), (decide, 1, False)]
    return [*engine, *effects, (taped_steps, 4, False), (taped_together, 4, False), (serve_portaudio, 6, True), *CALLED]


def _called_with_arrays() -> list[tuple[Any, tuple[Any, ...]]]:
    """(function, types of its arguments): what C and Python call."""
    from numba import int64

    import synth.engine.engine  # with these all kernels of an engine and of a live session are known
    import synth.live.deck
    import synth.live.jackcallback  # noqa: F401
    from synth.engine.team import take_instruments
    from synth.jit.entries import KERNELS
    from synth.native.denormals import enable_ftz, restore

    for_c = [(take_instruments, (int64, int64)), (enable_ftz, ()), (restore, (int64,))]
    return [*((each, each.arguments) for each in KERNELS), *for_c]


class _Kernel(NamedTuple):
    """A kernel as Numba has it."""

    name: str
    library: Any
    symbol: str
    arguments: tuple[Any, ...]
    result: Any


def _kernels() -> Iterator[_Kernel]:
    """All of the table, compiled or loaded."""
    from numba import types

    from synth.jit.entries import compiled

    for plain, count, answers in _called_by_address():
        made = compiled(plain, count, answers)
        symbol = made._wrapper_name.removeprefix("cfunc.")
        result = types.int64 if answers else types.void
        yield _Kernel(name_of(plain), made._library, symbol, (types.int64,) * count, result)
    for kernel, arguments in _called_with_arrays():
        kernel.compile(arguments)
        made = kernel.overloads[arguments]
        result = made.signature.return_type
        yield _Kernel(name_of(kernel.py_func), made.library, made.fndesc.llvm_func_name, arguments, result)


def _module_of(kernels: list[_Kernel]) -> Any:
    """The kernels and all that they call, linked: their functions are external under Numba's names."""
    from synth.jit.kernel_linking import library_of, part_of

    waiting = [(kernel.library, kernel.symbol) for kernel in kernels]
    wanted: set[str] = set()
    whole: Any = None
    while waiting:
        library, symbol = waiting.pop()
        if symbol in wanted:
            continue
        wanted.add(symbol)
        module = library._get_module_for_linking().clone()
        # what may be linked in twice is dropped where nothing calls it yet
        module.get_function(symbol).linkage = "external"
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
        waiting += [(library_of(each.symbol), each.symbol) for each in part_of(library).calls]
    return whole


def _table(kernels: list[_Kernel], symbol: str) -> str:
    """A module with a wrapper for each kernel, and the table of them."""
    from llvmlite import ir
    from numba.core import types
    from numba.core.registry import cpu_target

    context = cpu_target.target_context
    module = context.codegen()._create_empty_module("jawari")
    word, byte = ir.IntType(64), ir.IntType(8)
    address = byte.as_pointer()
    row = ir.LiteralStructType([address, address])
    rows = []
    for number, kernel in enumerate(kernels):
        wrapper = _wrapper(context, module, kernel, f"jawari.{number}")
        wrapper.linkage = "internal"
        text = bytearray(kernel.name.encode() + b"\0")
        name = ir.GlobalVariable(module, ir.ArrayType(byte, len(text)), f"jawari.name.{number}")
        name.global_constant, name.linkage = True, "internal"
        name.initializer = ir.Constant(name.type.pointee, text)
        rows.append(ir.Constant(row, [name.bitcast(address), wrapper.bitcast(address)]))
    listed = ir.ArrayType(row, len(rows))
    table = ir.GlobalVariable(module, ir.LiteralStructType([word, listed]), symbol)
    table.global_constant = True
    table.initializer = ir.Constant(table.type.pointee, [ir.Constant(word, len(rows)), ir.Constant(listed, rows)])
    assert all(kernel.result in (types.void, types.none, types.int64, types.boolean) for kernel in kernels)
    return str(module)


def _wrapper(context: Any, module: Any, kernel: _Kernel, name: str) -> Any:
    """A function of C's that calls a kernel; see the module's docstring."""
    from llvmlite import ir
    from numba.core import types
    from numba.np.arrayobj import make_array, populate_array

    word = ir.IntType(64)
    void = kernel.result in (types.void, types.none)
    taken: list[Any] = []
    for argument in kernel.arguments:
        array = isinstance(argument, types.Array)
        taken += [word] * (1 + argument.ndim) if array else [context.get_value_type(argument)]
    wrapper = ir.Function(module, ir.FunctionType(ir.VoidType() if void else word, taken), name)
    builder = ir.IRBuilder(wrapper.append_basic_block("entry"))
    given = iter(wrapper.args)
    values = []
    for argument in kernel.arguments:
        value = next(given)
        if isinstance(argument, types.Array):
            array = make_array(argument)(context, builder)
            shape = [next(given) for _ in range(argument.ndim)]
            size = word(context.get_abi_sizeof(context.get_data_type(argument.dtype)))
            strides = [size]
            for extent in reversed(shape[1:]):
                strides.insert(0, builder.mul(strides[0], extent))
            data = builder.inttoptr(value, array.data.type)
            populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
            value = array._getvalue()
        values.append(value)
    restype = types.none if void else kernel.result
    kind = context.call_conv.get_function_type(restype, kernel.arguments)
    called = ir.Function(module, kind, kernel.symbol)
    # an exception cannot be: kernels raise none of their own, and nobody could catch it
    _, result = context.call_conv.call_function(builder, called, restype, kernel.arguments, values)
    if void:
        builder.ret_void()
    else:
        builder.ret(result if result.type == word else builder.zext(result, word))
    return wrapper


def _text() -> str:
    """LLVM's text of all kernels as this process compiles them, with the table under the name _SYMBOL."""
    import llvmlite.binding as llvm

    from synth.jit import kernel_helpers

    kernel_helpers.compile_all("synth.engine.warmup:kernels")
    kernels = list(_kernels())
    whole = _module_of(kernels)
    table = llvm.parse_assembly(_table(kernels, _SYMBOL))
    table.data_layout = whole.data_layout
    whole.link_in(table)
    whole = _without_exceptions(whole)
    for each in (*whole.functions, *whole.global_variables):
        if each.name == _SYMBOL:
            each.visibility = "hidden"
        elif not each.is_declaration:
            each.linkage = "internal"
    return str(whole)


def _without_exceptions(module: Any) -> Any:
    """A module whose exceptions, which nobody looks at, are empty: they hold the paths of this machine."""
    import llvmlite.binding as llvm

    pickled = re.compile(r'^(@"?\.const\.pickledata\.[^=]*=[^\n]*?constant \[\d+ x i8\]) c"[^"\n]*"', re.MULTILINE)
    return llvm.parse_assembly(pickled.sub(r"\1 zeroinitializer", str(module)))


def _main(arguments: list[str]) -> None:
    (level,) = arguments
    if os.environ.get("NUMBA_CPU_NAME") != _settings(level)["NUMBA_CPU_NAME"]:
        raise SystemExit(f"this process compiles for another processor; set {_settings(level)} before it starts")
    sys.stdout.write(_text())


if __name__ == "__main__":
    _main(sys.argv[1:])
