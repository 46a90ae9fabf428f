"""The verbs of ``ahdc-mocap-bridge``, one module each, imported only when used."""
