"""NatNet, the protocol of OptiTrack's Motive: codec in both directions, client and clock, all pure.

Sources: OptiTrack's user documentation and the Apache-2.0 samples of NatNet SDK 3.1. Everything is
little-endian and packed; a datagram is ``u16 id, u16 payload bytes, payload``.
"""
