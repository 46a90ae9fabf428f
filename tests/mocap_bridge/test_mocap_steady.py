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
from mocap_bridge.natnet.listed import Listed, ids_of
from mocap_bridge.sources.base import SourceFrame
from mocap_bridge.steady import Steady
from mocap_bridge.track import Track

COUNT = 6
BODY = struct.Struct("<i8fh")
WAYS = ["named", "listed", "with strangers"]
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


class Lister:
    """Gives the bodies as a source does that lists them: in one order, with some that are no robot's."""

    def __init__(self, way: str) -> None:
        self.way, self.names = way, ("",)

    def frame(self, frame: SourceFrame) -> SourceFrame:
        if self.way == "named":
            return frame
        bodies = dict(frame.bodies)
        if self.way == "with strangers":
            wand = (77, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1)
            bodies = {"wand": wand, **dict(reversed(bodies.items())), "wand 2": wand}
        if tuple(bodies) != self.names:
            self.names = tuple(bodies)
        return frame._replace(bodies=Listed(self.names, b"".join(BODY.pack(*body) for body in bodies.values())))


class Sceptic(Steady):
    """Lets nothing go on."""

    def go_on(self, bodies: Mapping[str, Body], now_ns: int) -> tuple[list[BodyPose], list[Body | None], list[int]]:
        return super().go_on({}, now_ns)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("seed", range(4))
def test_going_on_gives_the_verdict_of_the_checks_one_by_one(
    seed: int, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw = random.Random(seed)
    arena = site("yz"[seed % 2])
    usual, walk, lister = Checker(arena), Walk(draw, arena), Lister(way)
    monkeypatch.setattr(checks, "Steady", Sceptic)
    careful = Checker(arena)
    gone_on = [0, 0]
    go_on = usual._steady.go_on

    def counted(bodies: Mapping[str, Body], now_ns: int) -> tuple[list[BodyPose], list[Body | None], list[int]]:
        found = go_on(bodies, now_ns)
        for place in range(COUNT):
            gone_on[place not in found[2]] += 1
        return found

    monkeypatch.setattr(usual._steady, "go_on", counted)
    now_ns = 10**9
    for number in range(800):
        now_ns += draw.choice(PERIODS_NS)
        if draw.random() < 0.003:
            usual.restart()
            careful.restart()
        frame = lister.frame(walk.frame(number, now_ns))
        assert usual.check(frame) == careful.check(frame), number
        for one, other in zip(usual.tracks, careful.tracks, strict=True):
            assert (one.reason, one.resets, one.faults) == (other.reason, other.resets, other.faults), number
    assert min(gone_on) > 500


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("seed", range(2))
def test_what_is_written_up_is_what_the_checks_one_by_one_wrote(
    seed: int, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw = random.Random(100 + seed)
    arena = site("yz"[seed % 2])
    usual, walk, lister = Checker(arena), Walk(draw, arena), Lister(way)
    monkeypatch.setattr(checks, "Steady", Sceptic)
    careful = Checker(arena)
    now_ns = 10**9
    for number in range(300):
        now_ns += draw.choice(PERIODS_NS)
        frame = lister.frame(walk.frame(number, now_ns))
        usual.check(frame)
        careful.check(frame)
        for checker in (usual, careful):
            checker._steady.settle(range(COUNT))
        for one, other in zip(usual.tracks, careful.tracks, strict=True):
            for name in Track.__slots__:
                assert getattr(one, name) == getattr(other, name), (number, name)


@pytest.mark.parametrize("listed", [False, True])
def test_a_body_that_slowly_falls_over_is_refused_as_soon_as_the_checks_refuse_it(listed: bool) -> None:
    arena = site("z")
    checker, lister, now_ns = Checker(arena), Lister("listed" if listed else "named"), 10**9
    leans = [0.02 * number for number in range(60)]
    reasons = []
    for number, lean_rad in enumerate(leans):
        now_ns += 4_166_667
        at, _ = ArenaFrame(arena.mocap).source(2.0 + 1e-4 * number, 1.0, 0.0, 0.1)
        turned = single([math.sin(0.5 * lean_rad), 0.0, 0.0, math.cos(0.5 * lean_rad)])
        bodies = {f"b{k}": (k, *single(at), *turned, 0.0, 1) for k in range(COUNT)}
        frame = lister.frame(SourceFrame(0, number, now_ns, now_ns, now_ns, 0, bodies))
        reasons.append({body.reason for body in checker.check(frame)})
    assert reasons == [{"tilted" if lean > math.radians(45.0) else ""} for lean in leans]


def test_a_list_is_a_mapping_of_its_bodies_by_name() -> None:
    bodies = {f"b{k}": (k, *single([0.1 * k] * 8), k % 2) for k in range(5)}
    listed = Listed(tuple(bodies), b"".join(BODY.pack(*body) for body in bodies.values()))
    assert listed == bodies
    assert list(listed.items()) == list(bodies.items())
    assert (len(listed), "b3" in listed, "b5" in listed) == (5, True, False)
    assert (listed.get("b3"), listed.get("b5"), listed.get("b5", "none")) == (bodies["b3"], None, "none")
    assert [*listed.sighted()] == [body[1:] for body in bodies.values()]
    assert [*listed.placed()] == [body[1:8] for body in bodies.values()]
    assert (dict(Listed((), b"")), *Listed((), b"").sighted()) == ({},)


@pytest.mark.parametrize("ids", [(1, 256), (1, 65536), (1, 1 << 24)])
def test_frames_whose_ids_differ_in_one_byte_are_told_apart(ids: tuple[int, int]) -> None:
    first, other = (BODY.pack(identity, *[0.0] * 8, 1) for identity in ids)
    assert ids_of(first + other) != ids_of(first + first) == ids_of(first + first)
