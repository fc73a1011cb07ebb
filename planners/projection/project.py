"""P2 by name: back onto the bilinear surface m = p·f, from a point of a relaxation.

What keeps what, and what it frees:

- ``fix-p`` keeps p (toes, c and Θ) and solves for f: Lin et al. §IV-A, "we use p_b from P1 to solve
  f";
- ``fix-f`` keeps f and solves for toes, c, Θ: Lin et al. §II;
- ``fix-toes`` keeps toes in the world, and solves for f, c, Θ: convex, as Σ f is fixed
  (``terms.Moments``);
- ``scp`` starts at the toes and keeps nothing: it alternates ``fix-toes`` with steps of all,
  linearised;
- ``nlp`` starts at the point and keeps nothing: Lin et al. §IV-A, by IPOPT (``nlp``);
- ``lift-fix-p`` frees all, then f alone: the lift of least gap about the point, then ``fix-p``.

A posture is projected to the least moment residual; a course, whose plans have an objective, to
residual zero. One of one's own is one function, called as these are; what it says is verified as
whatever a planner found.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from ..errors import InvalidInput
from ..plugins import Registry, foreign, takes
from ..relaxation.lift import LeastGap
from .held import FixForces, FixToes, Linearised

Projection = str
"""A name of ``PROJECTIONS``, or "FILE.py:NAME"."""
PROJECTIONS: Registry[Callable[[Programs, Scaled, Point, int], Point]] = Registry(
    "projection",
    "stancekit.projections",
    {
        name: f"{__name__}:_{name.replace('-', '_')}"
        for name in ("fix-p", "fix-f", "fix-toes", "scp", "nlp", "lift-fix-p")
    },
    expected="something to call with programs, a scaled problem, a point and a number of steps",
    accepts=lambda it: takes(it, 4),
)
"""All of them: called with the programs of this process, a problem with one candidate a foothold,
the point to start from and the most linearised steps, a function gives a point, its residual inf
where there is none."""
SURFACE = 1e-7
"""A point this close to the bilinear surface (non-dimensional moment residual) needs no further
step."""
STEPS = 6
"""Most linearised steps of SCP."""
STALLED = 0.9
"""A posture's SCP ends where a step leaves more than this share of the moment: one that gets there
leaves far less."""


def project(
    programs: Programs,
    projection: Projection,
    scaled: Scaled,
    start: Point,
    *,
    steps: int = STEPS,
    deadline: float = float("inf"),
) -> Point:
    """Project ``start`` on the bilinear surface, one candidate a foothold; the residual is inf
    without an answer.

    Arguments:
        steps, deadline: most linearised steps of "scp", and when they have to end, see ``scp``.

    Raises:
        InvalidInput: for an unknown name, and what one of another package or of a file raises.
    """
    make = PROJECTIONS.get(projection)
    if make is _scp:
        return scp(programs, scaled, start, steps=steps, deadline=deadline)
    if getattr(make, "__module__", "") == __name__:
        return make(programs, scaled, start, steps)
    with foreign(f"projection {projection}"):
        point = make(programs, scaled, start, steps)
    if not isinstance(point, Point):
        raise InvalidInput(
            f"projection {projection}: expected a Point, got a {type(point).__name__}"
        )
    return point


def _fix_p(programs: Programs, scaled: Scaled, start: Point, _: int) -> Point:
    return programs.get(FixToes, scaled.layout, True, True).solve(scaled, start)


def _fix_f(programs: Programs, scaled: Scaled, start: Point, _: int) -> Point:
    return programs.get(FixForces, scaled.layout).solve(scaled, start)


def _fix_toes(programs: Programs, scaled: Scaled, start: Point, _: int) -> Point:
    return programs.get(FixToes, scaled.layout, False, scaled.weights is None).solve(scaled, start)


def _nlp(programs: Programs, scaled: Scaled, start: Point, _: int) -> Point:
    from .nlp import NlpProgram  # CasADi is slow to import

    return programs.get(NlpProgram, scaled.layout, scaled.weights is None).solve(
        programs, scaled, start
    )


def _lift_fix_p(programs: Programs, scaled: Scaled, start: Point, _: int) -> Point:
    near = programs.get(LeastGap, scaled.layout).solve(scaled, start)
    point = programs.get(FixToes, scaled.layout, True, True).solve(
        scaled, near if near.residual == 0.0 else start
    )
    return replace(point, solves=2, seconds=near.seconds + point.seconds)


def _scp(programs: Programs, scaled: Scaled, start: Point, steps: int) -> Point:
    return scp(programs, scaled, start, steps=steps)


def scp(
    programs: Programs,
    scaled: Scaled,
    start: Point,
    *,
    steps: int = STEPS,
    worth: float = float("inf"),
    deadline: float = float("inf"),
) -> Point:
    """Fix the toes; while that leaves a moment, step along the linearised surface and fix the new
    toes.

    Arguments:
        worth: of a posture, take no step where the first toes leave more than this; none, either,
            after one that stalled.
        deadline: begin no step that would end after it (``time.perf_counter()``), by how long the
            one before took, and of the first by how long the solve before it took.
    """
    least = scaled.weights is None
    held, step, began = (
        programs.get(FixToes, scaled.layout, False, least),
        None,
        time.perf_counter(),
    )
    best = point = held.solve(scaled, start)
    solves, seconds, most, each = 1, point.seconds, float("inf"), 2 if least else 3
    for k in range(steps):
        took, began = (1 if k else each) * (time.perf_counter() - began), time.perf_counter()
        if began + took > deadline:
            break
        vain = least and (
            not np.isfinite(point.residual) or best.residual > worth or point.residual > most
        )
        if best.residual <= SURFACE or vain:
            break
        most = STALLED * point.residual
        about = (
            point
            if least
            else programs.get(FixToes, scaled.layout, False, True).solve(scaled, point)
        )
        if not np.isfinite(about.residual):
            about = replace(start, toes=point.toes)
        step = step or programs.get(Linearised, scaled.layout, least)
        stepped = step.solve(scaled, about)
        solves, seconds = (
            solves + (1 if least else 2),
            seconds + stepped.seconds + (0.0 if least else about.seconds),
        )
        if not np.isfinite(stepped.residual):
            break
        start, point = stepped, held.solve(scaled, stepped)
        solves, seconds = solves + 1, seconds + point.seconds
        best = point if point.residual < best.residual else best
    return replace(best, solves=solves, seconds=seconds)


_SHARES = (1.0, 0.3, 0.1)
"""Shares of a linearised step, tried in this order until one is better."""


def improved(
    programs: Programs,
    scaled: Scaled,
    point: Point,
    count: Callable[[int, float], object],
    *,
    steps: int = 8,
    least: float = 1e-9,
) -> Point:
    """A plan at least as good, by linearised steps on the bilinear surface, each with the toes held
    afterwards.

    Arguments:
        point: on the surface, one candidate a foothold.
        count: called with solves and their seconds.
        steps: the most.
        least: an improvement of the objective, in units of the length scale squared, worth another
            step.
    """
    step, held = (
        programs.get(Linearised, scaled.layout, False),
        programs.get(FixToes, scaled.layout, False, False),
    )
    best, value = point, cost(scaled, point)
    for _ in range(steps):
        stepped = step.solve(scaled, best)
        count(1, stepped.seconds)
        if not np.isfinite(stepped.residual):
            return best
        before = value
        for share in _SHARES:
            result = held.solve(
                scaled, replace(best, toes=best.toes + share * (stepped.toes - best.toes))
            )
            count(1, result.seconds)
            if result.residual <= SURFACE and cost(scaled, result) < value:
                best, value = result, cost(scaled, result)
                break
        if before - value < least:
            return best
    return best


def cost(scaled: Scaled, point: Point) -> float:
    """The objective of Lin et al. §IV-B at a point, in units of the length scale squared.

    Goal, nominal path, tilt, steps of the COM and of the toes, with the weights of the course
    (``Weights``); of one candidate a foothold.
    """
    weights, moves = scaled.aim, scaled.layout.moves
    value = weights.goal * float(np.sum((point.com[-1] - scaled.goal) ** 2))
    value += weights.com_path * float(np.sum((point.com - scaled.com) ** 2))
    value += weights.tilt / scaled.length_m**2 * float(np.sum(point.rotation**2))
    value += weights.com_step * float(np.sum(np.diff(point.com, axis=0) ** 2))
    if scaled.layout.stands:
        frame, _, foothold = scaled.layout.standing
        value += weights.stance * float(
            np.sum((point.toes[foothold] - point.com[frame] - scaled.standing) ** 2)
        )
    return value + weights.toe_step * float(
        np.sum((point.toes[moves[:, 1]] - point.toes[moves[:, 0]]) ** 2)
    )
