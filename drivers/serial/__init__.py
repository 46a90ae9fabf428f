"""Controllers on a serial line."""
