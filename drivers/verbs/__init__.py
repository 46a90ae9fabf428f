"""One module a verb of ``ahdc-drivers``."""
