"""Worst blocks beside median ones, where every block has an event in it or what one has left behind.

tools/bench --only even_blocks
PYTHONPATH=tools python -m benchmarks.test_blocks [SCENE …]    # a table by itself: median, worst, worst over median
"""

from __future__ import annotations

import sys
from typing import Any

import pytest

from benchmarks import block_scenes, scenes
from benchmarks.conftest import note_blocks
from benchmarks.count import block_times

BLOCKS = (64, 128, 256)
#: rounds of the table, after one that is not measured
ROUNDS = 6


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.parametrize("scene", list(block_scenes.SCENES))
def test_even_blocks(benchmark: Any, scene: str, block: int, short: bool) -> None:
    note_blocks(benchmark, scene, block_scenes.SCENES[scene](), block, short)


def player_of(scene: str) -> scenes.Player:
    """A scene of this file, or a demo song's first 10 s."""
    if scene in block_scenes.SCENES:
        return block_scenes.SCENES[scene]()
    player = scenes.song(scene)
    player.seconds = min(player.seconds, 10.0)
    return player


def table(names: list[str]) -> None:
    """Lines of a table, as parts of a block's own time; each block's least of all rounds."""
    from benchmarks.__main__ import pin

    pin()
    print("| scene | frames | median | worst | worst over median |\n|---|---|---|---|---|")
    for name in names:
        player = player_of(name)
        for block in BLOCKS:
            rounds = []
            for _ in range(1 + ROUNDS):
                player.engine.reset()
                rounds.append(list(player.blocks(block)))
            found = block_times(rounds[1:], block / scenes.RATE_HZ)
            ratio = found["worst"] / found["median"]
            print(f"| {name} | {block} | {found['median']:.3f} | {found['worst']:.3f} | {ratio:.1f} |", flush=True)


if __name__ == "__main__":
    table(sys.argv[1:] or [*scenes.SONGS, *block_scenes.SCENES])
