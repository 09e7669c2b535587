"""Rows of one line over the steps of a frame: of the contacts that are looked at, and of a finger that is on.

Each is what free flight and the kick at the start make of it, plus sums over the forces; beside it goes what it changes by
with the speed of the line's end. What a step's forces are is `line_forces` and `line_layers`.
"""

from __future__ import annotations

from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.coupling import NEAR
from synth.solver.lanes import add_late
from synth.solver.laws import EXACT_HOLD
from synth.solver.stepwise import finger_blend, finger_target

#: of numbers that tell sets of contacts apart
MIX = 1000003
#: of sets that were made one by one, by their diagonal: as laxly as `lcp` takes them
LEAST_PIVOT = 1e-16


@njit(inline="always")
def begin_rows(m, s, e, w, first: int, steps: int, turn: float) -> None:
    """Scratch.rows.u, and Scratch.rows.forces as its slopes, of contacts and finger, from step `first` of the block on."""
    several, contacts = e.counts[NEAR], m.contacts.size
    for i in range(several + 1 if s.finger[0].on != 0 else several):
        row = e.block.u[i] if i < several else e.block.u[contacts]
        moved = e.responses.moved[e.block.near[i]] if i < several else e.responses.finger_moved[0]
        for t in range(BLOCK):
            w.rows.u[i, t] = row[first + t] + moved[BLOCK + t] * turn if t < steps else 0.0
            w.rows.forces[i, t] = moved[BLOCK + t] if t < steps else 0.0


@njit(inline="always")
def push_of_finger(s, e, w, dt: float, step: int, t: int, here: float, here_slope: float) -> tuple[float, float, float]:
    """(push, its slope, its row's compliance) of a finger in step t, number `step` of its path, without contacts; where it
    was before, and the slope of that."""
    finger, row = s.finger[0], e.counts[NEAR]
    blend, compliance = finger_blend(EXACT_HOLD, dt, finger.stiffness, finger.resistance)
    target = finger_target(EXACT_HOLD, dt, finger.stiffness, finger.resistance, e.path[step], e.path[step + 1], here)
    total = s.grip.own[0, BLOCK] + compliance
    slope = finger.resistance / dt * here_slope / blend - w.rows.forces[row, t]
    return (target / blend - w.rows.u[row, t]) / total, slope / total, total


@njit(inline="always")
def act_on_rows(
    m, s, e, w, first: int, t: int, push: float, push_slope: float, total: float, later: bool
) -> tuple[float, float]:
    """Step t's forces, End.block.forces and slopes of the contacts and the finger's without them, act on the rows of it and
    later steps: (mean force on the bridge, its slope). Without `later` ones the rows of contacts are left as they are."""
    several, contacts, near, fingered = e.counts[NEAR], m.contacts.size, e.block.near, s.finger[0].on != 0
    force, slope = 0.0, 0.0
    if fingered:
        for i in range(several):
            share_of_it = s.grip.contacts[near[i], BLOCK] / total
            push -= share_of_it * e.block.forces[i, first + t]
            push_slope -= share_of_it * e.block.slopes[i, first + t]
        e.block.forces[contacts, first + t], e.block.slopes[contacts, first + t] = push, push_slope
        add_late(w.rows.u[several], s.grip.own[0], t, push)
        add_late(w.rows.forces[several], s.grip.own[0], t, push_slope)
        force += e.responses.finger_reach[0, t] * push
        slope += e.responses.finger_reach[0, t] * push_slope
    for i in range(several):
        c = near[i]
        if fingered:
            add_late(w.rows.u[i], s.grip.contacts[c], t, push)
            add_late(w.rows.forces[i], s.grip.contacts[c], t, push_slope)
        pressed, change = e.block.forces[i, first + t], e.block.slopes[i, first + t]
        if pressed > 0.0:
            for d in range(several if later else 0):
                add_late(w.rows.u[d], m.contacts.lags[near[d], c], t, pressed)
                add_late(w.rows.forces[d], m.contacts.lags[near[d], c], t, change)
            if fingered:
                add_late(w.rows.u[several], s.grip.contacts[c], t, pressed)
                add_late(w.rows.forces[several], s.grip.contacts[c], t, change)
            force += e.responses.reach[c, t] * pressed
            slope += e.responses.reach[c, t] * change
    return force, slope
