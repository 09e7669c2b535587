"""What docs/collisions.md says of scenes, references and entries, by the names of its places (`documentation.page`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.collisions import FOLDER, VERSION, entries, report, runfile
from benchmarks.collisions.resample import interpolated
from benchmarks.collisions.scene import facts_of, names, numbers_of, outside_names, reference
from benchmarks.collisions.score import score

#: rates over the scene's at which copies are made
_COPIED = (48 / 44.1, 96 / 44.1)


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
        "machines": report.origins(found_entries),
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
        errors = [_e(name, known.u, facts.rate_hz)]
        for ratio in _COPIED:
            t = np.arange(int(facts.duration_s * facts.rate_hz * ratio) + 1) / (facts.rate_hz * ratio)
            errors.append(_e(name, interpolated(known.u, facts.rate_hz, t), facts.rate_hz * ratio))
        lines.append([f"`{name}`", *map(report.number, errors), *(report.number(known.floors[each][-1]) for each in ratios)])
    head = ["scene", "a copy", *(f"a band-limited copy at {44.1 * ratio:.4g}/44.1 of the rate" for ratio in _COPIED)]
    head += [f"the motion itself at {ratio * 44.1:.4g}/44.1" for ratio in ratios]
    words = (
        "e over the whole of the reference: a copy of its samples; the band-limited curve through them, sampled at another "
        "rate, as the scorer interpolates it back; and its motion, with everything above half that rate, sampled without "
        "a filter. The last is added to the uncertainty of a run at such a rate; between two rates the lower one counts."
    )
    return f"{words}\n\n{report.table(head, lines)}"


def _e(name: str, u: np.ndarray, rate_hz: float) -> float | None:
    facts, known = facts_of(numbers_of(name)), reference(name)
    run = runfile.brought(Path(name), {"u": u, "rate_hz": np.array(rate_hz)}, facts, known)
    return score(run, facts, known).e[-1]
