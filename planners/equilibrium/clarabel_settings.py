"""Settings of Clarabel for programs of a posture's size."""

from __future__ import annotations

import clarabel


def solver_settings(*, equilibrate: bool, careful: bool = False) -> clarabel.DefaultSettings:
    """Clarabel's settings for small programs on one thread; no clock ends a solve, iterations do.

    Arguments:
        careful: slower, for the rare problem that the fast settings end on without an answer.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.presolve_enable = False
    settings.chordal_decomposition_enable = False
    settings.iterative_refinement_enable = careful
    settings.equilibrate_enable = equilibrate
    settings.equilibrate_max_iter = 10 if careful else 2
    return settings
