"""``python -m groundstation``: the same as the ``ahdc-groundstation`` command."""

from groundstation.cli import main

raise SystemExit(main())
