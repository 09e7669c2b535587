"""The page of the command line, out of the parser."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Iterator
from functools import partial

from synth.cli import command_parser

from .fields import Range
from .markdown import code, fence, plain, table

_INTRODUCTION = """# Command line

`synth COMMAND --help` says the same in a terminal. `-` as a file's name stands for standard output where a command
writes one.

Exit codes: 0 done; 1 the program's fault, or nobody reads on; 2 wrong input, or something could not be written; 128 + N
ended by signal N.
"""


def commands(
    parser: argparse.ArgumentParser | None = None, words: tuple[str, ...] = ("synth",)
) -> Iterator[tuple[str, argparse.ArgumentParser, str]]:
    """(its words, its parser, what it does) of every command, the whole program first."""
    top = parser or command_parser()
    yield " ".join(words), top, top.description or ""
    for action in top._actions:
        if isinstance(action, argparse._SubParsersAction):
            helps = {choice.dest: choice.help or "" for choice in action._choices_actions}
            for name, inner in action.choices.items():
                for each, its, what in commands(inner, (*words, name)):
                    yield each, its, what or (helps.get(name, "") if its is inner else "")


def options(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.Action]]:
    """(title of its group, action) of all that a parser takes, but for its commands and --help."""
    for group in parser._action_groups:
        for action in group._group_actions:
            if not isinstance(action, argparse._SubParsersAction | argparse._HelpAction):
                yield group.title or "", action


def help_of(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """An action's words. Raises LookupError where it has none."""
    if not action.help or action.help == argparse.SUPPRESS:
        raise LookupError(f"{parser.prog}: {name_of(action)} has no help; give it one")
    return parser._get_formatter()._expand_help(action)


def name_of(action: argparse.Action) -> str:
    """What is typed for it."""
    if not action.option_strings:
        return str(action.metavar or action.dest)
    return ", ".join(action.option_strings)


def _value(action: argparse.Action) -> str:
    if action.choices is not None:
        return " or ".join(code(str(each)) for each in action.choices)
    if not action.option_strings or action.nargs == 0:
        return ""
    names = action.metavar if isinstance(action.metavar, tuple) else (action.metavar or action.dest.upper(),)
    text = " ".join(names)
    limits = _range(action)
    return code(f"[{text}]" if action.nargs == "?" else text) + (f", {limits}" if limits else "")


def _range(action: argparse.Action) -> str:
    """Of an option whose type is `cli.common.number`."""
    if not inspect.isfunction(action.type):
        return ""
    seen = inspect.getclosurevars(action.type).nonlocals
    if not {"low", "high"} <= set(seen):
        return ""
    return f"{Range(seen['low'], seen['high'])}{seen.get('unit', '')}"


def _default(action: argparse.Action) -> str:
    value = action.default
    if value in (None, False, (), [], argparse.SUPPRESS) or action.nargs == 0:
        return "" if value != 0 or isinstance(value, bool) or not action.option_strings else "0"
    if isinstance(value, list | tuple):
        return code(",".join(map(str, value)))
    return f"{value:g}" if isinstance(value, float) else code(str(value))


def page() -> str:
    """The page. Raises LookupError for a command or an option without words."""
    out = [_INTRODUCTION]
    for name, parser, what in commands():
        if not what:
            raise LookupError(f"{name} has no description; give it one")
        parser.formatter_class = partial(argparse.HelpFormatter, width=78)
        out += [f"## {name}\n", plain(what[0].upper() + what[1:].rstrip(".")) + ".\n", fence(parser.format_usage())]
        rows = [
            (code(name_of(action)), _value(action), _default(action), plain(help_of(parser, action)))
            for _, action in options(parser)
        ]
        if rows:
            out.append(table(("option", "value", "default", "meaning"), rows))
        inner = [each for each, _, _ in commands(parser, (name,)) if each.count(" ") == name.count(" ") + 1]
        if inner:
            links = ", ".join(f"[{each}](#{each.replace(' ', '-')})" for each in inner)
            out.append(f"Commands: {links}.\n")
    return "\n".join(out)
