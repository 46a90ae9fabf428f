"""Emulated controllers: the same protocols from the other end, motors and bodies included."""
