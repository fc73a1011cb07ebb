"""Warped space (Pan et al. §IV): spline maps that flatten a terrain, and how they push frames
forward.
"""
