"""The pose stream's health as the terminal and the page show it."""

from contract.arena import parse
from contract.messages import BodyHealth, LogEntry, MocapHealth
from groundstation.page_health import health
from groundstation.watch import Watch

OK = MocapHealth(stamp_ns=1, state="ok", rate_hz=120.0, latency_ms=3.14, clock_error_ms=0.2)
ILL = MocapHealth(
    stamp_ns=1,
    state="degraded",
    detail="clock of the source known to 3.0 ms only: a slow or busy network, so stamps are vague",
    rate_hz=96.0,
    latency_ms=25.0,
    clock_error_ms=3.0,
    frames_dropped=24,
    malformed=2,
    bodies=(BodyHealth(robot="r06", valid=True), BodyHealth(robot="r08", valid=False, reason="occluded")),
)
ROBOT = {"body": "r06", "start": [1, 1], "wheels": {"kind": "none"}}
ARENA = parse({"arena": {"name": "lab", "size_m": [4, 5]}, "robots": {"r06": ROBOT}}, "lab")


def footer(message: MocapHealth) -> str:
    watch = Watch(ARENA)
    watch.receive(message, 1.0)
    return watch.footer().partition("   ")[0]


def on_page(message: MocapHealth) -> tuple[str, str]:
    nothing: LogEntry | None = None
    return health(message, 0.01, True, nothing, 0.0)[0]


def test_rate_and_latency_with_its_bound() -> None:
    assert footer(OK) == "mocap ok, 120 Hz, 3.1 ± 0.2 ms"
    assert on_page(OK) == ("Mocap 120 Hz, 3.1 ± 0.2 ms", "info")


def test_losses_cause_and_every_body_that_is_not_trusted() -> None:
    seen = "96 Hz, 25.0 ± 3.0 ms, 24 dropped, 2 malformed"
    assert footer(ILL) == f"mocap degraded, {seen}: {ILL.detail}; r08 occluded"
    assert on_page(ILL) == (
        f"Mocap {seen}, degraded: clock of the source known to 3.0 ms only: a slow or busy ne…",
        "warning",
    )
