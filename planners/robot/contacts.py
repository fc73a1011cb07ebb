"""Contact shapes of legs: the shape at its end, where that is a ball, or what a person says it is.

A foot is the shape of the leg's last body that is farthest from the last joint, whichever link of
that body it is on. A ball touches at any attitude a radius below its centre, and so does the end of
a capsule; meshes of balls are read as the balls they are. Where a box, a cylinder, a wheel or
another mesh is the farthest, only the robot's owner knows what is meant to touch: plans need
``contacts`` of the robot's YAML file.

A sphere is fitted to the corners of a mesh's convex hull by least squares, ‖x‖² = 2 x·m + (r² −
‖m‖²), and made as large as the farthest of them is away. It is taken where nearly all corners, and
the planes of half of the hull's surface, are no farther from it than a part of its radius, and than
two millimetres: balls that are cut off on their sides, or have a neck, are balls, boxes and cylinders
not. Where it may touch, away from the leg's last joint, it has to be round: half a ball with its
flat side down is none.

The foot of a robot on two legs is a sole where it is flat: the convex hull of what is within 2 mm of
the lowest plane while it stands level.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array, flat_cross
from ..terrain.obstacles import Ground
from ..terrain.patch import hull_of
from .inverse_kinematics import WholeBody
from .leg import FootSole, Leg, Mount
from .meshes import Shape, link_points, shape_elements, solid_shapes, surface_points

Index = NDArray[np.intp]
_ON_FACE_M = 1e-9
"""A point that is so little outside of a face's border is on it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bounds:
    """Bounds on the distances of K pairs of bodies at T moments.

    Arguments:
        least: no distance is less, shape (T, K) [m].
        way: how far points go from every moment to the next, of both bodies together, shape (T - 1,
            K) [m].
        exact: truth values, True for bounds that are the distances themselves, shape (T, K).
    """

    least: Array
    way: Array
    exact: NDArray[np.bool_]

    def nearer(self, limit_m: float, *, between: bool) -> NDArray[np.bool_]:
        """Tell which pairs may be nearer than this at a moment, or with ``between`` on the way
        before or after it, shape (T, K).
        """
        near = self.least < limit_m
        if between:
            on = self.least[:-1] + self.least[1:] < self.way + 2.0 * limit_m
            near[:-1] |= on
            near[1:] |= on
        return near

    def measured(
        self, measure: Callable[[int, int], float], limit_m: float, *, between: bool
    ) -> Bounds:
        """Better bounds: exact are those that are nearer than the limit, at moments and, with
        ``between``, at both ends of ways on which bodies may be nearer.

        Arguments:
            measure: the distance of a pair (k) at a moment (t).
        """
        least, exact = self.least.copy(), self.exact.copy()
        open_ = self.nearer(limit_m, between=between) & ~exact
        for k in np.flatnonzero(open_.any(axis=0)).tolist():
            rows, known, steps = least[:, k].tolist(), exact[:, k].tolist(), self.way[:, k].tolist()
            last, end = len(rows), len(rows) - 1
            for t in np.flatnonzero(open_[:, k]).tolist():
                for s in range(last, t):
                    rows[s + 1] = max(rows[s + 1], rows[s] - steps[s])
                last, close = t, rows[t] < limit_m
                if between and not close:
                    close = t > 0 and rows[t - 1] + rows[t] < steps[t - 1] + 2.0 * limit_m
                    close = close or (t < end and rows[t] + rows[t + 1] < steps[t] + 2.0 * limit_m)
                if close:
                    rows[t], known[t] = measure(t, k), True
            least[:, k], exact[:, k] = rows, known
        return replace(self, least=least, exact=exact)


def balls_apart(middles: Array, radii: Array, pairs: Index) -> Array:
    """Distances between balls around bodies, shape (T, K) [m].

    Arguments:
        middles: centres of S bodies, shape (T, S, 3).
        radii: radii of the balls, shape (S,).
        pairs: indices of the bodies, shape (K, 2).
    """
    first, second = pairs.T
    between = middles[:, second] - middles[:, first]
    return np.asarray(
        np.sqrt(np.einsum("tki,tki->tk", between, between)) - (radii[first] + radii[second])
    )


def boxes_apart(between: Array, one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Least distance at which an axis of either box keeps two apart, shape (L,) [m].

    Arguments:
        between: vector from the centre of one to that of the other, shape (L, 3).
        one, other: rotations R of the boxes, and half their sides, shapes (L, 3, 3) and (L, 3).
    """
    (a, ha), (b, hb) = one, other
    across = np.abs(np.swapaxes(a, 1, 2) @ b)
    along_a = np.abs(between[:, None] @ a)[:, 0] - ha - (across @ hb[:, :, None])[..., 0]
    along_b = np.abs(between[:, None] @ b)[:, 0] - hb - (ha[:, None] @ across)[:, 0]
    return np.asarray(np.maximum(along_a.max(axis=1), along_b.max(axis=1)))


def off_solids(
    middles: Array, supports: Array, normals: Array, offsets_m: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Least distance at which a face of a convex body keeps another body off, shape (L,) [m], and
    which middles are inside of the convex body, or nearest to the inside of a face of it: of balls
    these are the distances.

    Arguments:
        middles: centres of the bodies, shape (L, 3).
        supports: how far they reach along the faces' normals, shape (L, F) or (L, 1).
        normals, offsets_m: of the F faces n·x = d of every convex body, shapes (L, F, 3), (L, F).
    """
    heights = (normals @ middles[:, :, None])[..., 0] - offsets_m
    face, rows = heights.argmax(axis=1), np.arange(len(heights))
    height = heights[rows, face]
    below = middles - height[:, None] * normals[rows, face]
    over = np.all((normals @ below[:, :, None])[..., 0] - offsets_m < _ON_FACE_M, axis=1)
    return (heights - supports).max(axis=1), over | (height <= 0.0)


_ROUND, _OFF_BALL_M = 0.15, 2e-3
"""Share of its radius, and distance, by which a mesh that is taken for a ball may be off it: the
smaller of the two."""
_NECK = 0.05
"""Share of a ball's corners that may be farther from it, where a shank ends in it."""
HALF = 0.5
"""Share of a ball's surface that is round; the rest may be cut off."""
_TOUCHING_RAD = 0.7
"""A foot may touch with what is so far off the direction from its joint to its middle; one about
its joint with all."""
_DIRECTIONS = 400
"""Directions all over a sphere in which a ball's surface is looked at."""
_ENOUGH = 3000
"""Corners of a ball from which it is known to be one."""
_FINE = 0.05
"""Points on a foot's surface to which a ball is fitted are so far apart, as a share of its size."""
_DIGITS = 9
"""Decimals of a ball's centre and radius as a URDF has them [m]."""
_FARTHER_M = 1e-3
"""A shape that goes no farther than this beyond the ball at a leg's end does not touch before
it."""
_SAME_M = 1e-6
"""A shape is the one that touches if its centre and its radius are within this of the leg's."""


_Placed = tuple[Shape, tuple[Array, Array], tuple[tuple[Array, float], ...]]
"""A shape of a leg's last body, its rotation and origin in the last joint's frame, shapes (3, 3),
(3,) [m], and centre, shape (3,), and radius [m] of every ball that it is, or ends in."""


Touch = tuple[str, Array, float, str]
"""What touches: a link, with a ball about a centre in the last joint's frame, shape (3,) [m], its
radius [m]; and why it is unknown, in which case the rest is that of a point at the farthest end."""
Fits = dict[bytes, tuple[Array, float] | None]
"""``fitted_ball`` of hulls by their corners, each tried once."""


def placed_shapes(
    shapes: Sequence[Shape], places: Mapping[str, tuple[Array, Array]], fits: Fits
) -> list[_Placed]:
    """The shapes of the links of one body.

    Arguments:
        places: rotation and origin of every link of the body in the last joint's frame, by name.
    """
    return [
        (shape, pose, _balls(shape, *pose, fits))
        for shape in solid_shapes(shapes)
        if shape.link in places
        for turn, place in [places[shape.link]]
        for pose in [(turn @ shape.rotation, place + turn @ shape.origin_m)]
    ]


def touch_of(pieces: Sequence[_Placed]) -> Touch | None:
    """Shape with which a leg touches whose last body has these shapes; None for a body without
    shapes.
    """
    balls, others = list[tuple[float, Touch]](), list[tuple[float, Touch]]()
    unread = [shape for shape, *_ in pieces if shape.kind == "mesh" and shape.corners_m is None]
    for shape, pose, ends in pieces:
        for centre, radius_m in ends:
            far_m = float(np.linalg.norm(centre)) + radius_m
            balls.append((far_m, (shape.link, centre, radius_m, "")))
        if not ends and (points := shape.points_m) is not None:
            far_m = float(np.linalg.norm(pose[1] + points @ pose[0].T, axis=1).max())
            text = f"touches with a {shape.kind}: say with which point or ball, in a YAML file's contacts:"
            end = pose[1] + pose[0] @ shape.rotation.T @ (shape.far_m - shape.origin_m)
            others.append((far_m, (shape.link, end, 0.0, text)))
    ball = max(balls, key=lambda each: each[0], default=None)
    other = max(others, key=lambda each: each[0], default=None)
    if ball is not None and (other is None or other[0] <= ball[0] + _FARTHER_M):
        return ball[1]
    if other is not None and not unread:
        return other[1]
    if unread:
        text = "touches with a mesh that cannot be had: say with which point or ball, in a YAML file's contacts:"
        return unread[0].link, np.zeros(3), 0.0, text
    return None


_FLAT_M, _LEAST_M = 2e-3, (0.04, 0.02)
"""Corners this near to the plane that a foot stands on are its sole's [m]; a sole is at least so
long and so wide [m]."""
_UPRIGHT_RAD = 0.3
"""A sole is level while all joints are at 0, or leans by no more than this."""
_LARGER = 1.02
"""A plane that leans is taken where its sole is so much larger than that of a level one."""
_MOST_CORNERS = 8


def sole_of(pieces: Sequence[_Placed], base: Array) -> tuple[FootSole, Array, str] | None:
    """The flat face with which a leg's last body stands, its middle in the last joint's frame,
    shape (3,) [m], and the link that has it; None for a body without one.

    Arguments:
        base: rotation from the base's axes into the last joint's while all joints are at 0, shape
            (3, 3).
    """
    from scipy.spatial import ConvexHull  # slow to import

    clouds, owners = [np.zeros((0, 3))], list[str]()
    for shape, (rotation, origin_m), balls in pieces:
        ends = [centre - radius_m * base[:, 2] for centre, radius_m in balls]
        if not ends and (corners := shape.points_m) is not None:
            ends = list(origin_m + corners @ rotation.T)
        clouds.append(np.array(ends).reshape(-1, 3))
        owners += [shape.link] * len(ends)
    points, best, most = np.vstack(clouds), None, 0.0
    if len(points) < 3:
        return None
    faces = np.zeros((0, 3))
    if len(points) > 3:
        faces = ConvexHull(points, qhull_options="QJ").equations[:, :3]
    leaning = [face for face in faces if -face @ base[:, 2] > np.cos(_UPRIGHT_RAD)]
    for down in (-base[:, 2], *leaning):
        low = points @ down
        near = low > low.max() - _FLAT_M
        ahead = base[:, 0] - (base[:, 0] @ down) * down
        ahead = ahead / np.linalg.norm(ahead)
        turn = np.column_stack([ahead, np.cross(-down, ahead), -down])
        flat = (points[near] @ turn)[:, :2]
        if len(flat) < 3 or np.any(np.ptp(flat, axis=0) < _LEAST_M[1]):
            continue
        hull = ConvexHull(flat, qhull_options="QJ")
        if hull.volume > _LARGER * most:
            most, best = hull.volume, (flat[hull.vertices], turn, low.max(), near)
    if best is None or np.ptp(best[0], axis=0).max() < _LEAST_M[0]:
        return None
    corners, turn, depth, near = best
    while len(corners) > _MOST_CORNERS:  # the corner that takes least area goes first
        one = corners - np.roll(corners, 1, axis=0)
        two = np.roll(corners, -1, axis=0) - np.roll(corners, 1, axis=0)
        corners = np.delete(corners, int(np.argmin(np.abs(flat_cross(one, two)))), axis=0)
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    links = [link for link, low in zip(owners, near, strict=True) if low]
    sole = FootSole(points_m=np.round(corners - middle, 6), rotation=turn)
    return sole, turn @ np.array([*middle, -depth]), max(links, key=links.count)


_WHEEL = 0.1
"""Share of its radius by which a wheel may be out of round, and the sine of the angle by which its
axis may leave the ground."""


def is_wheel(pieces: Sequence[_Placed], axis: Array, up: Array) -> bool:
    """Tell whether shapes that turn freely about an axis through the origin are a wheel: round
    about it, and the axis level.

    Arguments:
        axis, up: unit vectors in the shapes' frame, shape (3,).
    """
    if abs(float(axis @ up)) > _WHEEL:
        return False
    ends = [
        origin_m + corners @ rotation.T
        for shape, (rotation, origin_m), _ in pieces
        if (corners := shape.points_m) is not None
    ]
    points = np.vstack([np.zeros((0, 3)), *ends])
    turn = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)[:, None]
    rims = np.cos(turn) * up + np.sin(turn) * np.cross(axis, up)
    radii = (rims @ points.T).max(axis=1, initial=0.0)
    return bool(radii.max() > 0.0 and np.ptp(radii) <= _WHEEL * radii.max())


def _balls(
    shape: Shape, rotation: Array, origin_m: Array, fits: Fits
) -> tuple[tuple[Array, float], ...]:
    """Centre, shape (3,), and radius [m] of every ball that a shape is, or ends in."""
    if shape.kind == "sphere":
        return ((origin_m, float(shape.size_m[0])),)
    if shape.kind == "capsule":
        half, radius_m = 0.5 * float(shape.size_m[1]) * rotation[:, 2], float(shape.size_m[0])
        return (origin_m + half, radius_m), (origin_m - half, radius_m)
    if shape.kind != "mesh" or shape.corners_m is None:
        return ()
    key = shape.corners_m.tobytes()
    if key not in fits:
        fits[key] = fitted_ball(shape.corners_m)
    if (ball := fits[key]) is None:
        return ()
    in_link = np.round(shape.origin_m + shape.rotation @ ball[0], _DIGITS)  # as a URDF has it
    middle = shape.rotation.T @ (in_link - shape.origin_m)
    centre, radius_m = origin_m + rotation @ middle, round(ball[1], _DIGITS)
    far_m = float(np.linalg.norm(centre))
    outward = rotation.T @ centre / far_m if far_m > 2.0 * radius_m else None
    return ((centre, radius_m),) if _round(shape.corners_m, middle, radius_m, outward) else ()


def _round(points_m: Array, middle_m: Array, radius_m: float, outward: Array | None) -> bool:
    """Tell whether the hull of points, shape (V, 3) [m], ends where a ball does in all directions
    in which that may touch: those within ``_TOUCHING_RAD`` of a unit vector, shape (3,), all of them
    where it is None.
    """
    z = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_DIRECTIONS)  # Fibonacci's lattice
    flat = np.sqrt(1.0 - z**2)
    ways = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    if outward is not None:
        ways = ways[ways @ outward > np.cos(_TOUCHING_RAD)]
    ends = ((points_m - middle_m) @ ways.T).max(axis=0)
    return bool(ends.min() >= radius_m - min(_ROUND * radius_m, _OFF_BALL_M))


def _touching(leg: Leg, mount: Mount, shape: Shape) -> bool:
    """Tell whether a leg's foot is this shape: a ball, a mesh of one, or a capsule with its end, at
    the leg's own end.
    """
    pose = mount.rotation @ shape.rotation, mount.origin_m + mount.rotation @ shape.origin_m
    return any(
        abs(radius_m - leg.radius_m) <= _SAME_M
        and float(np.linalg.norm(centre - leg.chain.tip_m)) < _SAME_M
        for centre, radius_m in _balls(shape, *pose, {})
    )


def feet_of(shapes: Sequence[Shape], legs: Sequence[Leg], mounts: Mapping[str, Mount]) -> list[int]:
    """For every shape the number of the leg whose foot it is, −1 for those that are none."""
    ends: Mapping[tuple[int | None, int], int] = {
        (i, len(leg.joints) - 1): i for i, leg in enumerate(legs)
    }
    feet = []
    for shape in shapes:
        mount = mounts[shape.link]
        limb = ends.get((mount.leg, mount.joint), -1)
        touches = limb >= 0 and shape.kind != "mesh" and _touching(legs[limb], mount, shape)
        feet.append(limb if touches else -1)
    return feet


def with_balls(
    root: Element,
    legs: Sequence[Leg],
    shapes: Sequence[Shape],
    mounts: Mapping[str, Mount],
) -> tuple[str, tuple[str, ...]]:
    """The URDF with a sphere added for every foot that is a ball and has no sphere in the file, and
    the links that got one.

    The sphere replaces the mesh that shows the ball. Where a person said what touches the ground,
    it stands beside the other shapes. The text is empty where nothing changes.
    """
    elements = [element for _, element, _ in shape_elements(root)]
    links = {link.get("name", ""): link for link in root.findall("link")}
    bodies, changed = {id(shape) for shape in solid_shapes(shapes)}, list[str]()
    for leg in legs:
        link, mount = links[leg.foot], mounts[leg.foot]
        touching = [
            (shape, element)
            for shape, element in zip(shapes, elements, strict=True)
            if leg.radius_m > 0.0 and shape.link == leg.foot and _touching(leg, mount, shape)
        ]
        if leg.radius_m <= 0.0 or any(shape.kind != "mesh" for shape, _ in touching):
            continue
        meshes = [element for shape, element in touching if id(shape) in bodies]
        gone = meshes[0] if meshes and leg.contact is None else None
        if link.find("collision") is None:  # what it looks like is its body, and stays so
            for visual in link.findall("visual"):
                if visual is not gone:
                    copy = ElementTree.fromstring(ElementTree.tostring(visual))
                    copy.tag = "collision"
                    link.append(copy)
        elif gone is not None:
            link.remove(gone)
        middle = mount.rotation.T @ (leg.chain.tip_m - mount.origin_m)
        collision = SubElement(link, "collision")
        SubElement(
            collision, "origin", {"xyz": " ".join(repr(round(float(x), _DIGITS)) for x in middle)}
        )
        SubElement(
            SubElement(collision, "geometry"),
            "sphere",
            {"radius": repr(round(leg.radius_m, _DIGITS))},
        )
        changed.append(leg.foot)
    return ElementTree.tostring(root, encoding="unicode") if changed else "", tuple(changed)


def check_contacts(
    legs: Sequence[Leg], name: str, shapes: Sequence[Shape], mounts: Mapping[str, Mount]
) -> None:
    """Raise InvalidInput for legs whose contact is unknown, with an example of what a YAML file may
    say.
    """
    doubts = dict[str, list[str]]()
    for leg in legs:
        if leg.doubt:
            doubts.setdefault(leg.doubt, []).append(leg.foot)
    if doubts:
        doubts_text = "; ".join(f"{', '.join(links)} {text}" for text, links in doubts.items())
        unsaid = next((leg for leg in legs if leg.doubt.endswith(":")), None)
        example = "" if unsaid is None else _example(unsaid, shapes, mounts)
        raise InvalidInput(
            f"robot {name}: expected feet that are balls or that its YAML file describes: "
            f"{doubts_text} {example}".rstrip()
        )


def _example(leg: Leg, shapes: Sequence[Shape], mounts: Mapping[str, Mount]) -> str:
    """An example for a message: the YAML entry that would describe a leg's foot as the ball nearest
    to its surface, or where that is no ball, as the point at the end of the leg: the middle of what
    is farthest from the last joint.
    """
    solid = solid_shapes([shape for shape in shapes if shape.link == leg.foot])
    corners = [points for points in map(link_points, solid) if points is not None]
    mount, why = mounts[leg.foot], "the point at its end"
    middle, radius_m = mount.rotation.T @ (leg.chain.tip_m - mount.origin_m), 0.0
    if corners and hull_of(points := np.vstack(corners)) is not None:
        far_m = np.linalg.norm(mount.placed(points), axis=1)
        middle = points[far_m >= far_m.max() - _FARTHER_M].mean(axis=0)
        size_m = np.ptp(points, axis=0).max()
        centre, away = _about(surface_points(points, _FINE * size_m))
        if away.max() <= min(3.0 * away.min(), size_m):  # a rod is no ball, and a plate none
            middle, radius_m = centre, 0.5 * (away.min() + away.max())
            why = f"the ball nearest to its shape, {500.0 * np.ptp(away):.1f} mm off at most"
    point = ", ".join(f"{round(float(value), 4) + 0.0:g}" for value in middle)
    return f"e.g. {{{leg.foot}: {{point_m: [{point}], radius_m: {radius_m:.4g}}}}}, {why}"


def _about(points_m: Array) -> tuple[Array, Array]:
    """The centre of the sphere of least squares, shape (3,), and how far points, shape (V, 3), are
    from it [m].
    """
    shift = points_m.mean(axis=0)
    apart = points_m - shift
    rows = np.column_stack([2.0 * apart, np.ones(len(apart))])
    middle = np.linalg.lstsq(rows, np.sum(apart**2, axis=1), rcond=None)[0][:3] + shift
    return middle, np.linalg.norm(points_m - middle, axis=1)


def fitted_ball(points_m: Array) -> tuple[Array, float] | None:
    """Centre, shape (3,), and radius [m] of the ball whose surface the corners of a hull, shape (V,
    3), are on; None where they are on none's.
    """
    if len(points_m) < 4:
        return None
    middle, away = _about(points_m)
    radius_m = float(away.max())
    least = radius_m - min(_ROUND * radius_m, _OFF_BALL_M)
    if not float(np.quantile(away, _NECK)) >= least:
        return None
    some = points_m[
        :: 1 + len(points_m) // _ENOUGH
    ]  # whether its planes are a ball's is as clear of fewer corners
    if (hull := hull_of(some)) is None:
        return None
    a, b, c = (some[hull.simplices[:, corner]] for corner in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    near = -(hull.equations[:, :3] @ middle + hull.equations[:, 3]) >= least
    return (middle, radius_m) if areas[near].sum() >= HALF * areas.sum() else None


_APART_M = 0.02
"""Points of a link's surface that are looked for in the ground are about so far apart."""


_PATCH_M = 1e-3
"""A ball touches where it comes so near to the plane that it stands on."""


class LinksInGround:
    """Shapes of links over one ground.

    Shapes are where they are with R_WS and p_WS, (S, 3, 3), (S, 3).

    Arguments:
        points: whose hulls the shapes are, a shape each, (K, 3) [m].
        feet: the limb that touches with a shape, −1 for none.
        radii_m: radii of the limbs' feet.
    """

    def __init__(
        self, ground: Ground, points: Sequence[Array], feet: Sequence[int], radii_m: Array
    ) -> None:
        self.ground, self._feet = ground, np.array(feet)
        self._patches_m = np.sqrt(2.0 * radii_m * _PATCH_M) + _PATCH_M
        self._points, self._surfaces = points, dict[int, Array]()

    def _surface(self, shape: int) -> Array:
        """Points all over a shape that comes near to the ground, in its own frame, shape (P, 3)
        [m].
        """
        if shape not in self._surfaces:
            self._surfaces[shape] = surface_points(self._points[shape], _APART_M)
        return self._surfaces[shape]

    def depths(
        self, turns: Array, origins: Array, low: Array, high: Array, bodies: WholeBody
    ) -> Iterator[tuple[int, int, float]]:
        """Moments and shapes whose boxes, corners (T, S, 3), may be in the ground, and how deep
        they are, −inf of what is above [m]; of feet that stand on it what is outside the patch on
        which they touch.
        """
        tops = self.ground.tops(low.reshape(-1, 3), high.reshape(-1, 3)).reshape(low.shape[:2])
        near = low[..., 2] < tops
        for shape in np.flatnonzero(near.any(axis=0)).tolist():
            moments, limb = np.flatnonzero(near[:, shape]), int(self._feet[shape])
            points = (
                self._surface(shape) @ np.swapaxes(turns[moments, shape], 1, 2)
                + origins[moments, shape, None]
            )
            below = points[..., 2] < tops[moments, shape, None]
            if limb >= 0:
                apart = (
                    np.linalg.norm(points - bodies.toes_m[moments, None, limb], axis=2)
                    > self._patches_m[limb]
                )
                below &= apart | ~bodies.stands[moments, None, limb]
            depths = np.full(below.shape, -np.inf)
            depths[below] = self.ground.depth_inside(points[below])
            for t, depth in zip(moments.tolist(), depths.max(axis=1).tolist(), strict=True):
                yield t, shape, depth

    def depth(self, turns: Array, origins: Array, shape: int) -> float:
        """Depth of a shape in the ground [m]."""
        return float(
            self.ground.depth(self._surface(shape) @ turns[shape].T + origins[shape]).max()
        )
