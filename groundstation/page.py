"""``report.html``: a run on one self-contained page, nothing fetched, fit to print."""

import re
from datetime import datetime
from html import escape
from pathlib import Path

from contract.exposure import exposure
from groundstation.activity import ACTIVITIES
from groundstation.connectivity import tree_floor
from groundstation.measures import Spread
from groundstation.metrics import Metrics
from groundstation.paper import document, image, shares, table
from groundstation.runfolder import Run, sha256
from groundstation.scenes import clock, label

CONFIRM_MS = 500.0
"""A STOP that is not answered by then is shown as NOT CONFIRMED."""
MOST_LINES = 40
MANY = 8
"""More robots than this have tables as wide as the page."""


def title(metrics: Metrics) -> str:
    """The result in one line."""
    if metrics.completed:
        return f"All {metrics.targets} targets in {clock(metrics.mission_s, 1)}"
    ending = metrics.ending or "recording cut off"
    return f"{metrics.occupied} of {metrics.targets} targets, {ending} after {clock(metrics.mission_s, 1)}"


def verdict(metrics: Metrics) -> list[str]:
    """Two or three sentences of HTML: the network, the distances, then faults if there were any."""
    floor, n = metrics.lambda2_floor, len(metrics.robots)
    if metrics.disconnected_frames:
        share = f"{metrics.disconnected_frames} of {metrics.frames} frames"
        network = f'<b class="bad">The network split</b> in {share}.'
    else:
        network = (
            f"The network <b>never split</b>. Smallest λ₂ was {metrics.min_lambda2:.2f}, and no connected graph of "
            f"{n} robots has less than {floor:.2f}."
        )
    if metrics.collisions:
        near = f'<b class="bad">{metrics.collisions} collisions</b>, least distance {metrics.min_distance_m:.3f} m.'
    elif metrics.min_distance_m is None:
        near = "Distances between robots are unknown."
    else:
        near = f"<b>No robot came closer than {metrics.min_distance_m:.2f} m</b> to another."
    sentences = [network, near]
    faults = [f"{label(name)}: {fault}" for name, robot in metrics.robots.items() for fault in robot.faults]
    misses = sum(loop.deadline_misses for loop in metrics.loop.values())
    due = misses + sum(loop.steps for loop in metrics.loop.values())
    late = f"{misses:,} of {due:,} control steps late or left out" if misses else "no late control step"
    if faults:
        sentences.append(f'<b class="bad">{escape("; ".join(faults[:4]))}.</b>')
    elif metrics.detail and not metrics.completed:
        sentences.append(f'<b class="bad">{escape(metrics.detail)}.</b>')
    elif not metrics.stops:
        sentences.append(f"No fault, no STOP, {late}.")
    return sentences


def page(run: Run, metrics: Metrics, figures: Path) -> bytes:
    """The page of a judged run, with the figures of that folder."""
    about = run.recording.metadata.get("run", {})
    software = run.recording.metadata.get("software", {})
    revision = software.get("git_revision", "")[:12] or software.get("ahdc-fieldkit", "unknown")
    dirty = " with changes" if software.get("git_dirty") == "true" else ""
    arena = run.history.arena
    emulated = all("wheels" in robot.emulate for robot in arena.robots.values())
    width, height = arena.arena.size_m
    exposed = exposure((arena.link.router, *arena.link.listen), arena.link.keys)
    place = about.get("place") or ("Mock arena" if emulated else "Real wheels")
    subtitle = (
        f"{len(arena.robots)} robots, arena {arena.arena.name}, {width:g} m by {height:g} m, profile "
        f"{metrics.profile}, seed {metrics.seed}. {_date(about.get('started', ''))}. {place}."
    )
    ratio = "-" if metrics.ratio_to_lower_bound is None else f"{metrics.ratio_to_lower_bound:.2f}"
    five = [
        (clock(metrics.mission_s, 1), "mission time"),
        (ratio, "times the lower bound"),
        (f"{metrics.min_lambda2:.2f}", "smallest λ₂"),
        (str(metrics.links_removed), "links removed"),
        (_ms(metrics.pose_to_wheel_ms.p99), "pose to wheel, p99"),
    ]
    n = len(arena.robots)
    lies = "y to the right and x down" if height > width else "x to the right and y up"
    timing = "<h2>Timing</h2>" + table(("milliseconds", "p50", "p99", "max", "limit"), _timing(run, metrics))
    robots = "<h2>Robots</h2>" + table(("id", "targets", "path, m", "nearest, m", "unseen", "faults"), _robots(metrics))
    body = [
        f"<h1>{escape(title(metrics))}</h1>",
        f'<p class="about">{escape(subtitle)}</p>',
        f'<p class="verdict">{" ".join(verdict(metrics))}</p>',
        *([f'<p class="verdict"><b class="bad">{escape(exposed)}</b></p>'] if exposed else []),
        '<div class="five">' + "".join(f"<div><b>{v}</b><span>{t}</span></div>" for v, t in five) + "</div>",
        image(figures / "topology.png", 1, f"Six moments of the run, to scale, {lies}. Numbers are ids of robots and, "
              "small, of targets."),
        image(figures / "lambda2.png", 2, "λ₂ of the graph of all robots within sensing range, log scale, over control "
              "steps; letters are the moments of figure 1, dots targets done. No connected graph of "
              f"{n} robots lies in the hatched band below {tree_floor(n):.2f}."),
        f'<div class="pair"><div>{timing}</div><div>{robots}</div></div>' if n <= MANY else timing + robots,
        "<h2>Control loops</h2>",
        table(("robot", "nominal Hz", "Hz", "jitter p99, ms", "late or left out", "steps"), _loops(metrics)),
        "<h2>Where the time went</h2>",
        *_time(metrics),
        image(figures / "trajectories.png", 3, "Where every robot went: squares are starts, discs with ids the ends, "
              "rings targets.", "narrow"),
        _handling(run),
        _faults(run),
        f'<p class="note">Frames not received: {metrics.frames_dropped} of {metrics.frames + metrics.frames_dropped}. '
        f"Messages that were not what their key carries: {metrics.undecodable}. "
        f"Lower bound of the mission time {metrics.lower_bound_s:.2f} s. Every number: metrics.csv; what each means: "
        "groundstation/metrics.py.</p>",
        f"<footer><span>{escape(run.recording.path.name)}, {run.recording.path.stat().st_size / 1e6:.1f} MB, sha256 "
        f"{sha256(run.recording.path)[:16]}…, {'whole' if run.recording.whole else 'cut off'}. "
        f"{escape(about.get('run_id', ''))}</span><span>Software {escape(revision)}{dirty}. "
        "ahdc-groundstation report</span></footer>",
    ]  # fmt: skip
    return document(title(metrics), body)


def _date(started: str) -> str:
    """22 November 2026, 02:20 UTC; as it stands where it is no date."""
    try:
        when = datetime.fromisoformat(started)
    except ValueError:
        return started[:16]
    return f"{when.day} {when:%B %Y, %H:%M} UTC"


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f} ms"


def _timing(run: Run, metrics: Metrics) -> list[tuple[object, ...]]:
    ends = {"motor": "the emulated motor", "write": "the bus write", "mixed": "motor or bus write"}
    safety = run.history.arena.safety

    def row(name: str, spread: Spread, limit_ms: float | None) -> tuple[object, ...]:
        return (name, spread.p50, spread.p99, spread.max, None if limit_ms is None else f"{limit_ms:g}")

    rows = [
        row("Pose age at the control step", metrics.pose_age_ms, safety.max_pose_age_s * 1e3),
        row(f"Pose datagram to {ends[metrics.pose_to_wheel_until]}", metrics.pose_to_wheel_ms, None),
    ]
    if metrics.stops:
        rows.append(row("STOP to the report that obeys it", metrics.stop_ms, CONFIRM_MS))
    return rows


def _loops(metrics: Metrics) -> list[tuple[object, ...]]:
    return [
        (label(name), loop.nominal_hz, loop.rate_hz, loop.p99_jitter_ms, loop.deadline_misses, loop.steps)
        for name, loop in metrics.loop.items()
    ]


def _robots(metrics: Metrics) -> list[tuple[object, ...]]:
    return [
        (label(name), r.targets, r.path_m, r.nearest_m, r.invalid_frames, len(r.faults))
        for name, r in metrics.robots.items()
    ]


def _time(metrics: Metrics) -> list[str]:
    """Of all robots as one bar, of each as a row."""
    kinds = _kinds(metrics)
    rows: list[tuple[object, ...]] = [
        (label(name), *(f"{robot.seconds.get(kind, 0.0):.1f}" for kind in kinds))
        for name, robot in metrics.robots.items()
    ]
    totals = [sum(robot.seconds.get(kind, 0.0) for robot in metrics.robots.values()) for kind in kinds]
    rows.append(("all", *(f"{total:.1f}" for total in totals)))
    parts = shares(list(zip(kinds, totals, strict=True)))
    return [parts, table(("seconds", *kinds), rows, total=True), _words(metrics)]


def _kinds(metrics: Metrics) -> list[str]:
    seen = {kind for robot in metrics.robots.values() for kind in robot.seconds}
    return [*(kind for kind in ACTIVITIES if kind in seen), *sorted(seen - set(ACTIVITIES))]


def _words(metrics: Metrics) -> str:
    """What the words of the table above mean."""
    words = [f"{kind}: {ACTIVITIES[kind]}" for kind in _kinds(metrics) if kind in ACTIVITIES]
    return f'<p class="note">{escape("; ".join(words))}.</p>' if words else ""


def _handling(run: Run) -> str:
    """Every time a robot left the mission's run state for a reason: when, why, what was to be done, for how long."""
    mission = run.history.mission()
    if mission is None:
        return ""
    rows: list[tuple[object, ...]] = []
    for name, track in run.history.tracks.items():
        reports = [report for report in track.reports if report.stamp_ns >= mission.start_ns]
        for k, report in enumerate(reports):
            before = reports[k - 1] if k else None
            same = before is not None and (before.run, before.reason) == (report.run, report.reason)
            if not report.reason or same or report.run in ("running", "disarmed"):
                continue
            after = next((r for r in reports[k + 1 :] if (r.run, r.reason) != (report.run, report.reason)), None)
            lasted = "to the end" if after is None else f"{(after.stamp_ns - report.stamp_ns) / 1e9:.2f} s"
            when = f"{(report.stamp_ns - mission.start_ns) / 1e9:+.2f} s"
            rows.append((when, label(name), report.run, report.reason, report.remedy or "-", lasted))
    if not rows:
        return ""
    head = ("since start", "robot", "became", "why", "remedy", "for")
    ordered = sorted(rows, key=lambda row: float(str(row[0])[:-2]))
    return "<h2>Faults and their handling</h2>" + table(head, ordered, words=(1, 2, 3, 4))


def _faults(run: Run) -> str:
    """Warnings and errors; those that differ in their numbers only are one line with its count."""
    mission = run.history.mission()
    if mission is None or not run.history.logs:
        return ""
    alike: dict[tuple[str, str, str], list[tuple[float, str]]] = {}
    for entry in run.history.logs:
        words = entry.text or entry.event
        key = (entry.level, entry.source, re.sub(r"\d+([.,]\d+)?", "#", words))
        alike.setdefault(key, []).append(((entry.stamp_ns - mission.start_ns) / 1e9, words))
    rows: list[tuple[object, ...]] = []
    for (level, source, _), said in list(alike.items())[:MOST_LINES]:
        first_s, words = said[0]
        until = f" to {said[-1][0]:+.1f} s" if len(said) > 1 else ""
        rows.append((f"{first_s:+.1f} s{until}", len(said), level, source, words))
    left = len(alike) - len(rows)
    more = f'<p class="note">{left} more kinds are in the recording.</p>' if left else ""
    head = ("since start", "times", "level", "source", "what (the first)")
    return "<h2>Warnings and errors</h2>" + table(head, rows, words=(2, 3, 4)) + more
