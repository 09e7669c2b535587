"""What docs/collisions.md says of scenes, references and entries, by the names of its places (`documentation.page`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.collisions import FOLDER, VERSION, entries, report, runfile
from bench.collisions.scene import facts_of, names, numbers_of, outside_names, reference
from bench.collisions.score import score


def parts() -> dict[str, str]:
    """Texts by place."""
    found_entries = entries.all_entries()
    found = report.by_scene(found_entries)
    scenes = [name for name in names() if name in found]
    size = sum(path.stat().st_size for path in FOLDER.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
    texts = {
        "version": f"Version {VERSION}: {len(names())} scenes, {size / 1e6:.1f} MB with references and entries.",
        "references": report.references_table(),
        "summary": report.summary_table(found, scenes),
        "machines": "\n".join(f"- {each['name']}: {each['machine']}; {each['source']}" for each in found_entries),
        "refused": report.not_applied({name: found[name] for name in scenes}),
        "scores": "\n".join(
            f"### {facts_of(numbers_of(name)).title}\n\n`{name}`\n\n{report.scene_table(found[name])}" for name in scenes
        ),
    }
    outside = [f"`{name}`\n\n{report.outside_table(found_entries, name)}" for name in outside_names() if name in found]
    texts["siconos"] = "\n".join(outside)
    texts["scorer"] = scorer_table()
    return texts


def scorer_table() -> str:
    """What the scorer makes of the references themselves: as they are, and sampled at other rates, over the whole."""
    lines = []
    for name in names():
        facts, known = facts_of(numbers_of(name)), reference(name)
        ratios = sorted(known.floors)
        exact = runfile.brought(Path(name), {"u": known.u, "rate_hz": np.array(facts.rate_hz)}, facts, known)
        e = score(exact, facts, known).e[-1]
        lines.append([f"`{name}`", report.number(e), *(report.number(known.floors[ratio][-1]) for ratio in ratios)])
    rates = [f"{ratio * 44.1:.4g}" for ratio in ratios]
    head = ["scene", "e of its own copy", *(f"at {rate}/44.1 of the rate" for rate in rates)]
    words = (
        "e over the whole of the reference's own motion, sampled at another rate without a filter and interpolated back by "
        "the scorer; between, the next lower rate counts. It is the motion above half the rate that is lost."
    )
    return f"{words}\n\n{report.table(head, lines)}"
