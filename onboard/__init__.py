"""Runs on each robot computer: the control law, the supervisor, the agent and its runtime."""
