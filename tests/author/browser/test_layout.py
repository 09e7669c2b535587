"""The page on screens of four sizes, with each preset: nothing is cut off, torn apart or taller than it may be."""

import pytest

from tests.author.browser.running import Page

SIZES = [(1280, 720), (1024, 768), (820, 1180), (400, 800)]
#: how much of the screen's height the dock may take [px], and the row of key switches, where a preset has some
DOCK = {1280: 155, 1024: 155, 820: 195, 400: 170}
SWITCHES = 32


@pytest.fixture(scope="module", params=["tanpura-light", "fretted-bass", "jawari-harp", "steel-guitar"])
def opened(driver, author, request):
    page = Page(driver)
    driver.set_window_size(1280, 900)
    page.open(author.address)
    page.choose(request.param)
    yield page
    driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    page.open_nothing()


@pytest.fixture(params=SIZES, ids=[f"{width}x{height}" for width, height in SIZES])
def sized(opened, request):
    """(page, width, height)"""
    width, height = request.param
    opened.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500},
    )
    opened.until(lambda: opened.script("return [innerWidth, innerHeight]") == [width, height])
    return opened, width, height


TORN = """
const torn = [];
const box = (each) => each.getBoundingClientRect();
for (const group of document.querySelectorAll(".group[open]")) {
  const head = box(group.querySelector("summary"));
  for (const each of group.querySelectorAll(".control, .card, .tab-list, .control-slider")) {
    if (!each.checkVisibility()) continue;
    // below its heading, and within its width
    if (box(each).top < head.bottom - 1 || box(each).left < head.left - 1 || box(each).right > box(group).right + 1)
      torn.push([group.dataset.group, each.outerHTML.slice(0, 90)]);
  }
}
for (const each of document.querySelectorAll(".control")) {
  const slider = each.querySelector(".control-slider");
  if (!slider?.checkVisibility()) continue;
  const name = each.querySelector(".control-name");
  const below = box(slider).top - box(name).bottom;
  if (below < -8 || below > 24) torn.push(["slider", each.dataset.path]);
}
return torn;
"""

CUT = """
const seen = (each) => each.checkVisibility({visibilityProperty: true});
const wide = innerWidth;
const out = [];
const all = "button, input, select, output, summary, h1, h2, h3, .unit, .control-name, .facts div, .muted";
for (const each of document.querySelectorAll(all)) {
  if (!seen(each) || each.closest(".keys, .plot, .hidden-text, .rows, .partials, .skip")) continue;
  const b = each.getBoundingClientRect();
  if (b.width === 0) continue;
  if (b.left < -0.5 || b.right > wide + 0.5) out.push(["beyond the screen", each.outerHTML.slice(0, 90)]);
  const hides = getComputedStyle(each).overflowX !== "visible" && each.clientWidth > 0 && !each.matches("input");
  if (hides && each.scrollWidth > each.clientWidth + 1)
    out.push(["cut off", each.outerHTML.slice(0, 90)]);
  for (let at = each.parentElement; at !== null && at !== document.body; at = at.parentElement) {
    if (!["hidden", "clip"].includes(getComputedStyle(at).overflowX)) continue;
    const around = at.getBoundingClientRect();
    if (b.right > around.right + 1 || b.left < around.left - 1) out.push(["clipped", each.outerHTML.slice(0, 90)]);
  }
}
return out;
"""


def test_controls_stand_below_their_headings_with_their_sliders(sized):
    page, *_ = sized
    page.until(lambda: page.script(TORN) == [])


def test_nothing_is_cut_off(sized):
    page, width, _ = sized
    page.until(lambda: page.script(CUT) == [])
    assert page.script("return document.scrollingElement.scrollWidth") <= width


def test_the_dock_leaves_room_and_shows_its_volume(sized):
    page, width, _ = sized
    row = page.script("return document.querySelector('.key-switches')?.offsetHeight ?? 0")
    assert row <= SWITCHES
    page.until(lambda: 80 < page.script("return document.getElementById('dock').offsetHeight") <= DOCK[width] + row)
    dock = "const d = document.getElementById('dock'); return d.scrollHeight <= d.clientHeight + 1"
    assert page.script(dock), "nothing of the dock is out of sight"
    if width < 700:
        page.button("More", ".keyboard-head").click()
        page.until(lambda: page.script(CUT) == [])
    inside = (
        "return [...document.querySelectorAll('.player-volume input, .player-volume output, .meter')].map((each) =>"
        " { const b = each.getBoundingClientRect(); return b.width > 0 && b.left >= 0 && b.right <= innerWidth; })"
    )
    assert page.script(inside) == [True] * 3
    if width < 700:
        page.button("Less", ".keyboard-head").click()


def test_the_peak_is_told_in_decibels(opened):
    opened.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    opened.until(lambda: opened.script("return document.querySelector('.plot-peak').textContent").endswith("dBFS"))
    told = opened.script("return document.querySelector('.plot-peak').textContent")
    assert -60.0 < float(told.removeprefix("peak ").removesuffix(" dBFS").replace("−", "-")) < 0.0
    opened.find("[data-phrase='note']").click()
    opened.until(lambda: opened.text(".meter-peak").endswith("dBFS"))
    opened.find(".player-phrases .quiet").click()
