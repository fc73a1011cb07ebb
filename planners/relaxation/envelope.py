"""Envelopes: boxes B over [p, f] that a McCormick relaxation is taken over (Lin et al. §III), and
their file. Answers of relaxations: shares of vertices, forces, a point rounded from them; the margin
of P1 and its proofs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..equilibrium.layout import Index, Layout, Of
from ..equilibrium.programs import ConicSolution, Programs
from ..equilibrium.rows import Rows
from ..equilibrium.scaled import Point, Scaled
from ..equilibrium.terms import Given
from ..errors import InvalidInput
from ..files.arrays import LARGEST, Array, checked, read_only
from ..files.codec import LATER, fields_to_json, from_json
from ..physics import GRAVITY_M_S2
from ..plugins import Registry
from ..problem import Problem
from ..problem.posture import MAX_TILT_RAD, THREE_LEGS
from ..robot import Robot, hexapod


class _LearnedFor(Protocol):
    """Class of problems that something was learned for: legs of one robot, in one pair of units."""

    @property
    def robot(self) -> str:
        """Identity of the robot, see ``Robot``; empty for the default hexapod."""

    @property
    def legs(self) -> tuple[str, ...]:
        """Legs of the contacts, in order."""

    @property
    def force_scale_n(self) -> float:
        """Unit of forces [N]."""

    @property
    def length_scale_m(self) -> float:
        """Unit of lengths [m]."""


def check_robot(it: _LearnedFor, robot: str, learned: str) -> None:
    """Raise InvalidInput unless it was learned for the robot of this identity.

    Arguments:
        learned: what it is, in words.
    """
    if robot != it.robot:
        mine, other = (name or "the default hexapod" for name in (it.robot, robot))
        raise InvalidInput(f"robot: expected {mine} for {learned}, got {other}")


def check_learned(it: _LearnedFor, problem: Problem, learned: str) -> None:
    """Raise InvalidInput unless the problem is of the robot, legs and units that it was learned
    for.
    """
    check_robot(it, problem.robot.identity, learned)
    if problem.legs != it.legs:
        raise InvalidInput(
            f"contacts: expected legs {list(it.legs)} for {learned}, got {list(problem.legs)}"
        )
    if problem.push_n:
        raise InvalidInput(f"push_n: expected 0 N for {learned}, got {problem.push_n:g} N")
    for name in ("force_scale_n", "length_scale_m"):
        mine, theirs = getattr(it, name), float(getattr(problem, name))
        if abs(mine - theirs) > 1e-6 * mine:
            raise InvalidInput(f"{name}: expected {mine:g} for {learned}, got {theirs:g}")


TILT_ROOM_RAD = np.deg2rad(10.0)
"""Angle beyond that of training by which a patch may lean before an envelope is refused as learned
for something else."""
LOW_LOW, HIGH_HIGH, LOW_HIGH, HIGH_LOW = range(4)
"""The corners of a box in p_j and f_k, in the order of the four envelope rows of m_jk = p_j f_k."""
_P_ENDS, _F_ENDS = np.array([0, 1, 0, 1]), np.array([0, 1, 1, 0])
"""Bounds, of low and high, that they are at."""
SIGNS = np.array([1.0, 1.0, -1.0, -1.0])[:, None, None, None]
"""Signs of those rows: the first two bound m_jk from below, the others from above."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Envelope:
    """One box: bounds on p (toes relative to the body, world axes) and f (contact frame),
    non-dimensional.

    Arguments:
        low, high: shape (N, 6), the columns p_x p_y p_z f_n f_y f_z.

    Raises:
        InvalidInput: for other shapes, and where low exceeds high.
    Source:
        Lin et al. §III, B_S.

    Example:
        >>> import numpy as np
        >>> from stancekit import Envelope
        >>> box = Envelope.around(np.array([np.zeros((3, 6)), np.ones((3, 6))]))
        >>> box.contacts, box.widened(0.1).contains(np.full((1, 3, 6), 1.05)).tolist()
        (3, [True])
    """

    low: Array
    high: Array

    def __post_init__(self) -> None:
        low = read_only(self.low, (None, 6), "low")
        high = read_only(self.high, (len(low), 6), "high")
        if (low > high).any():
            i, d = np.argwhere(low > high)[0]
            raise InvalidInput(
                f"low[{i}][{d}]: expected at most high, got {low[i, d]:g} > {high[i, d]:g}"
            )
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)

    @classmethod
    def around(cls, points: Array) -> Envelope:
        """The exterior boundary of points [p, f], shape (K, N, 6) with K ≥ 1.

        Raises InvalidInput without any.
        """
        if not len(points):
            raise InvalidInput("points: expected one or more, got none")
        return cls(low=points.min(axis=0), high=points.max(axis=0))

    @classmethod
    def from_vector(cls, bounds: Array) -> Envelope:
        """Read the flat form, all of low and then all of high, shape (12N,); reversed pairs are put
        in order.
        """
        flat = np.asarray(bounds, dtype=np.float64)
        if flat.ndim != 1 or flat.size == 0 or flat.size % 12:
            raise InvalidInput(
                f"bounds: expected 12 numbers a contact, got an array of shape {flat.shape}"
            )
        first, second = flat.reshape(2, -1, 6)
        low, high = np.minimum(first, second), np.maximum(first, second)
        if not float(abs(flat).max()) <= LARGEST:  # also false for NaN
            return cls(low=low, high=high)  # which says what is wrong
        low.setflags(write=False)
        high.setflags(write=False)
        envelope = object.__new__(cls)
        vars(envelope).update(low=low, high=high)
        return envelope

    def to_vector(self) -> Array:
        """All of low and then all of high, shape (12N,)."""
        return np.concatenate([self.low.ravel(), self.high.ravel()])

    @property
    def contacts(self) -> int:
        """N."""
        return len(self.low)

    @property
    def position(self) -> tuple[Array, Array]:
        """Bounds on p, each of shape (N, 3)."""
        return self.low[:, :3], self.high[:, :3]

    @property
    def force(self) -> tuple[Array, Array]:
        """Bounds on f, each of shape (N, 3)."""
        return self.low[:, 3:], self.high[:, 3:]

    @cached_property
    def corners(self) -> Corners:
        """The numbers of the envelope rows."""
        ends = np.array([self.low, self.high])
        p = SIGNS * ends.take(_P_ENDS, axis=0)[:, :, :3, None]
        f = ends.take(_F_ENDS, axis=0)[:, :, None, 3:]
        ends[0] *= -1.0
        return Corners(p=p, f=SIGNS * f, products=p * f, outward=ends)

    def log_volume(self) -> float:
        """Sum of the logarithms of the widths; −inf for a box without volume."""
        widths = self.high - self.low
        return float(np.log(widths).sum()) if widths.all() else -math.inf

    def contains(self, points: Array, *, margin: float = 0.0) -> Array:
        """Tell which points [p, f], shape (K, N, 6), lie in the box widened by ``margin``; shape
        (K,).
        """
        inside = (points >= self.low - margin) & (points <= self.high + margin)
        return np.asarray(inside.all(axis=(-2, -1)))

    def widened(self, margin: float) -> Envelope:
        """The box with every side moved out by ``margin``."""
        return Envelope(low=self.low - margin, high=self.high + margin)


class Corners(NamedTuple):
    """Numbers that the envelope rows sign (p_end f + f_end p − m) ≤ sign p_end f_end and −x ≤ −low,
    x ≤ high need.

    Arguments:
        p, f, products: times the signs, by corner, contact, j of p and k of f, shapes (4, N, 3, 1),
            (4, N, 1, 3) and (4, N, 3, 3).
        outward: (2, N, 6). Of several boxes, these stacked.
    """

    p: Array
    f: Array
    products: Array
    outward: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class EnvelopeSet:
    """Envelopes learned for one class of problems; P1 may choose any one of them a posture (a
    binary each).

    Arguments:
        problem_class: name of the class, e.g. ``wall-3``.
        legs: legs of the boxes' rows, N names.
        force_scale_n, length_scale_m: scales of the problems [N], [m].
        normals: mean normals of the training patches, shape (N, 3).
        tilt_rad: how far the training patches leaned from them, shape (N,) [rad].
        envelopes: one box or more.
        provenance: how the set was learned, for people.
        robot: identity of the model whose legs they are, see ``Robot``; empty for the default
            hexapod.

    Raises:
        InvalidInput: for other shapes, normals that are no unit vectors, no boxes.
    Source:
        Lin et al. §III; the binaries of §IV-A.

    Example:
        >>> import numpy as np, stancekit
        >>> problems = stancekit.sample("wall-3", 5, rng=0)
        >>> box = stancekit.Envelope(low=np.full((3, 6), -1.0), high=np.ones((3, 6)))
        >>> boxes = stancekit.EnvelopeSet.for_problems("wall-3", problems, [box])
        >>> method = stancekit.TwoStage(relaxation="p1", envelopes=boxes, projection=None)
        >>> stancekit.solve(problems[0], method).method
        'p1'
    """

    FORMAT: ClassVar = "stancekit/envelope/1"

    problem_class: str
    legs: tuple[str, ...]
    force_scale_n: float
    length_scale_m: float
    normals: Array
    tilt_rad: Array
    envelopes: tuple[Envelope, ...]
    robot: str = field(default="", metadata=LATER)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.legs)
        if not count or len(set(self.legs)) != count:
            raise InvalidInput(f"legs: expected one or more different ones, got {list(self.legs)}")
        for name in ("force_scale_n", "length_scale_m"):
            object.__setattr__(self, name, checked(getattr(self, name), name, above=0.0))
        object.__setattr__(self, "normals", read_only(self.normals, (count, 3), "normals"))
        object.__setattr__(self, "tilt_rad", read_only(self.tilt_rad, (count,), "tilt_rad"))
        if np.any(np.abs(np.linalg.norm(self.normals, axis=1) - 1.0) > 1e-3):
            raise InvalidInput(f"normals: expected unit vectors, got {self.normals.tolist()}")
        if np.any(self.tilt_rad < 0.0):
            raise InvalidInput(
                f"tilt_rad: expected no negative angle, got {self.tilt_rad.tolist()}"
            )
        if not self.envelopes:
            raise InvalidInput("envelopes: expected one or more, got none")
        for index, envelope in enumerate(self.envelopes):
            if envelope.contacts != count:
                raise InvalidInput(
                    f"envelopes[{index}]: expected {count} contacts, got {envelope.contacts}"
                )

    @classmethod
    def for_problems(
        cls,
        problem_class: str,
        problems: Sequence[Problem],
        envelopes: Sequence[Envelope],
        provenance: Mapping[str, Any] | None = None,
    ) -> EnvelopeSet:
        """Envelopes with the description of the problems that they were learned from."""
        if not problems:
            raise InvalidInput("problems: expected one or more, got none")
        normals = np.array(
            [[contact.patch.normal for contact in problem.contacts] for problem in problems]
        )
        mean = normals.mean(axis=0)
        mean = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
        lean = np.arccos(np.clip(np.einsum("knj,nj->kn", normals, mean), -1.0, 1.0)).max(axis=0)
        first = problems[0]
        return cls(
            problem_class=problem_class,
            legs=first.legs,
            force_scale_n=float(first.force_scale_n or 0.0),
            length_scale_m=first.length_scale_m,
            normals=mean,
            tilt_rad=lean,
            envelopes=tuple(envelopes),
            provenance=dict(provenance or {}),
            robot=first.robot.identity,
        )

    def measured_in(self, length_scale_m: float) -> EnvelopeSet:
        """Convert the boxes to another length scale."""
        unit = np.array([self.length_scale_m / length_scale_m] * 3 + [1.0] * 3)
        boxes = tuple(Envelope(low=unit * box.low, high=unit * box.high) for box in self.envelopes)
        return replace(self, envelopes=boxes, length_scale_m=length_scale_m)

    def check_robot(self, robot: str) -> None:
        """Raise InvalidInput unless the envelopes were learned for the robot of this identity."""
        check_robot(self, robot, f"an envelope learned for {self.problem_class}")

    def check_fits(self, problem: Problem) -> None:
        """Raise InvalidInput unless the problem is of the class that the envelopes were learned
        for.
        """
        learned = f"an envelope learned for {self.problem_class}"
        check_learned(self, problem, learned)
        for index, contact in enumerate(problem.contacts):
            lean = float(np.arccos(np.clip(contact.patch.normal @ self.normals[index], -1.0, 1.0)))
            most = float(self.tilt_rad[index]) + TILT_ROOM_RAD
            if lean > most:
                raise InvalidInput(
                    f"contacts[{index}].normal: expected one within {np.rad2deg(most):.0f}° of "
                    f"{np.round(self.normals[index], 2).tolist()} for {learned}, got one "
                    f"{np.rad2deg(lean):.0f}° off"
                )

    def to_json(self) -> dict[str, Any]:
        """Return the set in its JSON form."""
        return fields_to_json(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> EnvelopeSet:
        """Read the JSON form.

        Raises InvalidInput that lists every key that is wrong.
        """
        return from_json(cls, data)


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxed(Given):
    """Data that P1 is loaded with: boxes over the stance contacts.

    Arguments:
        allowed: which of them a stance may use, (S, E).
    """

    boxes: Sequence[Envelope]
    allowed: Array | None = None

    @cached_property
    def corners(self) -> Corners:
        """Corners of the box, or of all boxes."""
        if len(self.boxes) == 1:
            return self.boxes[0].corners
        parts = zip(*(box.corners for box in self.boxes), strict=True)
        return Corners(*(np.stack(part) for part in parts))


def envelope_rows(
    rows: Rows[Any],
    whole: Index,
    moments: Index,
    *,
    margin: Index | None = None,
    share: Index | None = None,
    e: int | None = None,
) -> None:
    """(p, f, m) ∈ M_c(B): the four envelope rows of every m_jk = p_j f_k, and [p, f] ∈ B, the e-th
    box.

    Arguments:
        whole: [p, f], (B, 6).
        moments: (B, 9).
        margin: relaxes every row.
        share: z of every contact, (B,), in whose measure the rows are: (p, f, m) ∈ z M_c(B).
    """
    count = len(whole)
    envelope, sides = (
        rows.at_most(_of("envelope", e), 4, count, 3, 3),
        rows.at_most(_of("sides", e), 2, count, 6),
    )
    rows.put(envelope[:2], moments.reshape(-1, 3, 3), -1.0)
    rows.put(envelope[2:], moments.reshape(-1, 3, 3), 1.0)
    p_ends, f_ends, products, outward = (Of(f"corners.{name}", e) for name in Corners._fields)
    rows.put(envelope, whole[:, None, 3:], p_ends)
    rows.put(envelope, whole[:, :3, None], f_ends)
    rows.put(sides[0], whole, -1.0)
    rows.put(sides[1], whole, 1.0)
    for group, bounds, at in (
        (envelope, products, (slice(None), None, None)),
        (sides, outward, (slice(None), None)),
    ):
        if share is not None:
            rows.put(group, share[at], -bounds)
            continue
        rows.right(group, bounds)
        if margin is not None:
            rows.put(group, margin, -1.0)


def _of(name: str, e: int | None) -> str:
    return name if e is None else f"{name}_{e}"


_CLIMBING = ((0.0, 0.9), (-0.3, 0.3), (0.0, 0.4))
"""Bounds on f_n, f_y and the vertical shear f_z on a wall, in units of the robot's weight (Lin et
al. §IV-A)."""
_WALKING = ((0.0, 0.5), (-0.15, 0.15), (-0.15, 0.15))
"""The same on the ground."""
_LENGTH_SCALE_M = 0.6


def rule_of_thumb(
    shoulders_m: Array, reach_m: Array, climbs: NDArray[np.bool_], length_scale_m: float
) -> Envelope:
    """p within the limbs' workspace, f within CLIMBING for limbs on a wall, WALKING for those on
    the ground.

    Arguments:
        shoulders_m: shape (N, 3) [m].
        reach_m, climbs: shape (N,).
    """
    force = np.where(np.asarray(climbs)[:, None, None], _CLIMBING, _WALKING)
    reach = np.asarray(reach_m)[:, None]
    return Envelope(
        low=np.concatenate([(shoulders_m - reach) / length_scale_m, force[..., 0]], axis=1),
        high=np.concatenate([(shoulders_m + reach) / length_scale_m, force[..., 1]], axis=1),
    )


def expert_envelopes(
    terrain: Literal["ground", "wall"],
    robot: Robot | None = None,
    legs: tuple[str, ...] = THREE_LEGS,
) -> EnvelopeSet:
    """One envelope for these legs on the ground, or on two facing walls, up to 30° off: p within
    the limbs' workspace, f within WALKING or CLIMBING.
    """
    robot = robot or hexapod()
    limbs = robot.select(legs)
    shoulders = np.array([limb.shoulder_m for limb in limbs])
    reach = np.array([limb.reach_m for limb in limbs])
    inward = np.where(shoulders[:, 1] < 0.0, 1.0, -1.0)
    walls = np.column_stack([0.0 * inward, inward, 0.0 * inward])
    return EnvelopeSet(
        problem_class=f"{terrain}-{len(limbs)}",
        legs=tuple(legs),
        force_scale_n=robot.mass_kg * GRAVITY_M_S2,
        length_scale_m=_LENGTH_SCALE_M,
        normals=walls if terrain == "wall" else np.tile([0.0, 0.0, 1.0], (len(limbs), 1)),
        tilt_rad=np.full(len(limbs), MAX_TILT_RAD),
        envelopes=(
            rule_of_thumb(
                shoulders, reach, np.full(len(limbs), terrain == "wall"), _LENGTH_SCALE_M
            ),
        ),
        provenance={"method": "heuristic", "source": "paper E §IV-A"},
    )


FEASIBLE_MARGIN = 1e-7
"""A margin up to this counts as feasible: the solver's own tolerance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Relaxed:
    """A point of a relaxation, in which a toe may stand on several candidates at once.

    Arguments:
        com, rotation: (M, 3).
        weights: λ ≥ 0, shape (V,), which add up to 1 at every foothold.
        forces: in contact frames, one at each of ``rows`` = (stance contact, candidate), shape (n,
            3).
        seconds: in the solver [s].
    """

    scaled: Scaled
    com: Array
    rotation: Array
    weights: Array
    forces: Array
    rows: tuple[Index, Index]
    seconds: float = 0.0

    @classmethod
    def of(cls, scaled: Scaled, solution: ConicSolution, rows: tuple[Index, Index]) -> Relaxed:
        """Values of the variables in a program's solution.

        Arguments:
            rows: of its forces.
        """
        return cls(
            scaled=scaled,
            com=solution.value("com"),
            rotation=solution.value("rotation"),
            weights=unit_shares(scaled, solution.value("weights")),
            forces=solution.value("forces"),
            rows=rows,
            seconds=solution.seconds,
        )

    @cached_property
    def shares(self) -> Array:
        """z of every candidate, shape (K,)."""
        return np.asarray(np.add.reduceat(self.weights, self.scaled.layout.candidate_starts))

    @cached_property
    def toes(self) -> Array:
        """Position of each candidate's share of the toe, shape (K, 3)."""
        starts = self.scaled.layout.candidate_starts
        sums = np.add.reduceat(self.weights[:, None] * self.scaled.vertices, starts)
        return sums / np.maximum(self.shares, 1e-12)[:, None]

    def rounded(self) -> tuple[Index, Point]:
        """The candidate of the largest share of every foothold, by number, (P,), and a point whose
        toes are on them.
        """
        number = self.scaled.numbers
        if len(number) == self.scaled.layout.footholds:  # nothing to round
            one = len(self.forces) == len(self.scaled.force_min)
            return number, self._point(
                self.toes, self.forces if one else self._added(np.arange(len(number)))
            )
        ends = np.cumsum([len(counts) for counts in self.scaled.layout.corners])
        parts = np.split(self.shares, ends[:-1])
        chosen = np.array(
            [end - len(part) + int(part.argmax()) for end, part in zip(ends, parts, strict=True)]
        )
        return number[chosen], self._point(self.toes[chosen], self._added(chosen))

    def _added(self, chosen: Index) -> Array:
        """All forces of a contact as one, in the frame of the chosen candidate, shape (B, 3)."""
        scaled, layout, (contact, candidate) = self.scaled, self.scaled.layout, self.rows
        world = np.matmul(scaled.frames[candidate], self.forces[..., None])[..., 0]
        total = np.zeros((len(layout.contacts[0]), 3))
        np.add.at(total, contact, world)
        frames = scaled.frames[chosen][layout.contacts[2]]
        return np.asarray(np.matmul(frames.transpose(0, 2, 1), total[..., None])[..., 0])

    def _point(self, toes: Array, forces: Array) -> Point:
        return Point(
            com=self.com,
            rotation=self.rotation,
            toes=toes,
            forces=forces,
            residual=float("inf"),
            seconds=self.seconds,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RelaxationAnswer:
    """One solve of P1.

    Arguments:
        margin: t; of the hard form 0 where it has an answer; inf where there is none, NaN where the
            solver gave up.
        relaxed: the answer, off the bilinear surface by ``excess`` = m − p f, shape (B, 3, 3),
            indices contact, j, k.
        at: [p, f], f in the axes of the box, (B, 6).
        chosen: which envelope of a set.
        objective: of the hard form.
        modes: z of every stance and box, (S, E).
        gradient: (∂t/∂low, ∂t/∂high), (B, 6) each, where asked for.
    """

    margin: float
    relaxed: Relaxed | None = None
    at: Array | None = None
    excess: Array | None = None
    chosen: int = 0
    objective: float = float("nan")
    modes: Array | None = None
    solves: int = 1
    seconds: float = 0.0
    gradient: tuple[Array, Array] | None = None

    @property
    def feasible(self) -> bool:
        """Tell whether P1 admits the problem.

        False also where nothing is known: see ``known``.
        """
        return self.margin <= FEASIBLE_MARGIN

    @property
    def known(self) -> bool:
        """Tell whether the solver came to an end."""
        return not np.isnan(self.margin)

    @cached_property
    def point(self) -> Point | None:
        """A point to project from, rounded to a choice of candidates where there is one; None
        without an answer.
        """
        return None if self.relaxed is None else self.relaxed.rounded()[1]

    @property
    def gap(self) -> float:
        """Largest |m − p f|; NaN without an answer."""
        return float("nan") if self.excess is None else float(np.abs(self.excess).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class DualBound:
    """Knowledge about every other box over the same posture problem from one solve of P1.

    Arguments:
        margin: as in ``RelaxationAnswer``; the rest is None where there is none.
        point: [p, f], shape (N, 6), and excess = m − p f, shape (N, 3, 3), indices contact, j, k: a
            primal solution.
        rows: u ≥ 0, multipliers of the four envelope rows low-low, high-high, low-high, high-low,
            shape (4, N, 3, 3).
        slope, constant: what the Lagrangian  slope · [p, f] + constant  of all other constraints
            but [p, f] ∈ B and t is, shape (N, 6), minimised over what else there is, a lower bound
            that holds for every answer of the problem.
    """

    margin: float
    point: Array | None = None
    excess: Array | None = None
    rows: Array | None = None
    slope: Array | None = None
    constant: float = 0.0


def unit_shares(scaled: Scaled, weights: Array) -> Array:
    """λ as a solver gives them, made ≥ 0 with sum 1 at every foothold."""
    weights = np.maximum(weights, 0.0)
    foothold = scaled.layout.vertex_footholds
    totals = np.bincount(foothold, weights, minlength=scaled.layout.footholds)
    return np.asarray(weights / np.maximum(totals, 1e-300)[foothold])


class RelaxedProgram(Protocol):
    """A convex program that relaxes m = p f, made for one layout as ``TYPE(layout)``.

    Class attributes:
        over_boxes: whether it bounds [p, f] by learned boxes; the lift does not.
        about_points: whether each box comes with a point [p, f], as in ``joint``.
    """

    over_boxes: ClassVar[bool]
    about_points: ClassVar[bool]

    def __init__(self, layout: Layout) -> None: ...

    @classmethod
    def margin(
        cls, programs: Programs, scaled: Scaled, box: Envelope, *, gradient: bool = False
    ) -> RelaxationAnswer:
        """The signed margin over a box: the least t by which the rows of its envelope have to give
        way.

        The relaxation has an answer where t ≤ 0. The margin is inf where not even the rest of the
        problem has an answer, and NaN where the solver failed.

        Arguments:
            programs: compiled models to share.
            gradient: also ∂t/∂low and ∂t/∂high.
        """
        ...

    @classmethod
    def answers(
        cls,
        programs: Programs,
        scaled: Sequence[Scaled],
        boxes: Sequence[Sequence[Envelope]],
        points: Sequence[Array],
    ) -> list[RelaxationAnswer]:
        """The answer over the best box of each problem; all problems have one layout.

        Arguments:
            boxes: one or more per problem; those that need none ignore them.
            points: [p, f] of shape (B, 6) per problem where ``about_points``; else empty.
        """
        ...


RELAXATIONS: Registry[type[RelaxedProgram]] = Registry(
    "relaxation",
    "stancekit.relaxations",
    {
        "p1": "stancekit.planners.relaxation.mccormick:McCormick",
        "joint": "stancekit.planners.relaxation.lift:JointRelaxation",
        "coned": "stancekit.planners.relaxation.mccormick:Coned",
        "lift": "stancekit.planners.relaxation.lift:LiftProgram",
    },
    expected="a class with margin and answers, as McCormick has them",
    accepts=lambda it: all(callable(getattr(it, name, None)) for name in ("margin", "answers")),
)
"""The relaxations of postures; a class that derives from ``McCormick`` serves courses, too."""
