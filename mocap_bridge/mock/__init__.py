"""The motion-capture system from the other end: an emulated NatNet server with scripted faults."""
