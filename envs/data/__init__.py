"""Data sets of labelled posture problems: what an environment draws from and selectors learn
from.

Read ``ledger`` (rows on disk), ``dataset`` (rows as they are read), then ``label_plan`` and
``leap_tries`` (what is to be labelled).
"""
