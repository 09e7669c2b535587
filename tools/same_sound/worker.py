"""A process that renders scenes with one package: python -m same_sound.worker TREE, a scene a line on its input.

A process that compiles a kernel may round otherwise than all later ones, which load it: callees that both have are then
linked from another place. So what comes out with a compilation is no answer; the scene is to be asked of a new process.
"""

from __future__ import annotations

import json
import os
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np


def main() -> None:
    tree = Path(sys.argv[1])
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a scene prints is no answer
    warnings.simplefilter("ignore")
    compiling = Compilations()
    for line in sys.stdin:
        asked = json.loads(line)
        began = time.perf_counter()
        came, words = _attempt(tree, asked["scene"], Path(asked["path"]), compiling)
        if came == "done" and compiling.count() and not asked["last"]:
            came = "compiled"
        answers.write(json.dumps({"came": came, "words": words, "took_s": time.perf_counter() - began}) + "\n")
        answers.flush()


class Compilations:
    """How many kernels Numba has compiled in this process, from when it is first asked to listen."""

    _recorder: Any = None

    def listen(self) -> None:
        """To be called once the package, which sets Numba up, is there."""
        if self._recorder is None:
            from numba.core import event

            self._recorder = event.RecordingListener()
            event.register("numba:compile", self._recorder)

    def count(self) -> int:
        return len(self._recorder.buffer) if self._recorder is not None else 0


def _attempt(tree: Path, scene: dict[str, Any], path: Path, compiling: Compilations) -> tuple[str, str]:
    """("done", "unknown" or "failed", why)."""
    from same_sound.render import Unknown, arrays_of

    try:
        import synth

        if not Path(str(synth.__file__)).is_relative_to(tree):
            return "failed", f"{synth.__file__} was imported, not the package of {tree}"
        compiling.listen()
        arrays = arrays_of(scene)
    except Unknown as error:
        return "unknown", str(error)
    except BaseException as error:  # SystemExit of a command line, too
        if isinstance(error, KeyboardInterrupt):
            raise
        return "failed", f"{type(error).__name__}: {' '.join(str(error).split())[:500]}"
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    with open(beside, "wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]
    os.replace(beside, path)
    return "done", ""


if __name__ == "__main__":
    main()
