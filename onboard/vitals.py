"""Whether a robot is well enough for its watchdog to be petted. Pure.

A service manager's watchdog is petted from the control loop, and only by a loop that does its work:

===========================  =========================================================
run state                    petted while
===========================  =========================================================
disarmed, stopped, fault     the loop runs: motors are off, and without motion capture
                             a robot may stand like this for days
armed, running, holding      the loop runs, *and* a pose frame and wheel feedback came
                             within the last ``PATIENCE_S``
===========================  =========================================================

A robot that is not petted for is ended and started again by the service manager. It comes up disarmed,
where poses and motors are not asked for: so it is restarted once, never in a loop, and never re-armed.
The robot's safety rests on none of this: zeros go out and the device watchdog lets go long before.
"""

from typing import Final, NamedTuple

from contract.messages import RunState

PATIENCE_S: Final = 10.0
"""A bridge that is started anew, or a body carried through a blind spot, is back before that."""
MOTORS_ON: frozenset[RunState] = frozenset({"armed", "running", "holding"})


class Vitals(NamedTuple):
    """How a robot is, of one turn of its loop."""

    run: RunState
    reason: str
    frame_ns: int
    """Arrival of the newest pose frame, site time; 0: none yet."""
    feedback_ns: int
    """Stamp of the newest wheel feedback, site time; 0: none yet."""


def stale(vitals: Vitals, now_ns: int, powered_ns: int) -> str:
    """What a robot whose motors are on has been without for too long; empty: nothing.

    :param powered_ns: since when the motors are on; what was missing before does not count.
    """
    if vitals.run not in MOTORS_ON:
        return ""
    for name, heard_ns in (("pose frame", vitals.frame_ns), ("wheel feedback", vitals.feedback_ns)):
        if now_ns - max(heard_ns, powered_ns) > PATIENCE_S * 1e9:
            return f"{vitals.run}, and no {name} for {PATIENCE_S:g} s"
    return ""
