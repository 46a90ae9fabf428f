"""A body that plainly goes on is believed without a check: never another verdict than the checks one by one give."""

import math
import random
import struct
from collections.abc import Mapping

import pytest

from contract import arena as arenas
from contract.messages import BodyPose
from mocap_bridge import checks
from mocap_bridge.checks import Checker
from mocap_bridge.frames import ArenaFrame
from mocap_bridge.natnet.frame import Body
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.steady import Steady
from mocap_bridge.track import Track

COUNT = 6
PERIODS_NS = [4_166_667] * 12 + [0, 2_777_778, 50_000_000]
ODD = [math.nan, math.inf, -math.inf, 3e38, 28.4, 28.6, 49.0, 60.0]


def site(up_axis: str) -> arenas.Arena:
    robots = {
        f"b{k}": {
            "body": f"b{k}",
            "start": [0.5 + 0.5 * k, 1.0],
            "heading_offset_rad": 0.7 * (k - 3),
            "wheels": {"kind": "none"},
        }
        for k in range(COUNT)
    }
    mocap = {"up_axis": up_axis, "rotation_rad": -2.0, "origin_m": [0.3, -0.2]}
    return arenas.parse({"arena": {"name": "x", "size_m": [4.0, 3.0]}, "mocap": mocap, "robots": robots}, "test")


def single(values: list[float]) -> list[float]:
    return list(struct.unpack(f"<{len(values)}f", struct.pack(f"<{len(values)}f", *values)))


class Walk:
    """Bodies that wander, now and then spoilt, swapped or lost for a while."""

    def __init__(self, draw: random.Random, arena: arenas.Arena) -> None:
        self.draw, self.axes = draw, ArenaFrame(arena.mocap)
        self.at = [[0.5 + 0.5 * k, 1.0, draw.uniform(-3.0, 3.0)] for k in range(COUNT)]
        self.trouble: dict[int, tuple[str, int]] = {}
        self.order = list(range(COUNT))
        self.last: dict[str, Body] = {}

    def frame(self, number: int, now_ns: int) -> SourceFrame:
        draw = self.draw
        for place in self.at:
            place[0], place[1] = place[0] + draw.gauss(0.0, 1e-3), place[1] + draw.gauss(0.0, 1e-3)
            place[2] += draw.gauss(0.0, 1e-2)
        if draw.random() < 0.03:
            kinds = [
                "lost",
                "gone",
                "jump",
                "hop",
                "turn",
                "odd",
                "norm",
                "tilt",
                "out",
                "error",
                "warn",
                "frozen",
                "still",
            ]
            self.trouble[draw.randrange(COUNT)] = (draw.choice(kinds), draw.randrange(1, 40))
        if draw.random() < 0.01:
            draw.shuffle(self.order)
        elif draw.random() < 0.03:
            self.order.sort()
        bodies = {f"b{k}": body for k in range(COUNT) if (body := self.body(k)) is not None}
        self.last.update(bodies)
        self.trouble = {k: (kind, left - 1) for k, (kind, left) in self.trouble.items() if left > 1}
        return SourceFrame(0, number, now_ns, now_ns, now_ns, 0, bodies, draw.random() < 0.005)

    def body(self, k: int) -> Body | None:
        draw, kind = self.draw, self.trouble.get(k, ("", 0))[0]
        if kind == "gone":
            return None
        if kind == "frozen" and f"b{k}" in self.last:
            return self.last[f"b{k}"]
        x, y, heading = self.at[self.order[k]]
        x += {"jump": 0.5, "out": -9.0, "hop": draw.choice([0.0, 0.079, 0.081])}.get(kind, 0.0)
        at, turned = self.axes.source(x, y, heading + (1.5 if kind == "turn" else 0.0), 0.05)
        if kind == "tilt":
            turned = (math.sin(0.5), 0.0, 0.0, math.cos(0.5))
        scale = draw.choice([1.0089, 1.011, 0.5]) if kind == "norm" else draw.gauss(1.0, 2e-4)
        numbers = single([*at, *(scale * part for part in turned)])
        if kind == "odd":
            numbers[draw.randrange(7)] = draw.choice(ODD)
        if kind == "still" and f"b{k}" in self.last:
            numbers[:3] = self.last[f"b{k}"][1:4]
        error_m = {"error": draw.choice([0.011, math.nan]), "warn": draw.choice([0.002, 0.003, 0.01])}.get(kind, 3e-4)
        x, y, z, qx, qy, qz, qw = numbers
        return (k, x, y, z, qx, qy, qz, qw, error_m, draw.choice([0, 2]) if kind == "lost" else draw.choice([1, -1]))


class Sceptic(Steady):
    """Lets nothing go on."""

    def go_on(self, bodies: Mapping[str, Body], now_ns: int) -> tuple[list[BodyPose], list[Body | None], list[int]]:
        return super().go_on({}, now_ns)


@pytest.mark.parametrize("seed", range(6))
def test_going_on_gives_the_verdict_of_the_checks_one_by_one(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    draw = random.Random(seed)
    arena = site("yz"[seed % 2])
    usual, walk = Checker(arena), Walk(draw, arena)
    monkeypatch.setattr(checks, "Steady", Sceptic)
    careful = Checker(arena)
    gone_on = [0, 0]
    go_on = usual._steady.go_on

    def counted(bodies: Mapping[str, Body], now_ns: int) -> tuple[list[BodyPose], list[Body | None], list[int]]:
        found = go_on(bodies, now_ns)
        for body in found[1]:
            gone_on[body is not None] += 1
        return found

    monkeypatch.setattr(usual._steady, "go_on", counted)
    now_ns = 10**9
    for number in range(800):
        now_ns += draw.choice(PERIODS_NS)
        if draw.random() < 0.003:
            usual.restart()
            careful.restart()
        frame = walk.frame(number, now_ns)
        assert usual.check(frame) == careful.check(frame), number
        for one, other in zip(usual.tracks, careful.tracks, strict=True):
            assert (one.reason, one.resets, one.faults) == (other.reason, other.resets, other.faults), number
    assert min(gone_on) > 500


@pytest.mark.parametrize("seed", range(3))
def test_what_is_written_up_is_what_the_checks_one_by_one_wrote(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    draw = random.Random(100 + seed)
    arena = site("yz"[seed % 2])
    usual, walk = Checker(arena), Walk(draw, arena)
    monkeypatch.setattr(checks, "Steady", Sceptic)
    careful = Checker(arena)
    now_ns = 10**9
    for number in range(300):
        now_ns += draw.choice(PERIODS_NS)
        frame = walk.frame(number, now_ns)
        usual.check(frame)
        careful.check(frame)
        for checker in (usual, careful):
            checker._steady.settle(range(COUNT))
        for one, other in zip(usual.tracks, careful.tracks, strict=True):
            for name in Track.__slots__:
                assert getattr(one, name) == getattr(other, name), (number, name)
