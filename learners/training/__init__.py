"""Learning by name: every method of ``stancekit fit``, and reinforcement.

Read ``fitting`` (every method by name), then ``reinforce``.
"""
