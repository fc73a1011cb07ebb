"""Safety: the stop latch, limits, watchdogs, the heartbeat monitor, and how runs end."""
