"""A proof that no leap exists: a tree over the toes' candidates with one cut per leaf
(``verify.leap_proof``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..answer.certificate import Certificate
from ..equilibrium.layout import Index, Layout
from ..equilibrium.programs import ConicSolution, ConicStatus, Programs
from ..equilibrium.scaled import Scaled
from ..files.arrays import Array, cross
from ..physics import GRAVITY_M_S2
from ..robot.model import turned_most
from .numbers import LeapGiven, LeapNumbers
from .scp import (
    HEIGHT_RESERVE_M,
    LEAST_FRICTION,
    REACH_RESERVE_M,
    TILT_RESERVE_RAD,
    LeapAttempt,
    LeapLift,
)

MARGIN = 1e-6
"""A sum above this, for multipliers of at most 1, is refused by no rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """C + Σ_j a_j(r_j).

    Arguments:
        constant: C.
        table: a, shape (P, options), inf where there is no candidate.
    """

    constant: float
    table: Array

    def value(self, choice: Index) -> float:
        """The sum for one choice, shape (P,)."""
        return self.constant + float(self.table[np.arange(len(choice)), choice].sum())

    def least(self, opened: Array) -> float:
        """The least sum of all choices of open candidates, shape (P, options)."""
        return self.constant + float(np.where(opened > 0.0, self.table, np.inf).min(axis=1).sum())


def shapes(numbers: LeapNumbers) -> dict[str, tuple[int, ...]]:
    """The groups of a leaf's multipliers, in their order (``verify.leap_proof``)."""
    layout, still = numbers.layout, sum(numbers.leap.still)
    standing = len(layout.standing[0])
    return {
        "reach": (standing, 3),
        "reach_rows": (len(layout.standing_rows[0]),),
        "height": (standing,),
        "goal": (3,),
        "end": (3,),
        "rest": (still, 3),
        "moment": (still, 3),
    }


def split(numbers: LeapNumbers, row: Array) -> dict[str, Array]:
    """The groups of a row of multipliers by name."""
    parts, at = {}, 0
    for name, shape in shapes(numbers).items():
        size = int(np.prod(shape, dtype=int))
        parts[name] = row[at : at + size].reshape(shape)
        at += size
    return parts


def ray(numbers: LeapNumbers, solution: ConicSolution) -> Array:
    """The multipliers of a solve's hard rows, the largest ±1, in single precision."""
    flat = np.concatenate([np.ravel(part) for part in _multipliers(numbers, solution).values()])
    return np.asarray(
        (flat / max(float(np.abs(flat).max()), 1e-300)).astype(np.float32).astype(np.float64)
    )


def _multipliers(numbers: LeapNumbers, solution: ConicSolution) -> dict[str, Array]:
    """The multipliers of a solve's hard rows by the groups of ``shapes``."""
    groups, still = solution.groups, sum(numbers.leap.still)
    lasts = numbers.lasts[
        [k for k, rests in zip((0, -1), numbers.leap.still, strict=True) if rests]
    ]
    return {
        "reach": -solution.dual("reach")[:, 1:],
        "reach_rows": np.maximum(solution.dual("reach_rows"), 0.0)
        if "reach_rows" in groups
        else np.zeros(0),
        "height": np.maximum(solution.dual("height"), 0.0),
        "goal": -solution.dual("ball")[-1, 1:],
        "end": solution.dual("end"),
        "rest": GRAVITY_M_S2 * lasts[:, None] * solution.dual("rest"),
        "moment": solution.dual("moment_still")
        if "moment_still" in groups
        else np.zeros((still, 3)),
    }


def widened(numbers: LeapNumbers) -> tuple[Array, Array]:
    """Radii of the limbs with room for exact rotations, by ½ |Θ|² of where the shoulders are, and
    bounds of the half-spaces with such radii (``robot.model``).
    """
    scaled, spaces = numbers.scaled, numbers.scaled.half_spaces
    bend = 1.5 * scaled.tilt**2  # ½ |Θ|² where every component is at the limit
    out = bend * np.linalg.norm(scaled.shoulders, axis=1)
    turned = turned_most(spaces.normals, scaled.tilt)
    return scaled.reach + out, spaces.outer_bounds + turned * out[numbers.layout.row_limbs]


def proof_cut(numbers: LeapNumbers, row: Array) -> Cut:
    """Cut that multipliers prove of any leap, with all of the friction and reach with room for
    exact rotations.
    """
    reach, rows = widened(numbers)
    scaled = numbers.scaled
    return _cut(
        numbers, row, scaled.friction, reach, rows, numbers.leap.limits.height_m, scaled.tilt
    )


def plan_cut(numbers: LeapNumbers, row: Array, share: float) -> Cut:
    """Cut that multipliers prove of the steps of SCP, which have a share of the friction and keep
    some of the reach.
    """
    scaled = numbers.scaled
    friction, bounds = (
        np.maximum(share * scaled.friction, LEAST_FRICTION),
        scaled.half_spaces.outer_bounds,
    )
    height, tilt = numbers.leap.limits.height_m + HEIGHT_RESERVE_M, scaled.tilt - TILT_RESERVE_RAD
    return _cut(numbers, row, friction, scaled.reach - REACH_RESERVE_M, bounds, height, tilt)


def guide(numbers: LeapNumbers, found: LeapAttempt) -> Cut:
    """The cost of the first step's slack as a sum over toes, by its multipliers: c × F linearised,
    p × f as it is.
    """
    solution, layout, problem, lasts = (
        found.solution,
        numbers.layout,
        found.data,
        numbers.lasts[:, None],
    )
    pulls = _toe_pulls(numbers, _multipliers(numbers, solution))
    foothold = layout.standing[2]
    np.add.at(pulls, foothold, solution.dual("short")[:, None] * problem.legs[0])
    if "within" in solution.groups:
        which, half = layout.standing_rows
        normals = numbers.scaled.half_spaces.normals[half]
        np.add.at(pulls, foothold[which], solution.dual("within")[:, None] * normals)
    sums = problem.point.velocity[1:] + problem.point.velocity[:-1]
    turns = np.cross(solution.dual("turn") @ numbers.spin, sums)
    slopes = -GRAVITY_M_S2 * (lasts * solution.dual("faster") + lasts**3 / 24.0 * turns)
    twists = -GRAVITY_M_S2 * lasts * solution.dual("moment")
    means = numbers.means(problem.point.com, problem.point.velocity)
    friction = np.maximum(found.share * numbers.scaled.friction, LEAST_FRICTION)
    table = _table(numbers, friction, pulls, slopes, twists, means)
    value = float(table[np.arange(len(found.choice)), found.choice].sum())
    return Cut(constant=found.first - value, table=table)


def _toe_pulls(numbers: LeapNumbers, parts: dict[str, Array]) -> Array:
    """Gradient of the reach and height terms with respect to every toe, shape (P, 3)."""
    layout = numbers.layout
    foothold, (which, half) = layout.standing[2], layout.standing_rows
    pulls = np.zeros((layout.footholds, 3))
    np.add.at(pulls, foothold, parts["reach"])
    np.add.at(
        pulls,
        foothold[which],
        parts["reach_rows"][:, None] * numbers.scaled.half_spaces.normals[half],
    )
    np.add.at(pulls[:, 2], foothold, parts["height"])
    return pulls


def _cut(
    numbers: LeapNumbers,
    row: Array,
    friction: Array,
    reach: Array,
    bounds: Array,
    height: float,
    tilt: float,
) -> Cut:
    """C and a of multipliers, for these cones, radii, bounds of half-spaces, heights and
    rotations.
    """
    parts, layout, scaled, leap = split(numbers, row), numbers.layout, numbers.scaled, numbers.leap
    (frame, limb, _), (which, half) = layout.standing, layout.standing_rows
    rows, normals = parts["reach_rows"], scaled.half_spaces.normals[half]
    along, twist = np.zeros((layout.frames, 3)), np.zeros((layout.frames, 3))  # slopes on c and Θ
    np.add.at(along, frame, -parts["reach"])
    np.add.at(along, frame[which], -rows[:, None] * normals)
    np.add.at(along[:, 2], frame, -parts["height"])
    np.add.at(twist, frame, -np.cross(scaled.shoulders[limb], parts["reach"]))
    np.add.at(twist, frame[which], rows[:, None] * scaled.half_spaces.outer_levers[half])
    along[-1] += parts["goal"]
    still = [k for k, rests in zip((0, numbers.intervals - 1), leap.still, strict=True) if rests]
    for k, moment in zip(still, parts["moment"], strict=True):
        along[0 if k == 0 else -1] -= np.array(
            [-moment[1], moment[0], 0.0]
        )  # m·(c × e_z) = (e_z × m)·c
    weights = GRAVITY_M_S2 * numbers.fallen
    slopes = weights.T @ along + GRAVITY_M_S2 * numbers.lasts[:, None] * parts["end"]
    twists = np.zeros_like(slopes)
    for k, rest, moment in zip(still, parts["rest"], parts["moment"], strict=True):
        slopes[k] += rest
        twists[k] += moment
    fall = np.array([0.0, 0.0, -GRAVITY_M_S2])
    drift = (
        numbers.start[0]
        + numbers.times[:, None] * numbers.velocity[0]
        + 0.5 * numbers.times[:, None] ** 2 * fall
    )
    gained = numbers.velocity[0] + numbers.times[-1] * fall - numbers.velocity[1]
    constant = float(
        np.sum(along * drift)
        + parts["end"] @ gained
        - parts["goal"] @ leap.goal.com_m
        - np.linalg.norm(parts["goal"]) * leap.goal_radius_m
        - parts["rest"][:, 2].sum()
        - np.sum(parts["reach"] * scaled.shoulders[limb])
        - np.linalg.norm(parts["reach"], axis=1) @ reach[limb]
        - rows @ bounds[half]
        + parts["height"].sum() * height
        - tilt * np.abs(twist).sum()
    )
    pulls = _toe_pulls(numbers, parts)
    table = _table(numbers, friction, pulls, slopes, twists, np.zeros_like(slopes))
    return Cut(constant=constant, table=table)


def _table(
    numbers: LeapNumbers,
    friction: Array,
    pulls: Array,
    slopes: Array,
    twists: Array,
    centres: Array,
) -> Array:
    """The least of P·p + Σ (y + w × (p − ĉ))·f over a candidate's toes and the forces in its cone,
    (P, options).

    The toe's least is at a vertex, since the forces' least is concave in it.

    Arguments:
        pulls: P of every foothold.
        slopes, twists, centres: y, w and ĉ of every interval, shape (M, 3).
    """
    scaled: Scaled = numbers.scaled
    layout = scaled.layout
    value = np.sum(scaled.vertices * pulls[layout.vertex_footholds], axis=1)
    contact, vertex = layout.contact_vertices
    candidate = layout.vertex_candidates[vertex]
    k = numbers.contact_intervals[contact]
    slope = slopes[k] + cross(twists[k], scaled.vertices[vertex] - centres[k])
    along = np.matmul(slope[:, None], scaled.frames[candidate])[:, 0]
    least = along[:, 0] - friction[candidate] * np.hypot(along[:, 1], along[:, 2])
    np.add.at(value, vertex, np.minimum(least, 0.0) * scaled.force_max[contact, 0])
    return scaled.by_candidate(np.minimum.reduceat(value, layout.candidate_starts), np.inf)


_LEAF, _CHOICE, _TIMING = 0.0, 1.0, 4.0
"""Kinds of a certificate's nodes that a leap's has."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ProofSearch:
    """Result of a search for a proof: rows of the tree and of multipliers, None without a proof;
    solves.
    """

    tree: list[tuple[float, ...]] | None
    rows: list[Array]
    solves: int


class Prover:
    """Branch and bound over the candidates of one timing.

    Arguments:
        rows: multipliers from earlier solves, which may refute something.
        solves: convex problems at most.
    """

    def __init__(
        self, programs: Programs, numbers: LeapNumbers, rows: list[Array], solves: int
    ) -> None:
        self._programs, self._numbers, self._left = programs, numbers, solves
        self._most = solves
        self._cuts: list[Cut] = [proof_cut(numbers, row) for row in rows]
        self._rows = list(rows)
        self._leaves: list[Array] = []
        self._shares = numbers.scaled.opened()

    def prove(self) -> ProofSearch:
        """Search until all choices are refuted, one is not, or the solves are spent."""
        tree = self._node(self._numbers.scaled.opened())
        return ProofSearch(tree=tree, rows=self._leaves, solves=self._most - self._left)

    def _node(self, opened: Array) -> list[tuple[float, ...]] | None:
        """The rows of a subtree, None where its choices are not refuted."""
        refutation = self._refuting(opened)
        if refutation is None and self._left > 0:
            whole = self._solve(opened)
            refutation = self._refuting(opened)
            if refutation is None and whole.status is not ConicStatus.SOLVED:
                return None
            if refutation is None:
                single = self._favourite(opened)
                if (opened.sum(axis=1) == 1.0).all() or self._left <= 0:
                    return None
                if self._solve(single).status is not ConicStatus.INFEASIBLE:
                    return None
                refutation = self._refuting(opened)
        if refutation is not None:
            self._leaves.append(self._rows[refutation])
            return [(_LEAF, 0.0, 0.0, 0.0, 0.0)]
        if self._left <= 0:
            return None
        p, r = self._torn(opened)
        on, off = opened.copy(), opened.copy()
        on[p], off[p, r] = 0.0, 0.0
        on[p, r] = 1.0
        first = self._node(on)
        second = self._node(off) if first is not None else None
        if first is None or second is None:
            return None
        return [(_CHOICE, float(p), float(r), 0.0, 0.0), *first, *second]

    def _refuting(self, opened: Array) -> int | None:
        """The number of a cut that refutes all choices of open candidates."""
        for k, cut in enumerate(self._cuts):
            if cut.least(opened) > MARGIN:
                return k
        return None

    def _solve(self, opened: Array) -> ConicSolution:
        """Solve the relaxation over open candidates, and keep the cut of one that has no answer."""
        self._left -= 1
        numbers = self._numbers
        solution, scaled = _relaxed(self._programs, numbers, opened)
        if solution.status is ConicStatus.INFEASIBLE:
            row = ray(numbers, solution)
            self._rows.append(row)
            self._cuts.append(proof_cut(numbers, row))
        elif solution.solved:
            self._shares = scaled.by_candidate(
                _shares(scaled.layout, solution.value("weights")), 0.0
            )
        return solution

    def _favourite(self, opened: Array) -> Array:
        """One open candidate per foothold, that of the largest share."""
        single = np.zeros_like(opened)
        single[
            np.arange(len(opened)), np.where(opened > 0.0, self._shares, -1.0).argmax(axis=1)
        ] = 1.0
        return single

    def _torn(self, opened: Array) -> tuple[int, int]:
        """The foothold with several open candidates that is least decided, and its best one."""
        shares = np.where(opened > 0.0, self._shares, -1.0)
        p = int(np.where(opened.sum(axis=1) > 1.0, 1.0 - shares.max(axis=1), -1.0).argmax())
        return p, int(shares[p].argmax())


def refuting_ray(programs: Programs, numbers: LeapNumbers, choice: Index) -> Array | None:
    """Multipliers that refute one choice of contacts, by one convex problem; None where it has an
    answer.
    """
    single = np.zeros_like(numbers.scaled.opened())
    single[np.arange(len(choice)), choice] = 1.0
    solution, _ = _relaxed(programs, numbers, single)
    if solution.status is not ConicStatus.INFEASIBLE:
        return None
    row = ray(numbers, solution)
    return row if proof_cut(numbers, row).value(choice) > MARGIN else None


def _relaxed(
    programs: Programs, numbers: LeapNumbers, opened: Array
) -> tuple[ConicSolution, Scaled]:
    """The relaxation over open candidates, solved, and what its program was loaded with."""
    reach, rows = widened(numbers)
    spaces = replace(numbers.scaled.half_spaces, outer_bounds=rows)
    scaled = replace(
        numbers.scaled,
        reach=reach,
        half_spaces=spaces,
        friction=np.maximum(numbers.scaled.friction, LEAST_FRICTION),
    ).only(opened)
    program = programs.get(LeapLift, scaled.layout, numbers.leap.still)
    return program.solve(LeapGiven(scaled, loaded_numbers=numbers)), scaled


def _shares(layout: Layout, weights: Array) -> Array:
    """Σ_u λ_u of every candidate."""
    return np.asarray(np.bincount(layout.vertex_candidates, weights))


def certificate_of(searches: list[ProofSearch]) -> Certificate | None:
    """The certificate of the proofs of every timing, None unless each has one."""
    tree: list[tuple[float, ...]] = []
    rows: list[Array] = []
    for k, search in enumerate(searches):
        if search.tree is None:
            return None
        if k + 1 < len(searches):
            tree.append((_TIMING, float(k), 0.0, 0.0, 0.0))
        tree += search.tree
        rows += search.rows
    return Certificate(tree=np.array(tree), multipliers=np.array(rows))
