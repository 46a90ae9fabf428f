"""``python -m mocap_bridge`` is ``ahdc-mocap-bridge``."""

import sys

from mocap_bridge.cli import main

if __name__ == "__main__":
    sys.exit(main())
