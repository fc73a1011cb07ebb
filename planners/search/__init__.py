"""Planners: searches over choices of patches and over cuts in space, with stages P1 and P2 at every
node.

Read ``two_stage`` (Lin et al.'s method), ``exact``, ``cuts``, ``choice`` (which patches), ``witness``,
then ``plan_course``, ``pieces`` and ``methods``; ``flood`` proves that there is no way.
"""
