"""Learning by name: every method of ``stancekit fit``, and reinforcement."""
