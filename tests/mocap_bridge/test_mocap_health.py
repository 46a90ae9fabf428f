"""Health: states by silence, rate, latency and clock, each with words; nothing else than the record."""

import pytest

from mocap_bridge.bridge import log_of
from mocap_bridge.health import BODY_REASONS, Health
from mocap_bridge.pipeline import Pipeline
from mocap_bridge.sources.base import STEADY, SourceFrame, SourceStatus
from tests.mocap_bridge.lockstep import arena

MS = 1_000_000
STATUS = SourceStatus("Motive", STEADY, nominal_rate_hz=100.0)


def streamed(
    health: Health, seconds: float = 1.5, period_ms: int = 10, age_ms: float = 5.0, clock_error_ms: float = 0.1
) -> int:
    """Feed frames; the time of the last."""
    now_ns = 10**12
    for number in range(int(seconds * 1000 / period_ms)):
        now_ns = 10**12 + number * period_ms * MS
        exposure_ns = now_ns - int(age_ms * MS)
        health.frame(SourceFrame(0, number, exposure_ns, now_ns, now_ns, int(clock_error_ms * MS), {}), now_ns)
    return now_ns


@pytest.mark.parametrize(
    ("after_ms", "state", "said"),
    [
        (0, "ok", ""),
        (29, "ok", ""),
        (35, "degraded", "no frame for 4 frame periods"),
        (101, "stale", "no frame for 101 ms"),
        (501, "lost", "no frame for 0.5 s"),
    ],
)
def test_silence(after_ms: int, state: str, said: str) -> None:
    health = Health(120.0)
    last_ns = streamed(health)
    found, detail = health.state(STATUS, last_ns + after_ms * MS)
    assert found == state
    assert detail.startswith(said)


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ({"period_ms": 12}, "83 frames/s, 100 nominal"),
        ({"age_ms": 25.0}, "25 ms from exposure to publication: high"),
        ({"age_ms": 150.0}, "150 ms from exposure to publication: far too old"),
        ({"age_ms": -3.0}, "frames from 3.0 ms ahead of now"),
        ({"clock_error_ms": 3.0}, "clock of the source known to 3.0 ms only"),
    ],
)
def test_warnings(shape: dict[str, float], said: str) -> None:
    health = Health(120.0)
    last_ns = streamed(health, **shape)  # type: ignore[arg-type]
    state, detail = health.state(STATUS, last_ns)
    assert state == "degraded"
    assert detail.startswith(said)


def test_slow_source_is_not_stale_between_its_frames() -> None:
    health = Health(10.0)
    last_ns = streamed(health, seconds=3.0, period_ms=100)
    status = STATUS._replace(nominal_rate_hz=10.0)
    assert health.state(status, last_ns + 250 * MS)[0] == "ok"
    assert health.state(status, last_ns + 450 * MS)[0] == "stale"


def test_words_of_the_source_come_first() -> None:
    health = Health(120.0)
    assert health.state(STATUS._replace(phase="searching"), 0) == ("connecting", "Motive: waiting (searching)")
    assert health.state(STATUS._replace(phase="refused", problem="too new"), 0) == ("refused", "too new")
    last_ns = streamed(health)
    assert health.state(STATUS._replace(problem="millimetres"), last_ns) == ("degraded", "millimetres")


def test_record_names_every_body() -> None:
    site = arena()
    pipeline = Pipeline(site, 5)
    pipeline.frame(SourceFrame(0, 1, 10**9, 10**9, 10**9, 0, {}), 10**9)
    status = STATUS._replace(
        names=frozenset(("r06", "r08")), duplicate_names=frozenset(("r08",)), malformed=3, counters={"old": 2}
    )
    record = pipeline.report(status, 10**9)
    assert {body.robot: body.reason for body in record.bodies} == {
        "r06": "missing",
        "r08": "duplicate_name",
        "r09": "not_in_model_list",
    }
    assert {body.reason for body in record.bodies} <= BODY_REASONS.keys()
    assert (record.malformed, record.counters, record.session) == (3, {"old": 2}, 5)
    assert log_of(record).event == f"mocap_{record.state}"
