"""The kernels whose cost is measured: those by which the program runs a scene of one of its laws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from synth.native.views import table
from synth.research.scene import Scene
from synth.solver import driver
from synth.solver.certificates import CERTIFY_FROM
from synth.solver.laws import EXACT_HOLD
from synth.solver.step import advance
from synth.solver.stepwise import one_by_one
from synth.solver.stringmodel import Strung, with_outputs
from synth.solver.study import DIVIDE, certify_watch
from synth.solver.substeps import advance_substepped

#: of one call: as many as a large block of an engine has
STEPS = 1024


def kernel_of(scene: Scene) -> Callable[[], np.ndarray]:
    """What takes the next `STEPS` steps of a scene and returns its first output after each, (STEPS,), valid until then.

    In blocks (`step.advance`), with certificates where the driver has them; over more points than there is a table of
    responses for, one by one. Sub-steps over one point are blocks of parts Δt/K with an output after every part, over
    several `substeps.advance_substepped`. The scene has no finger, its obstacle and its tension stay.
    """
    m = scene.model
    q, v = scene.initial()
    q, force, _ = driver.static_contact(m, q)
    run = driver.start_run(m, q, v, force, STEPS, 2, False, scene.case.scheme.start == "published")
    if m.parts > 1 and m.under.eta.size > 1:
        return _substepped(m, run)
    hold, contacts = m.string.law == EXACT_HOLD, m.under.eta.size
    certified = int(hold and contacts >= CERTIFY_FROM)
    model = with_outputs(m.part if contacts == 1 else m.string, 0, 1, 1)._replace(certified=certified)
    in_blocks = model.step == 0 and model.contacts.lags.shape[0] == contacts
    steps = STEPS * (m.parts if contacts == 1 else 1)
    string = Strung(model, run.q, run.v, steps)
    string.state.u[:], string.state.v_contact[:], string.state.force[:] = run.u_contact, run.v_contact, run.force
    addresses = string.addresses

    def take() -> np.ndarray:
        if in_blocks:
            advance(*addresses, steps, 0)
        else:
            one_by_one(*addresses, 0, 0, steps)
        return string.out(steps)[0, steps // STEPS - 1 :: steps // STEPS]

    return take


def _substepped(m: driver.Model, run: driver.Run) -> Callable[[], np.ndarray]:
    study, kept = run.study(m, np.zeros(1), np.zeros(0))
    out = np.zeros(STEPS)
    parting = run.stepping._replace(record=run.part_records.reshape(-1), out=out)
    tables = [table(each) for each in (with_outputs(m.string, 0, 1, 1), with_outputs(m.part, 0, 0, 0), run.state, parting)]
    addresses = [each.ctypes.data for each in tables]

    def take() -> np.ndarray:
        assert kept and tables  # both must outlive the calls
        certify_watch(study.ctypes.data)
        advance_substepped(*addresses, m.parts, run.results.counts[DIVIDE:], run.records)
        return out

    return take
