"""Where compiled kernels are kept between runs.

Numba keeps them beside the source and looks only at the file that holds the kernel: after an update of another file
that it calls, the old machine code would go on being used. So the cache is a folder of the user's, named by a hash over
all sources that kernels are made of; a changed source is another folder, and the oldest folders go. Where that folder
cannot be written, kernels are kept in one that goes with the process, and `trouble` says so. NUMBA_CACHE_DIR, if set, is
left alone.

What keeps a kernel is Numba's own cache, with some things mended once Numba is loaded: `synth.jit.compiling` is told what is
compiled; a file that cannot be read or written costs a compilation and not the program; one process at a time writes,
since two that kept different signatures of a kernel under one number could each run the code of the other; what another
has claimed is waited for (`kernel_claims`); and large kernels are called, not copied (`kernel_linking`).
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, NoReturn

from synth.files import locks
from synth.jit import compiling, kernel_claims, kernel_linking, vector_width
from synth.jit.kernel_sources import sources_id, users_cache
from synth.native.debugging import INTERPRETED
from synth.native.processors import level
from synth.signals import hearing_signals

KEEP = 8
_PACKAGE = Path(__file__).resolve().parents[1]
#: how long a writer waits for another; then the kernel is compiled again some day [s]
PATIENCE_S = 5.0
#: what a write that was cut short leaves goes after this time [s]
STALE_S = 3600.0
#: objects after which garbage is collected while something is compiled; Python's own is some hundreds
COLLECT_AFTER = 100_000
#: let signals be heard while the main thread compiles: for programs that end when they are interrupted
interruptible = False

_trouble: str | None = None
#: what NUMBA_CACHE_DIR was set to here; empty: it was left alone
_chosen = [""]
_passing: list[Path] = []


def trouble() -> str | None:
    """Why kernels that are compiled now will be compiled again at the next start, and what helps; None: they are kept."""
    return _trouble


def environment() -> dict[str, str]:
    """That of this process as it was before NUMBA_CACHE_DIR was set here: for one that is to choose for itself."""
    return {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR" or value != _chosen[0]}


def cache_folder() -> Path:
    """The folder for the sources as they are now (not created); vectors of another width have one of their own."""
    lanes = os.environ.get("JAWARI_LANES", "")
    return users_cache() / f"kernels-{sources_id()}{lanes and '-' + lanes}"


def use() -> None:
    """Point Numba there; to be called before Numba is imported."""
    if INTERPRETED:
        return
    vector_width.use_kept()
    _point()
    if "numba" in sys.modules:
        _mend_numba()
    else:
        sys.meta_path.insert(0, _Once("numba", _for_a_level, _mend_numba))


def point_again() -> None:
    """Point Numba, which nobody has imported yet, to where kernels of a width that was chosen since are kept."""
    if _chosen[0] and os.environ.get("NUMBA_CACHE_DIR") == _chosen[0]:
        del os.environ["NUMBA_CACHE_DIR"]
        _point()


def _point() -> None:
    if "NUMBA_CACHE_DIR" not in os.environ:
        folder = None
        try:
            folder = cache_folder()
            _make(folder)
        except (OSError, RuntimeError) as error:  # RuntimeError: no home
            _complain(f"{folder or 'no home directory'}: {getattr(error, 'strerror', None) or error}")
            with suppress(OSError):  # no place at all: nothing is kept
                folder = _temporary()
        if folder is not None:
            os.environ["NUMBA_CACHE_DIR"] = _chosen[0] = str(folder)


def _for_a_level() -> None:
    """Let Numba compile for the processor's level of x86-64 rather than for its make: what is computed is then the same on
    all that have the level, and in a native library made for it. NUMBA_CPU_NAME, if set, is left alone."""
    if "NUMBA_CPU_NAME" not in os.environ and (name := level()) is not None:
        os.environ["NUMBA_CPU_NAME"] = name
        os.environ["NUMBA_CPU_FEATURES"] = ""


def _temporary() -> Path:
    """A folder that goes with this process. Raises OSError."""
    import tempfile

    folder = Path(tempfile.mkdtemp(prefix="jawari-kernels-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    _passing.append(folder)
    return folder


def leave(code: int) -> NoReturn:
    """End the process at once, with whatever its threads are doing."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):
            stream.flush()
    for folder in _passing:
        shutil.rmtree(folder, ignore_errors=True)
    os._exit(code)


def _make(folder: Path) -> None:
    """Make the folder, without the oldest of the others. Raises OSError where it cannot be used: what lies in it
    is run, so it must be nobody else's."""
    if not folder.is_dir():
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        kept = sorted(folder.parent.glob("kernels-*"), key=lambda path: path.stat().st_mtime)
        for old in kept[:-KEEP]:
            shutil.rmtree(old, ignore_errors=True)
    if not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
        raise PermissionError(0, "cannot be written")
    if hasattr(os, "getuid") and os.getuid() not in (0, folder.stat().st_uid):
        raise PermissionError(0, "belongs to another user")


def _complain(why: str) -> None:
    global _trouble
    if _trouble is None:
        _trouble = (
            f"compiled kernels cannot be kept and are compiled again at every start ({why}): make room there, or set "
            "XDG_CACHE_HOME to a folder that can be written"
        )


class _Once:
    """A finder of modules that calls `first` when the module `name` is loaded for the first time, and `then` when it is."""

    def __init__(self, name: str, first: Callable[[], None], then: Callable[[], None]) -> None:
        self._name, self._first, self._then = name, first, then

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> Any:
        if fullname != self._name:
            return None
        from importlib.util import find_spec

        sys.meta_path.remove(self)
        self._first()
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            load, then = spec.loader.exec_module, self._then

            def exec_module(module: Any) -> None:
                load(module)
                then()

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def _mend_numba() -> None:
    """Let the caches of this package's kernels, and of others that call them, be those of `_cache_class`, and compilations
    be interrupted if wanted."""
    from numba.core import caching, ccallback, codegen, dispatcher
    from numba.core import config as numba_config

    mended: Any = dispatcher.Dispatcher
    if getattr(mended, "_jawari_mended", False):  # done twice, a library would forget what it calls
        return
    mended._jawari_mended = True
    config: Any = numba_config
    users: Any = (dispatcher, ccallback)
    kinds: Any = (dispatcher.Dispatcher, ccallback.CFunc)

    if not config.CACHE_DIR:  # Numba was loaded before this package
        config.CACHE_DIR = os.environ.get("NUMBA_CACHE_DIR", "")
    ours = _cache_class(caching)

    def cache_of(function: Any) -> Any:
        # what calls kernels of ours needs those loaded before it, which Numba's own cache does not see to
        return (ours if compiling.calls_ours(function) else caching.FunctionCache)(function)

    kernel_linking.mend(codegen.CPUCodeLibrary, dispatcher.Dispatcher, compiling.is_ours)
    for user in users:
        user.FunctionCache = cache_of
    for kind in kinds:
        kind.compile = _heard(kind.compile)


def _heard(compile_now: Callable[..., Any]) -> Callable[..., Any]:
    """A compilation of the main thread, in another one if it is to hear signals meanwhile, which LLVM does not."""

    def compiled(kernel: Any, *arguments: Any) -> Any:
        try:
            with _collecting_less():
                return compile_now(kernel, *arguments)
        except BaseException:
            kernel_claims.leave(claim_of(kernel.__wrapped__))
            compiling.fails(kernel.__wrapped__)
            raise

    def compile(self: Any, *arguments: Any) -> Any:
        if not interruptible or threading.current_thread() is not threading.main_thread() or _importing():
            return compiled(self, *arguments)
        return hearing_signals(lambda: compiled(self, *arguments))

    return compile


@contextlib.contextmanager
def _collecting_less() -> Iterator[None]:
    """Numba makes millions of small objects that stay, which the collector looks through again and again."""
    before = gc.get_threshold()
    if before[0]:
        gc.set_threshold(max(before[0], COLLECT_AFTER), *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


def _importing() -> bool:
    """Whether a module is being imported by this thread: another one, which may import it too, would wait for it."""
    frame = sys._getframe()
    while (caller := frame.f_back) is not None:
        frame = caller
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
    return False


def _cache_class(caching: Any) -> type:
    class Locator(caching.UserProvidedCacheLocator):  # type: ignore[misc]
        """Places by the module in the package, not by its path: checkouts of the same sources share their kernels."""

        @classmethod
        def get_suitable_cache_subpath(cls, py_file: str) -> str:
            file = Path(py_file).resolve()
            if not file.is_relative_to(_PACKAGE):
                return str(super().get_suitable_cache_subpath(py_file))
            return "_".join(file.relative_to(_PACKAGE.parent).parent.parts)

    class Impl(caching.CompileResultCacheImpl):  # type: ignore[misc]
        _locator_classes = (Locator,)

        def reduce(self, cres: Any) -> Any:
            return tuple(kernel_linking.part_of(cres.library)), super().reduce(cres)

        def rebuild(self, target_context: Any, payload: Any) -> Any:
            part, reduced = payload
            part = kernel_linking.LinkedLibrary(*part)
            for called in part.calls:
                if not kernel_linking.is_there(target_context, called):
                    KernelCache.of[called.function]._look(called.signature, target_context)
                if not kernel_linking.is_there(target_context, called):
                    raise LookupError(called.symbol)
            found = super().rebuild(target_context, reduced)
            kernel_linking.set_part(found.library, part)
            return found

    class KernelCache(caching.FunctionCache):  # type: ignore[misc]
        """Numba's cache of one kernel; see the module's docstring."""

        _impl_class = Impl
        #: of every kernel that was imported, by `kernel_linking.name_of`
        of: ClassVar[dict[Any, KernelCache]] = {}

        def __init__(self, function: Any) -> None:
            self._kept = True
            self._loaded: dict[Any, Any] = {}
            self.of[kernel_linking.name_of(function)] = self
            self._claim = claim_of(function)
            try:
                super().__init__(function)
            except (OSError, RuntimeError) as error:  # RuntimeError: Numba has found no place
                _complain(str(error) if isinstance(error, OSError) else os.environ.get("NUMBA_CACHE_DIR", "no folder"))
                self._kept, self._py_func = False, function
                self.enable()
            compiling.found(function, self)

        def holds_any(self) -> bool:
            """Whether some signature of it is kept."""
            return self._kept and os.path.exists(self._cache_file._index_path)

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            found = self._look(sig, target_context)
            if found is None and self._kept and kernel_claims.wait_for(self._claim):
                found = self._look(sig, target_context)  # another process has compiled it meanwhile
                if found is not None:
                    kernel_claims.leave(self._claim)
            if found is None:
                _tidy()
                compiling.begins(self._py_func)
            return found

        def _look(self, sig: Any, target_context: Any) -> Any:
            found = self._loaded.get(sig)
            if found is None and self._kept:
                try:
                    found = super().load_overload(sig, target_context)
                except Exception:  # a file that was cut short: whatever unpickling makes of it
                    with suppress(OSError):
                        os.unlink(self._cache_file._index_path)
                if found is not None:
                    self._loaded[sig] = found  # loaded twice its symbols would be there twice
            return found

        def save_overload(self, sig: Any, data: Any) -> None:
            try:
                kernel_linking.keep_apart(data, self._py_func, sig)
                if self._kept:
                    with _writing(Path(self._cache_path).parent) as alone:
                        if alone:
                            super().save_overload(sig, data)
            except OSError as error:
                _complain(f"{self._cache_path}: {error.strerror or error}")
            finally:
                kernel_claims.leave(self._claim)
                compiling.ends(self._py_func)

    return KernelCache


def claim_of(function: Any) -> str:
    return "kernel {}:{}:{}".format(*kernel_linking.name_of(function))


@contextlib.contextmanager
def _writing(folder: Path) -> Iterator[bool]:
    """Whether this process is the only one that writes into the folder. Raises OSError."""
    handle = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o600)
    try:
        yield _locked(handle)
    finally:
        os.close(handle)


def _locked(handle: int) -> bool:
    end = time.monotonic() + PATIENCE_S
    while not locks.taken(handle):
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


@functools.cache
def _tidy() -> None:
    """Take away what writes that were cut short have left; once."""
    folder = os.environ.get("NUMBA_CACHE_DIR")
    if folder is None:
        return
    for path in Path(folder).glob("*/*.nb[ic].tmp.*"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > STALE_S:
                path.unlink()
