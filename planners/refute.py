"""Independent check of infeasibility certificates: matrix-vector work, no solver.

All numbers here are non-dimensional: lengths over the length scale, forces over the force scale. For contact i let v_u
be the vertices of its patch, C_i its frame (eq. 3), μ its friction, B its force box, s its shoulder, ρ its reach; let w
be the weight. With multipliers ν_F, ν_M of the balances (eqs. 5, 6) and r_i of the reach (eq. 11), every posture that
meets all constraints except the moment balance, whose largest component is off by ε, has

    ν_F·(Σ C f − w e_z) + ν_M·(Σ q × C f − c × w e_z) + Σ [r·(q − c − s − Θ × s) − ρ‖r‖]  ≤  ‖ν_M‖₁ ε.

(The moment about c is Σ q × C f − c × w e_z because Σ C f = w e_z; q and c are in the world frame.) Where the smallest
value ℓ of the left side is positive, ε ≥ ℓ / ‖ν_M‖₁. It separates: a ball for c, a box for Θ, and for every contact the
least over the vertices v_u of r·v_u + min {a·f : f in B and in the friction cone}, a = Cᵀ(ν_F + ν_M × v_u).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import Array
from .outcome import Certificate, InvalidInput
from .scene import PostureProblem

SLACK = 1e-6
"""A certificate must also refute postures that break constraints by this much: ``check_posture`` accepts those."""
GUARD = 1e-12
"""Every leaf's bound is lowered by this share of its terms: far more than they can lose by rounding."""
MOST_CORNERS = 1_000_000
"""Of all pieces of all leaves of a certificate, each of which takes about a kilobyte to bound."""


@dataclass(frozen=True, kw_only=True)
class CertificateReport:
    """Whether a certificate refutes a problem.

    lower_bound: proved least moment residual (largest component over force scale times length scale), the worst leaf's;
    inf where the leaf needs no moment balance. weakest: that leaf, −1 without one. leaves: how many were checked.
    """

    accepted: bool
    lower_bound: float
    leaves: int
    weakest: int
    message: str

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; an infinite bound becomes null."""
        bound = self.lower_bound if math.isfinite(self.lower_bound) else None
        return {**vars(self), "lower_bound": bound}


def check_certificate(
    problem: PostureProblem, certificate: Certificate, *, tolerance: float = 1e-4
) -> CertificateReport:
    """Replay the certificate's tree and bound the moment residual at every leaf; never raises for a bad certificate.

    Accepted when every leaf's bound exceeds ``tolerance`` (non-dimensional moment, not below 0).
    """
    try:
        leaves = replay(problem, certificate)
    except InvalidInput as error:
        return CertificateReport(accepted=False, lower_bound=0.0, leaves=0, weakest=-1, message=f"rejected: {error}")
    bounds = leaf_bounds(numbers_of(problem), leaves)
    weakest = int(np.argmin(bounds))
    bound = float(bounds[weakest])
    accepted = bound > max(tolerance, 0.0)
    if not accepted:
        message = (
            f"rejected: leaf {weakest} of {len(bounds)} proves a residual of {bound:.3g}, expected above {tolerance:g}"
        )
    elif math.isinf(bound):
        message = f"refuted at all leaves ({len(bounds)}), even without the balance of moments"
    else:
        moment_nm = bound * problem.moment_scale_nm
        message = f"refuted at all leaves ({len(bounds)}): {moment_nm:.3g} Nm of moment or more are left over"
    return CertificateReport(accepted=accepted, lower_bound=bound, leaves=len(bounds), weakest=weakest, message=message)


def contact_frames(problem: PostureProblem) -> Array:
    """R_WC of every contact, columns n, y = z × n, z with z the shear reference in the patch, shape (N, 3, 3)."""
    n = np.array([contact.patch.normal for contact in problem.contacts])
    z = np.array([contact.patch.shear_reference for contact in problem.contacts])
    z = z - (z * n).sum(axis=1, keepdims=True) * n
    z /= np.sqrt((z * z).sum(axis=1, keepdims=True))
    frames = np.empty((len(n), 3, 3))
    frames[:, :, 0], frames[:, :, 1], frames[:, :, 2] = n, cross(z, n), z
    return frames


def cross(a: Array, b: Array) -> Array:
    """a × b along the last axis (``np.cross`` takes five times as long on a few vectors)."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0], out[..., 1], out[..., 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Numbers:
    """What the bounds need of a problem, non-dimensional, N contacts."""

    frames: Array  # (N, 3, 3)
    friction: Array  # (N,)
    reach: Array  # (N,)
    shoulders: Array  # (N, 3)
    com: Array  # (3,)
    com_radius: float
    tilt: float
    weight: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaves:
    """The leaves of a tree, M of them with V vertices in all, non-dimensional.

    pair: contact plus N times leaf of every vertex, ascending, shape (V,). sag: how far a toe may be off the pieces.
    """

    lower: Array  # (M, N, 3)
    upper: Array  # (M, N, 3)
    vertices: Array  # (V, 3)
    pair: NDArray[np.intp]  # (V,)
    sag: Array  # (M, N)
    multipliers: Array  # (M, 6 + 3N), the largest entry of each row ±1


def numbers_of(problem: PostureProblem) -> Numbers:
    """A problem in non-dimensional numbers, frames recomputed."""
    length = problem.length_scale_m
    return Numbers(
        frames=contact_frames(problem),
        friction=np.array([contact.patch.friction for contact in problem.contacts]),
        reach=np.array([contact.reach_m for contact in problem.contacts]) / length,
        shoulders=np.array([contact.shoulder_m for contact in problem.contacts]) / length,
        com=problem.com_nominal_m / length,
        com_radius=problem.com_radius_m / length,
        tilt=problem.tilt_limit_rad,
        weight=problem.weight_n * length / problem.moment_scale_nm,
    )


def replay(problem: PostureProblem, certificate: Certificate) -> Leaves:
    """Grow the tree from the problem's own patches and force boxes, so that the leaves cover. Raises InvalidInput."""
    tree, multipliers, count = certificate.tree, certificate.multipliers, len(problem.contacts)
    if tree.ndim != 2 or tree.shape[1] != 4 or multipliers.ndim != 2 or multipliers.shape[1] != 6 + 3 * count:
        raise InvalidInput(
            f"certificate: expected a tree of shape (K, 4) and multipliers of shape (leaves, {6 + 3 * count}), "
            f"got {tree.shape} and {multipliers.shape}"
        )
    if not (np.isfinite(tree).all() and np.isfinite(multipliers).all()):
        raise InvalidInput("certificate: expected finite numbers")
    roots = [contact.patch.vertices_m / problem.length_scale_m for contact in problem.contacts]
    sags = [sag(root) for root in roots]
    lower = np.array([contact.force_min for contact in problem.contacts])
    upper = np.array([contact.force_max for contact in problem.contacts])
    stack, leaves, corners = [(tuple(roots), lower, upper)], [], 0
    for row, (kind, contact, first, second) in enumerate(tree.tolist()):
        where = f"tree[{row}]"
        if not stack:
            raise InvalidInput(f"{where}: expected the end of the tree, got another node")
        pieces, lower, upper = stack.pop()
        if kind == 0:
            if contact or first or second:
                raise InvalidInput(f"{where}: expected zeros in a leaf")
            leaves.append((pieces, lower, upper))
            corners += sum(map(len, pieces))
            if corners > MOST_CORNERS:
                raise InvalidInput(f"{where}: expected {MOST_CORNERS} corners of pieces or fewer, got more")
            continue
        if kind not in (1, 2):
            raise InvalidInput(f"{where}: expected kind 0, 1 or 2, got {kind:g}")
        i = _index(contact, count, f"{where}: contact")
        if kind == 1:
            k = _index(first, 3, f"{where}: force component")
            if not lower[i, k] <= second <= upper[i, k]:
                raise InvalidInput(f"{where}: expected a force in [{lower[i, k]:g}, {upper[i, k]:g}], got {second:g}")
            below, above = upper.copy(), lower.copy()
            below[i, k] = above[i, k] = second
            stack += [(pieces, above, upper), (pieces, lower, below)]  # the first child is popped first
        else:
            if not 0.0 <= first < second < len(pieces[i]):
                raise InvalidInput(
                    f"{where}: expected border coordinates 0 ≤ a < b < {len(pieces[i])}, got {first:g}, {second:g}"
                )
            one, other = cut(pieces[i], first, second)
            for child in (other, one):
                stack.append(((*pieces[:i], child, *pieces[i + 1 :]), lower, upper))
    if stack:
        raise InvalidInput(f"tree: expected {len(stack)} more nodes or more after {len(tree)}")
    if len(leaves) != len(multipliers):
        raise InvalidInput(f"multipliers: expected a row for each of {len(leaves)} leaves, got {len(multipliers)}")
    largest = np.abs(multipliers).max(axis=1, keepdims=True)
    return Leaves(
        lower=np.array([leaf[1] for leaf in leaves]),
        upper=np.array([leaf[2] for leaf in leaves]),
        vertices=np.concatenate([piece for leaf in leaves for piece in leaf[0]]),
        pair=np.repeat(np.arange(len(leaves) * count), [len(piece) for leaf in leaves for piece in leaf[0]]),
        sag=np.array([[sags[i] * (leaf[0][i] is not roots[i]) for i in range(count)] for leaf in leaves]),
        multipliers=multipliers / np.where(largest > 0.0, largest, 1.0),
    )


def _index(value: float, count: int, where: str) -> int:
    if value != int(value) or not 0 <= value < count:
        raise InvalidInput(f"{where}: expected an integer in [0, {count}), got {value:g}")
    return int(value)


def cut(polygon: Array, first: float, second: float) -> tuple[Array, Array]:
    """Cut a convex polygon, shape (U, 3), along the chord between two border coordinates (see ``Certificate``)."""

    def point(coordinate: float) -> Array:
        e = int(coordinate)
        start = polygon[e]
        return np.asarray(start + (coordinate - e) * (polygon[(e + 1) % len(polygon)] - start))[None]

    begin, end = point(first), point(second)
    after_first, after_second = math.floor(first) + 1, math.floor(second) + 1  # corners strictly after each point
    before_first, before_second = math.ceil(first), math.ceil(second)
    return (
        np.concatenate([begin, polygon[after_first:before_second], end]),
        np.concatenate([end, polygon[after_second:], polygon[:before_first], begin]),
    )


def sag(polygon: Array) -> float:
    """Largest distance of a point of the convex hull from the pieces that any cuts leave; 0 for a triangle.

    Cut pieces of a flat convex polygon cover it. A polygon from a rounded file is neither, quite: its corners are off
    some flat convex polygon by a height and by up to a depth in the plane, and so is every point of hull and pieces.
    """
    if len(polygon) == 3:
        return 0.0
    centred = polygon - polygon.mean(axis=0)
    flat = centred @ np.linalg.svd(centred)[2].T
    x, y = flat[:, 0], flat[:, 1]
    around = np.sign(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))

    def turn(p: int, q: int, r: int) -> float:
        return float(around * ((x[q] - x[p]) * (y[r] - y[q]) - (y[q] - y[p]) * (x[r] - x[q])))

    kept, at = list(range(len(polygon))), 0
    while at < len(kept) and len(kept) > 3:
        if turn(kept[at - 1], kept[at], kept[(at + 1) % len(kept)]) < 0.0:
            del kept[at]
            at = max(at - 1, 0) if at < len(kept) else 0
        else:
            at += 1
    depth = 0.0
    for corner in set(range(len(polygon))).difference(kept):
        start = flat[max((k for k in kept if k < corner), default=kept[-1]), :2]
        edge = flat[min((k for k in kept if k > corner), default=kept[0]), :2] - start
        away = flat[corner, :2] - start
        share = np.clip(away @ edge / max(float(edge @ edge), 1e-300), 0.0, 1.0)
        depth = max(depth, float(np.linalg.norm(away - share * edge)))
    return float(np.ptp(flat[:, 2])) + 2.0 * depth


def leaf_bounds(numbers: Numbers, leaves: Leaves) -> Array:
    """Proved lower bound on the moment residual at every leaf, shape (M,); 0 where nothing is proved.

    Nothing is proved against postures within ``SLACK`` of the constraints, so that no problem has both an accepted
    posture and an accepted certificate.
    """
    with np.errstate(all="ignore"):  # absurd magnitudes end as NaN, which proves nothing
        value = _least_lagrangian(numbers, leaves, slack=0.0)
        proved = (value > 0.0) & (_least_lagrangian(numbers, leaves, slack=SLACK) > 0.0)
        bounds = np.where(proved, value / np.abs(leaves.multipliers[:, 3:6]).sum(axis=1), 0.0)
        return np.where(_misses_cone(leaves, numbers.friction).any(axis=1), np.inf, bounds)


def _least_lagrangian(numbers: Numbers, leaves: Leaves, slack: float) -> Array:
    """Least value ℓ of the Lagrangian over a leaf, every constraint widened by ``slack``, rounded down; shape (M,)."""
    count, w = len(numbers.friction), numbers.weight
    nu_F, nu_M = leaves.multipliers[:, :3], leaves.multipliers[:, 3:6]
    r = leaves.multipliers[:, 6:].reshape(-1, count, 3)
    v, pair = leaves.vertices, leaves.pair
    leaf, contact = np.divmod(pair, count)

    a = np.einsum("vjk,vj->vk", numbers.frames[contact], nu_F[leaf] + cross(nu_M[leaf], v))  # ν·(v × F) = (ν × v)·F
    lower, upper = leaves.lower.reshape(-1, 3)[pair], leaves.upper.reshape(-1, 3)[pair]
    work = least_work(a, lower, upper, numbers.friction[contact], slack=slack)
    starts = np.searchsorted(pair, np.arange(r.shape[0] * count))
    patches = np.minimum.reduceat(work + np.sum(r.reshape(-1, 3)[pair] * v, axis=1), starts).reshape(-1, count)

    pull = np.stack([w * nu_M[:, 1], -w * nu_M[:, 0], 0.0 * nu_M[:, 2]], axis=1) - r.sum(axis=1)  # −w e_z × ν_M − Σ r
    twist = cross(numbers.shoulders, r).sum(axis=1)
    length, torque = np.linalg.norm(r, axis=-1), np.linalg.norm(nu_M, axis=1)
    com_radius, tilt, reach = numbers.com_radius + slack, numbers.tilt + slack, numbers.reach + slack
    most = np.linalg.norm(np.maximum(np.abs(leaves.lower), np.abs(leaves.upper)), axis=-1) + 2.0 * slack  # ‖f‖, (M, N)
    off_patch = leaves.sag + slack
    com = float(np.linalg.norm(numbers.com)) + com_radius
    value = (
        patches.sum(axis=1)
        - w * nu_F[:, 2]
        + pull @ numbers.com - com_radius * np.linalg.norm(pull, axis=1)        # ‖c − c_nominal‖ ≤ com_radius
        - tilt * np.abs(twist).sum(axis=1)                                      # |Θ_k| ≤ tilt
        - np.sum(r * numbers.shoulders, axis=(1, 2)) - length @ reach           # ‖q − c − s − Θ × s‖ ≤ ρ
        - np.sum(off_patch * (length + torque[:, None] * most), axis=1)         # ‖q − Σ λ v‖ ≤ off_patch
        - slack * (np.linalg.norm(nu_F, axis=1) + torque * com)                 # ‖Σ C f − w e_z‖ ≤ slack
        - slack * torque                                                        # ‖moment about c‖ ≤ slack
    )  # fmt: skip

    far = np.maximum.reduceat(np.linalg.norm(v, axis=1), starts).reshape(-1, count)
    arm = np.linalg.norm(numbers.shoulders, axis=1) * (1.0 + 2.0 * tilt) + reach
    terms = (
        np.linalg.norm(nu_F, axis=1) * (w + most.sum(axis=1))
        + torque * (w * com + np.sum(far * most, axis=1))
        + np.sum(length * (far + com + arm), axis=1)
    )
    return np.asarray(value - GUARD * (1.0 + terms))


def _misses_cone(leaves: Leaves, friction: Array) -> NDArray[np.bool_]:
    """Where no force is within ``SLACK`` of both force box and friction cone: the leaf is empty, shape (M, N)."""
    nearest = np.linalg.norm(np.maximum(np.maximum(leaves.lower[..., 1:], -leaves.upper[..., 1:]), 0.0), axis=-1)
    most = friction * (leaves.upper[..., 0] + SLACK) + SLACK  # largest shear
    return np.asarray((most < 0.0) | (nearest > most + 1.5 * SLACK))


def least_work(a: Array, lower: Array, upper: Array, friction: Array, *, slack: float = 0.0) -> Array:
    """Proved lower bound on min {a·f : lower ≤ f ≤ upper, ‖(f_y, f_z)‖ ≤ μ f_n} for each of V rows, shape (V,).

    a, lower, upper: shape (V, 3), in the contact frame; friction: shape (V,); slack: widens every inequality.
    By duality every κ in the plane gives the bound min {(a_n − μ‖κ‖) f_n + (a_t − κ)·f_t : f in the box}, a concave
    function of κ. Its maximum lies at 0, on a line κ_y = a_y or κ_z = a_z, or on the circle μ‖κ‖ = a_n: where two of
    these meet or where it is stationary on one. All such points are tried and none is trusted: rounding and degenerate
    boxes can only lower the result.
    """
    mu, (an, ay, az) = friction[:, None], (a[:, k : k + 1] for k in range(3))
    low = np.where(mu > 0.0, np.maximum(lower[:, :1], 0.0), lower[:, :1])  # the cone has f_n ≥ 0
    high = np.maximum(upper[:, :1], 0.0)
    y, z = np.stack([lower[:, 1:], upper[:, 1:]], axis=2).swapaxes(0, 1)  # the two bounds of each shear, (V, 2) each
    cone = mu * np.concatenate([low, high], axis=1)  # largest shear at either end of f_n
    circle = np.maximum(an, 0.0) / np.maximum(mu, 1e-12)

    def along(fixed: Array, bounds: Array) -> Array:
        """The other coordinate of κ on the line where one is ``fixed``: four stationary points, two on the circle."""
        steep = cone[:, :, None] ** 2 - bounds[:, None, :] ** 2
        stationary = -np.abs(fixed)[..., None] * bounds[:, None, :] / np.sqrt(np.maximum(steep, 1e-14))
        meet = np.sqrt(np.maximum(circle**2 - fixed**2, 0.0))
        return np.concatenate([stationary.reshape(-1, 4), meet, -meet], axis=1)

    corner_y, corner_z = y[:, [0, 0, 1, 1]], z[:, [0, 1, 0, 1]]
    outward = -circle / np.maximum(np.hypot(corner_y, corner_z), 1e-12)
    six, zero = np.ones((1, 6)), np.zeros_like(an)
    ky = np.concatenate([zero, ay, ay * six, along(az, y), outward * corner_y], axis=1)  # (V, 18)
    kz = np.concatenate([zero, az, along(ay, z), az * six, outward * corner_z], axis=1)
    k = np.hypot(ky, kz)
    dn, dy, dz = an - mu * k, ay - ky, az - kz
    value = (
        np.minimum(dn * low, dn * high)
        + np.minimum(dy * y[:, :1], dy * y[:, 1:])
        + np.minimum(dz * z[:, :1], dz * z[:, 1:])
    )
    size = cone[:, 1:] + np.abs(y).max(axis=1, keepdims=True) + np.abs(z).max(axis=1, keepdims=True)
    value -= 1e-14 * k * size  # far more than is lost by rounding where κ is large
    if slack:
        pulling = np.minimum(slack / np.maximum(mu, 1e-300), low - lower[:, :1])  # f_n ≥ −slack / μ
        value -= slack * (k + np.abs(dn) + np.abs(dy) + np.abs(dz)) + pulling * np.abs(dn)
    return np.asarray(value.max(axis=1))
