"""The pytest plug-in that comes with the wheel: ``emulated_controller`` and ``mock_arena``, each with the fault verbs.

``emulated_controller(kind, **options)`` is a wheel controller with motors behind it on a pty of its own, for
drivers in any language. ``mock_arena(...)`` is a whole mission in virtual time over real bytes: poses, network,
agents, drivers, controllers. Faults are those of :data:`drivers.mock.faults.FAULTS`. Nothing is imported
before a test asks for it.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from groundstation.emulated import EmulatedPort, MockArena


@pytest.fixture
def emulated_controller(tmp_path: Path) -> "Iterator[Callable[..., EmulatedPort]]":
    """``emulated_controller("roboclaw", address=0x81)``: a controller on a pty, gone after the test."""
    from groundstation.emulated import EmulatedPort

    ports: list[EmulatedPort] = []

    def start(kind: str, **options: Any) -> EmulatedPort:
        ports.append(EmulatedPort(kind, tmp_path, options))
        return ports[-1]

    yield start
    for port in ports:
        port.close()


@pytest.fixture
def mock_arena() -> "Callable[..., MockArena]":
    """``mock_arena(robots=6, targets=19, seed=1, wheels=[...])``: a mission in virtual time."""
    from groundstation.emulated import MockArena

    return MockArena
