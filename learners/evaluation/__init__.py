"""Comparing: Table I's shares, and the benches of selectors and planners.

Read ``evaluate`` (one selector, and Table I), then the benches of planners and walks, and ``room``
(how much there is to gain, and the finders of leaps).
"""
