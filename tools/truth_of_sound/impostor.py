"""The impostor test: how easily is one set of notes told from recordings by somebody who never heard it?

A classifier learns the impostor from half of its notes, and what is real from all sets of recordings but one; then it
tells the other half from the set that was left out. AUC is the share of pairs (a note of each) that it puts in the right
order: 0.5 is guessing, 1 is certainty. Every real set takes the impostor's place, too: what counts is how much more easily
ours is told.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from sklearn.impute import SimpleImputer
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from truth_of_sound.families import Notes, logged
from truth_of_sound.note_features import FEATURES

#: inverse strength of the classifier's regularisation
C = 0.1
#: features of the distance: all but the wire's own, what the common bandwidth leaves of the highest band, and the lowest
#: band, which is coarse below E1
DISTANT = [key for key in FEATURES if key not in ("inharmonicity", "burst_4k_db", "between_low_db")]


def told(notes: Notes, real: Mapping[str, Notes]) -> dict[str, float]:
    """AUC of notes against each real set, the classifier having learned from the others."""
    x, order = logged(notes), np.random.default_rng(0).permutation(len(notes))
    tables = {name: logged(found) for name, found in real.items()}
    out = {}
    for left, unseen in tables.items():
        others = [table for name, table in tables.items() if name != left]
        if others:
            halves = ((order[::2], order[1::2]), (order[1::2], order[::2]))
            out[left] = float(np.mean([_auc(x[learnt], x[heard], others, unseen) for learnt, heard in halves]))
    return out


def _auc(learnt: np.ndarray, heard: np.ndarray, others: list[np.ndarray], unseen: np.ndarray) -> float:
    x = np.concatenate([learnt, *others])
    y = np.r_[np.ones(len(learnt)), np.zeros(len(x) - len(learnt))]
    share = [np.full(len(table), 1.0 / len(table) / len(others)) for table in others]
    weight = 0.5 * len(y) * np.concatenate([np.full(len(learnt), 1.0 / len(learnt)), *share])
    model = make_pipeline(
        SimpleImputer(strategy="median", keep_empty_features=True), StandardScaler(), LogisticRegression(C=C, max_iter=1000)
    )
    model.fit(x, y, logisticregression__sample_weight=weight)
    both = np.concatenate([heard, unseen])
    return float(roc_auc_score(np.r_[np.ones(len(heard)), np.zeros(len(unseen))], model.decision_function(both)))


def real_ones(real: Mapping[str, Notes]) -> dict[str, float]:
    """AUC of every real set in the impostor's place, in the mean over the sets left out; none where there are only two."""
    if len(real) < 3:
        return {}
    return {name: mean(told(notes, {k: v for k, v in real.items() if k != name})) for name, notes in real.items()}


def mean(found: Mapping[str, float], names: tuple[str, ...] | None = None) -> float:
    """Mean AUC over the sets left out, or over some of them; nan where none is."""
    values = [value for name, value in found.items() if names is None or name in names]
    return float(np.mean(values)) if values else float("nan")


def distances(notes: Notes, real: Mapping[str, Notes]) -> dict[str, float]:
    """{feature of `DISTANT`: how far the median lies from that of the recordings, in their robust standard deviations}.

    Recordings: all notes, each set of the same weight; robust: 1.4826 times the median distance from the median.
    """
    ours, out = logged(notes, DISTANT), {}
    tables = [logged(found, DISTANT) for found in real.values()]
    for column, key in enumerate(DISTANT):
        sets = [table[np.isfinite(table[:, column]), column] for table in tables]
        sets = [values for values in sets if values.size]
        mine = ours[np.isfinite(ours[:, column]), column]
        if not sets or not mine.size:
            continue
        values = np.concatenate(sets)
        weight = np.concatenate([np.full(each.size, 1.0 / each.size) for each in sets])
        middle = _weighted_median(values, weight)
        spread = 1.4826 * _weighted_median(np.abs(values - middle), weight)
        out[key] = float(abs(np.median(mine) - middle) / max(spread, 1e-9))
    return out


def _weighted_median(values: np.ndarray, weight: np.ndarray) -> float:
    order = np.argsort(values)
    reached = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(reached, 0.5 * reached[-1])])
