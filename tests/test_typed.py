"""What a type checker makes of a program that uses this package: the wheel says that it is typed, and it is."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import synth

ROOT = Path(__file__).resolve().parents[1]

PROGRAM = """
import numpy as np
import synth
from synth import Note, Sound

sound: Sound = synth.render([Note(48, 90, 2.0), (55, 80, 1.0)], "tanpura", quality="draft", tail=1.0)
reveal_type(synth.render("song.mid"))
reveal_type(sound.samples)
reveal_type(sound.part(0.0, 1.0).report.notes)
sound.save("a.flac", bit_depth="16")
loud: float = float(np.abs(sound).max())
run = synth.simulate("tanpura", quality="draft", duration_s=0.1)
reveal_type(run)
if isinstance(run, synth.Result):
    reveal_type(run.u)
    reveal_type(run.largest_penetration_m)
    run.plot("u", start_s=0.0)
reveal_type(synth.load_result("run.npz"))
reveal_type(synth.load_preset("tanpura").name)
for each in synth.render_notes("tanpura", [(48, 90)]):
    reveal_type(each.rate_hz)
"""
REVEALED = (
    "synth.host.soundclip.Sound", "numpy.ndarray", "int", "synth.research.result.Result",
    "synth.research.coupled.coupled_result.CoupledResult", "numpy.ndarray", "float", "synth.research.result.Result", "str",
    "int",
)  # fmt: skip

#: a line that is wrong, and what is said of it
WRONG = {
    'synth.rendr("song.mid")': 'Module has no attribute "rendr"',
    'synth.render("song.mid", qualty="draft")': 'Unexpected keyword argument "qualty" for "render"',
    'synth.render("song.mid", quality=3)': 'Argument "quality" to "render" has incompatible type "int"',
    'synth.simulate("tanpura", modes="many")': 'Argument "modes" to "simulate" has incompatible type "str"',
    'n: str = synth.render("song.mid").rate_hz': 'expression has type "int", variable has type "str"',
    'synth.Note("C3")': 'Argument 1 to "Note" has incompatible type "str"',
}


def checked(folder: Path, program: str) -> subprocess.CompletedProcess[str]:
    """What mypy --strict says of a program outside of this repository."""
    pytest.importorskip("mypy")
    (folder / "program.py").write_text(program, encoding="utf-8")
    (folder / "mypy.ini").write_text("[mypy]\n[mypy-synth.*]\nignore_errors = True\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "mypy.ini", "program.py"]
    cache = {"MYPY_CACHE_DIR": str(folder / "cache"), "MYPYPATH": str(folder / "site")}
    (folder / "site").mkdir()
    (folder / "site" / "synth").symlink_to(ROOT / "synth", target_is_directory=True)
    return subprocess.run(command, cwd=folder, env={**os.environ, **cache}, capture_output=True, text=True)


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Lines of mypy's, of the program that is right with what is wrong behind it; it is asked once, for it takes a while."""
    program = PROGRAM + "".join(f"{line}\n" for line in WRONG)
    return [line for line in checked(tmp_path_factory.mktemp("typed"), program).stdout.splitlines() if "program.py" in line]


def test_a_program_passes_the_strict_check(said: list[str]) -> None:
    first_wrong = PROGRAM.count("\n") + 1
    errors = [line for line in said if ": error:" in line]
    assert [line for line in errors if int(line.split(":")[1]) < first_wrong] == []
    revealed = " ".join(line.partition("Revealed type is")[2] for line in said if "Revealed type" in line)
    at = 0
    for name in REVEALED:
        at = revealed.find(name, at)
        assert at >= 0, (name, revealed)
        at += len(name)


@pytest.mark.parametrize("number", range(len(WRONG)), ids=list(WRONG))
def test_what_is_wrong_is_found(said: list[str], number: int) -> None:
    line = PROGRAM.count("\n") + 1 + number
    words = list(WRONG.values())[number]
    assert any(each.startswith(f"program.py:{line}: error: ") and words in each for each in said), [
        each for each in said if each.startswith(f"program.py:{line}:")
    ]


def test_every_public_name_is_known_to_a_checker() -> None:
    """What is loaded when it is first used is imported for type checkers, too, and listed once."""
    source = (ROOT / "synth" / "__init__.py").read_text(encoding="utf-8")
    block = source.partition("if TYPE_CHECKING:")[2].partition("__all__")[0]
    assert set(synth.__all__) - {"__version__"} == set(synth._MODULES)
    for name, module in synth._MODULES.items():
        line = next(line for line in block.splitlines() if line.strip().startswith(f"from {module} import "))
        assert name in line.partition(" import ")[2].split(", ")
        assert getattr(synth, name) is not None


def test_the_wheel_says_that_it_is_typed() -> None:
    """All of synth/ goes into it but compiled files; `tools/wheel --check` looks at a wheel that is installed."""
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"][
        "wheel"
    ]
    assert wheel["packages"] == ["synth"] and wheel["exclude"] == ["__pycache__"]
    assert (ROOT / "synth" / "py.typed").read_bytes() == b""
