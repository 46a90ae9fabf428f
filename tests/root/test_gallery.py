"""Every state of the arena page as a picture, light and dark, desk and tablet; what must hold in all of them.

``AHDC_SHOTS=shots ./kit test -m root tests/root/test_gallery.py`` keeps the pictures.
"""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from tests.root.staged import SCENES, Served, Still

CHROMIUM = "/usr/bin/chromium"
SHOTS = os.environ.get("AHDC_SHOTS", "")
SIZES = {"desk": (1600, 1000), "tablet": (1180, 820)}
STOP_HIGH = {"desk": 116, "tablet": 112}
LEAST_TOUCH_PX = 48
PATIENCE_MS = 100_000
WORDS = {
    "a": "DISARMED", "a-armed": "ARMED", "b-running": "RUNNING", "b-holding": "HOLDING", "b-completed": "COMPLETED",
    "b-homing": "HOMING", "c": "RUNNING", "c-station-gone": "NO STATION", "c-router-gone": "NO STATION",
    "d": "STOPPED", "d-stopping": "STOPPING", "m": "RUNNING", "m-waiting": "DISARMED",
    "m-not-confirmed": "STOPPED",
}  # fmt: skip

SEEN = """([whole, touch]) => {
  const parse = (text) => text.match(/[\\d.]+/g).map(Number);
  const part = (v) => (v / 255 <= 0.03928 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
  const light = ([r, g, b]) => 0.2126 * part(r) + 0.7152 * part(g) + 0.0722 * part(b);
  const ground = (node) => {
    for (; node; node = node.parentElement) {
      const c = parse(getComputedStyle(node).backgroundColor);
      if (c.length < 4 || c[3] > 0.99) return c;
    }
    return [255, 255, 255];
  };
  const found = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const node = walk.currentNode.parentElement, words = walk.currentNode.textContent.trim();
    if (!words || !node.checkVisibility() || node.closest("svg") || node.closest("button:disabled")) continue;
    const style = getComputedStyle(node), size = parseFloat(style.fontSize);
    const a = light(parse(style.color)), b = light(ground(node));
    const large = size >= 24 || (size >= 18.6 && Number(style.fontWeight) >= 700);
    found.push([(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), large, words.slice(0, 40)]);
  }
  const shown = (query) => [...document.querySelectorAll(query)].filter((n) => n.checkVisibility());
  const box = (n) => n.getBoundingClientRect(), name = (n) => `${n.id || n.className || n.tagName}: ${n.textContent}`;
  const cut = (n) => n.scrollWidth > n.clientWidth + 1 && getComputedStyle(n).display !== "inline";
  const out = (b) => b.right > innerWidth + 1 || b.bottom > innerHeight + 1 || b.left < -1 || b.top < -1;
  const stop = box(document.getElementById("stop"));
  return {
    contrasts: found, stop: [stop.x, stop.y, stop.width, stop.height],
    "hard to touch": shown("button").filter((n) => box(n).height < touch - 0.5).map(name),
    outside: shown("#bar, #map-panel, #rows, #actions button, #stop").filter((n) => out(box(n))).map(name),
    "cut off": shown(whole).filter(cut).map(name),
    "hidden": shown("#seed .tools button, #checks li:first-child, #release-button, #chart-panel")
      .filter((n) => box(n).bottom > box(document.getElementById("middle")).bottom + 1).map(name),
  };
}"""
WHOLE = """#run b, #run small, #cell b, #cell span, #cell p, #net p, #progress p, #time p, .row .title, .row .does,
  .row .id,  .row .value, #actions button, #stop b, #stop small, .tools button, #checks li, #release-form button"""


class Tab(NamedTuple):
    size: str
    page: Page
    faults: list[str]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    assert shutil.which(CHROMIUM), "install Debian's chromium"
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with Served(Still(SCENES["a-disarmed"]())) as running:
        yield running


@pytest.fixture(scope="module", params=SIZES)
def tab(request: pytest.FixtureRequest, browser: Browser, served: Served) -> Iterator[Tab]:
    width, height = SIZES[request.param]
    context = browser.new_context(
        viewport={"width": width, "height": height}, reduced_motion="reduce", color_scheme="light"
    )
    opened = Tab(request.param, context.new_page(), [])
    opened.page.on("pageerror", lambda error: opened.faults.append(str(error)))
    opened.page.set_default_timeout(PATIENCE_MS)
    opened.page.goto(served.url)
    opened.page.wait_for_function("document.fonts.ready.then(() => true)")
    yield opened
    context.close()


@pytest.mark.parametrize("scene", SCENES)
def test_scene(tab: Tab, served: Served, scene: str) -> None:
    assert isinstance(served.page, Still)
    page, said = tab.page, WORDS.get(scene) or WORDS[scene[0]]
    number = served.page.show(SCENES[scene]())
    page.wait_for_function("number => document.body.dataset.scene === String(number)", arg=number)
    page.wait_for_function("word => document.getElementById('run-word').textContent === word", arg=said)
    if scene == "d-not-confirmed":
        page.keyboard.type("release-n")
        assert page.input_value("#release-word").upper() == "RELEASE-N"
    for theme in ("light", "dark"):
        if theme == "dark":
            page.evaluate("document.activeElement.blur()")
            page.keyboard.press("d")
        page.evaluate("() => new Promise((done) => setTimeout(done, 150))")
        _keep(page, f"{scene}-{tab.size}-{theme}")
        tab.faults.extend(f"{theme}: {words}" for words in look(page, tab.size))
    page.keyboard.press("d")
    faults, tab.faults[:] = list(tab.faults), []
    assert not faults, "\n".join(faults)


def look(page: Page, size: str) -> list[str]:
    """What does not hold on a picture and should on every one."""
    width, height = SIZES[size]
    pad, column = (14, 522) if size == "desk" else (10, 392)
    seen: dict[str, Any] = page.evaluate(SEEN, [WHOLE, LEAST_TOUCH_PX])
    same = [width - pad - column, height - pad - STOP_HIGH[size], column, STOP_HIGH[size]]
    found = [] if seen["stop"] == same else [f"STOP is elsewhere: {seen['stop']}"]
    found += [f"{what}: {name}" for what in ("hard to touch", "outside", "cut off", "hidden") for name in seen[what]]
    poor = [entry for entry in seen["contrasts"] if entry[0] < (3.0 if entry[1] else 4.5)]
    return found + [f"contrast {ratio:.2f}: {words}" for ratio, _, words in poor]


def _keep(page: Page, name: str) -> None:
    if SHOTS:
        Path(SHOTS).mkdir(parents=True, exist_ok=True)
        page.screenshot(path=str(Path(SHOTS) / f"{name}.png"))
