"""Two tabs on one document show the same, whoever edits."""

import pytest

from tests.author.browser.running import set_value


@pytest.fixture
def tabs(page):
    """Handles of two tabs on the document."""
    driver = page.driver
    first = driver.current_window_handle
    address = driver.current_url
    driver.switch_to.new_window("tab")
    page.open(address)
    second = driver.current_window_handle
    yield first, second
    driver.switch_to.window(second)
    page.open_nothing()
    driver.close()
    driver.switch_to.window(first)


def value(page, path):
    return page.field(path).get_property("value")


def test_edit_undo_and_save_are_seen_in_the_other_tab(page, tabs):
    first, second = tabs
    switch = page.driver.switch_to.window
    set_value(page, "pluck.position", 0.31)
    switch(first)
    page.until(lambda: value(page, "pluck.position") == "0.31")
    page.find("#undo").click()
    switch(second)
    page.until(lambda: value(page, "pluck.position") == "0.42")
    page.find("#redo").click()
    page.until(lambda: value(page, "pluck.position") == "0.31")
    page.find("#save").click()
    switch(first)
    page.until(lambda: page.text("#doc-status") == "mine.toml")
    assert page.find("#save").get_property("disabled")


def test_edits_of_both_tabs_are_steps_of_one_history(page, tabs):
    first, second = tabs
    switch = page.driver.switch_to.window
    set_value(page, "pluck.position", 0.31)
    switch(first)
    page.until(lambda: value(page, "pluck.position") == "0.31")
    set_value(page, "obstacle.jiva_um", 5)
    switch(second)
    page.until(lambda: value(page, "obstacle.jiva_um") == "5")
    page.find("#undo").click()
    page.until(lambda: value(page, "obstacle.jiva_um") == "3")
    assert value(page, "pluck.position") == "0.31"
