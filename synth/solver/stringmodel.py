"""One string and its contacts as compiled code has them, behind three addresses.

    model     what does not change while it sounds      string_model(address)
    state     what does                                 string_state(address)
    scratch   what a call works with                    scratch_of(address)

Declared here, once: allocation, addresses and views follow from it (`native`). N modes stand in rows of n = padded(N) with
zeros behind them; C contacts; P outputs, first those of displacements, then those of velocities. An array may be longer
than the model at hand needs (a string that is stopped at several places has one state): sizes are the model's.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numba import njit

from synth.native.arrays import aligned, allocate, f8, i8, struct, u1
from synth.native.views import opener, table
from synth.solver.block_rows import BLOCK, ROWS
from synth.solver.lanes import padded, padded_single
from synth.solver.laws import EXACT_HOLD, contact_matrix
from synth.solver.responses import make_lags, make_rows, padded_rows
from synth.solver.single import SingleRoom, SingleTables, fill_single_rows
from synth.solver.vectors import dot

#: length of a response to a force during a block: its first half is zero, place K + l is l steps after the force's own
RESPONSE = 2 * BLOCK
#: more contacts have no table of their responses to each other (C² · 2K numbers), and one step at a time is taken
MOST_IN_BLOCKS = 256

#: places in StringState.counts: modes that are not all zero, forces move all of them; steps since the certificates were
#: forgotten; whether they hold; whether nothing can be touched before something comes from outside
MOVING, CLOCK, CERTAIN, FREE = range(4)
N_COUNTS = 4

#: rows of ContactTables.layers: spring [N/m] and dashpot [N s/m] of each contact's, how deep it is [m] (0: there is none)
STIFFNESS, RESISTANCE, DEPTH = range(3)

#: a finger's row of the contact problem, a spring and a dashpot towards a path; `on` is 0 where none is near
FINGER = np.dtype(
    [
        ("on", "i8"),
        ("own", "f8"),  # weights diag(k) weightsᵀ
        ("stiffness", "f8"),  # [N/m]
        ("resistance", "f8"),  # [N s/m]
        ("here", "f8"),  # displacement under it [m]
        ("push", "f8"),  # its unknown in the last step
    ],
    align=True,
)


class ContactTables(NamedTuple):
    """Contacts under a string and how they answer."""

    size: int
    shapes: Annotated[np.ndarray, f8("contacts, modes")]
    eta: Annotated[np.ndarray, f8("contacts")]  # heights where nothing raises the obstacle [m]
    residual: Annotated[np.ndarray, f8("contacts, contacts")]
    matrix: Annotated[np.ndarray, f8("contacts, contacts")]  # `laws.contact_matrix`
    lags: Annotated[np.ndarray, f8("lagged, lagged, RESPONSE")]  # `responses.fill_lags`; lagged: contacts, or 0 of too many
    layers: Annotated[np.ndarray, f8("3, layered")]  # if any has one (`layers`); layered: contacts, or 0


class OutputTables(NamedTuple):
    """What is heard of a string."""

    first: int  # the outputs in use begin here, …
    points: int  # … are so many, …
    on_q: int  # … and the first so many of these are displacements
    weights: Annotated[np.ndarray, f8("outputs, modes")]
    lags: Annotated[np.ndarray, f8("outputs, lagged, RESPONSE")]  # of outputs to forces of contacts


class StringModel(NamedTuple):
    """What does not change while a string sounds and nothing bends or damps it."""

    law: int
    dt: float
    restitution: float
    mu: float  # [kg/m]
    modes: int  # N
    certified: int  # whether contacts out of reach may be passed over
    step: int  # address of what answers in a step (`contact_laws.ContactLaw`), 0: the kernels know the law
    omega: Annotated[np.ndarray, f8("modes")]  # 1 behind the last mode: it is divided by
    sigma: Annotated[np.ndarray, f8("modes")]
    rows: Annotated[np.ndarray, f8("ROWS, modes")]  # step coefficients and what follows from them, see `lanes`
    q_rest: Annotated[np.ndarray, f8("modes")]  # where it comes to rest
    contacts: ContactTables
    outputs: OutputTables
    single: SingleTables


class Certificates(NamedTuple):
    """Which contacts are out of reach, and for how long (`certificates`)."""

    looked: Annotated[np.ndarray, u1("contacts")]  # whether a contact is among those looked at
    until: Annotated[np.ndarray, i8("contacts")]  # step at which that is to be asked again
    margin: Annotated[np.ndarray, f8("contacts")]  # by how much it is missed until then, as long as the string flies [m]
    bounds: Annotated[np.ndarray, f8("contacts, 3")]  # how deep it may ever go, how far move within each of HORIZONS [m]
    renewed: Annotated[np.ndarray, i8("contacts")]  # step at which these were taken, −1: they do not hold


class Grip(NamedTuple):
    """How a finger holds the string, and responses to a unit unknown of it over a block (`fingers.fill_grip`)."""

    weights: Annotated[np.ndarray, f8("modes")]  # mode shapes averaged over its width
    coupling: Annotated[np.ndarray, f8("contacts")]  # S diag(k) weightsᵀ, of one step
    own: Annotated[np.ndarray, f8("1, RESPONSE")]  # of its own row, as those in `ContactTables.lags`
    contacts: Annotated[np.ndarray, f8("contacts, RESPONSE")]
    outputs: Annotated[np.ndarray, f8("outputs, RESPONSE")]
    far: Annotated[np.ndarray, f8("contacts")]  # bound on the displacement of a contact at any later time


class StringState(NamedTuple):
    """What changes while it sounds. All of it goes from call to call."""

    q: Annotated[np.ndarray, f8("modes")]
    v: Annotated[np.ndarray, f8("modes")]
    eta: Annotated[np.ndarray, f8("contacts")]  # heights now [m]
    u: Annotated[np.ndarray, f8("contacts")]  # S q and …
    v_contact: Annotated[np.ndarray, f8("contacts")]  # … S v, kept by the laws of velocities
    force: Annotated[np.ndarray, f8("contacts")]  # contact unknown of the last step
    counts: Annotated[np.ndarray, i8("N_COUNTS")]
    due: Annotated[np.ndarray, u1("contacts")]  # what of the responses to a force there still waits (`due_responses`)
    certificates: Certificates
    finger: Annotated[np.ndarray, struct(FINGER, "1")]
    grip: Grip


class Coefficients(NamedTuple):
    """What a hand or a bend gives a string of its own, in the place of its model's."""

    omega: Annotated[np.ndarray, f8("modes")]
    rows: Annotated[np.ndarray, f8("ROWS*modes")]
    matrix: Annotated[np.ndarray, f8("contacts*contacts")]
    lags: Annotated[np.ndarray, f8("contacts*contacts*RESPONSE")]
    out_lags: Annotated[np.ndarray, f8("outputs*contacts*RESPONSE")]
    flight_rows: Annotated[np.ndarray, f8("ROWS*heard")]  # of its flight, of the modes that are heard


class ModeRoom(NamedTuple):
    """Room for the modes of a string."""

    sigma: Annotated[np.ndarray, f8("modes")]
    amplitude: Annotated[np.ndarray, f8("modes")]
    q: Annotated[np.ndarray, f8("modes")]
    v: Annotated[np.ndarray, f8("modes")]
    moved: Annotated[np.ndarray, f8("3, modes")]
    after: Annotated[np.ndarray, f8("contacts")]  # S q of these


class PivotRoom(NamedTuple):
    """What `lcp.pivot` works with, of the contacts that take part."""

    b: Annotated[np.ndarray, f8("contacts")]
    factor: Annotated[np.ndarray, f8("contacts, contacts")]
    matrix: Annotated[np.ndarray, f8("contacts*contacts")]
    order: Annotated[np.ndarray, i8("contacts")]
    enabled: Annotated[np.ndarray, u1("contacts")]
    active: Annotated[np.ndarray, u1("contacts")]


class BlockRoom(NamedTuple):
    """K steps of the contacts looked at, and in the row behind them of a finger."""

    near: Annotated[np.ndarray, i8("contacts")]  # their numbers
    u: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]  # free, then with forces
    forces: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]
    spare: Annotated[np.ndarray, f8("3, BLOCK")]


class Scratch(NamedTuple):
    """What a call works with; it carries nothing but what its caller puts there: `path` and `watch` in, the rest out."""

    path: Annotated[np.ndarray, f8("path")]  # of the finger [m], at the start and after each step
    watch: Annotated[np.ndarray, u1("contacts")]  # contacts that may be touched while none has been, for steps one by one
    out: Annotated[np.ndarray, f8("outputs*steps")]  # the outputs in use after each step, a row each
    record: Annotated[np.ndarray, f8("steps*contacts")]  # contact unknowns of each step
    contact_u: Annotated[np.ndarray, f8("watched*contacts")]  # displacements S q + R λ of the contacts; none: not wanted
    # a step as its law sees it (`contact_laws.ContactLaw`)
    y: Annotated[np.ndarray, f8("contacts")]
    a: Annotated[np.ndarray, f8("contacts, contacts")]
    z: Annotated[np.ndarray, f8("contacts")]
    modes: ModeRoom
    single: SingleRoom
    pivot: PivotRoom
    rows: BlockRoom


#: (address) → the StringModel, the StringState, the Scratch that is there, in compiled code
string_model, string_state, scratch_of = opener(StringModel), opener(StringState), opener(Scratch)

#: sizes that do not depend on a string
SIZES = {"ROWS": ROWS, "RESPONSE": RESPONSE, "BLOCK": BLOCK, "N_COUNTS": N_COUNTS}


class StringModes(NamedTuple):
    """Modes of a string: mass per length μ [kg/m], angular frequencies ω and decay rates σ (N,) [rad/s, 1/s]."""

    mu: float
    omega: np.ndarray
    sigma: np.ndarray


class StringContacts(NamedTuple):
    """Contacts under a string.

    shapes (C, N) of the modes there; eta (C,) heights [m]; residual (C, C) static compliance [m/N]; layers (3, C) of
    `layers`, None or (3, 0): none; matrix (C, C) of `laws.contact_matrix`, None where it is not known yet
    """

    shapes: np.ndarray
    eta: np.ndarray
    residual: np.ndarray
    layers: np.ndarray | None = None
    matrix: np.ndarray | None = None


class StringOutputs(NamedTuple):
    """Outputs of a string: weights (P, N), the first on_q of them on displacements, the others on velocities (None: all on
    displacements); used: first, number, on_q of those in use, None: all."""

    weights: np.ndarray
    on_q: int | None = None
    used: tuple[int, int, int] | None = None


def no_contacts(modes: int) -> StringContacts:
    """Of so many modes."""
    return StringContacts(np.zeros((0, modes)), np.zeros(0), np.zeros((0, 0)))


def make_string(
    law: int,
    dt: float,
    modes: StringModes,
    coef: np.ndarray,
    under: StringContacts,
    outputs: StringOutputs,
    *,
    restitution: float = 0.0,
    certified: bool = False,
    q_rest: np.ndarray | None = None,
    in_blocks: bool = True,
    step: int = 0,
    single: bool = False,
) -> StringModel:
    """A model of N modes with step coefficients (6, N) over the contacts under it.

    q_rest (N,), zero unless given; in_blocks: with the tables that steps in blocks need, unless contacts are too many for
    them; single: with modes in float32 there.
    """
    mu, omega, sigma = modes
    shapes, eta, residual, layers, matrix = under
    weights = outputs.weights
    n, contacts, points = omega.size, eta.size, weights.shape[0]
    on_q = points if outputs.on_q is None else outputs.on_q
    first, in_use, in_use_on_q = outputs.used or (0, points, on_q)
    if matrix is None:
        matrix = np.empty((contacts, contacts))
        contact_matrix(law, np.ascontiguousarray(coef), np.ascontiguousarray(shapes), _copy(residual), matrix)
    rows = make_rows(coef)
    size = rows.shape[1]
    shapes, weights = padded_rows(shapes, size), padded_rows(weights, size)
    padded_omega = padded_rows(omega, size)
    padded_omega[n:] = 1.0
    lagged = contacts if in_blocks and contacts <= MOST_IN_BLOCKS else 0
    lags, out_lags = np.zeros((0, 0, RESPONSE)), np.zeros((points, 0, RESPONSE))
    if lagged:
        lags = make_lags(law != EXACT_HOLD, rows, shapes, shapes, matrix)
        kinds = ((False, weights[:on_q]), (True, weights[on_q:]))
        out_lags = np.concatenate([make_lags(velocity, rows, shapes, some) for velocity, some in kinds])
    layers = np.zeros((3, 0)) if layers is None else layers
    extents = {"contacts": contacts, "lagged": lagged, "layered": layers.shape[1], "outputs": points, "singles": 0}
    sizes = SIZES | extents | {"modes": size}
    tables = {"residual": _copy(residual), "matrix": _copy(matrix), "lags": _copy(lags), "layers": _copy(layers)}
    heard = {"first": first, "points": in_use, "on_q": in_use_on_q, "weights": weights, "lags": _copy(out_lags)}
    model = allocate(
        StringModel,
        sizes,
        law=law,
        dt=dt,
        restitution=restitution,
        mu=mu,
        modes=n,
        certified=int(certified),
        step=step,
        omega=padded_omega,
        sigma=padded_rows(sigma, size),
        rows=rows,
        q_rest=padded_rows(np.zeros(n) if q_rest is None else q_rest, size),
        contacts=allocate(ContactTables, sizes, size=contacts, shapes=shapes, eta=_copy(eta), **tables),
        outputs=allocate(OutputTables, sizes, **heard),
        single=allocate(SingleTables, sizes, on=0),
    )
    return in_single(model) if single else model


def in_single(model: StringModel) -> StringModel:
    """The model with its modes in float32 where it is advanced in blocks: what its float64 arrays say, rounded."""
    singles = padded_single(model.modes)
    rows = aligned((ROWS, singles), np.float32)
    fill_single_rows(model.rows, 0, model.rows.shape[1], rows)
    shapes, weights = (padded_rows(each, singles, np.float32) for each in (model.contacts.shapes, model.outputs.weights))
    return model._replace(single=SingleTables(1, rows, shapes, weights))


def with_outputs(model: StringModel, first: int, points: int, on_q: int) -> StringModel:
    """The model with these of its outputs in use."""
    return model._replace(outputs=model.outputs._replace(first=first, points=points, on_q=on_q))


def state_sizes(modes: int, contacts: int, outputs: int) -> dict[str, int]:
    """Extents of a StringState for up to so many."""
    return SIZES | {"modes": padded(modes), "contacts": contacts, "outputs": outputs}


def make_state(model: StringModel, q: np.ndarray, v: np.ndarray) -> StringState:
    """A state at q, v (≥ N,) with the contacts at the model's heights, nothing pressed, nothing certain, no finger."""
    state = allocate(StringState, state_sizes(model.modes, model.contacts.size, model.outputs.weights.shape[0]))
    state.q[: model.modes], state.v[: model.modes] = q[: model.modes], v[: model.modes]
    state.eta[:] = model.contacts.eta
    state.u[:] = model.contacts.shapes @ state.q
    state.v_contact[:] = model.contacts.shapes @ state.v
    state.certificates.looked[:] = 1
    state.certificates.renewed[:] = -1
    state.counts[MOVING] = model.modes
    return state


def make_scratch(
    contacts: int, modes: int, outputs: int, steps: int, *, watched: int = 0, path: np.ndarray | None = None
) -> Scratch:
    """For calls of up to `steps` steps; `watched` of them with displacements of the contacts."""
    path = np.zeros(steps + 1) if path is None else np.ascontiguousarray(path, dtype=np.float64)
    sizes = {"contacts": max(1, contacts), "modes": max(1, padded(modes)), "outputs": outputs, "steps": steps}
    sizes["singles"] = max(1, padded_single(modes))
    scratch = allocate(Scratch, SIZES | sizes | {"path": path.size, "watched": watched}, path=path)
    scratch.watch[:] = 1
    return scratch


class Strung:
    """A string that Python can have advanced: a model, a state and a scratch for calls of up to `steps` steps.

    `addresses` is what kernels take; what they gave in a call of some steps is in `out`, `forces` and `contact_u`, views
    that the next call overwrites. watched: whether kernels give displacements of the contacts, too. path: of the finger.
    """

    def __init__(
        self,
        model: StringModel,
        q: np.ndarray,
        v: np.ndarray,
        steps: int,
        *,
        watched: bool = False,
        path: np.ndarray | None = None,
    ) -> None:
        self.model, self.state = model, make_state(model, q, v)
        contacts, outputs = model.contacts.size, model.outputs.weights.shape[0]
        self.scratch = make_scratch(contacts, model.modes, outputs, steps, watched=steps if watched else 0, path=path)
        self._tables = [table(each) for each in (model, self.state, self.scratch)]

    @property
    def addresses(self) -> tuple[int, int, int]:
        """Of model, state and scratch; good as long as this is kept."""
        model, state, scratch = (each.ctypes.data for each in self._tables)
        return model, state, scratch

    @property
    def q(self) -> np.ndarray:
        """(N,)"""
        return self.state.q[: self.model.modes]

    @property
    def v(self) -> np.ndarray:
        """(N,)"""
        return self.state.v[: self.model.modes]

    def out(self, steps: int) -> np.ndarray:
        """(P, steps) the outputs in use after each step."""
        return self.scratch.out[: self.model.outputs.points * steps].reshape(self.model.outputs.points, steps)

    def forces(self, steps: int) -> np.ndarray:
        """(steps, C) contact unknowns."""
        contacts = self.model.contacts.size
        return self.scratch.record[: steps * contacts].reshape(steps, contacts)

    def contact_u(self, steps: int) -> np.ndarray:
        """(steps, C) displacements of the contacts, where watched."""
        contacts = self.model.contacts.size
        return self.scratch.contact_u[: steps * contacts].reshape(steps, contacts)


@njit(cache=True, nogil=True)
def place_contacts(model: int, state: int, modes: int) -> None:
    """Displacements and velocities of the contacts as so many modes have them."""
    m, s = string_model(model), string_state(state)
    q, v = s.q[:modes], s.v[:modes]
    for c in range(m.contacts.size):
        s.u[c] = dot(m.contacts.shapes[c], q)
        s.v_contact[c] = dot(m.contacts.shapes[c], v)


@njit(inline="always")
def place_of(m, s, c: int, q) -> float:
    """S q + R λ of a contact [m]: the modes left out move it, too."""
    u = dot(m.contacts.shapes[c], q)
    for d in range(m.contacts.size):
        u += m.contacts.residual[c, d] * s.force[d]
    return u


def _copy(array: Any) -> np.ndarray:
    """An aligned one."""
    array = np.asarray(array, dtype=np.float64)
    out = aligned(array.shape)
    out[...] = array
    return out
