"""Canonical postures: of all that a problem has, one that follows from the problem alone, whatever found it feasible.

The toes are those that a fixed iteration comes to (``witness``), and with them held the rest is the middle of what is
left (``centre``), whoever else is in the batch. Where the iteration comes to no end the toes are those that were found.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..answer.posture import Posture
from ..equilibrium.batch import PointBatch, ScaledBatch
from ..equilibrium.programs import Programs
from ..problem import PostureBatch
from ..projection.centre import centred
from ..relaxation.mccormick import WithoutMoment
from ..verify import check_postures
from .witness import Iteration, witnesses

Index = NDArray[np.intp]
Found = dict[int, tuple[Posture, float]]
"""Postures by the index of their problem, each with its largest violation."""
SHORT, LONG = 96, 320
"""Steps of the iteration before a solver is asked, and after: most feasible problems need fewer than the first."""


def canonical(batch: PostureBatch, steps: int = LONG, *, tolerance: float = 1e-6) -> Found:
    """Canonical postures of the problems that the iteration finds one for.

    tolerance: as in ``Acceptance``. Problems that are not in it may be feasible all the same.
    """
    return gone_on(Iteration(ScaledBatch.of(batch)), batch, steps, tolerance=tolerance)


def gone_on(iteration: Iteration, batch: PostureBatch, until: int, *, tolerance: float = 1e-6) -> Found:
    """``canonical`` of what is left of an iteration over the batch, which goes on until it has taken so many steps."""
    return _accepted(batch, *_centres(iteration.scaled, iteration.claims(until)), tolerance)


def with_toes(batch: PostureBatch, found: Mapping[int, Posture], *, tolerance: float = 1e-6) -> Found:
    """The middle of what these postures' toes leave, by the index of the problem; none where that has no inside."""
    index, scaled = np.array(list(found), dtype=np.intp), ScaledBatch.of(batch)
    toes = np.array([posture.toes_m for posture in found.values()]).reshape(-1, *scaled.friction.shape[1:], 3)
    held = scaled.select(index).held(toes / scaled.like.length_m)
    middles = _accepted(batch.select(index), *_centres(held, witnesses(held, LONG)), tolerance)
    return {int(index[k]): middle for k, middle in middles.items()}


def relaxed(batch: PostureBatch, *, tolerance: float = 1e-6) -> dict[int, Posture]:
    """Canonical points of P̄, which violate nothing but the balance of moments, where the iteration finds one."""
    scaled = ScaledBatch.of(batch)
    found = _accepted(batch, *_centres(scaled, witnesses(scaled, LONG, moments=False), moments=False), tolerance, False)
    return {k: posture for k, (posture, _) in found.items()}


def without_moments(programs: Programs, batch: PostureBatch, *, tolerance: float = 1e-6) -> dict[int, Posture]:
    """``relaxed``, and where the iteration comes to no end ``solved``."""
    found = relaxed(batch, tolerance=tolerance)
    rest = np.array([k for k in range(len(batch)) if k not in found], dtype=np.intp)
    ended = solved(programs, batch.select(rest), tolerance=tolerance)
    return found | {int(rest[k]): posture for k, posture in ended.items()}


def solved(programs: Programs, batch: PostureBatch, *, tolerance: float = 1e-6) -> dict[int, Posture]:
    """The points of P̄ that the solver ends at; none where P̄ has none."""
    scaled, postures = ScaledBatch.of(batch), dict[int, Posture]()
    layout = scaled.like.layout
    for k in range(len(batch)):
        point = programs.get(WithoutMoment, layout, bool(layout.reach_rows)).solve(scaled.problem(k))
        if point is not None:
            posture = scaled.problem(k).posture(point)
            worst = check_postures([batch.problems[k]], [posture], without=("moment_balance",))
            postures |= {k: posture} if worst[0] <= tolerance else {}
    return postures


def _centres(
    scaled: ScaledBatch, claims: tuple[Index, PointBatch], *, moments: bool = True
) -> tuple[Index, list[Posture]]:
    index, points = claims
    some = scaled.select(index)
    return index, some.postures(centred(some, points, moments=moments))


def _accepted(
    batch: PostureBatch, index: Index, postures: list[Posture], tolerance: float, moments: bool = True
) -> Found:
    """Those that the verifier accepts."""
    without = () if moments else ("moment_balance",)
    worst = check_postures([batch.problems[k] for k in index.tolist()], postures, without=without).tolist()
    return {
        k: (posture, off) for k, posture, off in zip(index.tolist(), postures, worst, strict=True) if off <= tolerance
    }
