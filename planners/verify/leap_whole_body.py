"""A leap on the robot's own body: joints, torques, what legs that swing turn, feet that leave and
land, and bodies, by the sweep that judges walks.

Torque has a speed–torque line: a joint that drives gives τ/τ_max + q̇/q̇_max ≤ 1, effort and velocity
being those of the robot's file, and one that brakes τ/τ_max ≤ 1. No motor is looked up: of these
robots none is published with its curve.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..answer.certificate import LEAP_BODY
from ..answer.plan import LeapPlan
from ..answer.report import Group, Report
from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array
from ..motion.leap_motion import LeapBody, gaps
from ..terrain.obstacles import Obstacles
from .moving_body import BodyPath, MovingBodyMeasurements

UNITS = {
    "joints": "m",
    "joint_speed": "1",
    "torque": "1",
    "legs_turn": "rad",
    "take_off": "m",
    "landing": "m",
    "bodies": "m",
}


@dataclass(frozen=True, kw_only=True)
class LeapBodyLimits:
    """Limits of a leap's whole body.

    Arguments:
        joints_m: distance of a foot from where it should be, with all joints within their limits.
        joint_speed, torque: shares of what the robot's file gives a joint, the torque on the
            speed–torque line.
        legs_turn_rad: what legs turn the body by beside what the plan says; joints are judged with
            all of it.
        dip_m: how far a foot in the air is below the plane of the surface that it left or comes to.
    """

    joints_m: float = 1e-4
    joint_speed: float = 0.95
    torque: float = 1.0
    legs_turn_rad: float = 0.05
    dip_m: float = 2e-3


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
        most = np.where(solver.velocity_rad_s > 0.0, solver.velocity_rad_s, np.inf)
        fast = 0.5 * (rates[1:] + rates[:-1]) / most
        return fast, self.torques_nm / solver.torque_nm

    @cached_property
    def line(self) -> Array:
        """Share of the speed–torque line that is used at the inner samples, shape (K − 2, J)."""
        fast, strong = self.shares
        drives = np.where(fast * strong > 0.0, np.abs(fast), 0.0)
        return np.asarray(np.abs(strong) + drives)

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
        limits: LeapBodyLimits = LeapBodyLimits(),
        *,
        bodies: bool = True,
        obstacles: Obstacles | None = None,
    ) -> Iterator[Group]:
        """The groups of ``LEAP_BODY``.

        Arguments:
            bodies: judge them, too.
            obstacles: what they keep out of; the surfaces that are taken where nobody knows more.
        """
        feet, joints, times = self.path.feet, self.kinematics.joints, self.times_s
        off, left = self.off_toes(), self.dips()
        legs = [self.path.feet[leg] for leg in self.kinematics.legs]
        speed, model = self.speed(), self.kinematics.model
        bent = _group("joints", off.values, feet, times, limits.joints_m, feet)
        yield _as_far_as_known(bent, model.limit_doubts)
        fast = _group("joint_speed", speed.values, joints, speed.times_s, limits.joint_speed, legs)
        torque = _group("torque", self.line, joints, times[1:-1], limits.torque, legs)
        known = self.kinematics.velocity_rad_s > 0.0
        slow = [name for name, there in zip(joints, known, strict=True) if not there]
        unlimited = [f"no velocity limit of {', '.join(slow)}"] if slow else []
        yield _as_far_as_known(fast, unlimited)
        yield _as_far_as_known(torque, [*unlimited, *model.lines_of(model.torque_doubts)])
        turned = np.abs(self.turned)
        yield _group(
            "legs_turn",
            turned,
            ("x", "y", "z"),
            self.leap_body.plan.times_s,
            limits.legs_turn_rad,
        )
        yield _group("take_off", left[0], feet, times, limits.dip_m, feet)
        yield _group("landing", left[1], feet, times, limits.dip_m, feet)
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
        unit=UNITS[name],
        where=names[column],
        limb=limbs[column] if limbs else "",
        when=float(times_s[row]),
    )


def _as_far_as_known(group: Group, unlimited: Sequence[str]) -> Group:
    """A group of joints of which some have no limits: what holds of the others is not checked."""
    if not unlimited or group.verdict == "violated":
        return group
    return replace(group, message="; ".join(unlimited), verdict="not checked")


def _body_groups(plan: LeapPlan, limits: LeapBodyLimits = LeapBodyLimits()) -> tuple[Group, ...]:
    """The groups of a leap's whole body; none is checked where the robot's legs are not known, or
    without pinocchio.
    """
    try:
        return tuple(LeapBodyMeasurements(LeapBody(plan)).groups(limits))
    except InvalidInput as error:
        return unjudged(str(error))


def unjudged(why: str) -> tuple[Group, ...]:
    """The groups of a leap's whole body, which nobody judged."""
    return tuple(
        Group(name, unit=UNITS[name], message=why, verdict="not checked") for name in LEAP_BODY
    )


def with_body(
    report: Report[LeapPlan], limits: LeapBodyLimits = LeapBodyLimits()
) -> Report[LeapPlan]:
    """The report of ``check_leap`` with the robot's own body, from one without."""
    if report.defect:
        return report
    others = tuple(group for group in report.groups if group.name not in LEAP_BODY)
    return replace(report, groups=(*others, *_body_groups(report.answer, limits)))
