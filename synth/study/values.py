"""What a parameter of a study goes through: lists, ranges, random draws."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from synth.instrument.table import Table

MOST = 10_000_000
#: what a parameter may be set to
Scalar = bool | int | float | str | None


class Range(Table):
    """From one number to another, both in it (`to` only where a step meets it)."""

    from_: float = Field(alias="from")
    to: float
    count: int | None = Field(None, ge=1, le=MOST)
    step: float | None = None
    spacing: Literal["linear", "log"] = "linear"
    whole: bool = False

    @model_validator(mode="after")
    def _possible(self) -> Range:
        if (self.count is None) == (self.step is None):
            raise ValueError("give either count or step")
        if self.spacing == "log" and not (self.from_ > 0 and self.to > 0):
            raise ValueError(f"from and to must be more than 0 for spacing log, got {self.from_:g} and {self.to:g}")
        if self.step is not None:
            if self.spacing == "log":
                raise ValueError("step needs linear spacing; give count instead")
            if self.step == 0.0 or (self.to - self.from_) / self.step < 0.0:
                raise ValueError(f"step must lead from {self.from_:g} to {self.to:g}, got {self.step:g}")
            if (self.to - self.from_) / self.step > MOST:
                raise ValueError(f"must be at most {MOST} values")
        return self

    def values(self) -> list[Any]:
        """In order; whole numbers where `whole`, or where all of them are."""
        if self.step is not None:
            n = math.floor((self.to - self.from_) / self.step + 1e-9) + 1
            found = self.from_ + self.step * np.arange(n)
        elif self.spacing == "log":
            found = np.geomspace(self.from_, self.to, self.count or 1)
        else:
            found = np.linspace(self.from_, self.to, self.count or 1)
        if self.whole:
            found = np.unique(np.round(found)) if self.to >= self.from_ else np.unique(np.round(found))[::-1]
        if np.all(found == np.round(found)) and np.all(np.abs(found) < 2**53):
            return [int(value) for value in found]
        return [float(value) for value in found]


class Distribution(Table):
    """One of these: where a drawn parameter lies."""

    uniform: tuple[float, float] | None = None
    loguniform: tuple[float, float] | None = None
    normal: tuple[float, float] | None = None
    lognormal: tuple[float, float] | None = None
    integers: tuple[int, int] | None = None
    choice: list[Any] | None = Field(None, min_length=1)
    #: a normal one is cut off there: samples beyond are the bounds'
    low: float | None = None
    high: float | None = None

    @model_validator(mode="after")
    def _one(self) -> Distribution:
        kinds = [
            name for name in ("uniform", "loguniform", "normal", "lognormal", "integers", "choice") if self._given(name)
        ]
        if len(kinds) != 1:
            raise ValueError("give one of uniform, loguniform, normal, lognormal, integers and choice")
        pair = getattr(self, kinds[0])
        if kinds[0] in ("uniform", "loguniform", "integers") and not pair[0] < pair[1]:
            raise ValueError(f"{kinds[0]} must rise, got {pair[0]:g} and {pair[1]:g}")
        if kinds[0] == "loguniform" and not pair[0] > 0:
            raise ValueError(f"loguniform must begin above 0, got {pair[0]:g}")
        if kinds[0] in ("normal", "lognormal") and not pair[1] > 0:
            raise ValueError(f"{kinds[0]} needs a mean and a width above 0, got width {pair[1]:g}")
        return self

    def _given(self, name: str) -> bool:
        return getattr(self, name) is not None

    def of(self, u: np.ndarray) -> np.ndarray | list[Any]:
        """(n,) values of (n,) numbers from 0 to 1: the inverse of the distribution function."""
        from scipy.special import ndtri

        if self.uniform is not None:
            low, high = self.uniform
            return low + (high - low) * u
        if self.loguniform is not None:
            low, high = np.log(self.loguniform)
            return np.exp(low + (high - low) * u)
        if self.integers is not None:
            first, last = self.integers
            return np.minimum(first + np.floor(u * (last - first + 1)), last).astype(np.int64)
        if self.choice is not None:
            chosen = np.minimum((u * len(self.choice)).astype(int), len(self.choice) - 1)
            return [self.choice[k] for k in chosen]
        middle, width = self.normal or self.lognormal or (0.0, 1.0)
        found = ndtri(np.clip(u, 1e-16, 1.0 - 1e-16)) * width
        found = middle + found if self.normal is not None else middle * np.exp(found)
        return np.clip(found, -np.inf if self.low is None else self.low, np.inf if self.high is None else self.high)


class Draw(Table):
    """Joint random samples of parameters, the same whenever they are drawn with a seed."""

    count: int = Field(ge=1, le=MOST)
    seed: int = Field(ge=0)
    sampler: Literal["random", "latin-hypercube", "sobol"] = "random"
    parameters: dict[str, Distribution] = Field(min_length=1)

    def samples(self) -> dict[str, np.ndarray | list[Any]]:
        """Name → `count` values."""
        cube = unit_cube(self.sampler, self.count, len(self.parameters), self.seed)
        return {name: each.of(cube[:, k]) for k, (name, each) in enumerate(self.parameters.items())}


def unit_cube(sampler: str, count: int, dimensions: int, seed: int) -> np.ndarray:
    """(count, dimensions) samples in [0, 1): NumPy's generator, or SciPy's Latin hypercube or scrambled Sobol sequence."""
    generator = np.random.default_rng(seed)
    if sampler == "random":
        return generator.random((count, dimensions))
    from scipy.stats import qmc

    kind: Any = {"latin-hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol}[sampler]
    try:
        engine = kind(dimensions, rng=generator)
    except TypeError:  # SciPy before 1.15
        engine = kind(dimensions, seed=generator)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that a count is no power of two: `--check` says so
        return engine.random(count)


def plain_of(values: Mapping[str, Any], index: int) -> dict[str, Any]:
    """Python's numbers of one sample."""
    return {name: each[index].item() if isinstance(each, np.ndarray) else each[index] for name, each in values.items()}
