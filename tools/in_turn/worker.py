"""A process that plays scenes with one package: python -m in_turn.worker TREE, a line of JSON a request on its input.

{"scene": …} prepares one and plays it once, unmeasured; {} plays it again from silence, and the answer is what it took. A
scene is one of `same_sound` of kind "engine", of which what comes before its `timed_from` [s] is played unmeasured.
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
    os.dup2(2, 1)
    warnings.simplefilter("ignore")
    playing = None
    for line in sys.stdin:
        asked = json.loads(line)
        try:
            if "scene" in asked:
                playing = Playing(tree, asked["scene"])
            assert playing is not None
            said = playing.round()
        except Exception as error:
            said = {"error": f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"}
        answers.write(json.dumps(said) + "\n")
        answers.flush()


class Playing:
    """An engine with the blocks that it plays."""

    def __init__(self, tree: Path, scene: dict[str, Any]) -> None:
        import synth

        if not Path(str(synth.__file__)).is_relative_to(tree):
            raise RuntimeError(f"{synth.__file__} was imported, not the package of {tree}")
        from same_sound.render import events_of, prepared
        from same_sound.worker import Compilations

        self._compilations = Compilations()
        self._compilations.listen()
        rate_hz, (block,) = scene["rate_hz"], scene["blocks"]
        self.engine = prepared(scene)
        events = events_of(scene["events"], rate_hz, self.engine)
        frames, timed_from = round(scene["seconds"] * rate_hz), round(scene.get("timed_from", 0.0) * rate_hz)
        self._blocks: tuple[list[Any], list[Any]] = [], []  # before and from `timed_from` on
        out = np.zeros((block, 2))
        for at in range(0, frames, block):
            end = min(frames, at + block)
            due = events[(events["frame"] >= at) & (events["frame"] < end)].copy()
            due["frame"] -= at
            self._blocks[at >= timed_from].append((due, out[: end - at]))

    def round(self) -> dict[str, Any]:
        """Seconds [s] of the processor and by the wall clock, mode-steps since silence, kernels compiled by the process."""
        self.engine.reset()
        before, timed = self._blocks
        for events, out in before:
            self.engine.process(events, out)
        cpu, wall = time.process_time(), time.perf_counter()
        for events, out in timed:
            self.engine.process(events, out)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        done = {"mode_steps": self.engine.mode_steps, "compiled": self._compilations.count()}
        return {"cpu_s": cpu, "wall_s": wall} | done


if __name__ == "__main__":
    main()
