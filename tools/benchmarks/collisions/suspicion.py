"""What is probably wrong with a run whose error is large: its unit, its sign, its start. It is told, never mended."""

from __future__ import annotations

import numpy as np

#: a change explains a run if it takes e down to this part of itself, and below `_FITS`
_PART, _FITS = 0.2, 0.3
_SUSPECT = 0.05  # no run with a smaller e is suspected
_LARGEST_SHIFT = 64
_UNITS = {1000.0: "mm for m", 1e6: "µm for m", 1e-3: "km for m, or divided by 1000", 100.0: "cm for m"}


def _e(u: np.ndarray, ref: np.ndarray) -> float:
    return float(np.sqrt(np.sum((u - ref) ** 2) / np.sum(ref**2)))


def suspicions(u: np.ndarray, ref: np.ndarray) -> list[str]:
    """Lines about u (n,) against ref (n,); none where nothing simple explains the difference, or there is none."""
    e = _e(u, ref)
    if not e > _SUSPECT or not np.any(u):
        return ["u is zero throughout: was the string plucked?"] if not np.any(u) else []
    found = []
    # a chaotic run parts from its reference sooner or later: the start is what tells
    head = slice(0, max(16, ref.size // 8))
    for part in (slice(0, ref.size), head):
        a, b = u[part], ref[part]
        before = _e(a, b) if np.any(b) else 0.0
        if not before > _SUSPECT or not np.any(a):
            continue
        gain = float(a @ b / (b @ b))

        def explains(after: float, before: float = before) -> bool:
            return after < _PART * before and after < _FITS

        if gain < 0.0 and explains(_e(-a, b)):
            found.append("the sign is reversed: up is positive, away from the obstacle")
        elif gain != 0.0 and explains(_e(a / gain, b)):
            unit = next((words for factor, words in _UNITS.items() if abs(np.log(abs(gain) / factor)) < 0.3), None)
            what = f"{unit}?" if unit else "is u the displacement in metres, at the output point?"
            found.append(f"u is {gain:.4g} times the reference: {what}")
        else:
            e_shifted, shift = _best_shift(a, b)
            if shift and explains(e_shifted):
                when = "late" if shift > 0 else "early"
                found.append(
                    f"u comes {abs(shift)} samples of the reference too {when}: sample 0 is t = 0, the start itself"
                )
        if found:
            break
    return found


def _best_shift(a: np.ndarray, b: np.ndarray) -> tuple[float, int]:
    """(e, shift) of the shift in samples that fits best; positive: a comes late."""
    most = min(_LARGEST_SHIFT, a.size // 4)
    tried = []
    for shift in range(-most, most + 1):
        if shift >= 0:
            tried.append((_e(a[shift:], b[: b.size - shift]), shift))
        else:
            tried.append((_e(a[:shift], b[-shift:]), shift))
    return min(tried)
