"""Constants of physics."""

GRAVITY_M_S2 = 9.81
"""Acceleration of free fall on Earth, wherever nothing else is said [m/s²]."""
