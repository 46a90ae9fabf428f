"""The source that the arena file asks for."""

from pathlib import Path

from contract.arena import Arena
from mocap_bridge.natnet import version
from mocap_bridge.sources.base import Source
from mocap_bridge.sources.natnet import NatNetSource
from mocap_bridge.sources.natnet_receiver import NatNetReceiver


class SourceError(ValueError):
    """The source cannot be opened; the text names the arena key and the remedy."""


def open_source(arena: Arena) -> Source:
    """Open ``mocap.source``, with the virtual bodies where the arena has both kinds.

    :raises SourceError: unknown version, no such interface, group, server name or recording.
    """
    tracked = _open_tracked(arena)
    if not arena.virtual_beside_tracked():
        return tracked
    from mocap_bridge.sources.virtual import WithVirtual

    return WithVirtual(arena, tracked)


def _open_tracked(arena: Arena) -> Source:
    source = arena.mocap.source
    if source == "natnet":
        return open_natnet(arena)
    if source == "replay":
        from mocap_bridge.sources.replay import ReplaySource
        from mocap_bridge.sources.tape_file import TapeError

        try:
            return ReplaySource(arena, Path(arena.mocap.recording))
        except TapeError as error:
            raise SourceError(f"mocap.recording: {error}") from None
    if source == "external":
        from mocap_bridge.sources.external import ExternalSource

        return ExternalSource(arena)
    from mocap_bridge.sources.qualisys import open_qualisys

    try:
        return open_qualisys(arena)
    except ImportError:
        raise SourceError(
            'mocap.source = "qualisys" needs the package qtm-rt: pip install "ahdc-fieldkit[qualisys]"'
        ) from None


def open_natnet(arena: Arena) -> NatNetSource:
    """A NatNet client of ``mocap.server``.

    :raises SourceError: unknown version, no such interface, group or server name.
    """
    mocap = arena.mocap
    try:
        receiver = NatNetReceiver("ahdc mocap bridge", version.parse(mocap.version), bool(mocap.multicast_group))
    except version.UnsupportedVersion as error:
        raise SourceError(f"mocap.version: {error}") from None
    try:
        return NatNetSource(
            receiver, mocap.server, mocap.command_port, mocap.local_address, mocap.multicast_group, mocap.data_port
        )
    except OSError as error:
        raise SourceError(
            f"mocap.local_address = {mocap.local_address}, mocap.server = {mocap.server}: {error.strerror or error}; "
            "local_address must be this machine's address in the motion-capture network"
        ) from None
