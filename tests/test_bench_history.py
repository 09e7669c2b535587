"""The history of runs by machine, and the tables that pages have of it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from benchmarks import aims, history, pages, scenes
from benchmarks.history import Run
from documentation import page
from documentation.machine import Machine, here

ROOT = Path(__file__).resolve().parents[1]
#: an environment that finds the benchmarks
FINDS = os.environ | {"PYTHONPATH": str(ROOT / "tools")}
XEON = Machine("Intel(R) Xeon(R) Processor", 2701, 2, {"L2": 2048})
EPYC = Machine("AMD EPYC", 2596, 2, {"L1": 48, "L2": 1024, "L3": 32768})


def run_of(machine: Machine, commit: str, date: str = "2026-01-02", precision: str = "float64", **figures: float) -> Run:
    named = {name.replace("_", "-"): {"median": value} for name, value in figures.items()}
    return Run(date, commit, "0.5.0", machine, 8, precision, "", named)


def test_runs_are_appended_and_come_back(tmp_path: Path) -> None:
    path, first = tmp_path / "history.jsonl", run_of(XEON, "aaa", tanpura_kernel=1314.0)
    assert history.read(path) == []
    history.write(history.with_runs([], [first]), path)
    second = run_of(EPYC, "aaa", tanpura_kernel=700.0)
    history.write(history.with_runs(history.read(path), [second]), path)
    assert history.read(path) == [first, second]
    assert len(path.read_text(encoding="utf-8").splitlines()) == 2


def test_the_same_machine_and_commit_is_one_line_and_what_was_not_measured_again_stays() -> None:
    before = replace(run_of(XEON, "aaa", tanpura_kernel=1314.0, paper_bass=2.4), note="by hand")
    again = run_of(XEON._replace(mhz=2688), "aaa", "2026-02-03", tanpura_kernel=1400.0)
    (found,) = history.with_runs([before], [again])
    assert found.figures == {"tanpura-kernel": {"median": 1400.0}, "paper-bass": {"median": 2.4}}
    assert found.date == "2026-02-03" and found.note == "by hand"


@pytest.mark.parametrize(
    "other",
    [
        run_of(XEON, "bbb"),
        run_of(XEON._replace(mhz=2500), "aaa"),
        run_of(XEON._replace(cores=4), "aaa"),
        run_of(EPYC, "aaa"),
        run_of(XEON, "aaa", precision="float32"),
        replace(run_of(XEON, "aaa"), lanes=4),
    ],
)
def test_another_commit_machine_precision_or_width_is_another_line(other: Run) -> None:
    assert history.with_runs([run_of(XEON, "aaa")], [other]) == [run_of(XEON, "aaa"), other]


GOOD = json.loads(run_of(XEON, "aaa", tanpura_kernel=1314.0).line())


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{", "line 2: must be JSON"),
        ("", "line 2: must be JSON"),
        ("[]", "line 2: must have the fields date, commit"),
        (json.dumps({k: v for k, v in GOOD.items() if k != "lanes"}), "differs in lanes"),
        (json.dumps(GOOD | {"host": "x"}), "differs in host"),
        (json.dumps(GOOD | {"mhz": "fast"}), "mhz must be of type int, got 'fast'"),
        (json.dumps(GOOD | {"precision": "float16"}), "precision must be float64 or float32, got 'float16'"),
        (json.dumps(GOOD | {"date": "yesterday"}), "date must be YYYY-MM-DD or empty, got 'yesterday'"),
        (json.dumps(GOOD | {"figures": {"a": {"mean": 1.0}}}), "figure a must have numbers of best"),
        (json.dumps(GOOD | {"figures": {"a": {"median": float("nan")}}}), "figure a must have numbers of best"),
        (json.dumps(GOOD | {"figures": {"a": {}}}), "figure a must have numbers of best"),
    ],
)
def test_a_line_that_is_none_is_named(tmp_path: Path, line: str, said: str) -> None:
    path = tmp_path / "history.jsonl"
    path.write_text(f"{json.dumps(GOOD)}\n{line}\n", encoding="utf-8")
    with pytest.raises(ValueError, match="correct the line, or restore it from git") as caught:
        history.read(path)
    assert str(caught.value).startswith(f"{path}, line 2: ") and said in str(caught.value)


def test_what_is_no_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "history.jsonl"
    path.write_bytes(b"\xff\n")
    with pytest.raises(ValueError, match="must be UTF-8, got a byte 0xff"):
        history.read(path)


def test_the_history_that_is_kept_can_be_read_and_names_no_machine() -> None:
    runs = history.read()
    assert history.with_runs([], runs) == runs, "a run has two lines"
    assert len({run.machine.same for run in runs}) >= 2
    text = history.HISTORY.read_text(encoding="utf-8")
    assert "/home" not in text and "/work" not in text and "".join(run.line() + "\n" for run in runs) == text


def test_pages_say_what_the_history_says() -> None:
    """`tools/bench --pages` changes nothing."""
    for path, texts in pages.parts(history.read()).items():
        text = path.read_text(encoding="utf-8")
        for name, part in texts.items():
            assert f"<!-- {name} -->\n\n{part.strip()}\n\n<!-- /{name} -->" in text, f"{path.name}: tools/bench --pages"


def test_one_version_on_one_machine_is_shown_and_what_misses_its_aim_is_marked() -> None:
    runs = [run_of(XEON, "aaa", tanpura_kernel=1314.0), run_of(EPYC, "bbb", tanpura_kernel=399.0)]
    text = pages.parts(runs)[pages.SPEED]["targets"]
    assert text.startswith("AMD EPYC, 2.6 GHz, 2 cores, L1 48 KiB, L2 1 MiB, L3 32 MiB; version ")
    assert "| ≥ 400 × | **399** × |" in text and "1314" not in text
    assert "≥ 20 ×" not in text, "a row that was not measured is left out"


def test_at_most_is_at_most_and_a_block_counts_by_its_worst() -> None:
    name = "many-strings/1/block-128"
    run = replace(run_of(XEON, "aaa"), figures={name: {"median": 0.1, "worst": 0.51}})
    assert pages.Line("", (name,)).cell(run) == "**0.51**"
    run = replace(run, figures={name: {"median": 0.1, "worst": 0.5}})
    assert pages.Line("", (name,)).cell(run) == "0.5"


def test_a_spread_is_of_all_that_begin_so() -> None:
    line = pages.Line("", ("bass-note/",), "×", spread=True)
    figures = {"bass-note/E1/64": {"median": 300.0}, "bass-note/D3/110": {"median": 149.0}, "paper-bass": {"median": 1.0}}
    assert line.cell(replace(run_of(XEON, "a"), figures=figures)) == "**149** to 300 ×"
    assert (
        line.cell(replace(run_of(XEON, "a"), figures={"bass-note/all": {"least": 91.0, "most": 215.0}})) == "**91** to 215 ×"
    )
    assert line.cell(run_of(XEON, "a", paper_bass=1.0)) == "–"


def test_the_worst_is_named() -> None:
    line = pages.Line("", ("gesture/bend/",), "×", worst=True)
    figures = {"gesture/bend/sitar": {"median": 1.2}, "gesture/bend/banjo": {"median": 12.0}, "paper-bass": {"median": 99.0}}
    assert line.cell(replace(run_of(XEON, "a"), figures=figures)) == "**12** × (banjo)"
    assert line.cell(run_of(XEON, "a", paper_bass=1.0)) == "–" and line.aim == "≤ 1.5 ×"


def test_what_else_plays_it_stands_beside_ours_where_it_was_measured() -> None:
    """A row without our figure, or without that of what it is compared with, is left out; published speeds are named so."""
    ours = {f"beside/sitar/{quality}": {"median": 5.0} for quality in pages.QUALITIES}
    loop = {"beside/sitar/Karplus–Strong loop": {"median": 1000.0}}
    run = replace(run_of(EPYC, "a"), figures={**ours, **loop, "paper-bass": {"median": 4.8}})
    text = pages.parts([run])[pages.SPEED]["beside"]
    assert "| 5; 5; 5 | e < 0.3; 0.1; 0.02 over 3 s | Karplus–Strong | 1000 |" in text
    assert "the paper's C++ (Siconos); its MATLAB | 1/300; 1/3000 |" in text and "FluidSynth" not in text


def test_the_newest_whole_run_is_shown() -> None:
    whole = run_of(XEON, "aaa", "2026-01-01", tanpura_kernel=1.0, paper_bass=1.0)
    newer = run_of(XEON, "bbb", "2026-01-02", tanpura_kernel=2.0, paper_bass=2.0)
    piece = run_of(XEON, "ccc", "2026-01-03", tanpura_kernel=3.0)
    single = run_of(XEON, "bbb", "2026-01-03", precision="float32", fretless_note=4.0)
    shown = pages.newest_whole([newer, whole, piece, single], pages.TARGETS)
    assert shown.figures == {**newer.figures, **single.figures}
    with pytest.raises(ValueError, match="has no runs"):
        pages.parts([])


def test_readme_shows_one_version_on_one_machine_beside_a_plain_loop() -> None:
    """The two precisions of a version are one column; figures of other versions and machines are never beside them."""
    loop = {"tanpura-kernel": {"median": 1300.0}, "tanpura-kernel/by the naive loop": {"median": 150.0}}
    bass = {"bass-note/E1/64": {"median": 300.0}}
    old = replace(run_of(XEON, "aaa", "2026-01-01"), figures={**loop, **bass})
    double = replace(run_of(EPYC, "bbb", "2026-01-02"), version="0.9", figures=loop)
    single = replace(run_of(EPYC, "bbb", "2026-01-02", precision="float32"), version="0.9", figures=bass)
    piece = run_of(EPYC, "ccc", "2026-01-03", tanpura_kernel=1.0)
    table = pages.parts([old, double, single, piece])[pages.README]["speed"]
    head, _, *rows = table.strip().splitlines()
    assert head.endswith("| aim | EPYC 2.6 GHz, version 0.9 |")
    assert rows[0].endswith("| ≥ 400 × | 1300 × |") and "plain Numba loop" in rows[1] and rows[1].endswith("| 150 × |")
    assert rows[2].endswith("| ≥ 150 × | 300 to 300 × |") and len(rows) == len(pages.SHORT)


def test_every_aim_has_a_figure_that_a_page_shows_and_notes_are_those_of_the_presets() -> None:
    shown = {*pages.SHOWN, "bass-note/E1/64", "decay/tanpura-light/C2/standard/cpu", "gesture/bend/sitar"}
    for pattern, aim in aims.AIMS.items():
        assert any(aims.aim_of(name) == aim for name in shown), pattern
    for preset, notes in pages.NOTES.items():
        assert tuple(scenes.midi_to_note(note) for note in scenes.three_notes(preset)) == notes


FOUND = [
    {
        "section": "targets", "precision": "float64", "lanes": 8,
        "rows": [{"name": "paper-bass", "what": "", "unit": "", "reached": 2.123456, "best": 3.0, "figure": None}],
    },
    {
        "section": "blocks", "precision": "float64", "lanes": 8, "scene": "64 strings", "block": 64, "median": 0.1,
        "worst": 0.2,
    },
    {
        "section": "notes", "precision": "float32", "lanes": 16, "preset": "tanpura-light", "note": "C2", "quality": "fine",
        "times_real_time": 500.0, "best": 600.0,
    },
    {"section": "peak", "precision": "float64", "lanes": 8, "fma_per_s": 6e10, "best_fma_per_s": 7e10},
    {"section": "peak", "precision": "float64", "lanes": 2, "fma_per_s": 1e10, "best_fma_per_s": 2e10},
]  # fmt: skip


def test_figures_are_kept_by_precision_and_width() -> None:
    assert pages.figures_of(FOUND) == {
        ("float64", 8): {
            "paper-bass": {"median": 2.123, "best": 3.0},
            "block/64-strings/64": {"median": 0.1, "worst": 0.2},
            "peak": {"median": 6e10, "best": 7e10},
        },
        ("float32", 16): {"note/tanpura-light/C2/fine": {"median": 500.0, "best": 600.0}},
    }
    wide, narrow = history.runs_of(pages.figures_of(FOUND), EPYC)
    assert (wide.precision, wide.lanes, narrow.precision, narrow.lanes) == ("float64", 8, "float32", 16)
    assert narrow.column == "EPYC 2.6 GHz, 16 × float32" and wide.date and wide.version
    assert history.with_runs([], [wide, narrow]) == [wide, narrow]


def test_the_pages_have_a_place_for_all_that_is_published(tmp_path: Path) -> None:
    for path, texts in pages.parts([run_of(EPYC, "aaa", tanpura_kernel=123.0)]).items():
        copy = tmp_path / path.name
        copy.write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
        page.put(texts, copy)
        text = copy.read_text(encoding="utf-8")
        assert ("**123** ×" in text or "| 123 |" in text) and "Xeon 2.5 GHz" not in "".join(texts.values()) and "## " in text


def test_a_machine_is_what_the_system_says(tmp_path: Path) -> None:
    """Not its name, and the clock that it was made for where that is known."""
    (tmp_path / "proc").mkdir()
    (tmp_path / "proc" / "cpuinfo").write_text("model name\t: Intel(R) Core(TM) i7 CPU @ 3.0GHz\ncpu MHz\t: 800.0\n")
    cpu = tmp_path / "sys" / "devices" / "system" / "cpu" / "cpu0"
    for number, (level, kind, size) in enumerate(
        [("1", "Data", "48K"), ("1", "Instruction", "32K"), ("2", "Unified", "2M")]
    ):
        folder = cpu / "cache" / f"index{number}"
        folder.mkdir(parents=True)
        for name, text in (("level", level), ("type", kind), ("size", size)):
            (folder / name).write_text(f"{text}\n")
    found = here(tmp_path)
    assert (found.processor, found.mhz, found.caches) == ("Intel(R) Core(TM) i7 CPU @ 3.0GHz", 800, {"L1": 48, "L2": 2048})
    assert found.cores >= 1 and found.short == "Core i7 0.8 GHz"
    (cpu / "cpufreq").mkdir()
    (cpu / "cpufreq" / "base_frequency").write_text("3000000\n")
    assert here(tmp_path).mhz == 3000
    assert here(tmp_path / "nothing").words


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--publish", "--only", "peak"], "--publish needs a whole run"),
        (["--publish", "--short"], "--publish needs a whole run"),
        (["--publish", "--short", "--only", "page"], "--publish needs a whole run"),
        (["--record", "--short"], "--record needs all rounds"),
        (["--pages", "--record"], "--pages measures nothing"),
    ],
)
def test_options_that_contradict_each_other_are_refused(words: list[str], said: str) -> None:
    done = subprocess.run([sys.executable, "-m", "benchmarks", *words], cwd=ROOT, env=FINDS, capture_output=True, text=True)
    assert done.returncode == 2 and said in done.stderr and not done.stdout


def test_an_unreadable_history_is_said_before_anything_is_measured(tmp_path: Path) -> None:
    bad = tmp_path / "bad.jsonl"
    bad.write_text("{\n")
    program = "from pathlib import Path; from benchmarks import history, __main__\n"
    program += f"history.read.__defaults__ = (Path({str(bad)!r}),)"
    done = subprocess.run(
        [sys.executable, "-c", f"{program}\nraise SystemExit(__main__.main())", "--only", "peak"],
        cwd=ROOT, env=FINDS, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2 and f"tools/bench: error: {bad}, line 1: must be JSON" in done.stderr
