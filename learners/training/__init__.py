"""Learning by name: every method of ``stancekit fit``, and reinforcement.

Read ``loop`` (what every fit goes through, and its checkpoint), ``fitting`` (every method by name),
then ``reinforce``.
"""
