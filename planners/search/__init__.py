"""Planners: searches over choices of patches and cuts in space, on relaxations and projections."""
