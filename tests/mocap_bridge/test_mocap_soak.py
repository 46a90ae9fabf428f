"""A slice of a soak in virtual time: a random fault every few seconds, and nothing wrong ever believed."""

import math
import random

import pytest

from tests.mocap_bridge.lockstep import STARTS, Story, circling

FAULTS = {
    "occlusion": ("{body}", 0.6),
    "absent": ("{body}", 0.6),
    "swap": ("{body} {other}", 0.8),
    "jump": ("{body} 0.6", 0.03),
    "turn": ("{body} 1.2", 0.03),
    "frozen": ("{body}", 0.2),
    "not_finite": ("{body}", 0.3),
    "denormal": ("{body} 1.1", 0.3),
    "tilt": ("{body} 1.2", 0.3),
    "marker_error": ("{body} 0.05", 0.3),
    "drop": ("0.5", 0.5),
    "late": ("0.03", 0.5),
    "reorder": ("", 0.5),
    "duplicate": ("", 0.5),
    "burst": ("", 0.2),
    "truncated": ("", 0.3),
    "restart": ("", 0.6),
    "silence": ("", 1.5),
    "millimetres": ("", 0.3),
    "edit_mode": ("", 0.3),
    "clock_drift": ("200", 2.0),
    "id_change": ("{body}", 0.1),
}
GAP_S = 3.0
FROZEN_S = 0.25


def script(seed: int, count: int) -> tuple[str, list[tuple[float, str]]]:
    """A script with one fault every ``GAP_S``, and when each begins."""
    draw = random.Random(seed)
    kinds = [kind for _ in range(1 + count // len(FAULTS)) for kind in draw.sample(list(FAULTS), len(FAULTS))]
    lines, starts = [], []
    for number, kind in enumerate(kinds[:count]):
        body, other = draw.sample(list(STARTS), 2)
        words, seconds = FAULTS[kind]
        start_s = 2.0 + number * GAP_S + draw.uniform(0.0, 0.1)
        lines.append(f"{start_s:.3f} {seconds} {kind} {words.format(body=body, other=other)}")
        starts.append((start_s, kind))
    return "\n".join(lines), starts


@pytest.mark.parametrize("seed", [1, 2])
def test_random_faults_are_survived_and_nothing_wrong_is_believed(seed: int) -> None:
    text, starts = script(seed, len(FAULTS))
    story = Story(text, seed=seed).until(2.0 + GAP_S * len(FAULTS))
    truth = circling()
    wrong = 0
    for frame in story.frames:
        exposure_s = story.script_s(frame)
        now = {pose.name: pose for pose in truth(exposure_s)}
        for body in frame.bodies:
            here = now[body.robot]
            frozen = story.server.settings.script.active("frozen", exposure_s, body.robot)
            allowed_m = 0.3 * FROZEN_S if frozen else 0.002
            if body.valid and math.hypot(body.x_m - here.x_m, body.y_m - here.y_m) > allowed_m:
                wrong += 1
    assert wrong == 0
    order = [(frame.session, frame.frame) for frame in story.frames]
    assert order == sorted(set(order))
    for start_s, kind in starts:
        late = [frame for frame in story.frames if start_s + 2.6 <= story.script_s(frame) < start_s + 2.85]
        assert len(late) > 20, f"no stream after {kind} at {start_s:.1f} s"
        assert all(body.valid for frame in late[-5:] for body in frame.bodies), f"{kind} at {start_s:.1f} s"
    seen = story.health[-1]
    named = {name for body in seen.bodies for name in body.faults} | set(seen.counters)
    assert {
        "occluded", "missing", "swap_suspect", "jump", "rotation_jump", "not_finite", "quaternion_norm", "tilted",
        "marker_error", "old", "duplicate", "malformed", "restart", "silence", "units", "edit_mode", "unknown_id",
    } <= named  # fmt: skip
