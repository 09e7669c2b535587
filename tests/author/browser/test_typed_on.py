"""What is typed into a field while the answer to the entry before is on its way."""

import pytest
from selenium.webdriver.common.keys import Keys

from tests.author.browser.running import FIELD, state

JIVA = "obstacle.jiva_um"
HOLD = """
const ask = window.fetch;
const held = new Promise((resolve) => { window.release = resolve; });
window.fetch = async (...given) => {
  const answer = await ask(...given);
  if (String(given[0]).endsWith('/edit')) {
    window.waiting = true;
    await held;
  }
  return answer;
};
"""


@pytest.fixture
def field(page):
    """The field of the thread's height, with 0.02 mm entered whose answer has not come; `window.release()` lets it come."""
    page.script(HOLD)
    field = page.field(JIVA)
    type_over(field, "0.02 mm", Keys.ENTER)
    page.until(lambda: page.script("return window.waiting"))
    assert state(page)["data"]["obstacle"]["jiva_um"] == 20
    return field


def type_over(field, *keys):
    field.send_keys(Keys.CONTROL, "a", Keys.NULL, *keys)


def refusal(page):
    return page.script(f"return document.querySelector('.control[data-path=\"{JIVA}\"] .control-error').textContent")


def answered(page):
    """Let the answer come, and wait until all of it is seen."""
    page.script("window.release()")
    page.until(lambda: page.script("return document.getElementById('undo').disabled") is False)
    page.await_script("for (let k = 0; k < 10; k++) await new Promise((next) => requestAnimationFrame(next));")


def test_a_refusal_outlives_the_answer_to_the_entry_before(page, field):
    type_over(field, "3 s", Keys.ENTER)
    page.until(lambda: refusal(page).startswith("must be a length in µm"))
    answered(page)
    assert refusal(page).startswith("must be a length in µm")
    assert field.get_property("value") == "3 s" and field.get_attribute("aria-invalid") == "true"
    type_over(field, "5", Keys.ENTER)
    page.until(lambda: state(page)["data"]["obstacle"]["jiva_um"] == 5)
    page.until(lambda: refusal(page) == "")


def test_the_entry_before_typed_again_takes_the_refusal_away(page, field):
    type_over(field, "3 s", Keys.ENTER)
    page.until(lambda: refusal(page) != "")
    type_over(field, "0.02 mm", Keys.ENTER)
    page.until(lambda: refusal(page) == "")
    answered(page)
    page.until(lambda: page.script("return document.querySelector(arguments[0]).value", FIELD.format(JIVA)) == "20")
    assert refusal(page) == ""


def test_what_is_selected_to_be_typed_over_stays_so(page, field):
    type_over(field)
    answered(page)
    page.until(lambda: field.get_property("value") == "20")
    field.send_keys("7", Keys.ENTER)
    page.until(lambda: state(page)["data"]["obstacle"]["jiva_um"] == 7)
