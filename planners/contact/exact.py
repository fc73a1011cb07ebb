"""P exact: the posture problem decided by branch and bound, with a witness or a certificate.

Best-first on the lift (``lift.py``) as lower bound and SCP from its toes (``project.py``) as upper bound. A node
confines contacts to pieces of their patches and of their force boxes; on a piece of no size the lift is exact, so
bisection ends. A node whose moment residual is proved above the gap is closed; when all are, the tree and the lift's
multipliers are the certificate. Every answer is put through the independent verifier before it is given.
"""

from __future__ import annotations

import heapq
import itertools
import time
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Array
from ..outcome import Certificate, InvalidInput, Outcome, Posture
from ..scene import PostureProblem
from .lift import LiftAnswer
from .planner import Acceptance
from .project import SURFACE
from .scaled import ScaledProblem
from .stages import Stages

PATCH_UNIT_M = 0.1
"""A force interval of half this many patch sizes is as wide as the patch: the rule of when to cut the patch instead."""

WORTH = 2e-3
"""Moment residual from which, above three times a node's bound, SCP is not tried at the node's toes."""


@dataclass(kw_only=True, eq=False)
class _Node:
    """A node of the tree: where it confines the contacts to, what the lift says there, and how it was split."""

    scaled: ScaledProblem
    pieces: tuple[Array, ...]
    lift: LiftAnswer
    split: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    children: list[_Node] = field(default_factory=list)

    def rows(self) -> tuple[list[tuple[float, float, float, float, float]], list[Array]]:
        """The certificate's rows below this node, in preorder."""
        tree, multipliers = [self.split], [] if self.children else [self.lift.multipliers]
        for child in self.children:
            below, proofs = child.rows()
            tree += below
            multipliers += proofs
        return tree, multipliers


class ExactPlanner:
    """Feasible with a witness, infeasible with a certificate, or undecided at a limit.

    acceptance: problems whose least moment residual lies between its two figures stay undecided.
    max_nodes, time_limit_s: where to stop and say undecided.
    """

    name = "exact"

    def __init__(
        self,
        *,
        acceptance: Acceptance = Acceptance(),
        max_nodes: int = 2000,
        time_limit_s: float = 30.0,
        stages: Stages | None = None,
    ) -> None:
        if not time_limit_s >= 0.0:
            raise InvalidInput(f"time_limit_s: expected a number of at least 0, got {time_limit_s!r}")
        if max_nodes < 0:
            raise InvalidInput(f"max_nodes: expected 0 or more, got {max_nodes!r}")
        self.acceptance = acceptance
        self.max_nodes = max_nodes
        self.time_limit_s = time_limit_s
        self.stages = stages or Stages()

    def solve(self, problem: PostureProblem, *, root: LiftAnswer | None = None) -> Outcome:
        """Decide the problem. root: its lift, where it has been solved before."""
        begin = time.perf_counter()
        scaled = ScaledProblem.of(problem)
        pieces = tuple(contact.patch.vertices_m / scaled.length_m for contact in problem.contacts)
        search = _Search(self, scaled, pieces, root)
        posture, certificate = search.run(begin + self.time_limit_s)
        return self.acceptance.outcome(
            problem,
            method=self.name,
            begin=begin,
            posture=posture,
            certificate=certificate,
            solves=search.solves,
            message=search.stopped,
            details={"nodes": float(search.nodes), "trivial": float(np.isinf(search.root.lift.bound))},
        )


class _Search:
    """One branch and bound."""

    def __init__(
        self, planner: ExactPlanner, scaled: ScaledProblem, pieces: tuple[Array, ...], root: LiftAnswer | None
    ) -> None:
        self._planner = planner
        self.solves = 0
        self.nodes = 0
        self.stopped = ""
        self.root = self._node(scaled, pieces, root)

    def run(self, deadline: float) -> tuple[Posture | None, Certificate | None]:
        """Return a witness, or a certificate, or neither with ``stopped`` telling why."""
        order = itertools.count()
        queue = [(self.root.lift.bound, next(order), self.root)]
        while queue:
            bound, _, node = heapq.heappop(queue)
            if bound > self._planner.acceptance.gap:
                break  # best first: every open node is closed, too
            if self.nodes > self._planner.max_nodes or time.perf_counter() > deadline or not node.lift.solved:
                self.stopped = "stopped at the time, node or solver limit"
                return None, None
            found = self._project(node)
            if found is not None:
                return found, None
            for child in self._branch(node):
                node.children.append(child)
                heapq.heappush(queue, (child.lift.bound, next(order), child))
        tree, multipliers = self.root.rows()
        return None, Certificate(tree=np.array(tree), multipliers=np.array(multipliers))

    def _node(self, scaled: ScaledProblem, pieces: tuple[Array, ...], lift: LiftAnswer | None = None) -> _Node:
        self.solves += 1
        self.nodes += 1
        return _Node(scaled=scaled, pieces=pieces, lift=lift or self._planner.stages.lift(scaled))

    def _project(self, node: _Node) -> Posture | None:
        """A witness from the node's toes, or None. The whole problem's boxes hold, not only the node's.

        Below the root, toes that leave far more than the node's bound are left alone: steps from them hardly ever pay.
        """
        whole = self.root.scaled
        worth = np.inf if node is self.root else 3.0 * node.lift.bound + WORTH
        point = self._planner.stages.project("scp", whole, node.lift.point, worth=worth)
        self.solves += point.solves
        if point.residual > max(SURFACE, 0.5 * self._planner.acceptance.tolerance):
            return None
        return whole.posture(com=point.com, rotation=point.rotation, toes=point.toes, forces=point.forces)

    def _branch(self, node: _Node) -> list[_Node]:
        """Two children that cover the node."""
        index, axis, spread = _widest_spread(node.lift)
        scaled, piece = node.scaled, node.pieces[index]
        low, high = scaled.force_min[index].copy(), scaled.force_max[index].copy()
        size = float(np.max(np.linalg.norm(piece[:, None] - piece[None], axis=-1))) * scaled.length_m
        if spread < 1e-9 or high[axis] - low[axis] < 0.5 * size / PATCH_UNIT_M:
            first, second = halving_chord(piece)
            node.split = (2.0, float(index), 0.0, first, second)
            return [self._child(node, index, part, low, high) for part in cut(piece, first, second)]
        value = 0.5 * (low[axis] + high[axis])
        node.split = (3.0, float(index), float(axis), float(value), 0.0)
        below, above = high.copy(), low.copy()
        below[axis] = above[axis] = value
        return [self._child(node, index, piece, low, below), self._child(node, index, piece, above, high)]

    def _child(self, node: _Node, index: int, piece: Array, low: Array, high: Array) -> _Node:
        pieces = (*node.pieces[:index], piece, *node.pieces[index + 1 :])
        return self._node(node.scaled.narrowed(index, piece, low, high), pieces)


def _widest_spread(lift: LiftAnswer) -> tuple[int, int, float]:
    """The contact and force component whose f_u / λ_u differ most over the vertices, weighted by λ."""
    share = lift.weights[..., None]
    per_vertex = lift.by_vertex / np.maximum(share, 1e-9)
    mean = lift.forces[:, None, :]
    spread = np.sqrt(np.sum(share * (per_vertex - mean) ** 2, axis=1))  # shape (N, 3)
    index, axis = np.unravel_index(int(np.argmax(spread)), spread.shape)
    return int(index), int(axis), float(spread[index, axis])


def halving_chord(piece: Array) -> tuple[float, float]:
    """Border coordinates of a chord that halves a polygon: a triangle's median to its longest edge, else a diagonal."""
    count = len(piece)
    if count > 3:
        return 0.0, float(count // 2)
    edge = int(np.argmax(np.linalg.norm(np.roll(piece, -1, axis=0) - piece, axis=1)))
    first, second = sorted((edge + 0.5, float((edge + 2) % 3)))
    return first, second


def cut(piece: Array, first: float, second: float) -> tuple[Array, Array]:
    """The two parts of a convex polygon on either side of a chord, as ``Certificate`` orders them."""
    count = len(piece)

    def point(coordinate: float) -> Array:
        edge, share = int(coordinate), coordinate - int(coordinate)
        return np.asarray(piece[edge] + share * (piece[(edge + 1) % count] - piece[edge]))

    def run(start: float, stop: float) -> Array:
        between = [piece[k % count] for k in range(int(start) + 1, int(np.ceil(stop)))]
        return np.array([point(start), *between, point(stop % count)])

    return run(first, second), run(second, first + count)
