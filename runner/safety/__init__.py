"""Safety: the stop latch, limits, watchdogs, the heartbeat monitor, and how runs end.

Read ``latch``, ``guard``, ``estop``, then ``heartbeat`` and ``ending``.
"""
