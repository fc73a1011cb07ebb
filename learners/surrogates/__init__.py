"""Surrogates of feasibility: networks that say feasible or infeasible at a stated error, and "ask"
of the rest.

Read ``features``, ``training``, ``calibration``, then ``surrogate``, which answers.
"""
