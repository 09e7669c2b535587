"""What `tools/targets` does; see there."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import brotli
import lief
import pytest

from synth.instrument.preset import load_preset
from synth.plugin import bankfile, shelf, wclap
from synth.plugin.platforms import TARGETS, WEB, Target, host
from tests.plugin import clapabi, takes
from tests.plugin.native import Library
from tests.plugin.test_targets import check_library


@dataclass
class Row:
    """Of the table: a library, and what has become of its checks."""

    target: str
    kind: str
    path: Path | None = None
    checked: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def check(self, name: str, function: Callable[[], Any]) -> None:
        """A check that raises where something is wrong, or skips where a program is missing."""
        try:
            function()
        except pytest.skip.Exception as missing:
            self.left_out.append(f"{name}: {missing}")
        except Exception as error:  # whatever is wrong is a row's result
            self.wrong.append(f"{name}: {str(error).strip() or type(error).__name__}".splitlines()[0])
        else:
            self.checked.append(name)

    def line(self) -> str:
        sizes = ["", ""]
        if self.path is not None:
            data = self.path.read_bytes()
            sizes = [f"{len(each) / 1e6:.2f}" for each in (data, brotli.compress(data))]
        result = "; ".join(self.wrong) or ("right" if self.checked else "not checked")
        return f"{self.target:15} {self.kind:9} {sizes[0]:>7} {sizes[1]:>7}  {', '.join(self.checked):44} {result}"


class Checks:
    """The takes that every portable library must play, and who plays them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._bank = folder / "bank.jawari"
        self._bank.write_bytes(takes.bank())
        here = shelf.library_for(TARGETS["linux-x86-64"], "portable", _say)
        self._expected = takes.here(Library(here), self._bank)

    def native(self, target: Target, bits: str) -> Row:
        """A native library and its plugins; the portable one plays."""
        row = Row(target.name, bits)
        row.check("built", lambda: setattr(row, "path", shelf.library_for(target, bits, _say)))
        native = row.path
        if native is None:
            return row
        place = self._place(f"{target.name}-{bits}")
        row.check("lief", lambda: check_library(native, target, place))
        if bits == "portable":
            for name, processor in _PLAYERS.get(target.name, ()):
                row.check(name, lambda processor=processor: self._same(self._elsewhere(target, native, processor)))
        return row

    def web(self, kind: str) -> Row:
        """The engine as WebAssembly, with a CLAP or without."""
        row = Row(WEB.name, kind)
        row.check("built", lambda: setattr(row, "path", shelf.web_library(kind, _say)))
        module = row.path
        if module is None:
            return row
        row.check("wasmtime", lambda: self._same(takes.in_wasmtime(module.read_bytes(), self._bank.read_bytes())))
        row.check("node", lambda: self._same(takes.in_node(module, self._bank, self._place(f"node-{kind}"))))
        if kind == "wclap":
            row.check("host", lambda: self._hosted(module))
        return row

    def _place(self, name: str) -> Path:
        place = self._folder / name
        place.mkdir()
        return place

    def _same(self, found: Mapping[str, str]) -> None:
        other = [name for name in takes.PRESETS if found[name] != self._expected[name]]
        assert not other, f"other bits of {', '.join(other)}"

    def _elsewhere(self, target: Target, native: Path, processor: str) -> Mapping[str, str]:
        place = self._place(f"{target.name}-{processor or 'takes'}")
        return takes.elsewhere(target, native, self._bank, place, processor)

    def _hosted(self, module: Path) -> None:
        from tests.plugin.wclaphost import WclapHost

        archive = self._folder / "tanpura.wclap.tar.gz"
        data = bankfile.bank([load_preset("tanpura-light")], [takes.RATE_HZ], quality="draft")
        wclap.write(archive, module.read_bytes(), data)
        playing = WclapHost(archive).instance()
        assert playing.activate(takes.RATE_HZ)
        assert abs(playing.process([clapabi.note_on(0, 48, 0.8)], 4096)).max() > 0.01, "it is silent"


#: who plays a portable library, and on which processor
_PLAYERS: Mapping[str, Sequence[tuple[str, str]]] = {
    "linux-x86-64": [(f"qemu {processor}", processor) for processor in takes.PROCESSORS],
    "linux-arm64": [("qemu arm64", "")],
    "windows-x86-64": [("Wine", "")],
}


def _say(what: str) -> None:
    print(f"tools/targets: {what}", file=sys.stderr, flush=True)


def main() -> int:
    names = [*TARGETS, WEB.name]
    parser = argparse.ArgumentParser(prog="tools/targets", description="Builds and checks libraries of all targets.")
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(names)}; default: all")
    given = parser.parse_args().targets or names
    if unknown := sorted(set(given) - set(names)):
        parser.error(f"there is no target {unknown[0]!r}; use {', '.join(names)}")
    if host() != TARGETS["linux-x86-64"]:
        parser.error("it compares with what Linux on x86-64 plays, and runs there only")
    lief.logging.disable()  # of what it leaves out of a file
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        checks = Checks(Path(temporary))
        print(f"{'target':15} {'kind':9} {'MB':>7} {'brotli':>7}  {'checked by':44} result")
        for name in given:
            kinds = ("web", "wclap") if name == WEB.name else shelf.BITS
            for kind in kinds:
                rows.append(checks.web(kind) if name == WEB.name else checks.native(TARGETS[name], kind))
                print(rows[-1].line(), flush=True)
    for text in dict.fromkeys(each for row in rows for each in row.left_out):
        print(f"left out: {text}")
    return int(any(row.wrong for row in rows))


if __name__ == "__main__":
    sys.exit(main())
