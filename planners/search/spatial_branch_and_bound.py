"""Branch and bound on the box of P1: the domain of [p, f] is halved until a posture is found or
every box is refuted.

Each box carries P1 over it. A box is refuted where interval propagation leaves nothing of it or
where P1's signed margin is positive; where P1's answer projects onto a verified posture, the
problem is feasible. The first box holds all that the problem allows, and the halves of a box cover
it, so that a problem without open boxes is infeasible. Unlike the exact planner's, this search
shows how tight McCormick envelopes are, and what the choice of a cut is worth.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from ..answer.answer import Status
from ..answer.plan import Plan
from ..equilibrium.programs import Programs
from ..equilibrium.scaled import Point, Scaled
from ..files.arrays import Array
from ..problem import Problem
from ..projection.project import Projection, project
from ..relaxation.envelope import Envelope
from ..relaxation.mccormick import McCormick, domain_of, toe_ranges
from .answer import Acceptance, Claim, plan_of
from .clock import Clock

REFUTED_MARGIN = 1e-6
"""A box is refuted where P1's margin exceeds this: a hundred times the solver's tolerance."""
ROUNDING = 1e-9
SWEEPS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenBox:
    """A box that is neither refuted nor projected, and P1's answer over it.

    Arguments:
        margin: t, at most REFUTED_MARGIN.
        point: P1's [p, f], shape (N, 6).
        gaps: |m_jk − p_j f_k|, shape (N, 3, 3).
        depth: cuts from the first box.
    """

    box: Envelope
    margin: float
    point: Array
    gaps: Array
    depth: int


class BoxSearch:
    """One problem's search, best first: ``current`` is the open box of least margin, ``cut`` halves
    it.

    verdict: UNDECIDED while boxes are open. solves: convex problems so far. posture: the witness,
    where feasible.
    """

    def __init__(
        self,
        problem: Problem,
        scaled: Scaled,
        programs: Programs,
        *,
        projection: Projection = "fix-toes",
        acceptance: Acceptance = Acceptance(),
    ) -> None:
        self._problem, self._scaled, self._programs = problem, scaled, programs
        self._projection, self._acceptance = projection, acceptance
        self._queue: list[tuple[float, int, OpenBox]] = []
        self._pushed = 0
        self.solves = 0
        self.refuted = 0
        self.posture: Plan | None = None
        self._visit(domain_of(scaled, reach=False), depth=0)

    @property
    def verdict(self) -> Status:
        """Verdict that is proved so far."""
        if self.posture is not None:
            return Status.FEASIBLE
        return Status.UNDECIDED if self._queue else Status.INFEASIBLE

    @property
    def open(self) -> int:
        """Number of boxes that are neither refuted nor cut."""
        return len(self._queue)

    @property
    def current(self) -> OpenBox:
        """The open box of least margin.

        Raises IndexError where none is open.
        """
        return self._queue[0][2]

    def cut(self, dimension: int) -> None:
        """Halve the current box in the middle of this dimension, 0 … 6N − 1 (contact by contact),
        and visit both.
        """
        node = heapq.heappop(self._queue)[2]
        contact, column = divmod(dimension, 6)
        middle = 0.5 * (node.box.low[contact, column] + node.box.high[contact, column])
        for end in ("low", "high"):
            bounds = {"low": node.box.low.copy(), "high": node.box.high.copy()}
            bounds[end][contact, column] = middle
            if self.posture is None:
                self._visit(Envelope(**bounds), depth=node.depth + 1)

    def _visit(self, box: Envelope, *, depth: int) -> None:
        """Refute the box, or find a posture in it, or keep it open."""
        tight = propagate(self._scaled, box)
        if tight is None:
            self.refuted += 1
            return
        answer = self._relax(tight, depth)
        if answer is None:
            self.refuted += 1
            return
        node, point = answer
        if point is not None:
            self.posture = self._project(point)
        self._pushed += 1
        heapq.heappush(self._queue, (node.margin, self._pushed, node))

    def _relax(self, box: Envelope, depth: int) -> tuple[OpenBox, Point | None] | None:
        """P1 over the box; None where it is refuted.

        A solver that gives up leaves the box open, with no point.
        """
        answer = self._programs.get(McCormick, self._scaled.layout).solve(self._scaled, box)
        self.solves += 1
        if not answer.known:
            middle = 0.5 * (box.low + box.high)
            return OpenBox(
                box=box, margin=0.0, point=middle, gaps=np.zeros((len(middle), 3, 3)), depth=depth
            ), None
        if answer.margin > REFUTED_MARGIN or answer.at is None or answer.excess is None:
            return None
        gaps = np.abs(answer.excess)
        return OpenBox(
            box=box, margin=answer.margin, point=answer.at, gaps=gaps, depth=depth
        ), answer.point

    def _project(self, start: Point) -> Plan | None:
        """A verified posture from P1's point, or None."""
        point = project(self._programs, self._projection, self._scaled, start)
        self.solves += point.solves
        if not point.residual <= self._acceptance.tolerance:
            return None
        posture = plan_of(self._problem, self._scaled, self._scaled.numbers, point)
        outcome = self._acceptance.answer(
            self._problem, Claim(plan=posture), method=self._projection, clock=Clock.start()
        )
        return outcome.solution


def propagate(scaled: Scaled, box: Envelope) -> Envelope | None:
    """The box less what interval arithmetic rules out; None where nothing is left.

    p = toe − c with one c for all contacts; the friction cone; and Σ f = w e_z − F, by components.
    """
    low, high = box.low.copy(), box.high.copy()
    for _ in range(SWEEPS):
        if not (
            _share_com(scaled, low, high)
            and _in_cones(scaled, low, high)
            and _balance(scaled, low, high)
        ):
            return None
        if np.any(low > high + ROUNDING):
            return None
        high = np.maximum(low, high)
    return Envelope(low=low, high=high)


def _share_com(scaled: Scaled, low: Array, high: Array) -> bool:
    """Narrow p through the interval of the centre of mass, in place.

    False where that is empty.
    """
    toe_low, toe_high = toe_ranges(scaled)
    com_low = (
        np.maximum((toe_low - high[:, :3]).max(axis=0), scaled.com - scaled.com_radius) - ROUNDING
    )
    com_high = (
        np.minimum((toe_high - low[:, :3]).min(axis=0), scaled.com + scaled.com_radius) + ROUNDING
    )
    low[:, :3] = np.maximum(low[:, :3], toe_low - com_high)
    high[:, :3] = np.minimum(high[:, :3], toe_high - com_low)
    return bool(np.all(com_low <= com_high))


def _in_cones(scaled: Scaled, low: Array, high: Array) -> bool:
    """Narrow |f_y|, |f_z| ≤ μ f_n, in place.

    False where a frictionless contact would have to shear.
    """
    shear = scaled.friction * high[:, 3] + ROUNDING
    low[:, 4:] = np.maximum(low[:, 4:], -shear[:, None])
    high[:, 4:] = np.minimum(high[:, 4:], shear[:, None])
    least = np.maximum(np.maximum(low[:, 4:], -high[:, 4:]), 0.0).max(axis=1)
    rough = scaled.friction > ROUNDING
    low[rough, 3] = np.maximum(low[rough, 3], (least[rough] - ROUNDING) / scaled.friction[rough])
    return bool(np.all(least[~rough] <= 2.0 * ROUNDING))


def _balance(scaled: Scaled, low: Array, high: Array) -> bool:
    """Narrow every force component through Σ f = w e_z − F, in place.

    False where no forces balance.
    """
    frames = scaled.frames  # [i, r, k]: world component r of a unit force k at contact i
    ends = frames * low[:, None, 3:], frames * high[:, None, 3:]
    least, most = np.minimum(*ends), np.maximum(*ends)
    weight = scaled.borne[0]
    total_least, total_most = least.sum(axis=(0, 2)), most.sum(axis=(0, 2))
    if np.any(total_least > weight + ROUNDING) or np.any(total_most < weight - ROUNDING):
        return False
    room_most = (weight + ROUNDING - total_least)[
        :, None
    ] + least  # what the others leave to this term
    room_least = (weight - ROUNDING - total_most)[:, None] + most
    counts = np.abs(frames) > 1e-6
    safe = np.where(counts, frames, 1.0)
    first, second = room_least / safe, room_most / safe
    low[:, 3:] = np.maximum(
        low[:, 3:], np.where(counts, np.minimum(first, second), -np.inf).max(axis=1)
    )
    high[:, 3:] = np.minimum(
        high[:, 3:], np.where(counts, np.maximum(first, second), np.inf).min(axis=1)
    )
    return True
