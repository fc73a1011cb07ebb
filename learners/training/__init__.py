"""Learning by name: every method of ``stancekit fit``.

Read ``loop`` (what every fit goes through, and its checkpoint), then ``fitting`` (every method by
name).
"""
