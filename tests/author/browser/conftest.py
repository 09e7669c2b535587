"""A browser, where there is one, and a preset in it."""

import pytest

from tests.author.browser.running import Author, Page, chromium, copy_preset, name_of, why_not
from tests.patience import COMPILING_QUIET_S, until


@pytest.fixture(scope="session", autouse=True)
def compiled(tmp_path_factory):
    """Kernels that need not be compiled while a page waits for them."""
    with Author(tmp_path_factory.mktemp("presets")) as author:
        until(lambda: author.get("/api/session")["kernels"] == "ready", quiet_s=COMPILING_QUIET_S)
        for preset, note in (("tanpura-light", 48), ("fretted-bass", 43)):
            doc = author.open(preset)
            for view in ("motion", "analysis"):
                author.get(f"{doc.path}/{view}?note={note}")


@pytest.fixture(scope="module")
def driver():
    """A Chromium for all tests of a module; skips where there is none."""
    reason = why_not()
    if reason:
        pytest.skip(reason)
    with chromium() as driver:
        yield driver


@pytest.fixture(scope="module")
def author(tmp_path_factory):
    """A server for all tests of a module, of which each has a file of its own."""
    with Author(tmp_path_factory.mktemp("presets")) as author:
        yield author


@pytest.fixture
def mine(author, request):
    """A file of the test's own in the folder of the module's server: the module's PRESET, else a tanpura."""
    path = author.folder / f"{name_of(request)}.toml"
    copy_preset(getattr(request.module, "PRESET", "tanpura-light"), path)
    return path


@pytest.fixture
def page_of_mine(driver, author, mine):
    """The page with that file open."""
    page = Page(driver)
    page.open(f"{author.address}#{author.open(mine.name).key}")
    yield page
    page.open_nothing()


@pytest.fixture
def folder(tmp_path):
    """A folder with one preset, mine.toml, a tanpura."""
    copy_preset("tanpura-light", tmp_path / "mine.toml")
    return tmp_path


@pytest.fixture
def page(driver, folder):
    """The page with that preset open."""
    with Author(folder, "mine.toml") as author:
        page = Page(driver)
        page.open(author.address)
        yield page
        page.open_nothing()
