"""The glance bar: may robots move, which is not well, the network, progress, time; and what may be pressed. Pure."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from groundstation.page_links import Network
from groundstation.page_missing import Missing
from groundstation.page_reasons import seconds
from groundstation.page_stop import CONFIRM_NS
from groundstation.scenes import clock, label

if TYPE_CHECKING:
    from groundstation.page_state import PageState

Row = dict[str, Any]


def bar(
    state: "PageState", rows: Sequence[Row], graph: Network, gone: Sequence[Missing], now_ns: int
) -> dict[str, Any]:
    """``run``, ``cell``, ``net``, ``progress``, ``time``, ``stop``, ``can`` and ``checks`` of the view."""
    stop = _stop(state, rows, now_ns)
    run = _run(state, rows, stop, now_ns)
    missing = _checks(state, graph, now_ns)
    return {
        "run": run,
        "cell": _robots(rows, stop, gone),
        "net": _released() if run["state"] == "HOMING" else _network(graph, state.frame_age_s(now_ns)),
        "progress": _progress(state, stop),
        "time": _time(state),
        "stop": stop,
        "checks": missing,
        "can": _can(state, run["state"], missing),
    }


def _stop(state: "PageState", rows: Sequence[Row], now_ns: int) -> dict[str, Any] | None:
    """The latched STOP; also one that a robot or another station began."""
    pressed = state.latch.pressed
    stopped = [row["id"] for row in rows if row.get("run") == "stopped"]
    if pressed is None and not stopped:
        return None
    silent = state.silent(now_ns)
    source = pressed.source if pressed and pressed.stop_id else _first_reason(state, stopped)
    since_s = (now_ns - pressed.since_ns) / 1e9 if pressed else 0.0
    known = pressed is None or now_ns - pressed.since_ns >= CONFIRM_NS or not silent
    answers = state.latch.acknowledged_ns.values()
    return {
        "id": pressed.stop_id if pressed else 0,
        "source": source,
        "since_s": round(since_s, 2),
        "answered": len(rows) - len(silent),
        "of": len(rows),
        "slowest_ms": round(max(answers) / 1e6) if answers else None,
        "silent": silent if known else [],
        "waiting": silent,
        "known": known,
        "word": state.latch.word(silent),
        "releasing": state.latch.releasing,
        "failed": _left_over(state, silent, known),
    }


def _first_reason(state: "PageState", stopped: Sequence[str]) -> str:
    status, reports = state.status, state.reports()
    if status is not None and status.phase in ("stopped", "failed") and status.detail:
        return status.detail
    return next((f"{label(n)}: {reports[n].reason}" for n in stopped if reports[n].reason), "the station")


def _left_over(state: "PageState", silent: Sequence[str], known: bool) -> list[dict[str, Any]]:
    """What motion capture sees of the robots that have not confirmed."""
    seen = []
    for name in silent if known else ():
        speed = state.speed_mps(name)
        seen.append({"id": name, "label": label(name), "mps": None if speed is None else round(speed, 2)})
    return seen


def _run(state: "PageState", rows: Sequence[Row], stop: dict[str, Any] | None, now_ns: int) -> dict[str, str]:
    """The state in one word, its icon, its tone and one line below it."""

    def said(word: str, icon: str, tone: str, sub: str) -> dict[str, str]:
        return {"state": word, "icon": icon, "tone": tone, "sub": sub}

    status = state.status
    if stop is not None:
        if not stop["known"]:
            return said("STOPPING", "stop", "red", f"{stop['answered']} of {stop['of']} confirmed")
        if stop["releasing"]:
            return said("STOPPED", "stop", "red", "releasing")
        return said("STOPPED", "stop", "red", f"Latched by {stop['source']}")
    if status is None or not state.station_alive(now_ns):
        return said("NO STATION", "caution", "amber", "Run ahdc-groundstation session")
    may, idle = _movers(rows)
    order = state.heartbeat.order if state.heartbeat is not None else ""
    if status.phase == "homing":
        return said("HOMING", "play", "blue", status.detail)
    if status.phase == "running" and order == "hold":
        return said("HOLDING", "hold", "blue", "Robots hold their places")
    if status.phase == "running":
        out = [row["id"] for row in rows if row.get("out")]
        idle = [name for name in idle if name not in out]
        words = [
            f"{', '.join(map(label, names))} {verb}" for names, verb in ((idle, "waits"), (out, "dropped")) if names
        ]
        if words:
            return said("RUNNING", "play", "blue", ", ".join([f"{len(may)} may move", *words]))
        return said("RUNNING", "play", "blue", "Robots may move")
    if status.phase == "armed":
        return said("ARMED", "armed", "blue", "Wheels hold. Start moves robots")
    if status.phase == "completed":
        return said("COMPLETED", "done", "blue", "Wheels locked" if status.detail.startswith("all ") else status.detail)
    if status.phase in ("failed", "stopped"):
        return said("FAILED", "caution", "amber", status.detail)
    if order == "arm":
        return said("ARMING", "armed", "blue", "waiting for every robot")
    return said("DISARMED", "barred", "", "Wheels locked. Seed, then arm")


def _movers(rows: Sequence[Row]) -> tuple[list[str], list[str]]:
    may = [row["id"] for row in rows if row.get("run") == "running" and row.get("report_s", 9) <= 1.0]
    return may, [row["id"] for row in rows if row["id"] not in may]


def _robots(rows: Sequence[Row], stop: dict[str, Any] | None, gone: Sequence[Missing]) -> dict[str, Any]:
    total = len(rows)
    if stop is not None:
        slowest = stop["slowest_ms"]
        return {
            "label": "Confirmed stopped",
            "big": str(stop["answered"]),
            "of": f"of {total}",
            "sub": f"slowest {slowest} ms" if slowest is not None else "",
            "tone": "red",
        }
    faults = [row for row in rows if row.get("trouble", {}).get("level") == "fault"]
    cautions = [row for row in rows if row.get("trouble", {}).get("level") == "caution"]
    if gone and (not faults or gone[0].level == "fault"):
        part = gone[0]
        tone = "red" if part.level == "fault" else "amber"
        name, _, state_word = part.title.rpartition(" ")
        return {"label": f"for {part.value}", "big": name, "of": state_word, "sub": part.short, "tone": tone}
    if faults or cautions:
        tone, these = ("red", faults) if faults else ("amber", cautions)
        first = these[0]
        word = "at fault" if faults else "to look at"
        return {
            "label": f"{len(these)} of {total} {word}",
            "big": label(first["id"]),
            "of": first["trouble"]["title"],
            "sub": "its wheels are stopped" if faults and first.get("stopped") else first["trouble"]["why"],
            "tone": tone,
        }
    oldest = max((row["pose_ms"] for row in rows if row.get("pose_ms") is not None), default=None)
    running = any(row.get("run") == "running" for row in rows)
    sub = "" if oldest is None else f"oldest pose {oldest} ms" if running else "all poses fresh"
    return {
        "label": "Robots",
        "big": str(total),
        "of": f"of {total} {'ok' if running else 'ready'}",
        "sub": sub,
        "tone": "",
    }


def _network(graph: Network, age_s: float) -> dict[str, Any]:
    tone = {"Connected": "", "At risk": "amber", "SPLIT": "red", "Unknown": "amber"}[graph.word]
    detail = graph.detail
    if graph.word == "Unknown" and age_s > 1.0:
        detail = f"no poses for {seconds(age_s)}"
    value = None if graph.word == "Unknown" else round(graph.lambda2, 2)
    return {"word": graph.word, "l2": value, "sub": detail, "tone": tone}


def _released() -> dict[str, Any]:
    return {"word": "Released", "l2": None, "sub": "no links on the way home", "tone": ""}


def _progress(state: "PageState", stop: dict[str, Any] | None) -> dict[str, Any]:
    total = len(state.cloud.targets) if state.cloud else 0
    done = len(state.status.occupied) if state.status else 0
    begun = done > 0 or (state.status is not None and state.status.elapsed_s > 0)
    sub = "mission on hold" if stop is not None and begun else ""
    if not begun:
        return {"label": "Targets", "big": str(total), "of": "placed", "done": 0, "total": 0, "sub": _stray(state)}
    return {"label": "Targets done", "big": str(done), "of": f"of {total}", "done": done, "total": total, "sub": sub}


def _stray(state: "PageState") -> str:
    count = len(state.board.strays)
    return f"{count} need{'s' if count == 1 else ''} attention" if count else "all in reach"


def _time(state: "PageState") -> dict[str, str]:
    mission = state.cloud.mission if state.cloud else state.arena.arena.name
    elapsed = state.status.elapsed_s if state.status else 0.0
    minutes = clock(elapsed)
    return {
        "label": "Elapsed",
        "big": minutes if len(minutes) > 4 else f"0{minutes}",
        "sub": f"{mission}, {state.arena.control.profile}",
    }


def _checks(state: "PageState", graph: Network, now_ns: int) -> list[tuple[str, str]]:
    """(level, words) of what must hold before Arm and Start."""
    if not state.station_alive(now_ns):
        return [("fault", "No station: run ahdc-groundstation session")]
    status = state.status
    assert status is not None
    checks = []
    if status.phase == "waiting" and status.detail and not status.detail.startswith("disarmed"):
        checks += [("caution", part) for part in status.detail.split("; ")[:4]]
    elif status.phase != "waiting":
        checks.append(("ok", f"One arena file on all {len(state.arena.robots)} robots"))
    if graph.word == "Connected":
        checks.append(("ok", f"Swarm connected at start, λ2 {graph.lambda2:.2f}"))
    reach = state.arena.control.sensing_radius_m
    for target, gap in state.board.strays[:2]:
        checks.append(("stray", f"T{target + 1:02d} out of reach: {gap:.2f} m of {reach:.2f} m. Move it or Delete"))
    if state.cloud is not None and 0 < len(state.cloud.targets) == len(status.occupied):
        checks.append(("caution", "All targets are done. Repeat them (N) or place others"))
    if state.cloud is None or not state.cloud.targets:
        checks.append(("caution", "No targets. Click to place, drag for a cloud"))
    return sorted(checks, key=lambda check: check[0] == "ok")


def _to_clear(state: "PageState") -> bool:
    """A robot is disarmed for a reason of old, which a new ``disarm`` clears where it has gone."""
    return any(report.run == "disarmed" and report.reason for report in state.reports().values())


def _can(state: "PageState", word: str, checks: Sequence[tuple[str, str]]) -> dict[str, bool]:
    phase = state.status.phase if state.status else ""
    good = word not in ("STOPPED", "STOPPING", "NO STATION")
    idle = good and phase in ("waiting", "ready", "completed") and word in ("DISARMED", "COMPLETED")
    begun = state.status is not None and bool(state.status.occupied)
    stray = any(level == "stray" for level, _ in checks)
    return {
        "seed": good and phase in ("waiting", "ready") and word == "DISARMED",
        "arm": good and phase == "ready" and word == "DISARMED",
        "start": good and not stray and (phase == "armed" or word == "HOLDING"),
        "hold": good and word == "RUNNING",
        "disarm": good
        and (word in ("ARMED", "ARMING", "HOLDING", "HOMING", "COMPLETED", "FAILED") or _to_clear(state)),
        "drop": good and word in ("RUNNING", "HOLDING"),
        "repeat": idle and (begun or word == "COMPLETED"),
        "home": idle and bool(state.misplaced()),
    }
