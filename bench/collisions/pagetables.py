"""What docs/collisions.md says of scenes, references and entries, by the names of its places there (`documentation.page`)."""

from __future__ import annotations

from bench.collisions import FOLDER, VERSION, entries, report
from bench.collisions.scene import facts_of, names, numbers_of, outside_names


def parts() -> dict[str, str]:
    """Texts by place."""
    found_entries = entries.all_entries()
    found = report.by_scene(found_entries)
    scenes = [name for name in names() if name in found]
    size = sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    texts = {
        "version": f"Version {VERSION} of the benchmark: {len(names())} scenes, {size / 1e6:.1f} MB with references and entries.",
        "references": report.references_table(),
        "summary": report.summary_table(found, scenes),
        "machines": "\n".join(f"- {each['name']}: {each['machine']}; {each['source']}" for each in found_entries),
        "refused": report.not_applied({name: found[name] for name in scenes}),
        "scores": "\n".join(f"### {facts_of(numbers_of(name)).title}\n\n`{name}`\n\n{report.scene_table(found[name])}" for name in scenes),
    }
    outside = [f"`{name}`\n\n{report.outside_table(found_entries, name)}" for name in outside_names() if name in found]
    texts["siconos"] = "\n".join(outside)
    return texts
