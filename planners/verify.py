"""The independent verifier of postures: it knows the problem and the posture, not how the posture was made.

It recomputes contact frames, rotation, balances, cones and reach from the problem's own numbers. ``refute`` does the
same for proofs that there is no posture.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .arrays import Array
from .explain import Explanation, Relaxation, explain
from .outcome import Certificate, Posture
from .refute import CertificateReport, check_certificate, contact_frames, cross
from .scene import PostureProblem

__all__ = [
    "GROUPS",
    "CertificateReport",
    "Explanation",
    "GroupViolation",
    "Relaxation",
    "Report",
    "check_certificate",
    "check_certificates",
    "check_posture",
    "check_postures",
    "explain",
]

GROUPS = {
    "patch": "m",
    "force_balance": "N",
    "moment_balance": "Nm",
    "friction": "N",
    "force_bounds": "N",
    "reach": "m",
    "tilt": "rad",
    "com": "m",
}
"""The groups of constraints in the order of a report, and the unit of what is violated."""
LARGEST_UNIT_M = 1.0
"""Violations are measured in the problem's scales, but in no more than this length and the robot's weight: a file that
claims huge scales buys no tolerance with them."""


@dataclass(frozen=True, slots=True)
class GroupViolation:
    """The worst violation in one group of constraints.

    worst: non-dimensional, 0 when satisfied, inf for a posture that is no posture. value: the same in ``unit`` (SI).
    where: the leg, "leg component" (force_bounds) or world axis, empty for the whole body. index: of the leg or axis.
    """

    group: str
    worst: float
    value: float
    unit: str
    where: str
    index: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Report:
    """What the verifier says of one posture.

    worst: largest non-dimensional violation of all groups; accepted: it is at most ``tolerance``.
    residual_nm: norm of the net moment about the COM [Nm].
    """

    accepted: bool
    worst: float
    groups: tuple[GroupViolation, ...]
    residual_nm: float
    tolerance: float
    problem: PostureProblem = field(repr=False)
    posture: Posture = field(repr=False)
    defect: str = ""
    """Why the posture could not be checked at all; empty when it could."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of problem, posture, tolerance and verdict as canonical JSON: what the runner asks for."""
        content = {
            "problem": self.problem.to_json(),
            "posture": self.posture.to_json(),
            "tolerance": self.tolerance,
            "accepted": self.accepted,
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()

    @property
    def message(self) -> str:
        """One line: the verdict, the worst group, where and by how much."""
        verdict = "accepted" if self.accepted else "rejected"
        if self.defect:
            return f"{verdict}: {self.defect}"
        group = max(self.groups, key=lambda g: g.worst)
        if group.worst == 0.0:
            return f"{verdict}: no constraint is violated"
        where = f" ({group.where})" if group.where else ""
        return f"{verdict}: worst is {group.group}{where}, off by {group.value:.3g} {group.unit}"

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; what is not finite becomes null."""
        return {
            "accepted": self.accepted,
            "worst": _or_null(self.worst),
            "tolerance": _or_null(self.tolerance),
            "residual_nm": _or_null(self.residual_nm),
            "message": self.message,
            "digest": self.digest,
            "groups": [
                {
                    "group": g.group,
                    "worst": _or_null(g.worst),
                    "value": _or_null(g.value),
                    "unit": g.unit,
                    "where": g.where,
                    "index": g.index,
                }
                for g in self.groups
            ],
        }


def check_posture(problem: PostureProblem, posture: Posture, *, tolerance: float = 1e-6) -> Report:
    """Check every constraint of the problem at the posture; never raises for a bad posture.

    tolerance: largest violation allowed in any group, with lengths in the length scale, forces in the force scale,
    moments in their product and angles in rad. The two balances are judged by the Euclidean norm of what is left over.
    """
    defect = _defect(problem, posture)
    if defect:
        return _refused(problem, posture, tolerance, defect)
    with np.errstate(all="ignore"):
        report = _measured(problem, posture, tolerance)
    return report if math.isfinite(report.worst) else _refused(problem, posture, tolerance, "the numbers overflow")


def check_postures(problems: Sequence[PostureProblem], postures: Sequence[Posture]) -> Array:
    """The ``worst`` of ``check_posture`` for many at once, shape (B,)."""
    return np.array([check_posture(*pair).worst for pair in zip(problems, postures, strict=True)])


def check_certificates(problems: Sequence[PostureProblem], certificates: Sequence[Certificate]) -> Array:
    """The ``lower_bound`` of ``check_certificate`` for many at once, shape (B,)."""
    return np.array([check_certificate(*pair).lower_bound for pair in zip(problems, certificates, strict=True)])


def _measured(problem: PostureProblem, posture: Posture, tolerance: float) -> Report:
    contacts, legs = problem.contacts, problem.legs
    scale = problem.moment_scale_nm / problem.length_scale_m
    length, force = min(problem.length_scale_m, LARGEST_UNIT_M), min(scale, problem.weight_n)
    c, theta, toes, forces = posture.com_m, posture.rotation_rad, posture.toes_m, posture.forces_n
    arms = toes - c
    shoulders = np.array([contact.shoulder_m for contact in contacts])
    groups: list[GroupViolation] = []

    def add(violations: Array, unit_scale: float, names: tuple[str, ...], columns: tuple[str, ...] = ("",)) -> None:
        """Note the worst of the violations [SI] of the next group, rows by name and columns."""
        at = int(violations.argmax())
        value = max(float(violations.flat[at]), 0.0)
        row, column = divmod(at, len(columns))
        group, unit = group_units[len(groups)]
        groups.append(GroupViolation(group, value / unit_scale, value, unit, names[row] + columns[column], row))

    def add_norm(vector: Array, unit_scale: float, names: tuple[str, ...]) -> float:
        """Note the norm of a balance [SI] under its worst axis."""
        size = math.sqrt(float(vector @ vector))
        at = int(np.abs(vector).argmax())
        group, unit = group_units[len(groups)]
        groups.append(GroupViolation(group, size / unit_scale, size, unit, names[at], at))
        return size

    group_units = tuple(GROUPS.items())
    axes = ("x", "y", "z")
    add(_patch_distances(problem, toes), length, legs)
    net = forces.sum(axis=0)
    net[2] -= problem.weight_n
    # fmt: off
    add_norm(net, force, axes)                                                     # Σ f + m g = 0            (5)
    residual_nm = add_norm(cross(arms, forces).sum(axis=0), force * length, axes)  # Σ (p_w − c) × f = 0      (6)
    f = (forces[:, None, :] @ contact_frames(problem))[:, 0, :]                    # f_n, f_y, f_z [N]        (3)
    friction = np.array([contact.patch.friction for contact in contacts])
    shear = f[:, 1:]
    add(np.sqrt((shear * shear).sum(axis=1)) - friction * f[:, 0], force, legs)    # ‖f_t‖ ≤ μ f_n           (10)
    least = scale * np.array([contact.force_min for contact in contacts])
    most = scale * np.array([contact.force_max for contact in contacts])
    add(np.maximum(least - f, f - most), force, legs, (" n", " y", " z"))          # f_min ≤ f ≤ f_max
    to_toe = arms - shoulders - cross(theta, shoulders)                            # p_w − c − (I + [Θ]×) v  (11)
    reach = np.array([contact.reach_m for contact in contacts])
    add(np.sqrt((to_toe * to_toe).sum(axis=1)) - reach, length, legs)              # ‖·‖ ≤ reach             (11)
    add(np.abs(theta) - problem.tilt_limit_rad, 1.0, axes)                         # |Θ_i| ≤ tilt limit
    # fmt: on
    off = c - problem.com_nominal_m
    add(np.array([math.sqrt(float(off @ off)) - problem.com_radius_m]), length, ("",))
    worst = max(group.worst if group.worst == group.worst else math.inf for group in groups)
    return Report(
        accepted=worst <= tolerance, worst=worst, groups=tuple(groups), residual_nm=residual_nm,
        tolerance=tolerance, problem=problem, posture=posture,
    )  # fmt: skip


def _defect(problem: PostureProblem, posture: Posture) -> str:
    """What keeps the posture from being one at all; empty when nothing does."""
    rows = len(problem.contacts)
    for name, shape in (("com_m", (3,)), ("rotation_rad", (3,)), ("toes_m", (rows, 3)), ("forces_n", (rows, 3))):
        array = getattr(posture, name)
        if array.shape != shape:
            return f"{name}: expected shape {shape}, got {array.shape}"
        if not np.isfinite(array).all():
            return f"{name}: expected finite numbers"
    return ""


def _refused(problem: PostureProblem, posture: Posture, tolerance: float, defect: str) -> Report:
    return Report(
        accepted=False,
        worst=math.inf,
        groups=tuple(GroupViolation(group, math.inf, math.inf, unit, "", -1) for group, unit in GROUPS.items()),
        residual_nm=math.inf,
        tolerance=tolerance,
        problem=problem,
        posture=posture,
        defect=defect,
    )


def _patch_distances(problem: PostureProblem, toes: Array) -> Array:
    """Distance of every toe from the convex hull of its patch's vertices (eq. 1), shape (N,) [m]."""
    polygons = [contact.patch.vertices_m for contact in problem.contacts]
    if all(len(polygon) == 3 for polygon in polygons):
        return _triangle_distances(np.array(polygons), toes)
    distances = np.empty(len(polygons))
    for i, (polygon, toe) in enumerate(zip(polygons, toes, strict=True)):
        fan = np.stack([np.broadcast_to(polygon[0], (len(polygon) - 2, 3)), polygon[1:-1], polygon[2:]], axis=1)
        distances[i] = _triangle_distances(fan, toe).min()
        if distances[i] > 1e-12 and len(polygon) > 3:  # vertices of a rounded file span a thin body, not just a fan
            distances[i] = _hull_distance(polygon, toe)
    return distances


def _triangle_distances(triangles: Array, points: Array) -> Array:
    """Distance of points, shape (T, 3) or (3,), from triangles, shape (T, 3, 3); shape (T,)."""
    edges = triangles[:, [1, 2, 0]] - triangles
    away = (points[:, None] if points.ndim == 2 else points) - triangles
    share = (away * edges).sum(axis=2) / np.maximum((edges * edges).sum(axis=2), 1e-300)
    to_border = away - np.minimum(np.maximum(share, 0.0), 1.0)[:, :, None] * edges
    squares = (to_border * to_border).sum(axis=2).min(axis=1)
    normals = cross(edges[:, 0], edges[:, 1])
    sides = (cross(edges, away) * normals[:, None]).sum(axis=2)  # all ≥ 0 above the inside, either way round
    lengths = (normals * normals).sum(axis=1)
    heights = (away[:, 0] * normals).sum(axis=1)
    above = (sides.min(axis=1) >= 0.0) & (lengths > 0.0)
    return np.asarray(np.sqrt(np.where(above, heights * heights / np.maximum(lengths, 1e-300), squares)))


def _hull_distance(vertices: Array, point: Array) -> float:
    """Distance of a point from the convex hull of points in space, shape (U, 3): 0 in a tetrahedron, else to a face.

    Tetrahedra at the first vertex fill the hull; all its faces are among the triangles of three vertices.
    """
    away = point - vertices[0]
    corners = vertices[list(itertools.combinations(range(1, len(vertices)), 3))] - vertices[0]
    volumes = np.linalg.det(corners)
    corners = corners[np.abs(volumes) > 1e-12 * np.ptp(vertices, axis=0).max() ** 3]
    shares = np.linalg.solve(corners.swapaxes(1, 2), np.broadcast_to(away, (len(corners), 3))[..., None])[..., 0]
    if np.any((shares.min(axis=1, initial=0.0) >= 0.0) & (shares.sum(axis=1) <= 1.0)):
        return 0.0
    triangles = vertices[list(itertools.combinations(range(len(vertices)), 3))]
    return float(_triangle_distances(triangles, point).min())


def _or_null(number: float) -> float | None:
    return number if math.isfinite(number) else None
