"""Controllers on a CAN bus."""
