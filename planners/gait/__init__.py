"""Gait optimisation over height fields, after Pan et al. §III, §IV-C and §IV-D, whose method goes
back to TOWR.

Read ``settings``, ``variables``, ``charts``, ``constraints``, ``gait_program``, then ``method``
(the search for a walk); ``forbidden`` proves that there is none.
"""
