"""Data sets of labelled posture problems: what an environment draws from and selectors learn
from.
"""
