"""Convex polytopes in space, as half-spaces: what is in them, what fits into them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, read_only

if TYPE_CHECKING:
    from scipy.spatial import HalfspaceIntersection


@dataclass(frozen=True, kw_only=True, eq=False)
class Polytope:
    """{p : normals p ≤ offsets}, bounded and with an inside.

    Arguments:
        normals: unit, shape (F, 3).
        offsets_m: shape (F,) [m].
    """

    normals: Array
    offsets_m: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "normals", read_only(self.normals, (None, 3), "normals"))
        object.__setattr__(
            self, "offsets_m", read_only(self.offsets_m, (len(self.normals),), "offsets_m")
        )

    def contains(self, points: Array) -> np.ndarray:
        """Tell which points, shape (K, 3) [m], are inside, shape (K,)."""
        return np.asarray(np.all(points @ self.normals.T <= self.offsets_m, axis=1))

    @cached_property
    def largest_ball(self) -> Array:
        """Centre and radius of the largest ball inside (Chebyshev), shape (4,) [m].

        Raises InvalidInput for none.
        """
        import highspy  # as SciPy's linprog has it, which is slow to import

        solver: Any = highspy.Highs()  # type: ignore[no-untyped-call]
        infinity = highspy.kHighsInf
        solver.setOptionValue("output_flag", False)
        solver.addVars(4, np.array([-infinity] * 3 + [0.0]), np.full(4, infinity))
        solver.changeColCost(3, -1.0)
        for row, offset in zip(
            np.column_stack([self.normals, np.ones(len(self.normals))]), self.offsets_m, strict=True
        ):
            solver.addRow(-infinity, offset, 4, np.arange(4), row)
        solver.run()
        ball = np.array(solver.getSolution().col_value)
        if solver.getModelStatus() != highspy.HighsModelStatus.kOptimal or not ball[3] > 0.0:
            raise InvalidInput("polytope: expected one that is bounded and has an inside")
        return ball

    @cached_property
    def _dual(self) -> HalfspaceIntersection:
        from scipy.spatial import HalfspaceIntersection, QhullError  # slow to import

        try:
            return HalfspaceIntersection(
                np.column_stack([self.normals, -self.offsets_m]), self.largest_ball[:3]
            )
        except QhullError:
            raise InvalidInput("polytope: expected one that is bounded and has an inside") from None

    @property
    def vertices(self) -> Array:
        """Corners, shape (V, 3) [m]."""
        return np.asarray(self._dual.intersections)

    def lean(self) -> Polytope:
        """Polytope without the faces that the others imply."""
        keep = np.unique(np.concatenate([np.asarray(facet) for facet in self._dual.dual_facets]))
        return Polytope(normals=self.normals[keep], offsets_m=self.offsets_m[keep])

    def cut(self, normals: Array, offsets: Array) -> Polytope:
        """The part of it in some more half-spaces."""
        return Polytope(
            normals=np.vstack([self.normals, normals]), offsets_m=np.append(self.offsets_m, offsets)
        )

    def sample(self, count: int, rng: np.random.Generator) -> Array:
        """Points spread evenly over it, shape (count, 3) [m]."""
        corners = self.vertices
        low, high = corners.min(axis=0), corners.max(axis=0)
        result, size = list[Array](), 0
        while size < count:
            points = rng.uniform(low, high, (3 * count, 3))
            result.append(points[self.contains(points)])
            size += len(result[-1])
        return np.vstack(result)[:count]

    def largest_box(self) -> Array:
        """Low and high corner of the largest upright box inside, shape (2, 3) [m]: max Σ log(high −
        low).
        """
        centre, radius = np.split(self.largest_ball, [3])
        sides = np.hstack([-np.eye(3), np.eye(3)])
        return self._box(
            sides, np.zeros(3), np.concatenate([centre - 0.5 * radius, centre + 0.5 * radius])
        )

    def box_about(self, point: Array, room_m: float) -> Array:
        """Low and high corner of the upright box inside that has most room about a point, on all
        its sides, shape (2, 3) [m]: max Σ log(high − point) + log(point − low).

        Raises InvalidInput where a ball of ``room_m`` about the point is not inside.
        """
        room = float(np.min(self.offsets_m - self.normals @ point))
        if not room >= room_m > 0.0:
            raise InvalidInput(
                f"polytope: expected {room_m:.3g} m about a point to be inside, got {room:.3g}"
            )
        sides, middle = np.diag([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]), np.tile(point, 2)
        return self._box(sides, sides @ middle, middle + 0.5 * room * np.repeat([-1.0, 1.0], 3))

    def _box(self, sides: Array, shifts: Array, start: Array) -> Array:
        """The box inside for which Σ log(sides x − shifts) of its corners x = (low, high) is
        largest, from one that is inside.

        The corner that a face n looks at is low or high by the signs of n: a concave programme.
        """
        from scipy.optimize import LinearConstraint, minimize  # slow to import

        rows = np.column_stack([np.minimum(self.normals, 0.0), np.maximum(self.normals, 0.0)])

        def loss(x: Array) -> float:
            return -float(np.sum(np.log(np.maximum(sides @ x - shifts, 1e-9))))

        def slope(x: Array) -> Array:
            return np.asarray(-sides.T @ (1.0 / np.maximum(sides @ x - shifts, 1e-9)))

        constraint = LinearConstraint(rows, -np.inf, self.offsets_m)
        result = minimize(
            loss, start, jac=slope, method="SLSQP", constraints=constraint, options={"maxiter": 100}
        ).x
        best = result if loss(result) < loss(start) else start
        over, room = (
            rows @ (best - start),
            self.offsets_m - rows @ start,
        )  # drawn back until every corner is inside
        share = float(np.min(room[over > room] / over[over > room], initial=1.0))
        return np.asarray((start + share * (best - start)).reshape(2, 3))
