"""What a notebook is shown of sounds and results: tables, pictures, sound inside the HTML itself: nothing is fetched."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from html import escape
from importlib.util import find_spec
from typing import Any

#: extra of the package → what it installs that is asked for here
_EXTRAS = {"matplotlib": "notebook", "xarray": "notebook", "sounddevice": "live"}
_TABLE = "border-collapse:collapse;margin:0.3em 0"
_CELL = "text-align:left;padding:0.1em 0.8em 0.1em 0"


def need(module: str, what: str) -> None:
    """ImportError, which says how to get it, where a module that `what` needs is not installed."""
    if find_spec(module) is None:
        raise ImportError(f"{what} needs {module}: pip install 'jawari[{_EXTRAS[module]}]'", name=module)


def there_is(module: str) -> bool:
    """Whether a module is installed; it is not loaded."""
    return find_spec(module) is not None


def data_uri(kind: str, data: bytes) -> str:
    """Bytes of a MIME type as an address that holds them."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def picture(png: bytes, what: str) -> str:
    """A PNG in the page; `what` is said where it cannot be seen."""
    return f'<img alt="{escape(what)}" src="{data_uri("image/png", png)}" style="max-width:100%"/>'


def table(rows: Iterable[tuple[str, str]]) -> str:
    """Names and what they are, a row each."""
    cells = (
        f'<tr><th style="{_CELL}">{escape(name)}</th><td style="{_CELL}">{escape(value)}</td></tr>' for name, value in rows
    )
    return f'<table style="{_TABLE}">{"".join(cells)}</table>'


def paragraph(text: str) -> str:
    """A line of plain text."""
    return f"<p>{escape(text)}</p>"


def png_of(figure: Any) -> bytes:
    """A matplotlib Figure as a PNG, whatever is set for the screen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    out = io.BytesIO()
    FigureCanvasAgg(figure).print_png(out)
    return out.getvalue()
