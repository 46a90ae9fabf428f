"""Several runs on one page to hand on: the groups with their intervals, then every run. Pure."""

from collections.abc import Sequence
from html import escape

from groundstation.compare import MEASURES, Group, groups
from groundstation.metrics import Metrics, failures
from groundstation.paper import document, table
from groundstation.scenes import clock

NAMES = {
    "mission_s": "mission, s",
    "ratio_to_lower_bound": "times the lower bound",
    "min_lambda2": "smallest λ₂",
    "min_distance_m": "nearest, m",
    "links_removed": "links removed",
}
assert tuple(NAMES) == MEASURES


def verdict(found: Sequence[Group]) -> str:
    """What the groups tell, in two sentences of HTML."""
    runs, done = sum(group.runs for group in found), sum(group.completed for group in found)
    failed = sum(group.failed for group in found)
    words = f"<b>{done} of {runs} runs</b> occupied every target. "
    good = "None split, collided or stayed incomplete."
    return words + (good if not failed else f'<b class="bad">{failed} split, collided or stayed incomplete</b>.')


def page(runs: Sequence[tuple[str, Metrics]]) -> bytes:
    """The page of runs, each with its name."""
    found = groups(metrics for _, metrics in runs)
    head = ("profile", "robots", "targets", "runs", "completed", *NAMES.values())
    rows = [
        (g.profile, g.robots, g.targets, g.runs, g.completed, *(str(g.means[name]) for name in MEASURES)) for g in found
    ]
    each = [
        (
            name, m.profile, len(m.robots), m.targets, m.seed, clock(m.mission_s, 1), m.ratio_to_lower_bound,
            m.min_lambda2, m.min_distance_m, "; ".join(failures(m)) or "good",
        )
        for name, m in runs
    ]  # fmt: skip
    columns = (
        "run",
        "profile",
        "robots",
        "targets",
        "seed",
        "mission",
        "ratio",
        "smallest λ₂",
        "nearest, m",
        "verdict",
    )
    title = f"{len(runs)} runs compared"
    return document(
        title,
        [
            f"<h1>{escape(title)}</h1>",
            '<p class="about">Grouped by profile, robots and targets.</p>',
            f'<p class="verdict">{verdict(found)}</p>',
            "<h2>Groups</h2>",
            table(head, rows),
            '<p class="note">Means with the half-width of their 95 % interval (Student\'s t); times and ratios of '
            "completed runs, the rest of all. A single run has no interval.</p>",
            "<h2>Runs</h2>",
            table(columns, each, words=(1, 9)),
        ],
    )
