"""Where mission time goes: one word for what a robot was about in a control step. Pure."""

from contract.messages import RobotStep

ACTIVITIES = {
    "travel": "towards a target",
    "turning": "on the spot, before travelling",
    "follow": "without a target: towards an indicator, or the way pointed at the start",
    "link": "waiting at the bound of a link",
    "separation": "waiting for another robot to make way",
    "fence": "waiting at the fence",
    "hold": "occupying a target",
    "help": "answering HELP",
    "aside": "out of the way of another's target",
    "joining": "waiting for its first links",
}
"""Each word, and what it says in full; any other word is what :attr:`RobotStep.waits` says."""
_WORDS = {"": "travel", "indicator": "follow", "start": "follow", "free": "follow"}


def activity(step: RobotStep) -> str:
    """What the step was about; ``turning`` where the rims' difference exceeds their sum on the way somewhere."""
    word = _WORDS.get(step.waits, step.waits)
    if word in ("travel", "follow", "help", "aside"):
        left, right = step.left_radps, step.right_radps
        return "turning" if abs(right - left) > abs(right + left) else word
    return word
