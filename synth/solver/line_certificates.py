"""Whether a string whose end moves can touch anything: a bound, not a guess, so that no sound depends on it.

No free motion brings a contact deeper than Σ |φ_j| E_j (`certificates`). What the bridge does adds to that: a kick of the
end by a moves it by at most a Σ |φ_j c_j|/ω_j at any later time, and the end itself by ξ b. A line is certified with what is
left to the nearest contact, and this is spent frame by frame. A block in which it is used up is gone through once more, with
the line's contacts looked at.
"""

from __future__ import annotations

from numba import njit

from synth.solver.certificates import MARGIN, extents
from synth.solver.coupling import ENGAGED, KICK_REACH, LARGEST_LEVERAGE, SPENT, coupling_at, end_at
from synth.solver.stringmodel import string_model, string_state
from synth.solver.vectors import FAST

#: a contact is certified if it is clear by so many times what has been spent since the line was last asked
_RESERVE = 2.0


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_reach(model: int, end: int) -> None:
    """What certificates need to know of a line's contacts, once End.kick and leverage are there."""
    m, e = string_model(model), end_at(end)
    furthest, largest = 0.0, 0.0
    for c in range(m.shapes.shape[0]):
        total = 0.0
        for j in range(m.modes):
            total += abs(m.shapes[c, j] * e.kick[j]) / m.omega[j]
        furthest = max(furthest, MARGIN * total)
        largest = max(largest, abs(e.leverage[c]))
    e.numbers[KICK_REACH] = furthest
    e.numbers[LARGEST_LEVERAGE] = largest


@njit(cache=True, nogil=True, fastmath=FAST)
def certify_line(coupling: int, line: int, spare) -> int:
    """How many contacts free flight of a line, its end standing where it is, may touch: those whose clearance is not
    positive after this. spare (≥n,) is work space."""
    c = coupling_at(coupling)
    m, s, e = string_model(c.line_model[line]), string_state(c.line_state[line]), end_at(c.line_end[line])
    height, n = 0.0, m.modes
    for i in range(c.beta.size):
        height += c.direction[line, i] * c.beta[i]
    extent = spare[:n]
    extents(m.omega[:n], s.q[:n], s.v[:n], extent)
    near = 0
    for k in range(m.shapes.shape[0]):
        total = 0.0
        for j in range(n):
            total += abs(m.shapes[k, j]) * extent[j]
        e.clearance[k] = e.leverage[k] * height - s.eta[k] - MARGIN * total
        if e.clearance[k] <= _RESERVE * e.numbers[SPENT]:  # would not last
            e.clearance[k] = 0.0
            near += 1
    e.numbers[SPENT] = 0.0
    return near


@njit(cache=True, nogil=True)
def spend(coupling: int, line: int, frames: int) -> bool:
    """Take what bridge and finger have done in the last `frames` frames off a line's clearances; whether all contacts that
    were not looked at have some left. Forces of contacts end every certificate."""
    c = coupling_at(coupling)
    m, s, e = string_model(c.line_model[line]), string_state(c.line_state[line]), end_at(c.line_end[line])
    contacts = m.shapes.shape[0]
    speed, kicked, moved = 0.0, 0.0, 0.0
    for i in range(c.beta.size):
        speed += c.direction[line, i] * c.kept[0, i]
    for k in range(frames):
        turn = 0.0
        for i in range(c.beta.size):
            turn += c.direction[line, i] * c.kicks[i, k]
        speed += turn
        kicked += abs(turn)
        moved += abs(speed)
    spent = e.numbers[KICK_REACH] * kicked + e.numbers[LARGEST_LEVERAGE] * c.frame * moved
    e.numbers[SPENT] += spent
    pushed = e.pushed[0] if e.counts[ENGAGED] else 0.0
    enough = True
    for k in range(contacts):
        if e.clearance[k] > 0.0:
            e.clearance[k] -= spent + (s.grip_far[k] * pushed if pushed > 0.0 else 0.0)
            enough = enough and e.clearance[k] > 0.0 and not (e.counts[ENGAGED] and e.pushed[1] > 0.0)
    return enough


@njit(cache=True, nogil=True)
def look_everywhere(end: int) -> None:
    """No contact of a line is certified any more."""
    e = end_at(end)
    e.clearance[:] = 0.0
