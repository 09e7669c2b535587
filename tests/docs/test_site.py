"""README is short, and the site is whole: built without a warning, every link leads somewhere, nothing asks another host."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from listening import instruments

from synth.instrument.preset import list_presets
from tests.author.browser.running import chromium, why_not
from tests.docs import links
from tests.patience import until

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = REPOSITORY / "docs"
_MARKDOWN_LINK = re.compile(r"\]\(([^)\s]+)\)")


def test_readme_is_short_and_its_links_lead_somewhere() -> None:
    text = (REPOSITORY / "README.md").read_bytes()
    assert len(text) <= 6144
    found = _MARKDOWN_LINK.findall(text.decode())
    assert len(found) > 10
    for link in (*found, *_MARKDOWN_LINK.findall((REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8"))):
        assert (REPOSITORY / link.split("#")[0]).is_file(), link


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda path: path.relative_to(DOCS).as_posix())
def test_links_of_a_page_lead_somewhere_in_a_checkout(page: Path) -> None:
    """…where nothing is generated; pages that the site generates have stand-ins."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    missing = [
        link
        for link in _MARKDOWN_LINK.findall(text)
        if ":" not in link and link.split("#")[0] and not (page.parent / link.split("#")[0]).exists()
    ]
    assert missing == []


def test_stand_ins_are_replaced_by_the_reference(site: Path) -> None:
    for page in (DOCS / "reference").rglob("*.md"):
        text = (site / page.relative_to(DOCS).with_suffix(".html")).read_text(encoding="utf-8")
        assert "Without the site" in page.read_text(encoding="utf-8") and "Without the site" not in text


def stub_sounds(folder: Path) -> None:
    """What `tools/listen` leaves, without sound: a player for each section that a page asks for."""
    folder.mkdir(parents=True)
    sections = {
        name for page in DOCS.rglob("*.md") for name in re.findall(r"<!-- players: ([a-z-]+) -->", page.read_text("utf-8"))
    }
    pieces = [(name, name) for name in sorted(sections)] + [("instruments", preset.name) for preset in list_presets()]
    about = {"title": "one", "about": "nothing", "file": "one.ogg"}
    sounds = [{"section": section, "piece": piece, **about} for section, piece in pieces]
    (folder / "one.ogg").touch()
    (folder / "sounds.json").write_text(json.dumps(sounds), encoding="utf-8")


def stub_instruments(folder: Path) -> None:
    """What `tools/live` leaves where there is no engine for web pages."""
    folder.mkdir(parents=True)
    listed = [{"name": name, "title": name, "file": None, "bytes": 0} for name in instruments.every_name()]
    (folder / "live.json").write_text(json.dumps(listed), encoding="utf-8")


def build(configuration: Path, site: Path, built: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "JAWARI_DOCS_BUILD": str(built), "NO_MKDOCS_2_WARNING": "1"}
    return subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", str(configuration), "-d", str(site)],
        env=environment,
        capture_output=True,
        text=True,
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `tools/docs` builds it, with players of nothing."""
    folder = tmp_path_factory.mktemp("docs").resolve()
    stub_sounds(folder / "build" / "sounds")
    stub_instruments(folder / "build" / "live")
    reference = REPOSITORY / "tools" / "reference"
    if reference.is_file():
        subprocess.run([sys.executable, str(reference), str(folder / "build" / "reference")], check=True)
    done = build(REPOSITORY / "mkdocs.yml", folder / "site", folder / "build")
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "site"


def test_every_page_is_built_and_can_be_reached(site: Path) -> None:
    wanted = {path.relative_to(DOCS).with_suffix(".html") for path in DOCS.rglob("*.md")} | {Path("changelog.html")}
    assert wanted <= {path.relative_to(site) for path in site.rglob("*.html")}
    # the navigation is on every page, whole
    start = site / "index.html"
    reached = {
        (start.parent / address.split("#")[0]).resolve() for address, asks in links.pages(site)[start].links if not asks
    }
    assert {site / path for path in wanted} <= reached


def test_notebooks_stay_out_of_it(site: Path) -> None:
    assert {path.suffix for path in (DOCS / "notebooks").iterdir() if path.is_file()} == {".py", ".ipynb"}
    assert not (site / "notebooks").exists()
    assert not [path for path in site.rglob("*") if path.suffix in (".py", ".ipynb")]


def test_every_link_anchor_picture_and_sound_is_there(site: Path) -> None:
    assert links.broken(site) == []


def test_nothing_asks_another_host(site: Path) -> None:
    assert links.foreign(site) == []
    # what the theme's script would fetch: diagrams' renderer for the one, a repository's stars for the other
    for path, page in links.pages(site).items():
        assert "mermaid" not in page.classes and "md-source" not in page.classes, path


def test_every_preset_has_a_page_to_play_it_that_the_pages_of_instruments_lead_to(site: Path) -> None:
    linked = {address.split("#")[0] for address, _ in links.pages(site)[site / "instruments.html"].links}
    index = {address for address, _ in links.pages(site)[site / "reference" / "instruments" / "index.html"].links}
    for preset in list_presets():
        text = (site / "reference" / "instruments" / f"{preset.name}.html").read_text(encoding="utf-8")
        assert text.count('class="live-missing"') == (2 if preset.family == "tanpura" else 1) and text.count("<audio") == 1
        assert f"synth export {preset.name} -f web" in re.sub(r"<[^>]*>", "", text)
        assert f"{preset.name}.html" in index
    assert {f"reference/instruments/{name}.html" for name in ("slap-bass", "harp")} <= linked


def test_formulas_and_players_are_on_their_pages(site: Path) -> None:
    assert "<audio" in (site / "listen.html").read_text(encoding="utf-8")
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert "<!-- player" not in text and "<!-- instrument:" not in text and 'class="arithmatex"' not in text, path
        assert "\\|" not in re.sub(r"<pre.*?</pre>", "", text, flags=re.DOTALL), path
    assert "<math" in (site / "theory" / "passivity.html").read_text(encoding="utf-8")


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    (tmp_path / "there.html").write_text('<p id="here">')
    (tmp_path / "index.html").write_text(
        """<a href="there.html#here">good</a><a href="there.html#gone">no anchor</a><a href="gone.html">no page</a>
        <a href="https://example.org/">leads away</a><img src="gone.png"><script src="//example.org/x.js"></script>
        <p style="background: url(https://example.org/y.png)"><a href="#gone">no anchor here</a>"""
    )
    (tmp_path / "style.css").write_text('@import "https://example.org/font.css"; a { background: url(data:x) }')
    assert links.broken(tmp_path) == [
        f"index.html: {address}" for address in ("there.html#gone", "gone.html", "gone.png", "#gone")
    ]
    assert links.foreign(tmp_path) == [
        "index.html: //example.org/x.js",
        "index.html: https://example.org/y.png",
        "style.css: https://example.org/font.css",
    ]


def test_the_build_refuses_what_is_wrong(tmp_path: Path) -> None:
    """A page outside the navigation, a link to nothing and sounds that were not rendered: each is told."""
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "index.md").write_text("# Start\n\n[gone](gone.md)\n\n<!-- players: none -->\n")
    (docs / "lost.md").write_text("# Lost\n")
    text = (REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8")
    text = text[: text.index("\nnav:")].replace("tools/documentation", str(REPOSITORY / "tools" / "documentation"))
    (tmp_path / "mkdocs.yml").write_text(f"{text}\nnav: [index.md]\n", encoding="utf-8")
    done = build(tmp_path / "mkdocs.yml", tmp_path / "site", tmp_path / "build")
    assert done.returncode != 0
    for told in ("gone.md", "lost.md", "'none'"):
        assert told in done.stderr, done.stderr


def test_it_opens_from_the_folder_and_can_be_searched(site: Path) -> None:
    """In a browser, as a reader without a server has it: search answers, nothing is asked of another host, no page is wider
    than a telephone."""
    if reason := why_not():
        pytest.skip(reason)
    with chromium() as driver:
        driver.get((site / "index.html").as_uri())
        field = driver.find_element("css selector", "input.md-search__input")
        driver.execute_script("document.getElementById('__search').click()")
        until(field.is_displayed)
        field.send_keys("jiva")
        until(lambda: driver.find_elements("css selector", ".md-search-result__article"), "search does not answer")
        for page in ("index.html", "theory/passivity.html", "quality.html", "listen.html"):
            metrics = {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True}
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
            driver.get((site / page).as_uri())
            asked = driver.execute_script("return performance.getEntriesByType('resource').map((entry) => entry.name)")
            assert all(address.startswith(site.as_uri()) for address in asked), asked
            assert driver.execute_script("return document.documentElement.scrollWidth") <= 400, page
        problems = [entry["message"] for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]
        assert [problem for problem in problems if ".ogg" not in problem] == []
