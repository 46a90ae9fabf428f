"""Poses in: motion-capture streams to one checked whole-frame message on the network."""
