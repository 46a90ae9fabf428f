"""Runs the handbook as a reader would: its blocks in order, in one folder, on free ports."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from groundstation.ports import free_ports
from tests.house.checkout import ROOT

FOLDER = ROOT / "docs" / "handbook"
PAGES = ("first-hour", "one-robot", "optitrack", "two-robots", "six-robots", "report", "law")
"""In a reader's order, those with commands to run."""
QUICK = ("one-robot", "optitrack", "six-robots")
"""Those without a mission."""
READY_S, PATIENCE_S = 60.0, 120.0
KIT = """#!/bin/sh
verb=$1; shift
case $verb in
  exec) command=$1; shift; exec "$command" "$@" ;;
  demo) exec ahdc-groundstation demo "$@" ;;
esac
"""
COMMAND = """#!{python}
import sys
sys.path.insert(0, {root!r})
if __name__ == "__main__":
    from {room}.cli import main
    sys.exit(main())
"""


class Block(NamedTuple):
    """A fenced block: the words after the backticks, and what is in it."""

    kind: str
    text: str


def blocks(page: Path) -> list[Block]:
    """Every fenced block of a page, its indentation taken off."""
    found = re.findall(r"^( *)```([^\n`]*)\n(.*?)^\1```$", page.read_text(), re.DOTALL | re.MULTILINE)
    return [Block(kind, re.sub(rf"^{indent}", "", text, flags=re.MULTILINE)) for indent, kind, text in found]


class Reader:
    """Somebody in a clone, whose kit is built already.

    :param folder: stands for the clone.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        tcp, command, data = free_ports(3)
        self.usual = {
            "/tmp/lab": str(folder / "lab"),
            "7447": str(tcp),
            "1510": str(command),
            "1511": str(data),
        }
        self._background: list[subprocess.Popen[bytes]] = []
        (folder / "kit").write_text(KIT)
        (folder / "bin").mkdir()
        for name in ("groundstation", "onboard", "drivers", "mocap_bridge"):
            path = folder / "bin" / f"ahdc-{name.replace('_', '-')}"
            path.write_text(COMMAND.format(python=sys.executable, root=str(ROOT), room=name))
            path.chmod(0o755)
        (folder / "kit").chmod(0o755)
        for name, there in (
            (".venv", Path(sys.prefix)),
            ("groundstation", ROOT / "groundstation"),
            ("bench", ROOT / "bench"),
        ):
            (folder / name).symlink_to(there)
        self.environment = {
            **os.environ,
            "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
            "XDG_STATE_HOME": str(folder / "state"),
            "PYTHONUNBUFFERED": "1",
        }

    def follow(self, page: Path) -> None:
        """Save the files of a page and type its commands; what is left running ends with it."""
        try:
            for block in blocks(page):
                name = re.match(r"# (\S+\.toml)\n", block.text)
                if block.kind == "toml" and name:
                    self._save(name[1], block.text)
                elif block.kind == "sh":
                    for line in block.text.splitlines():
                        self.type(line)
        finally:
            self.end()

    def _save(self, name: str, text: str) -> None:
        for usual, own in self.usual.items():
            text = text.replace(usual, own)
        (self.folder / name).write_text(text)

    def type(self, line: str, refusal: str = "") -> str:
        """Run one line as it stands; output. AssertionError where it fails.

        :param refusal: to be in the output; an exit code of 1 is an answer then, too.
        """
        command, _, remark = line.replace("/tmp/lab", self.usual["/tmp/lab"]).partition("   # until: ")
        if command.rstrip().endswith("&"):
            self._start(command.rstrip().removesuffix("&").strip())
            return ""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            done = subprocess.run(
                ["bash", "-ec", command],
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                check=False,
            )
            print(f"$ {command}\n{done.stdout}")
            good = (0, 1) if refusal and refusal in done.stdout else (0,)
            assert done.returncode in good, f"{command}: ended with {done.returncode}\n{done.stdout}\n{self.words()}"
            assert refusal in done.stdout, f"{command}: does not say {refusal!r}\n{done.stdout}"
            if not remark or remark.strip() in done.stdout:
                return done.stdout
            assert time.monotonic() < deadline, f"{command}: never said {remark!r}\n{done.stdout}\n{self.words()}"
            time.sleep(0.2)

    def _start(self, command: str) -> None:
        log = self.folder / f"background-{len(self._background)}.log"
        with log.open("wb") as sink:
            process = subprocess.Popen(
                ["bash", "-c", f"exec {command.removeprefix('./kit exec ')}"],
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=subprocess.STDOUT,
                preexec_fn=lambda: os.nice(-10 if os.geteuid() == 0 else 0),
            )
        self._background.append(process)
        deadline = time.monotonic() + READY_S
        while not log.read_bytes().strip():
            assert process.poll() is None, f"{command} ended with {process.returncode}"
            assert time.monotonic() < deadline, f"{command} says nothing"
            time.sleep(0.05)

    def words(self) -> str:
        """What runs in the background has said."""
        return "\n".join(
            path.read_text(errors="replace")[-600:] for path in sorted(self.folder.glob("background-*.log"))
        )

    def end(self) -> None:
        """End what runs in the background, the last first."""
        for process in reversed(self._background):
            process.send_signal(signal.SIGTERM)
        for process in self._background:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(5.0)
            process.kill()
            process.wait()
        self._background.clear()
