"""A process that renders scenes with one package: python -m same_sound.worker TREE, a scene a line on its input."""

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
    for line in sys.stdin:
        asked = json.loads(line)
        began = time.perf_counter()
        came, words = _attempt(tree, asked["scene"], Path(asked["path"]))
        answers.write(json.dumps({"came": came, "words": words, "took_s": time.perf_counter() - began}) + "\n")
        answers.flush()


def _attempt(tree: Path, scene: dict[str, Any], path: Path) -> tuple[str, str]:
    """("done", "unknown" or "failed", why)."""
    from same_sound.render import Unknown, arrays_of

    try:
        import synth

        if not Path(str(synth.__file__)).is_relative_to(tree):
            return "failed", f"{synth.__file__} was imported, not the package of {tree}"
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
