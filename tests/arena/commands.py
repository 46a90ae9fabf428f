"""Every command that the documentation names, and the test that runs it; whatever stands nowhere here fails a test."""

import re
from pathlib import Path
from typing import NamedTuple

from groundstation.cli import VERBS as STATION
from tests.arena.handbook import FOLDER, PAGES, blocks
from tests.house.checkout import ROOT, tracked

VERBS = {*STATION, "run", "check", "failsafes", "list", "jog", "identify", "emulate"}
"""Of all rooms' commands; the text names some without their room: ``keys issue r06``."""
TOOL = re.compile(
    r"(\./kit|ahdc-[a-z-]+|pip|ssh|scp|systemctl|journalctl|sudo|ip|source|cp|python|AHDC_\w+=\w+|tests/\S+\.sh) \S"
)


class Way(NamedTuple):
    """How a command of the text is typed where it has placeholders, and what it may answer."""

    typed: str
    says: str = ""
    """Must be in the output; with it a refusal (exit code 1) is an answer, too."""


SWEEP = "--robots 6 --targets 19 --runs 100 --conditions field --workers 2 --json sweep.json"
BESIDE_IT = "trap 'kill $!' EXIT;"
"""Ends what was begun in the background, however the line ends."""
FIT = "cp lab.toml fit.toml && ahdc-groundstation calibrate lab1/run.mcap --arena fit.toml --robot r06"
SHORT = f"echo n | ({FIT}) 2>&1 | grep -E 'drive|nothing written'"
"""The mission of two robots is short: that too little was driven is an answer, too, and so is a no."""
ALONE: dict[str, Way] = {
    "source .venv/bin/activate": Way("source .venv/bin/activate && ahdc-groundstation --help"),
    "ahdc-groundstation --help": Way("ahdc-groundstation --help"),
    "cp groundstation/arenas/bench2.toml lab.toml": Way("cp groundstation/arenas/bench2.toml bench2.toml"),
    "./kit demo --arena lab.toml": Way("./kit demo --arena bench2.toml --headless --out bench2"),
    "./kit demo [--headless] [--arena FILE] [--seed N] [--robots N] [--targets M] [--out DIR]": Way(
        "./kit demo --headless --arena experiment1 --seed 2 --robots 2 --targets 2 --out run3"
    ),
    "ahdc-drivers list": Way("ahdc-drivers list"),
    "ahdc-drivers list KIND": Way("ahdc-drivers list vesc"),
    "ahdc-drivers emulate KIND --port-link /tmp/wheels": Way(
        "ahdc-drivers emulate roboclaw --port-link /tmp/lab/wheels &"
    ),
    "ahdc-drivers jog FILE --robot r06": Way(
        f"{BESIDE_IT} ahdc-drivers emulate odrive --port-link /tmp/lab/r06 & "
        "sleep 2; echo www | ahdc-drivers jog lab.toml --robot r06",
        "let go and it stops",
    ),
    "ahdc-drivers identify FILE --robot r06": Way(
        f"{BESIDE_IT} ahdc-drivers emulate odrive --port-link /tmp/lab/r06 & "
        "sleep 2; printf 'lf\\nrf\\n' | ahdc-drivers identify lab.toml --robot r06",
        "both wheels are as the arena file says",
    ),
    "ahdc-groundstation metrics RUN": Way("ahdc-groundstation metrics run1"),
    "ahdc-groundstation report RUN": Way("ahdc-groundstation report run1"),
    "ahdc-groundstation report RUN...": Way("ahdc-groundstation report run1 lab1 --page compared.html"),
    "report run1 run2": Way("ahdc-groundstation report run1 lab1 --page compared.html"),
    "replay --check": Way("ahdc-groundstation replay --check run1"),
    "ahdc-groundstation replay --check RUN": Way("ahdc-groundstation replay --check run1"),
    "ahdc-groundstation page --replay RUN": Way("ahdc-groundstation page --replay run1 --port 0 &"),
    "ahdc-groundstation foxglove RUN": Way("ahdc-groundstation foxglove run1"),
    "ahdc-groundstation recover": Way("ahdc-groundstation recover run1/run.mcap --out whole.mcap"),
    "ahdc-groundstation recover FILE --out FILE": Way("ahdc-groundstation recover lab1/run.mcap --out also-whole.mcap"),
    "ahdc-groundstation calibrate lab1/run.mcap --arena lab.toml --robot r06 --yes": Way(f"{FIT} --yes || {SHORT}"),
    "ahdc-groundstation calibrate run.mcap --arena FILE --robot r06": Way(f"echo n | {FIT} || {SHORT}"),
    "ahdc-groundstation topics --markdown": Way("ahdc-groundstation topics --markdown"),
    "ahdc-onboard failsafes": Way("ahdc-onboard failsafes"),
    "ahdc-onboard doctor": Way("ahdc-onboard doctor"),
    "ahdc-onboard doctor --jitter": Way("ahdc-onboard doctor --jitter --turns 1 --seconds 0.2"),
    "ahdc-groundstation simulate": Way("ahdc-groundstation simulate --robots 2 --targets 2 --runs 1 --workers 1"),
    "simulate --profile paper --conditions ideal": Way(
        "ahdc-groundstation simulate --profile paper --conditions ideal --robots 2 --targets 2 --runs 1 --workers 1"
    ),
    f"ahdc-groundstation simulate {SWEEP}": Way(
        f"ahdc-groundstation simulate {SWEEP.replace('6 --targets 19 --runs 100', '3 --targets 4 --runs 2')}"
    ),
    "ahdc-groundstation simulate --runs 1 --seed 7 --conditions field --pose-age-ms 20:150 --loss 0.3 --save kept": Way(
        "ahdc-groundstation simulate --runs 1 --seed 7 --conditions field --pose-age-ms 20:150 --loss 0.3 --save kept"
    ),
    "ahdc-groundstation report kept/seed-7": Way("ahdc-groundstation report kept/seed-7"),
    "ahdc-groundstation faults": Way("ahdc-groundstation faults --rows unplugged"),
    "ahdc-groundstation faults --repetitions N --progress DIR --markdown docs/fault-matrix.md": Way(
        "ahdc-groundstation faults --rows unplugged --repetitions 1 --progress rows --markdown matrix.md"
    ),
    "ahdc-groundstation experiment FILE.toml": Way("ahdc-groundstation experiment small.toml --out trials"),
    "ahdc-groundstation experiment FILE.toml --out DIR": Way("ahdc-groundstation experiment small.toml --out trials"),
    "ahdc-mocap-bridge emulate": Way("ahdc-mocap-bridge emulate --seconds 0.5 --ports 0 0"),
    "emulate --help": Way("ahdc-mocap-bridge emulate --help"),
    "ahdc-mocap-bridge emulate --bodies 6 --rate 240 --version 3.1 --multicast 239.255.42.99": Way(
        "ahdc-mocap-bridge emulate --bodies 6 --rate 240 --version 3.1 --multicast 239.255.42.99 --seconds 0.5 "
        "--ports 0 0"
    ),
    "ahdc-mocap-bridge emulate --arena lab.toml --script faults.txt": Way(
        "echo '0 1 occlusion r06' > faults.txt; "
        "ahdc-mocap-bridge emulate --arena lab.toml --script faults.txt --seconds 0.5"
    ),
    "ahdc-mocap-bridge record --arena FILE --out session.mcap": Way(
        "ahdc-mocap-bridge emulate --arena lab.toml --seconds 8 & "
        "ahdc-mocap-bridge record --arena lab.toml --out session.mcap --seconds 3; wait"
    ),
    "ahdc-mocap-bridge emulate --arena lab.toml --recording session.mcap": Way(
        "ahdc-mocap-bridge emulate --arena lab.toml --recording session.mcap --seconds 2"
    ),
    "ahdc-groundstation radio --out DIR": Way(
        "ahdc-groundstation radio --out radio --loss 0.05 --jitter 0 --protocol quic --robots 2 --targets 2"
    ),
    "run --allow-replay": Way("ahdc-mocap-bridge run --arena lab.toml --allow-replay &"),
    "./kit exec python bench/NAME.py": Way(
        "for bench in bench/*.py; do [ $bench = bench/bare_chain.py ] || python $bench --help; done; "
        "python bench/natnet_decode.py"
    ),
    "ahdc-mocap-bridge record --arena lab.toml --out floor.mcap": Way(
        "ahdc-mocap-bridge emulate --arena lab.toml --seconds 8 & "
        "ahdc-mocap-bridge record --arena lab.toml --out floor.mcap --seconds 3; wait"
    ),
    "ahdc-groundstation doctor --arena lab6.toml": Way(
        f"{BESIDE_IT} ahdc-groundstation router --arena site.toml & "
        "sleep 3; ahdc-groundstation doctor --arena site.toml",
        "certificate",
    ),
    "keys issue r06 --replace": Way("ahdc-groundstation keys issue r06 --replace --arena site.toml"),
    "keys issue router --replace": Way("ahdc-groundstation keys issue router --replace --arena site.toml"),
    "keys revoke r06": Way("ahdc-groundstation keys revoke r06 --arena site.toml"),
    "keys issue r06": Way("ahdc-groundstation keys issue r06 --arena site.toml"),
}
"""Typed one after the other in the reader's folder, once the handbook has been followed."""
SMALL = """name = "small"
backend = "lockstep"
robots = [2]
targets = [2]
seeds = [1]
"""
SITE = (
    "ahdc-mocap-bridge run --arena lab.toml &",
    "ahdc-groundstation record --arena lab.toml --out runs/lab &",
    "ahdc-groundstation mock-arena --arena lab.toml &",
    "ahdc-onboard run --arena lab.toml --robot r06 &",
    "ahdc-onboard run --arena lab.toml --robot r08 &",
    "ahdc-groundstation session --arena lab.toml --quorum 1 --mission again --override disk_low &",
    "ahdc-groundstation page --port 0 &",
)
BESIDE: dict[str, Way] = {
    "ahdc-groundstation doctor --arena FILE": Way("ahdc-groundstation doctor --arena lab.toml"),
    "ahdc-groundstation status": Way("ahdc-groundstation status"),
    "ahdc-groundstation watch": Way("ahdc-groundstation watch --once"),
    "ahdc-groundstation fleet status": Way("ahdc-groundstation fleet status"),
    "fleet logs": Way("ahdc-groundstation fleet logs --wait 1"),
    "fleet version": Way("ahdc-groundstation fleet version"),
    "ahdc-groundstation arm": Way("ahdc-groundstation arm"),
    "ahdc-groundstation start": Way("ahdc-groundstation start"),
    "ahdc-groundstation hold": Way("ahdc-groundstation hold"),
    "ahdc-groundstation stop": Way("ahdc-groundstation stop"),
    "ahdc-groundstation stop --arena FILE": Way("ahdc-groundstation stop --arena lab.toml"),
    "ahdc-groundstation release": Way("ahdc-groundstation release"),
    "seed --points X,Y...": Way("ahdc-groundstation seed --points 1.2,1.2 1.6,1.4"),
    "exclude ROBOT...": Way("ahdc-groundstation exclude r08"),
    "ahdc-groundstation exclude r09": Way("ahdc-groundstation exclude r08"),
    "readmit ROBOT...": Way("ahdc-groundstation readmit r08"),
    "ahdc-groundstation home": Way("ahdc-groundstation home"),
    "ahdc-groundstation repeat": Way("ahdc-groundstation repeat"),
}
"""Typed in this order beside ``SITE``."""
SAID_BY_SITE = (
    "record --out runs/lab",
    "session --quorum N",
    "session --quorum 5",
    "session --mission NAME",
    "session --override NAME",
    "ahdc-groundstation mock-arena --arena FILE",
    "ahdc-groundstation session --arena lab.toml",
    "ahdc-mocap-bridge run --arena FILE",
    "ahdc-onboard run",
    "ahdc-groundstation page",
)
ELSEWHERE = {
    "ahdc-groundstation deploy": ("tests/prove/test_deploy.py", '"deploy"'),
    "ahdc-groundstation compile": ("tests/prove/test_compiled.py", '"groundstation", "compile"'),
    "scp lab6.toml": ("tests/prove/test_deploy.py", '"scp"'),
    "ssh r06 tar": ("tests/prove/test_deploy.py", '"tar", "-xpf"'),
    "systemctl status": ("tests/prove/test_deploy.py", "systemctl status"),
    "journalctl -u": ("tests/prove/test_deploy.py", "journalctl -u"),
    "pip install": ("tests/prove/test_platforms.py", "pip install"),
    "./kit prove": ("tests/house/test_kit.py", '["prove", "sweep", "-x"]'),
    "./kit test": ("tests/house/test_kit.py", '["test", "-m", "root"]'),
    "./kit lint": ("tests/house/test_kit.py", '["lint"]'),
    "./kit check": ("tests/house/test_kit.py", '["check"]'),
    "./kit exec": ("tests/house/test_kit.py", '["exec", "ahdc-drivers", "list"]'),
    "./kit --yes demo": ("tests/house/test_kit.py", '["--yes", "demo", "--headless"]'),
    "./kit demo": ("tests/arena/test_six_robots.py", '"demo"'),
    "ahdc-groundstation simulate --profile straight": ("tests/house/test_plugin.py", '"--profile", "straight"'),
    "AHDC_SHOTS=shots ./kit test": ("tests/root/test_gallery.py", "AHDC_SHOTS"),
    "ip link set can0 up type can bitrate 500000": ("tests/guest/socketcan_suite.py", "BIT_RATE"),
    "tests/guest/run-in-guest.sh": ("tests/guest/guest.py", "run-in-guest.sh"),
}
"""A command's beginning: the file that runs it, and what must stand there."""


COUNTERS = {"report replayed"}
"""What robots and station count begins with a verb here and there, too."""


def inline(text: str) -> set[str]:
    """Commands among the words set as code in a page's text."""
    words = re.findall(r"`([^`\n]+)`", re.sub(r"^ *```[^\n`]*\n.*?^ *```$", "", text, flags=re.DOTALL | re.MULTILINE))
    return {word for word in words if TOOL.match(word) or is_verb(word)}


def is_verb(word: str) -> bool:
    first, _, rest = word.partition(" ")
    return word not in COUNTERS and first in VERBS and bool(rest) and not rest.startswith("=")


def fenced(page: Path, *kinds: str) -> set[str]:
    """Commands in a page's blocks of these kinds, remarks taken off."""
    lines = [line for block in blocks(page) if block.kind in kinds for line in block.text.splitlines()]
    return {re.split(r" {2,}#", line)[0].strip() for line in lines if TOOL.match(line)}


def plain(command: str) -> str:
    """As it is typed: without kit in front, with the reader's files for those of the page."""
    for page, own in (("./kit exec ", ""), ("lab6.toml", "site.toml"), ("FILE", "lab.toml")):
        command = command.replace(page, own)
    return command.removesuffix(" &")


def documented() -> dict[str, str]:
    """Every command of every page, and a page that has it; the changelog tells of the past."""
    found = {}
    for page in tracked("*.md"):
        if page.name != "CHANGELOG.md":
            for command in inline(page.read_text()) | fenced(page, "", "bash", "sh", "sh by-hand", "sh elsewhere"):
                found[command] = str(page.relative_to(ROOT))
    return found


def typed() -> set[str]:
    """What a reader types who follows the handbook, then everything in the text."""
    pages = {plain(command) for page in PAGES for command in fenced(FOLDER / f"{page}.md", "sh")}
    return pages | {plain(command) for command in (*ALONE, *BESIDE, *SAID_BY_SITE)}


def unaccounted(commands: dict[str, str]) -> list[str]:
    """Commands that no test runs. A bare name stands for what is typed with its options."""
    run = typed()
    return sorted(
        f"{page}: {command}"
        for command, page in commands.items()
        if not any(line == plain(command) or line.startswith(f"{plain(command)} ") for line in run)
        and not any(
            plain(command).startswith(begin) or command.startswith(begin) for begin in set(ELSEWHERE) - {"./kit exec"}
        )
        and not re.fullmatch(r"\./kit exec( COMMAND.*)?", command)
    )
