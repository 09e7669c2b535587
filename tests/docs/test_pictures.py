"""The pictures of docs/architecture.md are those that their script draws, of the rooms that there are."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from documentation import draw

from tests.test_architecture import FLOORS

DOCS = Path(__file__).parents[2] / "docs"


def test_they_are_as_drawn() -> None:
    page = (DOCS / "architecture.md").read_text(encoding="utf-8")
    for name, drawn in draw.PICTURES.items():
        assert (draw.ASSETS / name).read_text(encoding="utf-8") == drawn(), f"{name}: run tools/documentation/draw.py"
        assert f"(assets/{name})" in page


def test_floors_are_those_of_the_package() -> None:
    shown = [{room for room, _ in inside} for _, inside in draw.FLOORS]
    # what begins with a stroke is no room
    rooms = [{room for room in floor if not room.startswith("_")} for floor in reversed(FLOORS)]
    assert shown == [floor for floor in rooms if floor]
