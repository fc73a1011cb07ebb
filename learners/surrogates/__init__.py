"""Surrogates of feasibility: networks that say feasible or infeasible at a stated error, and "ask"
of the rest.

Read ``features``, ``calibration``, then ``surrogate``, which is trained and answers.
"""
