"""A plugin's bank with another setup, for one sample rate: what plugins start where Python is there (c/plugin_rebuild.c).

    python -m synth.plugin.rebuild PLUGIN CHECKSUM RATE OUT tanpura/string.length=0.9 …

PLUGIN is the plugin's file, CHECKSUM that of its bank (8 hexadecimal digits), RATE the sample rate [Hz], OUT where the bank
goes: a file of the user's alone. What cannot be is said in one line on standard output. It ends when its standard input
does: with the host that has started it.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path

#: banks that are kept, all together [bytes]; the oldest go
KEPT_BYTES = 256 << 20


def main(arguments: Sequence[str]) -> int:
    """What the module's docstring says. The exit code: 0 or 2."""
    try:
        plugin, checksum, rate, out, *settings = arguments
        rebuild(Path(plugin), int(checksum, 16), float(rate), Path(out), settings)
    except (ValueError, OSError) as error:
        strerror = getattr(error, "strerror", None)
        told = f"{getattr(error, 'filename', '')}: {strerror}" if strerror else str(error)
        print(" ".join((told.splitlines() or [type(error).__name__])[0].split()))
        return 2
    return 0


def rebuild(plugin: Path, checksum: int, rate_hz: float, out: Path, settings: Iterable[str]) -> None:
    """Write the bank. settings: PRESET/ID=VALUE each. Raises ValueError for what cannot be, OSError for what cannot be read
    or written."""
    from synth.files.targets import write_whole
    from synth.instrument.check import check
    from synth.plugin import bankfile
    from synth.plugin.setup import set_up

    found, recipe = bankfile.recipe_of(plugin)
    if found != checksum:
        raise ValueError("the plugin's file was replaced after it was loaded; load the plugin again")
    values: dict[str, dict[str, float]] = {preset.name: {} for preset in recipe.presets}
    for each in settings:
        place, _, value = each.partition("=")
        name, _, identity = place.partition("/")
        values[name][identity] = float(value)
    presets = [set_up(preset, values[preset.name]) for preset in recipe.presets]
    for preset, before in zip(presets, recipe.presets, strict=True):
        if preset is not before:
            check(preset, preset.title or preset.name)
    data = bankfile.bank(presets, [rate_hz], name=recipe.name, **recipe.options)
    out.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    write_whole(out, lambda file: file.write(data), 0o600)
    clear(out.parent, out)


def clear(folder: Path, kept: Path, most: int = KEPT_BYTES) -> None:
    """Take away the oldest banks of a folder that are too many, but not `kept`. Raises nothing: another may do the same."""
    found = []
    for path in folder.glob("*.jawari"):
        try:
            about = path.stat()
        except OSError:
            continue
        found.append((path == kept, about.st_mtime, about.st_size, path))
    room = most
    for mine, _, size, path in sorted(found, reverse=True):
        room -= size
        if room < 0 and not mine:
            path.unlink(missing_ok=True)


def _end_with_the_host() -> None:
    """Wait for the end of standard input, then end at once."""
    os.read(0, 1)
    from synth.files.unfinished import discard_unfinished

    discard_unfinished()
    os._exit(2)


def _let_go_of_the_hosts_files() -> None:
    """A host may have left files open to all that it starts: sound cards among them."""
    for name in os.listdir("/proc/self/fd"):
        if int(name) > 2:
            try:
                os.close(int(name))
            except OSError:  # the listing's own
                pass


if __name__ == "__main__":
    _let_go_of_the_hosts_files()
    os.nice(10)
    threading.Thread(target=_end_with_the_host, daemon=True).start()
    code = main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(code)
