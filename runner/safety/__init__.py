"""Safety: the stop latch, limits, watchdogs, the heartbeat monitor, and how runs end.

Read ``estop`` (the latch, the buttons), ``guard`` (and how runs end), then ``heartbeat``.
"""
