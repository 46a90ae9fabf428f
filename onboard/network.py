"""How a process of this room joins the network: a session of given settings, publishers of given channels."""

import os
import signal
from typing import Any

from contract import network
from contract.allocator import share_arenas


def open_session(settings: network.Settings) -> Any:
    """A ``zenoh.Session``; use it in a ``with`` block, else a forgotten callback hangs the exit.

    SIGTERM and SIGINT are masked meanwhile: Zenoh's threads inherit that, and never take a signal meant for the loop.

    :raises zenoh.ZError: no router answers, an address is taken, or a certificate is of no use.
    """
    os.environ.setdefault("ZENOH_RUNTIME", network.RUNTIME)
    share_arenas()
    import zenoh

    config = zenoh.Config()
    for key, value in settings:
        config.insert_json5(key, value)
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
    try:
        return zenoh.open(config)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def publisher(session: Any, key: str, channel: str) -> Any:
    """A ``zenoh.Publisher`` with the quality of service of a channel of :data:`contract.network.QOS`."""
    import zenoh

    qos = network.QOS[channel]
    return session.declare_publisher(
        key,
        priority=getattr(zenoh.Priority, qos.priority),
        congestion_control=getattr(zenoh.CongestionControl, qos.congestion),
        reliability=getattr(zenoh.Reliability, qos.reliability),
        express=qos.express,
    )
