"""One robot, every hop real bytes: walk, STOP from another process, release, restart of the robot."""

import os
import signal
from pathlib import Path

from tests.arena.conftest import Running, alive, is_zero, open_files


def test_it_moves_and_its_process_holds_the_pty(one: Running) -> None:
    one.until(lambda: one.moving("r06"), "r06 moves")
    child = next(child for child in one.rig.family.children if child.name == "r06")
    pty = Path(one.arena.robots["r06"].wheels["channel"]).resolve()
    assert str(pty) in open_files(child.pid)
    assert child.pid != os.getpid()
    assert any(sample.enabled and not is_zero(sample) for sample in one.samples["r06"])
    assert one.reports["r06"].links_on == ()


def test_stop_from_another_process(one: Running) -> None:
    one.until(lambda: one.moving("r06"), "r06 moves")
    process = one.command("stop", "--arena", str(one.rig.config))
    one.until(lambda: process.poll() is not None, "stop returns")
    said = process.stdout.read()
    assert process.returncode == 0, said
    assert "r06  stopped" in said
    one.until(lambda: one.at_rest() and one.session.phase == "stopped", "wheels rest", 3.0)
    one.until(lambda: not one.feedback["r06"].enabled, "motors disabled", 3.0)
    commands = one.samples["r06"]
    first_zero = max(index for index, sample in enumerate(commands) if not is_zero(sample)) + 1
    assert any(sample.enabled for sample in commands[first_zero:]), "STOP brakes under control before it disables"
    assert one.reports["r06"].run == "stopped"
    assert "terminal" in one.reports["r06"].reason


def test_a_stopped_robot_refuses_arm_and_start(one: Running) -> None:
    one.drop_samples()
    for verb in ("arm", "start"):
        process = one.command(verb, "--arena", str(one.rig.config), "--wait", "0.5")
        one.until(lambda process=process: process.poll() is not None, f"{verb} returns")
        assert process.returncode == 1, process.stdout.read()
    assert one.reports["r06"].run == "stopped"
    assert all(is_zero(sample) for sample in one.samples["r06"])


def test_release_arms_nothing_then_arm_and_start_work(one: Running) -> None:
    for verb, state in (("release", "disarmed"), ("arm", "armed")):
        one.drop_samples()
        process = one.command(verb, "--arena", str(one.rig.config))
        one.until(lambda process=process: process.poll() is not None, f"{verb} returns")
        assert process.returncode == 0, process.stdout.read()
        one.until(lambda state=state: one.reports["r06"].run == state, f"r06 reports {state}")
        assert all(is_zero(sample) for sample in one.samples["r06"])
    process = one.command("start", "--arena", str(one.rig.config))
    one.until(lambda: one.moving("r06") or one.session.phase == "completed", "r06 moves again")
    one.until(lambda: process.poll() is not None, "start returns")
    assert process.returncode == 0, process.stdout.read()


def test_a_hung_robot_process_is_cut_and_not_confirmed(one: Running) -> None:
    one.until(lambda: one.moving("r06"), "r06 moves")
    child = next(child for child in one.rig.family.children if child.name == "r06")
    child.signal(signal.SIGSTOP)
    try:
        one.until(lambda: any(sample.released for sample in one.samples["r06"]), "the device watchdog lets go", 3.0)
        one.until(one.at_rest, "the wheels have coasted to rest", 5.0)
        process = one.command("stop", "--arena", str(one.rig.config))
        one.until(lambda: process.poll() is not None, "stop returns")
        said = process.stdout.read()
        assert process.returncode == 1, said
        assert "STOP NOT CONFIRMED by r06" in said
    finally:
        child.signal(signal.SIGCONT)
    one.until(lambda: one.reports["r06"].run == "stopped", "the robot obeys once it runs again", 5.0)
    assert one.at_rest()


def test_a_killed_robot_process_neither_moves_nor_rearms(one: Running) -> None:
    child = next(child for child in one.rig.family.children if child.name == "r06")
    child.signal(signal.SIGKILL)
    assert child.wait(5.0)
    assert not alive(child.pid)
    one.rig.family.children.remove(child)
    child.close()
    killed = one.reports["r06"].boot
    again = one.rig.start_robot("r06")
    one.session.order("disarm", 0)
    one.drop_samples()
    one.until(lambda: again.ready and one.reports["r06"].boot != killed, "r06 reports again")
    assert one.reports["r06"].run == "disarmed"
    assert all(is_zero(sample) and not sample.enabled for sample in one.samples["r06"])


def test_every_process_ends_well(one: Running) -> None:
    one.rig.family.check()
    codes = one.rig.end()
    assert set(codes.values()) == {0}, codes
    assert not (one.out / "ports").exists()
