"""Devices that are not here, played so that the real drivers cannot tell: for tests and benchmarks
only.
"""
