"""docs/extending/contact-law.md does what it says: by name from the command line, in `simulate`, and in an engine."""

import pytest

from synth.solver import contact_laws
from synth.solver.contact_laws import ContactLaw, check_scheme, register
from synth.solver.laws import law_of
from synth.solver.schemes import LAWS, SCHEMES
from tests.extending.pages import install, run, type_commands, write_files

SIMULATED = """
import felt
import numpy as np
from synth import simulate

soft = simulate("tanpura", duration=0.02, modes=40, scheme="felt")
rigid = simulate("tanpura", duration=0.02, modes=40, tail="static")
assert np.abs(soft.u - rigid.u).max() > 0.01 * np.abs(rigid.u).max()
# pressed in by what the felt gives way under the force, and no deeper
assert 0.2 < soft.contact_force.max() / rigid.contact_force.max() < 2.0
assert 0.0 < soft.summary["largest_penetration_m"] < soft.contact_force.max() / felt.STIFFNESS_N_M
assert rigid.summary["largest_penetration_m"] < 1e-12
assert soft.summary["unsolved_steps"] == 0
"""

STONE = """
import felt
import numpy as np
from synth import simulate

# a stop that is stiffer gives less, and in the end is the rigid one
rigid = simulate("tanpura", duration=0.02, modes=40, tail="static")
stone = simulate("tanpura", duration=0.02, modes=40, scheme="felt")
assert rigid.contact_force.any() and np.abs(stone.u - rigid.u).max() < 1e-6 * np.abs(rigid.u).max()
"""

PLAYED = """
import numpy as np
from synth import EVENT, Engine, load_preset
from synth.midi.events import BEND, NOTE_ON, make_events

rows = [(0, NOTE_ON, 0, 43, 100), (1500, BEND, 0, 3000), (2100, NOTE_ON, 0, 48, 60), (3900, NOTE_ON, 0, 43, 127)]
runs = []
for block, threads in ((4096, 1), (333, 2), (64, 1)):
    engine = Engine([load_preset("tanpura-light")], scheme="felt", quality="draft", limiter=False, threads=threads)
    engine.prepare(44100.0, 4096)
    out = np.zeros((9000, 2))
    for at in range(0, 9000, block):
        end = min(9000, at + block)
        here = [(row[0] - at, *row[1:]) for row in rows if at <= row[0] < end]
        engine.process(make_events(here) if here else np.zeros(0, EVENT), out[at:end])
    assert engine.report().unsolved_contacts == 0
    runs.append(out)
    engine.close()
assert np.isfinite(runs[0]).all() and np.abs(runs[0]).max() > 0.01
assert np.array_equal(runs[0], runs[1]) and np.array_equal(runs[0], runs[2])
"""


def installed(folder):
    names = [path.name for path in write_files("contact-law", folder)]
    assert names == ["felt.py", "pyproject.toml"]
    install(folder)


@pytest.mark.parametrize("program", [SIMULATED, PLAYED], ids=["simulated", "played"])
def test_the_law_does_what_it_says(tmp_path, program):
    installed(tmp_path)
    (tmp_path / "program.py").write_text(program)
    run(tmp_path, "python", "program.py")


def test_the_page_runs_and_a_hard_layer_is_the_rigid_stop(tmp_path):
    installed(tmp_path)
    type_commands("contact-law", tmp_path)
    law = (tmp_path / "felt.py").read_text()
    harder = law.replace("STIFFNESS_N_M = 2e5", "STIFFNESS_N_M = 1e13").replace("_S_M = 0.5", "_S_M = 0.0")
    assert harder != law
    (tmp_path / "felt.py").write_text(harder)
    (tmp_path / "program.py").write_text(STONE)
    run(tmp_path, "python", "program.py")


def nothing(model: int, state: int, scratch: int) -> int:
    return 0


def test_names_that_cannot_be():
    for name in ("", "Felt", "felt cloth", "-"):
        with pytest.raises(ValueError, match="lower-case letters, digits and hyphens, got"):
            register(ContactLaw(name, "", nothing))
    for name in ("exact-hold", "wall"):
        with pytest.raises(ValueError, match=f"there is a contact scheme '{name}' already"):
            register(ContactLaw(name, "", nothing))


def test_a_registered_law_is_known_by_its_name(monkeypatch):
    monkeypatch.setattr(contact_laws.LAWS_ADDED, "known", {})
    law = register(ContactLaw("soft", "", nothing))
    assert register(law) is law and check_scheme("soft", LAWS) == "soft" and law_of("soft") == law_of("exact-hold")
    with pytest.raises(
        ValueError, match=r"unknown contact scheme 'sof' \(perhaps soft\?\); use one of exact-hold, .*, soft"
    ):
        check_scheme("sof", SCHEMES)
    with pytest.raises(ValueError, match="there is a contact scheme 'soft' already"):
        register(ContactLaw("soft", "another", nothing))
