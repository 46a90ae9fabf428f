"""``report.html``: a run on one self-contained page, nothing fetched, fit to print."""

import base64
from html import escape
from pathlib import Path

from groundstation.activity import ACTIVITIES
from groundstation.measures import Spread
from groundstation.metrics import Metrics
from groundstation.runfolder import Run, sha256
from groundstation.scenes import clock, label

STYLE = """
body{font:15px/1.45 Inter,"DejaVu Sans",sans-serif;color:#13202c;max-width:860px;margin:36px auto;padding:0 24px;
font-variant-numeric:tabular-nums}
h1{font-size:33px;line-height:1.15;margin:0 0 4px} .about{color:#455563;margin:0 0 14px}
.verdict{font-size:19px;margin:0 0 22px} .bad{color:#b4182d}
.five{display:grid;grid-template-columns:repeat(5,1fr);border-top:2px solid #13202c;border-bottom:1px solid #d5dbe1;
margin-bottom:22px} .five div{padding:8px 12px 10px 0} .five b{display:block;font-size:25px}
.five span{color:#455563;font-size:13px} figure{margin:0 0 26px} figure img{width:100%}
figcaption,.note{color:#455563;font-size:13px} table{border-collapse:collapse;width:100%;margin:6px 0 24px}
th,td{text-align:right;padding:5px 6px;border-bottom:1px solid #e3e8ed} th:first-child,td:first-child{text-align:left}
th{color:#455563;font-weight:600;font-size:13px;border-bottom:1px solid #13202c} footer{color:#5c6b78;font-size:12px;
border-top:1px solid #d5dbe1;padding-top:8px} .narrow img{width:56%;display:block;margin:0 auto} h2{font-size:18px;
margin:0} @media print{body{margin:0;max-width:none}figure,table{break-inside:avoid}}
"""


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
            f"The network <b>never split</b>: smallest λ₂ {metrics.min_lambda2:.3f}, "
            f"and no connected graph of {n} robots has less than {floor:.3f}."
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
    if faults:
        sentences.append(f'<b class="bad">{escape("; ".join(faults[:4]))}.</b>')
    elif metrics.detail and not metrics.completed:
        sentences.append(f'<b class="bad">{escape(metrics.detail)}.</b>')
    elif not metrics.stops:
        sentences.append(f"No fault, no STOP, {misses or 'no'} late control steps.")
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
    subtitle = (
        f"{len(arena.robots)} robots, arena {arena.arena.name}, {width:g} m by {height:g} m, profile "
        f"{metrics.profile}, seed {metrics.seed}. {about.get('started', '')[:16].replace('T', ' ')}. "
        f"{about.get('place') or ('Mock arena' if emulated else 'Real wheels')}."
    )
    ratio = "-" if metrics.ratio_to_lower_bound is None else f"{metrics.ratio_to_lower_bound:.2f}"
    five = [
        (clock(metrics.mission_s, 1), "mission time"),
        (ratio, "times the lower bound"),
        (f"{metrics.min_lambda2:.2f}", "smallest λ₂"),
        (str(metrics.links_removed), "links removed"),
        (_ms(metrics.pose_to_wheel_ms.p99), "pose to wheel, p99"),
    ]
    body = [
        f"<h1>{escape(title(metrics))}</h1>",
        f'<p class="about">{escape(subtitle)}</p>',
        f'<p class="verdict">{" ".join(verdict(metrics))}</p>',
        '<div class="five">' + "".join(f"<div><b>{v}</b><span>{t}</span></div>" for v, t in five) + "</div>",
        _image(figures, "topology", "Six moments of the run, to scale."),
        _image(
            figures, "lambda2", "λ₂ of the graph of all robots within r_c, over control steps; letters are those above."
        ),
        _image(
            figures, "trajectories", "Where every robot went; squares are starts, numbers at the end are ids.", "narrow"
        ),
        "<h2>Timing</h2>",
        _table(("milliseconds", "p50", "p99", "max"), _timing(metrics)),
        "<h2>Control loops</h2>",
        _table(("robot", "nominal Hz", "Hz", "jitter p99, ms", "late or left out", "steps"), _loops(metrics)),
        "<h2>Robots</h2>",
        _table(("robot", "targets", "path, m", "nearest, m", "frames unseen", "faults"), _robots(metrics)),
        "<h2>Where the time went</h2>",
        _table(*_time(metrics)),
        _words(metrics),
        _handling(run),
        _faults(run),
        f'<p class="note">Frames not received: {metrics.frames_dropped} of {metrics.frames + metrics.frames_dropped}. '
        f"Messages that were not what their key carries: {metrics.undecodable}. "
        f"Lower bound {metrics.lower_bound_s:.2f} s.</p>",
        f"<footer>{escape(run.recording.path.name)}, {run.recording.path.stat().st_size / 1e6:.1f} MB, sha256 "
        f"{sha256(run.recording.path)[:16]}…, {'whole' if run.recording.whole else 'cut off'}. Software "
        f"{escape(revision)}{dirty}. {escape(about.get('run_id', ''))}</footer>",
    ]
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title(metrics))}</title>'
    return f"{head}<style>{STYLE}</style><body>{''.join(body)}</body></html>\n".encode()


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f} ms"


def _image(figures: Path, name: str, caption: str, kind: str = "") -> str:
    content = base64.b64encode((figures / f"{name}.png").read_bytes()).decode()
    return (
        f'<figure class="{kind}"><img alt="{escape(caption)}" src="data:image/png;base64,{content}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _table(head: tuple[str, ...], rows: list[tuple[object, ...]]) -> str:
    def cell(value: object) -> str:
        return "-" if value is None else f"{value:.2f}" if isinstance(value, float) else escape(str(value))

    cells = "".join("<tr>" + "".join(f"<td>{cell(v)}</td>" for v in row) + "</tr>" for row in rows)
    return f"<table><tr>{''.join(f'<th>{escape(h)}</th>' for h in head)}</tr>{cells}</table>"


def _timing(metrics: Metrics) -> list[tuple[object, ...]]:
    ends = {"motor": "the emulated motor", "write": "the bus write", "mixed": "motor or bus write"}

    def row(name: str, spread: Spread) -> tuple[object, ...]:
        return (name, spread.p50, spread.p99, spread.max)

    return [
        row("Exposure to control step", metrics.pose_age_ms),
        row(f"Pose datagram sent to {ends[metrics.pose_to_wheel_until]}", metrics.pose_to_wheel_ms),
        row("STOP to the report that obeys it", metrics.stop_ms),
    ]


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


def _time(metrics: Metrics) -> tuple[tuple[str, ...], list[tuple[object, ...]]]:
    kinds = _kinds(metrics)
    rows: list[tuple[object, ...]] = [
        (label(name), *(robot.seconds.get(kind, 0.0) for kind in kinds)) for name, robot in metrics.robots.items()
    ]
    totals = [sum(robot.seconds.get(kind, 0.0) for robot in metrics.robots.values()) for kind in kinds]
    whole = sum(totals) or 1.0
    return (("seconds", *kinds), [*rows, ("share, %", *(100 * total / whole for total in totals))])


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
    return "<h2>Faults and their handling</h2>" + _table(head, sorted(rows, key=lambda row: float(str(row[0])[:-2])))


def _faults(run: Run) -> str:
    mission = run.history.mission()
    if mission is None or not run.history.logs:
        return ""
    rows: list[tuple[object, ...]] = [
        (f"{(entry.stamp_ns - mission.start_ns) / 1e9:+.2f} s", entry.level, entry.source, entry.text or entry.event)
        for entry in run.history.logs[:60]
    ]
    return "<h2>Warnings and errors</h2>" + _table(("since start", "level", "source", "what"), rows)
