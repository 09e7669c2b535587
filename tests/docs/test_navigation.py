"""Folders of the site's navigation: order, sections, folders that are not there."""

import importlib.util
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
_SPEC = importlib.util.spec_from_file_location("navigation", REPOSITORY / "tools" / "documentation" / "navigation.py")
assert _SPEC is not None and _SPEC.loader is not None
navigation = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(navigation)


def files(folder: Path, **texts: str) -> dict[str, Path]:
    made = {}
    for name, text in texts.items():
        name = name.replace("__", "/") + ".md"
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        made[name] = path
    return made


def test_a_folder_is_its_index_then_what_that_links_to_then_the_rest(tmp_path: Path) -> None:
    there = files(
        tmp_path,
        how__index="[second](zebra.md#part), [again](zebra.md), [elsewhere](../other.md), [keys](deep/index.md)",
        how__apple="",
        how__zebra="",
        how__deep__index="",
        how__deep__key="",
        other="",
    )
    assert navigation.expand([{"How": "how/"}, "other.md"], there) == [
        {"How": ["how/index.md", "how/zebra.md", {"Deep": ["how/deep/index.md", "how/deep/key.md"]}, "how/apple.md"]},
        "other.md",
    ]


def test_a_folder_without_pages_is_left_out(tmp_path: Path) -> None:
    there = files(tmp_path, a="")
    assert navigation.expand([{"Gone": "gone/"}, {"Here": ["a.md", {"Gone": "gone/"}]}], there) == [{"Here": ["a.md"]}]
