"""Which body an id of a frame is, by the server's model list. Pure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from mocap_bridge.natnet import modeldef, version
from mocap_bridge.natnet.modeldef import BodyModel
from mocap_bridge.natnet.version import Layout, Version
from mocap_bridge.natnet.wire import Malformed, Packet

OTHER_LAYOUTS = tuple(version.layout(Version(*v)) for v in ((4, 2), (4, 1), (4, 0), (3, 1), (2, 9)))
"""Every way of packing a model list, newest first."""


class ModelNames(NamedTuple):
    """One model list. A body is published only if its name and its id are its own."""

    names: Mapping[int, str] = {}
    """Body name by id."""
    known_ids: frozenset[int] = frozenset()
    """Every id of the list, those without a usable name included."""
    duplicate_names: frozenset[str] = frozenset()
    """Names that more than one body has."""
    duplicate_ids: frozenset[str] = frozenset()
    """Names of bodies that share an id."""
    known_names: frozenset[str] = frozenset()
    """The values of ``names``."""


def names_of(bodies: Sequence[BodyModel]) -> ModelNames:
    """The usable names of a model list; a body that is listed twice alike counts once."""
    own = {(body.name, body.id) for body in bodies}
    names = Counter(name for name, _ in own)
    ids = Counter(identity for _, identity in own)
    usable = {identity: name for name, identity in own if names[name] == ids[identity] == 1}
    return ModelNames(
        usable,
        frozenset(ids),
        frozenset(name for name, count in names.items() if count > 1),
        frozenset(name for name, identity in own if ids[identity] > 1),
        frozenset(usable.values()),
    )


def read_models(opened: Packet, layout: Layout) -> tuple[list[BodyModel], Layout]:
    """A MODELDEF in the layout expected, else in the first in which it decodes to its last byte.

    :raises Malformed: in no layout; the fault is the expected layout's.
    """
    try:
        return modeldef.decode_models(opened, layout), layout
    except Malformed as fault:
        for other in OTHER_LAYOUTS:
            try:
                return modeldef.decode_models(opened, other), other
            except Malformed:
                continue
        raise fault from None
