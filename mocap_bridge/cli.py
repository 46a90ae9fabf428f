"""``ahdc-mocap-bridge``: poses from a motion-capture system onto the swarm's network."""

import argparse
import importlib
import sys
from collections.abc import Sequence

VERBS = {
    "run": ("mocap_bridge.verbs.run", "connect to the motion-capture system and publish every frame"),
    "check": ("mocap_bridge.verbs.check", "check an arena file and say what the bridge would do with it"),
    "doctor": ("mocap_bridge.verbs.doctor", "look for poses and name what is wrong"),
    "record": ("mocap_bridge.verbs.record", "record raw datagrams with their times, for replay bit for bit"),
    "emulate": ("mocap_bridge.verbs.emulate", "be a NatNet server with circling bodies and scripted faults"),
}
EXAMPLES = """\
examples:
  ahdc-mocap-bridge check lab.toml              what the bridge would do
  ahdc-mocap-bridge emulate --arena lab.toml    a motion-capture system without cameras
  ahdc-mocap-bridge run --arena lab.toml        READY once the network is up; waits for the server

exit codes: 0 good, 1 failed, 2 bad input
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser = argparse.ArgumentParser(
        prog="ahdc-mocap-bridge",
        description=__doc__,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for name, (path, text) in VERBS.items():
        verb = verbs.add_parser(
            name, help=text, allow_abbrev=False, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        if words[:1] == [name]:
            importlib.import_module(path).configure(verb)
    options = parser.parse_args(words)
    try:
        return int(importlib.import_module(VERBS[options.verb][0]).run(options))
    except KeyboardInterrupt:
        return 0
    except BrokenPipeError:
        return 1
