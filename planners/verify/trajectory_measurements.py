"""Measurements of a trajectory between the optimiser's knots, from its samples alone.

Derivatives are differences of neighbouring samples, balances are balances of momentum, and the
surface under a point is known by heights alone, so that no derivative that a planner relied on is
believed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.report import Group
from ..answer.trajectory import OFF_M, STEP_S, WALK_BODY as WHOLE_BODY, Trajectory
from ..arguments import cached_property
from ..files.arrays import LARGEST, Array
from ..physics import GRAVITY_M_S2

__all__ = ["GROUPS", "LIMITS", "WHOLE_BODY"]

GROUPS = MappingProxyType(
    {
        "rotation": "1",
        "start": "m",
        "goal": "m",
        "domain": "m",
        "continuity": "m",
        "foot_speed": "m/s",
        "torso_speed": "m/s",
        "turn_rate": "rad/s",
        "force_balance": "N",
        "force_peak": "N",
        "moment_balance": "Nm",
        "moment_peak": "Nm",
        "impulse": "N s",
        "angular_impulse": "N m s",
        "angular_residual": "rad/s²",
        "traction": "N",
        "traction_impulse": "N s",
        "traction_way": "m",
        "traction_turn": "rad",
        "cone": "N",
        "suction": "N",
        "force_foot": "N",
        "swing_force": "N",
        "contact_gap": "m",
        "slip": "m",
        "foot_velocity": "m/s",
        "touch_speed": "m/s",
        "stance_time": "s",
        "swing_time": "s",
        "lift": "m",
        "clearance": "m",
        "drag": "m",
        "penetration": "m",
        "penetration_between": "m",
        "reach": "m",
        "trunk": "m",
        "heading": "rad",
        "rest": "m/s",
        "rest_acceleration": "m/s²",
        "joints": "m",
        "joint_speed": "1",
        "torque": "1",
        "legs_moment": "Nm",
        "bodies": "m",
    }
)
"""The groups in the order of a report, and the unit of what is measured;
``docs/reference/groups.md`` has their formulas."""


LIMITS: Mapping[str, float] = MappingProxyType(
    {
        "step_s": STEP_S,
        "rotation": 1e-6,
        "start_m": 5e-3,
        "goal_m": 5e-3,
        "domain_m": 0.0,
        "continuity_m": 5e-3,
        "foot_speed_m_s": 10.0,
        "torso_speed_m_s": 3.0,
        "turn_rate_rad_s": 6.0,
        "force_balance": 0.05,
        "force_peak": 0.4,
        "moment_balance": 0.05,
        "moment_peak": 0.3,
        "impulse_s": 0.01,
        "impulse_rate": 0.016,
        "angular_impulse_s": 0.015,
        "angular_impulse_rate": 2e-3,
        "angular_residual": 1.0,
        "traction": 0.04,
        "traction_impulse_s": 2e-3,
        "traction_way_m": 0.02,
        "traction_turn_rad": 0.02,
        "cone": 1e-3,
        "force_foot": 2.0,
        "swing_force": 1e-3,
        "contact_gap_m": 1e-3,
        "slip_m": 1e-3,
        "foot_velocity_m_s": 0.01,
        "touch_speed_m_s": 0.6,
        "least_stance_s": 0.1,
        "least_swing_s": 0.1,
        "least_lift_m": 5e-3,
        "least_clearance_m": 1e-3,
        "drag_m": 0.12,
        "penetration_m": 1e-3,
        "reach_m": 3e-3,
        "trunk_m": 0.0,
        "heading_rad": 0.01,
        "rest_m_s": 5e-3,
        "rest_acceleration": 0.02,
        "joints_m": 1e-4,
        "joint_speed": 0.9,
        "torque": 0.9,
        "legs_moment": 0.05,
        "bodies_m": 1e-4,
    }
)
"""Tolerances for a trajectory, the same for every chart; forces in units of m·g, moments of
m·g·stand height.

The two balances are judged by their root mean square over all samples, and by a wide limit on the
single sample.

cone: how far the tangential force may exceed ν times the normal one; 1e-3 m·g on a foot that
carries half the weight is an error of .002 in ν, less than its uncertainty, and ten times the
optimiser's own tolerance. continuity_m: ‖x₋ − 2x + x₊‖ of torso and feet; 5 mm at 5 ms is 200
m/s², a jump and no swing. slip_m: distance of a standing foot from where it came down. trunk_m:
depth of the trunk's box in the terrain. impulse_s, impulse_rate: what a window may gather, and what
more for each second of it [m·g·s, m·g]. traction: of what cones cannot give. traction_impulse_s: of
the same over the whole walk [m·g·s]. traction_way_m, traction_turn_rad: how far it gets by that,
and how far it turns by moments that feet cannot give. angular_residual, rest_acceleration: in units
of g a stand height, and of g. least_…: what a phase has at least. joints_m: distance of a foot from
its toe, with all joints within their limits. joint_speed, torque: shares of what the robot's file
gives a joint; the rest is what a controller corrects by. legs_moment: as moment_balance, of the
whole robot, whose legs weigh something. bodies_m: of one link in another, or in the ground; of the
latter what is within 1 mm counts as 0. ``docs/reference/groups.md`` has the limits."""


def worst_group(
    name: str,
    values: Array,
    limit: float,
    unit: str,
    names: Sequence[str],
    times_s: Array,
    *,
    judged: float | None = None,
    limbs: Sequence[str] = (),
) -> Group:
    """The group of one quantity over time, with the column and the time of its largest value.

    Arguments:
        values: shape (S, C), or (S,) of the whole body.
        names, limbs: of the columns.
        times_s: shape (S,) [s].
        judged: the value that is judged where that is not the largest, or 0 where that is less.
    """
    if not values.size:
        return Group(name=name, limit=limit, unit=unit)
    row, column = divmod(int(values.argmax()), values[0].size)
    return Group(
        name=name,
        value=max(float(values.flat[values.argmax()]), 0.0) if judged is None else judged,
        limit=limit,
        unit=unit,
        where=names[column],
        limb=limbs[column] if limbs else "",
        when=float(times_s[row]),
    )


def as_far_as_known(group: Group, why: str) -> Group:
    """A group of which something is not known or not asked for: it holds of nothing."""
    if not why or group.verdict == "violated":
        return group
    return replace(group, message=why, verdict="not checked")


def arrays_defect(
    thing: Any,
    shapes: Mapping[str, tuple[int, ...]],
    later: Collection[str] = (),
    most: float = LARGEST,
) -> str:
    """The first array of something that has another shape than it should, or numbers that are none
    or larger than the most, in words; empty where there is none.

    Arguments:
        later: names of arrays that may be None.
    """
    for name, shape in shapes.items():
        array = getattr(thing, name)
        if array is None and name in later:
            continue
        if np.shape(array) != shape:
            return f"{name}: expected shape {shape}, got {np.shape(array)}"
        if not (largest := np.abs(array).max(initial=0)) <= most:  # NaN, too
            wanted = f"magnitudes up to {most:g}" if np.isfinite(largest) else "finite numbers"
            return f"{name}: expected {wanted}, got {largest:g}"
    return ""


Flags = NDArray[np.bool_]

_APART_M, _CLOSE_M, NEAR_M = 0.08, 0.02, 0.1
"""How far apart points of the trunk are, and where something is near; and what near is [m]."""
_FEELER_M = 1e-5
"""Half the base over which the slope of the surface is felt [m]."""


class TrajectoryMeasurements:
    """The measurements of one trajectory that has no defect (``defect_of``)."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory, self.robot = trajectory, trajectory.robot
        self.feet = tuple(foot.name for foot in self.robot.feet)
        self.times_s, self.step_s = trajectory.times_s, trajectory.step_s
        self.weight_n = self.robot.mass_kg * GRAVITY_M_S2
        self.moment_scale_nm = self.weight_n * self.robot.stand_height_m
        sucks = math.inf if trajectory.problem.suction_n is None else trajectory.problem.suction_n
        self.suction_n = np.where(trajectory.problem.adhesive, sucks, 0.0)
        self.gripping = trajectory.contact & ~trajectory.problem.adhesive
        torso = trajectory.torso_m[:, None]
        self.points, self.arms = np.hstack([trajectory.feet_m, torso]), trajectory.feet_m - torso

    def group(
        self,
        name: str,
        values: Array,
        limit: float,
        *,
        judged: float | None = None,
        times_s: Array | None = None,
    ) -> Group:
        """The group of a quantity at all K samples, between them, or at the inner ones.

        Arguments:
            values: shape (S, E) of the feet, (S, E + 1) of feet and torso, or (S,) of the torso.
            judged: as of ``worst_group``.
            times_s: of other samples, shape (S,).
        """
        skipped = len(self.times_s) - len(values)
        if times_s is None:
            times_s = self.times_s[min(skipped, 1) : len(self.times_s) - skipped // 2]
        names = ("torso",) if values.ndim == 1 else (*self.feet, "torso")
        return worst_group(name, values, limit, GROUPS[name], names, times_s, judged=judged)

    # -------------------------------------------------------------------------------------------
    # balances

    @cached_property
    def acceleration(self) -> Array:
        """Acceleration of the torso at the inner samples, shape (K − 2, 3) [m/s²]."""
        return np.diff(self.trajectory.torso_m, 2, axis=0) / self.step_s**2

    @cached_property
    def spin(self) -> Array:
        """Rotation vector from each sample to the next over its time, in the torso's axes, shape (K
        − 1, 3) [rad/s].
        """
        rotation = self.trajectory.rotation
        turn = np.swapaxes(rotation[:-1], 1, 2) @ rotation[1:]
        sine = 0.5 * np.stack(
            [
                turn[:, 2, 1] - turn[:, 1, 2],
                turn[:, 0, 2] - turn[:, 2, 0],
                turn[:, 1, 0] - turn[:, 0, 1],
            ],
            axis=1,
        )
        size = np.linalg.norm(sine, axis=1)
        angle = np.arctan2(size, 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))
        along = np.where(
            size[:, None] > 1e-12, sine / np.maximum(size, 1e-300)[:, None], np.eye(3)[0]
        )
        return np.asarray(angle[:, None] * along / self.step_s)

    @cached_property
    def force_residual(self) -> Array:
        """m (a − g) − Σ f_i at the inner samples (Newton; W2), shape (K − 2, 3) [N]."""
        felt = self.acceleration + np.array([0.0, 0.0, GRAVITY_M_S2])
        return np.asarray(self.robot.mass_kg * felt - self.trajectory.forces_n[1:-1].sum(axis=1))

    @cached_property
    def moment_residual(self) -> Array:
        """dL/dt − Σ (p_i − p) × f_i at the inner samples (Euler; W2), world axes, shape (K − 2, 3)
        [Nm].

        L is the angular momentum about the centre of mass half-way between samples: it changes by
        what the feet do, and by nothing else, however fast the torso turns.
        """
        half = self.trajectory.rotation[:-1] @ _turned(0.5 * self.step_s * self.spin)
        momentum = np.einsum("kij,jl,kl->ki", half, np.asarray(self.robot.inertia_kgm2), self.spin)
        moments = np.cross(self.arms, self.trajectory.forces_n).sum(axis=1)
        return np.asarray(np.diff(momentum, axis=0) / self.step_s - moments[1:-1])

    # ------------------------------------------------------------------------------------------
    # feet

    @cached_property
    def ground(self) -> tuple[Array, Array]:
        """Distance along the normal, shape (K, E) [m], and normal, (K, E, 3), of the surface at
        every foot.
        """
        return self.above(self.trajectory.feet_m)

    def above(self, points: Array) -> tuple[Array, Array]:
        """Distance from the surface along its normal, negative below, shape (…) [m], and upward
        normals, (…, 3).
        """
        xy, terrain = points[..., :2], self.trajectory.problem.terrain
        steps = _FEELER_M * np.array([[1.0, 0.0], [0.0, 1.0]])
        slope = [
            (terrain.height(xy + step) - terrain.height(xy - step)) / (2.0 * _FEELER_M)
            for step in steps
        ]
        up = np.stack([-slope[0], -slope[1], np.ones(xy.shape[:-1])], axis=-1)
        steep = np.linalg.norm(up, axis=-1)
        return (points[..., 2] - terrain.height(xy)) / steep, up / steep[..., None]

    def beyond_cone(self, forces_n: Array, normals: Array, suction_n: Array) -> Array:
        """Distance of forces, shape (…, E, 3) [N], outside the cones at these normals, shape (…, E)
        [N].

        ‖f_t‖ − ν (f_n + s) or −(f_n + s), whichever is more: a foot that sucks with s, shape (E,),
        is pressed on by it (W5 for s = 0). Without friction the second alone keeps a foot from
        pulling.
        """
        normal, tangential = _split(forces_n, normals)
        pressed = normal + suction_n
        held = np.where(np.isinf(pressed), np.inf, self.trajectory.problem.friction * pressed)
        return np.asarray(np.maximum(tangential - held, -pressed))

    @cached_property
    def beyond(self) -> Array:
        """Distance of the forces outside their cones, shape (K, E) [N]."""
        return self.beyond_cone(self.trajectory.forces_n, self.ground[1], self.suction_n)

    def slip(self) -> Array:
        """Distance of standing feet from where they came down, shape (K, E) [m]."""
        feet, contact = self.trajectory.feet_m, self.trajectory.contact
        samples = np.arange(len(feet))[:, None]
        down = np.maximum.accumulate(np.where(_began(contact), samples, 0), axis=0)
        home = np.take_along_axis(feet, down[..., None], axis=0)
        return np.asarray(np.linalg.norm(feet - home, axis=-1))

    def reach(self) -> Array:
        """Distance of feet outside their boxes in the torso's frame (W4), shape (K, E) [m]."""
        local = np.einsum("kji,kej->kei", self.trajectory.rotation, self.arms)
        ends = [(foot.reach_min_m, foot.reach_max_m) for foot in self.robot.feet]
        return _outside(local, *np.array(ends).swapaxes(0, 1))

    def domain(self) -> Array:
        """Distance of feet and torso outside the terrain's grid, shape (K, E + 1) [m]."""
        return _outside(self.points[..., :2], *np.array(self.trajectory.problem.terrain.domain_m).T)

    # -------------------------------------------------------------------------------------- body
    # and course

    def trunk(self) -> Array:
        """Depth of the trunk's box below the surface, shape (K,) [m]: its corners, and its lower face every few
        centimetres.

        Where the map has something higher than that within NEAR_M of such a point, the face is
        looked at every CLOSE_M: a stone may come up between.
        """
        terrain, points = self.trajectory.problem.terrain, self._placed(slice(None), _APART_M)
        depth = (terrain.height(points[..., :2]) - points[..., 2]).max(axis=1)
        near = np.flatnonzero((self._tops(points[..., :2]) > points[..., 2]).any(axis=1))
        if len(near):
            close = self._placed(near, _CLOSE_M)
            deeper = (terrain.height(close[..., :2]) - close[..., 2]).max(axis=1)
            depth[near] = np.maximum(depth[near], deeper)
        return np.asarray(depth)

    def _placed(self, rows: NDArray[np.intp] | slice, apart_m: float) -> Array:
        """Points of the trunk's box in the world at some samples, shape (S, N, 3) [m]."""
        half = np.asarray(self.robot.trunk_half_m)
        x, y = (
            np.linspace(-side, side, max(2, 1 + math.ceil(2.0 * side / apart_m)))
            for side in half[:2]
        )
        lower = np.array([(a, b, -half[2]) for a, b in product(x, y)])
        box = np.concatenate(
            [lower, half * np.array([(a, b, 1.0) for a, b in product((-1.0, 1.0), repeat=2)])]
        )
        rotation, torso = self.trajectory.rotation[rows], self.trajectory.torso_m[rows]
        return np.asarray(torso[:, None] + np.einsum("kij,nj->kni", rotation, box))

    def _tops(self, xy: Array) -> Array:
        """The highest of the map's own heights within NEAR_M of points, shape (…, 2) [m] → (…)."""
        terrain = self.trajectory.problem.terrain
        lines = terrain.x_m, terrain.y_m
        highest = terrain.heights_m
        for axis, line in enumerate(lines):
            aside = min(math.ceil(NEAR_M / float(np.diff(line).min())), len(line) - 1)
            rows = np.arange(-aside, aside + 1)[:, None] + np.arange(len(line))
            highest = reduce(np.maximum, (highest.take(k, axis, mode="clip") for k in rows))
        cells = tuple(
            np.clip(np.searchsorted(line, xy[..., k]), 0, len(line) - 1)
            for k, line in enumerate(lines)
        )
        return np.asarray(highest[cells])

    def off_rotation(self) -> Array:
        """Largest entry of |RᵀR − I| and |det R − 1|, shape (K,), non-dimensional."""
        rotation = self.trajectory.rotation
        off = np.abs(np.swapaxes(rotation, 1, 2) @ rotation - np.eye(3)).max(axis=(1, 2))
        return np.asarray(np.maximum(off, np.abs(np.linalg.det(rotation) - 1.0)))

    # -------------------------------------------------------------------------------------------
    # figures

    def figures(self, cone: float) -> dict[str, float]:
        """Measurements that nothing is judged by.

        turn_rad: by how much the torso's x axis turns from x towards y, seen from above, whole turns
        counted; accelerations in g, balances in m·g and m·g·stand height; friction_needed: the least ν that
        holds every standing foot that presses with more than .01 m·g; footing_friction: the least ν
        that would hold every standing foot on the ground within OFF_M of its place; outside_cone:
        share of the standing samples.

        Arguments:
            cone: what counts as outside, in units of m·g.
        """
        normal, tangential = _split(self.trajectory.forces_n, self.ground[1])
        pressing = self.gripping & (normal > 0.01 * self.weight_n)
        excess = self.beyond[self.gripping]
        force, moment = self.force_residual, self.moment_residual
        x, y, _ = self.trajectory.rotation[:, :, 0].T
        facing = np.unwrap(np.arctan2(y, x))
        return {
            "duration_s": self.trajectory.duration_s,
            "turn_rad": float(facing[-1] - facing[0]),
            "path_m": float(np.linalg.norm(np.diff(self.trajectory.torso_m, axis=0), axis=1).sum()),
            "peak_acceleration_g": float(np.linalg.norm(self.acceleration, axis=1).max())
            / GRAVITY_M_S2,
            "force_rms": rms(force) / self.weight_n,
            "force_peak": float(np.linalg.norm(force, axis=1).max()) / self.weight_n,
            "moment_rms": rms(moment) / self.moment_scale_nm,
            "moment_peak": float(np.linalg.norm(moment, axis=1).max()) / self.moment_scale_nm,
            "friction_needed": float((tangential[pressing] / normal[pressing]).max(initial=0.0)),
            "footing_friction": self.footing_friction(),
            "outside_cone": float(np.mean(excess > cone * self.weight_n)) if excess.size else 0.0,
        }

    def footing_friction(self) -> float:
        """The steepest gradient of the ground where feet with a friction cone come down, and at
        four places OFF_M around each: the least ν with which a foot that misses its place by OFF_M
        does not slip.
        """
        about = OFF_M * np.vstack([np.zeros(3), np.eye(3)[:2], -np.eye(3)[:2]])
        places = (self.trajectory.feet_m[_began(self.gripping)][:, None] + about).reshape(-1, 3)
        low, high = np.transpose(self.trajectory.problem.terrain.domain_m)
        normals = self.above(
            places[np.all((places[:, :2] >= low) & (places[:, :2] <= high), axis=1)]
        )[1]
        return float((np.linalg.norm(normals[:, :2], axis=1) / normals[:, 2]).max(initial=0.0))

    def footing(self) -> str:
        """How sure the feet stand, in words."""
        needs, has = self.footing_friction(), self.trajectory.problem.friction
        place = f"within {1e3 * OFF_M:.0f} mm of"
        if needs <= has:
            return f"sure footing: the ground {place} every foothold holds with a friction of {needs:.2g}, of {has:.2g}"
        slope, held = (f"{math.degrees(math.atan(each)):.0f}°" for each in (needs, has))
        slope = f"{slope}, and friction {has:.2g} holds on {held}"
        return f"no sure footing: the ground {place} a foothold is {slope}; a foot that comes down there may slip"


def rms(residual: Array) -> float:
    """Root mean square of the rows' norms."""
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


def _outside(points: Array, low: Array, high: Array) -> Array:
    """Distance of points outside a box, shape (…, D) to (…)."""
    beyond = np.maximum(np.maximum(low - points, points - high), 0.0)
    return np.asarray(np.linalg.norm(beyond, axis=-1))


def _began(contact: Flags) -> Flags:
    """Tell where feet come down, or stand at the first sample, shape (K, E)."""
    before = np.vstack([np.zeros((1, contact.shape[1]), dtype=bool), contact[:-1]])
    return np.asarray(contact & ~before)


def _split(forces: Array, normals: Array) -> tuple[Array, Array]:
    """Normal and tangential size of forces at normals, each shape (…, 3) → (…)."""
    normal = np.sum(forces * normals, axis=-1)
    return normal, np.linalg.norm(forces - normal[..., None] * normals, axis=-1)


def _turned(vectors: Array) -> Array:
    """Rotation matrices of rotation vectors, shape (S, 3) [rad] → (S, 3, 3) (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.asarray(
        np.eye(3)
        + np.sinc(angle / np.pi) * skew
        + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * skew @ skew
    )
