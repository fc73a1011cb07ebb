"""P2 by name: back onto the bilinear surface m = p·f, from a point of a relaxation.

========== ===================================== ======================= ==============================================
name       keeps                                 frees                   source
========== ===================================== ======================= ==============================================
fix-p      p (toes, c and Θ)                     f                       paper E §IV-A, "we use p_b from P1 to solve f"
fix-f      f                                     toes, c, Θ              paper E §II
fix-toes   toes in the world                     f, c, Θ                 convex as Σ f is fixed (``terms.Moments``)
scp        nothing, starts at the toes           all                     fix-toes, then some linearised steps
nlp        nothing, starts at the point          all                     paper E §IV-A, ``nlp``
========== ===================================== ======================= ==============================================

A posture is projected to the least moment residual; a course, whose plans have an objective, to residual zero.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from .held import FixForces, FixToes, Linearised

Projection = Literal["fix-p", "fix-f", "fix-toes", "scp", "nlp"]
PROJECTIONS: tuple[Projection, ...] = get_args(Projection)
SURFACE = 1e-7
"""A point this close to the bilinear surface (non-dimensional moment residual) needs no further step."""
STEPS = 6
"""Most linearised steps of SCP."""


def project(programs: Programs, projection: Projection, scaled: Scaled, start: Point, *, steps: int = STEPS) -> Point:
    """Project ``start`` on the bilinear surface, one candidate a foothold; the residual is inf without an answer.

    steps: most linearised steps of "scp".
    """
    least = scaled.weights is None
    if projection == "fix-p":
        return programs.get(FixToes, scaled.layout, True, True).solve(scaled, start)
    if projection == "fix-f":
        return programs.get(FixForces, scaled.layout).solve(scaled, start)
    if projection == "fix-toes":
        return programs.get(FixToes, scaled.layout, False, least).solve(scaled, start)
    if projection == "nlp":
        from .nlp import NlpProgram  # CasADi is slow to import

        return programs.get(NlpProgram, scaled.layout, least).solve(programs, scaled, start)
    return scp(programs, scaled, start, steps=steps)


def scp(programs: Programs, scaled: Scaled, start: Point, *, steps: int = STEPS, worth: float = float("inf")) -> Point:
    """Fix the toes; while that leaves a moment, step along the linearised surface and fix the new toes.

    worth: of a posture, take no step where the first toes leave more than this.
    """
    least = scaled.weights is None
    held, step = programs.get(FixToes, scaled.layout, False, least), None
    best = point = held.solve(scaled, start)
    solves, seconds = 1, point.seconds
    for _ in range(steps):
        if best.residual <= SURFACE or (least and not (np.isfinite(point.residual) and best.residual <= worth)):
            break
        about = point if least else programs.get(FixToes, scaled.layout, False, True).solve(scaled, point)
        if not np.isfinite(about.residual):
            about = replace(start, toes=point.toes)
        step = step or programs.get(Linearised, scaled.layout, least)
        stepped = step.solve(scaled, about)
        solves, seconds = solves + (1 if least else 2), seconds + stepped.seconds + (0.0 if least else about.seconds)
        if not np.isfinite(stepped.residual):
            break
        start, point = stepped, held.solve(scaled, stepped)
        solves, seconds = solves + 1, seconds + point.seconds
        best = point if point.residual < best.residual else best
    return replace(best, solves=solves, seconds=seconds)
