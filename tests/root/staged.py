"""The arena page in every state it knows, without an arena: made-up messages, a clock that stands still."""

import asyncio
import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import uvicorn
from msgspec.structs import replace

from contract.arena import Arena, digest, load, parse
from contract.messages import (
    SCHEMA_VERSION,
    BodyPose,
    LogEntry,
    LoopTiming,
    MocapFrame,
    MocapHealth,
    RobotReport,
    RunStatus,
    StationHeartbeat,
    Target,
    TargetCloud,
)
from groundstation import rig
from groundstation.page_live import Page
from groundstation.page_missing import BRIDGE, PAGE, RECORDER, STATION
from groundstation.page_replay import NoLink
from groundstation.page_state import PageState
from groundstation.page_web import application

MS = 1_000_000
NOW_NS = 100_000 * MS
ALL = frozenset({BRIDGE, STATION, RECORDER, PAGE})
POINTS = (
    (0.80, 1.77), (1.12, 2.26), (0.99, 2.61), (0.94, 3.60), (0.57, 4.13), (1.61, 2.96), (1.77, 2.13), (1.56, 3.90),
    (1.96, 3.18), (2.36, 2.58), (2.63, 2.30), (2.95, 2.54), (3.01, 2.13), (3.09, 2.92), (2.75, 3.65), (3.09, 4.65),
    (3.36, 4.26), (2.12, 3.88), (0.52, 2.42),
)  # fmt: skip
SPREAD = {
    "r06": (1.51, 2.26, 0.2), "r08": (2.49, 2.34, 1.6), "r09": (2.97, 2.11, -2.2), "r11": (1.97, 3.19, 1.6),
    "r13": (2.81, 3.38, 1.1), "r14": (2.14, 2.77, 2.2),
}  # fmt: skip
LINKS = (("r06", "r08"), ("r08", "r09"), ("r08", "r14"), ("r14", "r11"), ("r14", "r13"))
TASKS = (
    ("tracking", 1), ("tracking", 5), ("free", -1), ("occupied", 7), ("tracking", 14), ("tracking", 13),
)  # fmt: skip


@dataclass
class Stage:
    """A page state fed by hand; every method returns the stage, so that scenes read as a sentence."""

    state: PageState
    now_ns: int = NOW_NS
    phase: str = "running"

    @property
    def arena(self) -> Arena:
        return self.state.arena

    def poses(self, places: dict[str, tuple[float, float, float]], hidden: Iterable[str] = ()) -> "Stage":
        bodies = tuple(
            BodyPose(robot=n, x_m=x, y_m=y, heading_rad=h, valid=n not in hidden,
                     reason="occluded" if n in hidden else "")
            for n, (x, y, h) in places.items()
        )  # fmt: skip
        frame = MocapFrame(
            session=1, frame=self.now_ns // MS, exposure_ns=self.now_ns, transmit_ns=self.now_ns,
            publish_ns=self.now_ns, rate_hz=240.0, bodies=bodies,
        )  # fmt: skip
        self.state.receive(frame, self.now_ns)
        self.state.receive(MocapHealth(stamp_ns=self.now_ns, state="ok", rate_hz=240.0), self.now_ns)
        return self

    def status(self, phase: str, elapsed_s: float = 0.0, done: Iterable[int] = (), detail: str = "") -> "Stage":
        self.phase = phase
        status = RunStatus(
            stamp_ns=self.now_ns, phase=phase, elapsed_s=elapsed_s, occupied=tuple(done), detail=detail,  # type: ignore[arg-type]
            mission="lab", targets=len(self.state.cloud.targets) if self.state.cloud else 0,
        )  # fmt: skip
        self.state.receive(status, self.now_ns)
        return self

    def without(self, *names: str) -> "Stage":
        """The operator has dropped these."""
        assert self.state.status is not None
        self.state.receive(replace(self.state.status, excluded=names), self.now_ns)
        return self

    def order(self, order: str) -> "Stage":
        beat = StationHeartbeat(boot=1, seq=1, stamp_ns=self.now_ns, order=order, order_id=1)  # type: ignore[arg-type]
        self.state.receive(beat, self.now_ns)
        return self

    def reports(self, run: str, links: bool = True, **special: dict[str, object]) -> "Stage":
        """Every robot's report; ``r11={...}`` changes one."""
        names = list(self.arena.robots)
        for k, name in enumerate(names):
            mine = tuple(b if a == name else a for a, b in LINKS if name in (a, b) and {a, b} <= set(names))
            task, claim = TASKS[k % len(TASKS)] if run == "running" else ("free", -1)
            fields: dict[str, Any] = {
                "robot": name, "boot": 1, "stamp_ns": self.now_ns, "schema_version": SCHEMA_VERSION,
                "arena_hash": digest(self.arena), "run": run, "pose_valid": True, "pose_age_ms": 7.0 + k,
                "battery_v": 15.8 - 0.13 * k, "task": task, "claim": claim, "stopped": run not in ("running",),
                "timing": LoopTiming(nominal_hz=100.0, rate_hz=100.0, jitter_ms=0.3 + 0.02 * k, steps=10, misses=0),
                "neighbours": mine or tuple(n for n in names if n != name), "links_on": mine if links else (),
            }  # fmt: skip
            self.state.receive(RobotReport(**fields | special.get(name, {})), self.now_ns)
        return self

    def recorder(self, megabytes: float = 41.0, level: str = "info", text: str = "41.0 MB, 120 kB/s") -> "Stage":
        entry = LogEntry(
            stamp_ns=self.now_ns, level=level, source="recorder", event="recording", text=text,  # type: ignore[arg-type]
            fields={"bytes": megabytes * 1e6, "bytes_per_s": 120_000, "disk_free_bytes": 1.34e9},
        )  # fmt: skip
        self.state.receive(entry, self.now_ns)
        return self

    def here(self, present: Iterable[str] = ALL) -> "Stage":
        self.state.attend(set(present), self.now_ns)
        return self

    def later(self, seconds: float) -> "Stage":
        self.now_ns += round(seconds * 1e9)
        return self

    def stop(self, *silent: str) -> "Stage":
        """STOP, answered within 31 ms by all but ``silent``."""
        self.state.stop_id = 77  # type: ignore[attr-defined]
        self.state.latch.press(77, "Space", self.now_ns)
        self.state.note("STOP sent by Space", "error", self.now_ns)
        self.later(0.014)
        stopped = {"stop_id": 77}
        for k, name in enumerate(self.arena.robots):
            if name not in silent:
                self.later(0.003)
                self._one(name, k, stopped)
        return self

    def standing(self, *silent: str) -> "Stage":
        """The stopped robots' next reports, and the station's status."""
        for k, name in enumerate(self.arena.robots):
            if name not in silent:
                self._one(name, k, {"stop_id": 77})
        return self.status("stopped", 47.0, range(12), "stop requested by Space")

    def _one(self, name: str, k: int, changes: dict[str, object]) -> None:
        base = self.state.reports()[name]
        fields = {f: getattr(base, f) for f in base.__struct_fields__} | {
            "run": "stopped", "stamp_ns": self.now_ns, "reason": "stop requested by Space",
            "remedy": "release (`disarm`) when it is safe", "task": base.task, "stopped": True,
        }  # fmt: skip
        self.state.receive(RobotReport(**fields | changes), self.now_ns)


def lab() -> Arena:
    return load(rig.find_arena("experiment2"))


def many() -> Arena:
    robots = {
        f"r{i + 1:02d}": {
            "body": f"b{i}",
            "start": [0.6 + 0.8 * (i % 8), 0.6 + 0.8 * (i // 8)],
            "wheels": {"kind": "odrive"},
        }
        for i in range(50)
    }
    return parse({"arena": {"name": "many", "size_m": [12.0, 16.0]}, "robots": robots}, "test")


def cloud(points: Iterable[tuple[float, float]]) -> TargetCloud:
    return TargetCloud(mission="lab", targets=tuple(Target(index=k, x_m=x, y_m=y) for k, (x, y) in enumerate(points)))


def fresh(points: Iterable[tuple[float, float]] = POINTS) -> Stage:
    """Disarmed at the starts, all well."""
    stage = Stage(PageState(lab(), NOW_NS - 60_000 * MS)).here()
    stage.state.receive(cloud(points), NOW_NS)
    starts = {name: (*robot.start, robot.heading_rad) for name, robot in stage.arena.robots.items()}
    return stage.poses(starts).status("ready").order("disarm").reports("disarmed", links=False)


def mission(done: int = 6, elapsed_s: float = 34.0) -> Stage:
    """Running since ``elapsed_s``, with a past."""
    stage = fresh().order("run")
    stage.now_ns = NOW_NS - round(elapsed_s * 1e9)
    steps = round(elapsed_s * 4)
    for k in range(1, steps + 1):
        stage.later(0.25)
        share = k / steps
        places = {}
        for name, (x, y, h) in SPREAD.items():
            sx, sy = stage.arena.robots[name].start
            places[name] = (sx + (x - sx) * share, sy + (y - sy) * share, h)
        stage.poses(places).status("running", 0.25 * k, range(int(done * share)))
        stage.state.network(stage.now_ns)
        stage.state.history.append((0.25 * k, 0.268 + abs(math.sin(k / 17)) * 1.2))
    return stage.reports("running").recorder().status("running", elapsed_s, range(done))


SCENES: dict[str, Callable[[], Stage]] = {
    "a-disarmed": fresh,
    "a-out-of-reach": lambda: fresh((*POINTS[:13], (3.42, 1.08))),
    "a-no-targets": lambda: fresh(()),
    "a-waiting": lambda: (
        fresh().status("waiting", detail="r11 does not report; r13 has another arena file (0123456789ab)")
    ),
    "a-armed": lambda: fresh().order("arm").status("armed", detail="all robots armed").reports("armed"),
    "b-running": lambda: mission().here(),
    "b-holding": lambda: mission().order("hold").reports("holding"),
    "b-completed": lambda: (
        mission(19, 52.0).order("disarm").reports("disarmed", links=False)
        .status("completed", 52.0, range(19), "all 19 targets occupied")
    ),
    "b-homing": lambda: (
        mission(19, 52.0).order("run").reports("running", links=False, **{n: {"task": "homing"} for n in SPREAD})
        .status("homing", 0.0, (), "on the way: r06, r09, r14")
    ),
    "c-fault": lambda: (
        mission(9, 59.0)
        .poses(SPREAD, hidden=["r11"])
        .reports("running", r11={"run": "holding", "pose_valid": False, "pose_age_ms": 1800.0, "stopped": True,
                                 "task": "free", "claim": -1, "reason": "pose invalid: occluded"})
        .status("running", 59.0, range(9))
    ),
    "c-dropped": lambda: (
        mission(9, 59.0)
        .poses(SPREAD, hidden=["r11"])
        .reports("running", r11={"run": "holding", "pose_valid": False, "pose_age_ms": 1800.0, "stopped": True,
                                 "task": "free", "claim": -1, "reason": "pose invalid: occluded", "links_on": ()},
                 r14={"links_on": ("r08", "r13")})
        .status("running", 59.0, range(9))
        .without("r11")
    ),
    "c-caution": lambda: mission().reports("running", r13={"battery_v": 10.6}),
    "c-recorder-gone": lambda: mission().here(ALL - {RECORDER}),
    "c-disk": lambda: mission().recorder(41.0, "warning", "disk nearly full: 310 MB left, 43 min at this rate"),
    "c-station-gone": lambda: mission().here(ALL - {STATION}).later(1.3).poses(SPREAD).reports(
        "running", **{n: {"run": "holding", "reason": "no heartbeat of the station", "stopped": True} for n in SPREAD}
    ),
    "c-router-gone": lambda: mission().here({PAGE}).later(1.2),
    "d-stopping": lambda: mission(12, 47.0).stop(*list(SPREAD)[2:]),
    "d-stopped": lambda: mission(12, 47.0).stop().later(1.0).standing().poses(SPREAD),
    "d-not-confirmed": lambda: (
        mission(12, 47.0).stop("r13").later(2.2).standing("r13")
        .poses(SPREAD | {"r13": (2.83, 3.38, 1.1)}).later(0.2).poses(SPREAD | {"r13": (2.85, 3.39, 1.1)})
    ),
}  # fmt: skip


def crowd() -> Stage:
    """50 robots and 500 targets in the middle of a mission."""
    stage = Stage(PageState(many(), NOW_NS)).here()
    points = [(0.5 + 0.44 * (k % 25), 0.6 + 0.75 * (k // 25)) for k in range(500)]
    stage.state.receive(cloud(points), NOW_NS)
    places = {n: (*robot.start, 0.3 * i) for i, (n, robot) in enumerate(stage.arena.robots.items())}
    stage.poses(places).status("running", 0.0).later(0.3).poses(places).order("run")
    near = {n: tuple(o for o in places if o != n and math.dist(places[n][:2], places[o][:2]) <= 0.85) for n in places}
    special: dict[str, dict[str, object]] = {n: {"links_on": near[n], "neighbours": near[n]} for n in places}
    special["r17"] |= {"run": "fault", "reason": "driver: port gone", "remedy": "plug it in, then release and arm"}
    return stage.reports("running", **special).status("running", 61.0, range(120))


def unready() -> Stage:
    """50 robots of which some are not ready: what is to be done must be seen beside their many rows."""
    stage = Stage(PageState(many(), NOW_NS)).here()
    stage.state.receive(cloud(POINTS), NOW_NS)
    stage.poses({n: (*robot.start, 0.0) for n, robot in stage.arena.robots.items()})
    waits = "; ".join(f"{name} does not report" for name in list(stage.arena.robots)[:4])
    return stage.status("waiting", detail=waits).order("disarm").reports("disarmed", links=False)


SCENES["m-many"] = crowd
SCENES["m-not-confirmed"] = lambda: crowd().stop(*list(many().robots)[5:]).later(1.0).standing(*list(many().robots)[5:])
SCENES["m-waiting"] = unready


class Still(Page):
    """A page that shows one stage for ever."""

    def __init__(self, stage: Stage) -> None:
        super().__init__(stage.arena, NoLink(stage.arena), "")
        self._number = 0
        self.show(stage)

    def show(self, stage: Stage) -> int:
        """From now on this stage; the number that its views bear."""
        stage.state.view(stage.now_ns - 1_500 * MS)
        self.arena, self.state = stage.arena, stage.state
        self._number += 1
        self._fixed = stage.state.view(stage.now_ns) | {"scene": self._number}
        for client in list(self.clients):
            client.cloud_version = -1
            client.answer(self.layout())
        return self._number

    def turn(self, now_ns: int) -> None:
        return

    def view(self, now_ns: int) -> dict[str, Any]:
        return self._fixed

    def poses(self, now_ns: int) -> None:
        return None


class Served:
    """A page's server in a thread, at ``url``."""

    def __init__(self, page: Page) -> None:
        self.page = page
        config = uvicorn.Config(application(page), port=0, log_level="error", ws_per_message_deflate=False)
        self.server = uvicorn.Server(config)
        self._started = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    async def _serve(self) -> None:
        serving = asyncio.create_task(self.server._serve())
        while not self.server.started:
            await asyncio.sleep(0.005)
        self.url = f"http://127.0.0.1:{self.server.servers[0].sockets[0].getsockname()[1]}/"
        self._started.set()
        await serving

    def __enter__(self) -> "Served":
        self._thread.start()
        assert self._started.wait(20.0)
        return self

    def __exit__(self, *exception: object) -> None:
        self.server.should_exit = self.server.force_exit = True
        self._thread.join(10.0)
