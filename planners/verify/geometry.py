"""Geometry that the verifier works out for itself: contact frames, distances from patches, cuts of
polygons, half-spaces of reach.

Half-spaces of reach, as the verifier works them out: (a + Θ × a)·(p_w − c) ≤ b, the rotation as
that of the ball.

*Of a certificate.* Multipliers σ ≥ 0 of a limb's half-spaces at a frame, α = Σ σ a, add to the left
side of ``lagrangian`` Σ σ ((a + Θ × a)·(q − c) − b) = (α + Θ × α)·(q − c) − Σ σ b. With d = q − c −
s that is

    α·(q − c) + Θ·(α × s) − Σ σ b + Θ·(α × d),

the first two of which have the form of those of r. By the ball ‖d‖ ≤ ρ + ‖Θ × s‖, so the last one
is at least −t(α) (ρ + t(s)), t(x) the largest ‖Θ × x‖ in the box of Θ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import Plan
from ..files.arrays import Array, cross, lengths
from ..problem.contact import Contact
from ..robot.model import Limb, Robot
from ..terrain.patch import FOR_BODIES_M, Certainty, Patch
from ..terrain.polygon import half_planes, signed_area
from .margins import borne_share, stance_margins, verdict_yields_m

_FLAT = 1e-12
"""A polygon whose corners leave its plane by less than this share of its size is the fan of its
triangles."""


_FOLLOWING = np.array([1, 2, 0])
"""The corner of a triangle after each."""


def exact_and_linear(rotation: Array, vectors: Array) -> tuple[Array, Array]:
    """exp([Θ]×) v by Rodrigues' formula and (I + [Θ]×) v; shapes (..., 3) each that go together."""
    angle = lengths(rotation)
    flat = np.maximum(angle, 1e-12)
    sine = np.where(angle < 1e-12, 1.0, np.sin(angle) / flat)
    versine = np.where(angle < 1e-6, 0.5, (1.0 - np.cos(angle)) / flat**2)
    once = cross(rotation, vectors)
    return vectors + sine[..., None] * once + versine[..., None] * cross(
        rotation, once
    ), vectors + once


def contact_frames(normals: Array, references: Array) -> Array:
    """R_WC of every contact, columns n, y = z × n, z with z the shear reference in the patch (E3).

    Arguments:
        normals, references: unit normals and shear references, shape (..., 3).

    Returns:
        Shape (..., 3, 3).
    """
    n = normals
    z = references - np.vecdot(references, n)[..., None] * n
    z /= lengths(z)[..., None]
    frames = np.empty((*n.shape, 3))
    frames[..., 0], frames[..., 1], frames[..., 2] = n, cross(z, n), z
    return frames


def patch_distances(polygons: list[Array], toes: Array) -> Array:
    """Distance of every toe from the convex hull of its patch's vertices (E1).

    Returns shape (K,) [m]. A flat convex polygon is the fan of its triangles. The corners of a
    rounded file span a thin body, and where a toe is off the fan of such, its distance is that from
    the body's nearest point.

    Arguments:
        polygons: one a toe, shape (U, 3) [m] each.
        toes: shape (K, 3) [m].
    """
    counts = [len(polygon) for polygon in polygons]
    if set(counts) == {3}:
        return triangle_distances(np.array(polygons), toes)
    distances = np.empty(len(polygons))
    for count in set(counts):
        rows = np.flatnonzero(np.array(counts) == count)
        corners, points = np.array([polygons[row] for row in rows]), toes[rows]
        fan = np.empty((len(rows), count - 2, 3, 3))
        fan[:, :, 0], fan[:, :, 1], fan[:, :, 2] = corners[:, :1], corners[:, 1:-1], corners[:, 2:]
        each = triangle_distances(fan.reshape(-1, 3, 3), np.repeat(points, count - 2, axis=0))
        result = each.reshape(-1, count - 2).min(axis=1)
        off = np.flatnonzero(result > 1e-12) if count > 3 else np.zeros(0, dtype=np.intp)
        for k in off[_bent(corners[off])] if len(off) else off:
            result[k] = min(result[k], hull_distance(corners[k], points[k]))
        distances[rows] = result
    return distances


def triangle_distances(triangles: Array, points: Array) -> Array:
    """Distance of points, shape (T, 3), from triangles, shape (T, 3, 3); shape (T,)."""
    edges = triangles.take(_FOLLOWING, axis=1) - triangles
    away = points[:, None] - triangles
    normals = cross(edges[:, 0], edges[:, 1])
    sides = np.vecdot(
        cross(edges, away), normals[:, None]
    )  # all ≥ 0 above the inside, either way round
    areas = np.vecdot(normals, normals)
    heights = np.vecdot(away[:, 0], normals)
    above = (sides.min(axis=1) >= 0.0) & (areas > 0.0)
    squares = heights * heights / np.maximum(areas, 1e-300)
    if not above.all():
        share = np.vecdot(away, edges) / np.maximum(np.vecdot(edges, edges), 1e-300)
        to_border = away - np.minimum(np.maximum(share, 0.0), 1.0)[:, :, None] * edges
        squares = np.where(above, squares, np.vecdot(to_border, to_border).min(axis=1))
    return np.asarray(np.sqrt(squares))


def hull_distance(vertices: Array, point: Array) -> float:
    """Distance of a point from the convex hull of points in space, shape (U, 3), never too small.

    By least-distance programming (Lawson and Hanson, Solving Least Squares Problems, ch. 23): the
    non-negative least squares of [(v_u − p)ᵀ; 1] λ = (0, 1) has the shares of the nearest point, up
    to a factor. What is returned is the distance of that combination of the vertices, whatever the
    method says of it. Cost grows with U, not with its cube.
    """
    from scipy.optimize import nnls  # costs as much to import as everything else here

    away = vertices - point
    size = float(np.abs(away).max())
    if size == 0.0:
        return 0.0
    try:
        shares, _ = nnls(
            np.vstack([away.T / size, np.ones(len(away))]), np.array([0.0, 0.0, 0.0, 1.0])
        )
    except RuntimeError:  # too many steps: any combination is an upper bound
        shares = np.ones(len(away))
    total = float(shares.sum())
    return float(lengths(shares @ away)) / total if total > 0.0 else math.inf


def _bent(corners: Array) -> NDArray[np.bool_]:
    """Tell which polygons, shape (G, U, 3), are not flat and convex to the last digits, shape
    (G,).
    """
    from_mean = corners - corners.mean(axis=1, keepdims=True)
    edges = np.roll(from_mean, -1, axis=1) - from_mean
    size = np.abs(from_mean).max(axis=(1, 2))
    normals = cross(from_mean, edges).sum(axis=1)
    normals /= np.maximum(lengths(normals), 1e-300)[:, None]
    heights = np.abs(np.vecdot(from_mean, normals[:, None])).max(axis=1)
    turns = np.vecdot(cross(np.roll(edges, 1, axis=1), edges), normals[:, None]).min(axis=1)
    return np.asarray((heights > _FLAT * size) | (turns < -_FLAT * size * size))


def cut(polygon: Array, first: float, second: float) -> tuple[Array, Array]:
    """Cut a convex polygon along the chord between two border coordinates (see ``Certificate``).

    Arguments:
        polygon: corners in order, shape (U, 3). first < second: k + s is the point s of the way
            from corner k to the next.

    Returns:
        Both parts, the one between the two points first.
    """

    def point(coordinate: float) -> Array:
        e = int(coordinate)
        start = polygon[e]
        return np.asarray(start + (coordinate - e) * (polygon[(e + 1) % len(polygon)] - start))[
            None
        ]

    begin, end = point(first), point(second)
    after_first, after_second = (
        math.floor(first) + 1,
        math.floor(second) + 1,
    )  # corners strictly after each point
    before_first, before_second = math.ceil(first), math.ceil(second)
    return (
        np.concatenate([begin, polygon[after_first:before_second], end]),
        np.concatenate([end, polygon[after_second:], polygon[:before_first], begin]),
    )


def sag(polygon: Array) -> float:
    """Largest distance of a point of the convex hull from the pieces that any cuts leave; 0 for a
    triangle.

    Cut pieces of a flat convex polygon cover it. A polygon from a rounded file is neither, quite:
    its corners are off some flat convex polygon by a height and by up to a depth in the plane, and
    so is every point of hull and pieces.
    """
    if len(polygon) <= 3:
        return 0.0
    centred = polygon - polygon.mean(axis=0)
    flat = centred @ np.linalg.svd(centred, full_matrices=False)[2].T
    x, y = flat[:, :2].T
    around = np.sign(signed_area(flat[:, :2]))

    def turn(p: int, q: int, r: int) -> float:
        return float(around * ((x[q] - x[p]) * (y[r] - y[q]) - (y[q] - y[p]) * (x[r] - x[q])))

    corners, at = list(range(len(polygon))), 0
    while at < len(corners) and len(corners) > 3:
        if turn(corners[at - 1], corners[at], corners[(at + 1) % len(corners)]) < 0.0:
            del corners[at]
            at = max(at - 1, 0) if at < len(corners) else 0
        else:
            at += 1
    depth = 0.0
    for corner in set(range(len(polygon))).difference(corners):
        start = flat[max((k for k in corners if k < corner), default=corners[-1]), :2]
        edge = flat[min((k for k in corners if k > corner), default=corners[0]), :2] - start
        away = flat[corner, :2] - start
        share = np.clip(away @ edge / max(float(edge @ edge), 1e-300), 0.0, 1.0)
        depth = max(depth, float(np.linalg.norm(away - share * edge)))
    return float(np.ptp(flat[:, 2])) + 2.0 * depth


_THICK_M = 1e-3
"""A toe so far from the terrain stands on it, as in walks [m]: rounded files, merged facets."""
_SAME_WAY = float(np.cos(0.02))
"""Cosine between normals of a foothold and of the terrain under it: more than a mesh's facets
differ, 1 % of a cone."""
_ROUGHER = 1e-9
"""Of friction: what rounding makes of it."""
_AROUND, FAR_M = 64, 0.3
"""Ways from a toe along which the border of its surface is looked for, and how far [m]."""


def off_terrain(terrain: Sequence[Patch], patches: Sequence[Patch], toes: Array) -> Array:
    """Distance of every toe from terrain that is as rough as its patch and faces as it does, beyond
    ``_THICK_M``; on a map, from where a surface is known, which goes on for bodies to keep out of,
    and of the surfaces near by from the one that it is nearest to so.

    Arguments:
        patches: the one that each toe chose.
        toes: shape (P, 3) [m].

    Returns:
        Shape (P,) [m], inf where there is none.
    """
    distances = np.full(len(toes), np.inf)
    if not terrain:
        return distances
    normals, friction = (
        np.array([patch.normal for patch in terrain]),
        np.array([patch.friction for patch in terrain]),
    )
    carries = np.array(
        [each.certainty is None or each.certainty.wider_m < FOR_BODIES_M for each in terrain]
    )
    low = np.array([patch.vertices_m.min(axis=0) for patch in terrain])
    high = np.array([patch.vertices_m.max(axis=0) for patch in terrain])
    near = list[list[int]]()
    for patch, toe in zip(patches, toes, strict=True):
        bears = carries & (normals @ patch.normal >= _SAME_WAY)
        bears &= friction >= patch.friction - _ROUGHER
        about = np.where(
            bears,
            lengths(np.maximum(low - toe, 0.0) + np.maximum(toe - high, 0.0)),
            np.inf,
        )
        most = max(_THICK_M, float(about.min()))
        near.append(np.flatnonzero(bears & (about <= most)).tolist())
    counts, surface = [len(each) for each in near], cache(partial(_surface_of, terrain))
    gaps = patch_distances(
        [terrain[i].vertices_m for each in near for i in each], np.repeat(toes, counts, axis=0)
    )
    for p, off in enumerate(np.split(np.maximum(0.0, gaps - _THICK_M), np.cumsum(counts)[:-1])):
        for k in np.argsort(off, kind="stable").tolist():
            if off[k] >= distances[p]:
                break
            if (sure := terrain[near[p][k]].certainty) is not None:
                off[k] = max(off[k], -_inside_m(surface(near[p][k]), toes[p], sure.wider_m))
            distances[p] = min(distances[p], off[k])
    return distances


def certainty_under(
    terrain: Sequence[Patch], patch: Patch, toe: Array
) -> tuple[Certainty, float] | None:
    """The terrain's certainty of the surface that a toe stands on, and the distance of the toe
    inside of where the surface's edge most likely is [m]; None where it does not say so.
    """
    near = [
        (gap, i)
        for i, other in enumerate(terrain)
        if other.certainty is not None
        and not other.certainty.exact
        and other.normal @ patch.normal >= _SAME_WAY
        and abs(gap := float(other.normal @ (toe - other.vertices_m[0]))) <= _THICK_M
        and (gap := float(patch_distances([other.vertices_m], toe[None])[0])) <= _THICK_M
    ]
    if not near:
        return None
    _, first = min(near)
    sure = terrain[first].certainty
    assert sure is not None
    return sure, _inside_m(_surface_of(terrain, first), toe, sure.wider_m)


def _inside_m(surface: Any, toe: Array, wider_m: float) -> float:
    """Distance of a toe inside of where its surface's edge most likely is [m], at most ``FAR_M``.

    Arguments:
        surface: its pieces, see ``_surface_of``.
        toe: in one of them, shape (3,) [m].
        wider_m: how far the pieces reach beyond that edge.
    """
    axes, normals, offsets, along, firsts = surface
    with np.errstate(divide="ignore", invalid="ignore"):
        reached = (offsets - normals @ (toe @ axes))[:, None] / along
    begin = np.maximum.reduceat(np.where(along < 0.0, reached, -np.inf), firsts)
    end = np.minimum.reduceat(np.where(along > 0.0, reached, np.inf), firsts)
    out, before = np.zeros(_AROUND), np.ones(_AROUND)
    while not np.array_equal(out, before):
        before, meets = out, (begin <= out + _THICK_M) & (begin <= end)
        out = np.maximum(out, np.max(np.where(meets, end, 0.0), axis=0))
    return min(float(out.min()), max(FAR_M, wider_m)) - wider_m


def _surface_of(terrain: Sequence[Patch], first: int) -> Any:
    """The surface that a patch is a piece of: axes of its plane, shape (3, 2), and the half-planes
    of all pieces along them, how they face the ways from a toe, shape (H, _AROUND), and the first
    of every piece.
    """
    patch, angles = terrain[first], np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    axes = patch.frame[:, 1:]
    pieces = [half_planes(each.vertices_m @ axes) for each in terrain if _same_surface(patch, each)]
    normals, offsets = map(np.concatenate, zip(*pieces, strict=True))
    firsts = np.cumsum([0, *(len(each) for _, each in pieces[:-1])])
    return axes, normals, offsets, normals @ [np.cos(angles), np.sin(angles)], firsts


def _same_surface(one: Patch, other: Patch) -> bool:
    """Tell whether two patches are pieces of one surface of a map."""
    if one.certainty is None or other.certainty is None:
        return one is other
    return bool(
        np.array_equal(one.certainty.about_m, other.certainty.about_m)
        and np.array_equal(one.certainty.covariance, other.certainty.covariance)
        and one.normal @ other.normal >= 1.0 - 1e-9
        and abs(one.normal @ (other.vertices_m[0] - one.vertices_m[0])) <= _THICK_M
    )


_POINTS_SUM = 1e-9
"""Forces at the points of a foot add up to the foot's, up to this share of the largest."""


def sole_points(sole_m: Array | None, patch: Patch, yaw_rad: float) -> Array:
    """Vectors from the toe to the points that bear forces, shape (K, 3) [m]; zero for a point foot.

    Forward is z of the contact frame (E3) turned by the yaw about the normal n; left is n ×
    forward.
    """
    if sole_m is None:
        return np.zeros((1, 3))
    n, _, z = contact_frames(patch.normal, patch.shear_reference).T
    ahead = math.cos(yaw_rad) * z + math.sin(yaw_rad) * cross(n, z)
    return np.asarray(sole_m[:, :1] * ahead + sole_m[:, 1:] * cross(n, ahead))


def off_sole(patch: Patch, region: Patch, offsets: Array, toe: Array, claimed: Array) -> float:
    """The farthest of: the centre from where it may be, a point from the patch, a point from where
    it is claimed [m].

    Arguments:
        claimed: shape (K, 3) or longer; what comes after the points is the centre.
    """
    points = np.concatenate(
        [toe + offsets, np.repeat(toe[None], len(claimed) - len(offsets), axis=0)]
    )
    centre = float(patch_distances([region.vertices_m], toe[None])[0])
    off = patch_distances([patch.vertices_m] * len(offsets), points[: len(offsets)])
    return max(centre, float(off.max()), float(lengths(claimed - points).max()))


def counts_of(limbs: tuple[Limb, ...] | tuple[Contact, ...]) -> tuple[int, ...]:
    """Number of points per foot; () where all have one."""
    counts = tuple(1 if limb.sole_m is None else len(limb.sole_m) for limb in limbs)
    return counts if max(counts) > 1 else ()


def forces_defect(whole: Array, points: Array, counts: tuple[int, ...]) -> str:
    """Fault of forces at points, shape (..., N, K, 3), of feet with forces (..., N, 3); empty if
    nothing.
    """
    with np.errstate(all="ignore"):  # absurd magnitudes are no sum, either
        most = float(np.abs(whole).max(initial=0.0) + np.abs(points).max(initial=0.0))
        off = float(np.abs(points.sum(axis=-2) - whole).max(initial=0.0))
    if not off <= _POINTS_SUM * most or math.isinf(most):
        return "point_forces_n: expected forces that add up to forces_n"
    if points[..., np.arange(points.shape[-2]) >= np.array(counts)[:, None], :].any():
        return "point_forces_n: expected zeros after the points of a foot"
    return ""


_Limbs = Sequence[Limb | Contact]


def row_counts(limbs: _Limbs) -> tuple[int, ...]:
    """Number of half-spaces of reach that each limb has."""
    return tuple(0 if limb.reach_rows is None else len(limb.reach_rows.bounds_m) for limb in limbs)


def reach_rows(limbs: _Limbs) -> tuple[Array, Array] | None:
    """Half-spaces of reach, normals (N, R, 3) and bounds (N, R) [m], with such that hold always
    where one has fewer.

    None where there are none.
    """
    counts = row_counts(limbs)
    if not any(counts):
        return None
    normals, bounds = (
        np.zeros((len(limbs), max(counts), 3)),
        np.full((len(limbs), max(counts)), math.inf),
    )
    for i, limb in enumerate(limbs):
        if limb.reach_rows is not None:
            normals[i, : counts[i]], bounds[i, : counts[i]] = (
                limb.reach_rows.normals,
                limb.reach_rows.bounds_m,
            )
    return normals, bounds


def beyond(ball: Array, rotation: Array, legs: Array, rows: tuple[Array, Array] | None) -> Array:
    """Distances by which K toes are out of reach [m], shape (K,): of the ball, or of (a + Θ ×
    a)·(p_w − c) ≤ b.

    Arguments:
        ball: out of it.
        rotation: Θ.
        legs: p_w − c; shape (K, 3) each.
        rows: of each, as ``reach_rows`` has them.
    """
    if rows is None:
        return ball
    normals, bounds = rows
    turned = normals + cross(rotation[:, None], normals)
    return np.asarray(np.maximum(ball, (np.vecdot(turned, legs[:, None]) - bounds).max(axis=1)))


def bowed(rotation: Array, legs: Array, rows: tuple[Array, Array]) -> Array:
    """The most that toes which stay are beyond their half-spaces on a straight way of the body [m],
    shape (K,).

    A row at the share t is (1 − t) g₀ + t g₁ − q t (1 − t) with q = (ΔΘ × a)·Δ(p_w − c), largest
    between the ends where q is negative.

    Arguments:
        rotation: Θ at either end, (2, 3).
        legs: p_w − c, (2, K, 3).
        rows: as ``reach_rows`` has them.
    """
    normals, bounds = rows
    start, end = (
        np.vecdot(normals + cross(theta, normals), leg[:, None]) - bounds
        for theta, leg in zip(rotation, legs, strict=True)
    )
    q = np.minimum(
        np.vecdot(cross(rotation[1] - rotation[0], normals), (legs[1] - legs[0])[:, None]), -1e-300
    )
    with np.errstate(invalid="ignore"):  # half-spaces that hold always
        share = np.clip(0.5 - 0.5 * (end - start) / q, 0.0, 1.0)
        most = (1.0 - share) * start + share * end - q * share * (1.0 - share)
    return np.asarray(np.fmax(most, -math.inf).max(axis=1))


def scaled_half_spaces(limbs: Sequence[_Limbs], lengths: Array) -> dict[str, Array]:
    """The half-spaces of reach of Q problems.

    Arguments:
        lengths: their length scales.
    """
    rows = [
        [limb.reach_rows for limb in each_limb if limb.reach_rows is not None]
        for each_limb in limbs
    ]
    if not rows[0]:
        return {"row_normals": np.zeros((len(rows), 0, 3)), "row_bounds": np.zeros((len(rows), 0))}
    bounds = np.array([np.concatenate([part.bounds_m for part in each_limb]) for each_limb in rows])
    normals = np.array([np.concatenate([part.normals for part in each_limb]) for each_limb in rows])
    return {"row_normals": normals, "row_bounds": bounds / lengths[:, None]}


def relative_rows(robot: Robot, holds: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array, Array]:
    """Half-spaces a·(p_other − p_limb) ≤ b of feet, wherever the limb has just been put down.

    Arguments:
        holds: the foothold under each limb at each frame, (M, N).

    Returns:
        Of each row the footholds of the limb and of the other, (L, 2), and a, (L, 3), and b, (L,)
        [m].
    """
    names, feet, normals, bounds = robot.limb_names, [], [np.zeros((0, 3))], [np.zeros(0)]
    for before, after in pairwise(holds):
        for pair in robot.relative_reach:
            limb, other = names.index(pair.limb), names.index(pair.other)
            if before[limb] != after[limb]:
                feet += [(after[limb], after[other])] * len(pair.rows.bounds_m)
                normals.append(pair.rows.normals)
                bounds.append(pair.rows.bounds_m)
    return (
        np.array(feet, dtype=np.intp).reshape(-1, 2),
        np.concatenate(normals),
        np.concatenate(bounds),
    )


def most_turned(vectors: Array) -> Array:
    """t(x), the largest ‖Θ × x‖ over |Θ_i| ≤ 1, shape (…, 3) to (…)."""
    corners = np.array([[1.0, y, z] for y in (1.0, -1.0) for z in (1.0, -1.0)])  # or opposite ones
    return np.asarray(lengths(cross(corners, vectors[..., None, :])).max(axis=-1))


LEAST_PUSH = 0.01
"""Share of the weight that a push has which every stance of a plan for a robot's own legs bears, or
it is not accepted: simulated, plans below it fall, and most of those above stand."""


def tipping(plan: Plan, share: float = LEAST_PUSH) -> str:
    """Why a plan for a robot's own legs is about to tip though the verifier accepts it; empty where
    it is not.

    Arguments:
        plan: plan of any robot; those without legs of their own file are not judged.
        share: push that every stance has to bear, as a share of the weight; 0 for none.
    """
    course = plan.problem
    if not course.robot.own or course.uncarried or share <= 0.0:
        return ""
    yields_m, least_n = verdict_yields_m(plan), share * course.weight_n
    if borne_share(plan, (share,), yields_m):
        return ""
    pushes_n = stance_margins(plan, ("push_n",), yields_m=yields_m)["push_n"]
    weakest, push_n = course.stances[int(pushes_n.argmin())], float(pushes_n.min())
    if push_n >= least_n:
        return ""
    limbs = " ".join(course.robot.limb_names[limb] for limb in weakest.limbs)
    return (
        f"margin: {limbs} at frame {weakest.frame} bear a push of "
        f"{round(push_n, 2):g} N, "
        f"expected {round(least_n, 2):g} N or more, {100.0 * share:.2g} % of the weight"
    )
