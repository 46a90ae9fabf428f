"""Algorithm 1: one robot's whole decision, and what it tells its neighbours."""

import math
from collections.abc import Callable, Container, Iterable
from typing import Final, Literal

from contract.messages import LinkMessage, NeighbourState, Target
from contract.units import metres, radians
from onboard.ahdc.cotr import Task
from onboard.ahdc.field_law import FieldLaw, Steer
from onboard.ahdc.law import Law
from onboard.ahdc.links import LEAVING, OFF, ON, Link
from onboard.ahdc.memory import to_hex
from onboard.ahdc.paper_law import PaperLaw
from onboard.ahdc.parameters import Parameters, Vector
from onboard.ahdc.plan import Motion, Planner
from onboard.ahdc.stopping import stop_tables
from onboard.ahdc.tasking import Tasking
from onboard.ahdc.view import Decision, Goal, View
from onboard.record import record

LinkWord = Literal["on", "doubt", "leaving"]

MAIL_REPEATS: Final = 2
"""Every link message rides on this many state messages: the radio loses some."""
SIGHTINGS_A_MESSAGE: Final = 6
"""Shared sightings take turns, so that a state message stays small."""
STILL_MPS: Final = 0.01


class Controller:
    """One robot's law in either profile: :meth:`think` and :meth:`act` once a step, :meth:`announce` when due.

    The ``paper`` profile thinks first and then acts, as algorithm 1 stands. The ``field`` profile acts on the
    newest poses at once and thinks afterwards, so that a goal is one step old and the command is not late.
    A law of another distribution takes the place of the ``paper`` profile's velocity.
    """

    def __init__(
        self,
        robot: str,
        boot: int,
        parameters: Parameters,
        period_s: float,
        steer: Steer,
        rims: Callable[[float, float, float, float], tuple[float, float]],
        law: Law | None = None,
    ) -> None:
        self.robot = robot
        self.boot = boot
        self.parameters = parameters
        self.tasking = Tasking(robot, parameters)
        self.paper = PaperLaw(robot, parameters) if parameters.profile == "paper" else None
        self.field = FieldLaw(robot, boot, parameters, period_s, steer) if parameters.profile == "field" else None
        self.own = law
        """Neither ``paper`` nor ``field``."""
        self._near: list[str] = []
        self.planner = self.field.planner if self.field else Planner(parameters, stop_tables(parameters), period_s)
        self._steer = steer
        self._rims = rims
        self.mission = ""
        self._goal: Goal | None = None
        self._out = False
        """The operator has taken this robot itself out of the network."""
        self._seq = 0
        self._last_sighting = -1
        self._mail: list[tuple[int, LinkMessage]] = []
        self._states: list[Link] = []
        """Of all links that there have been, when :meth:`link_states` was asked last."""
        self._link_states: dict[str, LinkWord] = {}

    def begin(self, mission: str) -> None:
        """A new mission: forget every target, also the occupied ones. Links stay."""
        self.mission = mission
        self.tasking = Tasking(self.robot, self.parameters)
        self._goal, self._last_sighting = None, -1

    def release(self) -> None:
        """Give up every link, as homing needs it."""
        self._mail.clear()
        if self.field is not None:
            self.field.release()
        if self.paper is not None:
            self.paper.neighbours, self.paper.wishes, self.paper.kept = set(), set(), set()

    def settle(self, beyond: Callable[[Iterable[str]], list[str]]) -> None:
        """Robots without power are carried about: no link is kept with one that is out of reach now."""
        if self.field is not None:
            for name in beyond(self.field.links.enforced()):
                self.field.forget(name)

    def rejoin(self) -> None:
        """As at the start it moves only once linked to every robot within r_c."""
        if self.field is not None:
            self.field.rejoin()

    def exclude(self, robots: frozenset[str]) -> None:
        """Robots that are no part of the network any more, by the operator's order."""
        self._out = self.robot in robots
        if self.field is not None and robots - {self.robot} != self.field.excluded:
            self.field.exclude(robots - {self.robot})

    def vouch(self, obeyed: bool) -> None:
        """Whether its wheels do what they are told and its pose is its own: else no detour may lean on its links."""
        if self.field is not None:
            self.field.links.fit = obeyed

    @property
    def linked(self) -> Container[str]:
        """Robots that a link is kept with, seen or unseen."""
        return self.field.links if self.field is not None else ()

    def think(self, view: View) -> None:
        """Algorithm 1, line 1: the goal from algorithm 2; in the ``field`` profile also the links."""
        if self.field is not None:
            self.field.keep_links(view)
        if self._out:
            self.tasking.leave()
            self._goal = None
        else:
            self._goal = self.tasking.update(view)

    def act(self, view: View) -> Decision:
        """Algorithm 1, lines 2-12: rim speeds towards the goal by the profile's law, or stop."""
        goal, tasking = self._goal, self.tasking
        reason = "" if goal is not None and goal.why == "target" else goal.why if goal is not None else "hold"
        law = self.own or self.paper
        if law is not None:
            self._near = sorted(view.sighted) if self.own else []
            u = law.velocity(view, goal)
            if not view.may_move:
                return Decision(0.0, 0.0, "hold")
            speed, turn = self._steer(u, view.motion.heading_rad)
            left, right = self._rims(speed, turn, self.parameters.wheel_separation_m, self.parameters.max_speed_mps)
            return Decision(left, right, reason)
        assert self.field is not None
        if not view.may_move:
            return Decision(0.0, 0.0, "hold")
        facing = tasking.claim_at() if tasking.task is Task.OCCUPIED and tasking.next_target is not None else None
        command = self.field.command(view, goal, facing)
        waits = "joining" if not self.field.joined else command.bound or reason
        return record(Decision, (command.left_mps, command.right_mps, waits))

    def hear_mail(self, sender: str, mail: tuple[LinkMessage, ...], now_s: float) -> None:
        """Link protocol messages of a neighbour's state message."""
        if self.field is not None and sender not in self.field.excluded:
            for message in mail:
                self.field.links.hear(sender, message, now_s)

    def link_states(self) -> dict[str, LinkWord]:
        """Every enforced link: 'on', 'doubt' (offered, accepted, in removal) or 'leaving'."""
        if self.field is None:
            return dict.fromkeys(sorted(self.paper.neighbours) if self.paper else self._near, "on")
        entries = self.field.links.entries
        states = [entry.state for entry in entries.values()]
        if states != self._states:
            self._states = states
            self._link_states = {
                name: "on" if state is ON else "leaving" if state is LEAVING else "doubt"
                for name, state in zip(entries, states, strict=True)
                if state is not OFF
            }
        return self._link_states

    def announce(
        self,
        motion: Motion,
        stamp_ns: int,
        left_mps: float,
        right_mps: float,
        asked_mps: tuple[float, float],
        rolls_to: Vector | None = None,
    ) -> NeighbourState:
        """The state message for this moment, given the rim speeds really commanded.

        :param asked_mps: those that the wheels follow if nothing else reaches them.
        :param rolls_to: where they take it if they obey nobody any more.
        """
        tasking = self.tasking
        x, y, heading, left, right = motion
        long, short = self.planner.stop_points(motion, left_mps, right_mps)
        long = rolls_to or long
        speed = (left + right) / 2
        self._seq += 1
        still = max(abs(left_mps), abs(right_mps), abs(left), abs(right)) < STILL_MPS
        claim = tasking.claim
        fit = self.field is None or self.field.links.fit
        on: list[str] = []
        kept: list[str] = []
        for name, state in self.link_states().items():
            (on if state == "on" and fit else kept).append(name)
        return NeighbourState(
            robot=self.robot,
            boot=self.boot,
            seq=self._seq,
            stamp_ns=stamp_ns,
            x_m=metres(x),
            y_m=metres(y),
            heading_rad=radians(math.remainder(heading, math.tau)),
            vx_mps=metres(speed * math.cos(heading)),
            vy_mps=metres(speed * math.sin(heading)),
            stop_long=(metres(long[0]), metres(long[1])),
            stop_short=(metres(short[0]), metres(short[1])),
            rims_mps=(metres(left), metres(right)),
            asked_mps=(metres(asked_mps[0]), metres(asked_mps[1])),
            moving=not still,
            mission=self.mission,
            task="helping" if tasking.helping else tasking.task.value,
            claim=-1 if claim is None else claim,
            claim_at=tasking.claim_at(),
            claim_wait_s=round(tasking.hold_left_s(stamp_ns * 1e-9), 3),
            claims=tasking.book.to_tell(stamp_ns * 1e-9) if self.field is not None else (),
            indicator=tasking.indicator,
            hops=tasking.hops,
            cloud_seen=tasking.cloud_seen,
            occupied=to_hex(tasking.memory.occupied),
            sightings=self._sightings(),
            help=tasking.assist.told,
            links_on=tuple(on),
            links_kept=tuple(kept),
            wishes=tuple(sorted(self.paper.wishes)) if self.paper else (),
            mail=self._post(),
        )

    def _sightings(self) -> tuple[Target, ...]:
        if not self.parameters.share_sightings:
            return ()
        memory = self.tasking.memory
        told = memory.after(self._last_sighting, SIGHTINGS_A_MESSAGE)
        self._last_sighting = told[-1] if told else -1
        places = [(index, memory.open[index]) for index in told]
        return tuple(Target(index=index, x_m=metres(x), y_m=metres(y)) for index, (x, y) in places)

    def _post(self) -> tuple[LinkMessage, ...]:
        if self.field is None:
            return ()
        outbox = self.field.links.outbox
        if not (outbox or self._mail):
            return ()
        self._mail = [(left - 1, message) for left, message in self._mail if left > 1]
        self._mail += [(MAIL_REPEATS, message) for message in outbox]
        outbox.clear()
        return tuple(message for _, message in self._mail)
