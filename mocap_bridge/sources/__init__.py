"""Where poses come from: every source turns what it receives into a :class:`base.SourceFrame`."""
