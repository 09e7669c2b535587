"""From presets to plugins: what `synth export` does."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from synth.files.targets import Named, check_apart
from synth.host.parts import files_read, load_presets
from synth.instrument.preset import Preset
from synth.plugin import bundle, wclap, webfolder
from synth.plugin.description import Description, describe
from synth.plugin.droning import DroneSettings
from synth.plugin.platforms import TARGETS, WEB, WEB_RELAXED

#: told how many strings are prepared, of how many
Progress = Callable[[int, int], None]
#: what judges a place, of formats for the web
_JUDGES: Mapping[str, Callable[[Path], None]] = {webfolder.KIND: webfolder.check, wclap.KIND: wclap.check}


@dataclass(frozen=True)
class Export:
    """What goes into a plugin. presets: names or files; every: those that come with the program instead; drone: what it
    plays by itself, on the only preset; bits: of `platforms.BITS`; the rest as the options of `synth export` are called."""

    presets: tuple[str, ...]
    every: bool = False
    name: str | None = None
    settings: Sequence[tuple[str | None, str, str]] = ()
    quality: str = "standard"
    rates_hz: tuple[int, ...] = (44100, 48000, 88200, 96000)
    tuning: str | None = None
    keyboard: str | None = None
    drone: DroneSettings | None = None
    bits: str = "fast"


@dataclass(frozen=True)
class ExportReport:
    """What was written: for each target the path of each format and the bytes of the native library; those of the bank,
    which is the same for all."""

    name: str
    presets: tuple[str, ...]
    rates_hz: tuple[int, ...]
    quality: str
    bits: str
    paths: Mapping[str, Mapping[str, str]]
    library_bytes: Mapping[str, int]
    bank_bytes: int

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        paths = {target: dict(each) for target, each in self.paths.items()}
        return {**self.__dict__, "paths": paths, "library_bytes": dict(self.library_bytes)}

    def lines(self) -> list[str]:
        """For people."""
        rates = ", ".join(f"{rate / 1000:g}" for rate in self.rates_hz)
        what = f"{self.name}: {', '.join(self.presets)}" if len(self.presets) > 1 else self.name
        lines = [f"{what}; {self.quality}, {rates} kHz"]
        for target, paths in self.paths.items():
            lines.append(f"  {target}, {(self.library_bytes[target] + self.bank_bytes) / 1e6:.1f} MB")
            lines += [f"    {kind:5} {path}" for kind, path in paths.items()]
            if webfolder.KIND in paths:
                lines.append(f"    to see it: python3 -m http.server --directory {shlex.quote(paths[webfolder.KIND])}")
        return lines


def export(
    wanted: Export,
    places: Callable[[str], Mapping[str, Mapping[str, Path]]],
    *,
    make_folders: bool = False,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> ExportReport:
    """Write a plugin in one or several formats, for one or several systems, or an instrument for web pages.

    places        for each target (`platforms.TARGETS`; or `WEB` alone) the path of each format, of a plugin of this name
    make_folders  the folders in which they lie are made
    progress      called with (strings that are compiled, all there are) after each
    say           told what takes time where a native library has to be built
    Raises ValueError for what cannot be exported, OSError for what cannot be written or built; of each format what was there
    before is then as it was, or the new one is whole.
    """
    names = _every_preset() if wanted.every else list(wanted.presets)
    presets = list(load_presets(names, wanted.settings).values())
    drone, name = None, wanted.name
    if wanted.drone is not None:
        if len(presets) != 1:
            raise ValueError(f"--drone makes a plugin of one preset, got {len(presets)}; leave the others out")
        if wanted.tuning is not None or wanted.keyboard is not None:
            raise ValueError("--drone tunes its strings by --sa and --first; leave --tuning and --kbm out")
        drone = wanted.drone.on(presets[0])
        presets, name = [drone.strings.preset], name or f"{presets[0].name}-drone"
    description = describe(presets, name, () if drone is None else drone.parameters())
    paths = {target: dict(each) for target, each in places(description.id).items()}
    _judge(wanted, names, paths, make_folders)
    note_hz = None
    if wanted.tuning is not None or wanted.keyboard is not None:
        from synth.host.scala import playable_frequencies

        note_hz, silent = playable_frequencies(wanted.tuning, wanted.keyboard)
        if silent.any():
            raise ValueError(
                f"--kbm {wanted.keyboard}: leaves keys silent, which a plugin does not support; map every key, or retune it "
                "in the music program (MTS)"
            )
    from synth.plugin import bankfile, python_record, shelf

    making: dict[str, Any] = {
        "name": name,
        "drone": drone,
        "quality": wanted.quality,
        "note_hz": note_hz,
        "progress": progress,
    }
    if WEB.name in paths:
        (kind, path), *_ = paths[WEB.name].items()
        size, bank = _write_for_web(kind, path, presets, wanted, description, making, say)
        sizes = {WEB.name: size}
    else:
        natives = {target: shelf.library_for(TARGETS[target], wanted.bits, say) for target in paths}
        bank, sizes = bankfile.bank(presets, wanted.rates_hz, **making), {}
        for target, native in natives.items():
            plugins = bundle.Plugins(native, bank, description, TARGETS[target])
            sizes[target] = plugins.library_bytes
            for kind, path in sorted(paths[target].items(), key=lambda each: bundle.FORMATS.index(each[0])):
                if make_folders:
                    path.parent.mkdir(parents=True, exist_ok=True)
                plugins.write(kind, path)
        python_record.write()
    return ExportReport(
        name=description.id,
        presets=tuple(preset.id for preset in description.presets),
        rates_hz=wanted.rates_hz,
        quality=wanted.quality,
        bits=wanted.bits,
        paths={target: {kind: os.fspath(path) for kind, path in each.items()} for target, each in paths.items()},
        library_bytes=sizes,
        bank_bytes=len(bank),
    )


def _write_for_web(
    kind: str,
    path: Path,
    presets: Sequence[Preset],
    wanted: Export,
    description: Description,
    making: Mapping[str, Any],
    say: Callable[[str], None] | None,
) -> tuple[int, bytes]:
    """The one thing that an export for the web writes: bytes of the engine in it, and its bank."""
    from synth.plugin import bankfile, packed_bank, shelf

    module = shelf.web_library(kind, say).read_bytes()
    if kind == wclap.KIND:
        bank = bankfile.bank(presets, wanted.rates_hz, **making)
        wclap.write(path, module, bank)
    else:
        relaxed = shelf.web_library(kind, say, WEB_RELAXED).read_bytes() if wanted.bits == "fast" else None
        bank = packed_bank.for_pages(*bankfile.laid_out(presets, wanted.rates_hz, **making))
        webfolder.write(path, module, bank, description, relaxed)
    return len(module), bank


def _every_preset() -> list[str]:
    from synth.instrument.preset import list_presets

    return [preset.name for preset in list_presets()]


def _judge(wanted: Export, names: Sequence[str], paths: Mapping[str, Mapping[str, Path]], make_folders: bool) -> None:
    """What is wrong with the places, before anything takes time."""
    read = files_read(names, **{"--tuning": wanted.tuning, "--kbm": wanted.keyboard})
    check_apart(read, [Named(f"the {kind}", path) for each in paths.values() for kind, path in each.items()])
    for target, each in paths.items():
        for kind, path in each.items():
            if kind in _JUDGES:
                _JUDGES[kind](path)
            elif not (make_folders and not path.parent.exists()):
                bundle.check(kind, path, TARGETS[target])
