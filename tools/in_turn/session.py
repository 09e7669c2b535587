"""Both sides at one scene: a process each, its kernels compiled before, asked in turn."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from same_sound.session import environment_of
from same_sound.trees import Side


class Failed(Exception):
    """A side cannot play the scene."""


class Player:
    """A process of one side that has prepared a scene and played it once. Raises Failed. To be closed."""

    def __init__(self, side: Side, scene: dict[str, Any]) -> None:
        self._side = side
        self._errors = tempfile.TemporaryFile("w+", errors="replace")
        self._process = self._start()
        try:
            if self._ask({"scene": scene})["compiled"]:  # one that loads its kernels, as all do later
                self._stop()
                self._process = self._start()
                self._ask({"scene": scene})
        except BaseException:
            self.close()
            raise

    def round(self) -> dict[str, float]:
        """cpu_s and wall_s of the scene, played from silence."""
        return self._ask({})

    def close(self) -> None:
        """End the process."""
        self._stop()
        self._errors.close()

    def _start(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-P", "-m", "in_turn.worker", str(self._side.tree)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, text=True,
            env=environment_of(self._side) | {"JAWARI_NATIVE": "0"},
        )  # fmt: skip

    def _stop(self) -> None:
        self._process.kill()
        self._process.communicate()

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            self._errors.seek(0)
            last = self._errors.read().strip().splitlines()[-1:]
            raise Failed(f"{self._side.name}: its process ended{': ' if last else ''}{''.join(last)}")
        said = json.loads(line)
        if "error" in said:
            raise Failed(f"{self._side.name}: {said['error']}")
        return said


def in_turn(sides: Sequence[Side], scene: dict[str, Any], rounds: int) -> list[list[dict[str, float]]]:
    """Of each side its rounds of the scene; who begins changes from round to round. Raises Failed."""
    with ExitStack() as stack:
        players = []
        for side in sides:
            players.append(Player(side, scene))
            stack.callback(players[-1].close)
        found: list[list[dict[str, float]]] = [[] for _ in sides]
        for number in range(rounds):
            order = list(range(len(sides)))
            for which in order if number % 2 == 0 else reversed(order):
                found[which].append(players[which].round())
    return found
