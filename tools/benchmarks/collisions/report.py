"""Tables of scores, of references and of entries, in Markdown."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from benchmarks.collisions.scene import facts_of, names, numbers_of, records
from benchmarks.collisions.score import Score, number, shown

#: CPU seconds for one second of sound, below which the best e is told
COSTS = (0.01, 0.1, 1.0)
#: a window is a scene's headline if its reference stands so well [e]
_STANDS = 0.02
_HEADLINE_COST = 0.1


def table(head: list[str], lines: Iterable[list[str]]) -> str:
    """A Markdown table."""
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows) + "\n"


def _seconds(value: float) -> str:
    return f"{value:g} s"


def of_scores(scores: list[Score]) -> str:
    """What `score` prints: a table for each scene, notes behind."""
    parts = []
    for name in dict.fromkeys(score.scene.name for score in scores):
        here = [score for score in scores if score.scene.name == name]
        windows = here[0].scene.windows_s
        head = ["run", *(f"e, {_seconds(w)}" for w in windows), "± of the last", "LSD, dB", "follows the reference until"]
        head += ["penetration", "energy rise", "impulse", "cost"]
        lines = []
        for score in here:
            last = max((k for k, e in enumerate(score.e) if e is not None), default=0)
            until = ("≥ " if score.horizon_open else "") + _seconds(float(f"{score.horizon_s:.3g}"))
            lsd = "–" if score.lsd_db is None else shown(score.lsd_db, score.lsd_uncertainty_db)
            cost = score.run.numbers.get("cost_s")
            depth = score.penetration_m
            lines.append(
                [
                    score.run.path.name,
                    *(shown(e, u) for e, u in zip(score.e, score.uncertainty, strict=True)),
                    number(score.uncertainty[last]),
                    lsd,
                    until,
                    "–" if depth is None else f"{number(depth * 1e6)} µm",
                    number(score.energy_rise),
                    number(score.impulse, 3),
                    "–" if cost is None else f"{number(cost)} s",
                ]
            )
        parts.append(f"### {name}: {here[0].scene.title}\n\n" + table(head, lines))
        for score in here:
            notes = list(score.suspicions)
            if not score.run.picked:
                notes.append(
                    f"{score.run.rate_hz:g} Hz, interpolated: this alone can cause e = {number(max(score.run.floor))}"
                )
            if any(e is None for e in score.e):
                notes.append("ends before the end of the scene")
            if score.pull_n:
                notes.append(f"its contacts pull, with up to {number(score.pull_n)} N")
            parts += [f"- {score.run.path.name}: {note}" for note in notes]
    return "\n".join(parts) + "\n"


# --- the page -------------------------------------------------------------------------------------------------------------


def references_table() -> str:
    """Every scene with its reference, that one's uncertainty, and what else says the same."""
    lines = []
    for name in names():
        facts, record = facts_of(numbers_of(name)), records()[name]
        windows = [f"{_seconds(w)}" for w in facts.windows_s]
        own = "0 (exact)" if record["exact"] and name != "forty-modes" else ""
        own = own or "; ".join(f"{number(u)} ({w})" for u, w in zip(record["uncertainty"], windows, strict=True))
        by = ", ".join(check["what"] for check in record["checks"]) or "–"
        others = "; ".join(f"{row['what']}: {', '.join(number(e) for e in row['e'])}" for row in record["independent"])
        rate = record["internal_rate_hz"]
        exact = record["scheme"] in ("cabannes", "flat-wall")
        how = record["scheme"] if exact else f"{record['scheme']}, {rate / 1e6:.3g} MHz, {record['modes']} modes"
        if record["scheme"] == "waveguide":
            how = "waves on a grid"
        until = _seconds(float(f"{record['horizon_s']:.3g}"))
        lines.append([f"`{name}`", facts.title, how, own, by, others, until])
    head = [
        "scene",
        "what",
        "reference",
        "uncertainty of e",
        "checked by itself",
        "another method: e by window",
        "valid until",
    ]
    return table(head, lines)


def headline(windows_s: list[float], uncertainty: list[float]) -> int:
    """The longest window whose reference stands to e = 0.02; the first where none does."""
    return max((k for k, u in enumerate(uncertainty) if u <= _STANDS and k < len(windows_s)), default=0)


def _window(records_here: list[dict[str, Any]]) -> tuple[int, float]:
    """(place, seconds) of a scene's headline window, by what its records say of the reference, interpolation left out."""
    first = min((r for r in records_here if "e" in r), key=lambda r: max(r["uncertainty"]))
    k = headline(first["windows_s"], first["uncertainty"])
    return k, first["windows_s"][k]


def _duration(record: dict[str, Any]) -> float:
    return record["windows_s"][-1]


def _cell(record: dict[str, Any] | None, k: int) -> str:
    if record is None:
        return "–"
    if record.get("blown_up"):
        return "blown up"
    return shown(record["e"][k], record["uncertainty"][k])


def _who(record: dict[str, Any], entry: dict[str, Any]) -> str:
    solver = record.get("solver") or entry["name"]
    return record["scheme"] if solver in ("jawari", "NumPy") else f"{solver}: {record['scheme']}"


def origins(entries: list[dict[str, Any]]) -> str:
    """A line for each entry: its machine and source; one more for the scenes that ran on another machine or version."""
    lines = []
    for entry in entries:
        own = (entry["machine"], entry["source"])
        found: dict[tuple[str, str], list[str]] = {own: []}
        for record in entry["scores"]:
            origin = (record.get("machine", own[0]), record.get("source", own[1]))
            scenes = found.setdefault(origin, [])
            if record["scene"] not in scenes:
                scenes.append(record["scene"])
        for origin, scenes in found.items():
            of = "" if origin == own else ", " + ", ".join(f"`{name}`" for name in scenes)
            lines.append(f"- {entry['name']}{of}: {'; '.join(origin)}")
    return "\n".join(lines)


def by_scene(entries: list[dict[str, Any]]) -> dict[str, list[tuple[str, dict[str, Any]]]]:
    """(who, record) of every entry by scene, in their order."""
    found: dict[str, list[tuple[str, dict[str, Any]]]] = {}
    for entry in entries:
        for record in entry["scores"]:
            found.setdefault(record["scene"], []).append((_who(record, entry), record))
    return found


def _best(records_here: list[dict[str, Any]], k: int, cost: float) -> dict[str, Any] | None:
    fit = [r for r in records_here if "e" in r and r["e"][k] is not None and r.get("cost_s") is not None]
    return min((r for r in fit if r["cost_s"] <= cost * _duration(r)), key=lambda r: r["e"][k], default=None)


def scene_table(rows: list[tuple[str, dict[str, Any]]]) -> str:
    """One scene: e by rate, the best e at given costs, how long the best run goes with the reference."""
    only = [record for _, record in rows if "does_not_apply" not in record]
    k, window = _window(only)
    rates = sorted({r["internal_rate_hz"] for r in only if r.get("internal_rate_hz")})
    head = [f"e over {_seconds(window)}", *(f"{hz / 1e3:.4g} kHz" if hz < 1e6 else f"{hz / 1e6:.3g} MHz" for hz in rates)]
    head += [f"best, ≤ {cost:g} s/s" for cost in COSTS] + ["follows the reference until"]
    lines = []
    for who in dict.fromkeys(who for who, record in rows if "does_not_apply" not in record):
        here = [record for name, record in rows if name == who and "does_not_apply" not in record]
        at: dict[float | None, dict[str, Any]] = {}
        for record in here:  # of several at a rate the best
            hz = record.get("internal_rate_hz")
            before = at.get(hz)
            if before is None or "e" not in before or ("e" in record and record["e"][k] < before["e"][k]):
                at[hz] = record
        finite = [r for r in here if "e" in r and r["e"][k] is not None]
        longest = max(finite, key=lambda r: r["horizon_s"], default=None)
        until = "–"
        if longest is not None:
            until = ("≥ " if longest["horizon_open"] else "") + _seconds(float(f"{longest['horizon_s']:.2g}"))
        line = [who, *(_cell(at.get(hz), k) for hz in rates), *(_cell(_best(here, k, cost), k) for cost in COSTS), until]
        lines.append(line)
    return table(head, lines)


def summary_table(found: dict[str, list[tuple[str, dict[str, Any]]]], scenes: list[str]) -> str:
    """Schemes × scenes: the best e for a tenth of real time of one core."""
    keys = {name: _window([r for _, r in found[name] if "does_not_apply" not in r]) for name in scenes}
    whos = list(dict.fromkeys(who for name in scenes for who, record in found[name] if "does_not_apply" not in record))
    lines = []
    for who in whos:
        line = [who]
        for name in scenes:
            here = [record for each, record in found[name] if each == who]
            k = keys[name][0]
            finite = [r for r in here if "does_not_apply" not in r]
            best = _best(finite, k, _HEADLINE_COST)
            line.append(_cell(best, k) if best else "" if not finite else "–")
        lines.append(line)
    return table(["best e at ≤ 0.1 s/s", *(f"`{name}`, {_seconds(keys[name][1])}" for name in scenes)], lines)


def not_applied(found: dict[str, list[tuple[str, dict[str, Any]]]]) -> str:
    """Which scheme takes which scene not, and why."""
    why: dict[tuple[str, str], list[str]] = {}
    for name, rows in found.items():
        for who, record in rows:
            if "does_not_apply" in record:
                why.setdefault((who, record["does_not_apply"]), []).append(name)
    lines = [[who, ", ".join(f"`{each}`" for each in scenes), reason] for (who, reason), scenes in why.items()]
    return table(["scheme", "scenes", "why not"], lines)


def outside_table(entries: list[dict[str, Any]], name: str) -> str:
    """A scene on others' modes: their runs and this program's at the same rates, both costs."""
    lines = []
    theirs = {record["internal_rate_hz"] for entry in entries for record in entry["scores"]
              if record["scene"] == name and str(record.get("solver", "")).startswith("Siconos")}  # fmt: skip
    windows: list[float] = []
    for entry in entries:
        for record in entry["scores"]:
            if record["scene"] != name or "e" not in record or record["internal_rate_hz"] not in theirs:
                continue
            windows = record["windows_s"]
            cost = record.get("cost_s")
            who = f"{record.get('solver', entry['name'])}: {record['scheme']}"
            e = [shown(e, u) for e, u in zip(record["e"], record["uncertainty"], strict=True)]
            line = [who, f"{record['internal_rate_hz'] / 1e3:g} kHz", str(round(record["modes"])), *e]
            lines.append([*line, number(record["lsd_db"]), "–" if cost is None else f"{number(cost)} s"])
    head = ["solver: scheme", "internal rate", "modes", *(f"e, {_seconds(w)}" for w in windows), "LSD, dB", "cost"]
    return table(head, lines)
