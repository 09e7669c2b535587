"""From presets to plugins: what `synth export` does."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from synth.files.targets import Named, check_apart
from synth.host.parts import files_read, load_presets
from synth.plugin import bundle, webfolder
from synth.plugin.description import Description, describe
from synth.plugin.droning import DroneSettings

#: told how many strings are prepared, of how many
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Export:
    """What goes into a plugin. presets: names or files; every: those that come with the program instead; drone: what it
    plays by itself, on the only preset; the rest as the options of `synth export` are called."""

    presets: tuple[str, ...]
    every: bool = False
    name: str | None = None
    settings: Sequence[tuple[str | None, str, str]] = ()
    quality: str = "standard"
    rates_hz: tuple[int, ...] = (44100, 48000, 88200, 96000)
    tuning: str | None = None
    keyboard: str | None = None
    drone: DroneSettings | None = None


@dataclass(frozen=True)
class ExportReport:
    """What was written: path of each format, bytes of the native library and of its bank."""

    name: str
    presets: tuple[str, ...]
    rates_hz: tuple[int, ...]
    quality: str
    paths: Mapping[str, str]
    library_bytes: int
    bank_bytes: int

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**self.__dict__, "paths": dict(self.paths)}

    def lines(self) -> list[str]:
        """For people."""
        rates = ", ".join(f"{rate / 1000:g}" for rate in self.rates_hz)
        size = (self.library_bytes + self.bank_bytes) / 1e6
        what = f"{self.name}: {', '.join(self.presets)}" if len(self.presets) > 1 else self.name
        return [
            f"{what}; {self.quality}, {rates} kHz, {size:.1f} MB",
            *(f"  {kind:5}{path}" for kind, path in self.paths.items()),
        ]


def export(
    wanted: Export,
    targets: Callable[[str], Mapping[str, Path]],
    *,
    make_folders: bool = False,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> ExportReport:
    """Write a plugin in one or several formats.

    targets       path of each format, of a plugin of this name
    make_folders  the folders in which they lie are made
    progress      called with (strings that are compiled, all there are) after each
    say           told what takes time where the native library has to be built
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
    paths = dict(targets(description.id))
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
    from synth.plugin import bankfile, library, python_record, shelf

    if webfolder.KIND in paths:
        wasm = shelf.web_library(say).read_bytes()
        bank = bankfile.bank(
            presets,
            (webfolder.RATE_HZ,),
            name=name,
            drone=drone,
            quality=wanted.quality,
            note_hz=note_hz,
            progress=progress,
        )
        webfolder.write(paths[webfolder.KIND], wasm, bank, description)
        return _report(wanted, description, paths, len(wasm), len(bank))
    native = shelf.native_library(say)
    bank = bankfile.bank(
        presets,
        wanted.rates_hz,
        name=name,
        drone=drone,
        quality=wanted.quality,
        note_hz=note_hz,
        progress=progress,
    )
    whole = library.with_bank(native, bank)
    same = None
    for kind in sorted(paths, key=bundle.FORMATS.index):  # CLAP, which is a file, first: those in folders become names of it
        path = paths[kind]
        if make_folders:
            path.parent.mkdir(parents=True, exist_ok=True)
        same = bundle.write(kind, path, whole, description, same)
    python_record.write()
    return _report(wanted, description, paths, len(whole) - len(bank), len(bank))


def _every_preset() -> list[str]:
    from synth.instrument.preset import list_presets

    return [preset.name for preset in list_presets()]


def _judge(wanted: Export, names: Sequence[str], paths: Mapping[str, Path], make_folders: bool) -> None:
    """What is wrong with the places, before anything takes time."""
    read = files_read(names, **{"--tuning": wanted.tuning, "--kbm": wanted.keyboard})
    check_apart(read, [Named(f"the {kind}", path) for kind, path in paths.items()])
    for kind, path in paths.items():
        if not (make_folders and not path.parent.exists()):
            webfolder.check(path) if kind == webfolder.KIND else bundle.check(kind, path)


def _report(wanted: Export, description: Description, paths: Mapping[str, Path], library: int, bank: int) -> ExportReport:
    return ExportReport(
        name=description.id,
        presets=tuple(preset.id for preset in description.presets),
        rates_hz=wanted.rates_hz,
        quality=wanted.quality,
        paths={kind: os.fspath(path) for kind, path in paths.items()},
        library_bytes=library,
        bank_bytes=bank,
    )
