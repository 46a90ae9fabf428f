"""How every process joins the network: Zenoh settings as text, and quality of service by channel.

The star: the motion-capture bridge holds the only router session, all other sessions are clients
that connect to ``arena.link.router``. This module opens nothing; a room applies it like this::

    config = zenoh.Config()
    for key, value in network.client_config(arena.link.router):
        config.insert_json5(key, value)
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
    try:                                    # else a Zenoh thread may swallow the signal
        session = zenoh.open(config)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    with session:                           # else a forgotten callback hangs the exit
        qos = network.QOS["state"]
        publisher = session.declare_publisher(
            keys.state("r06"),
            priority=getattr(zenoh.Priority, qos.priority),
            congestion_control=getattr(zenoh.CongestionControl, qos.congestion),
            reliability=getattr(zenoh.Reliability, qos.reliability),
            express=qos.express,
        )

Set ``ZENOH_RUNTIME`` to :data:`RUNTIME` in the environment *before* the first ``zenoh.open``.
Never leave a plain callback on a state channel: its subscribers use ``zenoh.handlers.RingChannel(1)``
or a callback that only fills a slot and wakes a poll.
"""

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

RUNTIME = "(" + ", ".join(f"{pool}: (worker_threads: 1)" for pool in ("app", "acc", "tx", "rx", "net")) + ")"
"""One worker per Zenoh runtime: a third less run-queue delay when ten processes share two cores."""

LEASE_MS = 1000
DROP_AFTER_US = 20_000
CLOSE_AFTER_US = 500_000
MAX_MESSAGE_BYTES = 1 << 20


class Qos(NamedTuple):
    """Member names of ``zenoh.Priority``, ``zenoh.CongestionControl`` and ``zenoh.Reliability``."""

    priority: str
    congestion: str
    reliability: str
    express: bool


_POSES = Qos("REAL_TIME", "DROP", "BEST_EFFORT", True)
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
        "heartbeat": _SAFETY,
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
    }
)
"""Quality of service by channel; the names are those of the members of :class:`contract.keys.Keys`.

Nothing blocks: a frozen receiver must never delay a message to a healthy one.
"""

Settings = list[tuple[str, str]]
"""Arguments of ``zenoh.Config.insert_json5``, in order."""


def router_config(endpoint: str) -> Settings:
    """Settings of the one router session, listening on ``endpoint`` such as ``tcp/127.0.0.1:7447``."""
    return [
        ("mode", '"router"'),
        ("listen/endpoints", json.dumps([endpoint])),
        ("connect/endpoints", "[]"),
        ("scouting/delay", "0"),
        *_common(endpoint),
        ("transport/unicast/accept_pending", "1000"),
        ("transport/unicast/accept_timeout", "2000"),
        ("transport/unicast/max_sessions", "200"),
    ]


def client_config(endpoint: str, connect_timeout_s: float = 10.0) -> Settings:
    """Settings of a client session of the router at ``endpoint``.

    ``zenoh.open`` retries for ``connect_timeout_s`` and then raises; after that a lost router is
    found again by the session itself.
    """
    return [
        ("mode", '"client"'),
        ("listen/endpoints", "[]"),
        ("connect/endpoints", json.dumps([endpoint])),
        ("connect/timeout_ms", str(round(connect_timeout_s * 1000))),
        (
            "connect/retry",
            '{"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 1.5}',
        ),
        *_common(endpoint),
    ]


def _common(endpoint: str) -> Settings:
    protocol = endpoint.partition("/")[0]
    congestion = {
        "drop": {"wait_before_drop": DROP_AFTER_US},
        "block": {"wait_before_close": CLOSE_AFTER_US},
    }
    return [
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        ("adminspace/enabled", "false"),
        ("timestamping/enabled", "true"),
        ("transport/link/protocols", json.dumps([protocol])),
        ("transport/link/tx/lease", str(LEASE_MS)),
        ("transport/link/tx/keep_alive", "4"),
        ("transport/link/tx/queue/congestion_control", json.dumps(congestion)),
        ("transport/link/rx/max_message_size", str(MAX_MESSAGE_BYTES)),
        ("transport/shared_memory/enabled", "false"),
    ]
