"""Software to robots' computers: what goes there, how it is checked, switched on and taken back (docs/deploy.md)."""
