"""A robot's computer to deploy to: Debian, booted with systemd in a container, thrown away afterwards; needs root.

The system is made once by debootstrap and kept in the user's cache; a container changes a copy in memory. It has a
network of its own with this machine's end at ``STATION`` and its own at ``ADDRESS``, and an ssh server.
"""

import contextlib
import fcntl
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

PACKAGES = "systemd,systemd-sysv,dbus,udev,openssh-server,rsync,python3,python3-venv,procps,iproute2"
SUITE = "bookworm"
STATION, ADDRESS = "10.77.9.1", "10.77.9.2"
NAMESPACE = "ahdc-robot"
BOOT_S = 60.0


def cache() -> Path:
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "ahdc-fieldkit" / "robot-computer"


def run(*command: str, check: bool = True, text: str | None = None) -> str:
    done = subprocess.run(
        command, input=text, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", check=False
    )
    assert done.returncode == 0 or not check, f"{' '.join(command)} ended with {done.returncode}:\n{done.stdout}"
    return done.stdout


def install(program: str, *packages: str) -> None:
    if not shutil.which(program):
        run("apt-get", "-qq", "update")
        run(
            "env",
            "DEBIAN_FRONTEND=noninteractive",
            "apt-get",
            "-qq",
            "install",
            "-y",
            "--no-install-recommends",
            *packages,
        )


def system() -> Path:
    """The root file system, made at the first call (about two minutes)."""
    cache().mkdir(parents=True, exist_ok=True)
    whole = cache() / f"{SUITE}-2"
    with (cache() / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        install("systemd-nspawn", "systemd-container")
        install("debootstrap", "debootstrap")
        install("rsync", "rsync")
        install("ssh", "openssh-client")
        if not whole.is_dir():
            draft = whole.with_suffix(".draft")
            shutil.rmtree(draft, ignore_errors=True)
            run("debootstrap", "--variant=minbase", f"--include={PACKAGES}", SUITE, str(draft))
            for path in (draft / "var/cache/apt/archives").glob("*.deb"):
                path.unlink()
            draft.rename(whole)
    return whole


class RobotComputer:
    """A booted one.

    :param folder: for its ssh key and console.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.key = folder / "id"
        self.console = folder / "console.txt"
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def ssh(self) -> list[str]:
        """Options that ssh needs to get in."""
        known = f"UserKnownHostsFile={self.folder / 'known_hosts'}"
        return [f"-i{self.key}", "-oStrictHostKeyChecking=accept-new", f"-o{known}"]

    def boot(self) -> None:
        """Until its ssh server answers."""
        root = system()
        run("ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(self.key))
        _unlink()
        run("ip", "netns", "add", NAMESPACE)
        run("ip", "link", "add", "ahdc-s", "type", "veth", "peer", "name", "host0", "netns", NAMESPACE)
        run("ip", "addr", "add", f"{STATION}/24", "dev", "ahdc-s")
        run("ip", "link", "set", "ahdc-s", "up")
        run("ip", "-n", NAMESPACE, "addr", "add", f"{ADDRESS}/24", "dev", "host0")
        run("ip", "-n", NAMESPACE, "link", "set", "host0", "up")
        run("ip", "-n", NAMESPACE, "link", "set", "lo", "up")
        command = ["systemd-nspawn", "--quiet", f"--directory={root}", "--volatile=overlay", "--boot", "--register=no"]
        command += [
            "--keep-unit",
            "--console=pipe",
            "--hostname=robot",
            f"--network-namespace-path=/run/netns/{NAMESPACE}",
        ]
        command += [f"--bind-ro={self.key}.pub:/etc/ssh/robot_key.pub", "--bind=/dev/pts:/run/station-pts"]
        with self.console.open("wb") as console:
            self._process = subprocess.Popen(
                [
                    "setpriv",
                    "--pdeathsig",
                    "KILL",
                    "unshare",
                    "--pid",
                    "--fork",
                    "--kill-child",
                    "--mount-proc",
                    *command,
                ],
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
                process_group=0,
            )
        deadline = time.monotonic() + BOOT_S
        while time.monotonic() < deadline:
            assert self._process.poll() is None, self.console.read_text(errors="replace")
            if (
                self._let_in()
                and "up" in self.shell("systemctl is-system-running --wait; echo up", check=False).split()
            ):
                return
            time.sleep(0.3)
        raise AssertionError(f"no ssh after {BOOT_S:g} s:\n{self.console.read_text(errors='replace')[-4000:]}")

    def _let_in(self) -> bool:
        leader = self.leader()
        if leader is None:
            return False
        script = "mkdir -p -m 700 ~root/.ssh; install -m 600 /etc/ssh/robot_key.pub ~root/.ssh/authorized_keys"
        inside = ["nsenter", f"--target={leader}", "--mount", "--pid", "--root", "sh", "-c", script]
        return subprocess.run(inside, capture_output=True, check=False).returncode == 0

    def leader(self) -> int | None:
        """Process id of the container's init, seen from here."""
        assert self._process is not None
        number = self._process.pid
        for _ in range(2):  # the container's manager, then its init
            try:
                children = Path(f"/proc/{number}/task/{number}/children").read_text().split()
            except OSError:
                return None
            if not children:
                return None
            number = int(children[0])
        return number

    def shell(self, script: str, check: bool = True) -> str:
        """Output of a script run as root over ssh."""
        command = ["ssh", "-oBatchMode=yes", "-oConnectTimeout=5", "-oLogLevel=ERROR", *self.ssh, f"root@{ADDRESS}"]
        return run(*command, "sh -s", check=check, text=script)

    def share_terminals(self) -> None:
        """This machine's pseudo-terminals in place of its own: emulated controllers are at their other end."""
        self.shell("mount --bind /run/station-pts /dev/pts")

    def off(self) -> None:
        """Power cut."""
        process, self._process = self._process, None
        if process is not None and process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait(10.0)
        _unlink()


def _unlink() -> None:
    run("ip", "link", "del", "ahdc-s", check=False)
    run("ip", "netns", "del", NAMESPACE, check=False)


@contextlib.contextmanager
def robot_computer(folder: Path) -> Iterator[RobotComputer]:
    """A booted computer, gone at the end of the block."""
    computer = RobotComputer(folder)
    try:
        computer.boot()
        yield computer
    finally:
        computer.off()
