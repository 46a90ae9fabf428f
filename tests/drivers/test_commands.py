"""The registry, ``ahdc-drivers``, and what importing a driver costs."""

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.cli import main
from drivers.registry import FAMILIES, module_of, wheel_faults

ARENA = """
[arena]
name = "bench"
size_m = [4.0, 4.0]
[robots.r06]
body = "a"
start = [1.0, 1.0]
wheels = {{ kind = "roboclaw", port = "/dev/ttyACM0", {option} = 2048 }}
"""


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.kind)
def test_every_option_of_every_family_is_explained(family, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", family.kind]) == 0
    lines = capsys.readouterr().out.splitlines()
    options = [index for index, line in enumerate(lines) if line.startswith("  ") and line[2] != " "]
    assert len(options) == len(module_of(family).Options.__struct_fields__) - 1
    for index in options:
        assert lines[index + 1].startswith("      "), f"{lines[index]} has no description"


def test_an_unknown_family_is_named_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    (fault,) = wheel_faults({"kind": "odrivve"}, "robots.r1.wheels")
    known = ", ".join(family.kind for family in FAMILIES)
    assert str(fault) == f'robots.r1.wheels.kind = "odrivve": needs one of {known} (did you mean "odrive"?)'
    assert wheel_faults({}, "w") == []
    assert main(["list", "robocaw"]) == 2
    assert 'did you mean "roboclaw"' in capsys.readouterr().out


def test_check_accepts_a_good_file_and_lists_the_faults_of_a_bad_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = tmp_path / "good.toml", tmp_path / "bad.toml"
    good.write_text(ARENA.format(option="counts_per_revolution"))
    bad.write_text(ARENA.format(option="counts"))
    assert main(["check", str(good)]) == 0
    assert "r06: RoboClaw packet serial on /dev/ttyACM0" in capsys.readouterr().out
    assert main(["check", str(bad)]) == 2
    text = capsys.readouterr().err
    assert "robots.r06.wheels.counts = 2048: unknown key" in text
    assert "robots.r06.wheels.counts_per_revolution: missing" in text


@pytest.mark.parametrize("verb", [[], ["list"], ["check"], ["emulate"]])
def test_help_teaches(verb: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main([*verb, "--help"])
    assert caught.value.code == 0
    assert len(capsys.readouterr().out) > 150


def test_emulate_refuses_a_bad_option_and_leaves_no_link(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    link = tmp_path / "rc"
    assert main(["emulate", "roboclaw", "--port-link", str(link), "--set", "bud=9600"]) == 2
    assert 'did you mean "baud"' in capsys.readouterr().err
    assert main(["emulate", "roboclaw", "--set", "baud"]) == 2
    assert not link.is_symlink()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_emulate_prints_its_path_serves_and_ends_cleanly(tmp_path: Path, number: int) -> None:
    link = tmp_path / "rc"
    command = [sys.executable, "-m", "drivers", "emulate", "roboclaw", "--port-link", str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().strip() == str(link)
        fd = os.open(link, os.O_RDWR | os.O_NOCTTY)
        os.write(fd, b"\x80\x15")
        text = b""
        while not text.endswith(b"\n\0", 0, -2):
            assert select.select([fd], [], [], 10.0)[0]
            text += os.read(fd, 100)
        assert b"Roboclaw" in text
        os.close(fd)
        process.send_signal(number)
        assert process.wait(10) == 0
    assert not link.is_symlink()


def test_a_serial_robot_does_not_import_python_can() -> None:
    code = (
        "import sys; from drivers.registry import open_drive; from contract.arena import Platform, Safety;"
        "open_drive('r1', {'kind': 'roboclaw', 'port': 'x', 'counts_per_revolution': 9}, Platform(), Safety());"
        "print(sorted({'can', 'numpy', 'asyncio', 'zenoh'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
