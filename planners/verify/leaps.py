"""Is this a leap? Newton and Euler, integrated finely from the forces alone, and every limit
between instants, too.

Knows toes, forces and the question; c, v, L and Θ are integrated anew (RK4 in ``_SUBSTEPS`` steps
per interval) and what a plan says of them is held against that. Rotations are exact here, R =
exp([Θ]×), in reach, length and speed of legs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..answer.plan import LATER, LEAP_BODY, LEAST_GATHER, MOST_GATHER, LeapPlan, leap_shapes
from ..answer.report import Group, Report
from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array
from ..motion.leap_motion import LeapBody, body_of, gaps
from ..physics import GRAVITY_M_S2
from ..robot.joint_limits import speed_doubts
from ..terrain.obstacles import Obstacles
from .bodies import BodyPath, MovingBodyMeasurements
from .postures import violation

_BODY_UNITS = {
    "joints": "m",
    "joint_speed": "1",
    "torque": "1",
    "legs_turn": "rad",
    "take_off": "m",
    "landing": "m",
    "bodies": "m",
}


JOINTS_M = 1e-4
"""Distance of a foot from where it should be, with all joints within their limits, at most [m]."""
JOINT_SPEED, TORQUE = 0.95, 1.0
"""Shares of what the robot's file gives a joint that may be used, the torque on the speed–torque
line."""
LEGS_TURN_RAD = 0.05
"""Angle by which legs may turn the body beside what the plan says; joints are judged with all of
it."""
DIP_M = 2e-3
"""Depth that a foot in the air may have below the plane of the surface that it left or comes to
[m]."""


class LeapBodyMeasurements(MovingBodyMeasurements):
    """Measurements of a leap of a robot whose legs are known."""

    def __init__(self, body: LeapBody) -> None:
        self.leap_body = body
        path = BodyPath(
            times_s=body.times_s,
            com_m=body.com_m,
            rotation=body.rotation,
            toes_m=body.toes_m,
            normals=body.normals,
            forces_n=body.mean_forces_n,
            contact=body.contact,
            feet=body.plan.problem.robot.limb_names,
        )
        super().__init__(path, body.postures)

    @cached_property
    def torques_nm(self) -> Array:
        """Torques as of every body that moves; where forces jump, as a limb leaves or lands, the larger
        of those under the mean of both sides and under the forces of the sample, (K − 2, J) [Nm].
        """
        mean, last = (self._torques(f) for f in (self.path.forces_n, self.leap_body.forces_n))
        return np.where(np.abs(mean) >= np.abs(last), mean, last)

    @cached_property
    def shares(self) -> tuple[Array, Array]:
        """q̇/q̇_max and τ/τ_max at the inner samples, 0 where a limit is not known, shape (K − 2, J)
        each.
        """
        solver, rates = self.kinematics, self.rates_rad_s
        most = np.where(self._limited, solver.velocity_rad_s, np.inf)
        return 0.5 * (rates[1:] + rates[:-1]) / most, self.torques_nm / solver.torque_nm

    @cached_property
    def line(self) -> Array:
        """Share of the speed–torque line that is used at the inner samples, shape (K − 2, J)."""
        fast, strong = self.shares
        drives = np.where(fast * strong > 0.0, np.abs(fast), 0.0)
        return np.asarray(np.abs(strong) + drives)

    @cached_property
    def _limited(self) -> NDArray[np.bool_]:
        """Whether a joint's file has a velocity limit for it, shape (J,): what is guessed for key
        frames is none.
        """
        solver = self.kinematics
        guessed = speed_doubts(solver.model.tree)
        named = [name not in guessed for name in solver.joints]
        return np.asarray((solver.velocity_rad_s > 0.0) & named)

    @cached_property
    def turned(self) -> Array:
        """Θ at the ends of intervals less the plan's, shape (M + 1, 3) [rad]."""
        body, plan = self.leap_body, self.leap_body.plan
        at = np.array([np.interp(plan.times_s, body.times_s, row) for row in body.rotation_rad.T]).T
        return np.asarray(at - plan.rotation_rad)

    def dips(self) -> tuple[Array, Array]:
        """Depth of every foot in the air below the plane of the surface that it left, and of the
        one that it comes to, each over its half of the flight, shape (K, N) each [m].
        """
        body, plan = self.leap_body, self.leap_body.plan
        leap, holds = plan.problem, body.holds
        normals = np.array([leap.patch(j, plan.choice).normal for j in range(len(leap.footholds))])
        left, lands = np.zeros(holds.shape), np.zeros(holds.shape)
        for i in range(holds.shape[1]):
            for first, last in gaps(holds[:, i] >= 0):
                rows = np.arange(first + 1, last)
                share = (rows - first) / (last - first)
                for depth, end, near in (
                    (left, first, share <= 0.5),
                    (lands, last, share > 0.5),
                ):
                    if 0 <= end < len(holds):
                        j = holds[end, i]
                        arms = body.toes_m[rows[near], i] - plan.toes_m[j]
                        depth[rows[near], i] = -arms @ normals[j]
        return np.maximum(left, 0.0), np.maximum(lands, 0.0)

    def groups(
        self,
        *,
        bodies: bool = True,
        obstacles: Obstacles | None = None,
    ) -> Iterator[Group]:
        """The groups of ``LEAP_BODY``.

        Arguments:
            bodies: judge them, too.
            obstacles: what they keep out of; the surfaces that are taken unless others are given.
        """
        feet, joints, times = self.path.feet, self.kinematics.joints, self.times_s
        off, left = self.off_toes(), self.dips()
        legs = [self.path.feet[leg] for leg in self.kinematics.legs]
        speed, model = self.speed(), self.kinematics.model
        bent = _group("joints", off.values, feet, times, JOINTS_M, feet)
        yield _as_far_as_known(bent, model.limit_doubts)
        shares = np.where(self._limited, speed.values, 0.0)
        fast = _group("joint_speed", shares, joints, speed.times_s, JOINT_SPEED, legs)
        torque = _group("torque", self.line, joints, times[1:-1], TORQUE, legs)
        slow = [name for name, there in zip(joints, self._limited, strict=True) if not there]
        unlimited = [f"no velocity limit of {', '.join(slow)}"] if slow else []
        yield _as_far_as_known(fast, unlimited)
        yield _as_far_as_known(torque, [*unlimited, *model.lines_of(model.torque_doubts)])
        turned = np.abs(self.turned)
        yield _group(
            "legs_turn",
            turned,
            ("x", "y", "z"),
            self.leap_body.plan.times_s,
            LEGS_TURN_RAD,
        )
        yield _group("take_off", left[0], feet, times, DIP_M, feet)
        yield _group("landing", left[1], feet, times, DIP_M, feet)
        if bodies:
            yield self._bodies(obstacles)

    def _bodies(self, obstacles: Obstacles | None) -> Group:
        plan = self.leap_body.plan
        leap = plan.problem
        patches = [leap.patch(j, plan.choice) for j in range(len(leap.footholds))]
        try:
            return self.bodies(obstacles or Obstacles.of(patches)).group("bodies")
        except InvalidInput as error:  # no coal
            return Group("bodies", unit="m", message=str(error), verdict="not checked")


def _group(
    name: str,
    values: Array,
    names: tuple[str, ...],
    times_s: Array,
    limit: float,
    limbs: tuple[str, ...] | list[str] = (),
) -> Group:
    """The worst of what was measured.

    Arguments:
        limbs: of the columns.
    """
    row, column = (int(i) for i in np.unravel_index(int(values.argmax()), values.shape))
    return Group(
        name=name,
        value=float(values[row, column]),
        limit=limit,
        unit=_BODY_UNITS[name],
        where=names[column],
        limb=limbs[column] if limbs else "",
        when=float(times_s[row]),
    )


def _as_far_as_known(group: Group, unlimited: Sequence[str]) -> Group:
    """A group of joints of which some have no limits: what holds of the others is not checked."""
    if not unlimited or group.verdict == "violated":
        return group
    return replace(group, message="; ".join(unlimited), verdict="not checked")


def _body_groups(plan: LeapPlan) -> tuple[Group, ...]:
    """The groups of a leap's whole body; none is checked where the robot's legs are not known, or
    without pinocchio.
    """
    try:
        return tuple(LeapBodyMeasurements(body_of(plan)).groups())
    except InvalidInput as error:
        return _unjudged(str(error))


def _unjudged(why: str) -> tuple[Group, ...]:
    """The groups of a leap's whole body, as not judged."""
    return tuple(
        Group(name, unit=_BODY_UNITS[name], message=why, verdict="not checked")
        for name in LEAP_BODY
    )


def with_body(report: Report[LeapPlan]) -> Report[LeapPlan]:
    """The report of ``check_leap`` with the robot's own body, from one without."""
    if report.defect:
        return report
    others = tuple(group for group in report.groups if group.name not in LEAP_BODY)
    return replace(report, groups=(*others, *_body_groups(report.answer)))


_SUBSTEPS = 16
_TOLERANCE = 1e-3
"""Largest violation that is accepted, without unit."""
_UNJUDGED = "its legs are not judged: its robot has limbs alone"
"""Said of a leap whose robot has no legs of its own."""
_UNITS = {
    "patch": ("m", 0.1),
    "idle_force": ("N", 1.0),
    "friction": ("N", 1.0),
    "force_bounds": ("N", 1.0),
    "start": ("", 1.0),
    "motion": ("m", 0.1),
    "momentum_balance": ("m²/s", 1.0),
    "rotation": ("rad", 0.1),
    "momentum": ("m²/s", 1.0),
    "rest": ("m/s", 1.0),
    "tilt": ("rad", 0.1),
    "goal": ("m", 0.1),
    "reach": ("m", 0.1),
    "height": ("m", 0.1),
    "fold": ("m", 0.1),
    "speed": ("m/s", 1.0),
    "power": ("W", 1.0),
}
"""Unit of each group in SI, and what 1 of its non-dimensional violation is in it: forces are in
units of the weight, momenta in those of their limit, power in those of the weight times m/s."""


def check_leap(plan: LeapPlan, *, body: bool = False) -> Report[LeapPlan]:
    """Check a plan of a leap by its toes and forces, and by its joints and bodies.

    No solver takes part.

    Arguments:
        body: judge the whole body, too, of a robot that has legs of its own; that takes most of the
            time.

    Returns:
        A report; a bad plan is refused in it, and not raised.
    """
    defect = _defect(plan)
    if defect:
        broken = (
            violation(name, math.inf, 1.0, _TOLERANCE, unit=unit)
            for name, (unit, _) in _UNITS.items()
        )
        return Report(groups=tuple(broken), answer=plan, tolerance=_TOLERANCE, defect=defect)

    judge = _Judge(plan)
    has_legs = plan.problem.robot.source.own
    report = Report(
        groups=(*judge.groups(), *_unjudged("not asked for" if has_legs else _UNJUDGED)),
        answer=plan,
        tolerance=_TOLERANCE,
        figures={"momentum_error": judge.momentum_error},
    )
    return with_body(report) if body and has_legs else report


def _defect(plan: LeapPlan) -> str:
    """Why a plan is none; empty where it is one."""
    leap = plan.problem
    if not 0 <= plan.timing < len(leap.timings_s):
        return f"timing: expected 0 to {len(leap.timings_s) - 1}, got {plan.timing}"
    for name, shape in leap_shapes(leap).items():
        array = getattr(plan, name)
        if array is None and name in LATER:
            continue
        if np.shape(array) != shape:
            return f"{name}: expected shape {shape}, got {array.shape}"
        if not np.all(np.isfinite(array)) or np.abs(array).max(initial=0.0) > 1e9:
            return f"{name}: expected finite numbers, got others"
    if plan.gather is not None and not np.all(
        (plan.gather >= LEAST_GATHER) & (plan.gather <= MOST_GATHER)
    ):
        return (
            f"gather: expected shares of 0.05 to 0.49 and of 0.1 to 1, got {plan.gather.tolist()}"
        )
    if plan.legs_turn_rad is not None and not leap.robot.source.own:
        return (
            "legs_turn_rad: expected none of a robot that has limbs alone, whose legs weigh nothing"
        )
    for j, foothold in enumerate(leap.footholds):
        if not 0 <= plan.choice[j] < len(foothold.candidates):
            return (
                f"choice[{j}]: expected 0 to {len(foothold.candidates) - 1}, got {plan.choice[j]}"
            )
    return ""


class _Judge:
    """One plan, integrated."""

    def __init__(self, plan: LeapPlan) -> None:
        self.plan, self.leap = plan, plan.problem
        self.phase = self.leap.interval_phases
        inertia = self.leap.robot.inertia
        assert inertia is not None
        self.spin = np.linalg.inv(inertia / self.leap.robot.mass_kg)
        self.ends = self.leap.times_s(plan.timing)
        self.found: dict[str, Group] = {}
        self._integrate()

    def groups(self) -> Iterator[Group]:
        """The worst of every group."""
        for name in _UNITS:
            self.found[name] = violation(
                name, 0.0, _UNITS[name][1], _TOLERANCE, unit=_UNITS[name][0]
            )
        self._ends()
        self._claims()
        for k in range(self.leap.intervals):
            self._forces(k)
            self._body(k)
            for i in np.flatnonzero(self.leap.holds[self.phase[k]] >= 0).tolist():
                self._limb(k, i)
        for j in range(len(self.leap.footholds)):
            self._toe(j)
        yield from self.found.values()

    @property
    def momentum_error(self) -> float:
        """Error of the claimed L, in units of its limit."""
        away = self.plan.momentum_m2_s - np.array(
            [path[0, 6:9] for path in self.paths] + [self.paths[-1][-1, 6:9]]
        )
        return float(np.abs(away).max()) / self.leap.limits.momentum_m2_s

    def _integrate(self) -> None:
        """The path of (c, v, L, Θ) in every interval at SUBSTEPS + 1 instants, shape (SUBSTEPS + 1,
        12) each.
        """
        leap, plan = self.leap, self.plan
        start = leap.start
        state = np.concatenate(
            [start.com_m, start.velocity_m_s, start.momentum_m2_s, start.rotation_rad]
        )
        mass, self.paths = leap.robot.mass_kg, []
        for k in range(leap.intervals):
            pushes = np.zeros(3)
            twists = np.zeros(3)
            for i, j in enumerate(leap.holds[self.phase[k]]):
                if j >= 0:
                    pushes = pushes + plan.forces_n[k, i] / mass
                    twists = twists + np.cross(plan.toes_m[j], plan.forces_n[k, i] / mass)
            step = (self.ends[k + 1] - self.ends[k]) / _SUBSTEPS
            swung = plan.turned_rad[k] / (self.ends[k + 1] - self.ends[k])
            path = [state]
            for _ in range(_SUBSTEPS):
                one = self._rate(state, pushes, twists, swung)
                two = self._rate(state + 0.5 * step * one, pushes, twists, swung)
                three = self._rate(state + 0.5 * step * two, pushes, twists, swung)
                four = self._rate(state + step * three, pushes, twists, swung)
                state = state + step / 6.0 * (one + 2.0 * two + 2.0 * three + four)
                path.append(state)
            self.paths.append(np.array(path))

    def _rate(self, state: Array, pushes: Array, twists: Array, swung: Array) -> Array:
        """(v, a, L′, Θ′) of a state.

        Arguments:
            pushes: Σ f / m.
            twists: Σ p × f / m, about the world's origin.
            swung: Θ′ by legs that swing.
        """
        x, y, z = state[:3].tolist()
        a, b, c = pushes.tolist()
        rate = np.empty(12)
        rate[:3] = state[3:6]
        rate[3:6] = a, b, c - GRAVITY_M_S2
        rate[6:9] = twists
        rate[6] -= y * c - z * b
        rate[7] -= z * a - x * c
        rate[8] -= x * b - y * a
        rate[9:] = self.spin @ state[6:9] + swung
        return rate

    def _note(
        self, group: str, by: Array | float, k: int, limb: str = "", *, scale: float = 0.0
    ) -> None:
        """Keep the worst violation of a group.

        Arguments:
            scale: what 1 of it is in SI; 0 for the group's own.
        """
        value = float(np.max(by))
        unit, scale_of_group = _UNITS[group]
        if not math.isfinite(value):
            value = math.inf
        violation_found = violation(
            group, value, scale or scale_of_group, _TOLERANCE, unit=unit, limb=limb, when=k
        )
        if violation_found.worst > self.found[group].worst:
            self.found[group] = violation_found

    def _ends(self) -> None:
        """Start, goal and rest."""
        leap, last, final = self.leap, len(self.paths) - 1, self.paths[-1][-1]
        limit = leap.limits.momentum_m2_s
        away = float(np.linalg.norm(final[:3] - leap.goal.com_m)) - leap.goal_radius_m
        self._note("goal", away, last)
        self._note("rest", np.abs(final[3:6] - leap.goal.velocity_m_s), last)
        self._note("momentum", np.abs(final[6:9] - leap.goal.momentum_m2_s), last, scale=limit)
        self._note("tilt", np.abs(final[9:]) - leap.limits.goal_tilt_rad, last)
        for still, k in zip(leap.still, (0, last), strict=True):
            if still:
                self._note("rest", np.abs(self.paths[k][:, 3:6]), k)
                self._note("momentum", np.abs(self.paths[k][:, 6:9]), k, scale=limit)

    def _claims(self) -> None:
        """Check the plan's c, v, L and Θ at the ends of intervals."""
        plan, limit = self.plan, self.leap.limits.momentum_m2_s
        says = np.concatenate(
            [plan.com_m, plan.velocity_m_s, plan.momentum_m2_s, plan.rotation_rad], axis=1
        )
        states = np.array([path[0] for path in self.paths] + [self.paths[-1][-1]])
        for k, away in enumerate(np.abs(says - states)):
            at = min(k, len(self.paths) - 1)
            self._note("motion", away[:3], at)
            self._note("rest", away[3:6], at)
            self._note("momentum_balance", away[6:9], at, scale=limit)
            self._note("rotation", away[9:], at)
        self._note("start", np.abs(says[0] - self.paths[0][0]), 0)

    def _forces(self, k: int) -> None:
        """Cones and limits of the limbs that stand, nothing at the others."""
        leap, weight = self.leap, self.leap.weight_n
        holds = leap.holds[self.phase[k]]
        for i, limb in enumerate(leap.robot.limb_names):
            force = self.plan.forces_n[k, i]
            if holds[i] < 0:
                self._note("idle_force", float(np.linalg.norm(force)), k, limb, scale=weight)
                continue
            patch = leap.patch(int(holds[i]), self.plan.choice)
            normal = float(force @ patch.normal)
            shear = float(np.linalg.norm(force - normal * patch.normal))
            self._note("friction", shear - patch.friction * max(normal, 0.0), k, limb, scale=weight)
            most = weight * self._most(k, i)
            self._note("force_bounds", max(-normal, normal - most), k, limb, scale=weight)

    def _most(self, k: int, i: int) -> float:
        """Largest normal force in units of the weight: less in the interval after the limb lands
        and in the one before it lifts.
        """
        stands = [bool(self.leap.holds[self.phase[q], i] >= 0) for q in range(self.leap.intervals)]
        lands = k > 0 and not stands[k - 1]
        lifts = k + 1 < len(stands) and not stands[k + 1]
        return float(self.leap.limits.most(lands, lifts))

    def _body(self, k: int) -> None:
        """Tilt at all instants, L at the end of the interval."""
        path, limits = self.paths[k], self.leap.limits
        self._note("tilt", np.abs(path[:, 9:]) - limits.tilt_rad, k)
        over = np.abs(path[-1, 6:9]) - limits.momentum_m2_s
        self._note("momentum", over, k, scale=limits.momentum_m2_s)

    def _limb(self, k: int, i: int) -> None:
        """Reach, height, length, speed and power of a limb that stands, at all instants of an
        interval.
        """
        leap, path = self.leap, self.paths[k]
        limb = leap.robot.limbs[i]
        leg = leap.leg(limb)
        toe = self.plan.toes_m[leap.holds[self.phase[k], i]]
        name, force = limb.name, self.plan.forces_n[k, i]
        com, speed, spin = path[:, :3], path[:, 3:6], path[:, 6:9] @ self.spin.T
        turns = _rotations(path[:, 9:])
        away = np.linalg.norm(toe - com - turns @ limb.shoulder_m, axis=1)
        self._note("reach", away - limb.reach_m, k, name)
        if limb.reach_rows is not None:
            arms = np.einsum("tij,ti->tj", turns, toe - com)  # Rᵀ (p − c)
            self._note(
                "reach", arms @ limb.reach_rows.normals.T - limb.reach_rows.bounds_m, k, name
            )
        self._note("height", toe[2] + leap.limits.height_m - com[:, 2], k, name)
        arm = turns @ leg.hip_m
        hip = com + arm - toe
        length = np.linalg.norm(hip, axis=1)
        self._note("fold", leg.fold_m - length, k, name)
        moves = speed + np.cross(spin, arm)
        rate = np.abs(np.sum(hip * moves, axis=1)) / np.maximum(length, 1e-9)
        if leg.speed_m_s < math.inf:
            self._note("speed", rate - leg.speed_m_s, k, name)
        if leg.power_w < math.inf:
            self._note("power", np.abs(moves @ force) - leg.power_w, k, name, scale=leap.weight_n)

    def _toe(self, j: int) -> None:
        """A toe on its patch, or where it stands already."""
        leap, toe = self.leap, self.plan.toes_m[j]
        foothold, patch = leap.footholds[j], leap.patch(j, self.plan.choice)
        first = int(np.flatnonzero(self.phase == foothold.frame)[0])
        if foothold.toe_m is not None:
            self._note("patch", float(np.linalg.norm(toe - foothold.toe_m)), first, foothold.limb)
            return
        border = patch.vertices_m
        along = np.roll(border, -1, axis=0) - border
        middle = border.mean(axis=0)
        outward = np.cross(along, patch.normal)
        outward *= np.sign(np.sum(outward * (border - middle), axis=1))[:, None]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        outside = np.sum(outward * (toe - border), axis=1).max()
        above = abs(float((toe - middle) @ patch.normal))
        self._note("patch", max(float(outside), above), first, foothold.limb)


def _rotations(vectors: Array) -> Array:
    """exp([Θ]×) = I + sin θ [u]× + (1 − cos θ) [u]×² of rotation vectors, shape (K, 3) to (K, 3,
    3).
    """
    angles = np.linalg.norm(vectors, axis=1)
    x, y, z = (vectors / np.maximum(angles, 1e-12)[:, None]).T
    zero = np.zeros_like(x)
    axes = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    sines, versines = np.sin(angles)[:, None, None], 1.0 - np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sines * axes + versines * np.matmul(axes, axes))
