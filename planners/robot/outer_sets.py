"""Sets that hold a robot whatever posture its joints take: where its centre of mass is in the base's
frame, and where its feet are about that centre.

Legs that move take the centre of mass along, so that a foot's places about the standing centre hold
nothing of the robot. The place of a foot less that of the centre of mass is Σ w_b p_b over points of
bodies, w_b = −m_b/m of every body's own centre and +1 of the foot. Outward of joint i these are
within a set X_i of vectors in the joint's frame, W_i the sum of the weights there: at an angle q of
the joint they are W_i o_i + R_i Z(q) X_i in the frame before it, and what a joint carries adds up
(Minkowski). This turns such sets, with how much larger they get. All joints of the file take
part, those of arms as well, each over its whole range; one without limits over a whole turn.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache, reduce
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array
from ..terrain.patch import hull_of
from .hulls import Polytope
from .leg import FULL_TURN, Leg
from .meshes import Shape, kept, link_points, solid_shapes
from .model import Limb
from .robot_model import RobotModel
from .urdf_reader import axes_of, base_joint

if TYPE_CHECKING:
    from .model import Robot


_STEPS = 48
"""Steps of a joint's whole range."""
_DIRECTIONS = 128
_MOST_POINTS = 2500
"""Most points of a hull that is turned; more are thinned."""
_MOST_SUMMED = 200
"""Most points of a hull that is added to another one."""
_COARSEST = 0.005
"""Share of a hull's size: how far the finest thinning moves a point at most."""
_ROUNDING_M = 1e-9
"""Added for the arithmetic."""


def foot_cloud(leg: Leg) -> _Cloud:
    """All places of a leg's foot in the base's frame."""
    chain, cloud = leg.chain, _Cloud(points=leg.chain.tip_m[None], slack_m=_ROUNDING_M)
    limits = np.column_stack([leg.lower_rad, leg.upper_rad])
    for i in reversed(range(chain.joints)):
        place, axis = (chain.rotations[i], chain.origins[i]), chain.axes[i]
        cloud = turned(cloud, 1.0, *place, axis, bool(chain.slides[i]), *limits[i])
    return cloud


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cloud:
    """All that is within a slack of the convex hull of points.

    Arguments:
        points: shape (K, 3) [m].
        slack_m: ε [m].
    """

    points: Array
    slack_m: float

    def supports(self, normals: Array) -> Array:
        """Largest product with unit vectors, shape (D, 3), shape (D,) [m]."""
        return np.asarray((self.points @ normals.T).max(axis=0) + self.slack_m)

    @cached_property
    def ball(self) -> tuple[Array, float]:
        """Centre and radius of a ball that holds it [m]."""
        centre, radius = enclosing_ball(self.points)
        return centre, radius + self.slack_m

    def fewer(self, most: int) -> _Cloud:
        """A cloud that holds this one, of so many points or a few more."""
        points, slack, share = self.points, 0.0, _COARSEST
        size = max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-6)
        while len(points) > most and share < 1.0:
            points, slack = _thinned(self.points, 0.5 * share * size)
            share *= 1.25
        return _Cloud(points=points, slack_m=self.slack_m + slack)

    def farthest_from(self, other: _Cloud) -> float:
        """Largest distance of a point of this one from one of another [m]."""
        from scipy.spatial.distance import cdist  # slow to import

        one, two = self.fewer(_MOST_POINTS), other.fewer(_MOST_POINTS)
        return float(cdist(one.points, two.points).max()) + one.slack_m + two.slack_m


def turned(
    cloud: _Cloud,
    weight: float,
    rotation: Array,
    origin: Array,
    axis: Array,
    slides: bool,
    lower: float,
    upper: float,
) -> _Cloud:
    """Carry what lies outward of a joint over the joint's whole range, into the frame before it.

    Arguments:
        weight: of what lies outward: 1 of a point, 0 of the difference of two.
        rotation, origin: pose of the joint's frame in the one before it.
        axis: in the joint's own frame.
        lower, upper: limits of the joint [rad, or m where it slides].
    """
    thin = cloud.fewer(_MOST_POINTS)
    points, slack = thin.points, thin.slack_m
    if slides:
        moved = points[None] + weight * np.array([lower, upper])[:, None, None] * axis
    else:
        along = (points @ axis)[:, None] * axis
        across, step = points - along, (upper - lower) / _STEPS
        slack += step**2 * float(np.linalg.norm(across, axis=1).max()) / 8.0
        angles = np.linspace(lower, upper, _STEPS + 1)[:, None, None]
        moved = along + np.cos(angles) * across + np.sin(angles) * np.cross(axis, across)
    placed = weight * origin + moved.reshape(-1, 3) @ rotation.T
    return _Cloud(points=_extreme(placed), slack_m=slack)


def _summed(one: _Cloud, two: _Cloud) -> _Cloud:
    """Every sum of a vector of one and a vector of the other."""
    if len(one.points) * len(two.points) > _MOST_POINTS:
        one, two = (each.fewer(_MOST_SUMMED) for each in (one, two))
    points = (one.points[:, None] + two.points[None]).reshape(-1, 3)
    return _Cloud(points=_extreme(points), slack_m=one.slack_m + two.slack_m)


def _extreme(points: Array) -> Array:
    """The points whose hull is that of all; all of them where they are in one plane."""
    hull = hull_of(points) if len(points) > 4 else None
    return points if hull is None else np.asarray(points[hull.vertices])


def _thinned(points: Array, most: float) -> tuple[Array, float]:
    """Fewer points, none of the old ones farther than ``most`` from one of the new [m], and how far
    the farthest is.
    """
    size = 2.0 * most / np.sqrt(3.0)
    cells = np.unique(np.round(points / size), axis=0) * size
    moved = float(np.linalg.norm(points - np.round(points / size) * size, axis=1).max())
    return _extreme(cells), moved


def directions_of(count: int = _DIRECTIONS) -> Array:
    """Unit vectors spread evenly (a spiral of golden angles), and the six along the axes, shape
    (count + 6, 3).
    """
    k = np.arange(count) + 0.5
    height, azimuth = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    flat = np.sqrt(1.0 - height**2)
    spiral = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), height])
    return np.vstack([spiral, np.eye(3), -np.eye(3)])


def enclosing_ball(points: Array, rounds: int = 200) -> tuple[Array, float]:
    """Centre and radius of a ball that holds all points, hardly larger than the smallest (Bădoiu
    and Clarkson) [m].
    """
    centre = points.mean(axis=0)
    for k in range(rounds):
        away = points - centre
        centre += away[np.argmax(np.einsum("ki,ki->k", away, away))] / (k + 2.0)
    return centre, float(np.linalg.norm(points - centre, axis=1).max())


_VERSION = "outer-sets/2"
_DEEPER = 2.0
"""How deep a centre of mass is assumed to get into the ground, in distances that it may be outside of
the trunk. Drawn robots whose legs are 20 to 85 % of their mass got less than one deep into a wall with
their bodies beside it and above it, in a search for the deepest."""
_CONTAINS_M = 1e-9
"""A set holds another one that is larger by no more than the rounding of a file [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OuterSets:
    """Outer sets of a robot, in the axes of its base.

    Arguments:
        normals: unit vectors, shape (D, 3).
        feet_m: for every leg the largest normals · (p − c), p the centre of its foot and c the
            robot's centre of mass, shape (N, D) [m].
        balls_m: centre and radius of a ball about p − c, shape (N, 4) [m].
        reach_m: largest distance of p from c, shape (N,) [m].
        apart_m: largest distance of the feet of two legs, shape (N, N) [m].
        com_m: largest normals · c in the base's frame, shape (D,) [m].
    """

    normals: Array
    feet_m: Array
    balls_m: Array
    reach_m: Array
    apart_m: Array
    com_m: Array

    def tilted(self, tilt_rad: float) -> OuterSets:
        """The sets of a body that is turned by R = exp([Θ]×), |Θ_i| ≤ tilt ≤ 1.4 rad, where limbs turn
        by I + [Θ]× (``robot.model``): rows stay, balls are larger.

        Let a ball be about x, θ = |Θ| ≤ √3 tilt, κ = ¾ tilt², and s = (1 − κ) x. Then R x − (I + [Θ]×) s
        is κ x along Θ, and across it (κ − 1 + cos θ) x + (κ − 1 + sin θ / θ) Θ × x; in all at most
        κ √(1 + tilt² / 3) |x|. About x itself it would be twice as much.
        """
        share, (centres, radii) = 0.75 * tilt_rad**2, np.split(self.balls_m, [3], axis=1)
        out = share * np.sqrt(1.0 + tilt_rad**2 / 3.0) * np.linalg.norm(centres, axis=1)
        return replace(self, balls_m=np.hstack([(1.0 - share) * centres, radii + out[:, None]]))

    def within(self, limbs: Sequence[Limb], radii_m: Array) -> bool:
        """Tell whether limbs may reach all that these sets hold, toes a radius, shape (N,) [m], away
        from the centres of feet.

        A turned body takes its balls farther from others by less than twice what they are apart.
        """
        for limb, bounds, ball, radius in zip(
            limbs, self.feet_m, self.balls_m, radii_m, strict=True
        ):
            beyond = 2.0 * float(np.linalg.norm(ball[:3] - limb.shoulder_m)) + ball[3] + radius
            if beyond > limb.reach_m + _CONTAINS_M:
                return False
            if limb.reach_rows is None:
                continue
            corners = Polytope(normals=self.normals, offsets_m=bounds).vertices
            most = (corners @ limb.reach_rows.normals.T).max(axis=0) + radius
            if np.any(most > limb.reach_rows.bounds_m + _CONTAINS_M):
                return False
        return True


@lru_cache(maxsize=16)
def outer_sets(robot: RobotModel) -> OuterSets:
    """The outer sets of a robot from its file, measured once and kept on disk.

    Raises InvalidInput for joints of unknown range.
    """
    tree = _Tree(robot)
    ends = [(leg.joint_names, leg.chain.tip_m) for leg in robot.legs]
    said = json.dumps([_VERSION, vars(tree), ends], default=np.ndarray.tolist)
    return kept(
        "workspaces/outer-",
        said.encode(),
        lambda: vars(tree.sets(robot.legs)),
        lambda arrays: OuterSets(**{each.name: arrays[each.name] for each in fields(OuterSets)}),
    )


def outward_m(robot: RobotModel) -> float:
    """Largest distance of the centre of mass from the trunk; where it stays within, less the least
    distance from the trunk's border [m].

    The trunk is the largest upright box in one of the shapes of the base's own links, the one that
    the centre stays deepest in; without a shape there is none, and the distance is infinite.
    """
    sets, axes = outer_sets(robot), np.vstack([np.eye(3), -np.eye(3)])
    spans = sets.com_m[[int(np.argmax(sets.normals @ axis)) for axis in axes]]
    return min((_beyond(box, -spans[3:], spans[:3]) for box in _boxes(robot)), default=np.inf)


def _beyond(box: Array, low: Array, high: Array) -> float:
    """Distance of the farthest point between two corners from a box; below 0 where all are inside
    [m].
    """
    beyond = np.maximum(high - box[1], box[0] - low)
    return float(beyond.max() if beyond.max() <= 0.0 else np.linalg.norm(np.maximum(beyond, 0.0)))


def contact_radii_m(robot: RobotModel) -> Array:
    """Distance from each foot's centre within which the foot may touch, shape (N,) [m]: the radius
    of a ball; where a person stated the contact, and of a sole, all of the foot's own shapes, since
    a sole touches with any part of it.
    """
    radii = []
    for i, leg in enumerate(robot.legs):
        radius = leg.radius_m if leg.sole is None else leg.sole.radius_m
        for shape in solid_shapes(robot.shapes) if leg.contact is not None or leg.sole else ():
            mount = robot.mounts[shape.link]
            last = mount.leg == i and mount.joint == len(leg.joints) - 1
            its = shape.link == leg.foot if leg.sole is None else last
            corners = link_points(shape) if its else None
            if corners is not None:
                away = mount.placed(corners) - leg.chain.tip_m
                radius = max(radius, float(np.linalg.norm(away, axis=1).max()))
        radii.append(radius)
    return np.array(radii)


class _Tree:
    """All joints of a robot's file below its base, with what they carry."""

    def __init__(self, robot: RobotModel) -> None:
        model = robot.built
        self.base = base_joint(model)
        self.mass_kg = float(sum(inertia.mass for inertia in model.inertias))
        self.children = {j: [int(c) for c in model.children[j]] for j in range(model.njoints)}
        self.masses = [float(inertia.mass) for inertia in model.inertias]
        self.levers = [np.array(inertia.lever) for inertia in model.inertias]
        self.places = [
            (np.array(at.rotation), np.array(at.translation)) for at in model.jointPlacements
        ]
        if any(mass > 0.0 for mass in self.masses[: self.base]):
            raise InvalidInput(f"robot {robot.name}: expected no mass that floats beside its base")
        self.names = [str(name) for name in model.names]
        self.joints: dict[int, tuple[Array, bool, float, float]] = {}
        for j, (axis, slides) in axes_of(model).items():
            joint = model.joints[j]
            if joint.nv != 1:
                raise InvalidInput(
                    f"robot {robot.name}: joint {model.names[j]}: expected one angle, it has more"
                )
            low, high = (
                float(limits[joint.idx_q])
                for limits in (model.lowerPositionLimit, model.upperPositionLimit)
            )
            if slides and not low < high:
                raise InvalidInput(
                    f"robot {robot.name}: joint {model.names[j]}: expected the range in which it "
                    "slides, got none"
                )
            if not slides and (joint.nq == 2 or not low < high or high - low > FULL_TURN):
                low, high = -np.pi, np.pi
            self.joints[j] = (axis, slides, low, high)

    def sets(self, legs: tuple[Leg, ...]) -> OuterSets:
        """The outer sets for the feet of these legs."""
        normals = directions_of()
        firsts, base = self.children[self.base], self.base
        tips = {self.names.index(leg.joint_names[-1]): leg.chain.tip_m for leg in legs}
        others = {first: self._carried(first, {}) for first in firsts}
        own = -self.masses[base] / self.mass_kg * self.levers[base]
        feet, balls, reach, alone = [], [], [], []
        for leg in legs:
            tip = self.names.index(leg.joint_names[-1])
            first = next(each for each in firsts if tip in self._below(each))
            foot = self._carried(first, {tip: tips[tip]})
            rest = [others[each] for each in firsts if each != first]
            feet.append(
                foot.supports(normals)
                + sum(each.supports(normals) for each in rest)
                + normals @ own
            )
            centre, radius = own, 0.0
            for each in rest:
                middle, size = each.ball
                centre, radius = centre + middle, radius + size
            far = np.linalg.norm(foot.points + centre, axis=1).max() + foot.slack_m + radius
            balls.append([*(foot.ball[0] + centre), foot.ball[1] + radius])
            reach.append(float(far))
            alone.append(foot_cloud(leg).fewer(_MOST_POINTS))
        apart = np.zeros((len(legs), len(legs)))
        for i, k in combinations(range(len(legs)), 2):
            apart[i, k] = apart[k, i] = alone[i].farthest_from(alone[k])
        com = -normals @ own + sum(each.supports(-normals) for each in others.values())
        return OuterSets(
            normals=normals,
            feet_m=np.array(feet),
            balls_m=np.array(balls),
            reach_m=np.array(reach),
            apart_m=apart,
            com_m=np.asarray(com),
        )

    def _below(self, joint: int) -> set[int]:
        """The joint and all that it carries."""
        return {joint}.union(*(self._below(child) for child in self.children[joint]))

    def _carried(self, joint: int, tips: Mapping[int, Array]) -> _Cloud:
        """The set of all that a joint carries, in the frame before the joint.

        Arguments:
            tips: the end of a chain in its last joint's frame, by joint, whose weight is 1.
        """
        below = self._below(joint)
        weight = len(below.intersection(tips)) - sum(self.masses[j] for j in below) / self.mass_kg
        own = tips.get(joint, np.zeros(3)) - self.masses[joint] / self.mass_kg * self.levers[joint]
        parts = [self._carried(child, tips) for child in self.children[joint]]
        outward = reduce(_summed, parts, _Cloud(points=own[None], slack_m=_ROUNDING_M))
        (rotation, origin), (axis, slides, low, high) = self.places[joint], self.joints[joint]
        return turned(outward, weight, rotation, origin, axis, slides, low, high)


def _boxes(robot: RobotModel) -> list[Array]:
    """Largest upright boxes in the shapes of the base's own links, low and high corner, shape (2, 3)
    [m] each.
    """
    model = robot.built
    base = base_joint(model)
    rigid = {frame.name for frame in model.frames if frame.parentJoint == base}
    return [
        box
        for shape in solid_shapes(robot.shapes)
        if shape.link in rigid and (box := _box(shape, robot)) is not None
    ]


def _box(shape: Shape, robot: RobotModel) -> Array | None:
    """Largest upright box in a shape of the base, None in one whose solid is not known: a mesh that
    its hull is much larger than.
    """
    points = link_points(shape)
    if points is None or shape.parts_m:
        return None
    if (hull := hull_of(robot.mounts[shape.link].placed(points))) is None:
        return None
    faces = np.unique(hull.equations.round(12), axis=0)
    return Polytope(normals=faces[:, :3], offsets_m=-faces[:, 3]).largest_box()


@dataclass(frozen=True, kw_only=True)
class Extent:
    """Numbers that hold a robot in any posture, tilted and turned in any way.

    Arguments:
        reach_m: largest distance of a contact from the centre of mass [m].
        apart_m: largest distance of contacts of two feet [m].
        sole_m: distance from the centre of a foot's place within which the foot may touch; 0 of a
            ball, which touches where it is placed [m].
        outward_m: largest distance of the centre of mass from the trunk; where it stays within,
            less the least distance from the trunk's border; inf where no trunk is known [m].
    """

    reach_m: float
    apart_m: float
    sole_m: float
    outward_m: float

    @property
    def depth_m(self) -> float:
        """How far below the ground under it the centre of mass is assumed to be at most, 0 of one that
        never leaves the trunk and inf where no trunk is known [m].
        """
        return _DEEPER * max(self.outward_m, 0.0)

    @property
    def assumes(self) -> bool:
        """Tell whether ``depth_m`` is more than what follows from the trunk."""
        return 0.0 < self.outward_m < np.inf

    @classmethod
    def of(cls, robot: Robot) -> Extent:
        """The extent of a robot; that of one without legs of its own as its limbs' balls have it, its
        centre of mass at the body's origin.

        Raises InvalidInput for a robot from a file with joints of unknown range.
        """
        if robot.own:
            model = robot.own_model()
            model.check_known()
            sets, radii = outer_sets(model), contact_radii_m(model)
            stated = [leg.contact is not None or leg.sole is not None for leg in model.legs]
            return cls(
                reach_m=float((sets.reach_m + radii).max()),
                apart_m=float((sets.apart_m + radii[:, None] + radii).max()),
                sole_m=float(np.where(stated, radii, 0.0).max()),
                outward_m=outward_m(model),
            )
        shoulders = np.array([limb.shoulder_m for limb in robot.limbs])
        soles = [
            0.0 if limb.sole_m is None else float(np.linalg.norm(limb.sole_m, axis=1).max())
            for limb in robot.limbs
        ]
        reach = np.array([limb.reach_m for limb in robot.limbs]) + soles
        between = np.linalg.norm(shoulders[:, None] - shoulders, axis=2) + reach[:, None] + reach
        try:
            boxes, origin = _boxes(robot.legs), np.asarray(robot.origin_m)
        except InvalidInput:  # its legs are not known, nor is its trunk
            boxes, origin = [], np.zeros(3)
        return cls(
            reach_m=float((np.linalg.norm(shoulders, axis=1) + reach).max()),
            apart_m=float((between * (1.0 - np.eye(len(shoulders)))).max()),
            sole_m=max(soles),
            outward_m=min((_beyond(box, origin, origin) for box in boxes), default=np.inf),
        )
