"""Who may say and hear what on a secured link: the router's rules, made from the arena file. Pure.

Everything is denied but what stands here. Identity is the common name of the certificate, matched literally, so every
robot has a rule set of its own. A robot writes its own keys and reads what it needs: STOP, heartbeat, poses, targets,
and the other robots' states. It may not ask for a STOP: that would let one stolen robot hold the site.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from contract.arena import Arena
from contract.keys import Keys

STATE_BYTES = 16_384
"""Largest message of a robot to the others; they measure at most a quarter of it with fifty robots."""
BATCH_BYTES = 65_536
MOST_HZ = 250
"""Messages of one key a second; what comes sooner is dropped by the router, which counts by rule: a rule a key."""


class Leave(NamedTuple):
    """What one holder of a certificate may do; all are key expressions."""

    says: tuple[str, ...]
    hears: tuple[str, ...]
    asks: tuple[str, ...] = ()
    """Queries."""


def leaves(arena: Arena) -> dict[str, Leave]:
    """What every robot and role of the arena may do."""
    keys = Keys(arena.arena.name)
    site = keys.site
    asks, told = f"{site}/clock/ask/*", f"{site}/clock/tell/*"
    common = (keys.stop, keys.heartbeat, keys.mocap_frame, keys.targets)
    found = {}
    for name in arena.robots:
        own = tuple(getattr(keys, kind)(name) for kind in ("state", "report", "steps", "feedback", "inputs", "log"))
        others = tuple(keys.state(other) for other in arena.robots)
        found[name] = Leave(
            (*own, keys.clock_ask(name), keys.presence(name)), (*common, keys.clock_tell(name), *others)
        )
    wishes = (keys.stop, keys.order, keys.seed)
    everything = (keys.everything,)
    found["station"] = Leave(
        (*wishes, keys.heartbeat, keys.targets, keys.status, f"{site}/log/*", f"{site}/presence/*", asks),
        everything,
        (f"{site}/recorder/*", f"{site}/presence/*"),
    )
    heard = (
        *common, keys.mocap_health, keys.status, f"{site}/log/*", f"{site}/log/**", f"{site}/robot/*/report",
        *(keys.report(name) for name in arena.robots), f"{site}/presence/*", told,
    )  # fmt: skip
    found["operator"] = Leave((*wishes, f"{site}/presence/*", asks), heard)
    found["bridge"] = Leave(
        (keys.mocap_frame, keys.mocap_health, keys.log("mocap_bridge"), keys.presence("mocap_bridge"), told),
        (keys.external, keys.virtual, asks),
    )
    found["external"] = Leave((keys.external,), (keys.mocap_health,))
    on_stands = [r for r, robot in arena.robots.items() if "body" in robot.emulate and "wheels" not in robot.emulate]
    found["mock"] = Leave(
        (f"{site}/motor/*", keys.virtual, keys.presence("mock-arena")), tuple(keys.feedback(name) for name in on_stands)
    )
    return found


def rules(arena: Arena, common_names: Mapping[str, str]) -> dict[str, Any]:
    """The router's sections ``access_control``, ``low_pass_filter`` and ``downsampling``.

    :param common_names: robot or role to the common name of the one certificate that stands for it now; who is
        not in it may connect, and then neither say nor hear anything.
    """
    site = Keys(arena.arena.name).site
    listed: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    leaves_of = leaves(arena)
    for name, leave in leaves_of.items():
        if name not in common_names:
            continue
        own = _rules_of(name, leave)
        listed += own
        subjects.append({"id": name, "cert_common_names": [common_names[name]]})
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [name]})
    spoken = [key for name in arena.robots for key in leaves_of[name].says]
    return {
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": listed,
            "subjects": subjects,
            "policies": policies,
        },
        "low_pass_filter": [
            _low_pass("states", [f"{site}/robot/*/state"], STATE_BYTES),
            _low_pass("everything", [f"{site}/**"], BATCH_BYTES),
        ],
        "downsampling": [
            {
                "id": "rate",
                "flows": ["ingress"],
                "messages": ["put"],
                "rules": [{"key_expr": key, "freq": MOST_HZ} for key in spoken],
            }
        ],
    }


def _rules_of(name: str, leave: Leave) -> list[dict[str, Any]]:
    """Ingress is what the client sends to the router, egress what the router sends to the client."""
    says = _rule(f"{name} says", "ingress", ["put", "liveliness_token"], leave.says)
    listeners = _rule(f"{name} is listened to", "egress", ["declare_subscriber"], ("**",))
    found = [says, listeners]
    if leave.hears:
        found += [
            _rule(f"{name} listens", "ingress", ["declare_subscriber"], leave.hears),
            _rule(f"{name} hears", "egress", ["put"], leave.hears),
        ]
    if leave.asks:
        found += [
            _rule(f"{name} asks", "ingress", ["query"], leave.asks),
            _rule(f"{name} is answered", "egress", ["reply"], leave.asks),
        ]
    return found


def _rule(label: str, flow: str, messages: list[str], keys: tuple[str, ...]) -> dict[str, Any]:
    return {
        "id": label,
        "permission": "allow",
        "flows": [flow],
        "messages": messages,
        "key_exprs": list(dict.fromkeys(keys)),
    }


def _low_pass(label: str, keys: list[str], limit_bytes: int) -> dict[str, Any]:
    return {
        "id": label,
        "flows": ["ingress"],
        "messages": ["put"],
        "key_exprs": keys,
        "size_limit": limit_bytes,
    }
