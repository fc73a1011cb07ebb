"""The independent verifier of trajectories: it knows the robot, the terrain and the samples, not how they were made.

Everything is measured between the optimiser's knots, in the world frame: balances by the momentum of finite
differences, cones and depths at the true surface, whose normals it takes from heights alone.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..answer.report import acceptance_word
from ..answer.trajectory import Trajectory
from ..cached import cached_property
from ..physics import GRAVITY_M_S2
from .trajectory_defects import defect_of
from .trajectory_limits import GROUPS as GROUPS
from .trajectory_limits import Limits as Limits
from .trajectory_measurements import TrajectoryMeasurements
from .trajectory_momentum import MomentumMeasurements
from .trajectory_series import Rows
from .trajectory_steps import StepMeasurements
from .trajectory_whole_body import hindrance, nothing, whole_body

TIME_S = 1e-9
"""Times are sums of steps: what rounding makes of them [s]."""
__all__ = ["GROUPS", "GaitReport", "GroupViolation", "Limits", "check_trajectory"]


@dataclass(frozen=True, slots=True)
class GroupViolation:
    """The worst in one group: value and limit in ``unit`` (SI), inf for a trajectory that is none.

    where: the foot, "torso", or the axis; time_s: when [s], NaN where the group has no moment. checked: False where the
    trajectory does not say what it is asked for, or of which robot's legs; unchecked says why.
    """

    group: str
    value: float
    limit: float
    unit: str
    where: str
    time_s: float
    unchecked: str = ""

    @property
    def checked(self) -> bool:
        """Whether it was."""
        return not self.unchecked

    @property
    def accepted(self) -> bool:
        """Whether the value keeps the limit."""
        return self.value <= self.limit


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitReport:
    """The verifier's word on one walk.

    Arguments:
        accepted: no group that was checked is violated beyond its limit.
        groups: the violation of each group of constraints, its unit, and where it is worst.
        limits: what each group may come to.
        trajectory: what was judged.
        figures: further measurements, none of them judged: peak acceleration and balances in units of g and m·g, the
            friction that the standing feet need and the share of their samples outside their cones.
        defect: why the walk could not be checked at all; empty when it could.
    Source:
        W2-W7, between the knots, too.
    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
        >>> found = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled")
        >>> stancekit.verify(found.trajectory).accepted
        True
    """

    accepted: bool
    groups: tuple[GroupViolation, ...]
    limits: Limits
    trajectory: Trajectory = field(repr=False)
    figures: Mapping[str, float] = field(default_factory=dict)
    defect: str = ""
    """Why the trajectory could not be checked at all; empty when it could."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of trajectory, limits, the groups that were checked, and verdict: what a runner asks for."""
        content = {"limits": asdict(self.limits), "accepted": self.accepted, "defect": self.defect}
        content["checked"] = [group.group for group in self.groups if group.checked]
        if not self.defect:
            content["trajectory"] = self.trajectory.digest
        return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()

    @property
    def unchecked(self) -> tuple[str, ...]:
        """The groups that could not be checked."""
        return tuple(group.group for group in self.groups if not group.checked)

    @cached_property
    def hindrance(self) -> str:
        """Why no runner executes the walk, whatever the world; empty where one may.

        Of a robot without a model, the runner asks the servos of the world what the verifier cannot know.
        """
        return hindrance(self.trajectory, self.unchecked)

    @property
    def refused(self) -> tuple[GroupViolation, ...]:
        """The groups that break their limits, the worst first."""
        broken = [group for group in self.groups if not group.accepted]
        return tuple(sorted(broken, key=lambda g: -g.value / max(g.limit, 1e-12)))

    @property
    def message(self) -> str:
        """One line: the verdict, the worst group, where, when and by how much."""
        if self.defect:
            return f"rejected: {self.defect}"
        if self.accepted:
            within = f"{len(self.groups) - len(self.unchecked)} groups within their limits"
            line = f"{acceptance_word(self.unchecked)}; {within}" if self.unchecked else f"accepted: all {within}"
            return f"{line}; cannot be executed: {self.hindrance}" if self.hindrance else line
        first, *rest = self.refused
        when = "" if math.isnan(first.time_s) else f" at {first.time_s:.3f} s"
        where = f" ({first.where})" if first.where else ""
        unit = "" if first.unit == "1" else f" {first.unit}"
        also = f"; also {', '.join(group.group for group in rest)}" if rest else ""
        return f"rejected: {first.group}{where} {first.value:.3g}{unit}{when}, limit {first.limit:.3g}{unit}{also}"

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; what is not finite becomes null."""
        return {
            "accepted": self.accepted,
            "message": self.message,
            "digest": self.digest,
            "checked": [g.group for g in self.groups if g.checked],
            "not_checked": list(self.unchecked),
            "groups": [
                {
                    "group": g.group,
                    "value": _or_null(g.value),
                    "limit": g.limit,
                    "unit": g.unit,
                    "where": g.where,
                    "time_s": _or_null(g.time_s),
                    "not_checked": g.unchecked,
                }
                for g in self.groups
            ],
            "figures": {name: _or_null(value) for name, value in self.figures.items()},
            "limits": asdict(self.limits),
        }


def check_trajectory(trajectory: Trajectory, limits: Limits = Limits(), *, body: bool = True) -> GaitReport:
    """Check everything between the knots that a robot would have to live with; never raises for a bad trajectory.

    body: judge joints, torques and bodies, too, of a robot that has a model; that takes most of the time.
    """
    with np.errstate(all="ignore"):
        defect = defect_of(trajectory, limits.step_s)
        if defect:
            return _refused(trajectory, limits, defect)
        measured = TrajectoryMeasurements(trajectory)
        groups = _measured(measured, limits, body=body)
        if not all(math.isfinite(group.value) for group in groups):
            return _refused(trajectory, limits, "the numbers overflow")
        return GaitReport(
            accepted=all(group.accepted for group in groups),
            groups=groups,
            limits=limits,
            trajectory=trajectory,
            figures=measured.figures(limits.cone),
        )


def _measured(measured: TrajectoryMeasurements, limits: Limits, *, body: bool) -> tuple[GroupViolation, ...]:
    """The worst of every group, in the order of ``GROUPS``."""
    own, unasked = whole_body(measured, limits) if body else nothing("not asked for")
    rows = _balances(measured, limits) | _contacts(measured, limits) | _whole(measured, limits) | own
    unasked |= _unasked(measured.trajectory)
    found = []
    for group, unit in GROUPS.items():
        series, limit, *rms = rows[group]
        worst, where, time_s = series.worst()
        value = rms[0] if rms else worst
        found.append(GroupViolation(group, value, limit, unit, where, time_s, unasked.get(group, "")))
    return tuple(found)


def _unasked(trajectory: Trajectory) -> dict[str, str]:
    """Groups of which a trajectory does not say what is asked for, and what it does not say."""
    found = dict[str, str]()
    if trajectory.heading_rad is None and trajectory.heading_end_rad is None:
        found["heading"] = "no heading is asked for"
    if not all(trajectory.still):
        found |= dict.fromkeys(("rest", "rest_acceleration"), "it is not asked to be at rest at both ends")
    if trajectory.adhesive.any() and trajectory.suction_n is None:
        found["suction"] = "no suction of feet that stick"
    return found


def _balances(measured: TrajectoryMeasurements, limits: Limits) -> Rows:
    """Newton and Euler, and who could supply what they lack."""
    weight, moment = measured.weight_n, measured.moment_scale_nm
    forces, moments, momentum = measured.force_residual(), measured.moment_residual(), MomentumMeasurements(measured)
    spin = limits.angular_residual * GRAVITY_M_S2 / measured.robot.stand_height_m
    return {
        "force_balance": (forces.size(), limits.force_balance * weight, forces.rms()),
        "force_peak": (forces.size(), limits.force_peak * weight),
        "moment_balance": (moments.size(), limits.moment_balance * moment, moments.rms()),
        "moment_peak": (moments.size(), limits.moment_peak * moment),
        "impulse": (momentum.impulse(limits.impulse_rate * weight), limits.impulse_s * weight),
        "angular_impulse": (
            momentum.angular_impulse(limits.angular_impulse_rate * moment), limits.angular_impulse_s * moment,
        ),
        "angular_residual": (momentum.angular_residual(), spin),
        "traction": (momentum.traction(), limits.traction * weight),
        "traction_impulse": (momentum.traction_impulse(), limits.traction_impulse_s * weight),
        "traction_way": (momentum.traction_way(), limits.traction_way_m),
        "traction_turn": (momentum.traction_turn(), limits.traction_turn_rad),
        "heading": (momentum.heading(), limits.heading_rad),
        "rest": (momentum.rest(), limits.rest_m_s),
        "rest_acceleration": (momentum.rest_acceleration(), limits.rest_acceleration * GRAVITY_M_S2),
    }  # fmt: skip


def _contacts(measured: TrajectoryMeasurements, limits: Limits) -> Rows:
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


def _whole(measured: TrajectoryMeasurements, limits: Limits) -> Rows:
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


def _refused(trajectory: Trajectory, limits: Limits, defect: str) -> GaitReport:
    groups = tuple(GroupViolation(group, math.inf, 0.0, unit, "", math.nan) for group, unit in GROUPS.items())
    return GaitReport(accepted=False, groups=groups, limits=limits, trajectory=trajectory, defect=defect)


def _or_null(number: float) -> float | None:
    return number if math.isfinite(number) else None
