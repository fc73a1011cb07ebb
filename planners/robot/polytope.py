"""Convex polytopes in space, as half-spaces: what is in them, what fits into them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import LinearConstraint, linprog, minimize
from scipy.spatial import HalfspaceIntersection, QhullError

from ..errors import InvalidInput
from ..files.arrays import Array, frozen


@dataclass(frozen=True, kw_only=True, eq=False)
class Polytope:
    """{p : normals p ≤ offsets}, bounded and with an inside; normals: unit, shape (F, 3); offsets_m: shape (F,) [m]."""

    normals: Array
    offsets_m: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "normals", frozen(self.normals, (None, 3), "normals"))
        object.__setattr__(self, "offsets_m", frozen(self.offsets_m, (len(self.normals),), "offsets_m"))

    def contains(self, points: Array) -> np.ndarray:
        """Which points, shape (K, 3) [m], are inside, shape (K,)."""
        return np.asarray(np.all(points @ self.normals.T <= self.offsets_m, axis=1))

    @cached_property
    def largest_ball(self) -> Array:
        """Centre and radius of the largest ball inside (Chebyshev), shape (4,) [m]. Raises InvalidInput for none."""
        rows = np.column_stack([self.normals, np.ones(len(self.normals))])
        found = linprog([0.0, 0.0, 0.0, -1.0], rows, self.offsets_m, bounds=[(None, None)] * 3 + [(0.0, None)])
        if found.status != 0 or found.x is None or not found.x[3] > 0.0:
            raise InvalidInput("polytope: expected one that is bounded and has an inside")
        return np.asarray(found.x)

    @cached_property
    def _dual(self) -> HalfspaceIntersection:
        try:
            return HalfspaceIntersection(np.column_stack([self.normals, -self.offsets_m]), self.largest_ball[:3])
        except QhullError:
            raise InvalidInput("polytope: expected one that is bounded and has an inside") from None

    @property
    def vertices(self) -> Array:
        """Its corners, shape (V, 3) [m]."""
        return np.asarray(self._dual.intersections)

    def lean(self) -> Polytope:
        """The same set without the faces that the others imply."""
        keep = np.unique(np.concatenate([np.asarray(facet) for facet in self._dual.dual_facets]))
        return Polytope(normals=self.normals[keep], offsets_m=self.offsets_m[keep])

    def cut(self, normals: Array, offsets: Array) -> Polytope:
        """The part of it in some more half-spaces."""
        return Polytope(normals=np.vstack([self.normals, normals]), offsets_m=np.append(self.offsets_m, offsets))

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Points spread evenly over it, shape (count, 3) [m]."""
        corners = self.vertices
        low, high = corners.min(axis=0), corners.max(axis=0)
        found, kept = list[Array](), 0
        while kept < count:
            points = rng.uniform(low, high, (3 * count, 3))
            found.append(points[self.contains(points)])
            kept += len(found[-1])
        return np.vstack(found)[:count]

    def largest_box(self) -> Array:
        """Low and high corner of the largest upright box inside, shape (2, 3) [m].

        The corner that a face n looks at is low or high by the signs of n: max Σ log(high − low), a concave programme.
        """
        centre, radius = np.split(self.largest_ball, [3])
        start = np.concatenate([centre - 0.5 * radius, centre + 0.5 * radius])
        rows = np.column_stack([np.minimum(self.normals, 0.0), np.maximum(self.normals, 0.0)])

        def loss(x: Array) -> float:
            return -float(np.sum(np.log(np.maximum(x[3:] - x[:3], 1e-9))))

        def slope(x: Array) -> Array:
            each = 1.0 / np.maximum(x[3:] - x[:3], 1e-9)
            return np.concatenate([each, -each])

        kept = LinearConstraint(rows, -np.inf, self.offsets_m)
        found = minimize(loss, start, jac=slope, method="SLSQP", constraints=kept, options={"maxiter": 100}).x
        best = found if np.all(found[3:] > found[:3]) else start
        middle = np.tile(0.5 * (best[:3] + best[3:]), 2)
        if np.any(rows @ middle > self.offsets_m):
            best, middle = start, np.tile(centre, 2)
        over, room = rows @ (best - middle), self.offsets_m - rows @ middle  # shrunk until every corner is inside
        share = float(np.min(room[over > room] / over[over > room], initial=1.0))
        return np.asarray((middle + share * (best - middle)).reshape(2, 3))
