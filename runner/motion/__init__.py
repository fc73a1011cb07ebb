"""Motions: plans and gaits as functions of time."""
