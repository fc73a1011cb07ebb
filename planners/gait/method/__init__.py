"""Search for a walk: a guess, a homotopy, smoothing, densification, and a portfolio of attempts on
one budget.

Read ``guess``, ``attempt``, ``way``, then ``portfolio``, which spends a budget.
"""
