"""What must not change anything: the frame, the numbering, a far robot; and what must not break anything."""

import math
from collections.abc import Callable, Iterator

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from contract.messages import BodyPose, MocapFrame
from groundstation.conditions import FIELD
from groundstation.lockstep import World
from groundstation.sweep import Job, arena_for
from groundstation.targets import Scenario
from onboard.agent import Agent
from onboard.ahdc.field_law import FieldLaw
from onboard.ahdc.links import Entry, Link
from onboard.ahdc.neighbours import critical_robots, neighbours, noncritical_robots
from onboard.ahdc.plan import Motion
from onboard.ahdc.topology import polygon_groups
from onboard.ahdc.view import Goal, Heard, Sighted, View
from onboard.unicycle import steer
from tests.onboard.samples import arena, field_parameters, state

Point = tuple[float, float]
PARAMETERS = field_parameters()
near = st.floats(-0.95, 0.95)
points = st.tuples(near, near)
rims = st.floats(-0.8, 0.8)


class Frame:
    """A turn about the origin, then a shift."""

    def __init__(self, angle_rad: float, shift: Point) -> None:
        self.angle_rad, self.shift = angle_rad, shift

    def turn(self, v: Point) -> Point:
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return (c * v[0] - s * v[1], s * v[0] + c * v[1])

    def __call__(self, p: Point) -> Point:
        x, y = self.turn(p)
        return (x + self.shift[0], y + self.shift[1])


class Scene:
    """A robot, its goal, and others with announced stop points."""

    def __init__(self, motion: Motion, goal: Point, others: dict[str, tuple[Point, Point]], age_s: float) -> None:
        self.motion, self.goal, self.others, self.age_s = motion, goal, others, age_s

    def command(self, frame: Frame, order: Callable[[list[str]], list[str]] = list) -> tuple[float, float]:
        """The field law's rim speeds, seen from that frame and with the others in that order."""
        law = FieldLaw("r01", 1, PARAMETERS, 0.01, steer)
        law.joined = True
        sighted, heard = {}, {}
        for name in order(sorted(self.others)):
            place, v = self.others[name]
            (x, y), (vx, vy) = frame(place), frame.turn(v)
            law.links.entries[name] = Entry(Link.ON)
            stop = frame((place[0] + 0.2 * v[0], place[1] + 0.2 * v[1]))
            sighted[name] = Sighted(x, y, vx, vy, self.age_s, True)
            told = state(name, x, y, vx_mps=vx, vy_mps=vy, stop_long=stop, stop_short=stop)
            heard[name] = Heard(told, self.age_s, False)
        (x, y), heading = frame(self.motion[:2]), self.motion.heading_rad + frame.angle_rad
        motion = Motion(x, y, heading, *self.motion[3:])
        view = View(1.0, motion, sighted, heard, {}, 0.0, True)
        return law.command(view, Goal(frame(self.goal), 0.0, "target"), None)[:2]

    def nudged(self) -> "Iterator[Scene]":
        """The scene with goal, heading and others a little off: where they change much, it is a matter of rounding."""
        x, y, heading, left, right = self.motion
        for by in (-1e-7, 1e-7):
            yield Scene(self.motion._replace(heading_rad=heading + by), self.goal, self.others, self.age_s)
            for dx, dy in ((by, 0.0), (0.0, by)):
                yield Scene(self.motion, (self.goal[0] + dx, self.goal[1] + dy), self.others, self.age_s)
                yield Scene(Motion(x + dx, y + dy, heading, left, right), self.goal, self.others, self.age_s)


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    others = draw(st.lists(st.tuples(points, st.tuples(rims, rims)), min_size=0, max_size=4))
    motion = Motion(0.0, 0.0, draw(st.floats(-3.0, 3.0)), draw(rims), draw(rims))
    named = {f"r{k + 2:02d}": other for k, other in enumerate(others)}
    assume(all(math.hypot(*place) > 0.15 for place, _ in others))
    goal = draw(points)
    assume(math.hypot(*goal) > 1e-6)  # nearer, a shift rounds it onto the robot
    return Scene(motion, goal, named, draw(st.floats(0.0, 0.15)))


SAME = Frame(0.0, (0.0, 0.0))


@given(scenes(), st.floats(-3.0, 3.0), st.tuples(st.floats(-5, 5), st.floats(-5, 5)))
def test_a_turned_and_shifted_arena_changes_no_command(scene: Scene, angle_rad: float, shift: Point) -> None:
    plain = scene.command(SAME)
    assume(all(nudged.command(SAME) == pytest.approx(plain, abs=1e-3) for nudged in scene.nudged()))
    assert scene.command(Frame(angle_rad, shift)) == pytest.approx(plain, abs=1e-5)


@given(scenes())
def test_the_order_in_which_others_are_known_changes_no_link(scene: Scene) -> None:
    """Yielding to near robots goes one after the other, so only robots farther than that are reordered."""
    assume(all(math.hypot(*place) > 0.61 for place, _ in scene.others.values()))
    backwards = scene.command(SAME, lambda names: names[::-1])
    assert backwards == pytest.approx(scene.command(SAME), abs=2e-3)


@given(st.lists(st.tuples(st.floats(0, 2), st.floats(0, 2)), min_size=2, max_size=7, unique=True), st.floats(-3, 3))
def test_graphs_do_not_know_the_frame(places: list[Point], angle_rad: float) -> None:
    """Neighbour sets and polygon groups in a turned, shifted, mirrored and renumbered arena; off by no link's end."""
    gaps = [math.dist(a, b) for i, a in enumerate(places) for b in places[:i]]
    assume(all(abs(gap - edge) > 1e-9 for gap in gaps for edge in (0.8, 1.0)))
    frame = Frame(angle_rad, (3.0, -2.0))

    def sets(
        positions: list[Point], name: Callable[[int], str]
    ) -> list[tuple[set[int], set[int], set[frozenset[int]]]]:
        back = {name(k): k for k in range(len(positions))}
        found = []
        for k, own in enumerate(positions):
            others = {name(j): p for j, p in enumerate(positions) if j != k}
            distances = neighbours(own, others, 1.0)
            heard = {a: {b for b in others if b != a and math.dist(others[a], others[b]) <= 1.0} for a in distances}
            groups = {frozenset(back[m] for m in group) for group in polygon_groups(name(k), set(distances), heard)}
            critical = critical_robots(distances, others, 0.8)
            found.append(({back[m] for m in distances}, {back[m] for m in critical}, groups))
        return found

    plain = sets(places, lambda k: f"r{k}")
    assert sets([frame(p) for p in places], lambda k: f"r{k}") == plain
    assert sets([(-x, y) for x, y in places], lambda k: f"r{k}") == plain
    assert sets(places, lambda k: f"r{9 - k}") == plain


@given(st.lists(st.tuples(st.floats(0, 2), st.floats(0, 2)), min_size=2, max_size=8, unique=True))
def test_on_equal_views_both_ends_agree_whether_a_link_is_critical(places: list[Point]) -> None:
    everybody = {f"r{k}": p for k, p in enumerate(places)}
    critical, noncritical = {}, {}
    for name, own in everybody.items():
        others = {other: p for other, p in everybody.items() if other != name}
        distances = neighbours(own, others, 1.0)
        critical[name] = critical_robots(distances, others, 0.8)
        noncritical[name] = noncritical_robots(distances, others, 0.8)
    for a in everybody:
        assert all(a in critical[b] for b in critical[a])
        assert all(a in noncritical[b] for b in noncritical[a])


def frame_of(number: int, poses: dict[str, tuple[float, float, float]]) -> MocapFrame:
    at_ns = number * 10_000_000
    bodies = tuple(BodyPose(robot=name, x_m=x, y_m=y, heading_rad=h) for name, (x, y, h) in poses.items())
    return MocapFrame(
        session=1, frame=number, exposure_ns=at_ns, transmit_ns=at_ns, publish_ns=at_ns, rate_hz=100.0, bodies=bodies
    )


@given(st.floats(1.6, 30.0), st.floats(-30.0, 30.0), st.booleans())
def test_a_far_robot_changes_nothing(x: float, y: float, speaks: bool) -> None:
    """Whatever a robot beyond r_c does and says, the others' commands and messages are the same."""

    def told(far: Point, says: bool) -> list[object]:
        agent = Agent(arena(robots=3), "r01", boot=1)
        said: list[object] = []
        for number in range(12):
            now_ns = number * 10_000_000 + 1000
            if says:
                agent.receive(state("r03", *far, seq=number + 1, stamp_ns=now_ns), now_ns)
            agent.receive(state("r02", 0.9, 0.5, seq=number + 1, stamp_ns=now_ns), now_ns)
            agent.receive(
                frame_of(number, {"r01": (0.5, 0.5, 0.0), "r02": (0.9, 0.5, 0.0), "r03": (*far, 0.0)}), now_ns
            )
            said.append(agent.step(now_ns))
            said += [message for key, message in agent.outbox(now_ns) if key.endswith(("state", "steps"))]
        return said

    assert told((x, y), speaks) == told((9.0, 9.0), False)


@pytest.mark.parametrize("place", [(0.0, 0.0), (1e-12, 0.0), (0.5, 0.0)])
@pytest.mark.parametrize("goal", [(0.0, 0.0), (1e-12, 0.0), (0.5, 0.0)])
def test_coincident_robots_and_goals_give_finite_commands(place: Point, goal: Point) -> None:
    scene = Scene(Motion(0.0, 0.0, 0.0, 0.3, 0.3), goal, {"r02": (place, (0.0, 0.0)), "r03": (place, (0.0, 0.0))}, 0.05)
    assert all(math.isfinite(speed) and abs(speed) <= 0.8 for speed in scene.command(SAME))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("who", ["r01", "r02"])
def test_a_pose_that_is_no_number_turns_no_wheel(bad: float, who: str) -> None:
    agent = Agent(arena(robots=2), "r01", boot=1)
    poses = {"r01": (0.5, 0.5, 0.0), "r02": (0.9, 0.5, 0.0)}
    for number in range(6):
        now_ns = number * 10_000_000
        wrong = poses | {who: (bad, 0.5, 0.0)} if number >= 3 else poses
        agent.receive(frame_of(number, wrong), now_ns)
        drive = agent.step(now_ns)
        assert (drive.left_radps, drive.right_radps) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("starts", "targets"),
    [
        (((1.0, 1.0),), ((1.7, 1.6), (1.2, 1.0))),
        (((1.0, 1.0), (1.4, 1.0)), ((2.0, 1.0),)),
        (((1.0, 1.0), (1.4, 1.0)), ((1.0, 1.0), (1.6, 1.5))),
    ],
    ids=["one robot alone", "two robots", "a target on a robot"],
)
def test_the_smallest_missions_complete(starts: tuple[Point, ...], targets: tuple[Point, ...]) -> None:
    job = Job(len(starts), len(targets), 1, "field", "field", 40.0)
    place = Scenario((4.0, 5.0), starts, targets, 0.7)
    result = World(arena_for(job), place, FIELD, 1, 40.0).run()
    assert result.completed, result.why
    assert (result.disconnected_steps, result.collisions) == (0, 0)
