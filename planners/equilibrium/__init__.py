"""Lin et al. §II as data and rows: layout, scaled numbers, every equation once (``terms``); in
cvxpy: ``relaxation.papers``.

Read ``terms`` (every equation), ``layout`` and ``rows`` (where it stands in a program), then
``scaled``, ``batch`` and ``programs``.
"""
