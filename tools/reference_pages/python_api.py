"""The page of Python: every public name, its signature and its docstring.

Public is what `synth.__all__` names, the modules in `MODULES`, and what the pages of docs/extending import for modules of
one's own.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import synth

from .markdown import anchor, code, docstring, fence

EXTENDING = Path(__file__).resolve().parents[2] / "docs" / "extending"

#: module → names that are public in it, None: all; those that `synth` itself has stand there
MODULES: dict[str, tuple[str, ...] | None] = {
    "synth.host.memory": ("RenderOptions",),
    "synth.host.render": ("RenderSettings",),
    "synth.engine.engine": ("Unplayed",),
    "synth.midi.events": None,
    "synth.fit": None,
    "synth.research.case": ("case_path", "case_folder"),
    "synth.study.sweeping": ("read_results",),
    "synth.physics.string": None,
    "synth.physics.tuning": None,
    "synth.physics.modes": None,
    "synth.physics.obstacle": None,
    "synth.physics.body_modes": None,
    "synth.physics.coupled": None,
    "synth.plugin.bankfile": ("bank",),
    "synth.extensions": None,
}


def names_of(module: ModuleType) -> list[str]:
    """The public names that a module has of its own."""
    chosen = getattr(module, "__all__", None)
    if chosen is not None:
        return list(chosen)
    assigned = [name for name in _comments(module) if not name.startswith("_")]
    made = [
        name
        for name, thing in vars(module).items()
        if not name.startswith("_") and getattr(thing, "__module__", None) == module.__name__ and name not in assigned
    ]
    return [*made, *(name for name in assigned if name not in made)]


def extending() -> dict[str, list[str]]:
    """Module → names that the pages on modules of one's own import."""
    found: dict[str, list[str]] = {}
    for path in sorted(EXTENDING.glob("*.md")):
        for block in re.findall(r"^```python[^\n]*\n(.*?)^```", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
            for node in ast.walk(ast.parse(block)):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("synth."):
                    names = found.setdefault(node.module or "", [])
                    names += [each.name for each in node.names if each.name not in names]
    return {module: found[module] for module in sorted(found)}


def public() -> Iterator[tuple[str, str, list[str]]]:
    """(heading, module, its public names) of everything that is public."""
    yield "synth", "synth", [name for name in synth.__all__ if name != "__version__"]
    known = set(synth.__all__)
    for name, chosen in MODULES.items():
        names = names_of(import_module(name)) if chosen is None else chosen
        yield name, name, [each for each in names if each not in known]
    for name, names in extending().items():
        beside = [each for each in names if not (each in known or (name in MODULES and MODULES[name] is None))]
        if beside:
            yield f"{name} (for modules of your own)", name, beside


def _comments(module: ModuleType) -> dict[str, str]:
    """Assigned names of a module with the comments before or behind them."""
    source = inspect.getsource(module)
    lines = source.splitlines()
    found: dict[str, str] = {}
    for node in ast.parse(source).body:
        targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        names = [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]
        if not names:
            continue
        above = []
        for line in reversed(lines[: node.lineno - 1]):
            if not line.startswith("#:"):
                break
            above.insert(0, line[2:].strip())
        behind = re.search(r"\s#\s+(.*)$", lines[(node.end_lineno or node.lineno) - 1])
        text = " ".join(above) or (behind[1] if behind else "")
        found.update(dict.fromkeys(names, text))
    return found


def _constant(module: ModuleType, name: str) -> str:
    """What a constant is: the comment at its definition, in this module or in the one that it is imported from."""
    if module is synth:
        return _constant(import_module(synth._MODULES[name]), name)
    comments = _comments(module)
    if name in comments:
        return comments[name]
    for node in ast.parse(inspect.getsource(module)).body:
        if (
            isinstance(node, ast.ImportFrom)
            and node.module
            and any((each.asname or each.name) == name for each in node.names)
        ):
            return _constant(import_module(node.module), name)
    return ""


def words_of(module: ModuleType, name: str, thing: Any) -> str:
    """What a public thing is. Raises LookupError where nothing says it."""
    text = ""
    if inspect.isclass(thing) or inspect.isroutine(thing) or inspect.ismodule(thing):
        text = inspect.getdoc(thing) or ""
        if inspect.isclass(thing) and text.startswith(f"{thing.__name__}("):  # made by dataclass, of the signature
            text = ""
    elif hasattr(thing, "py_func"):  # compiled
        text = inspect.getdoc(thing.py_func) or ""
    elif getattr(thing, "__doc__", None) and str(getattr(thing, "__module__", "")).startswith("synth"):
        text = inspect.getdoc(thing) or ""
    if not text:
        text = _constant(module, name)
        text = text[:1].upper() + text[1:]
    if not text:
        raise LookupError(f"{module.__name__}.{name} has no docstring; give it one")
    return text


class _Bare:
    """What is written as it is: an annotation without the quotes of a text."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


def _bare(annotation: Any) -> Any:
    text = getattr(annotation, "__forward_arg__", annotation)
    return _Bare(text) if isinstance(text, str) else annotation


def _signature(name: str, thing: Any) -> str:
    try:
        found = inspect.signature(thing)
    except (TypeError, ValueError):
        return name
    bare = [each.replace(annotation=_bare(each.annotation)) for each in found.parameters.values()]
    text = str(found.replace(parameters=bare, return_annotation=_bare(found.return_annotation)))
    text = re.sub(r"<function ([\w.<>]+) at 0x[0-9a-f]+>", lambda found: "…" if "<" in found[1] else found[1], text)
    text = re.sub(r"CPUDispatcher\(([\w.]+)\)", r"\1", text).replace("<factory>", "…").replace("'", '"')
    text = text.removesuffix(" -> None")
    if len(name + text) > 100 and ", " in text:
        inside, _, back = text[1:].rpartition(")")
        text = "(\n" + "".join(f"    {each},\n" for each in _arguments(inside)) + ")" + back
    return name + text


def _arguments(text: str) -> list[str]:
    """Arguments of a signature, cut at the commas between them."""
    depth, out = 0, [""]
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            out.append("")
        else:
            out[-1] += letter
    return [each.strip() for each in out if each.strip()]


def members(kind: type) -> Iterator[tuple[str, Any]]:
    """(name, function) of a class's public methods and properties, in order: its own, then its bases'."""
    found: dict[str, Any] = {}
    for base in kind.__mro__:
        if base.__module__.partition(".")[0] == "synth":
            found |= {name: thing for name, thing in vars(base).items() if name not in found}
    for name, thing in found.items():
        if name.startswith("_") or name in getattr(kind, "__dataclass_fields__", ()):
            continue
        function = thing.fget if isinstance(thing, property) else getattr(thing, "__func__", thing)
        if inspect.isfunction(function):
            yield name, thing if isinstance(thing, property) else function


def _entry(module: ModuleType, name: str, path: str) -> Iterator[str]:
    thing = getattr(module, name)
    words = words_of(module, name, thing)
    yield f"### {anchor(path)}{code(name)}\n"
    callable_ = getattr(thing, "py_func", thing)
    if inspect.isclass(thing) and issubclass(thing, BaseException):
        yield fence(f"class {name}({', '.join(base.__name__ for base in thing.__bases__)})", "python")
    elif inspect.isclass(thing):
        tables = hasattr(thing, "model_fields")
        yield fence(f"class {name}" if tables else _signature(f"class {name}", thing), "python")
    elif inspect.isroutine(callable_):
        yield fence(_signature(name, callable_), "python")
    elif isinstance(thing, int | float | str):
        yield fence(f"{name} = {thing!r}", "python")
    yield docstring(words)
    if module is synth:
        home = synth._MODULES[name]
        yield f"From `{home}`.\n"
    if inspect.isclass(thing):
        for member, function in members(thing):
            is_property = isinstance(function, property)
            its = inspect.getdoc(function.fget if is_property else function)
            if not its:
                raise LookupError(f"{path}.{member} has no docstring; give it one")
            yield f"#### {anchor(f'{path}.{member}')}{code(f'{name}.{member}')}\n"
            if not is_property:
                yield fence(_signature(member, function), "python")
            yield docstring(its)


_INTRODUCTION = """# Python

The names of `synth` itself are what most programs need: `render` for songs, `Engine` for blocks of sound, `simulate`
and `sweep` for research, `fit_recording` for recordings, `cite` for papers. The modules behind them follow, with what they
have beside these names, and last what [modules of your own](../extending/excitation.md) may use.
The package is typed.
"""


def page() -> str:
    """The page. Raises LookupError, which names them, for public names without a docstring."""
    out = [_INTRODUCTION]
    for title, name, names in public():
        module = import_module(name)
        out += [f"## {title}\n", docstring(inspect.getdoc(module) or "")]
        if name == "synth":
            out += [f"### {anchor('synth.__version__')}`__version__`\n", "The version that is installed.\n"]
        for each in names:
            out += _entry(module, each, f"{name}.{each}")
            if (name, each) == ("synth", "simulate"):
                about = import_module("synth.research.simulation").__doc__ or ""
                out += ["The module's description, of cases and results:\n", fence(inspect.cleandoc(about))]
    return "\n".join(out)
