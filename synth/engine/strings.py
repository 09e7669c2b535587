"""One physical string of the engine: waking, plucking, stopping at another fret, damping, advancing, falling asleep."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.layout import (
    CORE,
    DRAW,
    FAILED_LCP,
    NO_FINGER,
    PLUCK_AMOUNT,
    PLUCK_POSITION,
    PLUCK_WIDTH,
    PRESS,
    RELEASE,
    WORK,
)
from synth.solver.kernels import (
    FAST,
    Finger,
    Work,
    advance,
    advance_free,
    advance_one,
    amplitudes,
    cull,
    dot,
    finger_row,
    reach,
)
from synth.solver.laws import EXACT_HOLD, contact_matrix, step_coefficients

#: time in which the left hand brings a sounding string to a higher fret [s]
PRESS_S = 0.004
#: T60 of what a string still sounds while the plucking finger lies on it [s]
FINGER_S = 0.04
#: T60 of a stolen or silenced string [s]
CUT_S = 0.03
#: a mode leaves free flight for good when its largest possible output is below this (−160 dBFS)
PRUNE_BELOW = 1e-8
#: a string sleeps when its output is certain to stay below this (−100 dBFS; typically −120)
SLEEP_BELOW = 1e-5
#: internal steps for which contacts out of reach are not looked at, where a string has this many contacts or more
CULL_STEPS = 32
CULL_FROM = 3
#: level of a string under a finger, until it is measured: about to sound, it is the last to be stolen
LOUD = 1e9
#: how fast the output's rest line follows a change of fret [s]
BASE_S = 0.05
LN_1000 = math.log(1000.0)


@njit(**CORE)
def _set_coefficients(bank, state, settings, scratch, s: int) -> None:
    """Put the string's working coefficients, contact matrix and heights in line with model, hand, bend and height."""
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[me.model]
    n, c = model.n, model.contacts
    cap, off, m_off = fixed.cap, fixed.off, model.off
    for k in range(c):
        state.eta[fixed.coff + k] = bank.eta[model.coff + k] + me.height
        state.watch[fixed.coff + k] = 1
    me.free = 0
    _set_rest(bank, me, model)
    bend_ratio = 1.0
    if me.hand == 0.0 and me.bend == 0.0:
        for row in range(6):
            for j in range(n):
                state.coef[6 * off + row * cap + j] = bank.coef[6 * m_off + row * n + j]
        for k in range(c * c):
            state.matrix[fixed.goff + k] = bank.matrix[model.goff + k]
    else:
        dt = 1.0 / (settings.rate_hz * fixed.factor)
        # a tension change adds the same share of ω₁² to every k_j² = j² k₁²; bending stiffness stays
        bend_ratio = 2.0 ** (me.bend / 12.0)
        added = (bend_ratio * bend_ratio - 1.0) * bank.omega[m_off] * bank.omega[m_off]
        for j in range(n):
            w = bank.omega[m_off + j]
            more = added * (j + 1.0) * (j + 1.0) if j < model.own else (bend_ratio * bend_ratio - 1.0) * w * w
            scratch.omega[j] = math.sqrt(max(w * w + more, 1e-6 * w * w))
            scratch.sigma[j] = bank.sigma[m_off + j] + me.hand
            if scratch.omega[j] * dt > math.pi:  # bent above half the internal rate, where it would be heard mirrored
                scratch.sigma[j] += LN_1000 / CUT_S
        coef = state.coef[6 * off : 6 * off + 6 * cap].reshape(6, cap)
        step_coefficients(settings.law, scratch.omega[:n], scratch.sigma[:n], model.mu, dt, coef)
        if c > 0:
            shapes = bank.shapes[model.soff : model.soff + c * n].reshape(c, n)
            residual = bank.residual[model.goff : model.goff + c * c].reshape(c, c)
            matrix = state.matrix[fixed.goff : fixed.goff + c * c].reshape(c, c)
            contact_matrix(settings.law, coef, shapes, residual, matrix)
            if settings.law == EXACT_HOLD:  # the residual compliance goes with 1/T
                relief = 1.0 / (bend_ratio * bend_ratio) - 1.0
                for a in range(c):
                    for b in range(c):
                        matrix[a, b] += relief * residual[a, b]


@njit(**CORE)
def _set_rest(bank, me, model) -> None:
    """Where the string would come to rest over the obstacle as high as it now is: the contact's force and the output."""
    me.lift = 0.0
    me.rest = model.line_output + model.rest_output
    if model.contacts == 1:
        me.lift = max(0.0, bank.eta[model.coff] + me.height) / model.static_response
        me.rest = model.line_output + me.lift * model.lift_output


@njit(**CORE)
def _rest_state(bank, me, model, q_rest) -> None:
    """q (N,) of the string at rest."""
    for j in range(model.n):
        q_rest[j] = bank.q_rest[model.off + j]
    if model.contacts == 1:
        for j in range(model.n):
            w = bank.omega[model.off + j]
            q_rest[j] = bank.shapes[model.soff + j] * me.lift / (model.mu * w * w)


@njit(**CORE)
def _refresh(bank, state, settings, scratch, s: int) -> None:
    """Work out what an event has made stale. Here and nowhere else, once however many events came."""
    me = state.sounding[s]
    if me.stale == 1:
        _set_coefficients(bank, state, settings, scratch, s)
    if me.phase != NO_FINGER:
        _couple_finger(bank, state, settings, s)
    me.stale = 0


@njit(**CORE)
def _couple_finger(bank, state, settings, s: int) -> None:
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[me.model]
    n, c = model.n, model.contacts
    coef = state.coef[6 * fixed.off : 6 * fixed.off + 6 * fixed.cap].reshape(6, fixed.cap)
    shapes = bank.shapes[model.soff : model.soff + c * n].reshape(c, n)
    me.finger_own = finger_row(
        settings.law,
        coef,
        shapes,
        state.finger_weights[fixed.off : fixed.off + n],
        state.finger_coupling[fixed.coff : fixed.coff + c],
    )


@njit(**CORE)
def wake(bank, state, scratch, s: int, model_index: int) -> None:
    """A silent string begins at rest on the given model, over the obstacle as high as it now is."""
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[model_index]
    n = model.n
    me.awake = 1
    me.model = model_index
    me.n = n
    me.hand = 0.0
    me.stolen = 0
    me.phase = NO_FINGER
    me.bend = state.channels[me.channel].bend
    me.height = state.part_state[fixed.part].height
    _set_rest(bank, me, model)
    me.base = me.rest
    _rest_state(bank, me, model, scratch.q)
    for j in range(fixed.cap):
        state.q[fixed.off + j] = scratch.q[j] if j < n else 0.0
        state.v[fixed.off + j] = 0.0
    me.stale = 1


@njit(**CORE)
def sleep(bank, state, s: int) -> None:
    """The string is silent: it costs nothing until it is touched."""
    me = state.sounding[s]
    fixed = bank.strings[s]
    me.awake = 0
    me.level = 0.0
    me.stolen = 0
    me.phase = NO_FINGER
    for j in range(fixed.cap):
        state.q[fixed.off + j] = 0.0
        state.v[fixed.off + j] = 0.0


@njit(**CORE)
def _set_finger(bank, state, settings, s: int, distance: float, width: float, seconds: float) -> None:
    """A finger of some width takes hold of the string at a distance from the saddle, where the string now is."""
    me = state.sounding[s]
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    model = bank.models[me.model]
    n = model.n
    me.n = n
    me.free = 0
    for k in range(model.contacts):
        state.watch[fixed.coff + k] = 1
    x = model.length - distance
    scale = math.sqrt(2.0 / model.length)
    for j in range(n):
        k = (j + 1) * math.pi / model.length
        kappa = 0.25 * k * width
        taper = math.sin(kappa) / kappa if kappa > 1e-9 else 1.0
        state.finger_weights[fixed.off + j] = scale * math.sin(k * x) * taper * taper if j < model.own else 0.0
    me.finger_k = part.finger_stiffness
    me.finger_r = part.finger_loss * fixed.impedance
    me.finger_step = 0
    # whole output frames, so that it lets go at the same instant at every internal rate
    me.finger_steps = max(2, round(seconds * settings.rate_hz)) * fixed.factor
    here = dot(state.finger_weights[fixed.off : fixed.off + n], state.q[fixed.off : fixed.off + n])
    me.finger_from = here
    state.finger_state[s, 0] = here
    state.finger_state[s, 1] = 0.0
    me.level = LOUD
    if me.stale == 0:
        me.stale = 2


@njit(**CORE)
def draw(bank, state, settings, s: int, velocity: float, sounding: bool) -> None:
    """The plucking finger takes hold of the string, draws it aside and lets it go. One that sounds it damps."""
    me = state.sounding[s]
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    model = bank.models[me.model]
    parameters = state.parameters[fixed.part]
    strength = velocity / 127.0
    position = parameters[PLUCK_POSITION] + strength * part.position_hard
    width = 1e-3 * parameters[PLUCK_WIDTH] * (1.0 + strength * (part.width_hard - 1.0))
    distance = min(max(position * fixed.open_length, 0.02 * model.length), 0.5 * model.length)
    width = min(width, 1.5 * distance)
    _set_finger(bank, state, settings, s, distance, width, fixed.draw_s)
    force = fixed.pluck_force * parameters[PLUCK_AMOUNT] * strength**part.velocity_exponent
    me.finger_to = force * distance * (model.length - distance) / (model.tension * model.length)
    me.phase = DRAW
    if sounding:
        damp(state, s, FINGER_S)


@njit(**CORE)
def press(bank, state, settings, s: int, target: int, velocity: float) -> None:
    """The left hand brings a sounding string down to a higher fret; the change of model and the pluck come after."""
    me = state.sounding[s]
    old, new = bank.models[me.model], bank.models[target]
    me.pending_model = target
    me.pending_velocity = velocity
    _set_finger(bank, state, settings, s, new.length, 0.004, PRESS_S)
    me.finger_to = new.rest_height - old.rest_height * new.length / old.length
    me.finger_k *= 20.0  # the fret is behind this finger
    me.phase = PRESS


@njit(**CORE)
def change_model(bank, state, scratch, s: int, target: int) -> None:
    """Carry the motion of a sounding string over to another speaking length.

    Both models end at the saddle. With ξ counted from there, φ_j = √(2/L)(−1)^(j+1) sin(jπξ/L), and the new coordinates
    are the projections of the displacement (in the new rest line's frame, absolute positions kept) and of the velocity.
    Projection is on sines that vanish at the new fret: by Bessel's inequality neither kinetic nor elastic energy grows,
    but for the work of a hand that lets a stopped string go, which is the string's own. Lumped modes begin at rest.
    """
    me = state.sounding[s]
    fixed = bank.strings[s]
    old, new = bank.models[me.model], bank.models[target]
    n_old, n_new = old.own, new.own
    l_old, l_new = old.length, new.length
    q, v = state.q[fixed.off : fixed.off + n_old], state.v[fixed.off : fixed.off + n_old]
    scale = 2.0 / math.sqrt(l_old * l_new)
    if l_new < l_old:
        at_fret = 0.0
        for j in range(n_old):
            sign = 1.0 if j % 2 == 0 else -1.0
            scratch.amplitude[j] = sign * math.sin((j + 1) * math.pi * l_new / l_old)
            at_fret += math.sqrt(2.0 / l_old) * scratch.amplitude[j] * q[j]
        for i in range(n_new):
            a = (i + 1) * math.pi / l_new
            q_sum, v_sum = 0.0, 0.0
            for j in range(n_old):
                b = (j + 1) * math.pi / l_old
                gap = (a - b) * (a + b)
                if abs(gap) > 1e-9 * a * a:
                    weight = scratch.amplitude[j] * a / gap
                else:
                    # both sines are the same one: the sign (−1)^(i+1) of the closed form is in the new φ_i
                    weight = (1.0 if (i + j) % 2 == 0 else -1.0) * 0.5 * l_new
                q_sum += weight * q[j]
                v_sum += weight * v[j]
            # ∫₀^ℓ (ξ/ℓ) sin(aξ) dξ = (−1)^(i+1)/a, and φ_i carries the same sign
            scratch.q[i] = scale * q_sum - math.sqrt(2.0 / l_new) * at_fret / a
            scratch.v[i] = scale * v_sum
    else:
        # the string was stopped at height `lift` above the new rest line
        lift = old.rest_height - new.rest_height * l_old / l_new
        for i in range(n_new):
            a = (i + 1) * math.pi / l_new
            sign = 1.0 if i % 2 == 0 else -1.0
            end = sign * math.sin(a * l_old)
            q_sum, v_sum = 0.0, 0.0
            for j in range(n_old):
                b = (j + 1) * math.pi / l_old
                gap = (b - a) * (b + a)
                if abs(gap) > 1e-9 * b * b:
                    weight = end * b / gap
                else:
                    weight = (1.0 if (i + j) % 2 == 0 else -1.0) * 0.5 * l_old
                q_sum += weight * q[j]
                v_sum += weight * v[j]
            # triangle with its corner of height `lift` at ξ = l_old
            corner = 0.0
            if l_new > l_old:
                corner = lift * end * l_new / (a * a * l_old * (l_new - l_old))
            scratch.q[i] = scale * q_sum + math.sqrt(2.0 / l_new) * corner
            scratch.v[i] = scale * v_sum
    for j in range(fixed.cap):
        state.q[fixed.off + j] = scratch.q[j] if j < n_new else 0.0
        state.v[fixed.off + j] = scratch.v[j] if j < n_new else 0.0
    me.model = target
    me.n = new.n
    me.phase = NO_FINGER
    me.stale = 1


@njit(**CORE)
def pluck(bank, state, settings, scratch, s: int, target: int, velocity: float, legato: bool) -> None:
    """A note begins on string s at a model (position): wake or re-pluck, change fret where needed."""
    me = state.sounding[s]
    me.stolen = 0
    sounding = me.awake != 0
    if not sounding:
        wake(bank, state, scratch, s, target)
    elif me.hand != 0.0:
        me.hand = 0.0
        me.stale = 1
    if me.model != target:
        if bank.models[target].length < bank.models[me.model].length:
            press(bank, state, settings, s, target, 0.0 if legato else velocity)
            return
        change_model(bank, state, scratch, s, target)
        if legato:
            return
    draw(bank, state, settings, s, velocity, sounding)


@njit(**CORE)
def damp(state, s: int, seconds: float) -> None:
    """The hand lies on the string: every mode decays by 60 dB in `seconds` at the latest."""
    me = state.sounding[s]
    if me.awake:
        hand = LN_1000 / seconds
        if hand != me.hand:
            me.hand = hand
            me.stale = 1


@njit(**CORE)
def let_go(bank, state, s: int) -> None:
    """Note-off has reached the string: the hand damps it unless a finger is still at work or the preset rings on."""
    me = state.sounding[s]
    part = bank.strings[s].part
    if me.held or me.sustained or me.phase != NO_FINGER or bank.parts[part].ring_on:
        return
    damp(state, s, bank.strings[s].release_s * state.parameters[part, RELEASE])


@njit(**CORE)
def _finger_done(bank, state, settings, scratch, s: int) -> None:
    me = state.sounding[s]
    phase = me.phase
    me.phase = NO_FINGER
    if phase == PRESS:
        change_model(bank, state, scratch, s, me.pending_model)
        if me.pending_velocity > 0.0:
            draw(bank, state, settings, s, me.pending_velocity, True)
            return
    elif me.hand != 0.0:
        me.hand = 0.0
        me.stale = 1
    let_go(bank, state, s)


@njit(**CORE)
def advance_string(bank, state, settings, scratch, s: int, start: int, frames: int) -> None:
    """`frames` output frames of one awake string from frame `start` of the quantum, added to its bus."""
    fixed = bank.strings[s]
    bus = scratch.bus[fixed.bus]
    done = 0
    total = frames * fixed.factor
    while done < total:
        me = state.sounding[s]
        steps = total - done
        if me.stale:
            _refresh(bank, state, settings, scratch, s)
        if me.phase != NO_FINGER:
            steps = min(steps, me.finger_steps - me.finger_step)
        _steps(bank, state, settings, scratch, s, steps)
        _collect(bank, state, settings, scratch, s, steps, bus[start * fixed.factor + done + 1 :])
        done += steps
        if me.phase != NO_FINGER and me.finger_step >= me.finger_steps:
            _finger_done(bank, state, settings, scratch, s)


@njit(**CORE)
def _steps(bank, state, settings, scratch, s: int, steps: int) -> None:
    me = state.sounding[s]
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    model = bank.models[me.model]
    n, c, cap, off, coff = me.n, model.contacts, fixed.cap, fixed.off, fixed.coff
    coef = state.coef[6 * off : 6 * off + 6 * cap].reshape(6, cap)
    q, v = state.q[off : off + n], state.v[off : off + n]
    wq, wv = bank.wq[model.off : model.off + n], bank.wv[model.off : model.off + n]
    fingered = me.phase != NO_FINGER
    state.counters[WORK] += n * steps
    if not fingered and (c == 0 or me.free):
        advance_free(steps, coef, q, v, wq, wv, part.use_q, part.use_v, scratch.out_q[:, 0], scratch.out_v[:, 0])
        return
    eta = state.eta[coff : coff + c]
    if not fingered and c == 1 and settings.law == EXACT_HOLD:
        advance_one(
            steps,
            coef,
            bank.shapes[model.soff : model.soff + n],
            eta[0],
            state.matrix[fixed.goff],
            q,
            v,
            wq,
            wv,
            part.use_q,
            part.use_v,
            scratch.out_q[:, 0],
            scratch.out_v[:, 0],
        )
        return
    shapes = bank.shapes[model.soff : model.soff + c * model.n].reshape(c, model.n)
    u, vc = state.u[coff : coff + c], state.vc[coff : coff + c]
    for k in range(c):
        u[k] = dot(shapes[k], q)
        vc[k] = dot(shapes[k], v)
    if fingered:
        first = me.finger_step
        for t in range(steps + 1):
            s01 = (first + t) / me.finger_steps
            scratch.path[t] = me.finger_from + (me.finger_to - me.finger_from) * 0.5 * (1.0 - math.cos(math.pi * s01))
        me.finger_step = first + steps
    finger = Finger(
        1 if fingered else 0,
        state.finger_weights[off : off + n],
        state.finger_coupling[coff : coff + c],
        me.finger_own,
        me.finger_k,
        me.finger_r,
        scratch.path,
        state.finger_state[s],
    )
    work = Work(
        scratch.y[:c],
        scratch.b[:c],
        scratch.z[:c],
        scratch.a,
        scratch.factor,
        scratch.order,
        scratch.enabled[:c],
        scratch.active[:c],
    )
    for k in range(c):
        scratch.active[k] = 1 if state.force[coff + k] > 0.0 else 0
    dt = 1.0 / (settings.rate_hz * fixed.factor)
    matrix = state.matrix[fixed.goff : fixed.goff + c * c].reshape(c, c)
    watch = state.watch[coff : coff + c]
    omega = bank.omega[model.off : model.off + n]
    culling = settings.economy and not fingered and settings.law == EXACT_HOLD and c >= CULL_FROM and me.bend == 0.0
    near = scratch.near[:c] if culling else watch
    status = 0
    done = 0
    while done < steps:
        part_steps = steps - done
        if culling:
            part_steps = min(part_steps, CULL_STEPS)
            cull(shapes, eta, omega, q, v, part_steps * dt, watch, scratch.amplitude, near)
        bad = advance(
            settings.law,
            part_steps,
            dt,
            settings.restitution,
            coef,
            shapes,
            eta,
            matrix,
            q,
            v,
            u,
            vc,
            state.force[coff : coff + c],
            finger,
            near,
            wq.reshape(1, n)[: part.use_q],
            wv.reshape(1, n)[: part.use_v],
            scratch.out_q[done:],
            scratch.out_v[done:],
            scratch.record,
            scratch.record,
            work,
        )
        if bad != 0:
            status = bad
        if culling:
            for k in range(c):  # a contact that was certain to be out of reach is so no longer once any is touched
                if near[k] and not watch[k]:
                    watch[k] = 1
        done += part_steps
    if status != 0:
        state.counters[FAILED_LCP] += 1


@njit(**CORE)
def _collect(bank, state, settings, scratch, s: int, steps: int, bus) -> None:
    """Add the output of the last steps to the bus, counted from the slowly followed rest."""
    me = state.sounding[s]
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    if part.use_q and part.use_v:  # pickup: flux ∝ 1/(1 + u/d)², voltage ∝ v/(1 + u/d)³
        for t in range(steps):
            near = max(0.2, 1.0 + scratch.out_q[t, 0] / part.pickup_distance)
            bus[t] += scratch.out_v[t, 0] / (near * near * near)
    elif part.use_v:
        for t in range(steps):
            bus[t] += scratch.out_v[t, 0]
    else:
        model = bank.models[me.model]
        rest = me.rest
        follow = 1.0 / (BASE_S * settings.rate_hz * fixed.factor)
        base = me.base
        for t in range(steps):
            base += follow * (rest - base)
            bus[t] += scratch.out_q[t, 0] + model.line_output - base
        me.base = base


@njit(fastmath=FAST, **CORE)
def _energy_norm(omega, q, v, q_rest) -> float:
    total = 0.0
    for j in range(q.size):
        d = omega[j] * (q[j] - q_rest[j])
        total += d * d + v[j] * v[j]
    return math.sqrt(total)


@njit(**CORE)
def check(bank, state, settings, scratch, s: int) -> None:
    """Level, certificate that contacts are out of reach, pruning of inaudible modes, sleep."""
    me = state.sounding[s]
    if me.phase != NO_FINGER or me.stale:
        return
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    model = bank.models[me.model]
    n, off, m_off = me.n, fixed.off, model.off
    q, v = state.q[off : off + n], state.v[off : off + n]
    omega, sigma = bank.omega[m_off : m_off + n], bank.sigma[m_off : m_off + n]
    _rest_state(bank, me, model, scratch.q)
    me.level = model.output_bound * _energy_norm(omega, q, v, scratch.q[:n])
    if part.use_q and not part.use_v:
        me.level += abs(me.base - me.rest)
    if me.level < SLEEP_BELOW:
        sleep(bank, state, s)
        return
    if not settings.economy or me.bend != 0.0 or me.hand != 0.0 or settings.law != EXACT_HOLD:
        return  # the amplitudes below are those of the model's own ω and σ, and of v = q̇
    amplitude = scratch.amplitude[:n]
    reachable = 0
    known = False
    for k in range(model.contacts):
        gap = -state.eta[fixed.coff + k]
        if gap <= 0.0:
            reachable += 1
            continue
        if not known:
            amplitudes(omega, sigma, q, v, amplitude)
            known = True
        shape = bank.shapes[model.soff + k * model.n : model.soff + k * model.n + n]
        near = reach(shape, amplitude) >= 0.999 * gap
        state.watch[fixed.coff + k] = 1 if near else 0
        reachable += near
    me.free = 1 if reachable == 0 else 0
    if me.free:
        if not known:
            amplitudes(omega, sigma, q, v, amplitude)
        while n > 1:
            j = n - 1
            heard = (abs(bank.wq[m_off + j]) + abs(bank.wv[m_off + j]) * omega[j]) * amplitude[j]
            if heard >= PRUNE_BELOW:
                break
            q[j] = 0.0
            v[j] = 0.0
            n -= 1
        me.n = n


@njit(**CORE)
def follow_controls(bank, state, s: int) -> None:
    """Take over the pitch bend of the channel and the obstacle height of the part."""
    me = state.sounding[s]
    me.bend = state.channels[me.channel].bend
    me.height = state.part_state[bank.strings[s].part].height
    me.n = bank.models[me.model].n
    me.stale = 1
