"""SciPy and cvxpy as commands import them: torch is loaded by tests of networks alone."""

from stancekit.cli.pictures import keep_as_written

keep_as_written()
