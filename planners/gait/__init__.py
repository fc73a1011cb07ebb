"""Gait optimisation over height fields (paper W §III, §IV-C, §IV-D; its root is TOWR)."""
