"""The intruder table of docs/network.md: every row tried from a process of its own against a real router."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from contract import network
from contract.arena import Arena, load
from contract.keys import Keys
from groundstation import certificates, keys, rig
from groundstation.access import MOST_HZ, STATE_BYTES
from groundstation.certificates import Pair
from groundstation.keyring import Keyring
from groundstation.ports import free_ports
from groundstation.processes import Child, Family
from tests.house.checkout import ROOT

os.environ.setdefault("ZENOH_RUNTIME", network.RUNTIME)

import zenoh

PATIENCE_S = 30.0
REMOTE = zenoh.Locality.REMOTE


class Site:
    """A secured site on the loopback: its router, a witness that hears everything, robots r06 and r08."""

    router: Child

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.port, self.fake_port = free_ports(2)
        text = rig.find_arena("bench2").read_text()
        endpoints = [f"quic/127.0.0.1:{self.port}", f"tls/127.0.0.1:{self.port}"]
        link = f'router = "{endpoints[0]}"\nlisten = {json.dumps(endpoints)}\nkeys = "keys"'
        self.file = folder / "site.toml"
        self.file.write_text(text.replace('router = "tcp/127.0.0.1:7447"', link))
        self.arena: Arena = load(self.file)
        self.keys = Keys(self.arena.arena.name)
        now = datetime.now(UTC)
        keys.establish(self.arena, 2.0, now)
        self.keyring = Keyring(folder / "keys")
        self._forge(now)
        self.heard: list[tuple[str, bytes]] = []
        self.told: list[str] = []

    def _forge(self, now: datetime) -> None:
        """What intruders hold: certificates of another authority, expired ones, of nobody, with another's key."""
        folder = self.folder / "keys"
        own = Pair((folder / "ca.pem").read_bytes(), (folder / "authority" / "private.key").read_bytes())
        foreign = certificates.make_authority("elsewhere", now)
        day = timedelta(days=1)
        pairs = {
            "foreign": certificates.sign(foreign, "r06", now + day, now),
            "expired": certificates.sign(own, "r06", now - day / 2, now - day),
            "nobody": certificates.sign(own, "r99", now + day, now),
        }
        r06 = (folder / "r06" / "certificate.pem").read_bytes()
        pairs["mismatched"] = Pair(r06, (folder / "r08" / "private.key").read_bytes())
        for name, pair in pairs.items():
            (folder / name).mkdir()
            (folder / name / "certificate.pem").write_bytes(pair.certificate)
            (folder / name / "private.key").write_bytes(pair.private_key)

    def files(self, name: str) -> list[str]:
        who = network.identity(self.arena.link.keys, name)
        assert who is not None
        return list(who)

    def client(self, name: str, endpoint: str = "") -> zenoh.Session:
        config = zenoh.Config()
        who = network.Identity(*self.files(name))
        for key, value in network.client_config(endpoint or self.arena.link.router, 5.0, who):
            config.insert_json5(key, value)
        return zenoh.open(config)

    def wait_for(self, text: bytes, key: str) -> None:
        """Until the witness hears that text on the key, once more."""
        before, deadline = len(self.heard), time.monotonic() + PATIENCE_S
        while (key, text) not in self.heard[before:]:
            assert time.monotonic() < deadline, f"{text!r} not heard on {key}"
            time.sleep(0.01)

    def wait_until(self, done: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not done():
            assert time.monotonic() < deadline
            time.sleep(0.01)

    def wait_until_renewed(self, times: int) -> None:
        """Until the router has begun anew so often."""
        deadline = time.monotonic() + PATIENCE_S
        while self.router._text.count(b"READY") <= times:
            assert time.monotonic() < deadline, self.router.last_words()
            self.router.listen()
            time.sleep(0.01)

    @staticmethod
    def answer(process: "subprocess.Popen[str]") -> dict[str, Any]:
        """What an intruder says of itself; it stays."""
        assert process.stdout is not None
        return dict(json.loads(process.stdout.readline()))

    def start(self, attempt: dict[str, Any]) -> "subprocess.Popen[str]":
        attempt = {"endpoint": self.arena.link.router, **attempt}
        command = [sys.executable, "-m", "tests.root.intruder", json.dumps(attempt)]
        return subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def rows(site: Site) -> dict[str, dict[str, Any]]:
    """Row of the table -> what its process tries."""
    k, r06 = site.keys, site.files("r06")
    everything = [k.everything, k.status, k.report("r08"), k.motor("r08"), k.inputs("r08"), k.order, "**"]
    as_r06 = {"files": r06, "timeout_s": PATIENCE_S}
    tls = f"tls/127.0.0.1:{site.port}"
    return {
        "no encryption": {"endpoint": f"tcp/127.0.0.1:{site.port}"},
        "no certificate": {"ca_only": r06[0]},
        "no certificate, tls": {"ca_only": r06[0], "endpoint": tls},
        "foreign authority": {"files": [r06[0], *site.files("foreign")[1:]]},
        "expired": {"files": site.files("expired")},
        "expired, tls": {"files": site.files("expired"), "endpoint": tls},
        "mismatched key": {"files": site.files("mismatched")},
        "as another robot": {**as_r06, "put": [k.state("r08"), k.report("r08"), k.steps("r08"), k.log("r08")]},
        "as the station": {**as_r06, "put": [k.heartbeat, k.status, k.order, k.seed, k.log("station")]},
        "as the bridge": {**as_r06, "put": [k.mocap_frame, k.mocap_health, k.external]},
        "to STOP": {**as_r06, "put": [k.stop]},
        "to targets": {**as_r06, "put": [k.targets]},
        "wildcard writes": {**as_r06, "put": [f"{k.site}/robot/*/state", f"{k.site}/**", "**", f"{k.site}/*/targets"]},
        "deletes": {**as_r06, "delete": [k.stop, k.targets, k.state("r08"), k.state("r06")]},
        "another's presence": {**as_r06, "tokens": [k.presence("r08"), k.presence("station")]},
        "answers for others": {**as_r06, "answer": k.everything, "ask": [k.everything, f"{k.site}/presence/*"]},
        "as a router": {**as_r06, "mode": "router", "put": [k.stop, k.state("r08")], "listen": [k.report("r08")]},
        "as a peer": {**as_r06, "mode": "peer", "put": [k.stop, k.state("r08")], "listen": [k.report("r08")]},
        "reads all": {**as_r06, "listen": [*everything, k.heartbeat], "until": k.heartbeat},
        "of nobody": {**as_r06, "files": site.files("nobody"), "put": [k.state("r06"), k.stop], "listen": everything},
        "operator orders": {
            **as_r06, "files": site.files("operator"), "put": [k.heartbeat, k.targets, k.mocap_frame, k.state("r06")],
        },
        "too big": {**as_r06, "put": [k.state("r06")], "bytes": STATE_BYTES + 1},
        "too often": {**as_r06, "put": [k.state("r06")], "bytes": 200, "times": 3000},
    }  # fmt: skip


def last_of(site: Site, row: str) -> str:
    """The key on which the intruder of that row may speak."""
    return site.keys.order if row == "operator orders" else site.keys.log("r06")


REFUSED = (
    "no encryption", "no certificate", "no certificate, tls", "foreign authority", "expired", "expired, tls",
    "mismatched key",
)  # fmt: skip


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Site, dict[str, dict[str, Any]]]]:
    """Every row tried, what came of it by row; the site goes on."""
    site = Site(tmp_path_factory.mktemp("site"))
    k = site.keys
    with contextlib.ExitStack() as stack:
        family = stack.enter_context(Family())
        words = ["router", "--arena", str(site.file)]
        site.router = family.start("router", "groundstation", words, site.folder / "router.log")
        family.wait_ready(PATIENCE_S)
        station, r08 = stack.enter_context(site.client("station")), stack.enter_context(site.client("r08"))
        station.declare_subscriber(k.everything, lambda s: site.heard.append((str(s.key_expr), s.payload.to_bytes())))
        for key in (k.stop, k.heartbeat, k.targets, k.mocap_frame, k.state("r06"), k.state("r08")):
            r08.declare_subscriber(key, lambda s: site.told.append(f"{s.key_expr} {s.kind}"), allowed_origin=REMOTE)
        over = threading.Event()

        def beat() -> None:
            while not over.wait(0.05):
                for key in (k.status, k.heartbeat):
                    station.put(key, b"good")
                r08.put(k.report("r08"), b"good")

        beating = threading.Thread(target=beat)
        beating.start()
        stack.callback(beating.join)
        stack.callback(over.set)
        found = {}
        todo = list(rows(site).items())
        for some in (todo[i : i + 6] for i in range(0, len(todo), 6)):
            started = {name: site.start({**attempt, "last": last_of(site, name)}) for name, attempt in some}
            for name, process in started.items():
                found[name] = site.answer(process)
                if found[name]["opened"] and name != "of nobody":
                    site.wait_for(b"last", last_of(site, name))
                process.communicate(timeout=PATIENCE_S)
        yield site, found


@pytest.mark.parametrize("row", REFUSED)
def test_who_cannot_prove_who_it_is_gets_no_session(row: str, table: Any) -> None:
    assert table[1][row] == {"opened": False}


def test_every_other_intruder_got_a_session_and_was_heard_where_it_may_speak(table: Any) -> None:
    site, found = table
    assert {name for name, result in found.items() if result["opened"]} == set(rows(site)) - set(REFUSED)
    assert (site.keys.order, b"last") in site.heard


def test_nobody_writes_what_is_not_its_own(table: Any) -> None:
    """Rows 'as another robot' to 'operator orders': neither station nor robot heard anything but the honest."""
    site, _ = table
    k = site.keys
    strange = {(key, payload[:4]) for key, payload in site.heard if payload not in (b"good", b"last")}
    assert strange == {(k.state("r06"), b"xxxx")}, "only the flood on its own key, thinned out"
    honest = {k.status, k.heartbeat, k.report("r08"), k.log("r06"), k.order}
    assert {key for key, payload in site.heard if payload in (b"good", b"last")} == honest
    assert set(site.told) == {f"{k.heartbeat} SampleKind.PUT", f"{k.state('r06')} SampleKind.PUT"}


def test_nobody_reads_what_is_not_its_own(table: Any) -> None:
    site, found = table
    assert found["reads all"]["heard"] == [site.keys.heartbeat]
    for row in ("as a router", "as a peer", "of nobody", "answers for others"):
        assert found[row]["heard"] == [], row


def test_a_flood_is_thinned_out_and_big_messages_are_dropped(table: Any) -> None:
    site, found = table
    sizes = [len(payload) for key, payload in site.heard if key == site.keys.state("r06")]
    assert sizes
    assert set(sizes) == {200}
    assert len(sizes) <= MOST_HZ * (found["too often"]["seconds"] + 1.0)
    assert len(sizes) < 3000 / 2


def test_a_robot_that_poses_as_the_router_is_not_believed(table: Any) -> None:
    site, _ = table
    fake = f"quic/127.0.0.1:{site.fake_port}"
    pose = site.start({"pose": True, "files": site.files("r06"), "endpoint": fake})
    try:
        assert site.answer(pose) == {"listening": True}
        victim = site.start({"files": site.files("r08"), "endpoint": fake})
        assert json.loads(victim.communicate(timeout=PATIENCE_S)[0]) == {"opened": False}
    finally:
        pose.communicate(timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def page(table: Any) -> Iterator[tuple[Site, int, str]]:
    """The site's arena page on every address of this computer, with its port and token."""
    site, _ = table
    with pytest.MonkeyPatch.context() as patch, Family() as family:
        patch.setenv("XDG_STATE_HOME", str(site.folder / "state"))
        patch.delenv("STATE_DIRECTORY", raising=False)
        words = ["page", "--arena", str(site.file), "--port", "0", "--host", "0.0.0.0"]
        served = family.start("page", "groundstation", words, site.folder / "page.log")
        family.wait_ready(PATIENCE_S)
        port = int(served._text.decode().rpartition("READY page http://0.0.0.0:")[2].split("/")[0])
        token = (site.folder / "state" / "ahdc" / "page-token").read_text().strip()
        assert token not in served._text.decode() + served.log.read_text()
        yield site, port, token


def browsed(site: Site, port: int, **attempt: object) -> dict[str, Any]:
    process = site.start({"browse": True, "address": ["127.0.0.1", port], **attempt})
    return dict(json.loads(process.communicate(timeout=PATIENCE_S)[0]))


ARM = {"do": "order", "to": 1, "order": "arm"}
SEED = {"do": "seed", "to": 1, "points": [[1.0, 1.0]]}
RELEASE = {"do": "release", "to": 1, "typed": "RELEASE"}


def test_the_page_hears_no_other_page_and_nobody_without_the_token(page: Any) -> None:
    """No socket for another origin; without the token one may look, not seed, arm or release; with it one may."""
    site, port, token = page
    k, quiet_from = site.keys, len(site.heard)
    other = browsed(site, port, says=[ARM | {"token": token}], origin="http://elsewhere.example")
    assert other["socket"] is False
    without = (ARM, SEED, RELEASE, *(ARM | {"token": wrong} for wrong in ("guessed", "", None)))
    answers = browsed(site, port, says=without)["answers"]
    assert len(answers) == len(without)
    assert all("not allowed" in answer for answer in answers)
    assert browsed(site, port, says=[ARM | {"token": token}], pad=1 << 20)["closed"] == 1009
    site.wait_for(b"good", k.report("r08"))
    wished = {key for key, payload in site.heard[quiet_from:] if key in (k.order, k.seed) and payload != b"last"}
    assert not wished
    assert browsed(site, port, says=[ARM | {"token": token}]) == {"socket": True, "answers": [""]}
    site.wait_until(lambda: any(key == k.order and b'"arm"' in payload for key, payload in site.heard[quiet_from:]))


def test_stop_needs_no_token_and_an_oversized_one_is_obeyed_unread(page: Any) -> None:
    site, port, _ = page
    for size, status in ((2, 200), (1 << 21, 413)):
        before = len(site.heard)
        headers = {"Origin": "http://elsewhere.example", "Content-Type": "text/plain"}
        assert browsed(site, port, post=size, headers=headers)["status"] in (status, 0)
        site.wait_until(lambda: any(key == site.keys.stop for key, _ in site.heard[before:]))  # noqa: B023


def test_certificates_are_renewed_under_live_sessions(table: Any) -> None:
    """A robot's, without anybody noticing; the router's own, after which every session comes back by itself."""
    site, _ = table
    k, now = site.keys, datetime.now(UTC)
    begun = site.router._text.count(b"READY")
    old = site.start({"files": kept(site, "r06"), "timeout_s": PATIENCE_S, "last": k.log("r06")})
    assert site.answer(old)["opened"]
    assert site.keyring.issue("r06", 3.0, now, replace=True) == "r06"
    new = site.start({"files": site.files("r06"), "timeout_s": PATIENCE_S, "last": k.state("r06")})
    try:
        assert site.answer(new)["opened"]
        for _ in range(5):
            site.wait_for(b"last", k.state("r06"))
            site.wait_for(b"last", k.log("r06"))
        site.router.listen()
        assert site.router._text.count(b"READY") == begun, "the sessions outlived the renewal"
        site.keyring.issue("router", 3.0, now, keys.servers_of(site.arena), replace=True)
        site.wait_until_renewed(begun)
        for key, text in ((k.state("r06"), b"last"), (k.log("r06"), b"last"), (k.report("r08"), b"good")):
            site.wait_for(text, key)
    finally:
        for process in (old, new):
            process.kill()
            process.communicate()


def kept(site: Site, name: str) -> list[str]:
    """Copies of what a holder has now, for somebody who keeps them."""
    said = [site.files(name)[0]]
    for path, source in zip((f"{name}.old.pem", f"{name}.old.key"), site.files(name)[1:], strict=True):
        (site.folder / path).write_bytes(Path(source).read_bytes())
        said.append(str(site.folder / path))
    return said


def test_a_crowd_at_the_door_keeps_nobody_out(table: Any) -> None:
    """Connections that never say who they are, and noise. (TLS handshakes queue; QUIC's do not.)"""
    site, _ = table
    crowd = site.start({"crowd": True, "address": ["127.0.0.1", site.port], "udp_port": site.port, "connections": 300})
    comer = None
    try:
        assert site.answer(crowd) == {"held": 300}
        attempt = {"files": site.files("r06"), "timeout_s": PATIENCE_S, "last": site.keys.log("r06")}
        comer = site.start(attempt)
        assert site.answer(comer)["opened"]
        site.wait_for(b"last", site.keys.log("r06"))
    finally:
        for process in filter(None, (crowd, comer)):
            process.kill()
            process.communicate()


def test_a_revoked_robot_is_shut_out_and_comes_back_with_new_keys_while_the_site_goes_on(table: Any) -> None:
    """Its certificate has not expired, but counts no more as soon as the router has taken the register in."""
    site, _ = table
    k = site.keys
    begun = site.router._text.count(b"READY")
    thief = site.start({"files": kept(site, "r06"), "timeout_s": PATIENCE_S, "last": k.log("r06")})
    assert site.answer(thief)["opened"]
    site.wait_for(b"last", k.log("r06"))
    site.keyring.revoke("r06")
    site.wait_until_renewed(begun)
    for _ in range(3):
        site.wait_for(b"good", k.report("r08"))
    quiet_from = len(site.heard)
    for _ in range(10):
        site.wait_for(b"good", k.report("r08"))
    assert (k.log("r06"), b"last") not in site.heard[quiet_from:]
    assert site.keyring.issue("r06", 1.0, datetime.now(UTC)) == "r06.2"
    site.wait_until_renewed(begun + 1)
    assert (k.log("r06"), b"last") not in site.heard[quiet_from:]
    owner = site.start({"files": site.files("r06"), "timeout_s": PATIENCE_S, "last": k.log("r06")})
    assert site.answer(owner)["opened"]
    site.wait_for(b"last", k.log("r06"))
    site.wait_for(b"good", k.report("r08"))
    for process in (thief, owner):
        process.kill()
        process.communicate()
