"""A browser, where there is one, and a preset in it."""

import pytest

from tests.author.browser.running import Author, Page, chromium, copy_preset, why_not


@pytest.fixture(scope="session", autouse=True)
def browser():
    """Skips where there is none."""
    reason = why_not()
    if reason:
        pytest.skip(reason)


@pytest.fixture(scope="module")
def driver():
    """A browser for all tests of a module."""
    with chromium() as driver:
        yield driver


@pytest.fixture
def folder(tmp_path):
    """A folder with one preset, mine.toml, a tanpura."""
    copy_preset("tanpura", tmp_path / "mine.toml")
    return tmp_path


@pytest.fixture
def page(driver, folder):
    """The page with that preset open."""
    with Author(folder, "mine.toml") as author:
        page = Page(driver)
        page.open(author.address)
        yield page
        page.open_nothing()
