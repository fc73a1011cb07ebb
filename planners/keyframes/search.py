"""The choice of patches: depth-first branch and bound whose node problem is the lift with some slots closed.

At every node the shares are rounded to a choice. The lift on that choice alone is solved first: where it has no point,
no projection can find a plan, and the ray that says so costs one solve. Rays are kept: they close other nodes without
a solve, and tell which placement to branch on, the one whose other candidates weaken the ray most. The choice of the
shares is looked at first all the same: the other order took far longer on hard courses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..conic import ConicModel, ConicSolution, ConicStatus
from ..outcome import Certificate
from .clock import Clock
from .descent import cost
from .layout import Index, Layout
from .lift import LiftedCourse, LiftedPlan
from .project import PlanPoint
from .rays import Rays
from .scaled import ScaledCourse

WHOLE = 1e-4
"""A share this close to 1 is a choice already made."""
LEAST = 3e-6
"""A gap is relative to the objective, or to this where the objective is smaller."""
LEAF = (0, 0, 0, 0, 0)
"""A leaf's row in the tree of a certificate."""
Project = Callable[[ScaledCourse, PlanPoint], PlanPoint]
"""A point of the lift on one choice of patches, on to the bilinear surface."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Where a search stops. gap: relative to the best plan's objective; None stops at the first plan."""

    max_nodes: int
    time_limit_s: float
    gap: float | None = None


class RegionSearch:
    """Depth-first over the choices of one course."""

    def __init__(
        self, lift: LiftedCourse, scaled: ScaledCourse, project: Project, limits: Limits, clock: Clock
    ) -> None:
        self._lift, self._scaled, self._limits, self._clock = lift, scaled, limits, clock
        self._onto_surface = project
        self.found: tuple[Index, PlanPoint] | None = None
        self.upper, self.bound = float("inf"), float("nan")
        self.nodes = self.tried = 0
        self.guessed = False
        self.message = ""
        self._rays = Rays(scaled)
        self._choices: set[tuple[int, ...]] = set()
        self._tree: list[tuple[int, int, int, int, int]] = []
        self._leaves: list[int] = []
        self._open_end = False

    def run(self) -> None:
        """Search until there is a plan as good as asked for, nothing left, or a limit."""
        shape = (self._scaled.layout.placements, self._scaled.layout.regions)
        if shape[1] > 1:
            self._guess()
        stack = [(float("-inf"), self._scaled.opened.reshape(shape))]  # bounds and open slots of what is left
        ended = [float("inf")]  # bounds of parts given up
        while stack and not (self._limits.gap is None and self.found is not None):
            if self.nodes >= self._limits.max_nodes or self._clock.working() > self._limits.time_limit_s:
                limit = f"{self._limits.max_nodes} nodes" if self.nodes >= self._limits.max_nodes else "its time limit"
                self._open_end, self.message = True, f"the search for patches met its limit ({limit})"
                break
            bound, opened = stack.pop()
            if self._beaten(bound):
                ended.append(bound)
            else:
                stack += self._expand(bound, opened, ended)
        if self.found is None and self._open_end and not self.message:
            self.message = "P1 admits the course, but P2 found no plan from its points"
        if self._limits.gap is not None and self.nodes:
            self.bound = min([self.upper, *ended, *(bound for bound, _ in stack)])

    @property
    def closed(self) -> bool:
        """Whether the best plan is proved to be within the gap."""
        return self._beaten(self.bound)

    def certificate(self) -> Certificate | None:
        """The proof that there is no plan, where the tree was searched to its end."""
        if self.found is not None or self._open_end or not self._leaves:
            return None
        return Certificate(
            tree=np.array(self._tree), multipliers=np.array([self._rays.rows[index] for index in self._leaves])
        )

    def _guess(self) -> None:
        """Try the first candidates that have friction, which are the nearest."""
        self._try(nearest(self._scaled).argmax(axis=1))
        self.guessed = self.found is not None

    def _expand(self, bound: float, opened: Array, ended: list[float]) -> list[tuple[float, Array]]:
        """Solve a node; its children, the one to look at first last."""
        self.nodes += 1
        ray = self._rays.refuting(opened)
        lifted = None if ray is not None else self._solve(opened)
        if lifted is not None and lifted.status is ConicStatus.INFEASIBLE:
            ray = self._refuted(lifted)
        if lifted is None or ray is not None:
            assert ray is not None
            self._tree.append(LEAF)
            self._leaves.append(ray)
            return []
        if lifted.status is ConicStatus.FAILED:
            self._open_end, self.message = True, "the conic solver gave up"
            ended.append(bound)
            return []
        bound = max(bound, lifted.objective)
        self.bound = bound if self.nodes == 1 else self.bound
        shares = np.where(opened > 0.0, lifted.shares, -1.0)
        choice = shares.argmax(axis=1)
        blamed = self._try(choice, lifted if shares.max(axis=1).min() > 1.0 - WHOLE else None)
        split = self._split(opened, shares, choice, blamed)
        if split is None or self._beaten(bound):
            ended.append(bound)
            self._open_end = self._open_end or (split is None and self.found is None)
            return []
        p, r = split
        self._tree.append((1, p, r, 0, 0))
        on, off = opened.copy(), opened.copy()
        on[p], off[p, r] = 0.0, 0.0
        on[p, r] = 1.0
        return [(bound, off), (bound, on)]

    def _split(self, opened: Array, shares: Array, choice: Index, blamed: int | None) -> tuple[int, int] | None:
        """Placement and candidate to branch on; None where every choice is made."""
        several = opened.sum(axis=1) > 1.0
        if not several.any():
            return None
        if blamed is not None:
            relief = np.where(several, self._rays.relief(blamed, choice, opened), -1.0)
            p = int(relief.argmax())
            if relief[p] > 0.0:
                return p, int(choice[p])
        p = int(np.where(several, 1.0 - shares.max(axis=1), -1.0).argmax())
        return p, int(choice[p])

    def _try(self, choice: Index, lifted: LiftedPlan | None = None) -> int | None:
        """Look for a plan on one choice, unless it was looked at. Returns the ray that refutes the choice, or None.

        lifted: a point of the lift that makes this choice already.
        """
        key = tuple(int(r) for r in choice)
        only = np.eye(self._scaled.layout.regions)[choice]
        ray = self._rays.refuting(only)
        if ray is not None or key in self._choices:
            return ray
        self._choices.add(key)
        lifted = lifted or self._solve(only)
        if lifted.status is ConicStatus.INFEASIBLE:
            return self._refuted(lifted)
        if lifted.status is ConicStatus.SOLVED:
            self._project(choice, lifted)
        return None

    def _project(self, choice: Index, lifted: LiftedPlan) -> None:
        self.tried += 1
        chosen = self._scaled.chosen(choice)
        frames = chosen.frames[self._scaled.layout.bearing[2]]
        forces = np.matmul(frames.transpose(0, 2, 1), lifted.forces[..., None])[..., 0]
        toes = lifted.toes[np.arange(len(choice)), choice]
        start = PlanPoint(com=lifted.com, rotation=lifted.rotation, toes=toes, forces=forces, residual=float("inf"))
        point = self._onto_surface(chosen, start)
        if point.found and cost(chosen, point) < self.upper:
            self.found, self.upper = (choice, point), cost(chosen, point)

    def _beaten(self, bound: float) -> bool:
        """Whether no plan of this bound is better than the one there is by more than the gap."""
        gap = self._limits.gap
        return gap is not None and self.found is not None and bound >= self.upper - gap * max(self.upper, LEAST)

    def _refuted(self, lifted: LiftedPlan) -> int:
        return self._rays.add(farkas(self._scaled.layout, self._lift.model, lifted.solution))

    def _solve(self, opened: Array) -> LiftedPlan:
        lifted = self._lift.solve(self._scaled.only(opened))
        self._clock.count(1, lifted.solution.seconds)
        return lifted


def nearest(scaled: ScaledCourse) -> Array:
    """Which slots are open where each placement keeps its first candidate that has friction, shape (P, R)."""
    shape = (scaled.layout.placements, scaled.layout.regions)
    friction, opened = scaled.friction.reshape(shape), scaled.opened.reshape(shape)
    return np.asarray(np.eye(shape[1])[np.argmax((friction > 0.0) & (opened > 0.0), axis=1)])


def farkas(layout: Layout, model: ConicModel, solution: ConicSolution, *, balanced: bool = True) -> Array:
    """A leaf's multipliers (``outcome.Certificate``): the ray that refutes a relaxation, in single precision.

    balanced: whether the model has the balances of forces and moments; without them their multipliers are zero.
    """
    steps, moves, nothing = layout.frames - 1, len(layout.moves), np.zeros((len(layout.stances), 3))

    def cone(name: str, count: int) -> Array:
        return -model.dual(name, solution)[count:].reshape(3, count).T

    parts = [model.dual(name, solution).T if balanced else nothing for name in ("balance", "moment")]
    parts.append(cone("reach", layout.frames * layout.limbs))
    if steps:
        parts += [cone("com_step", steps), cone("rotation_step", steps), model.dual("progress", solution)]
        parts += [cone("toe_step", moves)] if moves else []
    flat = np.concatenate([np.ravel(part) for part in parts])
    return np.asarray((flat / max(float(np.abs(flat).max()), 1e-300)).astype(np.float32).astype(np.float64))
