"""Canonical postures: for each problem one posture that depends on the problem alone, not on the
method that found the problem feasible.

The toes are those that a fixed iteration converges to (``witness``). With these toes held fixed,
the body and the forces are the middle of the set that remains (``centre``), whatever other problems
are in the batch. If the iteration does not converge, the toes are those that the method found.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..equilibrium.batch import PointBatch, ScaledBatch
from ..equilibrium.programs import Programs
from ..problem import PostureBatch
from ..projection.centre import centred
from ..relaxation.mccormick import WithoutMoment
from ..verify import check_postures
from .answer import plan_of
from .witness import Iteration, witnesses

Index = NDArray[np.intp]
Found = dict[int, tuple[Plan, float]]
"""Postures by the index of their problem, each with its largest violation."""
SHORT, LONG = 96, 320
"""Steps of the iteration before a solver is asked, and after: most feasible problems need fewer
than the first."""


def canonical(batch: PostureBatch, steps: int = LONG, *, tolerance: float = 1e-6) -> Found:
    """Canonical postures of the problems that the iteration finds one for.

    Problems that are not in it may be feasible all the same.

    Arguments:
        tolerance: as in ``Acceptance``.
    """
    return gone_on(Iteration(ScaledBatch.of(batch)), batch, steps, tolerance=tolerance)


def gone_on(
    iteration: Iteration, batch: PostureBatch, until: int, *, tolerance: float = 1e-6
) -> Found:
    """``canonical`` of what is left of an iteration over the batch, which goes on until it has
    taken so many steps.
    """
    return _accepted(batch, iteration.scaled, iteration.claims(until), tolerance)


def with_toes(batch: PostureBatch, found: Mapping[int, Plan], *, tolerance: float = 1e-6) -> Found:
    """The middle of what these postures' toes leave, by the index of the problem; none where that
    has no inside.
    """
    index, scaled = np.array(list(found), dtype=np.intp), ScaledBatch.of(batch)
    toes = np.array([posture.toes_m for posture in found.values()]).reshape(
        -1, *scaled.friction.shape[1:], 3
    )
    held = scaled.select(index).held(toes / scaled.like.length_m)
    middles = _accepted(batch.select(index), held, witnesses(held, LONG), tolerance)
    return {int(index[k]): middle for k, middle in middles.items()}


def relaxed(batch: PostureBatch, *, tolerance: float = 1e-6) -> dict[int, Plan]:
    """Canonical points of P̄, which violate nothing but the balance of moments, where the iteration
    finds one.
    """
    scaled = ScaledBatch.of(batch)
    postures = _accepted(
        batch, scaled, witnesses(scaled, LONG, moments=False), tolerance, moments=False
    )
    return {k: posture for k, (posture, _) in postures.items()}


def without_moments(
    programs: Programs, batch: PostureBatch, *, tolerance: float = 1e-6
) -> dict[int, Plan]:
    """``relaxed``, and where the iteration comes to no end ``solved``."""
    postures = relaxed(batch, tolerance=tolerance)
    rest = np.array([k for k in range(len(batch)) if k not in postures], dtype=np.intp)
    ended = solved(programs, batch.select(rest), tolerance=tolerance)
    return postures | {int(rest[k]): posture for k, posture in ended.items()}


def solved(programs: Programs, batch: PostureBatch, *, tolerance: float = 1e-6) -> dict[int, Plan]:
    """The points of P̄ that the solver ends at; none where P̄ has none."""
    scaled, postures = ScaledBatch.of(batch), dict[int, Plan]()
    layout = scaled.like.layout
    for k in range(len(batch)):
        one = scaled.problem(k)
        point = programs.get(WithoutMoment, layout, bool(layout.reach_rows)).solve(one)
        if point is not None:
            posture = plan_of(batch.problems[k], one, one.numbers, point)
            worst = check_postures([posture], without=("moment_balance",))
            postures |= {k: posture} if worst[0] <= tolerance else {}
    return postures


def _accepted(
    batch: PostureBatch,
    scaled: ScaledBatch,
    claims: tuple[Index, PointBatch],
    tolerance: float,
    *,
    moments: bool = True,
) -> Found:
    """The middles of what the toes of claimed points leave, where the verifier accepts them."""
    index, points = claims
    some, problems = scaled.select(index), [batch.problems[k] for k in index.tolist()]
    postures = some.plans(centred(some, points, moments=moments), problems)
    worst = check_postures(postures, without=() if moments else ("moment_balance",)).tolist()
    return {
        k: (posture, off)
        for k, posture, off in zip(index.tolist(), postures, worst, strict=True)
        if off <= tolerance
    }
