"""Six families on six robots over real bytes, plugs pulled in the middle. The whole is in tests/prove."""

from plugs import SIX, Puller, judge, six_families


def test_six_families_drive_one_mission_and_survive_pulled_plugs() -> None:
    world = six_families(1)
    puller = Puller(world, seed=1)
    puller.run(2.0)
    assert [robot.wheels["kind"] for robot in world.arena.robots.values()] == list(SIX)
    assert {agent.run_state for agent in world.agents.values()} == {"running"}
    refused = {
        hop: {n for n in counters if not n.startswith("gate_")} for hop, counters in world.hops.counters().items()
    }
    assert not any(names - {"below_min_erpm"} for names in refused.values()), refused
    pulls = [puller.pull() for _ in range(4)]
    for pull in pulls:
        judge(pull)
    assert {pull.how for pull in pulls} == {"unplug", "kill", "bus-off"}
    assert world.result(False).occupied >= 1
