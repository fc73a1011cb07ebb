"""What a planner counts while it works on one problem."""

from ..keyframes.clock import Clock

__all__ = ["Clock"]
