"""How long a stop takes to every emulated motor, measured stop by stop on a stage."""

from collections.abc import Callable, Collection, Iterator

from groundstation.faultrig import LATE_S, Stage
from groundstation.faultwords import zero_after_s

REST_S = 1.2


def stops(
    stage: Stage, how: Callable[[Stage], int], count: int, but: Collection[str] = ()
) -> Iterator[tuple[list[float], list[float]]]:
    """(motor zero, acknowledgement) in ms of every robot not named in ``but``, stop by stop.

    A station that speaks again after its silence lets robots on hold go on: what motors do from then on does not count.

    :param how: stops the swarm and tells since when, ns.
    :raises ValueError: a robot never heard a zero.
    """
    robots = [name for name in stage.arena.robots if name not in but]
    for _ in range(count):
        stage.to_running(least=len(stage.arena.robots) // 2 or 1)
        stage.forget()
        since_ns = how(stage)
        stage.watch(REST_S)
        until_ns = stage.link.now_ns()
        stage.repair()
        stage.watch(LATE_S)
        heard = ([s for s in stage.samples.get(name, ()) if s.stamp_ns < until_ns] for name in robots)
        zeros = [zero_after_s(samples, since_ns) for samples in heard]
        if None in zeros:
            raise ValueError(f"{robots[zeros.index(None)]} never heard a zero")
        answers = [stage.acknowledged_ns.get((name, stage.stop_id), since_ns) for name in robots]
        yield [zero * 1e3 for zero in zeros if zero is not None], [(then - since_ns) * 1e-6 for then in answers]
