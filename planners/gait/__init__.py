"""Gait optimisation over height fields (Pan et al. §III, §IV-C, §IV-D; its root is TOWR)."""
