"""Devices that are not here, played so that the real drivers cannot tell: for tests, benchmarks,
and a plan's first trial (``python -m tests.emulators``).
"""
