"""Notebooks that were run: what they show, and whether they are those of their sources."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import nbformat

from .source import notebook

#: of a picture, as many as leave it this small [bytes]
COLOURS = (128, 64, 32, 16)
LARGEST = 60_000
#: longest that a cell may take [s]
PATIENCE_S = 600


class Failed(Exception):
    """A notebook that ended with an error, or that shows not what it should."""


@contextmanager
def kernel() -> Iterator[Any]:
    """A kernel that runs, for several notebooks."""
    from jupyter_client.manager import KernelManager

    manager = KernelManager(kernel_name="python3")
    manager.start_kernel()
    try:
        yield manager
    finally:
        manager.shutdown_kernel(now=True)


def run(book: Any, folder: Path, manager: Any = None) -> Any:
    """The notebook with what its cells gave, run in a folder; manager: of a kernel that runs already. Raises Failed."""
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError

    client = NotebookClient(
        book, km=manager, timeout=PATIENCE_S, kernel_name="python3", record_timing=False,
        resources={"metadata": {"path": str(folder)}},
    )  # fmt: skip
    try:
        client.execute()
    except CellExecutionError as error:
        raise Failed(str(error)) from None
    for cell in book.cells:
        cell.metadata.pop("execution", None)
        for output in cell.get("outputs", ()):
            _tidy(output)
    return book


def _tidy(output: Any) -> None:
    """Smaller pictures, and no text for what has one; what is said on standard error would be a warning."""
    if output.output_type == "stream" and output.name == "stderr":
        raise Failed(f"a notebook warns:\n{output.text}")
    data = output.get("data", {})
    if "image/png" in data:
        png = fewer_colours(base64.b64decode(data["image/png"]))
        output.data = {"image/png": base64.b64encode(png).decode("ascii")}
        output.metadata = {}
    elif "text/markdown" in data:
        output.data = {"text/markdown": data["text/markdown"]}


def fewer_colours(png: bytes) -> bytes:
    """A picture with a palette, which is a third in size. Raises Failed where none is small enough."""
    from PIL import Image

    whole = Image.open(io.BytesIO(png)).convert("RGB")
    for colours in COLOURS:
        out = io.BytesIO()
        whole.quantize(colours, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
        if out.tell() <= LARGEST:
            break
    else:
        raise Failed(f"a picture of {out.tell()} bytes is too large; draw it smaller")
    return out.getvalue()


def _shown(book: Any, kind: str) -> list[str]:
    return [
        output["data"][kind]
        for cell in book.cells
        for output in cell.get("outputs", ())
        if kind in output.get("data", {})
    ]  # fmt: skip


def pictures(book: Any) -> list[bytes]:
    """The PNGs that it shows. Raises Failed where there is none."""
    found = [base64.b64decode(each) for each in _shown(book, "image/png")]
    if not found:
        raise Failed("it shows no picture")
    return found


def table(book: Any) -> str:
    """The one table that it shows as Markdown. Raises Failed where there is not one."""
    found = _shown(book, "text/markdown")
    if len(found) != 1:
        raise Failed(f"it must show one table of the paper's statements and ours, got {len(found)}")
    return found[0]


def text(book: Any) -> str:
    """The file."""
    nbformat.validate(book)
    return nbformat.writes(book) + "\n"


def is_of(path: Path, source: Path) -> bool:
    """Whether a notebook that was run has the cells of its source, all run, in order, and none with an error."""
    if not path.is_file():
        return False
    there, wanted = nbformat.read(path, as_version=4), notebook(source)
    if [(cell.id, cell.cell_type, cell.source) for cell in there.cells] != [
        (cell.id, cell.cell_type, cell.source) for cell in wanted.cells
    ]:
        return False
    counts = [cell.execution_count for cell in there.cells if cell.cell_type == "code"]
    errors = [output for cell in there.cells for output in cell.get("outputs", ()) if output.output_type == "error"]
    return counts == list(range(1, len(counts) + 1)) and not errors
