"""Leaps: stance and flight over chosen patches, with the dynamics of one rigid body."""
