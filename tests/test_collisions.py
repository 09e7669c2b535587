"""The benchmark of collisions: its scorer on runs that are right, wrong and broken, its scenes fixed, its entries judged."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from benchmarks.collisions import FOLDER, VERSION, ContestError, commands, entries, report, runfile, scene
from benchmarks.collisions.resample import interpolated
from benchmarks.collisions.score import Score, horizon, score, shown

ROOT = Path(__file__).resolve().parents[1]
NAMES = scene.names()
NAME = "moving"  # short, touched by one point, known to 0.003


def scored(data, name=NAME) -> Score:
    facts, reference = scene.scene(name), scene.reference(name)
    arrays = {key: np.asarray(value) for key, value in data.items()}
    return score(runfile.brought(Path("run.npz"), arrays, facts, reference), facts, reference)


def copy(name=NAME, **more):
    return {"u": scene.reference(name).u, "rate_hz": scene.scene(name).rate_hz, **more}


def main(monkeypatch, *words) -> int:
    monkeypatch.setattr(sys, "argv", ["collisions", *map(str, words)])
    return commands.main()


@pytest.mark.parametrize("name", NAMES)
def test_scenes_and_references_are_those_of_this_version(name):
    """Whoever changes one must raise VERSION and make the manifest anew (`references`): scores by it are others then."""
    assert (VERSION, len(NAMES)) == (1, 14)
    facts, reference = scene.scene(name), scene.reference(name)
    assert facts.windows_s == tuple(sorted(facts.windows_s)) and facts.windows_s[-1] == pytest.approx(facts.duration_s)
    assert reference.u.shape == (facts.samples,) and np.all(np.isfinite(reference.u))
    assert len(reference.uncertainty) == len(reference.confirmed) == len(facts.windows_s)


def test_no_file_of_it_is_forgotten_and_all_of_it_is_small():
    assert scene.manifest() == json.loads(scene.MANIFEST.read_text(encoding="utf-8"))
    files = [path for path in FOLDER.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert sum(path.stat().st_size for path in files) < 3e6


def test_a_changed_scene_is_noticed(tmp_path, monkeypatch):
    """One digit of a scene: no score by it, and the message says which file."""
    path = scene.SCENES / "moving.toml"
    (tmp_path / path.name).write_bytes(path.read_bytes().replace(b"1.0e-3", b"1.1e-3"))
    monkeypatch.setattr(scene, "digest", lambda each: "0" if each == path else "other")
    with pytest.raises(ContestError, match=r"moving\.toml is not that of version 1"):
        scene.check(path)
    monkeypatch.undo()
    assert scene.digest(tmp_path / path.name) != scene.digest(path)


def test_line_ends_are_no_change(tmp_path):
    path = scene.SCENES / "moving.toml"
    (tmp_path / "crlf.toml").write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert scene.digest(tmp_path / "crlf.toml") == scene.digest(path)


@pytest.mark.parametrize("name", NAMES)
def test_a_copy_of_the_reference_has_no_error(name):
    found = scored(copy(name), name)
    assert found.e == [0.0] * len(found.scene.windows_s) and found.lsd_db == 0.0
    assert shown(found.e[-1], found.uncertainty[-1]).startswith("≤ ")
    assert found.horizon_open and found.suspicions == []


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("ratio", [48 / 44.1, 96 / 44.1, 3.2])
def test_a_copy_at_another_rate_scores_below_its_uncertainty(name, ratio):
    """The band-limited curve through the kept samples, sampled anew: what interpolation to and fro makes, e < 1e-3."""
    facts, reference = scene.scene(name), scene.reference(name)
    t = np.arange(int(facts.duration_s * facts.rate_hz * ratio) + 1) / (facts.rate_hz * ratio)
    found = scored({"u": interpolated(reference.u, facts.rate_hz, t), "rate_hz": facts.rate_hz * ratio}, name)
    assert not found.run.picked
    assert all(e < 1e-3 for e in found.e)
    assert all(e <= u for e, u in zip(found.e, found.uncertainty, strict=True))
    assert all(u > own for u, own in zip(found.uncertainty, reference.uncertainty, strict=True))


@pytest.mark.parametrize("rate_hz", [48_000.0, 96_000.0, 50_123.0])
def test_interpolation_is_exact_below_the_band_edge(rate_hz):
    """Sines up to 0.4 of the rate, mirrored at the start as they are even in t: 1e-4 of their amplitude, ends left out."""
    t = np.arange(4000) / 44_100.0
    n = np.arange(int(t[-1] * rate_hz) + 80)
    for f in (110.0, 3_000.0, 0.4 * 44_100.0):
        wanted = np.cos(2 * np.pi * f * t)
        found = interpolated(np.cos(2 * np.pi * f * n / rate_hz), rate_hz, t)
        assert np.abs(found - wanted).max() < 1e-4


def test_multiples_are_picked_not_filtered():
    """Every third sample counts, whatever stands between."""
    facts, reference = scene.scene(NAME), scene.reference(NAME)
    u = np.full(3 * facts.samples - 2, 7.0)
    u[::3] = reference.u
    found = scored({"u": u, "t": np.arange(u.size) / (3 * facts.rate_hz)})
    assert found.run.picked and found.e == [0.0, 0.0] and found.run.rate_hz == 3 * facts.rate_hz


def test_a_known_error_is_found_to_rounding():
    """u = (1 + a) u_ref has e = |a|; an error in the last third alone leaves the first window as it was."""
    reference = scene.reference(NAME)
    assert scored(copy(u=1.02 * reference.u)).e == pytest.approx([0.02, 0.02], rel=1e-9)
    late = reference.u.copy()
    late[-1700:] *= -1.0
    found = scored(copy(u=late))
    expected = 2 * np.sqrt(np.sum(reference.u[-1700:] ** 2) / np.sum(reference.u**2))
    assert found.e[0] == 0.0 and found.e[1] == pytest.approx(expected, rel=1e-12)
    turned = (reference.u.size - 1700) / 44_100
    assert turned - 0.02 <= found.horizon_s <= turned and not found.horizon_open


def test_the_horizon_is_when_they_part():
    t = np.arange(44_100) / 44_100
    ref = np.exp(-3 * t) * np.cos(2 * np.pi * 100 * t)
    assert horizon(ref, ref, 44_100, 0.02) == pytest.approx(t[-1])
    for when in (0.2, 0.7):
        parted = np.where(t < when, ref, np.exp(-3 * t) * np.sin(2 * np.pi * 100 * t))
        assert when - 0.02 <= horizon(parted, ref, 44_100, 0.02) <= when


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda u: 1000 * u, "mm for m"),
        (lambda u: 1e6 * u, "µm for m"),
        (lambda u: u / 1000, "divided by 1000"),
        (lambda u: 3 * u, "3 times the reference"),
        (lambda u: -u, "the sign is reversed"),
        (lambda u: np.concatenate([np.full(7, u[0]), u[:-7]]), "7 samples of the reference too late"),
        (lambda u: np.concatenate([u[5:], np.zeros(5)]), "5 samples of the reference too early"),
        (np.zeros_like, "zero throughout"),
    ],
)
@pytest.mark.parametrize("name", ["moving", "bass", "flat-wall"])
def test_what_is_probably_wrong_is_told_and_not_mended(name, change, words):
    found = scored(copy(name, u=change(scene.reference(name).u)), name)
    assert any(words in line for line in found.suspicions)
    assert found.e[-1] > 0.05


def test_a_merely_bad_run_is_not_suspected():
    """Two runs of the bass that chaos has parted, and noise."""
    rng = np.random.default_rng(1)
    u = scene.reference("bass").u
    assert scored(copy("bass", u=rng.normal(size=u.size) * u.std()), "bass").suspicions == []
    parted = u.copy()
    parted[3000:] += 0.5 * u.std() * rng.normal(size=u.size - 3000)
    assert scored(copy("bass", u=parted), "bass").suspicions == []


def test_a_run_that_ends_early_is_scored_as_far_as_it_goes():
    reference = scene.reference("tanpura")
    found = scored(copy("tanpura", u=reference.u[:20_000]), "tanpura")
    assert found.e == [0.0, 0.0, None] and found.lsd_db is None
    assert "ends before the end of the scene" in report.of_scores([found])
    # the last instant may be left out, as ranges do
    assert scored(copy(u=scene.reference(NAME).u[:-1])).e == [0.0, 0.0]


def test_contacts_energy_and_cost_are_read():
    facts = scene.scene("thirds")
    u = scene.reference("thirds").u
    contact = np.zeros((u.size, 2))
    contact[100, 1] = -0.3e-3 - 2e-6
    force = np.zeros((u.size, 2))
    force[200] = 5.0, -1.0
    energy = np.linspace(2.0, 1.0, u.size)
    energy[300] += 0.2
    found = scored(
        copy("thirds", u_contact=contact, contact_force=force, energy=energy, cost_s=0.5, scheme="mine"), "thirds"
    )
    assert found.penetration_m == pytest.approx(2e-6) and found.pull_n == 1.0
    assert found.impulse == pytest.approx(4.0 / facts.rate_hz / scene.reference("thirds").impulse_n_s)
    assert found.energy_rise == pytest.approx(0.1, rel=0.01)
    text = report.of_scores([found])
    assert "2 µm" in text and "0.5 s" in text and "pull, with up to 1 N" in text


BROKEN = [
    ({"u": np.full(5293, np.nan), "rate_hz": 44_100}, "must be finite, got 5293 NaN or infinite of 5293, the first at 0"),
    ({"rate_hz": 44_100}, "has no array 'u'"),
    ({"u": np.zeros(5293)}, "has neither 't' nor 'rate_hz'"),
    ({"u": np.zeros((5293, 2)), "rate_hz": 44_100}, r"must be one row of samples \(n,\), got shape \(5293, 2\)"),
    ({"u": np.zeros(0), "rate_hz": 44_100}, "must be one row"),
    ({"u": np.zeros(1), "rate_hz": 44_100}, "has 1 samples"),
    ({"u": np.zeros(100), "rate_hz": 44_100}, "lasts 0.002245 s, but the shortest window"),
    ({"u": np.zeros(5293), "rate_hz": 0}, "'rate_hz' must be the rate of u in Hz, got 0"),
    ({"u": np.zeros(5293), "rate_hz": 44.1}, "is too low to interpolate"),
    ({"u": np.zeros(5293), "rate_hz": 44_000}, "sample at a multiple of 44100 Hz, or at 48000 Hz at least"),
    ({"u": np.zeros(5293), "t": np.arange(1, 5294) / 44_100}, "must begin at 0 s"),
    ({"u": np.zeros(5293), "t": np.arange(5293)[::-1] / 44_100}, "must begin at 0 s"),
    ({"u": np.zeros(5293), "t": np.arange(5292) / 44_100}, "must have the 5293 samples of u, got 5292"),
    ({"u": np.zeros(5293), "t": (np.arange(5293) / 5293) ** 2}, "evenly spaced"),
    ({"u": np.zeros(5293), "t": np.arange(5293) / 44_100, "rate_hz": 48_000}, "leave one of them out"),
    ({"u": np.zeros(5293) + 1j, "rate_hz": 44_100}, "must hold real numbers"),
    ({"u": np.array(["a"]), "rate_hz": 44_100}, "must hold real numbers"),
    ({"u": np.zeros(5293), "rate_hz": 44_100, "cost_s": -1.0}, "'cost_s' must be one number of at least 0"),
    ({"u": np.zeros(5293), "rate_hz": 44_100, "energy": np.zeros(3)}, r"'energy' must have the shape \(5293,\)"),
    ({"u": np.zeros(5293), "rate_hz": 44_100, "u_contact": np.zeros((5293, 4))}, r"the shape \(5293, 1\)"),
    ({"u": np.zeros(5293), "rate_hz": 44_100, "scheme": np.array([1, 2])}, "'scheme' must be one text"),
]


@pytest.mark.parametrize(("data", "words"), BROKEN, ids=lambda value: value if isinstance(value, str) else "")
def test_what_cannot_be_scored_is_one_line(data, words):
    with pytest.raises(ContestError, match=words) as caught:
        scored(data)
    assert str(caught.value).startswith("run.npz: ") and "\n" not in str(caught.value)


def test_wrong_files_end_with_exit_code_2_and_write_nothing(tmp_path, monkeypatch, capsys):
    """One line for each, none of them scored, no output."""
    good, bad, other = tmp_path / "good.npz", tmp_path / "bad.npz", tmp_path / "other.npz"
    np.savez(good, scene=NAME, **copy())
    bad.write_bytes(good.read_bytes()[:5000])
    np.savez(other, scene="tampura", **copy())
    out = tmp_path / "out.json"
    assert main(monkeypatch, "score", good, bad, other, tmp_path / "none.npz", "--json", out) == 2
    printed = capsys.readouterr()
    lines = printed.err.splitlines()
    assert printed.out == "" and not out.exists() and len(lines) == 3
    assert all(line.startswith("collisions: error: ") for line in lines)
    assert "bad.npz cannot be read" in lines[0] and "'tampura' (perhaps tanpura?)" in lines[1] and "none.npz" in lines[2]
    np.savez(bad, u=np.zeros(5293), rate_hz=44_100.0)
    assert main(monkeypatch, "score", bad) == 2 and "has no 'scene'" in capsys.readouterr().err
    assert main(monkeypatch, "score", good, "--scene", "bass") == 2 and "leave one of them out" in capsys.readouterr().err
    assert main(monkeypatch, "score", good, "--json", good) == 2 and "would overwrite" in capsys.readouterr().err


def test_a_run_of_the_wrong_scene_is_no_score_to_be_proud_of():
    """Nothing can know it, but nobody can take it for right."""
    other = scene.reference("two-close").u
    assert scored({"u": other, "rate_hz": 44_100}, NAME).e[-1] > 0.5


def test_scores_as_json_and_as_an_entry(tmp_path, monkeypatch, capsys):
    run, found, entry = tmp_path / "run.npz", tmp_path / "found.json", tmp_path / "mine.json"
    np.savez(run, scene=NAME, scheme="mine", cost_s=0.25, internal_rate_hz=44_100.0, modes=9, **copy())
    head = ["--name", "A", "--made-by", "B", "--source", "C"]
    assert main(monkeypatch, "score", run, "--entry", entry, *head) == 2
    assert "give --machine" in capsys.readouterr().err and not entry.exists()
    assert main(monkeypatch, "score", run, "--json", found, "--entry", entry, *head, "--machine", "D") == 0
    assert "| run.npz | ≤ " in capsys.readouterr().out
    record = json.loads(found.read_text(encoding="utf-8"))["scores"][0]
    assert record["e"] == [0.0, 0.0] and record["scheme"] == "mine" and record["suspicions"] == []
    kept = entries.read(entry)
    assert kept["benchmark"] == VERSION and kept["scores"][0]["cost_s"] == 0.25
    rows = report.by_scene([kept])[NAME]
    assert "| A: mine | ≤ " in report.scene_table(rows)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"benchmark": 0}, "is of version 0 of the benchmark, this is 1"),
        ({"machine": 3}, "'machine' must be str"),
        ({"scores": [{"scene": "mars", "scheme": "x"}]}, "'scene' must be one of"),
        ({"scores": [{"scene": NAME, "scheme": "x"}]}, "'e' must be a list of numbers"),
        (
            {"scores": [{"scene": NAME, "scheme": "x", "e": ["small"], "uncertainty": [0], "windows_s": [1]}]},
            "'e' must be a list",
        ),
        ({"scores": [{"scene": NAME, "scheme": "x", "e": [0.1], "uncertainty": [0, 1], "windows_s": [1]}]}, "of one length"),
        ({"scores": ["x"]}, "'scene' must be one of"),
        ({"scores": [{"scene": NAME, "scheme": "x", "blown_up": True, "source": 3}]}, "'source' must be str"),
    ],
)
def test_an_entry_that_is_wrong_is_refused(tmp_path, change, words):
    whole = {"benchmark": VERSION, "name": "A", "made_by": "B", "source": "C", "machine": "D", "scores": []}
    path = tmp_path / "entry.json"
    path.write_text(json.dumps(whole | change), encoding="utf-8")
    with pytest.raises(ContestError, match=words):
        entries.read(path)
    path.write_text("{", encoding="utf-8")
    with pytest.raises(ContestError, match="not valid JSON"):
        entries.read(path)


def test_scores_say_on_which_machine_they_ran(tmp_path):
    """Scenes run on another machine are told apart; the file's origin changes when none of the old scores are left."""
    path = tmp_path / "entry.json"

    def ran(name, machine):
        head = {"name": "A", "made_by": "B", "source": f"version of {machine}", "machine": machine}
        entries.merge(path, head, [{"scene": name, "scheme": "x", "does_not_apply": "no"}])
        return entries.read(path)

    ran("bass", "M")
    assert ran("sitar", "M")["scores"] == [
        {"scene": name, "scheme": "x", "does_not_apply": "no"} for name in ("bass", "sitar")
    ]
    both = ran("sitar", "N")
    assert both["machine"] == "M" and "machine" not in both["scores"][0]
    assert (both["scores"][1]["machine"], both["scores"][1]["source"]) == ("N", "version of N")
    assert report.origins([both]) == "- A: M; version of M\n- A, `sitar`: N; version of N"
    whole = ran("bass", "N")
    assert whole["machine"] == "N" and not any("machine" in record for record in whole["scores"])
    assert report.origins([whole]) == "- A: N; version of N"


def test_entries_of_every_scheme_are_in_the_page():
    """Its tables are those of the entries: `tools/collisions page`."""
    from benchmarks.collisions import pagetables

    text = (ROOT / "docs" / "collisions.md").read_text(encoding="utf-8")
    for name, part in pagetables.parts().items():
        assert name == "version" or f"<!-- {name} -->\n\n{part.strip()}\n\n<!-- /{name} -->" in text, name
    ours = [record for entry in entries.all_entries() if entry["name"] == "jawari" for record in entry["scores"]]
    schemes = {record["scheme"] for record in ours}
    for name in NAMES:  # a figure or a reason for each
        here = {record["scheme"] for record in ours if record["scene"] == name}
        assert {"wall", "event-driven", "compliant (penalty), Newton", "waveguide", "cabannes", "flat-wall"} <= here
    assert {"exact-hold + lumped tail", "Moreau–Jean, printed, e = 0", "Moreau–Jean, filtered, e = 1"} <= schemes


def test_the_scorer_loads_no_solver():
    """NumPy and the measures: another group scores without compiling anything."""
    words = "import sys; from benchmarks.collisions import commands; print(*{m.partition('.')[0] for m in sys.modules})"
    environment = os.environ | {"PYTHONPATH": str(ROOT / "tools")}
    done = subprocess.run(
        [sys.executable, "-c", words], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    assert "numpy" in done.stdout.split() and not {"numba", "scipy", "pydantic"} & set(done.stdout.split())
