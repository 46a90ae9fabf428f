"""Why no poses arrive, or wrong ones: evidence of a few seconds in, named causes and remedies out. Pure."""

import math

from contract.arena import Arena
from contract.checks import CheckResult, Verdict
from mocap_bridge.evidence import Evidence
from mocap_bridge.health import CLOCK_WARN_MS, RATE_TOLERANCE
from mocap_bridge.limits import TILT_COS
from mocap_bridge.natnet.frame import TRACKING_VALID, Body

HEIGHT_SPREAD_M = 0.5
"""Bodies on a floor do not differ more in height."""


def diagnose(seen: Evidence, arena: Arena) -> list[CheckResult]:
    """Checks in the order in which one has to put things right; later ones need the earlier."""
    mocap = arena.mocap
    results = [_interface(seen, arena)]
    if seen.info is None:
        return [*results, _server(seen, arena)] if seen.route_address else results
    results.append(_check("server", "pass", f"{seen.info.name}, NatNet {seen.info.natnet}"))
    if seen.problem:
        return [*results, _check("version", "fail", seen.problem, "choose a bit stream this bridge knows")]
    results += _transmission(seen, arena)
    if any(result.verdict == "fail" for result in results):
        return results
    results.append(_frames(seen, arena))
    if not seen.frames:
        return results
    if seen.other_bitstream:
        results.append(
            _check(
                "version",
                "warn",
                f"frames are in another bit stream than NatNet {seen.info.natnet} asked for as {mocap.version}",
                "set mocap.version to the bit stream of the streaming settings",
            )
        )
    results += [_bodies(seen, arena), _units(seen), _up_axis(seen, arena), _rate(seen, arena), _clock(seen)]
    if seen.edited:
        results.append(_check("edit_mode", "fail", "the server plays back or edits", "switch it to live mode"))
    return results


def _check(name: str, verdict: Verdict, seen: str, remedy: str = "", subject: str = "") -> CheckResult:
    return CheckResult(name=name, verdict=verdict, seen=seen[:400], remedy=remedy[:400], subject=subject)


def _interface(seen: Evidence, arena: Arena) -> CheckResult:
    mocap = arena.mocap
    if not seen.route_address:
        return _check(
            "interface",
            "fail",
            f"no way from this machine to {mocap.server}",
            "check mocap.server, the cable and this machine's address: both must be in one subnet",
        )
    if seen.route_address != mocap.local_address:
        return _check(
            "wrong_interface",
            "fail",
            f"{mocap.server} is reached from {seen.route_address}, not from {mocap.local_address}",
            f'set mocap.local_address = "{seen.route_address}"',
        )
    return _check("interface", "pass", f"{mocap.local_address} towards {mocap.server}")


def _server(seen: Evidence, arena: Arena) -> CheckResult:
    mocap = arena.mocap
    if seen.refused_ports:
        return _check(
            "no_natnet",
            "fail",
            f"{mocap.server} is up, but nothing listens on its port {mocap.command_port}",
            "switch streaming on in Motive; check mocap.command_port",
        )
    silent = f"{mocap.server}:{mocap.command_port} does not answer"
    if seen.early_frames:
        return _check(
            "command_port",
            "fail",
            f"{silent}, though {seen.early_frames} frames came",
            f"let UDP {mocap.command_port} into the server through its firewall; check mocap.command_port",
        )
    if not seen.same_subnet:
        return _check(
            "other_subnet",
            "fail",
            f"{silent}, and no interface here is in its subnet",
            "give this machine an address in the motion-capture network, or correct mocap.server",
        )
    if seen.neighbour == "absent":
        return _check(
            "host_absent",
            "fail",
            f"nobody in this subnet has the address {mocap.server}",
            "check mocap.server, that the host is on, and the cable",
        )
    if seen.neighbour == "present":
        return _check(
            "firewall",
            "fail",
            f"{silent}, but its host is there",
            f"let UDP {mocap.command_port} and {mocap.data_port} through the server's firewall; check that Motive runs "
            "and streams on this network's interface",
        )
    return _check(
        "server_silent",
        "fail",
        silent,
        "check that Motive runs and streams on this network's interface, that its firewall lets UDP "
        f"{mocap.command_port} in, and that both machines are in one subnet",
    )


def _transmission(seen: Evidence, arena: Arena) -> list[CheckResult]:
    mocap, info = arena.mocap, seen.info
    assert info is not None
    if info.natnet < (3, 0):
        return []
    if info.multicast and not mocap.multicast_group:
        remedy = f'set mocap.multicast_group = "{info.group}", or choose unicast in Motive'
        return [_check("unicast_vs_multicast", "fail", "the server multicasts, the arena file says unicast", remedy)]
    if not info.multicast and mocap.multicast_group:
        remedy = 'set mocap.multicast_group = "", or choose multicast in Motive'
        return [_check("unicast_vs_multicast", "fail", "the server unicasts, the arena file says multicast", remedy)]
    if info.multicast and (info.group, info.data_port) != (mocap.multicast_group, mocap.data_port):
        there, here = f"{info.group}:{info.data_port}", f"{mocap.multicast_group}:{mocap.data_port}"
        remedy = f'set mocap.multicast_group = "{info.group}" and mocap.data_port = {info.data_port}'
        return [_check("multicast_group", "fail", f"the server sends to {there}, the arena file says {here}", remedy)]
    return []


def _frames(seen: Evidence, arena: Arena) -> CheckResult:
    mocap = arena.mocap
    if seen.frames:
        return _check("frames", "pass", f"{seen.frames} frames, {seen.malformed} malformed")
    if seen.malformed:
        return _check("malformed", "fail", f"{seen.malformed} malformed: {seen.last_fault}", "check mocap.version")
    if seen.elsewhere:
        return _check(
            "multicast_not_joined",
            "fail",
            f"multicast arrives on {', '.join(seen.elsewhere)}, not on {mocap.local_address}",
            f'set mocap.local_address = "{seen.elsewhere[0]}", or stream on the other interface in Motive',
        )
    if seen.foreign_senders:
        return _check(
            "foreign_sender",
            "fail",
            f"datagrams come from {', '.join(seen.foreign_senders)}, not from {mocap.server}",
            f'set mocap.server = "{seen.foreign_senders[0]}", or the interface in Motive\'s streaming settings',
        )
    way = f"multicast to {mocap.multicast_group}" if mocap.multicast_group else "unicast"
    return _check(
        "command_port_only",
        "fail",
        f"{mocap.server} answers commands, but no frame came by {way} in {seen.seconds:.1f} s",
        f"let UDP from port {mocap.data_port} through this machine's firewall; check that Motive is live (or playing) "
        "and that switches and Wi-Fi pass multicast",
    )


def _bodies(seen: Evidence, arena: Arena) -> CheckResult:
    virtual = arena.virtual_beside_tracked()
    wanted = {robot.body: name for name, robot in arena.robots.items() if name not in virtual}
    doubled = sorted(wanted.keys() & seen.duplicate_names)
    if doubled:
        return _check("duplicate_name", "fail", f"two bodies are called {', '.join(doubled)}", "rename one in Motive")
    shared = sorted(wanted.keys() & seen.duplicate_ids)
    if shared:
        remedy = "give each body a streaming id of its own in Motive"
        return _check("duplicate_id", "fail", f"{', '.join(shared)}: another body has the same streaming id", remedy)
    missing = sorted(wanted.keys() - seen.names)
    if missing:
        return _check(
            "body_not_in_model_list",
            "fail",
            f"the server does not know {', '.join(missing)}; it has {', '.join(sorted(seen.names)) or 'none'}",
            "name the bodies alike in Motive and under robots.*.body, and switch rigid-body streaming on",
        )
    hidden = [
        body for body in sorted(wanted) if not any(sample[9] & TRACKING_VALID for sample in seen.bodies.get(body, ()))
    ]
    if hidden:
        return _check(
            "occluded", "warn", f"never seen: {', '.join(hidden)}", "put them on the floor, check their markers"
        )
    return _check("bodies", "pass", f"{len(wanted)} of {len(seen.names)} bodies of the server are robots")


def _tracked(seen: Evidence) -> list[Body]:
    return [sample for samples in seen.bodies.values() for sample in samples if sample[9] & TRACKING_VALID]


def _units(seen: Evidence) -> CheckResult:
    far = max((math.hypot(*body[1:4]) for body in _tracked(seen)), default=0.0)
    if abs(seen.units_to_millimetres - 1000.0) > 1.0 or far > 50.0:
        return _check(
            "units",
            "fail",
            f"one unit is {seen.units_to_millimetres:g} mm, the farthest body is {far:.0f} units away",
            "choose metres in Motive's streaming settings",
        )
    return _check("units", "pass", "metres")


def _up_axis(seen: Evidence, arena: Arena) -> CheckResult:
    """Bodies stand upright about one axis and at one height along it; see whether that is the other axis.

    Bodies with heading 0 are upright about both: only heights tell then.
    """
    y_up = z_up = 0
    tracked = _tracked(seen)
    for _, _, _, _, qx, qy, qz, qw, _, _ in tracked:
        norm = qx * qx + qy * qy + qz * qz + qw * qw
        y_up += norm - 2.0 * (qx * qx + qz * qz) > TILT_COS * norm
        z_up += norm - 2.0 * (qx * qx + qy * qy) > TILT_COS * norm
    here, other = (y_up, z_up) if arena.mocap.up_axis == "y" else (z_up, y_up)
    axis = "z" if arena.mocap.up_axis == "y" else "y"
    y_spread, z_spread = _spread([body[2] for body in tracked]), _spread([body[3] for body in tracked])
    vertical, horizontal = (y_spread, z_spread) if axis == "z" else (z_spread, y_spread)
    if other > 2 * here or (vertical > HEIGHT_SPREAD_M and horizontal < 0.2 * HEIGHT_SPREAD_M):
        return _check("up_axis", "fail", f"bodies stand upright about {axis}", f'set mocap.up_axis = "{axis}"')
    return _check("up_axis", "pass", f"bodies are upright about {arena.mocap.up_axis}")


def _spread(values: list[float]) -> float:
    return max(values, default=0.0) - min(values, default=0.0)


def _rate(seen: Evidence, arena: Arena) -> CheckResult:
    nominal = seen.nominal_rate_hz or arena.mocap.frame_rate_hz
    if abs(seen.rate_hz - nominal) > RATE_TOLERANCE * nominal:
        return _check(
            "rate",
            "warn",
            f"{seen.rate_hz:.0f} frames/s arrive, {nominal:g} are sent",
            "frames are lost: use a cable, look for other traffic, reduce what Motive streams",
        )
    if abs(nominal - arena.mocap.frame_rate_hz) > RATE_TOLERANCE * nominal:
        return _check(
            "rate",
            "warn",
            f"the server streams {nominal:g} Hz, the arena file says {arena.mocap.frame_rate_hz:g}",
            f"set mocap.frame_rate_hz = {nominal:g}",
        )
    return _check("rate", "pass", f"{seen.rate_hz:.0f} frames/s")


def _clock(seen: Evidence) -> CheckResult:
    if seen.clock_error_ms is None:
        return _check(
            "clock", "warn", "the server answers no echo", "stamps are taken from arrivals: expect some ms of error"
        )
    if seen.clock_error_ms > CLOCK_WARN_MS:
        return _check(
            "clock", "warn", f"known to {seen.clock_error_ms:.1f} ms", "use a cable: the way there and back is too slow"
        )
    return _check("clock", "pass", f"known to {seen.clock_error_ms:.2f} ms")
