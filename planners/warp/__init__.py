"""Warped space (Pan et al. §IV): spline maps that flatten a terrain, and how they push frames
forward.

Read ``spline_map`` (equation W1), ``energy``, then ``conformal``, which fits it.
"""
