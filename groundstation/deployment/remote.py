"""The way to a robot's computer: ssh and rsync, nothing remembered between two steps."""

import os
import subprocess
from pathlib import Path

from groundstation.deployment.plan import Copy, Step

OPTIONS = (
    "-o",
    "BatchMode=yes",
    "-o",
    "ConnectTimeout=5",
    "-o",
    "ServerAliveInterval=5",
    "-o",
    "ServerAliveCountMax=3",
)


class Ssh:
    """One computer.

    :param options: more words for ssh, such as ``-i KEY``.
    """

    def __init__(self, host: str, user: str, port: int, options: tuple[str, ...] = ()) -> None:
        self._command = ["ssh", *OPTIONS, "-p", str(port), *options]
        self._where = f"{user}@{host}"
        self._shell = "sh -s" if user == "root" else "sudo -n sh -s"
        self._rsync = "rsync" if user == "root" else "sudo -n rsync"
        bare = host.strip("[]")
        self._target = f"{user}@[{bare}]" if ":" in bare else self._where

    def __call__(self, step: Step) -> tuple[int, str]:
        """Do a step: its copies, then its script; (exit code, both streams)."""
        said = ""
        for copy in step.copies:
            code, text = run(self._copying(copy), "", step.timeout_s)
            said += text
            if code:
                return code, said
        if step.script:
            code, text = run([*self._command, self._where, self._shell], step.script, step.timeout_s)
            return code, said + text
        return 0, said

    def _copying(self, copy: Copy) -> list[str]:
        options = [
            "-rlt",
            "--checksum",
            "--chmod=D750,F640",
            f"--rsync-path={self._rsync}",
            "-e",
            " ".join(self._command),
        ]
        delete = ["--delete"] if copy.delete else []
        return ["rsync", *options, *delete, f"{copy.source}/", f"{self._target}:{copy.target}/"]


class Here:
    """This computer in place of a robot's: for tests, below a folder of their own."""

    def __init__(self, path: str) -> None:
        self._environment = {**os.environ, "PATH": path}

    def __call__(self, step: Step) -> tuple[int, str]:
        for copy in step.copies:
            delete = ["--delete"] if copy.delete else []
            code, text = run(
                ["rsync", "-rlt", "--checksum", *delete, f"{copy.source}/", f"{copy.target}/"], "", step.timeout_s
            )
            if code:
                return code, text
        return run(["sh", "-s"], step.script, step.timeout_s, self._environment) if step.script else (0, "")


def run(command: list[str], text: str, timeout_s: float, environment: dict[str, str] | None = None) -> tuple[int, str]:
    """A command with ``text`` on its standard input."""
    try:
        done = subprocess.run(
            command,
            input=text or None,
            stdin=None if text else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=timeout_s,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        heard = error.stdout.decode(errors="replace") if isinstance(error.stdout, bytes) else error.stdout or ""
        return 124, f"{heard}\nno answer within {timeout_s:g} s"
    except OSError as error:
        return 127, f"{Path(command[0]).name}: {error.strerror}"
    return done.returncode, done.stdout
