"""Robots as the gait optimiser sees them, one file a robot, every number with its source."""
