"""The bodies of one frame by name, left in the datagram's bytes until somebody asks for one. Pure.

Fifty bodies are five hundred numbers: as objects that live until the next frame they cost more to keep in reach of the
processor than to make.
"""

import struct
from collections.abc import Iterator, Mapping
from typing import TypeVar, overload

from mocap_bridge.natnet.frame import BODY_BYTES, Body

T = TypeVar("T")
Placed = tuple[float, float, float, float, float, float, float]
"""``(x, y, z, qx, qy, qz, qw)`` as in :data:`mocap_bridge.natnet.frame.Body`."""
Sighted = tuple[float, float, float, float, float, float, float, float, int]
"""The same, then mean marker error and params."""

_BODY = struct.Struct("<i8fh")
_SIGHTED = struct.Struct("<4x8fh")
_PLACED = struct.Struct("<4x7f6x")


def ids_of(data: bytes) -> bytes:
    """The ids of :data:`BODY_BYTES` a body: those of two frames are the same if these are."""
    return data[::BODY_BYTES] + data[1::BODY_BYTES] + data[2::BODY_BYTES] + data[3::BODY_BYTES]


class Listed(Mapping[str, Body]):
    """Bodies of one frame.

    :param names: in the order of the frame, each once; the same object for frames whose names are the same.
    :param data: :data:`BODY_BYTES` a body.
    """

    __slots__ = ("_bodies", "_data", "names")

    def __init__(self, names: tuple[str, ...], data: bytes) -> None:
        self.names = names
        self._data = data
        self._bodies: dict[str, Body] | None = None

    def sighted(self) -> Iterator[Sighted]:
        """Of every body what has to be judged, in the order of the names."""
        return _SIGHTED.iter_unpack(self._data)

    def placed(self) -> Iterator[Placed]:
        """Of every body where it is, in the order of the names."""
        return _PLACED.iter_unpack(self._data)

    def _all(self) -> dict[str, Body]:
        if self._bodies is None:
            self._bodies = dict(zip(self.names, _BODY.iter_unpack(self._data), strict=True))
        return self._bodies

    def __getitem__(self, name: str) -> Body:
        return self._all()[name]

    @overload
    def get(self, name: str, /) -> Body | None: ...
    @overload
    def get(self, name: str, /, default: Body | T) -> Body | T: ...
    def get(self, name: str, /, default: object = None) -> object:
        """As of every mapping, at the speed of a dict."""
        return self._all().get(name, default)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)
