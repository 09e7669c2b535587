"""A CLAP as WebAssembly (WCLAP): one module in an archive, which hosts in pages and music programs with a bridge load.

    write(Path("tanpura.wclap.tar.gz"), module, bank)

The archive NAME.wclap.tar.gz holds module.wasm; that exports `clap_entry`, its memory, its table of functions, and malloc.
"""

from __future__ import annotations

import gzip
import io
import tarfile
from pathlib import Path

from synth.files.targets import check_folder, write_whole
from synth.plugin.wasmbank import with_own_bank

#: what `synth export --format` calls it
KIND = "wclap"
MODULE = "module.wasm"


def check(path: Path) -> None:
    """What can be judged before anything is made. Raises OSError: a folder in its place, no folder to write into."""
    check_folder(path, path.parent)
    if path.is_dir():
        raise IsADirectoryError(f"{path}: is a directory; give a file name")


def write(path: Path, module: bytes, bank: bytes) -> None:
    """The archive at `path`: whole, or what was there before. Raises OSError that names what could not be written."""
    check(path)
    whole = with_own_bank(module, bank)
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as archive:
        about = tarfile.TarInfo(MODULE)
        about.size, about.mode = len(whole), 0o644
        archive.addfile(about, io.BytesIO(whole))
    write_whole(path, lambda file: file.write(gzip.compress(packed.getvalue(), mtime=0)))
