"""From what the arena page has heard to what it shows, as one plain view. Pure: times come from outside.

The server says the words, the browser draws them: so every word is tested without a browser.
"""

import math
from typing import Any

from contract.arena import Arena
from contract.exposure import exposure
from contract.messages import RobotReport, TargetCloud
from groundstation.connectivity import tree_floor
from groundstation.page_bar import bar
from groundstation.page_health import health
from groundstation.page_links import Network, network
from groundstation.page_memory import PageMemory
from groundstation.page_missing import Missing, missing
from groundstation.page_reasons import POWERED, SILENT_S, Complaint, Heard, complaint
from groundstation.page_rows import Sight, row
from groundstation.sighting import MISPLACED_M

CAUTION_AFTER_S = 1.0
"""A caution must last this long before it is shown: a single late step is no news."""
SHOWN_EVENTS = 12
HISTORY_S = 0.25
SPEED_OVER_S = 0.2


class PageState(PageMemory):
    """The view of everything heard so far."""

    def __init__(self, arena: Arena, now_ns: int) -> None:
        super().__init__(arena, now_ns)
        self._cautions: dict[str, tuple[str, int]] = {}
        self.site_ahead_ns = 0
        """Of the clock by which messages arrive."""

    def layout(self) -> dict[str, Any]:
        """What does not change while the page is open, and what has been so far."""
        arena, control = self.arena, self.arena.control
        return {
            "kind": "layout",
            "name": arena.arena.name,
            "size": arena.arena.size_m,
            "fence": arena.arena.fence_m,
            "robots": self._names,
            "labels": self._labels,
            "starts": [robot.start for robot in arena.robots.values()],
            "r_c": control.sensing_radius_m,
            "r_n": round(control.noncritical_radius_m, 4),
            "r_a": control.avoidance_radius_m,
            "diameter": arena.platform.diameter_m,
            "hold_s": control.occupying_time_s,
            "profile": control.profile,
            "floor": tree_floor(len(self._names)),
            "history": list(self.history),
            "marks": self.marks,
            "events": list(self.events),
            "insecure": exposure((arena.link.router,), arena.link.keys),
        }

    @property
    def cloud(self) -> TargetCloud | None:
        return self.board.cloud

    @property
    def cloud_version(self) -> int:
        return self.board.version

    def targets(self) -> dict[str, Any]:
        """The targets, sent when they change."""
        return self.board.message()

    def view(self, now_ns: int) -> dict[str, Any]:
        """The arena at this moment."""
        complaints = self.complaints(now_ns)
        graph = self.network(now_ns)
        if self._due():
            self._note_lambda2(graph)
        away = self.misplaced()
        rows = [row(name, self._sight(name, complaints.get(name), away.get(name), now_ns)) for name in self._names]
        running = [self._poses[n][:2] for n, (r, _) in self._reports.items() if r.run == "running" and n in self._poses]
        recorder_age_s = (now_ns - self.recorder_ns) / 1e9
        station, gone = self.station_alive(now_ns), self.missing(now_ns)
        view: dict[str, Any] = {
            "kind": "view",
            "t": now_ns // 1_000_000,
            "age_s": round(self.frame_age_s(now_ns), 3),
            "station": station,
            "missing": [part._asdict() for part in gone],
            "robots": rows,
            "links": graph.pairs,
            "l2": round(graph.lambda2, 4),
            "elapsed": self._elapsed(),
            "version": self.cloud_version,
            "targets": self.board.letters((r for r, _ in self._reports.values()), running),
            "health": health(self.mocap, self.frame_age_s(now_ns), station, self.recorder, recorder_age_s),
            "events": list(self.events)[-SHOWN_EVENTS:],
            "marks": self.marks[-40:],
            "marked": len(self.marks),
            "history": list(self.history)[-4:],
        }
        view |= bar(self, rows, graph, gone, now_ns)
        return view

    def remember(self, now_ns: int) -> None:
        """Keep the history while nobody looks, too."""
        if self._due():
            self._note_lambda2(self.network(now_ns))

    def _due(self) -> bool:
        """Whether the mission runs, and goes on since its last point of the history."""
        status = self.status
        if status is None or status.phase != "running":
            return False
        return not self.history or status.elapsed_s - self.history[-1][0] >= HISTORY_S

    def _note_lambda2(self, graph: Network) -> None:
        assert self.status is not None
        self.history.append((round(self.status.elapsed_s, 2), round(graph.lambda2, 4)))

    def station_alive(self, now_ns: int) -> bool:
        return self.status is not None and now_ns - self.status_ns < SILENT_S * 1e9

    def missing(self, now_ns: int) -> list[Missing]:
        """Processes of the station that were there and are not."""
        silent_s = (now_ns - self.status_ns) / 1e9 if self.status is not None else 0.0
        return missing(self.arena, self.roll, silent_s if silent_s > SILENT_S else None, now_ns)

    def report_age_s(self, robot: str, now_ns: int) -> float:
        """Since the robot's last report arrived; -1 for never."""
        entry = self._reports.get(robot)
        return (now_ns - entry[1]) / 1e9 if entry else -1.0

    def reports(self) -> dict[str, RobotReport]:
        return {name: report for name, (report, _) in self._reports.items()}

    def silent(self, now_ns: int) -> list[str]:
        """Robots that have not confirmed the STOP, or where nobody pressed it, that do not report."""
        if self.latch.pressed is not None and self.latch.pressed.stop_id:
            return self.latch.silent
        return [name for name in self._names if not 0 <= self.report_age_s(name, now_ns) <= SILENT_S]

    def misplaced(self) -> dict[str, float]:
        """Robots that are not at their starts, with the distance in m."""
        places = {name: pose[:2] for name, pose in self._poses.items()}
        starts = {name: self.arena.robots[name].start for name in places}
        away = {name: math.dist(place, starts[name]) for name, place in places.items()}
        return {name: away_m for name, away_m in away.items() if away_m > MISPLACED_M}

    def complaints(self, now_ns: int) -> dict[str, Complaint]:
        """What is wrong, by robot."""
        found = {}
        for name in self._names:
            entry = self._reports.get(name)
            report, arrival_ns = entry if entry else (None, 0)
            ahead_s = (report.stamp_ns - arrival_ns - self.site_ahead_ns) / 1e9 if report else 0.0
            age_s, frame_age_s = self.report_age_s(name, now_ns), self.frame_age_s(now_ns)
            trouble = complaint(self.arena, name, Heard(report, age_s, self._bodies.get(name), frame_age_s, ahead_s))
            if trouble is None:
                self._cautions.pop(name, None)
                continue
            if trouble.level == "caution" and report is not None:
                title, since_ns = self._cautions.get(name, ("", now_ns))
                if title != trouble.title:
                    since_ns = now_ns
                self._cautions[name] = (trouble.title, since_ns)
                if now_ns - since_ns < CAUTION_AFTER_S * 1e9:
                    continue
            found[name] = _dropped(trouble) if name in self.excluded else trouble
        return found

    @property
    def excluded(self) -> frozenset[str]:
        """Robots that the operator has taken out of the network."""
        return frozenset(self.status.excluded if self.status is not None else ())

    def network(self, now_ns: int) -> Network:
        """Of all robots but those taken out of it."""
        control, out = self.arena.control, self.excluded
        members = [name for name in self._names if name not in out]
        place = {name: k for k, name in enumerate(members)}
        reports = [self._reports[name][0] for name in members if name in self._reports]
        enforced = [[place[o] for o in r.links_on + r.links_kept if o in place] for r in reports]
        linked = len(enforced) == len(members) and any(enforced)
        powered = any(report.run in (*POWERED, "stopped", "fault") for report in reports)
        found = network(
            [self._poses[n][:2] if n in self._poses else None for n in members],
            enforced if linked and powered else None,
            frozenset(k for k, name in enumerate(members) if not self._verified(name, now_ns)),
            [self._labels[self._index[name]] for name in members],
            control.sensing_radius_m,
            control.noncritical_radius_m,
            0 <= self.frame_age_s(now_ns) <= SILENT_S,
        )
        number = [self._index[name] for name in members]
        return found._replace(pairs=tuple((number[i], number[j], kind) for i, j, kind in found.pairs))

    def _verified(self, name: str, now_ns: int) -> bool:
        body = self._bodies.get(name)
        return body is not None and body.valid and 0 <= self.report_age_s(name, now_ns) <= SILENT_S

    def speed_mps(self, name: str) -> float | None:
        """As motion capture sees it, over the last 0.2 s."""
        track = self._tracks[name]
        if len(track) < 2:
            return None
        first = last = track[-1]
        for point in reversed(track):
            if last[0] - point[0] > SPEED_OVER_S * 1e9:
                break
            first = point
        gap_s = (last[0] - first[0]) / 1e9
        return math.dist(first[1:], last[1:]) / gap_s if gap_s > 0 else None

    def _sight(self, name: str, trouble: Complaint | None, away_m: float | None, now_ns: int) -> Sight:
        entry = self._reports.get(name)
        return Sight(
            report=entry[0] if entry else None,
            told=self._told[name] if entry else {},
            report_age_s=self.report_age_s(name, now_ns),
            body=self._bodies.get(name),
            pose=self._poses.get(name),
            exposure_ns=self._frame.exposure_ns if self._frame else None,
            speed_mps=self.speed_mps(name),
            hold_share=self.hold_share(name, now_ns),
            acknowledged_ns=self.latch.acknowledged_ns.get(name),
            away_m=away_m,
            trouble=trouble,
            excluded=name in self.excluded,
        )


def _dropped(trouble: Complaint) -> Complaint:
    """What is wrong with a robot that the operator has taken out: no alarm any more, and how it comes back."""
    now = "Dropped: it stands still, the others keep no link to it"
    return trouble._replace(level="caution", now=now, do=f"{trouble.do}. Then rejoin it (J)")
