"""How every process joins the network: Zenoh settings as text, and quality of service by channel.

The star: one router session, all other sessions are clients that connect to ``arena.link.router``. The
router is a process of its own: where there are no keys a child of the motion-capture bridge, which begins and
ends it, and where there are, one that is started by itself (``ahdc-groundstation router``). This module
opens nothing: each room does, in its ``network.py``, with the settings of :func:`client_config`.

Never leave a plain callback on a state channel: its subscribers use ``zenoh.handlers.RingChannel(1)``
or a callback that only fills a slot and wakes a poll.
"""

import json
import os
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from contract.arena import ArenaError
from contract.exposure import protocol_of
from contract.tables import Fault

RUNTIME = "(" + ", ".join(f"{pool}: (worker_threads: 1)" for pool in ("app", "acc", "tx", "rx", "net")) + ")"
"""One worker per Zenoh runtime: a third less run-queue delay when ten processes share two cores."""

LEASE_MS = 1000
RADIO_LEASE_MS = 1500
"""Of a link with keys: a second without radio does not end the session, so that nothing has to be opened anew."""
OPEN_TIMEOUT_MS = 2500
"""An attempt to connect is given up after this: left alone, its retries grow to seconds, and a return takes as long.
Much less is too little for handshakes on a computer that is overloaded: nobody would come back at all."""
DROP_AFTER_US = 20_000
CLOSE_AFTER_US = 500_000
MAX_MESSAGE_BYTES = 1 << 20
MAX_PENDING = 1000
"""Connections that have not yet said who they are."""
ACCEPT_TIMEOUT_MS = 2000
"""After this they are dropped."""
MAX_SESSIONS = 200


class Qos(NamedTuple):
    """Member names of ``zenoh.Priority``, ``zenoh.CongestionControl`` and ``zenoh.Reliability``."""

    priority: str
    congestion: str
    reliability: str
    express: bool


_POSES = Qos("REAL_TIME", "DROP", "BEST_EFFORT", True)
_BEATS = Qos("REAL_TIME", "DROP", "BEST_EFFORT", True)
"""Twenty a second, each worth the ones before: a lost one costs nothing, one that waits for its repetition seconds."""
_SAFETY = Qos("REAL_TIME", "DROP", "RELIABLE", True)
_NEIGHBOURS = Qos("DATA_HIGH", "DROP", "BEST_EFFORT", True)
_ORDERS = Qos("INTERACTIVE_HIGH", "DROP", "RELIABLE", True)
_STATUS = Qos("DATA", "DROP", "RELIABLE", False)
_TELEMETRY = Qos("DATA_LOW", "DROP", "RELIABLE", False)
_LOGS = Qos("BACKGROUND", "DROP", "RELIABLE", False)

QOS: Mapping[str, Qos] = MappingProxyType(
    {
        "mocap_frame": _POSES,
        "mocap_health": _STATUS,
        "external": _POSES,
        "virtual": _POSES,
        "heartbeat": _BEATS,
        "stop": _SAFETY,
        "targets": _ORDERS,
        "seed": _ORDERS,
        "order": _ORDERS,
        "status": _STATUS,
        "state": _NEIGHBOURS,
        "report": _STATUS,
        "steps": _TELEMETRY,
        "feedback": _TELEMETRY,
        "inputs": _TELEMETRY,
        "motor": _TELEMETRY,
        "log": _LOGS,
        "clock_ask": _BEATS,
        "clock_tell": _BEATS,
    }
)
"""Quality of service by channel; the names are those of the members of :class:`contract.keys.Keys`.

Nothing blocks: a frozen receiver must never delay a message to a healthy one.
"""

Settings = list[tuple[str, str]]
"""Arguments of ``zenoh.Config.insert_json5``, in order."""

Rules = Mapping[str, object]
"""Top-level sections of the router's configuration that limit who may say what (groundstation/access.py)."""


class Identity(NamedTuple):
    """Paths of the PEM files with which a process proves who it is."""

    authority: str
    """Certificate of the site's own authority, who alone vouches for the others."""
    certificate: str
    private_key: str


def identity(keys: str, name: str) -> Identity | None:
    """The files of one holder (a robot's id or a role) in the folder ``keys``; None where the link has no keys.

    :raises ArenaError: a file is missing or may not be read.
    """
    if not keys:
        return None
    found = Identity(f"{keys}/ca.pem", f"{keys}/{name}/certificate.pem", f"{keys}/{name}/private.key")
    missing = [path for path in found if not os.access(path, os.R_OK)]
    if missing:
        remedy = f"missing or not readable; unpack {name}.tar beside the arena file (keys issue {name} makes it)"
        raise ArenaError(keys, [Fault("link.keys", path, remedy) for path in missing])
    return found


def router_config(
    endpoint: str, listen: Sequence[str] = (), identity: Identity | None = None, rules: Rules | None = None
) -> Settings:
    """Settings of the one router session.

    :param endpoint: such as ``tcp/127.0.0.1:7447``; the router listens there unless ``listen`` names other places.
    :param rules: who may say and hear what; everybody everything where None.
    """
    endpoints = listen or [endpoint]
    secured = _listener_tls(identity) if identity else {}
    return [
        ("mode", '"router"'),
        ("listen/endpoints", json.dumps([_tuned(entry) for entry in endpoints])),
        ("connect/endpoints", "[]"),
        ("scouting/delay", "0"),
        *_common(endpoints, secured),
        ("transport/unicast/accept_pending", str(MAX_PENDING)),
        ("transport/unicast/accept_timeout", str(ACCEPT_TIMEOUT_MS)),
        ("transport/unicast/max_sessions", str(MAX_SESSIONS)),
        *([(key, json.dumps(value)) for key, value in rules.items()] if rules else []),
    ]


def client_config(endpoint: str, connect_timeout_s: float = 10.0, identity: Identity | None = None) -> Settings:
    """Settings of a client session of the router at ``endpoint``.

    ``zenoh.open`` retries for ``connect_timeout_s`` and then raises; after that a lost router is
    found again by the session itself.
    """
    secured = _connector_tls(identity) if identity else {}
    return [
        ("mode", '"client"'),
        ("listen/endpoints", "[]"),
        ("connect/endpoints", json.dumps([_tuned(endpoint)])),
        ("connect/timeout_ms", str(round(connect_timeout_s * 1000))),
        (
            "connect/retry",
            '{"period_init_ms": 50, "period_max_ms": 250, "period_increase_factor": 1.5}',
        ),
        ("transport/unicast/open_timeout", str(OPEN_TIMEOUT_MS)),
        *_common([endpoint], secured),
    ]


def _tuned(endpoint: str) -> str:
    """QUIC carries best-effort messages as datagrams only where it is asked to."""
    return f"{endpoint}?mixed_rel=1" if protocol_of(endpoint) == "quic" and "?" not in endpoint else endpoint


def _listener_tls(identity: Identity) -> dict[str, object]:
    return {
        "root_ca_certificate": identity.authority,
        "listen_certificate": identity.certificate,
        "listen_private_key": identity.private_key,
        "enable_mtls": True,
        "close_link_on_expiration": True,
    }


def _connector_tls(identity: Identity) -> dict[str, object]:
    return {
        "root_ca_certificate": identity.authority,
        "connect_certificate": identity.certificate,
        "connect_private_key": identity.private_key,
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def _common(endpoints: Sequence[str], tls: Mapping[str, object]) -> Settings:
    congestion = {
        "drop": {"wait_before_drop": DROP_AFTER_US},
        "block": {"wait_before_close": CLOSE_AFTER_US},
    }
    return [
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        ("adminspace/enabled", "false"),
        ("timestamping/enabled", "true"),
        ("transport/link/protocols", json.dumps(list(dict.fromkeys(map(protocol_of, endpoints))))),
        ("transport/link/tx/lease", str(RADIO_LEASE_MS if tls else LEASE_MS)),
        ("transport/link/tx/keep_alive", "4"),
        ("transport/link/tx/queue/congestion_control", json.dumps(congestion)),
        ("transport/link/rx/max_message_size", str(MAX_MESSAGE_BYTES)),
        ("transport/shared_memory/enabled", "false"),
        *([("transport/link/tls", json.dumps(tls))] if tls else []),
    ]
