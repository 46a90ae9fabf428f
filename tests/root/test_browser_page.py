"""A mission driven from the arena page in headless Chromium, in a mock arena of real processes."""

import contextlib
import json
import os
import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from contract.messages import MotorBatch
from groundstation import rig
from groundstation.link import Link
from groundstation.processes import Child, Family
from tests.groundstation.kept import KEPT

CHROMIUM = "/usr/bin/chromium"
PATIENCE_MS = 40_000
SHOTS = os.environ.get("AHDC_SHOTS", "")
"""A folder to keep the screenshots in."""


class Arena:
    """The mock arena, a station session and the page's server, each a process."""

    def __init__(self, out: Path, robots: int, targets: int) -> None:
        self.arena = rig.mock_arena(rig.find_arena("experiment2"), out, rig.Changes(robots=robots, targets=targets))
        self.rig = rig.Rig(self.arena, out, record=False)
        self.page_log = out / "logs" / "page.log"

    def __enter__(self) -> "Arena":
        self.rig.__enter__()
        try:
            self.rig.start()
            config = ["--arena", str(self.rig.config)]
            self.start("session", ["session", *config])
            self.page = self.start("page", ["page", *config, "--port", "0"])
            self.rig.family.wait_ready(30.0)
        except BaseException:
            self.rig.end()
            raise
        found = re.search(rb"READY page (\S+)", self.page._text)
        assert found
        self.url = found[1].decode()
        return self

    def start(self, name: str, words: list[str]) -> Child:
        return self.rig.family.start(name, "groundstation", words, self.rig.out / "logs" / f"{name}.log")

    def __exit__(self, *exception: object) -> None:
        self.rig.end()


@pytest.fixture(scope="module")
def arena(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Arena]:
    with Arena(tmp_path_factory.mktemp("page"), robots=2, targets=6) as running:
        yield running


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    assert shutil.which(CHROMIUM), "install Debian's chromium"
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


@pytest.fixture
def page(browser: Browser, arena: Arena) -> Iterator[Page]:
    opened = browser.new_page(viewport={"width": 1600, "height": 1000})
    faults: list[str] = []
    opened.on("pageerror", lambda error: faults.append(str(error)))
    opened.on("request", lambda request: _note_foreign(request.url, arena.url, faults))
    opened.set_default_timeout(PATIENCE_MS)
    opened.goto(arena.url)
    yield opened
    opened.close()
    assert not faults


def _note_foreign(url: str, home: str, faults: list[str]) -> None:
    if not url.startswith((home, home.replace("http", "ws"), "data:", "blob:")):
        faults.append(f"fetches {url}")


def wait_run(page: Page, *states: str) -> None:
    whole = re.compile(f"^({'|'.join(states)})$")
    expect(page.locator("body")).to_have_attribute("data-run", whole, timeout=PATIENCE_MS)


def shoot(page: Page, name: str) -> None:
    if SHOTS:
        Path(SHOTS).mkdir(parents=True, exist_ok=True)
        page.screenshot(path=str(Path(SHOTS) / f"{name}.png"))


def on_map(page: Page, arena: Arena, x_m: float, y_m: float) -> tuple[float, float]:
    """Pixels of a place, the long side across (y right, x down)."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    height, width = arena.arena.arena.size_m
    scale = min((box["width"] - 67) / width, (box["height"] - 34) / height)
    left = box["x"] + 41 + (box["width"] - 67 - width * scale) / 2
    top = box["y"] + 26 + (box["height"] - 34 - height * scale) / 2
    return left + y_m * scale, top + x_m * scale


def release(page: Page) -> None:
    wait_run(page, "STOPPED")
    page.fill("#release-word", "RELEASE")
    page.click("#release-button")
    wait_run(page, "DISARMED")


STALLS = 3
"""So often a test goes on after this computer has stood still for longer than a motor controller's watchdog waits."""


def stalled(page: Page) -> bool:
    """Whether robots are stopped because their controllers heard nothing for too long, as they should be then."""
    if page.locator("body").get_attribute("data-run") != "STOPPED":
        return False
    words = page.locator("#run-sub").text_content() or ""
    assert re.search("watchdog expired|loop|heartbeat|pose", words), words
    print(f"this computer stood still: {words}")
    return True


def arm_and_start(page: Page) -> None:
    for _ in range(STALLS):
        _arm_and_start(page)
        if not stalled(page):
            return
        release(page)
    pytest.fail(f"stood still {STALLS} times")


def complete(page: Page) -> None:
    """Watch a running mission to its end; after a stall an operator releases, arms and starts again."""
    for _ in range(STALLS):
        wait_run(page, "COMPLETED", "STOPPED")
        if not stalled(page):
            return
        release(page)
        arm_and_start(page)
    pytest.fail(f"stood still {STALLS} times")


def _arm_and_start(page: Page) -> None:
    wait_run(page, "DISARMED")
    expect(page.locator("[data-action^=Arm]")).to_be_enabled(timeout=PATIENCE_MS)
    page.keyboard.press("a")
    with contextlib.suppress(AssertionError):  # refused where the station was on its way to a new mission
        expect(page.locator("body")).to_have_attribute("data-run", "ARMED", timeout=3000)
    if page.locator("body").get_attribute("data-run") == "DISARMED":
        expect(page.locator("[data-action^=Arm]")).to_be_enabled(timeout=PATIENCE_MS)
        page.keyboard.press("a")
    wait_run(page, "ARMED", "STOPPED")
    page.keyboard.down("Enter")
    wait_run(page, "RUNNING", "STOPPED")
    page.keyboard.up("Enter")


def test_seed_by_hand_with_undo_and_refusal(page: Page, arena: Arena) -> None:
    wait_run(page, "DISARMED")
    count = page.locator("#progress-big")
    expect(count).to_have_text("6", timeout=PATIENCE_MS)
    page.mouse.click(*on_map(page, arena, 2.0, 2.5))
    expect(count).to_have_text("7")
    begin, end = on_map(page, arena, 2.2, 2.2), on_map(page, arena, 2.4, 2.4)
    page.mouse.move(*begin)
    page.mouse.down()
    page.mouse.move(*end, steps=3)
    shoot(page, "a-seed")
    page.mouse.up()
    expect(count).to_have_text("12")
    page.keyboard.press("z")
    expect(count).to_have_text("7")
    page.mouse.click(*on_map(page, arena, 3.95, 2.5))
    page.mouse.click(*on_map(page, arena, 3.8, 0.3))
    expect(page.locator("#checks")).to_contain_text("out of reach")
    expect(count).to_have_text("8")
    shoot(page, "a-out-of-reach")
    page.keyboard.press("z")
    page.keyboard.press("z")
    expect(count).to_have_text("6")


def test_seed_by_keys_alone(page: Page, arena: Arena) -> None:
    wait_run(page, "DISARMED")
    count = page.locator("#progress-big")
    expect(count).to_have_text("6", timeout=PATIENCE_MS)
    page.focus("#map")
    for key in ("g", "ArrowRight", "t", *["ArrowDown"] * 6, "t"):
        page.keyboard.press(key)
    expect(count).to_have_text("11")
    page.keyboard.press("z")
    expect(count).to_have_text("6")
    for key in ("g", "t", "ArrowDown", "Escape", "p", *["ArrowDown"] * 8, "t"):
        page.keyboard.press(key)
    expect(count).to_have_text("7")
    page.keyboard.press("Delete")
    expect(count).to_have_text("6")


def test_stop_in_a_mission_reaches_every_motor_and_only_the_word_releases(page: Page, arena: Arena) -> None:
    arm_and_start(page)
    page.keyboard.press("ArrowDown")
    with Link(arena.arena, "browser-test") as link:
        link.subscribe(link.keys.motor(name) for name in arena.arena.robots)
        _until_moving(link, set(arena.arena.robots))
        shoot(page, "b-running")
        pressed_ns = time.monotonic_ns()
        page.keyboard.press("Space")
        zero_ns = _first_zeros(link, list(arena.arena.robots), pressed_ns)
    wait_run(page, "STOPPED")
    expect(page.locator("#cell-big")).to_have_text("2")
    shoot(page, "d-stopped")
    assert sorted(zero_ns) == sorted(arena.arena.robots)
    print(json.dumps({"stop_to_zero_ms": {k: round((v - pressed_ns) / 1e6, 1) for k, v in zero_ns.items()}}))
    for key in ("a", "Enter", "h", "l"):
        page.keyboard.press(key)
    page.fill("#release-word", "RELEAS")
    expect(page.locator("#release-button")).to_be_disabled()
    page.fill("#release-word", "")
    page.focus("#release-word")
    page.keyboard.press("Space")
    expect(page.locator("#release-word")).to_have_value("")
    release(page)
    expect(page.locator("[data-action=Start]")).to_be_disabled()


def test_the_mission_goes_on_after_a_new_arm_and_start(page: Page) -> None:
    arm_and_start(page)
    page.keyboard.press("h")
    wait_run(page, "HOLDING")
    page.click("[data-action='Go on']")
    wait_run(page, "RUNNING", "COMPLETED", "STOPPED")
    complete(page)
    shoot(page, "b-completed")


def test_home_by_a_long_press_then_the_same_targets_again(page: Page, arena: Arena) -> None:
    wait_run(page, "COMPLETED")
    page.keyboard.press("b")
    page.keyboard.down("b")
    wait_run(page, "HOMING")
    page.keyboard.up("b")
    expect(page.locator("#net-word")).to_have_text("Released")
    shoot(page, "b-homing")
    wait_run(page, "DISARMED")
    expect(page.locator("[data-action=Home]")).to_have_count(0, timeout=PATIENCE_MS)
    expect(page.locator("#progress-of")).to_have_text("of 6")
    page.keyboard.press("n")
    expect(page.locator("#progress-of")).to_have_text("placed", timeout=PATIENCE_MS)
    arm_and_start(page)
    complete(page)


def test_a_dead_server_is_said_and_stop_says_it_is_not_confirmed(page: Page, arena: Arena) -> None:
    wait_run(page, "COMPLETED", "DISARMED")
    arena.page.signal(19)
    page.locator("body.aged").wait_for()
    box = page.locator("#stop").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 20, box["y"] + 20)
    page.mouse.down()
    wait_run(page, "NOT CONFIRMED")
    shoot(page, "d-server-dead")
    arena.page.signal(18)
    wait_run(page, "STOPPED")
    page.mouse.up()
    page.set_viewport_size({"width": 1180, "height": 820})
    shoot(page, "d-tablet")
    release(page)


def _until_moving(link: Link, robots: set[str]) -> None:
    deadline = time.monotonic() + 30.0
    while robots and time.monotonic() < deadline:
        link.wait(0.5)
        robots -= {m.robot for _, m in link.drain() if isinstance(m, MotorBatch) and abs(m.true_speed_mps) > 0.05}
    assert not robots, f"never moved: {robots}"


def _first_zeros(link: Link, robots: list[str], since_ns: int) -> dict[str, int]:
    """When each emulated motor first decoded zero after ``since_ns`` and stayed there."""
    zeros: dict[str, int] = {}
    rest: set[str] = set()
    deadline = time.monotonic() + 10.0
    while len(rest) < len(robots) and time.monotonic() < deadline:
        link.wait(0.2)
        for _, message in link.drain():
            if not isinstance(message, MotorBatch):
                continue
            for sample in message.samples:
                if sample.stamp_ns < since_ns:
                    continue
                if sample.left_radps == 0.0 == sample.right_radps:
                    zeros.setdefault(message.robot, sample.stamp_ns)
                else:
                    zeros.pop(message.robot, None)
            if message.robot in zeros and abs(message.true_speed_mps) < 0.005:
                rest.add(message.robot)
    return zeros


def test_a_recording_is_replayed_with_a_scrubber_and_stop_stays_stop(browser: Browser, tmp_path: Path) -> None:
    with Family() as family:
        child = family.start("page", "groundstation", ["page", "--replay", str(KEPT), "--port", "0"], tmp_path / "log")
        family.wait_ready(30.0)
        found = re.search(rb"READY page (\S+)", child._text)
        assert found
        page = browser.new_page(viewport={"width": 1600, "height": 1000})
        page.set_default_timeout(PATIENCE_MS)
        page.goto(found[1].decode())
        wait_run(page, "REPLAY")
        stop_box = page.locator("#stop").bounding_box()
        page.keyboard.press("5")
        expect(page.locator("#replay-time")).to_contain_text("00:02.")
        shoot(page, "e-replay")
        words = page.locator("#replay-time").text_content()
        page.keyboard.press("ArrowRight")
        expect(page.locator("#replay-time")).not_to_have_text(words or "")
        page.keyboard.press("9")
        page.keyboard.press("n")
        expect(page.locator("#run-sub")).to_contain_text("COMPLETED")
        page.keyboard.press("0")
        page.keyboard.press("+")
        expect(page.locator("#replay-speed")).to_contain_text("2")
        page.keyboard.press("-")
        expect(page.locator("#replay-speed")).to_contain_text("1")
        page.click("#replay-play")
        expect(page.locator("#replay-play")).to_contain_text("Pause")
        assert page.locator("#stop").bounding_box() == stop_box
        page.keyboard.press("Space")
        wait_run(page, "STOPPED")
        expect(page.locator("#net-word")).to_contain_text("NOT CONFIRMED")
        page.close()
