"""Mutants of a module, as cosmic-ray makes them, and a seeded sample of them.

A sample draws places, and one mutant of each: an arithmetic operator has eleven mutants, and where one is caught most are.
Not taken is what Python does not compile or warns of, what changes annotations alone, and equality for identity: those of
small numbers are the same.
"""

from __future__ import annotations

import ast
import random
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names
from cosmic_ray.work_item import MutationSpec

Place = tuple[tuple[int, int], tuple[int, int]]


@dataclass(frozen=True, order=True)
class Mutant:
    """`place`: first and last (line, column), lines from 1; `occurrence`: which one of this operator in the module."""

    module: str
    place: Place
    operator: str
    occurrence: int

    def spec(self, tree: Path) -> MutationSpec:
        """As cosmic-ray wants it, in that copy of the sources."""
        return MutationSpec(tree / self.module, self.operator, self.occurrence, *self.place)


def mutants(tree: Path, module: str) -> Iterator[Mutant]:
    """All of a module, those that cannot be run included."""
    nodes = list(ast_nodes(get_ast_from_path(tree / module)))
    for name in operator_names():
        kind = get_operator(name)
        if kind.arguments() or re.search("_Is(Not)?(_|$)", name):  # the former change names that they must be given
            continue
        places = (place for node in nodes for place in kind().mutation_positions(node))
        for occurrence, place in enumerate(places):
            yield Mutant(module, place, name, occurrence)


def at_line(tree: Path, module: str, line: int) -> list[Mutant]:
    """All that start at a line and can be run."""
    found = sorted(mutant for mutant in mutants(tree, module) if mutant.place[0][0] == line)
    return [mutant for mutant in found if can_be_run(tree, mutant)]


def sample(tree: Path, modules: Iterable[str], count: int, seed: str) -> list[Mutant]:
    """At most `count` of them, no two at one place, sorted."""
    chance = random.Random(seed)
    places: dict[tuple[str, Place], list[Mutant]] = {}
    for mutant in sorted(each for module in modules for each in mutants(tree, module)):
        places.setdefault((mutant.module, mutant.place), []).append(mutant)
    taken: list[Mutant] = []
    for place in chance.sample(sorted(places), len(places)):
        if len(taken) >= count:
            break
        there = chance.sample(places[place], len(places[place]))
        taken += [mutant for mutant in there if can_be_run(tree, mutant)][:1]
    return sorted(taken)


def can_be_run(tree: Path, mutant: Mutant) -> bool:
    """Whether Python takes it without a word and it says anything else than the module does."""
    source = (tree / mutant.module).read_text(encoding="utf-8")
    mutated = mutate_code(source, get_operator(mutant.operator)(), mutant.occurrence)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            compile(mutated, mutant.module, "exec")
    except (SyntaxError, ValueError, SyntaxWarning):
        return False
    return _said(source) != _said(mutated)


def _said(source: str) -> str:
    """The module without its annotations, and whatever decides on what they need: they are for readers and mypy."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            node.returns = None
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(None)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            node.test = ast.Constant(None)
    return ast.dump(tree)
