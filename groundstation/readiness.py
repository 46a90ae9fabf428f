"""What stands between an arena and an armed swarm, in words. Pure."""

from collections.abc import Collection
from typing import NamedTuple

from contract.messages import TOOK_OVER, MocapHealth, Order
from groundstation.crew import Crew
from groundstation.failsafes import Facts, differs, refusals
from groundstation.preflight import Fleet, unfit
from groundstation.sighting import Sighting, misplaced
from groundstation.tally import Tally

SAID_HERE = frozenset({"robot_differs", "robot_silent", "swarm_split"})
"""Failsafes that have words of their own here."""


class Readiness(NamedTuple):
    """Everything that is looked at."""

    facts: Facts
    crew: Crew
    sighting: Sighting
    health: MocapHealth | None
    order: Order
    """In force now."""
    overrides: Collection[str]
    """Checks that the operator has taken on."""

    def lacking(self) -> list[str]:
        """What the swarm lacks to be armed."""
        crew, facts, sighting = self.crew.names, self.facts, self.sighting
        missing = [words for name in crew if (words := self.of(name))]
        missing += refusals(facts, SAID_HERE, self.overrides)
        if not missing:
            places = {name: sighting.places[name] for name in sighting.seen}
            missing += unfit(Fleet(facts, places, self.health, facts.now_ns), crew, self.overrides)
        if not missing and not set(crew) <= sighting.seen:
            missing.append(f"motion capture sees {len(sighting.points)} of {len(crew)} robots")
        return missing

    def apart(self, tally: Tally) -> list[str]:
        """What a swarm that lacks nothing else needs for a mission: to know its targets and to be one piece."""
        if late := tally.late(self.crew.names):
            return [f"{', '.join(late)}: targets of {tally.cloud.mission} not there yet"]
        if self.sighting.components < 2 or "swarm_split" in self.overrides:
            return []
        arena = self.facts.arena
        radius = arena.control.sensing_radius_m
        text = f"the swarm is in {self.sighting.components} pieces; place robots within {radius:g} m of others"
        return [text, *misplaced(arena, self.sighting.places)]

    def of(self, name: str) -> str:
        """Why one robot is not fit to be armed, in words; empty: it is."""
        facts = self.facts
        report = facts.reports.get(name)
        silence_ns = facts.arena.safety.report_silence_s * 1e9
        if report is None or facts.now_ns - facts.heard_ns[name] > silence_ns:
            return f"{name} does not report"
        if words := differs(report, facts.arena_hash):
            return words
        if not report.pose_valid:
            return f"{name} has no valid pose"
        bare = self.order == "disarm" or self.crew.addressees or name not in self.crew.names
        if bare and report.run != "disarmed":
            return f"{name} is {report.run}; release it (disarm)"
        if report.run == "disarmed" and report.reason not in ("", TOOK_OVER) and self.order != "arm":
            return f"{name}: {report.reason}"
        return ""
