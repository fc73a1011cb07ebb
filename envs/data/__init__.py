"""Data sets of labelled posture problems: what an environment draws from and selectors learn
from.

Read ``ledger`` (what is to be labelled, and rows on disk), ``dataset`` (rows as they are read), then
``leap_tries``.
"""
