"""Planners: searches over choices of patches and over cuts in space, with stages P1 and P2 at every
node.
"""
