"""Scores of leaps' candidates that are learned from labelled tries."""
