"""A folder with instruments for web pages: any static server serves it, and nothing is asked of another host.

file                what
index.html          the page with the instrument, which a server serves
NAME.html           the same in one file, which also opens by itself (from a disk, where browsers load no other files)
jawari.js           a module for pages of one's own: `mountInstrument(element, {wasm, relaxed, bank, worklet, style})`
jawari-worklet.js   what runs in the audio thread
jawari.css          how page and instrument look
jawari.wasm         the engine, the same for every instrument: it computes the same bits in every browser
jawari-relaxed.wasm the same for browsers with relaxed SIMD, where it is faster and rounds as the processor likes; portable
                    instruments go without it
NAME.jawari         the bank: for the sample rate RATE_HZ alone

The programs are written as modules of one subject each (`web/`), and come together in one file each here.
"""

from __future__ import annotations

import base64
import gzip
import html
import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from string import Template

from synth.files.folders import write_folder
from synth.files.targets import check_folder
from synth.plugin.description import Description

#: what `synth export --format` calls it
KIND = "web"
#: the sample rate of a bank for pages [Hz]: an audio context is made with it, whatever the sound card has
RATE_HZ = 48000.0
#: of engine and bank: what is larger is not written into one file as well
SINGLE_BYTES = 48_000_000

#: file names of the engine
ENGINE, RELAXED_ENGINE = "jawari.wasm", "jawari-relaxed.wasm"

_PAGE, _WORKLET = "page.js", "worklet.js"
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./([\w-]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const)\b)", re.MULTILINE)
#: what the file of a page gives to other pages
_GIVES = "export { mountInstrument, openPage };\n"
#: what a folder of this program has, and what else it may have beside its banks and the pages of these
_HAS = ("index.html", "jawari.js", "jawari-worklet.js", "jawari.css", ENGINE)
_MAY_HAVE = (RELAXED_ENGINE, "index-alone.html")

_HEAD = """\
    <link rel="stylesheet" href="jawari.css" />
    <link rel="modulepreload" href="jawari.js" />
    <link rel="preload" href="{bank}" as="fetch" crossorigin />"""
_SCRIPTS = """\
    <script>
      if (location.protocol === "file:")
        document.getElementById("instrument").innerHTML =
          '<p class="first-aid">{aid}</p>';
    </script>
    <script type="module">
      import {{ openPage }} from "./jawari.js";

      const here = (name) => new URL(name, document.baseURI).href;
      openPage(document.getElementById("instrument"), {{
        wasm: here("jawari.wasm"),{relaxed}
        bank: here("{bank}"),
        worklet: here("jawari-worklet.js"),
        style: here("jawari.css"),
      }});
    </script>"""
_AID = (
    "Browsers load no other files beside a page that is opened from a disk. {single}With Python, "
    "<code>python3 -m http.server</code> in this folder serves it at "
    '<a href="http://localhost:8000/">http://localhost:8000/</a>.'
)
_SINGLE_AID = 'Open <a href="{single}">{single}</a>, which is this page in one file. '
_SINGLE_HEAD = "    <style>\n{style}    </style>"
_SINGLE_SCRIPTS = """\
    <script type="text/plain" id="wasm">{wasm}</script>
    <script type="text/plain" id="bank">{bank}</script>
    <script type="text/plain" id="worklet">
{worklet}    </script>
    <script type="module">
{page}
const textOf = (id) => document.getElementById(id).textContent;
const addressOf = (text, type) => `data:${{type}},${{encodeURIComponent(text)}}`; // blobs of a page from a disk are nobody's
async function inflated(id) {{
  const bytes = Uint8Array.from(atob(textOf(id)), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}}
openPage(document.getElementById("instrument"), {{
  wasm: inflated("wasm"),
  bank: inflated("bank"),
  worklet: addressOf(textOf("worklet"), "text/javascript"),
  style: addressOf(document.querySelector("style").textContent, "text/css"),
}});
    </script>"""


def check(path: Path) -> None:
    """What can be judged before anything is made. Raises OSError: a file in the place of the folder, a folder that holds
    something else, no folder to write into."""
    check_folder(path, path.parent)
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise FileExistsError(f"{path}: is a file, and an instrument for web pages is a folder; give another name")
    if path.is_dir() and (other := _foreign(path)) is not None:
        raise FileExistsError(
            f"{path}: holds {other}, which does not belong to an instrument for web pages; give another name"
        )


def _foreign(folder: Path) -> str | None:
    """Something in a folder that this program has not written there."""
    names = sorted(str(found.relative_to(folder)) for found in folder.rglob("*"))
    if names and not set(_HAS) <= set(names):
        return names[0]
    banks = {name for name in names if name.endswith(".jawari") and (folder / name).parent == folder}
    own = {*_HAS, *_MAY_HAVE, *banks, *(f"{name.removesuffix('.jawari')}.html" for name in banks)}
    return next((name for name in names if name not in own or not (folder / name).is_file()), None)


def write(path: Path, wasm: bytes, bank: bytes, description: Description, relaxed: bytes | None = None) -> None:
    """An instrument for web pages at `path`: whole, or what was there before.

    wasm: the engine; relaxed: that with relaxed SIMD, if the instrument is to have it. bank: for RATE_HZ alone, packed or
    not. Raises OSError that names what could not be written.
    """
    check(path)
    write_folder(path, contents(wasm, bank, description, relaxed))


def contents(wasm: bytes, bank: bytes, description: Description, relaxed: bytes | None = None) -> Mapping[str, bytes]:
    """The files of the folder by their names."""
    title, about = _titles(description)
    bank_name = f"{description.id}.jawari"
    single = f"{description.id}.html" if description.id != "index" else "index-alone.html"
    made = parts()
    files_made = {name: text.encode() for name, text in made.items()} | {ENGINE: wasm, bank_name: bank}
    if relaxed is not None:
        files_made[RELAXED_ENGINE] = relaxed
    also = "" if relaxed is None else f'\n        relaxed: here("{RELAXED_ENGINE}"),'
    has_single = len(wasm) + len(bank) <= SINGLE_BYTES
    aid = _AID.format(single=_SINGLE_AID.format(single=single) if has_single else "")
    page = _page(title, about, _HEAD.format(bank=bank_name), _SCRIPTS.format(bank=bank_name, aid=aid, relaxed=also))
    files_made["index.html"] = page.encode()
    if has_single:
        scripts = _SINGLE_SCRIPTS.format(
            wasm=_inline(wasm), bank=_inline(bank), worklet=made["jawari-worklet.js"], page=made["jawari.js"]
        )
        files_made[single] = _page(title, about, _SINGLE_HEAD.format(style=made["jawari.css"]), scripts).encode()
    return files_made


def parts() -> dict[str, str]:
    """What every instrument needs in a page beside the engine and its bank, by file names."""
    return {"jawari.js": program(_PAGE), "jawari-worklet.js": program(_WORKLET), "jawari.css": _source("style.css")}


@cache
def program(first: str) -> str:
    """A module of `web/` and all that it imports, as one file, in the order in which they run. That of the page exports what
    other pages may use."""
    texts: dict[str, str] = {}

    def add(name: str) -> None:
        if name in texts:
            return
        source = _source(name)
        for other in _IMPORT.findall(source):
            add(other)
        texts[name] = f"// ---- {name}\n{_EXPORT.sub('', _IMPORT.sub('', source))}"

    add(first)
    return "\n".join(texts.values()) + (_GIVES if first == _PAGE else "")


def _source(name: str) -> str:
    return (files("synth.plugin") / "web" / name).read_text(encoding="utf-8")


def _page(title: str, about: str, head: str, scripts: str) -> str:
    texts = {"title": html.escape(title), "description": html.escape(about), "head": head, "scripts": scripts}
    return Template(_source("index.html")).substitute(texts)


def _titles(description: Description) -> tuple[str, str]:
    """Of the page: title and what stands below it."""
    presets = description.presets
    if len(presets) == 1:
        return presets[0].name, presets[0].description
    return description.name, ", ".join(preset.name for preset in presets)


def _inline(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, mtime=0)).decode()
