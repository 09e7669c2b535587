"""A preset's file with fitted values, and how the command line says them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

T = TypeVar("T")


def string_index(preset: Any, text: str) -> int:
    """Number of a preset's string, by number or name. Raises ValueError."""
    names = [table.name for table in preset.string]
    if text in names:
        return names.index(text)
    if text.isdecimal() and int(text) < len(names):
        return int(text)
    known = ", ".join(f"{i} ({name})" if name else str(i) for i, name in enumerate(names))
    raise ValueError(f"--string must be one of {known} of {preset.name}, got {text!r}")


def check_output(output: str, preset: str, recordings: Sequence[str]) -> None:
    """Raises ValueError, OSError where the preset must not or cannot be written there: over a recording, or over a preset
    that comes with the program. One's own preset may get its new values in place (-p and -o the same name)."""
    from pathlib import Path

    from synth.files.targets import Named, check_apart, check_target, is_special
    from synth.instrument.preset import preset_folder, preset_path

    source = preset_path(preset)
    in_place = Path(preset) == Path(output) and source.parent != preset_folder()
    read = [Named("recording", each) for each in recordings] + ([] if in_place else [Named("preset", source)])
    check_apart(read, [Named("-o", output)])
    check_target(output)
    if not is_special(output) and Path(output).suffix != ".toml":
        raise ValueError(f"-o must be a preset's file, ending in .toml, got {output!r}")


def about(recordings: Sequence[str], work: Callable[[], T]) -> T:
    """What `work` gives; what it refuses begins with the recording's name, or with how many there are."""
    try:
        return work()
    except ValueError as error:
        name = recordings[0] if len(recordings) == 1 else f"{len(recordings)} recordings"
        raise ValueError(f"{name}: {error}") from None


def write(text: str, source: str, target: str, values: list[tuple[str, Any]]) -> None:
    """The preset's text with the values changed, its comments kept, and named after the new file as saving under another
    name does; a device or pipe is written to as it is, and the name stays."""
    from pathlib import Path

    from synth.author import changes
    from synth.author.document import current, preset_name
    from synth.files.targets import is_special, write_whole

    text, _ = current(text, source)
    special = is_special(target)
    named = [] if special else [("name", preset_name(os.fsencode(Path(target).stem).decode("utf-8", "replace")))]
    text, _ = changes.apply(text, [*values, *named], source)
    write_whole(target, lambda file: file.write(text.encode("utf-8")))


def value_text(value: Any) -> str:
    """A value as a preset's file has it."""
    return "(taken out)" if value is None else json.dumps(value, ensure_ascii=False)
