"""A posture problem or a course in non-dimensional numbers (E3, E4), with the half-spaces of its
limbs' reach, by the rows of its layout: what programs are fed.

A posture is a plan of one frame: each contact a foothold with one candidate, all of them one
stance. Lengths are in units of the length scale, forces of the force scale (a course's is the
robot's weight), moments of their product.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..arguments import cached_property
from ..files.arrays import Array
from ..problem import Contact, Problem
from ..problem.problem import Weights
from ..robot.model import Limb, ReachRows, Robot, turned_most
from .layout import Index, Layout, shared

Values = TypeVar("Values")


def _of_problem(scaled: Callable[..., Values], course: Problem) -> Values:
    """A problem as ``scaled`` holds it, with every candidate open."""
    scale, limbs, limits = course.unit_m, course.robot.limbs, course.steps
    origin = course.origin_m
    patches = [patch for foothold in course.footholds for patch in foothold.candidates]
    borders = [
        patch.vertices_m if foothold.toe_m is None else foothold.toe_m[None]
        for foothold, regions in zip(course.footholds, course.regions, strict=True)
        for patch in regions
    ]
    points, offsets = _offsets(
        [each for row in course.offsets_m for each in row] if course.has_soles else [], scale
    )
    sizes = iter(len(border) for border in borders)
    toe_sides, turn_sides = course.side_rows
    linear = _linear(limits.linear_rows(scale), turn_sides, course.frames - 1)
    layout = shared(
        Layout(
            holds=tuple(tuple(row) for row in course.holds.tolist()),
            stances=tuple((stance.frame, stance.limbs) for stance in course.stances),
            corners=tuple(
                tuple(next(sizes) for _ in foothold.candidates) for foothold in course.footholds
            ),
            reach_rows=HalfSpaces.counts(limbs),
            points=tuple(1 if limb.sole_m is None else len(limb.sole_m) for limb in limbs)
            if points
            else (),
            relative=pairs_of_feet(course.robot),
            least_toes=len(toe_sides) > 0,
            linear=linear.shape[1],
            stands=course.weights is not None and course.weights.stance > 0.0,
            level=course.tilt_limit_rad == 0.0,
        )
    )
    wrench = _wrench(course, layout)
    if len(wrench):
        copies = len(wrench) // len(layout.stances) - 1
        stances = layout.stances * (1 + copies)
        layout = replace(layout, stances=stances, pushes=copies, wrench=course.wrench is not None)
    direction = np.array([course.direction(k) for k in range(1, course.frames)]).reshape(-1, 3)
    low, high = course.force_bounds
    under = layout.contacts[2]
    return scaled(
        layout=layout,
        options=max(len(foothold.candidates) for foothold in course.footholds),
        which=tuple(tuple(range(len(foothold.candidates))) for foothold in course.footholds),
        vertices=(np.concatenate(borders) - origin) / scale,
        frames=np.array([patch.frame for patch in patches]),
        friction=np.array([patch.friction for patch in patches]),
        shoulders=np.array([limb.shoulder_m for limb in limbs]) / scale,
        reach=np.array([limb.reach_m for limb in limbs]) / scale,
        force_min=_force_min(low, layout),
        force_max=high[under],
        weight=course.weight_n / course.force_n,
        com=(course.com_nominal_m - origin) / scale,
        com_radius=course.com_radius_m / scale,
        tilt=course.tilt_limit_rad,
        steps=(limits.com_m / scale, limits.toe_m / scale, limits.rotation_rad),
        direction=direction,
        progress=np.where(direction.any(axis=1), limits.progress_m / scale, 0.0),
        goal=(course.goal_m - origin) / scale,
        weights=course.weights,
        length_m=scale,
        force_n=course.force_n,
        origin_m=origin,
        half_spaces=HalfSpaces.of(limbs, scale, course.tilt_limit_rad),
        offsets=offsets,
        relative=relative_half_spaces(course.robot, scale, toe_sides),
        linear=linear,
        wrench=wrench,
        standing=_standing(course, layout),
    )


def _linear(rows: Array, turn_sides: Array, steps: int) -> Array:
    """``Scaled.linear``: the further rows of every step of the body, and its least rotation.

    Arguments:
        rows: of each step, shape (R, 7).
        turn_sides: n·(Θ′ − Θ) ≥ b by step, shape (M − 1, 4) or (0, 4).
    """
    if not steps:
        return np.zeros((0, *rows.shape))
    each = np.broadcast_to(rows, (steps, *rows.shape))
    if not len(turn_sides):
        return each
    turns = np.concatenate([np.zeros((steps, 3)), -turn_sides], axis=1)
    return np.concatenate([each, turns[:, None]], axis=1)


def _force_min(low: Array, layout: Layout) -> Array:
    """``Scaled.force_min``: the lower force bounds of all contacts, taken from those of the
    footholds. Under a push a foot may press less than its bound at rest.
    """
    least = low[layout.contacts[2]]
    if not layout.pushes:
        return np.asarray(least)
    pushed = layout.contacts[0] >= layout.unpushed
    least[pushed, 0] = np.minimum(least[pushed, 0], 0.0)
    return least


def _standing(course: Problem, layout: Layout) -> Array:
    """``Scaled.standing`` of a course."""
    if not layout.stands:
        return np.zeros((0, 3))
    assert course.standing_m is not None
    frame, limb, _ = layout.standing
    return course.standing_m[frame, limb] / course.unit_m


def _wrench(course: Problem, layout: Layout) -> Array:
    """``Scaled.wrench`` of a course: its own, and then with the corners of a square about the disc
    of pushes that it asks for, each on all stances.
    """
    corner = np.sqrt(2.0) * course.push_n / course.force_n
    corners = [(0.0, 0.0), (corner, 0.0), (0.0, corner), (-corner, 0.0), (0.0, -corner)]
    if course.push_n == 0.0:
        if course.wrench is None:
            return np.zeros((0, 6))
        corners = corners[:1]
    common = np.zeros((len(layout.stances), 6))
    if course.wrench is not None:
        unit = course.force_n * np.array([1.0, 1.0, 1.0, *(course.unit_m,) * 3])
        common = (course.wrench / unit)[layout.stance_frames]
    wrenches = np.tile(common, (len(corners), 1))
    wrenches[:, :2] += np.repeat(corners, len(common), axis=0)
    return wrenches


def _offsets(each: Sequence[Array], length_m: float) -> tuple[tuple[int, ...], Array]:
    """Number of points per contact, () where all have one, and ``Scaled.offsets``."""
    counts = tuple(len(offsets) for offsets in each)
    if max(counts, default=1) == 1:
        return (), np.zeros((0, 1, 3))
    table = np.zeros((len(each), max(counts), 3))
    for row, offsets in zip(table, each, strict=True):
        row[: len(offsets)] = offsets / length_m
    return counts, table


@dataclass(frozen=True, kw_only=True, eq=False)
class HalfSpaces:
    """Non-dimensional numbers of H half-spaces, by limb.

    Arguments:
        normals: a.
        bounds: b. Of the inner sets levers: a × z.
        arms: t(a) U(a), with ‖U(a) x‖ = ‖a × x‖: two rows across a, as long as a.
        offsets: t(a) U(a) z. Of the outer ones outer_levers: a × s.
        outer_bounds: b + t(a) (ρ + t(s)).
    """

    normals: Array  # (H, 3)
    bounds: Array  # (H,)
    levers: Array  # (H, 3)
    arms: Array  # (H, 2, 3)
    offsets: Array  # (H, 2)
    outer_levers: Array  # (H, 3)
    outer_bounds: Array  # (H,)

    @classmethod
    def of(cls, limbs: Sequence[Limb | Contact], length_m: float, tilt_rad: float) -> HalfSpaces:
        """Half spaces of some limbs."""
        parts = [
            (
                rows.normals,
                rows.bounds_m,
                np.tile([*limb.shoulder_m, limb.reach_m, *_centre(limb, rows)], (count, 1)),
            )
            for limb, count in zip(limbs, cls.counts(limbs), strict=False)
            if (rows := limb.reach_rows) is not None
        ]
        if not parts:
            return cls.none()
        normals, bounds, owners = (np.concatenate(part) for part in zip(*parts, strict=True))
        bounds, owners, turned = (
            bounds / length_m,
            owners / length_m,
            turned_most(normals, tilt_rad),
        )
        shoulders, reach, levers = owners[:, :3], owners[:, 3], np.cross(normals, owners[:, 4:])
        arms = turned[:, None, None] * _across(normals)
        return cls(
            normals=normals,
            bounds=bounds,
            levers=levers,
            offsets=(arms @ owners[:, 4:, None])[:, :, 0],
            arms=arms,
            outer_levers=np.cross(normals, shoulders),
            outer_bounds=bounds + turned * (reach + turned_most(shoulders, tilt_rad)),
        )

    @classmethod
    def none(cls) -> HalfSpaces:
        """No half-spaces."""
        line, vectors = np.zeros(0), np.zeros((0, 3))
        return cls(
            normals=vectors,
            bounds=line,
            levers=vectors,
            arms=np.zeros((0, 2, 3)),
            offsets=np.zeros((0, 2)),
            outer_levers=vectors,
            outer_bounds=line,
        )

    @staticmethod
    def counts(limbs: Sequence[Limb | Contact]) -> tuple[int, ...]:
        """Number of half spaces per limb; () where none has any."""
        result = tuple(
            0 if limb.reach_rows is None else len(limb.reach_rows.bounds_m) for limb in limbs
        )
        return result if any(result) else ()


def _across(normals: Array) -> Array:
    """U(a) of vectors of shape (H, 3): with the axis that is least along a, a × e and a × (a × e),
    both as long as a; shape (H, 2, 3).
    """
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    first *= length / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first) / length], axis=1)


def _centre(limb: Limb | Contact, rows: ReachRows) -> Array:
    """z: the middle of the half-spaces, drawn into the ball."""
    out = rows.centre_m - limb.shoulder_m
    return limb.shoulder_m + out * min(1.0, limb.reach_m / max(float(np.linalg.norm(out)), 1e-12))


def relative_half_spaces(robot: Robot, length_m: float, sides: Array) -> Array:
    """Non-dimensional half-spaces a·(p_other − p_limb) ≤ b, by pair of feet (``robot.reach``), and
    those that sides n·(p′ − p) ≥ b of least steps of toes are: (a, b), shape (G, 4).

    Arguments:
        sides: (n, b), shape (K, 4) [m].
    """
    pairs = [
        np.column_stack([each.rows.normals, each.rows.bounds_m]) for each in robot.relative_reach
    ]
    return np.concatenate([np.zeros((0, 4)), *pairs, -sides]) / [1.0, 1.0, 1.0, length_m]


def pairs_of_feet(robot: Robot) -> tuple[tuple[int, int, int], ...]:
    """``Layout.relative``."""
    number = {name: index for index, name in enumerate(robot.limb_names)}
    return tuple(
        (number[e.limb], number[e.other], len(e.rows.bounds_m)) for e in robot.relative_reach
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """A point in the space of plans, non-dimensional; on the bilinear surface m = p f where
    ``residual`` is about zero.

    Arguments:
        com, rotation: shape (M, 3).
        toes: one a foothold, (P, 3).
        forces: contact frames, a row a stance contact, (B, 3).
        residual: largest component of a net moment, inf where there is no answer.
        objective: of a course, where it was minimised.
        solves, seconds: what it took to get here.
    """

    com: Array
    rotation: Array
    toes: Array
    forces: Array
    residual: float
    objective: float = float("nan")
    solves: int = 1
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Scaled:
    """The numbers of a problem; see ``Layout`` for the counts.

    Arguments:
        options: most candidates of a foothold in the problem.
        which: the number, in the problem, of every open candidate, by foothold.
        vertices: v_u, shape (V, 3); a toe that already stands is a candidate of one vertex.
        frames: R_WC, columns n, y, z, shape (K, 3, 3).
        friction: (K,).
        shoulders: (N, 3).
        reach: (N,).
        half_spaces: of reach.
        relative: half-spaces (a, b) of feet from one another, shape (G, 4).
        offsets: from the toe to the points of its foot, on every candidate, with zeros after them,
            shape (K, points, 3); of point feet (0, 1, 3).
        force_min, force_max: on (f_n, f_y, f_z) of every stance contact, (B, 3).
        weight: m·g.
        com: nominal, (M, 3).
        com_radius: (M,).
        tilt: limit [rad].
        steps: largest step of the COM, of a toe and of the rotation.
        direction: of the nominal steps, (M − 1, 3).
        progress: least along them, (M − 1,).
        goal: (3,).
        linear: further rows of every step of the body, see ``StepLimits.linear_rows``, and the
            side of its least rotation, shape (M − 1, R, 7).
        weights: of the objective, None for a posture, which has none.
        wrench: on the body beside its weight in each stance, force and moment about the centre of
            mass, shape (S, 6); without any (0, 6).
        standing: from the centre of mass to each toe as the robot stands, a row for each of
            ``Layout.standing``, (T, 3); without any (0, 3).
        origin_m: place in the world that places are measured from, (3,) [m].
    """

    layout: Layout
    options: int
    which: tuple[tuple[int, ...], ...]
    vertices: Array
    frames: Array
    friction: Array
    shoulders: Array
    reach: Array
    force_min: Array
    force_max: Array
    weight: float
    com: Array
    com_radius: Array
    tilt: float
    steps: tuple[float, float, float]
    direction: Array
    progress: Array
    goal: Array
    weights: Weights | None
    length_m: float
    force_n: float
    origin_m: Array = field(default_factory=lambda: np.zeros(3))
    half_spaces: HalfSpaces = field(default_factory=HalfSpaces.none)
    offsets: Array = field(default_factory=lambda: np.zeros((0, 1, 3)))
    relative: Array = field(default_factory=lambda: np.zeros((0, 4)))
    linear: Array = field(default_factory=lambda: np.zeros((0, 0, 7)))
    wrench: Array = field(default_factory=lambda: np.zeros((0, 6)))
    standing: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "layout", shared(self.layout))

    @classmethod
    def of(cls, problem: Problem) -> Scaled:
        """Scale a problem: forces (E3) and positions (E4) as non-dimensional numbers."""
        return _of_problem(cls, problem)

    @property
    def aim(self) -> Weights:
        """The weights of the objective, which there is."""
        assert self.weights is not None
        return self.weights

    @property
    def size(self) -> tuple[int, int]:
        """(contacts, most vertices of a patch)."""
        return len(self.force_min), max(count for counts in self.layout.corners for count in counts)

    @cached_property
    def numbers(self) -> Index:
        """The number, in the problem, of every open candidate, shape (K,)."""
        return np.array([number for numbers in self.which for number in numbers], dtype=np.int_)

    @cached_property
    def patches(self) -> Array:
        """Vertices by candidate, shape (K, U, 3); a shorter border repeats its last vertex."""
        counts = np.array([count for counts in self.layout.corners for count in counts])
        starts = np.cumsum(counts) - counts
        return np.asarray(
            self.vertices[
                starts[:, None] + np.minimum(np.arange(counts.max()), counts[:, None] - 1)
            ]
        )

    @cached_property
    def pieces(self) -> tuple[Array, ...]:
        """The border of every candidate, shapes (·, 3)."""
        ends = np.cumsum([count for counts in self.layout.corners for count in counts])
        return tuple(np.split(self.vertices, ends[:-1]))

    @cached_property
    def box_implied(self) -> bool:
        """Tell whether cones and normal-force limits imply the rest of the force boxes, so that its
        rows can be left out.

        Then f_n ≥ 0 comes from the cone and λ ≥ 0 from f_n ≤ λ f_max, too.
        """
        return self.boxes_implied(self.friction[None])[0]

    def boxes_implied(self, frictions: Array) -> list[bool]:
        """``box_implied`` with other friction, of every row of shape (B, K)."""
        contact, candidate = self.layout.contact_candidates
        friction, normal = frictions[:, candidate], self.force_max[contact, 0]
        room = np.minimum(self.force_max[:, 1:], -self.force_min[:, 1:]).min(axis=1)[contact]
        implied = (friction > 1e-3) & (
            friction * normal <= room
        )  # on ice the cone says nothing of f_n
        of_all = bool((self.force_min[:, 0] <= 0.0).all() and (normal > 0.0).all())
        return [of_all and one for one in implied.all(axis=1).tolist()]

    @cached_property
    def arms(self) -> Array:
        """[v_u]× R_WC of every vertex under a stance contact: maps a force at it to its moment,
        shape (F, 3, 3).
        """
        candidate = self.layout.vertex_candidates[self.layout.contact_vertices[1]]
        return np.asarray(np.matmul(skew(self.bearing_vertices), self.frames[candidate]))

    @cached_property
    def bearing_vertices(self) -> Array:
        """Points at which the force of a stance contact acts, its toe being at each vertex under
        it, shape (F, 3).
        """
        contact, vertex = self.layout.contact_vertices
        if not self.layout.points:
            return np.asarray(self.vertices[vertex])
        point, candidate = (
            self.layout.contact_points[contact],
            self.layout.vertex_candidates[vertex],
        )
        return np.asarray(self.vertices[vertex] + self.offsets[candidate, point])

    def bearing_points(self, toes: Array) -> Array:
        """Points at which the forces of the stance contacts act; one candidate a foothold.

        Arguments:
            toes: (P, 3); shape (B, 3).
        """
        foothold = self.layout.contacts[2]
        if not self.layout.points:
            return np.asarray(toes[foothold])
        return np.asarray(toes[foothold] + self.offsets[foothold, self.layout.contact_points])

    def opened(self) -> Array:
        """1 where a candidate of a foothold is open, shape (P, options)."""
        table = np.zeros((self.layout.footholds, self.options))
        table[self.layout.candidate_footholds, self.numbers] = 1.0
        return table

    def by_candidate(self, values: Array, missing: float) -> Array:
        """Values of all candidates, (K,), as a table by foothold and number, shape (P, options)."""
        table = np.full((self.layout.footholds, self.options), missing)
        table[self.layout.candidate_footholds, self.numbers] = values
        return table

    def only(self, opened: Array) -> Scaled:
        """The problem with only these candidates, of those that there are; shape (P, options)."""
        open_numbers = opened[self.layout.candidate_footholds, self.numbers] > 0.0
        if open_numbers.all():
            return self
        rows = zip(self.which, self.layout.corners, opened.tolist(), strict=True)
        left = [
            [(r, n) for r, n in zip(numbers, counts, strict=True) if row[r] > 0.0]
            for numbers, counts, row in rows
        ]
        corners = tuple(tuple(count for _, count in some) for some in left)
        return replace(
            self,
            layout=replace(self.layout, corners=corners),
            which=tuple(tuple(number for number, _ in some) for some in left),
            vertices=self.vertices[open_numbers[self.layout.vertex_candidates]],
            frames=self.frames[open_numbers],
            friction=self.friction[open_numbers],
            offsets=self.offsets[open_numbers] if self.layout.points else self.offsets,
        )

    def chosen(self, choice: NDArray[np.int_]) -> Scaled:
        """The problem with one candidate a foothold, by its number, shape (P,)."""
        if len(self.numbers) == len(choice) and (
            choice is self.numbers or (choice == self.numbers).all()
        ):
            return self
        opened = np.zeros((self.layout.footholds, self.options))
        opened[np.arange(len(choice)), choice] = 1.0
        return self.only(opened)

    def with_piece(self, candidate: int, border: Array) -> Scaled:
        """The problem with one candidate confined to a piece of its patch, as a search in space
        cuts it.

        Arguments:
            candidate: its number, 0 ≤ candidate < K.
            border: the corners of the piece in order, shape (U, 3), non- dimensional.
        """
        pieces = (*self.pieces[:candidate], border, *self.pieces[candidate + 1 :])
        sizes = iter(len(piece) for piece in pieces)
        corners = tuple(tuple(next(sizes) for _ in counts) for counts in self.layout.corners)
        layout = (
            self.layout if corners == self.layout.corners else replace(self.layout, corners=corners)
        )
        return replace(self, layout=layout, vertices=np.concatenate(pieces))

    def with_force_box(self, low: Array, high: Array) -> Scaled:
        """The problem with these bounds on the forces of its stance contacts in place of f_min and
        f_max of E10.

        Arguments:
            low, high: in contact frames, shape (B, 3) each, non-dimensional.
        """
        return replace(self, force_min=low, force_max=high)

    @cached_property
    def borne(self) -> Array:
        """The sum of the contacts' forces in every stance: the weight, less the force on the body;
        shape (S, 3).
        """
        weight = np.tile([0.0, 0.0, self.weight], (len(self.layout.stances), 1))
        return weight - self.wrench[:, :3] if self.layout.loaded else weight

    @cached_property
    def twisted(self) -> Array:
        """The moment on the body about the centre of mass in every stance, shape (S, 3)."""
        return self.wrench[:, 3:] if self.layout.loaded else np.zeros((len(self.layout.stances), 3))

    def in_world(self, forces: Array) -> Array:
        """Forces of the stance contacts turned from contact frames to the world; one candidate a
        foothold; (B, 3).
        """
        return np.asarray(np.matmul(self.contact_frames, forces[..., None])[..., 0])

    @property
    def farthest(self) -> Array:
        """The most that ‖p_w − c‖ can be, by limb (E11), shape (N,)."""
        away = np.linalg.norm(self.shoulders, axis=1) + turned_most(self.shoulders, self.tilt)
        return np.asarray(self.reach + away)

    @cached_property
    def contact_frames(self) -> Array:
        """R_WC of every stance contact; one candidate a foothold; shape (B, 3, 3)."""
        return np.asarray(self.frames[self.layout.contacts[2]])

    def forces_si(self, point: Point) -> tuple[Array, dict[str, Array]]:
        """Forces of every limb in every stance, in the world, (S, N, 3) [N]; one candidate a
        foothold.

        And of soles, where there are: point_forces_n, (S, N, points, 3) [N], which add up to them,
        and points_m, where the points of every foothold are, (P, points, 3) [m].
        """
        layout, count = self.layout, self.layout.unpushed
        of_candidates = layout.contacts[0] < count  # the others are borne with forces of their own
        stance, limb, _ = (rows[of_candidates] for rows in layout.contacts)
        forces, world = (
            np.zeros((count, layout.limbs, 3)),
            self.in_world(point.forces)[of_candidates] * self.force_n,
        )
        if not layout.points:
            forces[stance, limb] = world
            return forces, {}
        each = np.zeros((count, layout.limbs, max(layout.points), 3))
        each[stance, limb, layout.contact_points[of_candidates]] = world
        points = self.places_m(point.toes[:, None] + self.offsets)
        return np.asarray(each.sum(axis=2)), {"points_m": points, "point_forces_n": each}

    def places_m(self, places: Array) -> Array:
        """Places with their units back, in the world, shape (…, 3) [m]."""
        return np.asarray(places * self.length_m + self.origin_m)

    def point(self, posture: Plan) -> Array:
        """[p, f] of a posture, the columns p_x p_y p_z f_n f_y f_z: p in world axes, f in the
        frames; shape (N, 6).
        """
        position = (posture.toes_m - posture.com_m) / self.length_m
        forces = (
            np.matmul(self.frames.transpose(0, 2, 1), posture.forces_n[0, ..., None])[..., 0]
            / self.force_n
        )
        return np.concatenate([position, forces], axis=1)


def skew(vectors: Array) -> Array:
    """[v]×, so that [v]× w = v × w; shape (..., 3) to (..., 3, 3)."""
    numbers = np.zeros((*vectors.shape[:-1], 7))
    numbers[..., :3] = vectors
    np.negative(vectors, out=numbers[..., 3:6])
    return numbers.take(_SKEW, axis=-1).reshape(*vectors.shape, 3)


_SKEW = np.array([6, 5, 1, 2, 6, 3, 4, 0, 6])  # of (x, y, z, −x, −y, −z, 0), by rows


def cones_met(low: Array, high: Array, friction: Sequence[float] | Array) -> tuple[Array, Array]:
    """Force boxes met with the box around their friction cones (E10): f_n ≥ 0, |f_y|, |f_z| ≤ μ
    f_n,max.

    Arguments:
        low, high: in contact frames, shape (B, 3) each.
        friction: μ, shape (B,).

    Returns:
        Both bounds anew, shape (B, 3) each; no force of cone and box is lost.
    """
    shear = (np.asarray(friction) * np.maximum(high[:, 0], 0.0))[:, None]
    low, high = low.copy(), high.copy()
    low[:, 0] = np.maximum(low[:, 0], 0.0)
    low[:, 1:], high[:, 1:] = np.maximum(low[:, 1:], -shear), np.minimum(high[:, 1:], shear)
    return low, high


ROOM = 4.0
"""Bound on non-dimensional coordinates in an observation."""


def observe(scaled: Scaled) -> dict[str, NDArray[np.float32]]:
    """The observation of a scene, an array a name."""
    return {name: values[0] for name, values in observe_batch([scaled]).items()}


def observe_batch(scaled: Sequence[Scaled | Any]) -> dict[str, NDArray[np.float32]]:
    """The observations of several scenes of one size, a row each.

    Arguments:
        scaled: problems, or whatever has their patches, frames, friction, shoulders and reach.
    """

    def seen(name: str, room: float) -> NDArray[np.float32]:
        values = np.stack(
            [getattr(problem, "patches" if name == "vertices" else name) for problem in scaled]
        )
        view: NDArray[np.float32] = (
            np.clip(values, -room, room).astype(np.float32).reshape(len(scaled), -1)
        )
        return view

    rooms = {"vertices": ROOM, "frames": 1.0, "friction": ROOM, "shoulders": ROOM, "reach": ROOM}
    return {name: seen(name, room) for name, room in rooms.items()}
