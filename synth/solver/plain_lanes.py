"""The vector code of `lanes` in Python: what each pass and each sequence computes, a step at a time.

It takes the place of that code where kernels are interpreted (`native.interpreted`), and the tests judge that code by it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from synth.solver.block_rows import BLOCK, KQ, KV, P11, P12, P21, P22


def one_pass(motion: str, kinds: str) -> Callable[..., None]:
    """The pass of `lanes.one_kind_of_pass`: K steps forward under forces and kicks, then the sums over K free steps."""
    kicked = motion.endswith(" kicked")
    several, one = "listed" in motion, motion.startswith(("drive listed and one", "drive kicked")) or motion == "drive"

    def run(n: int, *given: Any) -> None:
        rest = list(given)
        rows, q, v = rest.pop(0)[:, :n].astype(np.float64), rest.pop(0), rest.pop(0)
        x, y = q[:n].astype(np.float64), v[:n].astype(np.float64)
        forces = np.zeros((BLOCK, n))
        if several:
            count, which, shapes, each = (rest.pop(0) for _ in range(4))
            forces += each[:count, :BLOCK].T @ shapes[which[:count], :n]
        if one:
            shape, force = rest.pop(0), rest.pop(0)
            forces += np.outer(force[:BLOCK], shape[:n])
        kicks = np.zeros((BLOCK, n))
        if kicked:
            shape, kick = rest.pop(0), rest.pop(0)
            kicks += np.outer(kick[:BLOCK], shape[:n])
        if motion:
            for force, kick in zip(forces, kicks, strict=True):
                y = y + kick
                x, y = _step(rows, x, y)
                x, y = x + rows[KQ] * force, y + rows[KV] * force
            q[:n], v[:n] = x, y
        for kind, weights, out in zip(kinds, rest[: len(kinds)], rest[len(kinds) :], strict=True):
            ahead = x, y
            for k in range(BLOCK):
                before, ahead = ahead, _step(rows, *ahead)
                sought = {"q": ahead[0], "v": ahead[1], "a": ahead[1] - before[1]}[kind]
                out[k] = weights[:n].astype(np.float64) @ sought

    return run


def _step(rows: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A free step."""
    return rows[P11] * x + rows[P12] * y, rows[P21] * x + rows[P22] * y


def _sum_before(k: int, response: np.ndarray, forces: np.ndarray) -> float:
    """Σ_{i ≤ k} h_{k−i} λ_i; the response holds K zeros before h."""
    return float(sum(response[BLOCK + k - i] * forces[i] for i in range(k + 1)))


def press_sequence(u: np.ndarray, eta: float, response: np.ndarray, forces: np.ndarray) -> None:
    """λ_k = max(0, (η − u_k − Σ_{i<k} h_{k−i} λ_i)/h_0)."""
    forces[:BLOCK] = 0.0
    for k in range(BLOCK):
        forces[k] = max(0.0, (eta - u[k] - _sum_before(k, response, forces)) / response[BLOCK])


def grip_sequence(pull, held, y, own, pushes, true) -> None:
    """p_k = a_k − stiff·y_k + follow·y⁺_{k−1}, y_k with the pushes before it, y⁺_k with its own too."""
    stiff, follow, here = held
    pushes[:BLOCK] = 0.0
    for k in range(BLOCK):
        pushes[k] = pull[k] - stiff * (y[k] + _sum_before(k, own, pushes)) + follow * here
        here = true[k] = y[k] + _sum_before(k, own, pushes)


def grip_and_press_sequence(pull, held, y, own, eta, u, cross, response, pushes, true, forces) -> None:
    """The same over one contact: both unknowns of a step at once, 0 ≤ λ ⊥ u − η ≥ 0."""
    stiff, follow, here = held
    pushes[:BLOCK] = forces[:BLOCK] = 0.0
    for k in range(BLOCK):
        before = y[k] + _sum_before(k, own, pushes) + _sum_before(k, cross, forces)
        depth = eta - (u[k] + _sum_before(k, cross, pushes) + _sum_before(k, response, forces))
        alone = pull[k] - stiff * before + follow * here
        gives = stiff * cross[BLOCK]  # how much the finger's push falls for one newton at the contact
        forces[k] = max(0.0, (depth - cross[BLOCK] * alone) / (response[BLOCK] - gives * cross[BLOCK]))
        pushes[k] = alone - gives * forces[k]
        here = true[k] = before + own[BLOCK] * pushes[k] + cross[BLOCK] * forces[k]


def any_forced_below(y: np.ndarray, response: np.ndarray, forces: np.ndarray, level: float) -> bool:
    """Whether any of y, with `add_forced`'s sum over the forces, is below `level`."""
    return any(y[k] + _sum_before(k, response, forces) < level for k in range(BLOCK))


def any_below(u: np.ndarray, level: float) -> bool:
    """Whether any of u is below `level`."""
    return bool((u[:BLOCK] < level).any())


def add_forced(y: np.ndarray, response: np.ndarray, forces: np.ndarray) -> None:
    """y_k += Σ_{i ≤ k} h_{k−i} λ_i."""
    for k in range(BLOCK):
        y[k] += _sum_before(k, response, forces)


def add_late(y: np.ndarray, response: np.ndarray, late: int, force: float) -> None:
    """y_k += h_{k−late} λ for k ≥ late."""
    for k in range(late, BLOCK):
        y[k] += response[BLOCK + k - late] * force


def add_late_of_three(y: np.ndarray, first: np.ndarray, second: np.ndarray, third: np.ndarray, late: int, forces) -> None:
    """`add_late` of three forces."""
    for response, force in zip((first, second, third), forces, strict=True):
        add_late(y, response, late, force)
