"""Instruments for web pages: what the folder holds, what is refused, and that its programs are whole."""

from __future__ import annotations

import base64
import gzip
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest

from synth.cli import main
from synth.instrument.preset import Preset, load_preset
from synth.plugin import bankfile, droning, packed_bank, shelf, webfolder
from synth.plugin.description import describe

WEB = Path(webfolder.__file__).parent / "web"
WASM, BANK = b"\0asm of a test", b"JAWARIBK of a test"
PROGRAMS = ("jawari.js", "jawari-worklet.js")


def written(folder: Path, *presets: str, name: str | None = None) -> Path:
    webfolder.write(folder / "it", WASM, BANK, describe([load_preset(each) for each in presets], name))
    return folder / "it"


class Addresses(HTMLParser):
    """What a page asks for."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value for name, value in attrs if name in ("href", "src") and value]


def test_the_folder_holds_a_page_its_parts_and_the_page_in_one_file(tmp_path: Path) -> None:
    folder = written(tmp_path, "tanpura-light")
    names = {path.name for path in folder.iterdir()}
    assert names == {"index.html", "tanpura-light.html", "jawari.css", "jawari.wasm", "tanpura-light.jawari", *PROGRAMS}
    assert (folder / "jawari.wasm").read_bytes() == WASM
    assert (folder / "tanpura-light.jawari").read_bytes() == BANK
    page = (folder / "index.html").read_text()
    preset = load_preset("tanpura-light")
    assert f"<title>{preset.title}</title>" in page and preset.description.split(",")[0] in page


def test_nothing_is_asked_of_another_host(tmp_path: Path) -> None:
    folder = written(tmp_path, "tanpura-light")
    asked = Addresses((folder / "index.html").read_text()).found
    assert {each for each in asked if not each.startswith("data:")} <= {path.name for path in folder.iterdir()}
    texts = {path.name: path.read_text() for path in folder.iterdir() if path.suffix in (".html", ".js", ".css")}
    found = {name: set(re.findall(r"(?:https?:)?//[a-z][\w.:-]+", text)) for name, text in texts.items()}
    assert set().union(*found.values()) <= {"http://localhost", "http://localhost:8000"}


def test_one_file_holds_engine_and_bank(tmp_path: Path) -> None:
    text = (written(tmp_path, "tanpura-light") / "tanpura-light.html").read_text()
    for name, whole in (("wasm", WASM), ("bank", BANK)):
        found = re.search(rf'id="{name}">([\w+/=]+)</script>', text)
        assert found and gzip.decompress(base64.b64decode(found[1])) == whole
    assert [each for each in Addresses(text).found if not each.startswith("data:")] == []


def test_what_is_large_is_not_written_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webfolder, "SINGLE_BYTES", len(WASM))
    folder = written(tmp_path, "tanpura-light")
    assert not (folder / "tanpura-light.html").exists()
    page = (folder / "index.html").read_text()
    assert "tanpura-light.html" not in page and "python3 -m http.server" in page


def test_titles_are_texts_of_the_page(tmp_path: Path) -> None:
    preset = load_preset("tanpura-light")
    odd: Preset = preset.model_copy(update={"title": "<b>Four & a half</b> $head", "description": 'a "line" </p>'})
    webfolder.write(tmp_path / "it", WASM, BANK, describe([odd]))
    page = (tmp_path / "it" / "index.html").read_text()
    assert "<title>&lt;b&gt;Four &amp; a half&lt;/b&gt; $head</title>" in page
    assert "a &quot;line&quot; &lt;/p&gt;" in page and 'a "line"' not in page


def test_several_presets_have_a_name_together(tmp_path: Path) -> None:
    folder = written(tmp_path, "tanpura-light", "sitar", name="indian")
    page = (folder / "index.html").read_text()
    assert "<title>indian</title>" in page and "Tanpura, light, Sitar" in page and (folder / "indian.jawari").exists()


def test_a_preset_that_is_called_index_keeps_its_page(tmp_path: Path) -> None:
    folder = written(tmp_path, "tanpura-light", name="index")
    assert "module" in (folder / "index.html").read_text() and (folder / "index-alone.html").exists()


def test_it_is_written_over_its_like(tmp_path: Path) -> None:
    written(tmp_path, "sitar")
    folder = written(tmp_path, "tanpura-light")
    assert not (folder / "sitar.jawari").exists() and (folder / "tanpura-light.jawari").exists()


def test_a_page_of_ones_own_beside_it_is_not_written_over(tmp_path: Path) -> None:
    folder = written(tmp_path, "tanpura-light")
    (folder / "about.html").write_text("mine")
    with pytest.raises(FileExistsError, match=r"holds about\.html, which does not belong"):
        written(tmp_path, "tanpura-light")
    assert (folder / "about.html").read_text() == "mine"


@pytest.mark.parametrize("name", ["notes.txt", "deep/index.html", "mine.js", "about.html", "index.html"])
def test_a_folder_that_holds_something_else_is_refused_and_stays(name: str, tmp_path: Path) -> None:
    other = tmp_path / "it" / name
    other.parent.mkdir(parents=True)
    other.write_text("mine")
    with pytest.raises(FileExistsError, match="does not belong to an instrument for web pages"):
        written(tmp_path, "tanpura-light")
    assert other.read_text() == "mine" and len(list((tmp_path / "it").rglob("*.jawari"))) == 0


def test_a_file_in_its_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "it").write_text("mine")
    with pytest.raises(FileExistsError, match="is a folder"):
        written(tmp_path, "tanpura-light")
    with pytest.raises(OSError, match="no"):
        written(tmp_path / "nowhere", "tanpura-light")


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_programs_are_javascript(name: str, tmp_path: Path) -> None:
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    program = (written(tmp_path, "tanpura-light") / name).read_text()
    assert not re.search(r"^import ", program, re.MULTILINE)
    module = tmp_path / "program.mjs"
    module.write_text(program)
    done = subprocess.run(["node", "--check", str(module)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_module_is_in_a_program_once() -> None:
    for first in ("page.js", "worklet.js"):
        heads = re.findall(r"^// ---- (\S+)$", webfolder.program(first), re.MULTILINE)
        assert len(heads) == len(set(heads)) and heads[-1] == first
    both = webfolder.program("page.js") + webfolder.program("worklet.js")
    assert all(f"// ---- {path.name}\n" in both for path in WEB.glob("*.js"))


def test_the_programs_read_a_bank_as_it_is_laid_out() -> None:
    """Where JavaScript reads a bank or a drone's score itself, it has the places that Python writes."""

    def constant(module: str, name: str) -> int:
        found = re.search(rf"^const {name} = (\d+);$", (WEB / module).read_text(), re.MULTILINE)
        assert found, name
        return int(found[1])

    def at(kind, *names: str) -> list[int]:
        return [kind.fields[name][1] for name in names]

    assert at(bankfile.HEADER, "drone_at") == [constant("module.js", "DRONE_AT")]
    assert constant("drone.js", "SCORE_BYTES") == droning.SCORE.itemsize
    assert constant("drone.js", "OWN_BYTES") == droning.OWN.itemsize
    assert constant("drone.js", "STROKE_BYTES") == droning.STROKE.itemsize
    score = ("strings", "strokes", "parameters", "steps", "part", "channel", "position", "width")
    assert at(droning.SCORE, *score) == [0, 4, 8, 12, 16, 20, 24, 28]
    assert at(droning.SCORE, "step_low", "lead_s", "semitone_s", "step_s", "keys", "places") == [32, 40, 48, 56, 64, 96]
    assert at(droning.OWN, "minimum", "maximum", "initial", "curve", "id", "name", "unit") == [0, 8, 16, 24, 32, 80, 176]
    assert at(droning.STROKE, "sway", "wander", "louder", "farther", "wider") == [0, 8, 16, 24, 32]
    assert f"export const RATE_HZ = {webfolder.RATE_HZ:.0f};" in (WEB / "contexts.js").read_text()


def test_the_command_writes_it_and_says_how_to_see_it(web_library, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(shelf, "web_library", lambda *_: web_library)
    monkeypatch.chdir(tmp_path)
    assert main(["export", "tanpura-light", "-f", "web", "--quality", "draft"]) == 0
    out = capsys.readouterr().out
    assert "48 kHz" in out and "python3 -m http.server --directory tanpura-light-web" in out
    bank = packed_bank.unpack((tmp_path / "tanpura-light-web" / "tanpura-light.jawari").read_bytes())
    assert bank.startswith(b"JAWARIBK")


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["web", "--rates", "44100"], "pages play at 48000 Hz"),
        (["web", "--install"], "--install is for plugins"),
        (["web", "--target", "windows-x86-64"], "--target is for plugins; with --format web"),
        (["wclap", "--target", "windows-x86-64"], "--target is for plugins; with --format wclap"),
        (["wclap", "--install"], "--install is for plugins"),
        (["web", "-o", "it.clap"], "is named as clap, but --format is web"),
    ],
)
def test_what_the_web_cannot_have_is_refused(arguments: list[str], why: str, capsys) -> None:
    assert main(["export", "tanpura-light", "-f", *arguments]) == 2
    assert why in capsys.readouterr().err


def test_a_place_that_cannot_be_written_is_refused_before_anything_is_made(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.delattr(shelf, "web_library")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    assert main(["export", "tanpura-light", "-f", "web", "-o", str(tmp_path / "mine")]) == 2
    assert "notes.txt" in capsys.readouterr().err
