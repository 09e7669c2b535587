"""The button that measures a plan: progress, what is kept beside the file, an end before it is done."""

import pytest

from tests.author.browser.running import Author, Page
from tests.test_planfile import PRESET


@pytest.fixture
def page(driver, tmp_path):
    (tmp_path / "mine.toml").write_text(PRESET.format(string="viscoelastic_loss = 0.02", displacement="3.0", rest=""))
    with Author(tmp_path, "mine.toml") as author:
        page = Page(driver)
        page.open(author.address)
        yield page
        page.open_nothing()


def test_a_plan_is_measured_and_kept_beside_the_file(page, tmp_path):
    page.script("document.querySelector('#analysis').scrollTop = 99999")
    page.find("#measure-plan").click()
    page.until(lambda: "saved beside mine.toml; strings that cost less, out of 1: draft 1" in page.text("#plan-said"))
    assert 'note = "G2"' in (tmp_path / "mine.plan").read_text()
    page.until(lambda: "measured on this string" in page.text(".cost .promise"))
    assert page.find("#measure-plan").is_enabled() and page.errors() == []


def test_measuring_is_stopped(page, tmp_path):
    page.script("document.querySelector('#analysis').scrollTop = 99999")
    page.script(
        """document.getElementById("measure-plan").click();
        const head = document.getElementById("plan-said").parentElement;
        const timer = setInterval(() => head.querySelector("progress").hasAttribute("value") &&
          head.querySelector("button.quiet").click(), 5);
        setTimeout(() => clearInterval(timer), 20000);"""
    )
    page.until(lambda: page.find("#measure-plan").is_enabled())
    assert page.text("#plan-said") == "Cancelled" and not (tmp_path / "mine.plan").exists()
