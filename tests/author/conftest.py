"""The server for the tests of this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from synth.instrument.preset import preset_folder

from .serverkit import Server

Serve = Callable[..., Server]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with one preset, mine.toml."""
    place = tmp_path / "presets"
    place.mkdir()
    text = (preset_folder() / "tanpura-light.toml").read_text(encoding="utf-8")
    (place / "mine.toml").write_text(text.replace('name = "tanpura-light"', 'name = "mine"'), encoding="utf-8")
    return place


@pytest.fixture
def serve(folder: Path) -> Iterator[Serve]:
    """serve(*arguments) -> Server on the folder, until the end of the test."""
    running: list[Server] = []

    def start(*arguments: str, **options: object) -> Server:
        running.append(Server(folder, *arguments, **options))
        return running[-1]

    yield start
    for server in running:
        server.end()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """One server for all tests of a module that leave nothing behind."""
    with Server(tmp_path_factory.mktemp("presets")) as running:
        yield running
