"""Convex hulls of meshes: all that is known of a mesh as a body, and what travels in files in its
place.

A hull is of all corners of its mesh, to a micrometre; a mesh that is much smaller than its hull has
convex parts beside it. They are read once, when a robot's own files are read; a robot out of a
plan's file has those that were written, and looks for no mesh.

A mesh is cut by planes along two of its three axes, and each cell has the hull of the surface in it.
All of the mesh is in these hulls: the surface is, and from a point inside, a line along the third
axis leaves its cell nowhere, and so meets the surface on both sides of the point within the cell.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, read_only, unpacked
from ..files.codec import embedded, extracted
from ..files.documents import read_bytes, shown
from ..terrain.mesh_formats.numbers import MOST_BYTES
from ..terrain.patch import hull_of
from .meshes import Shape, kept, points_on, read_mesh, solid_shapes

if TYPE_CHECKING:
    from scipy.spatial import HalfspaceIntersection


def inscribed_ball(normals: Array, offsets_m: Array, radii_m: tuple[float, float]) -> Array | None:
    """Centre and radius of a largest ball in half-spaces normals · p ≤ offsets (Chebyshev), shape
    (4,) [m]; None where there is none.

    Arguments:
        radii_m: least and largest radius that is looked for.
    """
    import highspy  # as SciPy's linprog has it, which is slow to import

    solver: Any = highspy.Highs()  # type: ignore[no-untyped-call]
    solver.setOptionValue("output_flag", False)
    least, most = radii_m
    solver.addVars(4, np.array([-np.inf] * 3 + [least]), np.array([np.inf] * 3 + [most]))
    solver.changeColCost(3, -1.0)
    for row, offset in zip(
        np.column_stack([normals, np.ones(len(normals))]), offsets_m, strict=True
    ):
        solver.addRow(-np.inf, offset, 4, np.arange(4), row)
    solver.run()
    ball = np.array(solver.getSolution().col_value)
    found = solver.getModelStatus() == highspy.HighsModelStatus.kOptimal and ball[3] > 0.0
    return ball if found else None


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
        """Centre and radius of the largest ball inside, shape (4,) [m].

        Raises InvalidInput for none.
        """
        if (ball := inscribed_ball(self.normals, self.offsets_m, (0.0, np.inf))) is None:
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
        """Points spread evenly over it, shape (count, 3) [m]; of a sliver, that a box about it hardly
        meets, means of its corners.
        """
        corners = self.vertices
        low, high = corners.min(axis=0), corners.max(axis=0)
        result, size = list[Array](), 0
        for _ in range(_ROUNDS):
            points = rng.uniform(low, high, (3 * count, 3))
            result.append(points[self.contains(points)])
            size += len(result[-1])
            if size >= count:
                break
        else:
            result = [rng.dirichlet(np.ones(len(corners)), count) @ corners]
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


_ROUNDS = 1000
"""Draws from the box about a polytope before it counts as a sliver."""
_VERSION = "parts/1"
"""Part of every digest of kept parts: a change of method changes it, and older ones are no longer
found."""
_DIGITS = 6
"""Decimals of a corner [m]."""
ROOM_M = 3e-5
"""Parts are as near to their hull: corners are rounded, and what is flat is a little thick [m]."""
_MOST_CORNERS = 1_000_000
"""Corners of all hulls in one file."""


def hull_corners(points_m: Array) -> Array | None:
    """Corners of the convex hull of points, shape (V, 3) to (K, 3) [m]; None where they span no
    volume.
    """
    points = np.unique(np.round(np.asarray(points_m, dtype=np.float64), _DIGITS) + 0.0, axis=0)
    if len(points) < 4 or not np.isfinite(points).all():
        return None
    hull = hull_of(points)
    return None if hull is None else np.asarray(points[np.sort(hull.vertices)])


def with_hulls(shapes: Sequence[Shape]) -> tuple[tuple[Shape, ...], list[tuple[str, str]]]:
    """The shapes, every mesh that is a link's body with the corners of its hull; and the links
    whose mesh is there but has no hull, with why.
    """
    bodies, known = (
        {id(shape) for shape in solid_shapes(shapes)},
        dict[tuple[str, bytes], tuple[Array, tuple[Array, ...]] | str](),
    )
    shapes_with_hulls, doubts = list[Shape](), dict[tuple[str, str], None]()
    for shape in shapes:
        if shape.kind == "mesh" and shape.mesh is not None and id(shape) in bodies:
            key = str(shape.mesh), shape.size_m.tobytes()
            if key not in known:
                known[key] = _read_hull(shape.mesh, shape.size_m)
            if isinstance(hull := known[key], str):
                doubts[
                    f"link {shape.link}", f"has no body, mesh {shown(shape.mesh.name)}: {hull}"
                ] = None
            else:
                shape = replace(shape, corners_m=hull[0], parts_m=hull[1])
        shapes_with_hulls.append(shape)
    return tuple(shapes_with_hulls), list(doubts)


def with_same_hulls(shapes: Sequence[Shape], read: Sequence[Shape]) -> tuple[Shape, ...]:
    """The shapes of a URDF that was rewritten, its links' bodies with the hulls of the same meshes
    as they were read.

    A mesh is often both a link's body and what the link looks like; only the body has a hull.
    """
    hulls = {
        _place(shape): (shape.corners_m, shape.parts_m)
        for shape in read
        if shape.corners_m is not None
    }
    bodies, shapes_with_hulls = {id(shape) for shape in solid_shapes(shapes)}, list[Shape]()
    for shape in shapes:
        corners, parts = hulls.get(_place(shape), (None, ()))
        shapes_with_hulls.append(
            replace(shape, corners_m=corners, parts_m=parts) if id(shape) in bodies else shape
        )
    return tuple(shapes_with_hulls)


def _place(shape: Shape) -> tuple[str, str, bytes]:
    """The key of a mesh's hull: its link, its file, and how it is scaled and placed."""
    numbers = np.concatenate([shape.size_m, shape.origin_m, shape.rotation.ravel()])
    return shape.link, str(shape.mesh), numbers.tobytes()


def _read_hull(path: Path, scale: Array) -> tuple[Array, tuple[Array, ...]] | str:
    """The corners of a mesh's hull and of its parts, or why it has none."""
    try:
        mesh = read_mesh(path, scale)
        key = f"{_VERSION}\0{scale.tolist()}\0".encode() + read_bytes(path, MOST_BYTES)
    except InvalidInput as error:
        return str(error).removeprefix(f"{path}: ")
    corners = hull_corners(mesh.vertices_m)
    if corners is None:
        return "expected corners around a volume, got a flat one"

    def made() -> dict[str, Any]:
        parts = [hull_corners(part) for part in convex_parts(mesh.vertices_m, mesh.faces)]
        whole = [part for part in parts if part is not None]
        return (
            {str(k): part for k, part in enumerate(whole)} if len(whole) == len(parts) else {}
        )  # all, or none

    return corners, kept("meshes/", key, made, lambda arrays: _parts_of(arrays, corners))


def _parts_of(arrays: Mapping[str, Array], corners: Array) -> tuple[Array, ...]:
    """Parts of a hull out of arrays by number, none where they do not fill the hull, as of a sheet.

    Raises InvalidInput and KeyError for what is no array of points.
    """
    parts = tuple(read_only(arrays[str(k)], (None, 3), f"part {k}") for k in range(len(arrays)))
    return parts if parts and _fills(parts, corners) else ()


def hulls_to_text(shapes: Sequence[Shape]) -> str:
    """The hulls of a robot's meshes as text, by the number of the shape, and their parts as
    NUMBER_PART; empty where it has none.
    """
    hulls = dict[str, Array]()
    for i, shape in enumerate(shapes):
        if shape.corners_m is not None:
            hulls[str(i)] = shape.corners_m
            hulls |= {f"{i}_{k}": part for k, part in enumerate(shape.parts_m)}
    return embedded(hulls) if hulls else ""


def hulls_of_text(text: str) -> dict[int, list[Array]]:
    """The hulls that ``hulls_to_text`` wrote, by the number of the shape, each with its parts after
    it. Raises InvalidInput for what is none.
    """
    if not text:
        return {}
    result = dict[int, dict[int, Array]]()
    for name, corners in unpacked(extracted(text, "model: hulls"), "model: hulls").items():
        shape, line, part = name.partition("_")
        if not shape.isdecimal() or (line and not part.isdecimal()):
            raise InvalidInput(f"model: hulls: expected numbers of shapes, got {name:.40}")
        points = read_only(corners, (None, 3), f"model: hulls: {name}")
        result.setdefault(int(shape), {})[int(part) if part else -1] = points
    if sum(len(corners) for hulls in result.values() for corners in hulls.values()) > _MOST_CORNERS:
        raise InvalidInput(f"model: hulls: expected {_MOST_CORNERS} corners or fewer, got more")
    for number, parts in result.items():
        if -1 not in parts:
            raise InvalidInput(
                f"model: hulls: expected the hull of shape {number} beside its parts, got parts "
                "alone"
            )
    return {shape: [hulls[k] for k in sorted(hulls)] for shape, hulls in result.items()}


def with_known_hulls(
    shapes: Sequence[Shape], hulls: Mapping[int, Sequence[Array]]
) -> tuple[Shape, ...]:
    """The shapes with hulls and their parts, by their number.

    Raises InvalidInput for a hull of what is no mesh, or is flat, and for parts that are not inside
    their hull.
    """
    for number, (corners, *parts) in hulls.items():
        if number >= len(shapes) or shapes[number].kind != "mesh":
            raise InvalidInput(f"model: hulls: expected hulls of meshes, got one of shape {number}")
        for each in (corners, *parts):
            if (known_corners := hull_corners(each)) is None or not np.array_equal(
                known_corners, each
            ):
                raise InvalidInput(
                    f"model: hulls: expected the corners of a convex hull for shape {number}, got "
                    "points that are not the corners of their own hull"
                )
        if parts and not _fills(parts, corners):
            raise InvalidInput(
                f"model: hulls: expected parts whose hull is that of shape {number}, got other parts"
            )
    return tuple(
        replace(shape, corners_m=hulls[i][0], parts_m=tuple(hulls[i][1:])) if i in hulls else shape
        for i, shape in enumerate(shapes)
    )


def _fills(parts: Sequence[Array], corners: Array) -> bool:
    """Tell whether parts are inside a hull and have all of its corners, as nearly as they are
    known.
    """
    from scipy.spatial import ConvexHull

    def outside(points: Array, of: Array) -> Array:
        """Distance of points outside a hull, shape (P,) [m]."""
        faces = ConvexHull(of).equations
        return np.asarray((points @ faces[:, :3].T + faces[:, 3]).max(axis=1))

    if outside(np.concatenate(parts), corners).max() > ROOM_M:
        return False
    return bool(np.min([outside(corners, part) for part in parts], axis=0).max() <= ROOM_M)


_FEW_PARTS, MOST_PARTS = 4, 16
"""As many say which two axes are cut along, and as many there are."""
_PLACES, _FINE = 5, 16
"""So many cuts of a cell are tried along each axis; by points on the surface, so many on the
longest side."""
_THIN_M, _AROUND = 1e-5, np.concatenate([np.eye(3), -np.eye(3)])
"""Half of what a flat piece is thick [m]."""
_WORTH, _EACH = 0.25, 0.01
"""Share of the hull's volume that the parts have to save together, and that each cut has to."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cell:
    """A part of the surface between cutting planes.

    Arguments:
        sides: (axis, place, sign) of the planes that it is behind.
        points: on the surface in it, shape (P, 3) [m].
        volume: volume of their hull [m³].
        along: the cell in two along an axis, as it was found.
    """

    sides: tuple[tuple[int, float, float], ...]
    points: Array
    volume: float
    along: dict[int, tuple[_Cell, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, points: Array, sides: tuple[tuple[int, float, float], ...] = ()) -> _Cell:
        corners, volume = _hull(points)
        return cls(sides=sides, points=points if len(corners) else corners, volume=volume)

    def cut(self, axes: Sequence[int]) -> tuple[_Cell, ...]:
        """The cell in two, by the plane along these axes that saves the most; alone where it spans
        no volume.
        """
        for axis in {*axes} - {*self.along} if self.volume > 0.0 else ():
            self.along[axis] = min(self._halves(axis), key=_volume)
        return min((self.along.get(axis, (self,)) for axis in axes), key=_volume)

    def _halves(self, axis: int) -> Iterator[tuple[_Cell, ...]]:
        """The cell in two, by planes along an axis; the points of a half are those up to the plane."""
        along = self.points[:, axis]
        for place in np.linspace(along.min(), along.max(), _PLACES + 2)[1:-1].tolist():
            yield (
                _Cell.of(self.points[along <= place], (*self.sides, (axis, place, 1.0))),
                _Cell.of(self.points[along >= place], (*self.sides, (axis, place, -1.0))),
            )


def convex_parts(vertices_m: Array, faces: NDArray[np.int_]) -> tuple[Array, ...]:
    """Corners of convex parts that hold a mesh, shape (K, 3) [m] each; none where its hull is
    nearly as small.

    Arguments:
        vertices_m: shape (V, 3) [m].
        faces: corners by index, shape (F, 3).
    """
    triangles = np.asarray(vertices_m, dtype=np.float64)[faces]
    volume = _hull(triangles.reshape(-1, 3))[1]
    if volume <= 0.0:
        return ()
    apart_m = float(np.ptp(triangles.reshape(-1, 3), axis=0).max()) / _FINE
    whole = _Cell.of(points_on(triangles, apart_m))
    if whole.volume - _volume(whole.cut(range(3))) < _EACH * whole.volume:
        return ()
    best = min(combinations(range(3), 2), key=lambda axes: _volume(_parts(whole, axes, _FEW_PARTS)))
    cells = _parts(whole, best, MOST_PARTS)
    parts, left = list[Array](), 0.0
    for cell in cells:
        inside = triangles
        for side in cell.sides:
            inside = _behind(inside, *side)
        points = inside.reshape(-1, 3)
        corners, hull_faces = _hull(points)
        if len(points) and not len(corners):  # a flat piece
            corners, hull_faces = _hull((points[:, None] + _THIN_M * _AROUND).reshape(-1, 3))
        if len(corners):
            parts.append(corners)
            left += hull_faces
    return tuple(parts) if len(parts) > 1 and left <= (1.0 - _WORTH) * volume else ()


def _hull(points: Array) -> tuple[Array, float]:
    """Corners of a hull, shape (K, 3) [m], and its volume [m³]; none where points span none."""
    if (hull := hull_of(points)) is None:
        return points[:0], 0.0
    return points[np.sort(hull.vertices)], float(hull.volume)


def _volume(cells: Sequence[_Cell]) -> float:
    return sum(cell.volume for cell in cells)


def _parts(whole: _Cell, axes: tuple[int, ...], most: int) -> list[_Cell]:
    """At most so many cells by cuts along these axes, each time the one that saves the most."""
    cells = [whole]
    while len(cells) < most:
        cut = max(cells, key=lambda cell: cell.volume - _volume(cell.cut(axes)))
        if cut.volume - _volume(cut.cut(axes)) < _EACH * whole.volume:
            break
        cells.remove(cut)
        cells += cut.cut(axes)
    return cells


def _behind(triangles: Array, axis: int, place: float, sign: float) -> Array:
    """Parts of triangles where sign · x ≤ sign · place, as triangles, shape (F, 3, 3)."""
    height = sign * (triangles[:, :, axis] - place)
    inside = height <= 0.0
    count = inside.sum(axis=1)
    pieces = [triangles[count == 3]]
    for corners in (1, 2):
        which = np.flatnonzero(count == corners)
        if not len(which):
            continue
        apex = (inside[which] if corners == 1 else ~inside[which]).argmax(axis=1)
        turn = (apex[:, None] + np.arange(3)) % 3
        points = np.take_along_axis(triangles[which], turn[:, :, None], axis=1)
        heights = np.take_along_axis(height[which], turn, axis=1)
        share = heights[:, :1] / (
            heights[:, :1] - heights[:, 1:]
        )  # from the apex to where its sides are cut
        met = points[:, :1] + share[:, :, None] * (points[:, 1:] - points[:, :1])
        if corners == 1:
            pieces.append(np.concatenate([points[:, :1], met], axis=1))
        else:
            pieces.append(np.concatenate([points[:, 1:], met[:, :1]], axis=1))
            pieces.append(np.stack([points[:, 2], met[:, 1], met[:, 0]], axis=1))
    return np.concatenate(pieces)
