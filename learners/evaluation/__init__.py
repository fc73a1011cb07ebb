"""Comparing: Table I's shares, and the benches of selectors and planners.

Read ``evaluate`` (one selector), ``bench`` (Table I), then the benches of leaps, planners and
walks, and ``room`` (how much there is to gain).
"""
