"""P exact for batches of posture problems: what they have in common is done at once, and witnesses
are canonical.

A feasible problem is answered with one posture that follows from the problem alone (``canonical``),
whoever else is in the batch and whatever found the problem feasible. The cheapest goes first: a
short iteration, the lift's certificate, a long iteration, branch and bound.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.answer import Answer, Effort, Status
from ..answer.certificate import Certificate
from ..answer.plan import Plan
from ..equilibrium.batch import PointBatch, ScaledBatch
from ..equilibrium.layout import Layout
from ..equilibrium.programs import Programs
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import BodyVariables, Forces, Given, HeldToes, Moments
from ..files.arrays import Array
from ..problem import PostureBatch
from ..projection.centre import centred
from ..relaxation.lift import LiftAnswer, solve_lift
from ..relaxation.mccormick import WithoutMoment
from ..verify import check_certificates, check_postures
from .answer import plan_of
from .cuts import LEAF
from .exact import Exact
from .witness import Iteration, witnesses

_CLEAR = 1e-3
"""Contacts have to lack this share of the weight, so that a solver's tolerance has no say."""
_AZIMUTH = np.arange(8) * np.pi / 4.0
_ELEVATION = 1.05
DIRECTIONS = np.column_stack(
    [
        np.cos(_ELEVATION) * np.cos(_AZIMUTH),
        np.cos(_ELEVATION) * np.sin(_AZIMUTH),
        np.full(8, np.sin(_ELEVATION)),
    ]
)
"""Unit vectors d, steep: on walls it is friction that lacks, and a little to the side the normals
help least."""


def unsupported(scaled: ScaledBatch) -> NDArray[np.bool_]:
    """Tell which problems have not even P̄, since no forces carry the weight, shape (B,); others
    may not, either.

    For some d the contacts together push less along d than the weight, and what else is on the
    body, asks: Σ max d·C f < d·(w e_z − F) over f_n ≤ f_max and the friction cones (E5, E10), a
    certificate's bound with ν_F = −d alone.
    """
    along = np.matmul(DIRECTIONS, scaled.frames)  # (B, N, 8, 3), d in contact frames
    shear = np.hypot(along[..., 1], along[..., 2])
    most = np.maximum(along[..., 0] + scaled.friction[..., None] * shear, 0.0)
    pushed = np.matmul(np.maximum(scaled.like.force_max[:, 0], 0.0), most)
    like = scaled.like
    least = like.weight * (DIRECTIONS[:, 2] - _CLEAR)
    if like.layout.wrench:
        least = least - DIRECTIONS @ like.wrench[0, :3]
    return np.asarray((pushed < least).any(axis=1))


class _StandingTest:
    """Test for c, Θ and f with toes that are held: fix-toes (``held``), its moments zero, nothing
    to minimise.

    Arguments:
        implied: leave out the rows of the force box that the cones imply (``Scaled.box_implied``).
    """

    def __init__(self, layout: Layout, implied: bool) -> None:
        self._rows = rows = Rows[Given](keep=layout.frames == 1)
        body, forces = BodyVariables(rows, layout), Forces.of_contacts(rows, layout)
        forces.balance()
        Moments.of(layout, body, forces, "held_arms").vanish(rows)
        forces.in_cones()
        forces.in_box(implied=implied)
        body.reach(HeldToes(rows), inner=True)
        body.limits()

    def admits(self, scaled: Scaled, toes: Array) -> bool:
        """Tell whether the solver met its own tolerances at a point with these toes, shape (N,
        3).
        """
        nothing = np.zeros((1, 3))
        held = Point(com=nothing, rotation=nothing, toes=toes, forces=toes, residual=float("inf"))
        solution = self._rows.solve(Given(scaled, held))
        return solution.solved and solution.exact


def stands(programs: Programs, scaled: Scaled, toes: Array) -> bool:
    """Tell whether a posture problem has a posture with these toes, shape (N, 3),
    non-dimensional.
    """
    return programs.get(_StandingTest, scaled.layout, scaled.box_implied).admits(scaled, toes)


_Index = NDArray[np.intp]
_Found = dict[int, tuple[Plan, float]]
"""Postures by the index of their problem, each with its largest violation."""
SHORT, LONG = 96, 320
"""Steps of the iteration before a solver is asked, and after: most feasible problems need fewer
than the first."""


def canonical(batch: PostureBatch, steps: int = LONG, *, tolerance: float = 1e-6) -> _Found:
    """Canonical postures of the problems that the iteration finds one for.

    Problems that are not in it may be feasible all the same.

    Arguments:
        tolerance: as in ``Acceptance``.
    """
    return _gone_on(Iteration(ScaledBatch.of(batch)), batch, steps, tolerance=tolerance)


def _gone_on(
    iteration: Iteration, batch: PostureBatch, until: int, *, tolerance: float = 1e-6
) -> _Found:
    """``canonical`` of what is left of an iteration over the batch, which goes on until it has
    taken so many steps.
    """
    return _accepted(batch, iteration.scaled, iteration.claims(until), tolerance)


def _with_toes(
    batch: PostureBatch, found: Mapping[int, Plan], *, tolerance: float = 1e-6
) -> _Found:
    """The middle of what these postures' toes leave, by the index of the problem; none where that
    has no inside.
    """
    index, scaled = np.array(list(found), dtype=np.intp), ScaledBatch.of(batch)
    toes = np.array([posture.toes_m for posture in found.values()]).reshape(
        -1, *scaled.friction.shape[1:], 3
    )
    held = scaled.select(index).held((toes - scaled.like.origin_m) / scaled.like.length_m)
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
    claims: tuple[_Index, PointBatch],
    tolerance: float,
    *,
    moments: bool = True,
) -> _Found:
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


@dataclass(frozen=True, kw_only=True)
class Decided:
    """Every problem's outcome.

    Arguments:
        relaxed: canonical points of P̄ that were found on the way, by the problem's index.
    """

    outcomes: list[Answer[Plan]]
    relaxed: dict[int, Plan]


def decide_all(planner: Exact, batch: PostureBatch, *, points: bool = False) -> Decided:
    """Decide every problem as ``planner.solve`` does, with the same verdicts and certificates, and
    with canonical witnesses.

    ``residual_nm`` is NaN but where the search decided; ``seconds`` are a share of what each stage
    took.

    Arguments:
        points: whether the canonical points of P̄ of all that is infeasible, but not trivially, are
            looked for.
    """
    work = _Batch(planner, batch)
    work.find(SHORT)
    work.refute()
    work.find(LONG)
    work.search()
    if points:
        work.relax()
    return Decided(outcomes=[work.answers[k] for k in range(len(batch))], relaxed=work.relaxed)


class _Batch:
    """Problems that are decided together. answers: so far, by index; relaxed: points of P̄."""

    def __init__(self, planner: Exact, batch: PostureBatch) -> None:
        self._planner, self._accept, self._batch = planner, planner.acceptance, batch
        self._problems = batch.problems  # made once, and shared by what is selected
        self._scaled = ScaledBatch.of(batch)
        self._iteration = Iteration(self._scaled)
        self._lifts: dict[int, LiftAnswer] = {}
        self._seconds = np.zeros(len(batch))
        self.answers: dict[int, Answer[Plan]] = {}
        self.relaxed: dict[int, Plan] = {}

    def find(self, steps: int) -> None:
        """Answer what the iteration finds until it has taken so many steps."""
        begin, left = time.perf_counter(), self._left()
        self._iteration.keep(left)
        points = _gone_on(self._iteration, self._batch, steps, tolerance=self._accept.tolerance)
        self._took(begin, left)
        for k, (posture, off) in points.items():
            self.answers[k] = Answer(
                status=Status.FEASIBLE,
                solution=posture,
                bound=0.0,
                residual=off,
                **self._told(k, nodes=0.0),
            )

    def refute(self) -> None:
        """Answer what the lift refutes."""
        begin, left, gap = time.perf_counter(), self._left(), self._accept.gap
        for k in left.tolist():
            self._lifts[k] = solve_lift(
                self._planner.kept, self._scaled.problem(k), least_moment=True
            )
        chosen = [k for k in left.tolist() if self._lifts[k].bound > gap]
        certificates = [
            Certificate(
                tree=np.array([LEAF]),
                multipliers=self._lifts[k].multipliers[None],
                problem=self._problems[k],
            )
            for k in chosen
        ]
        bounds = check_certificates(certificates).tolist()
        self._took(begin, left)
        for k, certificate, bound in zip(chosen, certificates, bounds, strict=True):
            if bound > gap:
                self._refuted(k, certificate, bound, trivial=bool(np.isinf(self._lifts[k].bound)))

    def search(self) -> None:
        """Answer what is left by branch and bound, with the middle of what its toes leave."""
        postures = dict[int, Plan]()
        for k in self._left().tolist():
            answer = self._planner.solve(self._problems[k], root=self._lifts[k])
            effort = answer.effort
            self.answers[k] = replace(
                answer, effort=replace(effort, seconds=effort.seconds + float(self._seconds[k]))
            )
            if answer.solution is not None:
                postures[k] = answer.solution
        for k, (posture, off) in _with_toes(
            self._batch, postures, tolerance=self._accept.tolerance
        ).items():
            self.answers[k] = replace(self.answers[k], solution=posture, report=None, residual=off)

    def relax(self) -> None:
        """Find points of P̄ for what is infeasible, but not trivially."""
        index = np.array(
            [
                k
                for k, one in self.answers.items()
                if one.certificate is not None and not one.details["trivial"]
            ],
            dtype=np.intp,
        )
        postures = relaxed(self._batch.select(index), tolerance=self._accept.tolerance)
        self.relaxed = {int(index[k]): posture for k, posture in postures.items()}

    def _refuted(self, k: int, certificate: Certificate, bound: float, *, trivial: bool) -> None:
        message = self._told(k, nodes=1.0, trivial=trivial)
        self.answers[k] = Answer(
            status=Status.INFEASIBLE, certificate=certificate, bound=bound, **message
        )

    def _left(self) -> _Index:
        left = [k for k in range(len(self._batch)) if k not in self.answers]
        return np.array(left, dtype=np.intp)

    def _told(self, k: int, *, nodes: float, trivial: bool = False) -> dict[str, Any]:
        """Fields of every answer before the search."""
        details = {"nodes": nodes, "trivial": float(trivial)}
        effort = Effort(solves=int(k in self._lifts), seconds=float(self._seconds[k]))
        return {"method": self._planner.name, "effort": effort, "details": details}

    def _took(self, begin: float, chosen: _Index) -> None:
        """Share out the time since ``begin`` among those that it was spent on."""
        self._seconds[chosen] += (time.perf_counter() - begin) / max(len(chosen), 1)
