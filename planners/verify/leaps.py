"""Is this a leap? Newton and Euler, integrated from the forces alone, and every limit between the
ends of intervals, too.

Knows toes, forces and the question; c, v, L and Θ are integrated anew, exactly, and looked at in
``_INSTANTS`` instants of every interval; what a plan says of them is held against that. Rotations
are exact here, R = exp([Θ]×), in reach, length and speed of legs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..answer.motion import LATER
from ..answer.plan import LEAP_BODY, LEAST_GATHER, MOST_GATHER, LeapPlan
from ..answer.report import Group, Report
from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, cross, lengths
from ..motion.leap_motion import LeapBody, body_of, gaps
from ..physics import GRAVITY_M_S2
from ..robot.urdf_reader import speed_doubts
from ..terrain.obstacles import Obstacles
from .bodies import MovingBodyMeasurements, looked_at, nothing
from .geometry import exact_and_linear, patch_distances
from .postures import Worst, violation
from .trajectory_measurements import arrays_defect, as_far_as_known, worst_group

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
        super().__init__(
            body.postures,
            body.kinematics,
            times_s=body.times_s,
            com_m=body.com_m,
            normals=body.normals,
            forces_n=body.mean_forces_n,
        )

    @cached_property
    def torques_nm(self) -> Array:
        """Torques as of every body that moves; where forces jump, as a limb leaves or lands, the larger
        of those under the mean of both sides and under the forces of the sample, (K − 2, J) [Nm].
        """
        mean, last = (self._torques(f) for f in (self.forces_n, self.leap_body.forces_n))
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
        return np.asarray(np.abs(strong) + np.where(fast * strong > 0.0, np.abs(fast), 0.0))

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
        at = np.array([np.interp(plan.ends_s, body.times_s, row) for row in body.rotation_rad.T]).T
        return np.asarray(at - plan.rotation_rad)

    def dips(self) -> tuple[Array, Array]:
        """Depth of every foot in the air below the plane of the surface that it left, and of the
        one that it comes to, each over its half of the flight, shape (K, N) each [m].
        """
        body, plan = self.leap_body, self.leap_body.plan
        normals, holds = np.array([patch.normal for patch in plan.patches]), body.holds
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
        feet, joints, times, model = (
            self.feet,
            self.kinematics.joints,
            self.times_s,
            self.kinematics.model,
        )
        legs, (left, lands) = [feet[leg] for leg in self.kinematics.legs], self.dips()
        slow = [name for name, there in zip(joints, self._limited, strict=True) if not there]
        unlimited = f"no velocity limit of {', '.join(slow)}" if slow else ""
        weak = "; ".join(filter(None, (unlimited, *model.lines_of(model.torque_doubts))))
        speed = np.where(self._limited, self.speed(), 0.0)
        turned, ends = np.abs(self.turned), self.leap_body.plan.ends_s
        unsure = "; ".join(model.limit_doubts)
        for name, values, limit, names, times_s, limbs, why in (
            ("joints", self.off_toes(), JOINTS_M, feet, times, feet, unsure),
            ("joint_speed", speed, JOINT_SPEED, joints, times[1:], legs, unlimited),
            ("torque", self.line, TORQUE, joints, times[1:-1], legs, weak),
            ("legs_turn", turned, LEGS_TURN_RAD, ("x", "y", "z"), ends, (), ""),
            ("take_off", left, DIP_M, feet, times, feet, ""),
            ("landing", lands, DIP_M, feet, times, feet, ""),
        ):
            unit = _BODY_UNITS[name]
            group = worst_group(name, values, limit, unit, names, times_s, limbs=limbs)
            yield as_far_as_known(group, why)
        if bodies:
            around = obstacles or Obstacles.of(self.leap_body.plan.patches)
            yield looked_at("bodies", lambda: self.bodies("bodies", around))


def with_body(report: Report[LeapPlan]) -> Report[LeapPlan]:
    """The report of ``check_leap`` with the robot's own body, from one without."""
    if report.defect:
        return report
    others = tuple(group for group in report.groups if group.name not in LEAP_BODY)
    try:
        body = list(LeapBodyMeasurements(body_of(report.answer)).groups())
    except InvalidInput as error:  # legs that nobody knows, or no pinocchio
        body = nothing(str(error), _BODY_UNITS)
    return replace(report, groups=(*others, *body))


_INSTANTS = 17
_TOLERANCE = 1e-3
"""Largest violation that is accepted, without unit."""
_SPIN_M2_S = 0.1
"""Momentum that violations of it are measured in at most, whatever a leap allows on its way."""
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
units of the weight, momenta in those of their limit, or ``_SPIN_M2_S``, power in those of the weight times m/s."""


def check_leap(plan: LeapPlan, *, body: bool = False) -> Report[LeapPlan]:
    """Check a plan of a leap by its toes and forces, and by its joints and bodies.

    No solver takes part.

    Arguments:
        body: judge the whole body, too, of a robot that has legs of its own; that takes most of the
            time.

    Returns:
        A report; a bad plan is refused in it, and not raised.
    """
    if defect := _defect(plan):
        broken = (
            violation(name, math.inf, 1.0, _TOLERANCE, unit=unit)
            for name, (unit, _) in _UNITS.items()
        )
        return Report(groups=tuple(broken), answer=plan, tolerance=_TOLERANCE, defect=defect)
    judge, has_legs = _Judge(plan), plan.problem.robot.own
    left_out = nothing("not asked for" if has_legs else _UNJUDGED, _BODY_UNITS)
    report = Report(
        groups=(*judge.groups(), *left_out),
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
    if defect := arrays_defect(plan, leap.columns(), LATER, 1e9):
        return defect
    gather = LEAST_GATHER if plan.gather is None else plan.gather
    if not np.all((gather >= LEAST_GATHER) & (gather <= MOST_GATHER)):
        return f"gather: expected shares of 0.05 to 0.49 and of 0.1 to 1, got {gather.tolist()}"
    if plan.legs_turn_rad is not None and not leap.robot.own:
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
    """One plan: the path that its forces give, and the worst violation of every group.

    paths: (c, v, L per mass, Θ) in every interval at ``_INSTANTS`` instants, shape (M, T, 4, 3).
    """

    def __init__(self, plan: LeapPlan) -> None:
        self.plan, self.leap, self.limits = plan, plan.problem, plan.problem.limits
        robot, self.phase = self.leap.robot, self.leap.interval_phases
        assert robot.inertia is not None
        self.spin = np.linalg.inv(robot.inertia / robot.mass_kg)
        self.unit_m2_s = min(self.limits.momentum_m2_s, _SPIN_M2_S)
        self.holds = self.leap.holds[self.phase]
        self.k, self.i = np.nonzero(self.holds >= 0)
        self.toes = plan.toes_m[self.holds[self.k, self.i]]
        self.paths, self.last = self._paths(), len(self.holds) - 1
        self.states = np.concatenate([self.paths[:, 0], self.paths[-1:, -1]])
        self.worst = Worst(_UNITS, robot.limb_names, _TOLERANCE)

    def groups(self) -> tuple[Group, ...]:
        """The worst of every group."""
        for measure in (
            self._ends,
            self._claims,
            self._forces,
            self._body,
            self._limbs,
            self._toes,
        ):
            measure()
        return tuple(self.worst.groups.values())

    @property
    def momentum_error(self) -> float:
        """Error of the claimed L, in units of its limit."""
        away = np.abs(self.plan.momentum_m2_s - self.states[:, 2])
        return float(away.max()) / self.limits.momentum_m2_s

    def _paths(self) -> Array:
        """Forces are constant in an interval: v is linear, c quadratic, L cubic and Θ of degree 4."""
        leap, plan = self.leap, self.plan
        spans = np.diff(leap.times_s(plan.timing))
        forces = np.where(self.holds[..., None] >= 0, plan.forces_n, 0.0) / leap.robot.mass_kg
        pushes = forces.sum(axis=1)
        twists = cross(plan.toes_m[np.maximum(self.holds, 0)], forces).sum(axis=1)
        start, paths = leap.start, np.empty((len(spans), _INSTANTS, 4, 3))
        com, speed = start.com_m, start.velocity_m_s
        momentum, turn = start.momentum_m2_s, start.rotation_rad
        for k, (span, push) in enumerate(zip(spans, pushes, strict=True)):
            t = np.linspace(0.0, span, _INSTANTS)[:, None]
            rise = push - [0.0, 0.0, GRAVITY_M_S2]
            one, two, three = twists[k] - cross(com, push), -cross(speed, push), -cross(rise, push)
            swept = t * momentum + t**2 / 2.0 * one + t**3 / 6.0 * two + t**4 / 24.0 * three
            paths[k, :, 0] = com + t * speed + t**2 / 2.0 * rise
            paths[k, :, 1] = speed + t * rise
            paths[k, :, 2] = momentum + t * one + t**2 / 2.0 * two + t**3 / 6.0 * three
            paths[k, :, 3] = turn + t / span * plan.turned_rad[k] + swept @ self.spin.T
            com, speed, momentum, turn = paths[k, -1]
        return paths

    def _ends(self) -> None:
        """Start, goal and rest."""
        leap, unit = self.leap, self.unit_m2_s
        com, speed, momentum, turn = self.states[-1]
        away = float(np.linalg.norm(com - leap.goal.com_m)) - leap.goal_radius_m
        self.worst.note("goal", away, self.last)
        self.worst.note("rest", np.abs(speed - leap.goal.velocity_m_s), self.last)
        self.worst.note(
            "momentum", np.abs(momentum - leap.goal.momentum_m2_s), self.last, scale=unit
        )
        self.worst.note("tilt", np.abs(turn) - self.limits.goal_tilt_rad, self.last)
        for k in np.array([0, self.last])[list(leap.still)].tolist():
            self.worst.note("rest", np.abs(self.paths[k, :, 1]), k)
            self.worst.note("momentum", np.abs(self.paths[k, :, 2]), k, scale=unit)

    def _claims(self) -> None:
        """Check the plan's c, v, L and Θ at the ends of intervals."""
        plan, at = self.plan, np.minimum(np.arange(self.last + 2), self.last)
        says = (plan.com_m, plan.velocity_m_s, plan.momentum_m2_s, plan.rotation_rad)
        away = np.abs(np.stack(says, axis=1) - self.states)
        self.worst.note("motion", away[:, 0], at)
        self.worst.note("rest", away[:, 1], at)
        self.worst.note("momentum_balance", away[:, 2], at, scale=self.unit_m2_s)
        self.worst.note("rotation", away[:, 3], at)
        self.worst.note("start", away[0], 0)

    def _forces(self) -> None:
        """Cones and limits of the limbs that stand, nothing at the others; a limb presses less in
        the interval after it lands, and before it lifts.
        """
        leap, weight, k, i = self.leap, self.leap.weight_n, self.k, self.i
        when, limb = np.nonzero(self.holds < 0)
        self.worst.note("idle_force", lengths(self.plan.forces_n[when, limb]), when, limb, weight)
        patches = [leap.patch(j, self.plan.choice) for j in self.holds[k, i].tolist()]
        normals = np.array([patch.normal for patch in patches]).reshape(-1, 3)
        friction, forces = np.array([patch.friction for patch in patches]), self.plan.forces_n[k, i]
        press = np.vecdot(forces, normals)
        shear = lengths(forces - press[:, None] * normals)
        self.worst.note("friction", shear - friction * np.maximum(press, 0.0), k, i, weight)
        air = np.pad(self.holds < 0, ((1, 1), (0, 0)))
        most = weight * self.limits.most(air[k, i], air[k + 2, i])
        self.worst.note("force_bounds", np.maximum(-press, press - most), k, i, weight)

    def _body(self) -> None:
        """Tilt at all instants, L at the end of the interval."""
        limit, each = self.limits.momentum_m2_s, np.arange(self.last + 1)
        self.worst.note("tilt", np.abs(self.paths[:, :, 3]) - self.limits.tilt_rad, each)
        self.worst.note(
            "momentum", np.abs(self.paths[:, -1, 2]) - limit, each, scale=self.unit_m2_s
        )

    def _limbs(self) -> None:
        """Reach, height, length, speed and power of limbs that stand, at all instants."""
        leap, k, i = self.leap, self.k, self.i
        limbs = leap.robot.limbs
        legs = [leap.leg(limb) for limb in limbs]
        shoulders, hips = (
            np.array(each)[i, None]
            for each in ([limb.shoulder_m for limb in limbs], [leg.hip_m for leg in legs])
        )
        reach, fold, fastest, strongest = np.array(
            [
                (limb.reach_m, leg.fold_m, leg.speed_m_s, leg.power_w)
                for limb, leg in zip(limbs, legs, strict=True)
            ]
        )[i].T[..., None]
        com, speed, momentum, turn = np.moveaxis(self.paths[k], 2, 0)
        to_toe = self.toes[:, None] - com
        away = lengths(to_toe - exact_and_linear(turn, shoulders)[0])
        self.worst.note("reach", away - reach, k, i)
        arms = exact_and_linear(-turn, to_toe)[0]
        for number, limb in enumerate(limbs):
            if limb.reach_rows is not None:
                mine, rows = i == number, limb.reach_rows
                beyond = arms[mine] @ rows.normals.T - rows.bounds_m
                self.worst.note("reach", beyond, k[mine], i[mine])
        self.worst.note("height", self.limits.height_m - com[..., 2] + self.toes[:, 2:], k, i)
        arm = exact_and_linear(turn, hips)[0]
        hip = arm - to_toe
        long, moves = lengths(hip), speed + cross(momentum @ self.spin.T, arm)
        self.worst.note("fold", fold - long, k, i)
        rate = np.abs(np.vecdot(hip, moves)) / np.maximum(long, 1e-9)
        power = np.abs(np.vecdot(moves, self.plan.forces_n[k, i][:, None]))
        for name, used, most, scale in (
            ("speed", rate, fastest, 0.0),
            ("power", power, strongest, leap.weight_n),
        ):
            known = most[:, 0] < math.inf
            self.worst.note(name, (used - most)[known], k[known], i[known], scale)

    def _toes(self) -> None:
        """Toes on their patches, or where they stand already."""
        off = patch_distances([patch.vertices_m for patch in self.plan.patches], self.plan.toes_m)
        for foothold, toe, away in zip(self.leap.footholds, self.plan.toes_m, off, strict=True):
            if foothold.toe_m is not None:
                away = lengths(toe - foothold.toe_m)
            first = int(np.flatnonzero(self.phase == foothold.frame)[0])
            limb = np.array([self.leap.robot.limb_names.index(foothold.limb)])
            self.worst.note("patch", float(away), first, limb)
