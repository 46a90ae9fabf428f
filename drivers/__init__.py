"""Wheel motors: one small codec and driver per controller family, behind one last gate."""
