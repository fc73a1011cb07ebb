"""A patch: a flat convex piece of terrain on which one toe may stand, with its friction, its contact
frame and how well it is known; and frames that it is moved by.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, checked, collect_errors, cross, read_only
from ..files.codec import LATER

_NUMBER = r"(-?\d+(?:\.\d+)?(?:e[+-]?\d+)?)"
_PLACE = re.compile(rf"\({_NUMBER}, {_NUMBER}\)")


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """A frame with z upward in the world: where it lies, and which way its x points.

    Arguments:
        origin_m: its origin, shape (3,) [m].
        heading_rad: from the world's x towards y [rad].
    """

    origin_m: Array
    heading_rad: float = 0.0

    @property
    def rotation(self) -> Array:
        """R_WF, shape (3, 3)."""
        if self.heading_rad == 0.0:
            return np.eye(3)
        c, s = np.cos(self.heading_rad), np.sin(self.heading_rad)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    @property
    def inverse(self) -> Frame:
        """The world in this frame."""
        back = Frame(origin_m=np.zeros(3), heading_rad=-self.heading_rad)
        return Frame(origin_m=-back.vectors(self.origin_m), heading_rad=-self.heading_rad)

    def vectors(self, vectors: Array) -> Array:
        """Vectors of this frame in the world, shape (…, 3)."""
        return np.asarray(vectors @ self.rotation.T)

    def places(self, places_m: Array) -> Array:
        """Places of this frame in the world, shape (…, 3) [m]."""
        return np.asarray(self.vectors(places_m) + self.origin_m)

    def in_world(self, said: str) -> str:
        """A sentence about this frame with its places, as "(1, -0.2)", those of the world."""

        def there(found: re.Match[str]) -> str:
            x, y, _ = np.round(self.places(np.array([float(found[1]), float(found[2]), 0.0])), 3)
            return f"({x + 0.0:.10g}, {y + 0.0:.10g})"

        return _PLACE.sub(there, said)


_BENT_M = 0.08
"""Distance over which the ground turns that is off its plane from place to place [m]."""
FOUND_SD_M = 0.0064
"""Ground that is known to this is found within 2 cm by all of thirty toes on 95 of 100 grounds [m]."""
_SIDES = 16
"""Sides of the polygon of the places where it is."""
_TINY = 1e-12
"""Variance of a slope that is known to the last digit."""
_NEGATIVE = 1e-9
"""Error of a covariance by rounding, as a share of its largest entry."""

FOR_BODIES_M = 1e3
"""A surface that goes on so far beyond its edges is for bodies alone to keep out of [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Certainty:
    """The covariance of a surface's plane, and the deviation of its edges.

    Arguments:
        about_m: place that the plane's height is meant at, shape (2,) [m].
        covariance: of the height there [m] and of the slopes along x and y [rad], shape (3, 3).
        edge_sd_m: standard deviation of the place of an edge, across it [m].
        inset_m: how far footholds keep from where edges most likely are [m].
        rough_m: standard deviation of the ground off its plane from place to place, over about a
            foot's width [m].
        wider_m: how far the surface goes on beyond where its edges most likely are, for bodies to
            keep out of; toes may not stand there, and nowhere on it for ``FOR_BODIES_M`` [m].
    """

    about_m: Array
    covariance: Array
    edge_sd_m: float = 0.0
    inset_m: float = 0.0
    rough_m: float = field(default=0.0, metadata=LATER)
    wider_m: float = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        object.__setattr__(self, "about_m", read_only(self.about_m, (2,), "about_m"))
        object.__setattr__(self, "covariance", read_only(self.covariance, (3, 3), "covariance"))
        least = float(np.linalg.eigvalsh(self.covariance)[0])
        skew = float(np.abs(self.covariance - self.covariance.T).max())
        if max(skew, -least) > _NEGATIVE * float(np.abs(self.covariance).max()):
            raise InvalidInput(
                "covariance: expected a symmetric matrix without negative eigenvalues, got "
                f"{self.covariance.tolist()}"
            )
        for name in ("edge_sd_m", "inset_m", "rough_m", "wider_m"):
            checked(getattr(self, name), name, least=0.0)

    def moved(self, frame: Frame) -> Certainty:
        """The certainty of the surface moved with the world."""
        about, slopes = frame.places(np.append(self.about_m, 0.0))[:2], np.eye(3)
        slopes[1:, 1:] = frame.rotation[:2, :2]
        return replace(self, about_m=about, covariance=slopes @ self.covariance @ slopes.T)

    def levers(self, places_m: Array) -> Array:
        """Coefficients of height and slopes in the plane's height at places, shape (…, 2), shape
        (…, 3).
        """
        return np.concatenate(
            [np.ones((*places_m.shape[:-1], 1)), places_m - self.about_m], axis=-1
        )

    def height_sd_m(self, places_m: Array) -> Array:
        """Standard deviation of the ground's height above the plane at places of shape (…, 2),
        shape (…) [m].
        """
        levers = self.levers(places_m)
        plane = np.maximum(np.einsum("...i,ij,...j->...", levers, self.covariance, levers), 0.0)
        return np.asarray(np.sqrt(plane + self.rough_m**2))

    def known_within(self, sd_m: float) -> tuple[Array, Array] | None:
        """Normals and offsets of a polygon in whose places the height is known to this deviation,
        shape (S, 2) and (S,) [m]; None where there is none.
        """
        flat = self.covariance[1:, 1:] + _TINY * np.eye(2)
        middle = -np.linalg.solve(flat, self.covariance[1:, 0])
        least = self.covariance[0, 0] + self.covariance[0, 1:] @ middle + self.rough_m**2
        if least >= sd_m**2:
            return None
        angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        ways = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        normals = ways @ np.linalg.cholesky(flat).T
        radius = np.sqrt(sd_m**2 - least) * np.cos(np.pi / _SIDES)
        return normals, radius + normals @ (middle + self.about_m)

    @property
    def exact(self) -> bool:
        """True where plane and edges are known to the last digit."""
        return not (self.covariance.any() or self.edge_sd_m or self.rough_m)

    @property
    def tilt_sd_rad(self) -> float:
        """Standard deviation of the slope along the way on which it is largest [rad]."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.slope_covariance)[-1], 0.0)))

    @property
    def slope_covariance(self) -> Array:
        """Covariance of the ground's slopes at a place, shape (2, 2) [rad²]: of the plane's, and by
        what the ground is off it from one foot's width to the next.
        """
        return np.asarray(self.covariance[1:, 1:] + (self.rough_m / _BENT_M) ** 2 * np.eye(2))


THICKNESS_M = 0.04
_FLAT_M = 1e-6
"""A patch whose corners leave their plane by no more is flat."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid:
    """A convex body, mostly a thin prism behind a patch's surface.

    Arguments:
        corners: shape (K, 3) [m].
        normals, offsets_m: its faces n·x = d, outwards, shape (F, 3), (F,).
        triangles: of its surface, turned outwards, by index of the corners, shape (T, 3).
    """

    corners: Array
    normals: Array
    offsets_m: Array
    triangles: NDArray[np.int_]

    @classmethod
    def behind(cls, border_m: Array, normal: Array, thickness_m: float = THICKNESS_M) -> Solid:
        """A surface with some thickness behind it.

        Arguments:
            border_m: its corners in order, shape (U, 3) [m].
            normal: its unit normal, shape (3,).
            thickness_m: of the solid.
        """
        return cls.behind_all([border_m], [normal], [thickness_m])[0]

    @classmethod
    def behind_all(
        cls, borders_m: Sequence[Array], normals: Sequence[Array], thicknesses_m: Sequence[float]
    ) -> list[Solid]:
        """The solids ``behind`` many surfaces; those of as many corners are made at once."""
        prisms = [_prism(*each) for each in zip(borders_m, normals, thicknesses_m, strict=True)]
        solids: list[Solid | None] = [None] * len(prisms)
        for size in {len(corners) for corners in prisms}:
            chosen = [k for k, corners in enumerate(prisms) if len(corners) == size]
            corners, outwards = (
                np.array([prisms[k] for k in chosen]),
                np.array([normals[k] for k in chosen]),
            )
            for k, solid in zip(chosen, cls._of_prisms(corners, outwards), strict=True):
                solids[k] = solid
        return [solid for solid in solids if solid is not None]

    @classmethod
    def _of_prisms(cls, corners: Array, normal: Array) -> list[Solid]:
        """The solids between K borders and what lies behind them.

        Arguments:
            corners: the borders, and the same moved back, shape (K, 2U, 3) [m].
            normal: unit normals, shape (K, 3).
        """
        count = corners.shape[1] // 2
        border, top = corners[:, :count], np.arange(count)
        then = np.concatenate([top[1:], top[:1]])
        bent = np.ptp(np.matmul(border, normal[:, :, None])[..., 0], axis=1) > _FLAT_M
        around = np.vecdot(cross(border, border[:, then]).sum(axis=1), normal)
        sides = np.sign(around)[:, None, None] * cross(
            border[:, then] - border, np.repeat(normal[:, None], count, axis=1)
        )
        sides /= np.linalg.norm(sides, axis=2)[..., None]
        faces = np.concatenate([normal[:, None], -normal[:, None], sides], axis=1)
        offsets = np.matmul(faces, corners.transpose(0, 2, 1)).max(axis=2)
        fan = np.stack([np.zeros_like(top[2:]), top[1:-1], top[2:]], axis=1)
        walls = [
            np.stack([top, top + count, then], axis=1),
            np.stack([then, top + count, then + count], axis=1),
        ]
        triangles = np.concatenate([fan, fan[:, ::-1] + count, *walls])
        return [
            cls.of_corners(corners[k])  # bent as far as a patch may be
            if bent[k]
            else cls(
                corners=corners[k],
                normals=faces[k],
                offsets_m=offsets[k],
                triangles=triangles if around[k] > 0.0 else triangles[:, ::-1],
            )
            for k in range(len(corners))
        ]

    @classmethod
    def of_corners(cls, corners: Array) -> Solid:
        """The convex hull of points, shape (K, 3) [m]."""
        from scipy.spatial import ConvexHull  # slow to import

        hull = ConvexHull(corners)
        triangles, outwards = hull.simplices.astype(np.int_), hull.equations[:, :3]
        a, b, c = (corners[triangles[:, i]] for i in range(3))
        turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), outwards) < 0.0
        triangles[turned] = triangles[turned][:, [0, 2, 1]]
        faces = np.unique(hull.equations.round(12), axis=0)
        return cls(
            corners=corners, normals=faces[:, :3], offsets_m=-faces[:, 3], triangles=triangles
        )

    def distance(self, points: Array) -> Array:
        """Distance of points from the outside: never more than their distance, negative inside;
        shape (…, 3) to (…) [m].
        """
        return np.asarray((points @ self.normals.T - self.offsets_m).max(axis=-1))


def hull_of(points: Array) -> Any:
    """The convex hull of points, shape (P, 3) [m], as scipy has it; None where they span no
    volume.
    """
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None


def with_as_many_faces(solids: Sequence[Solid]) -> list[NDArray[np.int_]]:
    """Convex bodies, by number, that have as many faces."""
    counts = np.array([len(solid.offsets_m) for solid in solids], dtype=int)
    return [np.flatnonzero(counts == count) for count in sorted(set(counts.tolist()))]


class Solids:
    """Convex bodies whose distances are measured at once."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        ends = np.cumsum([0, *(len(solid.offsets_m) for solid in solids)])
        self._count = len(solids)
        self._normals = np.concatenate([np.zeros((0, 3)), *(solid.normals for solid in solids)])
        self._offsets_m = np.concatenate([np.zeros(0), *(solid.offsets_m for solid in solids)])
        self._alike = [
            (alike, np.array([np.arange(ends[k], ends[k + 1]) for k in alike]).T)
            for alike in with_as_many_faces(solids)
        ]

    def distances(self, points: Array) -> Array:
        """Distances from each of S solids, as of ``Solid.distance``: shape (…, 3) to (…, S) [m]."""
        beyond = points @ self._normals.T
        beyond -= self._offsets_m
        apart = np.empty((*points.shape[:-1], self._count))
        for solids, faces in self._alike:
            apart[..., solids] = reduce(np.maximum, (beyond.take(each, axis=-1) for each in faces))
        return apart


def _prism(border: Array, normal: Array, thickness_m: float) -> Array:
    """The border without doubled corners, then the same moved back along the normal, shape (2U, 3)
    [m].
    """
    apart = np.linalg.norm(border - border[[-1, *range(len(border) - 1)]], axis=1) > 1e-9
    return np.concatenate([border[apart], border[apart] - thickness_m * normal])


_FLATNESS = 2e-3
"""Vertices may leave the plane by this share of the patch's diameter: room for rounded files, not
for a bent patch."""

_THINNEST_M = 1e-3
"""Nothing behind a patch is thinner [m]."""
_MOST_VERTICES = 512
"""More make no difference to a foot, and checks of a polygon take the square of their number."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Patch:
    """A convex planar polygon with a Coulomb friction coefficient (Lin et al. §II, Fig. 2).

    Arguments:
        vertices_m: v_u in the world, in order around the border, shape (U, 3) with U ≥ 3 [m].
        normal: unit normal n, out of the terrain towards the robot, shape (3,).
        shear_reference: direction whose projection on the patch is the second shear axis z, shape
            (3,); not along n.
        friction: μ ≥ 0.
        certainty: how sure its plane and its edges are, where it was measured with noise.
        thickness_m: thickness of the solid behind it, for collisions of bodies [m].

    Raises:
        InvalidInput: for a bent, non-convex or degenerate polygon and for a shear reference along
            the normal.
    Source:
        Lin et al. §II, Fig. 2, E1 and E10.

    Example:
        >>> import numpy as np
        >>> from stancekit import Patch
        >>> square = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.1, 0.0]])
        >>> patch = Patch(vertices_m=square, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.5)
        >>> patch.frame.round(3).tolist()
        [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]
    """

    vertices_m: Array
    normal: Array
    shear_reference: Array
    friction: float
    certainty: Certainty | None = field(default=None, metadata=LATER)
    thickness_m: float = field(default=THICKNESS_M, metadata=LATER)

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        collect_errors(
            lambda: set_field(
                self, "vertices_m", read_only(self.vertices_m, (None, 3), "vertices_m")
            ),
            lambda: set_field(self, "normal", _unit(self.normal, "normal")),
            lambda: set_field(
                self,
                "shear_reference",
                _unit(self.shear_reference, "shear_reference", any_length=True),
            ),
            lambda: set_field(self, "friction", checked(self.friction, "friction", least=0.0)),
            lambda: checked(self.thickness_m, "thickness_m", least=_THINNEST_M),
        )
        if abs(self.normal @ self.shear_reference) > 1.0 - 5e-7:
            raise InvalidInput(
                "shear_reference: expected a direction not along the normal, got "
                f"{self.shear_reference.tolist()}"
            )
        self._check_polygon(self.vertices_m)

    @cached_property
    def frame(self) -> Array:
        """R_WC, columns n, y = z × n, z: the axes of f_n, f_y, f_z (E3), shape (3, 3)."""
        axes = contact_frames(self.normal, self.shear_reference)
        axes.setflags(write=False)
        return axes

    @cached_property
    def solid(self) -> Solid:
        """The body behind it: what a limb may run into."""
        return Solid.behind(self.vertices_m, self.normal, self.thickness_m)

    def with_friction(self, friction: float) -> Patch:
        """Patch of the same surface with another friction; its geometry is not checked again.

        Raises InvalidInput.
        """
        return self._with("friction", checked(friction, "friction", least=0.0))

    def with_certainty(self, certainty: Certainty | None) -> Patch:
        """Patch of the same surface with another certainty; its geometry is not looked at again."""
        return self._with("certainty", certainty)

    def with_thickness(self, thickness_m: float) -> Patch:
        """Patch of the same surface with so much behind it; its geometry is not looked at again."""
        new = self._with("thickness_m", thickness_m)
        vars(new).pop("solid", None)
        return new

    def with_vertices(self, vertices_m: Array) -> Patch:
        """Another polygon in the same plane; nothing else is looked at again.

        Raises InvalidInput.
        """
        vertices = read_only(vertices_m, (None, 3), "vertices_m")
        self._check_polygon(vertices)
        return self._moved_to(vertices)

    def moved(self, frame: Frame, shear_of: Callable[[Array], Array] | None = None) -> Patch:
        """Patch in a world that is moved with it; its polygon is not looked at again.

        Raises InvalidInput.

        Arguments:
            shear_of: gives the shear reference for its normal there; None for its own, turned.
        """
        new = self._moved_to(read_only(frame.places(self.vertices_m), (None, 3), "vertices_m"))
        for name in ("normal", "shear_reference"):
            turned = frame.vectors(getattr(self, name))
            object.__setattr__(new, name, read_only(turned, (3,), name))
        if shear_of is not None:
            object.__setattr__(new, "shear_reference", shear_of(new.normal))
        vars(new).pop("frame", None)
        return new if self.certainty is None else new.with_certainty(self.certainty.moved(frame))

    def _moved_to(self, vertices: Array) -> Patch:
        new = self._with("vertices_m", vertices)
        vars(new).pop("solid", None)
        return new

    def _with(self, name: str, value: object) -> Patch:
        new = object.__new__(Patch)
        new.__dict__.update(self.__dict__)
        object.__setattr__(new, name, value)
        return new

    def _check_polygon(self, vertices: Array) -> None:
        _check_polygons(vertices[None], self.frame[None])

    @property
    def centre_m(self) -> Array:
        """Mean of the vertices, shape (3,) [m]."""
        return np.asarray(self.vertices_m.mean(axis=0))

    def heights_at(self, places_m: Array) -> Array:
        """Heights of its plane at places, shapes (…, 2) to (…) [m]."""
        about = places_m - self.centre_m[:2]
        return np.asarray(self.centre_m[2] - about @ self.normal[:2] / self.normal[2])


def solids_of(patches: Sequence[Patch]) -> tuple[Solid, ...]:
    """The ``solid`` of every patch; those that are not made yet are made at once."""
    new = [patch for patch in patches if "solid" not in vars(patch)]
    if len(new) > 1:
        made = Solid.behind_all(
            [patch.vertices_m for patch in new],
            [patch.normal for patch in new],
            [patch.thickness_m for patch in new],
        )
        for patch, solid in zip(new, made, strict=True):
            vars(patch).setdefault("solid", solid)
    return tuple(patch.solid for patch in patches)


def with_polygons(patches: Sequence[Patch], vertices_m: Array, frames: Array) -> list[Patch]:
    """Other polygons in the planes of K patches, shape (K, U, 3), looked at all at once; nothing
    else is looked at again.

    Raises InvalidInput for the first that is none.

    Arguments:
        frames: those of the patches, shape (K, 3, 3).
    """
    vertices = read_only(vertices_m, (None, None, 3), "vertices_m")
    _check_polygons(vertices, frames)
    return [patch._moved_to(each) for patch, each in zip(patches, vertices, strict=True)]


def flat_patches(
    vertices_m: Array, normals: Array, shear_references: Array, frictions: Sequence[float]
) -> list[Patch]:
    """K patches of as many corners each, looked at all at once.

    Raises InvalidInput for the first that is none.

    Arguments:
        vertices_m: of each in order around the border, shape (K, U, 3) [m].
        normals, shear_references: unit vectors, shape (K, 3).
        frictions: μ ≥ 0 of each.
    """
    vertices = read_only(vertices_m, (None, None, 3), "vertices_m")
    normals = read_only(normals, (None, 3), "normal")
    shears = read_only(shear_references, (None, 3), "shear_reference")
    frames = contact_frames(normals, shears)
    frames.setflags(write=False)
    _check_polygons(vertices, frames)
    patches = list[Patch]()
    for k, friction in enumerate(frictions):
        patch = object.__new__(Patch)
        patch.__dict__.update(
            vertices_m=vertices[k],
            normal=normals[k],
            shear_reference=shears[k],
            friction=checked(friction, "friction", least=0.0),
            certainty=None,
            thickness_m=THICKNESS_M,
            frame=frames[k],
        )
        patches.append(patch)
    return patches


def _check_polygons(vertices: Array, frames: Array) -> None:
    count = vertices.shape[1]
    if not 3 <= count <= _MOST_VERTICES:
        message = "3 or more vertices" if count < 3 else f"{_MOST_VERTICES} vertices or fewer"
        raise InvalidInput(f"vertices_m: expected {message}, got {count}")
    defect = polygon_defect(vertices, frames)
    if defect:
        raise InvalidInput(defect[1])


def _unit(value: Array, where: str, *, any_length: bool = False) -> Array:
    vector = read_only(value, (3,), where)
    length = float(np.linalg.norm(vector))
    if length < 1e-9 or not (any_length or abs(length - 1.0) < 1e-3):
        raise InvalidInput(
            f"{where}: expected a {'non-zero' if any_length else 'unit'} vector, got length "
            f"{length:g}"
        )
    return vector if abs(length - 1.0) < 1e-12 else read_only(vector / length, (3,), where)


def contact_frames(normals: Array, shear_references: Array) -> Array:
    """R_WC, columns n, y = z × n, z, for normals and shear references of shape (..., 3); shape
    (..., 3, 3).
    """
    z = shear_references - np.vecdot(shear_references, normals)[..., None] * normals
    z = z / np.sqrt(np.vecdot(z, z))[..., None]
    frames = np.empty((*normals.shape, 3))
    frames[..., 0], frames[..., 1], frames[..., 2] = normals, cross(z, normals), z
    return frames


def polygon_defect(vertices: Array, frames: Array) -> tuple[int, str] | None:
    """The first of K polygons, shape (K, U, 3), whose vertices are not in order around a flat
    convex polygon with an area in the plane of its frame, shape (K, 3, 3); and what is wrong with
    it.
    """
    local = np.matmul(vertices - vertices[:, :1], frames)
    height, y, z = local[..., 0], local[..., 1], local[..., 2]
    squares = (y[:, :, None] - y[:, None]) ** 2 + (z[:, :, None] - z[:, None]) ** 2
    diameter = np.sqrt(squares.max(axis=(1, 2)))
    off_plane = np.abs(height - height.mean(axis=1, keepdims=True)).max(axis=1)
    area, turn, rounds = _around(y, z, diameter)
    defects = (
        (diameter < 1e-4, "a patch with an area, got one of diameter {0:g} m"),
        (
            off_plane > _FLATNESS * diameter,
            "a plane with the given normal, got vertices {1:.3g} mm off it",
        ),
        (np.abs(area) < 1e-4 * diameter**2, "a patch with an area, got {2:.3g} m² on {0:.3g} m"),
        (
            (turn < -1e-6 * diameter**2) | (rounds != 1.0),
            "a convex polygon, its vertices in order around the border",
        ),
    )
    for wrong, text in defects:
        if wrong.any():
            k = int(wrong.argmax())
            return (
                k,
                "vertices_m: expected "
                f"{text.format(diameter[k], 1e3 * off_plane[k], abs(area[k]))}",
            )
    return None


def _around(y: Array, z: Array, diameter: Array) -> tuple[Array, Array, Array]:
    """Measures of each border, shape (K, U): area, least turn of a corner towards the inside, and
    how often it goes round.
    """
    ahead = np.arange(1, y.shape[1] + 1) % y.shape[1]
    to_y, to_z = y[:, ahead], z[:, ahead]
    dy, dz = to_y - y, to_z - z
    double = (
        dy * dy + dz * dz <= (1e-9 * diameter[:, None]) ** 2
    )  # corners that are given twice in a row count once
    double[:, 0] &= ~double[:, 1:].all(axis=1)
    if double.any():
        rows = [
            _around(y[k : k + 1, ~double[k]], z[k : k + 1, ~double[k]], diameter[k : k + 1])
            for k in range(len(y))
        ]
        area, turn, rounds = np.concatenate(rows, axis=1)
        return area, turn, rounds
    area, next_y, next_z = 0.5 * (y * to_z - z * to_y).sum(axis=1), dy[:, ahead], dz[:, ahead]
    turns = dy * next_z - dz * next_y  # of each corner, positive to the left
    turned = np.arctan2(turns, dy * next_y + dz * next_z).sum(axis=1)
    least = (turns * np.sign(area)[:, None]).min(axis=1, initial=np.inf)
    return area, least, np.round(np.abs(turned) / (2.0 * np.pi))
