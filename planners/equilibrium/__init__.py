"""Lin et al. §II as data and rows: layout, scaled numbers, every equation once (``terms``); in
cvxpy: ``relaxation.papers``.
"""
