"""STOP pressed on the page, again and again: from pointer-down in Chromium to zero at every emulated motor."""

import json
import os
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, sync_playwright

from groundstation.link import Link
from tests.root.test_browser_page import (
    CHROMIUM,
    PATIENCE_MS,
    Arena,
    _first_zeros,
    _until_moving,
    arm_and_start,
    release,
)

PRESSES = int(os.environ.get("AHDC_PRESSES", "12"))
MOST_MS = 500.0
"""By then the page itself says NOT CONFIRMED."""
NOTE = """() => document.addEventListener("pointerdown",
  (event) => { window.pressed = performance.timeOrigin + event.timeStamp; }, { capture: true })"""


@pytest.fixture
def arena(tmp_path: Path) -> Iterator[Arena]:
    with Arena(tmp_path, robots=2, targets=60) as running:
        yield running


@pytest.fixture
def page(arena: Arena) -> Iterator[Page]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        opened = browser.new_page(viewport={"width": 1600, "height": 1000})
        opened.set_default_timeout(PATIENCE_MS)
        opened.goto(arena.url)
        yield opened
        browser.close()


@pytest.mark.timeout(60 + 30 * PRESSES)
def test_from_pointer_down_to_zero_at_every_motor(page: Page, arena: Arena) -> None:
    names = list(arena.arena.robots)
    page.evaluate(NOTE)
    found: list[float] = []
    with Link(arena.arena, "page-stop") as link:
        link.subscribe(link.keys.motor(name) for name in names)
        for _ in range(PRESSES):
            arm_and_start(page)
            _until_moving(link, set(names))
            box = page.locator("#stop").bounding_box()
            assert box is not None
            page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            began_ns = time.monotonic_ns()
            page.mouse.down()
            zeros = _first_zeros(link, names, began_ns)
            page.mouse.up()
            assert sorted(zeros) == sorted(names), "every motor has decoded zero and stays there"
            pressed_ns = page.evaluate("() => window.pressed") * 1e6 + time.monotonic_ns() - time.time_ns()
            found += [(zero_ns - pressed_ns) / 1e6 for zero_ns in zeros.values()]
            release(page)
    p99 = statistics.quantiles(found, n=100)[98]
    figures = {"presses": PRESSES, "p50": statistics.median(found), "p99": p99, "max": max(found)}
    print(json.dumps({name: round(value, 1) for name, value in figures.items()}))
    assert min(found) > 0.0
    assert statistics.median(found) < MOST_MS
