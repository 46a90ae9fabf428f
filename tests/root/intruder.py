"""One attempt to get in, as a process of its own: ``python -m tests.root.intruder '{...}'``.

Says as JSON whether a session opened, what it heard, and how many messages it put in how many seconds. An attempt that
gets a session ends with a message that it may send, again and again until its input is closed, so that the witness
knows that all before it has been judged.
"""

import json
import os
import select
import socket
import sys
import time
import urllib.error
import urllib.request
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from contract import network

os.environ.setdefault("ZENOH_RUNTIME", network.RUNTIME)

import zenoh

PATIENCE_S = 20.0
REMOTE = zenoh.Locality.REMOTE


def opened(attempt: dict[str, Any]) -> zenoh.Session:
    """A session as the attempt wants it."""
    files = attempt.get("files")
    who = network.Identity(*files) if files else None
    settings = dict(network.client_config(attempt["endpoint"], attempt.get("timeout_s", 1.5), who))
    if attempt.get("mode"):
        settings["mode"] = json.dumps(attempt["mode"])
    if attempt.get("ca_only"):
        settings["transport/link/tls"] = json.dumps({"root_ca_certificate": attempt["ca_only"]})
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, value)
    return zenoh.open(config)


def posing(attempt: dict[str, Any]) -> None:
    """Listen as if one were the router, until the parent closes our input."""
    config = zenoh.Config()
    for key, value in network.router_config(attempt["endpoint"], (), network.Identity(*attempt["files"])):
        config.insert_json5(key, value)
    with zenoh.open(config):
        print(json.dumps({"listening": True}), flush=True)
        sys.stdin.read()


def crowd(attempt: dict[str, Any]) -> None:
    """Connections that never say who they are, and datagrams of nonsense, until the parent closes our input."""
    host, port = attempt["address"]
    held = [socket.create_connection((host, port)) for _ in range(attempt["connections"])]
    for index, entry in enumerate(held):
        entry.sendall(b"\x16\x03\x01" if index % 2 else b"GET / HTTP/1.1\r\n")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as noise:
        for index in range(500):
            noise.sendto(os.urandom(1 + index % 1200), (host, attempt["udp_port"]))
    print(json.dumps({"held": len(held)}), flush=True)
    sys.stdin.read()


def browse(attempt: dict[str, Any]) -> dict[str, Any]:
    """What a page of somebody else's gets from the arena page: a socket and an answer, or why not; a STOP's status."""
    host, port = attempt["address"]
    if "post" in attempt:
        body = b"x" * attempt["post"]
        request = urllib.request.Request(f"http://{host}:{port}/stop", body, attempt.get("headers", {}), method="POST")
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as response:
                return {"status": response.status}
        except urllib.error.HTTPError as error:
            return {"status": error.code}
        except OSError:
            return {"status": 0}
    path = f"ws://{attempt.get('name', host)}:{port}/ws"
    try:
        with connect(path, sock=socket.create_connection((host, port)), origin=attempt.get("origin")) as browser:
            answers = []
            for words in attempt["says"]:
                browser.send(json.dumps({**words, "pad": "x" * attempt.get("pad", 0)}))
                while (message := json.loads(browser.recv(timeout=PATIENCE_S)))["kind"] != "answer":
                    pass
                answers.append(message["text"])
            return {"socket": True, "answers": answers}
    except InvalidStatus as error:
        return {"socket": False, "status": error.response.status_code}
    except ConnectionClosed as error:
        return {"socket": True, "closed": error.rcvd.code if error.rcvd else 0}


def asked(session: zenoh.Session, key: str) -> list[zenoh.Reply]:
    """What others answer."""
    return (
        list(session.get(key, timeout=1.0, allowed_destination=REMOTE))
        if "presence" not in key
        else list(session.liveliness().get(key, timeout=1.0))
    )


def main() -> None:
    attempt = json.loads(sys.argv[1])
    if attempt.get("pose"):
        return posing(attempt)
    if attempt.get("crowd"):
        return crowd(attempt)
    if attempt.get("browse"):
        return print(json.dumps(browse(attempt)), flush=True)
    try:
        session = opened(attempt)
    except zenoh.ZError:
        print(json.dumps({"opened": False}))
        return None
    heard: list[str] = []
    with session:
        for key in attempt.get("listen", []):
            session.declare_subscriber(key, lambda s: heard.append(str(s.key_expr)), allowed_origin=REMOTE)
        tokens = [session.liveliness().declare_token(key) for key in attempt.get("tokens", [])]
        forge = attempt.get("answer", "")
        queryable = session.declare_queryable(forge, lambda query: query.reply(forge, b"forged")) if forge else None
        for key in attempt.get("ask", []):
            heard += [str(reply.ok.key_expr) for reply in asked(session, key) if reply.ok]
        payload = bytes.fromhex(attempt["hex"]) if "hex" in attempt else b"x" * attempt.get("bytes", 100)
        began = time.monotonic()
        for _ in range(attempt.get("times", 1)):
            for key in attempt.get("put", []):
                session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
            for key in attempt.get("delete", []):
                session.delete(key)
        seconds = time.monotonic() - began
        if until := attempt.get("until"):
            deadline = time.monotonic() + PATIENCE_S
            while heard.count(until) < 3 and time.monotonic() < deadline:
                time.sleep(0.01)
        del tokens, queryable
        print(json.dumps({"opened": True, "heard": sorted(set(heard)), "seconds": seconds}), flush=True)
        while "last" in attempt and not select.select([sys.stdin], [], [], 0.1)[0]:
            session.put(attempt["last"], b"last", congestion_control=zenoh.CongestionControl.DROP)
            for key in attempt.get("again", []):
                session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)
    return None


if __name__ == "__main__":
    main()
