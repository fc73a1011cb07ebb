"""Warped space (paper W §IV): spline maps that flatten a terrain, and how they push frames forward."""
