"""What holds addresses stays in its process, and is not copied."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
import textwrap

import pytest

from synth.live.deck import Deck
from tests.patience import compiling_s

from .kit import FREE, engine


def test_what_holds_addresses_is_not_copied():
    made = engine(FREE, quality="draft", threads=2)
    for held in (made, made._team, Deck(made)):
        for copied in (copy.copy, copy.deepcopy, pickle.dumps):
            with pytest.raises(TypeError, match=f"{type(held).__name__} cannot be copied or pickled"):
                copied(held)
    made.close()


def test_a_forked_child_goes_on_alone():
    """It has no workers; in its parent they work on."""
    program = """
        import os, sys, warnings
        import numpy as np
        from synth.engine.engine import Engine
        from synth.engine import team
        from synth.midi.events import make_events
        from synth.instrument.preset import load_preset
        warnings.simplefilter("ignore")  # that threads and fork do not go together
        made = Engine([load_preset("tanpura-light")], threads=3, quality="draft", only_notes=[{43, 48}])
        made.prepare(44100.0)
        notes = make_events([(0, 1, 0, 43, 100), (9, 1, 0, 48, 100)])
        made.process(notes, np.zeros((2000, 2)))
        here, there = os.pipe()
        child = os.fork()
        out = np.zeros((2000, 2))
        if child == 0:
            made.process(notes, out)
            os.write(there, bytes([made._shared.team[team.WORKERS]]) + out.tobytes())
            os._exit(0)
        os.close(there)
        made.process(notes, out)
        with os.fdopen(here, "rb") as file:
            workers, heard = file.read(1)[0], np.frombuffer(file.read()).reshape(-1, 2)
        assert os.waitpid(child, 0)[1] == 0
        assert workers == 0 and made._shared.team[team.WORKERS] > 0
        assert out.any() and np.array_equal(heard, out)
        made.close()
        print("done")
    """
    program = textwrap.dedent(program)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=compiling_s(), check=False
    )
    assert done.stdout == "done\n", done.stderr
