"""Views of a preset, computed beside the server: one at a time of each kind, kept for when they are asked for again."""

from __future__ import annotations

import asyncio
import importlib
import json
import threading
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from synth.author.document import fingerprint
from synth.preset import Preset

#: answers that are kept
KEPT = 48


@dataclass(frozen=True)
class View:
    """A function of a preset, by module and name, with its parameters beside the preset and their kinds. Those that have no
    default there must be given."""

    module: str
    function: str
    parameters: Mapping[str, type]

    def __call__(self, preset: Preset, arguments: Mapping[str, Any]) -> Any:
        function = getattr(importlib.import_module(f"synth.author.views.{self.module}"), self.function)
        return function(preset, **arguments)


VIEWS = {
    "parameters": View("parameters", "describe", {}),
    "instrument": View("instrument", "draw", {"note": int, "velocity": int}),
    "motion": View("motion", "film", {"note": int, "velocity": int, "seconds": float, "frames": int, "start_s": float}),
    "analysis": View("analysis", "analyse", {"note": int, "velocity": int, "seconds": float}),
    "cost": View("cost", "estimate", {"note": int, "velocity": int}),
}


class Gone(Exception):
    """Whoever asked has gone before it was begun."""


class Viewer:
    """Computes views; see the module's docstring."""

    def __init__(self) -> None:
        self._workers = {name: ThreadPoolExecutor(1, thread_name_prefix=f"author-{name}") for name in VIEWS}
        self._kept: OrderedDict[tuple[Any, ...], bytes] = OrderedDict()
        self._lock = threading.Lock()

    async def json(
        self,
        name: str,
        preset: Preset,
        text: str,
        arguments: Mapping[str, Any],
        gone: Callable[[], Coroutine[Any, Any, bool]],
    ) -> bytes:
        """A view of the preset of a text, as JSON. Raises what the view raises, and Gone."""
        key = (name, fingerprint(text), *sorted(arguments.items()))
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        loop = asyncio.get_running_loop()

        def compute() -> bytes:
            # a drag asks for many: those that nobody waits for any more are passed over
            if asyncio.run_coroutine_threadsafe(gone(), loop).result():
                raise Gone
            with self._lock:
                if key in self._kept:
                    return self._kept[key]
            return json.dumps(VIEWS[name](preset, arguments), allow_nan=False, separators=(",", ":")).encode()

        answer = await loop.run_in_executor(self._workers[name], compute)
        with self._lock:
            self._kept[key] = answer
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return answer

    def close(self) -> None:
        for worker in self._workers.values():
            worker.shutdown(wait=False, cancel_futures=True)
