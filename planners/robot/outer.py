"""A convex set that holds everything a foot can reach, with a proof: what proofs of *infeasible*
may stand on.

The set is built from the foot inward, a joint at a time. Let what lies outward of joint i be within
conv(V) ⊕ B(ε), V points of the joint's frame, B(ε) a ball. Turning by q moves a point v along a
circle of radius r(v), its distance from the axis. Between two angles that are δ apart, a point of
the circle is within δ²·r/8 of the chord (a function's distance from its linear interpolation is at
most δ²/8 times its largest second derivative, here r); the same holds for points of conv(V), whose
distance from the axis is at most max r(v), as a distance from a line is convex. The chord is
between the two turned points. So what lies outward of joint i − 1 is within

    conv{Z(q_j) v} ⊕ B(ε + δ² max r(v) / 8),   q_j a grid of steps δ over the joint's whole range.

A joint that slides moves along the chord itself and adds nothing. Only the extreme points of each
hull are kept, so the cost grows with the number of joints, not with its exponent. Points may be
thinned by rounding, which adds how far they moved to ε. At the base, half-spaces d·p ≤ max d·v + ε
in any directions d hold everything that is reachable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..files.arrays import Array
from .leg import Leg

STEPS = 48
"""Steps of a joint's whole range."""
DIRECTIONS = 128
MOST_POINTS = 2500
"""Most points of a hull that is turned; more are thinned."""
MOST_SUMMED = 200
"""Most points of a hull that is added to another one."""
COARSEST = 0.005
"""Share of a hull's size: how far the finest thinning moves a point at most."""
ROUNDING_M = 1e-9
"""Added for the arithmetic."""


def foot_cloud(leg: Leg, steps: int = STEPS) -> Cloud:
    """All places of a leg's foot in the base's frame.

    Arguments:
        steps: of every joint's range; the finer, the smaller the slack.
    """
    chain, cloud = leg.chain, Cloud(points=leg.chain.tip_m[None], slack_m=ROUNDING_M)
    limits = np.column_stack([leg.lower_rad, leg.upper_rad])
    for i in reversed(range(chain.joints)):
        place, axis = (chain.rotations[i], chain.origins[i]), chain.axes[i]
        cloud = turned(cloud, 1.0, *place, axis, bool(chain.slides[i]), *limits[i], steps=steps)
    return cloud


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
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

    @property
    def ball(self) -> tuple[Array, float]:
        """Centre and radius of a ball that holds it [m]."""
        centre, radius = enclosing_ball(self.points)
        return centre, radius + self.slack_m

    def fewer(self, most: int) -> Cloud:
        """A cloud that holds this one, of so many points or a few more."""
        points, slack, share = self.points, 0.0, COARSEST
        size = max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-6)
        while len(points) > most and share < 1.0:
            points, slack = _thinned(self.points, 0.5 * share * size)
            share *= 1.25
        return Cloud(points=points, slack_m=self.slack_m + slack)

    def farthest_from(self, other: Cloud) -> float:
        """Largest distance of a point of this one from one of another [m]."""
        from scipy.spatial.distance import cdist  # slow to import

        one, two = self.fewer(MOST_POINTS), other.fewer(MOST_POINTS)
        return float(cdist(one.points, two.points).max()) + one.slack_m + two.slack_m


def turned(
    cloud: Cloud,
    weight: float,
    rotation: Array,
    origin: Array,
    axis: Array,
    slides: bool,
    lower: float,
    upper: float,
    *,
    steps: int,
    most: int = MOST_POINTS,
) -> Cloud:
    """Carry what lies outward of a joint over the joint's whole range, into the frame before it.

    Arguments:
        weight: of what lies outward: 1 of a point, 0 of the difference of two.
        rotation, origin: pose of the joint's frame in the one before it.
        axis: in the joint's own frame.
        lower, upper: limits of the joint [rad, or m where it slides].
        steps: of the range.
        most: points of the cloud; more are thinned.
    """
    thin = cloud.fewer(most)
    points, slack = thin.points, thin.slack_m
    if slides:
        moved = points[None] + weight * np.array([lower, upper])[:, None, None] * axis
    else:
        along = (points @ axis)[:, None] * axis
        across, step = points - along, (upper - lower) / steps
        slack += step**2 * float(np.linalg.norm(across, axis=1).max()) / 8.0
        angles = np.linspace(lower, upper, steps + 1)[:, None, None]
        moved = along + np.cos(angles) * across + np.sin(angles) * np.cross(axis, across)
    placed = weight * origin + moved.reshape(-1, 3) @ rotation.T
    return Cloud(points=_extreme(placed), slack_m=slack)


def summed(one: Cloud, two: Cloud) -> Cloud:
    """Every sum of a vector of one and a vector of the other."""
    if len(one.points) * len(two.points) > MOST_POINTS:
        one, two = (each.fewer(MOST_SUMMED) for each in (one, two))
    points = (one.points[:, None] + two.points[None]).reshape(-1, 3)
    return Cloud(points=_extreme(points), slack_m=one.slack_m + two.slack_m)


def _extreme(points: Array) -> Array:
    """The points whose hull is that of all; all of them where they are in one plane."""
    if len(points) < 5:
        return points
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points


def _thinned(points: Array, most: float) -> tuple[Array, float]:
    """Fewer points, none of the old ones farther than ``most`` from one of the new [m], and how far
    the farthest is.
    """
    size = 2.0 * most / np.sqrt(3.0)
    cells = np.unique(np.round(points / size), axis=0) * size
    extreme = _extreme(cells)
    moved = float(np.linalg.norm(points - np.round(points / size) * size, axis=1).max())
    return extreme, moved


def directions_of(count: int = DIRECTIONS) -> Array:
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
        far = points[np.argmax(np.einsum("ki,ki->k", points - centre, points - centre))]
        centre = centre + (far - centre) / (k + 2.0)
    return centre, float(np.linalg.norm(points - centre, axis=1).max())
