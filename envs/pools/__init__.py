"""Data sets of ``stancekit label`` that ship, found by ``data.pools`` and made by
benchmarks/pools.py.
"""
