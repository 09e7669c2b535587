"""Whether a string whose end moves can touch anything: a bound, not a guess, so that no sound depends on it.

No free motion brings a contact deeper than Σ |φ_j| E_j (`certificates`). What the bridge does adds to that: a kick of the
end by a moves it by at most a Σ |φ_j c_j|/ω_j at any later time (`coupling.most_of_contacts`), and the end itself by ξ b. A
line is certified with what is left to the nearest contact, and this is spent frame by frame. A line that can touch
something, but not within the next block, goes through it like one that cannot. A block in which what was left is used up is
gone through once more, with the line's contacts looked at.
"""

from __future__ import annotations

from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.certificates import MARGIN, extents
from synth.solver.coupling import (
    CERTIFIED,
    CLEAR,
    EVER,
    KICK_REACH,
    KIND,
    LARGEST_LEVERAGE,
    LATELY,
    LATELY_RISEN,
    LEAST,
    QUIET,
    RISEN,
    SEVERAL,
    SINGLE,
    SLACK,
    SPENT,
    along,
    coupling_at,
    end_at,
)
from synth.solver.stringmodel import MOVING, scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER, dot

#: a contact is certified if it is clear by so many times what has been spent since the line was last asked
_RESERVE = 2.0
#: a line whose nearest contact is clear by more than so many times what has been spent is not certified anew
CLEAR_ENOUGH = 4.0
#: blocks without a force after which it is asked again what is clear: asking costs about what looking for one block does
_QUIET_BLOCKS = 4
#: left to the nearest contact where there is none
_FAR_AWAY_M = 1e6


@njit(cache=True, nogil=True, fastmath=FAST)
def certify_line(coupling: int, line: int, scratch: int) -> int:
    """How many contacts free flight of a line, its end standing where it is, may touch: those whose clearance is not
    positive after this. End.certificate.bound holds from here on."""
    c, w = coupling_at(coupling), scratch_of(scratch)
    m, s, e = string_model(c.lines.model[line]), string_state(c.lines.state[line]), end_at(c.lines.end[line])
    height, n = along(c, line, c.bridge.beta), s.counts[MOVING]
    extent, moved = w.modes.moved[0, :n], w.modes.moved[1, :n]
    time = BLOCK * c.frame
    extents(m.omega[:n], s.q[:n], s.v[:n], extent)
    for j in range(n):
        moved[j] = extent[j] * min(2.0, m.omega[j] * time)
    near, least, furthest = 0, _FAR_AWAY_M, 0.0
    for k in range(m.contacts.size):
        ever, soon = 0.0, 0.0
        for j in range(n):
            size = abs(m.contacts.shapes[k, j])
            ever += size * extent[j]
            soon += size * moved[j]
        e.certificate.bound[k] = MARGIN * soon
        furthest = max(furthest, MARGIN * ever)
        e.certificate.clearance[k] = e.leverage[k] * height - s.eta[k] - MARGIN * ever
        if e.certificate.clearance[k] <= _RESERVE * e.numbers[SPENT]:  # would not last
            e.certificate.clearance[k] = 0.0
            near += 1
        else:
            least = min(least, e.certificate.clearance[k])
    e.numbers[SPENT] = 0.0
    e.numbers[LEAST] = least
    e.numbers[EVER] = furthest
    e.numbers[RISEN] = 0.0
    e.counts[QUIET] = -1
    e.counts[CERTIFIED] = m.contacts.size - near
    return near


@njit(**INNER)
def is_clear(coupling: int, line: int, scratch: int) -> bool:
    """Whether all contacts of a line that are not certified are out of reach for a block: within K frames free flight
    moves a contact by no more than Σ |φ_j| E_j min(2, ω_j K H), and End.numbers[SLACK] is what is left to the nearest."""
    c = coupling_at(coupling)
    m, s, e = string_model(c.lines.model[line]), string_state(c.lines.state[line]), end_at(c.lines.end[line])
    contacts = m.contacts.size
    if e.counts[QUIET] >= 0:
        if e.counts[QUIET] < _QUIET_BLOCKS:
            return False
        certify_line(coupling, line, scratch)
    n, height, slack = m.modes, along(c, line, c.bridge.beta), _FAR_AWAY_M
    for k in range(contacts):
        if e.certificate.clearance[k] <= 0.0:
            here = dot(m.contacts.shapes[k, :n], s.q[:n]) + e.leverage[k] * height - s.eta[k]
            slack = min(slack, here - e.certificate.bound[k])
    e.numbers[SLACK] = slack - 2.0 * e.numbers[RISEN]
    return e.numbers[SLACK] > _RESERVE * e.numbers[LATELY]


@njit(inline="always")
def _stirred(e) -> tuple[bool, bool]:
    """Whether a finger, and whether contacts of a line have pushed it in the last block."""
    looked = e.counts[KIND] >= SINGLE
    return looked and e.certificate.pushed[0] > 0.0, looked and e.certificate.pushed[1] > 0.0


@njit(cache=True, nogil=True)
def lasts(coupling: int, line: int, frames: int) -> bool:
    """Whether all contacts of a line that were not looked at in the last `frames` frames have some clearance left after what
    bridge and finger have done; LATELY and LATELY_RISEN are the bridge's part, from End.block.kicks by frames. Forces of
    contacts end every certificate."""
    c = coupling_at(coupling)
    s, e = string_state(c.lines.state[line]), end_at(c.lines.end[line])
    pushed, pressed = _stirred(e)
    speed, kicked, moved = along(c, line, c.bridge.speed), 0.0, 0.0
    for k in range(frames - 1, -1, -1):
        turn = e.block.kicks[k]
        kicked += abs(turn)
        moved += abs(speed)
        speed -= turn
    e.numbers[LATELY_RISEN] = e.numbers[KICK_REACH] * kicked
    e.numbers[LATELY] = e.numbers[LATELY_RISEN] + e.numbers[LARGEST_LEVERAGE] * c.frame * moved
    enough = e.counts[KIND] != CLEAR or e.numbers[LATELY] < e.numbers[SLACK]
    if e.counts[CERTIFIED] == 0:
        return enough
    if not pushed:
        return enough and not pressed and e.numbers[LEAST] > e.numbers[LATELY]
    for k in range(string_model(c.lines.model[line]).contacts.size):
        if e.certificate.clearance[k] > 0.0:
            enough = enough and e.certificate.clearance[k] > e.numbers[LATELY] + s.grip.far[k] * e.certificate.pushed[0]
    return enough and not pressed


@njit(cache=True, nogil=True)
def spend(coupling: int, line: int) -> None:
    """Take what the last block has done, by `lasts`, off a line's clearances."""
    c = coupling_at(coupling)
    s, e = string_state(c.lines.state[line]), end_at(c.lines.end[line])
    pushed, pressed = _stirred(e)
    if pushed or pressed:
        e.counts[QUIET] = 0
    elif e.counts[QUIET] >= 0:
        e.counts[QUIET] += 1
    e.numbers[SPENT] += e.numbers[LATELY]
    e.numbers[RISEN] += e.numbers[LATELY_RISEN]
    if e.counts[CERTIFIED] > 0:
        least, clearance = _FAR_AWAY_M, e.certificate.clearance
        for k in range(string_model(c.lines.model[line]).contacts.size):
            if clearance[k] > 0.0:
                clearance[k] -= e.numbers[LATELY] + (s.grip.far[k] * e.certificate.pushed[0] if pushed else 0.0)
                least = min(least, clearance[k])
        e.numbers[LEAST] = least


@njit(**INNER)
def outlives_bend(end: int, ratio: float) -> bool:
    """Whether the certificate of a line that is not looked at still has a reserve after its frequencies have changed by this
    ratio, at most, and nothing else has: no E_j = √(q_j² + v_j²/ω_j²) has grown by more than 1/ratio."""
    e = end_at(end)
    lost = max(0.0, 1.0 / ratio - 1.0) * (e.numbers[EVER] + e.numbers[SPENT])
    for k in range(e.certificate.clearance.size):
        if e.certificate.clearance[k] > 0.0:
            e.certificate.clearance[k] = max(0.0, e.certificate.clearance[k] - lost)
    e.numbers[SPENT] += lost
    e.numbers[LEAST] -= lost
    return e.numbers[LEAST] > CLEAR_ENOUGH * e.numbers[SPENT]


@njit(cache=True, nogil=True)
def runs_out(coupling: int, line: int, frames: int) -> bool:
    """Whether a finger that goes on pushing as it does may use up what is left to a certified contact in so many frames: it
    is better to ask the contacts then than to go through the block twice."""
    c = coupling_at(coupling)
    s, e = string_state(c.lines.state[line]), end_at(c.lines.end[line])
    if s.finger[0].on == 0 or e.counts[CERTIFIED] == 0:
        return False
    strength = _RESERVE * abs(s.finger[0].push) * (frames * c.lines.steps[line])
    for k in range(string_model(c.lines.model[line]).contacts.size):
        if e.certificate.clearance[k] > 0.0 and e.certificate.clearance[k] < s.grip.far[k] * strength:
            return True
    return False


@njit(cache=True, nogil=True)
def look_everywhere(end: int) -> None:
    """No contact of a line is certified any more, nor clear for a while."""
    e = end_at(end)
    for k in range(e.certificate.clearance.size):
        e.certificate.clearance[k] = 0.0
    e.numbers[LEAST] = 0.0
    e.counts[CERTIFIED] = 0
    e.counts[QUIET] = 0
    e.counts[KIND] = SEVERAL
