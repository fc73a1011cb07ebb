"""The independent verifier of trajectories: it knows the robot, the terrain and the samples, not
how they were made.

Everything is measured between the optimiser's knots, in the world frame: balances by the momentum
of finite differences, cones and depths at the true surface, whose normals it takes from heights
alone.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np

from ..answer.report import Group, Report
from ..answer.trajectory import Trajectory
from ..physics import GRAVITY_M_S2
from .trajectory_defects import defect_of
from .trajectory_limits import GROUPS as GROUPS
from .trajectory_limits import WalkLimits as WalkLimits
from .trajectory_measurements import TrajectoryMeasurements
from .trajectory_momentum import MomentumMeasurements
from .trajectory_series import Rows
from .trajectory_steps import StepMeasurements
from .trajectory_whole_body import nothing, whole_body

TIME_S = 1e-9
"""Times are sums of steps: what rounding makes of them [s]."""
OVERFLOW = "the numbers overflow"
__all__ = ["GROUPS", "WalkLimits", "check_trajectory", "with_body"]


def check_trajectory(
    trajectory: Trajectory, limits: WalkLimits = WalkLimits(), *, body: bool = True
) -> Report[Trajectory]:
    """Check everything between the knots that a robot would have to live with; never raises for a
    bad trajectory.

    Arguments:
        body: judge joints, torques and bodies, too, of a robot that has a model; that takes most of
            the time.
    """
    with np.errstate(all="ignore"):
        defect = defect_of(trajectory, limits.step_s)
        if defect:
            return _refused(trajectory, limits, defect)
        measured = TrajectoryMeasurements(trajectory)
        groups = _measured(measured, limits, body=body)
        if not all(math.isfinite(group.value) for group in groups):
            return _refused(trajectory, limits, OVERFLOW)
        return Report(
            groups=groups,
            answer=trajectory,
            tolerance=0.0,
            figures=measured.figures(limits.cone),
            limits=asdict(limits),
        )


def with_body(report: Report[Trajectory], limits: WalkLimits = WalkLimits()) -> Report[Trajectory]:
    """The report of ``check_trajectory`` with the robot's own body, from one without: the other
    groups stay.

    Arguments:
        report: with ``body=False``, for the same limits.
    """
    if report.defect:
        return report
    with np.errstate(all="ignore"):
        groups = {
            group.name: group
            for group in _groups(*whole_body(TrajectoryMeasurements(report.answer), limits))
        }
    if not all(math.isfinite(group.value) for group in groups.values()):
        return _refused(report.answer, limits, OVERFLOW)
    return replace(report, groups=tuple(groups.get(group.name, group) for group in report.groups))


def _measured(
    measured: TrajectoryMeasurements, limits: WalkLimits, *, body: bool
) -> tuple[Group, ...]:
    """The worst of every group, in the order of ``GROUPS``."""
    groups, unasked = whole_body(measured, limits) if body else nothing("not asked for")
    rows = (
        _balances(measured, limits)
        | _contacts(measured, limits)
        | _whole(measured, limits)
        | groups
    )
    return _groups(rows, unasked | _unasked(measured.trajectory))


def _groups(rows: Rows, unasked: dict[str, str]) -> tuple[Group, ...]:
    """The worst of every group that was measured, in the order of ``GROUPS``.

    Arguments:
        unasked: why some are not checked.
    """
    groups = []
    for group, unit in GROUPS.items():
        if group not in rows:
            continue
        series, limit, *rms = rows[group]
        worst, where, time_s = series.worst()
        value, reason = rms[0] if rms else worst, unasked.get(group, "")
        groups.append(
            Group(
                name=group,
                value=value,
                limit=limit,
                unit=unit,
                where=where,
                when=None if math.isnan(time_s) else time_s,
                message=reason,
                verdict="not checked" if reason and value <= limit else "",
            )
        )
    return tuple(groups)


def _unasked(trajectory: Trajectory) -> dict[str, str]:
    """Groups of which a trajectory does not say what is asked for, and what it does not say."""
    reasons = dict[str, str]()
    if trajectory.heading_rad is None and trajectory.heading_end_rad is None:
        reasons["heading"] = "no heading is asked for"
    if not all(trajectory.still):
        reasons |= dict.fromkeys(
            ("rest", "rest_acceleration"), "it is not asked to be at rest at both ends"
        )
    if trajectory.adhesive.any() and trajectory.suction_n is None:
        reasons["suction"] = "no suction of feet that stick"
    return reasons


def _balances(measured: TrajectoryMeasurements, limits: WalkLimits) -> Rows:
    """Newton and Euler, and who could supply what they lack."""
    weight, moment = measured.weight_n, measured.moment_scale_nm
    forces, moments, momentum = (
        measured.force_residual(),
        measured.moment_residual(),
        MomentumMeasurements(measured),
    )
    spin = limits.angular_residual * GRAVITY_M_S2 / measured.robot.stand_height_m
    return {
        "force_balance": (forces.size(), limits.force_balance * weight, forces.rms()),
        "force_peak": (forces.size(), limits.force_peak * weight),
        "moment_balance": (moments.size(), limits.moment_balance * moment, moments.rms()),
        "moment_peak": (moments.size(), limits.moment_peak * moment),
        "impulse": (momentum.impulse(limits.impulse_rate * weight), limits.impulse_s * weight),
        "angular_impulse": (
            momentum.angular_impulse(limits.angular_impulse_rate * moment),
            limits.angular_impulse_s * moment,
        ),
        "angular_residual": (momentum.angular_residual(), spin),
        "traction": (momentum.traction(), limits.traction * weight),
        "traction_impulse": (momentum.traction_impulse(), limits.traction_impulse_s * weight),
        "traction_way": (momentum.traction_way(), limits.traction_way_m),
        "traction_turn": (momentum.traction_turn(), limits.traction_turn_rad),
        "heading": (momentum.heading(), limits.heading_rad),
        "rest": (momentum.rest(), limits.rest_m_s),
        "rest_acceleration": (
            momentum.rest_acceleration(),
            limits.rest_acceleration * GRAVITY_M_S2,
        ),
    }


def _contacts(measured: TrajectoryMeasurements, limits: WalkLimits) -> Rows:
    """Feet: what they press with, where they stand, and how they step."""
    weight, steps = measured.weight_n, StepMeasurements(measured)
    return {
        "cone": (measured.cone(), limits.cone * weight),
        "suction": (measured.suction(), limits.cone * weight),
        "force_foot": (measured.force_foot(), limits.force_foot * weight),
        "swing_force": (measured.swing_force(), limits.swing_force * weight),
        "contact_gap": (measured.contact_gap(), limits.contact_gap_m),
        "slip": (measured.slip(), limits.slip_m),
        "foot_velocity": (steps.foot_velocity(), limits.foot_velocity_m_s),
        "touch_speed": (steps.touch_speed(), limits.touch_speed_m_s),
        "stance_time": (steps.stance_time(limits.least_stance_s), TIME_S),
        "swing_time": (steps.swing_time(limits.least_swing_s), TIME_S),
        "lift": (steps.lift(limits.least_lift_m), 0.0),
        "clearance": (steps.clearance(limits.least_clearance_m), 0.0),
        "drag": (steps.drag(limits.contact_gap_m), limits.drag_m),
        "penetration": (measured.penetration(), limits.penetration_m),
        "penetration_between": (steps.penetration_between(), limits.penetration_m),
        "reach": (measured.reach(), limits.reach_m),
    }


def _whole(measured: TrajectoryMeasurements, limits: WalkLimits) -> Rows:
    """The motion as one, and the course."""
    trajectory = measured.trajectory
    return {
        "rotation": (measured.off_rotation(), limits.rotation),
        "start": (measured.miss(0, trajectory.start_xy_m), limits.start_m),
        "goal": (measured.miss(-1, trajectory.goal_xy_m), limits.goal_m),
        "domain": (measured.domain(), limits.domain_m),
        "continuity": (measured.jumps(), limits.continuity_m),
        "foot_speed": (measured.foot_speed(), limits.foot_speed_m_s),
        "torso_speed": (measured.torso_speed(), limits.torso_speed_m_s),
        "turn_rate": (measured.turn_rate(), limits.turn_rate_rad_s),
        "trunk": (measured.trunk(), limits.trunk_m),
    }


def _refused(trajectory: Trajectory, limits: WalkLimits, defect: str) -> Report[Trajectory]:
    groups = tuple(Group(group, math.inf, 0.0, unit) for group, unit in GROUPS.items())
    return Report(
        groups=groups, answer=trajectory, tolerance=0.0, limits=asdict(limits), defect=defect
    )
