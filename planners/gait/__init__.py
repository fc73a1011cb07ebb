"""Gait optimisation over height fields, after Pan et al. §III, §IV-C and §IV-D, whose method goes
back to TOWR.
"""
