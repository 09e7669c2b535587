"""Views of a preset, computed beside the server one at a time, and kept for when they are asked for again."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass
from typing import Any

from synth.author.beside import ComputeProcess, compute
from synth.author.document import version_fingerprint
from synth.instrument.preset import Preset

#: answers that are kept
KEPT = 48


@dataclass(frozen=True)
class View:
    """A function of a preset, by module and name, with its parameters beside the preset and their kinds. `long`: it plays a
    note, at a quality and rate, in a process of its own."""

    module: str
    function: str
    parameters: Mapping[str, type]
    long: bool = True


VIEWS = {
    "parameters": View("parameters", "describe", {}, long=False),
    "instrument": View("instrument", "draw", {"note": int, "velocity": int}, long=False),
    "body": View("body_peaks", "describe_body", {}, long=False),
    "begin-body": View("begin_body", "begin", {}),
    "motion": View("motion", "film", {"note": int, "velocity": int, "seconds": float, "frames": int, "start_s": float}),
    "analysis": View("analysis", "analyse", {"note": int, "velocity": int, "seconds": float}),
    "cost": View("cost", "estimate", {"note": int, "velocity": int}),
}


class Gone(Exception):
    """Whoever asked has gone before it was begun."""


class Viewer:
    """Computes views; see the module's docstring."""

    def __init__(self) -> None:
        self._worker = ComputeProcess()
        self._turn = asyncio.Lock()
        self._kept: OrderedDict[tuple[Any, ...], bytes] = OrderedDict()

    async def json(
        self,
        name: str,
        preset: Preset,
        text: str,
        arguments: Mapping[str, Any],
        gone: Callable[[], Coroutine[Any, Any, bool]],
    ) -> bytes:
        """A view of the preset of a text, as JSON. Raises what the view raises, and Gone."""
        view = VIEWS[name]
        key = (name, version_fingerprint(text, preset), *sorted(arguments.items()))
        if key in self._kept:
            return self._keep(key, self._kept[key])
        if not view.long:
            return self._keep(key, await asyncio.to_thread(compute, view.module, view.function, preset, arguments))
        async with self._turn:
            # a drag asks for many: those that nobody waits for any more are passed over
            if await gone():
                raise Gone
            if key in self._kept:
                return self._keep(key, self._kept[key])
            answer = await asyncio.to_thread(self._worker.compute, view.module, view.function, preset, arguments)
            return self._keep(key, answer)

    def _keep(self, key: tuple[Any, ...], answer: bytes) -> bytes:
        self._kept[key] = answer
        self._kept.move_to_end(key)
        while len(self._kept) > KEPT:
            self._kept.popitem(last=False)
        return answer

    def warm_up(self, preset: Preset, note: int) -> None:
        """Start the process and let it load its kernels."""
        view = VIEWS["motion"]
        self._worker.compute(view.module, view.function, preset, {"note": note})

    def close(self) -> None:
        self._worker.close()
