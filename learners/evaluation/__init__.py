"""Comparing: Table I's shares, and the benches of selectors and planners."""
