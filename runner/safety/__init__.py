"""Safety: the stop latch, limits, watchdogs, the heartbeat monitor, and how runs end.

Read ``estop`` (the latch, the buttons), ``guard``, then ``heartbeat`` and ``ending``.
"""
