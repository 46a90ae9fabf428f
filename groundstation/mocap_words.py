"""The health of the pose stream in a line. Pure."""

from contract.messages import MocapHealth

MAX_DETAIL = 60


def figures(health: MocapHealth) -> str:
    """Rate, latency from mid-exposure to publication with its bound, and what was lost."""
    words = f"{health.rate_hz:.0f} Hz, {health.latency_ms:.1f} ± {health.clock_error_ms:.1f} ms"
    words += f", {health.frames_dropped} dropped" if health.frames_dropped else ""
    return words + (f", {health.malformed} malformed" if health.malformed else "")


def bodies(health: MocapHealth) -> str:
    """Bodies that are not trusted and why; empty when all are."""
    return ", ".join(f"{body.robot} {body.reason}" for body in health.bodies if not body.valid)


def short(health: MocapHealth) -> str:
    """State, unless it is ok, with the beginning of what is wrong."""
    if health.state == "ok":
        return ""
    detail = health.detail if len(health.detail) <= MAX_DETAIL else health.detail[: MAX_DETAIL - 1] + "…"
    return f"{health.state}: {detail}" if detail else str(health.state)
