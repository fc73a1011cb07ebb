"""The choice of patches: depth-first branch and bound whose node problem is the lift on the
candidates still open.

At every node the shares are rounded to a choice, and the lift on that choice alone, in its own
one-candidate program, is solved first: where it has no point, no projection can find a plan, and
the multipliers that say so cost one small solve. These Farkas cuts are kept: they close other nodes
without a solve, tell which foothold to branch on, the one whose other candidates weaken the cut
most, and guide a dive before the first branching; a rounding that they refute is mended by the same
dive. Where the lift has a point and P2 finds no plan,
stances that cannot be held alone leave nogoods, which do the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..answer.certificate import Certificate
from ..equilibrium.layout import Index
from ..equilibrium.programs import ConicStatus, Programs
from ..equilibrium.scaled import Point, Scaled
from ..errors import InvalidInput
from ..files.arrays import Array
from ..problem import Problem
from ..projection.project import SURFACE, cost
from ..relaxation.lift import LiftAnswer, solve_lift
from ..terrain import Patch
from .answer import Clock
from .cuts import LEAF, MARGIN, FarkasCuts, Nogoods, alone, of_stance
from .pieces import Standing

Features = dict[str, NDArray[np.float32]]
_BOUND = 8.0
"""Bound on what is seen, in length scales: farther things are seen at the bound."""
_BOUNDS = {
    "offered": (0.0, 1.0),
    "left": (0.0, 1.0),
    "normals": (-1.0, 1.0),
    "footing": (-1.0, 1.0),
    "friction": (0.0, _BOUND),
    "grip": (0.0, _BOUND),
    "reach": (0.0, _BOUND),
}


@dataclass(frozen=True, kw_only=True)
class CourseFeatures:
    """Features of one size for a policy: N limbs, H coming key frames, R candidates a toe, patches
    of up to U corners.

    They are a dict of flat float32 arrays. Lengths are in the course's length scale, places as seen
    from the COM: ``corners`` (H·N·R·U·3), ``normals`` (H·N·R·3), ``friction`` (H·N·R) of the
    candidate patches of the limb's next toe, by coming frame, limb and candidate; ``offered``
    (H·N·R) is 1 where there is one and 0 where the rest is zero. ``toes`` (N·3), ``footing`` (N·3)
    and ``grip`` (N): where the toes stand, the normal and the friction there. ``shoulders`` (N·3),
    ``reach`` (N). ``path`` (H·3): the nominal COM at the coming frames, the last one repeated.
    ``goal`` (3); ``left`` (1): share of the frames that are left.
    """

    limbs: int
    horizon: int
    regions: int
    corners: int

    def bounds(self) -> dict[str, tuple[float, float, int]]:
        """The least and the greatest value of every feature, and how many values it has."""
        return {
            name: (*_BOUNDS.get(name, (-_BOUND, _BOUND)), values.size)
            for name, values in self._blank().items()
        }

    def observe(self, course: Problem, frame: int, standing: Standing) -> Features:
        """The features at a key frame.

        Raises InvalidInput where the course does not fit the size.
        """
        if len(course.robot.limbs) != self.limbs:
            raise InvalidInput(
                f"course: expected {self.limbs} limbs, got {len(course.robot.limbs)}"
            )
        seen, scale, com_m = self._blank(), course.length_scale_m, standing.com_m
        for foothold in course.footholds:
            ahead = foothold.frame - frame - 1
            if 0 <= ahead < self.horizon:
                limb = course.robot.limb_names.index(foothold.limb)
                where = f"frame {foothold.frame}, limb {foothold.limb}"
                if len(foothold.candidates) > self.regions:
                    raise InvalidInput(
                        f"{where}: expected at most {self.regions} candidates, got "
                        f"{len(foothold.candidates)}"
                    )
                for region, patch in enumerate(foothold.candidates):
                    at = ahead, limb, region
                    seen["corners"][at] = (self._cornered(patch, where) - com_m) / scale
                    seen["normals"][at], seen["friction"][at] = patch.normal, patch.friction
                    seen["offered"][at] = 1.0
        coming = np.minimum(frame + 1 + np.arange(self.horizon), course.frames - 1)
        seen["path"][:] = (course.com_nominal_m[coming] - com_m) / scale
        seen["toes"][:] = (standing.toes_m - com_m) / scale
        seen["footing"][:] = [patch.normal for patch in standing.patches]
        seen["grip"][:] = [patch.friction for patch in standing.patches]
        seen["shoulders"][:] = np.array([limb.shoulder_m for limb in course.robot.limbs]) / scale
        seen["reach"][:] = np.array([limb.reach_m for limb in course.robot.limbs]) / scale
        seen["goal"][:] = (course.goal_m - com_m) / scale
        seen["left"][:] = (course.frames - 1 - frame) / max(course.frames - 1, 1)
        return {
            name: np.clip(values, -_BOUND, _BOUND).astype(np.float32).ravel()
            for name, values in seen.items()
        }

    def _blank(self) -> dict[str, Array]:
        shape = self.horizon, self.limbs, self.regions
        shapes: dict[str, tuple[int, ...]] = {
            "corners": (*shape, self.corners, 3),
            "normals": (*shape, 3),
            "friction": shape,
            "offered": shape,
            "toes": (self.limbs, 3),
            "footing": (self.limbs, 3),
            "grip": (self.limbs,),
            "shoulders": (self.limbs, 3),
            "reach": (self.limbs,),
            "path": (self.horizon, 3),
            "goal": (3,),
            "left": (1,),
        }
        return {name: np.zeros(shape) for name, shape in shapes.items()}

    def _cornered(self, patch: Patch, where: str) -> Array:
        """The corners of a patch, the last one repeated, shape (U, 3)."""
        count = len(patch.vertices_m)
        if count > self.corners:
            raise InvalidInput(
                f"{where}: expected patches of at most {self.corners} corners, got {count}"
            )
        return np.asarray(patch.vertices_m[np.minimum(np.arange(self.corners), count - 1)])


_WHOLE = 1e-4
"""A share this close to 1 is a choice already made."""
LEAST = 3e-6
"""A gap is relative to the objective, or to this where the objective is smaller."""
_DIVES, _SWEEPS, _CUT_PRICE, _GUMBEL = 12, 4, 200.0, 0.3
"""Numbers of the dive: tries, sweeps of a descent over the choices, price of a violated cut, noise
on the preference."""
_MENDS, _SCARCE = 4, 0.02
"""Mended roundings of a node that are tried; what is added to a share before its logarithm."""
_Project = Callable[[Scaled, Point, bool], Point]
"""A point of the lift on one choice of patches, on to the bilinear surface; in one try, or else
patiently."""


class ChoiceSearch:
    """Depth-first over the choices of one course.

    found: the best choice, (P,), and its point. bound: on the objective, of what was searched.
    complete: whether the tree was searched to its end, every leaf refuted; else message says why
    not.

    Arguments:
        gap: relative to the best plan's objective; None stops at the first plan.
        share: of the clock's limits, for a search that has met a choice that P1 admits and P2 finds
            no plan for.
        learns: whether a stance that cannot be held says anything: which patches are not to be
            chosen, or that there is no plan.
    """

    def __init__(
        self,
        programs: Programs,
        scaled: Scaled,
        project: _Project,
        clock: Clock,
        *,
        max_nodes: int,
        gap: float | None = None,
        share: float = 1.0,
        learns: bool = True,
    ) -> None:
        self._programs, self._scaled, self._clock = programs, scaled, clock
        self._max_nodes, self._gap, self._share, self._learns = max_nodes, gap, share, learns
        self._onto_surface = project
        self.found: tuple[Index, Point] | None = None
        self.upper, self.bound = float("inf"), float("nan")
        self.nodes = self.tried = self.dived = 0
        self.guessed = self.limited = False
        self.message = ""
        self._cuts, self._nogoods = FarkasCuts(scaled), Nogoods(programs, scaled, clock)
        self._tried: set[tuple[int, ...]] = set()
        self._alone: set[tuple[int, ...]] = set()
        self._tree: list[tuple[float, ...]] = []
        self._leaves: list[Array] = []
        self._open_end = False
        self._root: LiftAnswer | None = None

    def run(self) -> None:
        """Search until there is a plan as good as asked for, nothing left, or a limit."""
        if self._scaled.options > 1 or not self._max_nodes:
            self._guess()
        stack = [
            (float("-inf"), self._scaled.opened())
        ]  # bounds and open candidates of what is left
        ended = [float("inf")]  # bounds of parts given up
        while stack and not (self._gap is None and self.found is not None):
            if self.nodes >= self._max_nodes or self._late():
                at_nodes = self.nodes >= self._max_nodes
                limit = f"{self._max_nodes} nodes" if at_nodes else self._clock.limit
                self._open_end = self.limited = True
                self.message = f"the search for patches met its limit ({limit})"
                break
            bound, opened = stack.pop()
            if self._beaten(bound):
                ended.append(bound)
            else:
                stack += self._expand(bound, opened, ended)
        if self.found is None and self._open_end and not self.message:
            self.message = "P1 admits the course, but P2 found no plan from its points"
        if self._gap is not None and self.nodes:
            self.bound = min([self.upper, *ended, *(bound for bound, _ in stack)])

    @property
    def closed(self) -> bool:
        """Tell whether the best plan is proved to be within the gap."""
        return self._beaten(self.bound)

    def certificate(self) -> Certificate | None:
        """The proof that there is no plan, where the tree was searched to its end."""
        if self.found is not None or self._open_end or not self._leaves:
            return None
        return Certificate(
            tree=np.array(self._tree, dtype=np.float64), multipliers=np.array(self._leaves)
        )

    def _guess(self) -> None:
        """Try the first candidates that have friction, which are the nearest, and where P1 alone
        has a point on them those that the root likes best; then dive, unless the root is refuted,
        or the limit is met.
        """
        guess = nearest(self._scaled)
        self._try(guess, hasty=True)
        self.guessed = self.found is not None
        if (
            self.found is not None
            or not self._max_nodes
            or self._cuts.refuting(self._scaled.opened()) is not None
            or self._late()
        ):
            return
        self._root = root = self._solve(self._scaled)
        if root.status is ConicStatus.INFEASIBLE:
            self._cuts.add(root.multipliers)
        if root.status is not ConicStatus.SOLVED:
            return
        if self.tried:
            for choice in (root.rounded()[0], guess):
                if self.found is None and not self._late():
                    self._try(choice)
        if self._cuts.rows:
            self._blame_stances(guess)
        rng = np.random.default_rng(0)
        preference = _preference(self._scaled)
        for k in range(_DIVES):
            if self.found is not None or self._late():
                break
            self.dived = k + 1
            noise = _GUMBEL * rng.gumbel(size=preference.shape) if k else 0.0
            self._try(self._dive(preference, np.argmax(preference + noise, axis=1), rng))

    def _dive(self, preference: Array, choice: Index, rng: np.random.Generator) -> Index:
        """Coordinate descent over choices on the violation of all cuts and the preference."""
        tables, rows = self._cuts.tables, np.arange(len(choice))
        finite = np.where(np.isfinite(tables), tables, 0.0)
        for _ in range(_SWEEPS if len(tables) or self._nogoods.entries else 0):
            before = choice.copy()
            value = finite[:, rows, choice].sum(axis=1) + self._cuts.constants
            for p in rng.permutation(len(choice)):
                rest = value - finite[:, p, choice[p]]
                violation = np.maximum(rest[:, None] + finite[:, p], 0.0).sum(axis=0)
                violation = violation + self._nogoods.covering(choice, int(p))
                choice[p] = int(np.argmin(_CUT_PRICE * violation - preference[p]))
                value = rest + finite[:, p, choice[p]]
            if (before == choice).all():
                break
        return choice

    def _expand(self, bound: float, opened: Array, ended: list[float]) -> list[tuple[float, Array]]:
        """Solve a node; its children, the one to look at first last."""
        self.nodes += 1
        nogood = self._nogoods.refuting(opened)
        if nogood is not None:
            self._prove(nogood, opened)
            return []
        cut = self._cuts.refuting(opened)
        lifted, self._root = (
            None if cut is not None else self._root or self._solve(self._scaled.only(opened)),
            None,
        )
        if lifted is not None and lifted.status is ConicStatus.INFEASIBLE:
            cut = self._cuts.add(lifted.multipliers)
        if cut is not None or lifted is None:
            assert cut is not None
            self._tree.append(LEAF)
            self._leaves.append(self._cuts.rows[cut])
            return []
        if not lifted.solved:
            self._open_end, self.message = True, "the conic solver gave up"
            ended.append(bound)
            return []
        bound = max(bound, lifted.bound)
        self.bound = bound if self.nodes == 1 else self.bound
        shares = lifted.scaled.by_candidate(lifted.shares, -1.0)
        choice = np.asarray(shares.argmax(axis=1), dtype=np.int_)
        if self._cuts.refuting(np.eye(self._scaled.options)[choice]) is None:
            self._try(choice, lifted if shares.max(axis=1).min() > 1.0 - _WHOLE else None)
        else:
            self._mend(
                choice, np.where(opened > 0.0, np.log(np.maximum(shares, 0.0) + _SCARCE), -np.inf)
            )
        nogood = self._nogoods.refuting(opened)
        if nogood is not None:
            self._prove(nogood, opened)
            return []
        split = self._split(opened, shares, choice)
        if split is None or self._beaten(bound):
            ended.append(bound)
            self._open_end = self._open_end or (split is None and self.found is None)
            return []
        p, r = split
        self._tree.append((1.0, float(p), float(r), 0.0, 0.0))
        on, off = opened.copy(), opened.copy()
        on[p], off[p, r] = 0.0, 0.0
        on[p, r] = 1.0
        return [(bound, off), (bound, on)]

    def _mend(self, choice: Index, preference: Array) -> None:
        """Try what cuts leave of a rounding that they refute, as long as that teaches another cut.

        Arguments:
            preference: log of the shares, −inf where nothing is open, shape (P, options).
        """
        known, tries = -1, 0
        while not (self.found or self._late()) and known < len(self._cuts.rows) and tries < _MENDS:
            known, tries = len(self._cuts.rows), tries + 1
            self._try(self._dive(preference, choice.copy(), np.random.default_rng(0)), hasty=True)

    def _split(self, opened: Array, shares: Array, choice: Index) -> tuple[int, int] | None:
        """Foothold and candidate to branch on; None where every choice is made."""
        several = opened.sum(axis=1) > 1.0
        if not several.any():
            return None
        relief = np.where(several, self._cuts.relief(choice, opened), 0.0)
        p = int(relief.argmax())
        if relief[p] > 0.0:
            return p, int(choice[p])
        nogood = self._nogoods.refuting(np.eye(self._scaled.options)[choice])
        loose = None if nogood is None else self._nogoods.blame(nogood, opened)
        p = (
            loose
            if loose is not None
            else int(np.where(several, 1.0 - shares.max(axis=1), -1.0).argmax())
        )
        return p, int(choice[p])

    def _prove(self, nogood: int, opened: Array) -> None:
        """End a part of the tree with the subtree of a nogood."""
        tree, multipliers = self._nogoods.rows(nogood, opened)
        self._tree += tree
        self._leaves += multipliers

    def _try(self, choice: Index, lifted: LiftAnswer | None = None, *, hasty: bool = False) -> None:
        """Look for a plan on one choice, unless it was looked at.

        Arguments:
            lifted: a point of the lift that makes this choice already.
            hasty: where the first steps of P2 do not reach one, nothing is learned, and the choice
                may be looked at again.
        """
        key = tuple(int(r) for r in choice)
        only = np.eye(self._scaled.options)[choice]
        if (
            key in self._tried
            or self._cuts.refuting(only) is not None
            or self._nogoods.refuting(only) is not None
        ):
            return
        self._tried.add(key)
        lifted = lifted or self._solve(self._scaled.chosen(choice))
        if lifted.status is ConicStatus.INFEASIBLE:
            self._cuts.add(lifted.multipliers)
            if self._root is not None or self.nodes:
                self._blame_stances(choice)
        if lifted.status is ConicStatus.SOLVED:
            self._project(lifted, hasty=hasty)
            if hasty and self.found is None:
                self._tried.remove(key)

    def _blame_stances(self, choice: Index) -> None:
        """Learn cuts of single stances that the lift refutes on a choice: they say more than one
        over all frames.
        """
        layout, chosen = self._scaled.layout, self._scaled.chosen(choice)
        for stance, (frame, _) in enumerate(layout.stances):
            key = (stance, *choice[list(layout.holds[frame])].tolist())
            if key not in self._alone and not self._late():
                self._alone.add(key)
                lifted = solve_lift(self._programs, alone(chosen, stance)[0], least_moment=True)
                self._clock.count(1, lifted.seconds)
                if lifted.bound > MARGIN:
                    self._cuts.add(of_stance(self._scaled, stance, lifted))

    def _project(self, lifted: LiftAnswer, *, hasty: bool = False) -> None:
        self.tried += 1
        choice, start = lifted.rounded()
        chosen = self._scaled.chosen(choice)
        point = self._onto_surface(chosen, start, False)
        if not point.residual <= SURFACE and not hasty:
            if self._learns and self._nogoods.learn(choice, self._share):
                return
            point = self._onto_surface(chosen, start, True)
        if point.residual <= SURFACE and cost(chosen, point) < self.upper:
            self.found, self.upper = (choice, point), cost(chosen, point)

    def _beaten(self, bound: float) -> bool:
        """Tell whether no plan of this bound is better than the one there is by more than the
        gap.
        """
        gap = self._gap
        return (
            gap is not None
            and self.found is not None
            and bound >= self.upper - gap * max(self.upper, LEAST)
        )

    def _late(self) -> bool:
        return self._clock.ended(self._share if self.tried and self.found is None else 1.0)

    def _solve(self, scaled: Scaled) -> LiftAnswer:
        lifted = solve_lift(self._programs, scaled, least_moment=False)
        self._clock.count(1, lifted.seconds)
        return lifted


def nearest(scaled: Scaled) -> Index:
    """The first open candidate of every foothold that has friction, or its first, by number, shape
    (P,).
    """
    grips = scaled.by_candidate(np.where(scaled.friction > 0.0, 2.0, 1.0), 0.0)
    return np.asarray(np.argmax(grips, axis=1), dtype=np.int_)


def _preference(scaled: Scaled) -> Array:
    """Log of how much a candidate is liked before anything is known: near, and with friction; −inf
    where none is.
    """
    grips = scaled.by_candidate((scaled.friction > 0.0).astype(np.float64), 0.0)
    rank = np.cumsum(grips, axis=1) - 1.0
    liked = np.where(grips > 0.0, 0.7 * 0.35 ** np.maximum(rank, 0.0), 0.01)
    return np.where(scaled.opened() > 0.0, np.log(liked + 0.02), -np.inf)
