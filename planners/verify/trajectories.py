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
from functools import cached_property
from typing import Any

import numpy as np

from ..gait.trajectory import STEP_S, Trajectory
from .trajectory_measurements import Series, TrajectoryMeasurements, defect_of

__all__ = ["GROUPS", "GaitReport", "GroupViolation", "Limits", "check_trajectory"]

GROUPS = {
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
    "cone": "N",
    "swing_force": "N",
    "contact_gap": "m",
    "slip": "m",
    "penetration": "m",
    "reach": "m",
    "trunk": "m",
}
"""The groups in the order of a report, and the unit of what is measured."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a trajectory may miss by, the same for every chart; forces in units of m·g, moments of m·g·stand height.

    The two balances are judged by their root mean square over all samples, and by a wide limit on the single sample.
    cone: how far the tangential force may exceed ν times the normal one; 1e-3 m·g on a foot that carries half the
    weight is an error of .002 in ν, which nobody knows that well, and ten times the optimiser's own tolerance.
    continuity_m: ‖x₋ − 2x + x₊‖ of torso and feet; 5 mm at 5 ms is 200 m/s², a jump and no swing.
    slip_m: distance of a standing foot from where it came down. trunk_m: depth of the trunk's box in the terrain.
    """

    step_s: float = STEP_S
    rotation: float = 1e-6
    start_m: float = 5e-3
    goal_m: float = 5e-3
    domain_m: float = 0.0
    continuity_m: float = 5e-3
    foot_speed_m_s: float = 10.0
    torso_speed_m_s: float = 3.0
    turn_rate_rad_s: float = 6.0
    force_balance: float = 0.05
    force_peak: float = 0.5
    moment_balance: float = 0.05
    moment_peak: float = 0.5
    cone: float = 1e-3
    swing_force: float = 1e-3
    contact_gap_m: float = 1e-3
    slip_m: float = 1e-3
    penetration_m: float = 1e-3
    reach_m: float = 3e-3
    trunk_m: float = 0.0


@dataclass(frozen=True, slots=True)
class GroupViolation:
    """The worst in one group: value and limit in ``unit`` (SI), inf for a trajectory that is none.

    where: the foot, "torso", or the axis; time_s: when [s], NaN where the group has no moment.
    """

    group: str
    value: float
    limit: float
    unit: str
    where: str
    time_s: float

    @property
    def accepted(self) -> bool:
        """Whether the value keeps the limit."""
        return self.value <= self.limit


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitReport:
    """What the verifier says of one trajectory.

    figures: further measurements, none of them judged: peak acceleration and balances in units of g and m·g, the
    friction that the standing feet need and the share of their samples outside their cones.
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
        """SHA-256 of trajectory, limits and verdict: what a runner asks for."""
        content = {"limits": asdict(self.limits), "accepted": self.accepted, "defect": self.defect}
        if not self.defect:
            content["trajectory"] = self.trajectory.digest
        return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()

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
            return f"accepted: all {len(self.groups)} groups within their limits"
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
            "groups": [
                {
                    "group": g.group,
                    "value": _or_null(g.value),
                    "limit": g.limit,
                    "unit": g.unit,
                    "where": g.where,
                    "time_s": _or_null(g.time_s),
                }
                for g in self.groups
            ],
            "figures": {name: _or_null(value) for name, value in self.figures.items()},
            "limits": asdict(self.limits),
        }


def check_trajectory(trajectory: Trajectory, limits: Limits = Limits()) -> GaitReport:
    """Check everything between the knots that a robot would have to live with; never raises for a bad trajectory."""
    with np.errstate(all="ignore"):
        defect = defect_of(trajectory, limits.step_s)
        if defect:
            return _refused(trajectory, limits, defect)
        measured = TrajectoryMeasurements(trajectory)
        groups = _measured(measured, limits)
        if not all(math.isfinite(group.value) for group in groups):
            return _refused(trajectory, limits, "the numbers overflow")
        return GaitReport(
            accepted=all(group.accepted for group in groups),
            groups=groups,
            limits=limits,
            trajectory=trajectory,
            figures=measured.figures(limits.cone),
        )


def _measured(measured: TrajectoryMeasurements, limits: Limits) -> tuple[GroupViolation, ...]:
    """The worst of every group, in the order of ``GROUPS``."""
    weight, moment = measured.weight_n, measured.moment_scale_nm
    force_residual, moment_residual = measured.force_residual(), measured.moment_residual()
    trajectory = measured.trajectory
    rows: tuple[tuple[Series, float, float | None], ...] = (
        (measured.off_rotation(), limits.rotation, None),
        (measured.miss(0, trajectory.start_xy_m), limits.start_m, None),
        (measured.miss(-1, trajectory.goal_xy_m), limits.goal_m, None),
        (measured.domain(), limits.domain_m, None),
        (measured.jumps(), limits.continuity_m, None),
        (measured.foot_speed(), limits.foot_speed_m_s, None),
        (measured.torso_speed(), limits.torso_speed_m_s, None),
        (measured.turn_rate(), limits.turn_rate_rad_s, None),
        (force_residual.size(), limits.force_balance * weight, force_residual.rms()),
        (force_residual.size(), limits.force_peak * weight, None),
        (moment_residual.size(), limits.moment_balance * moment, moment_residual.rms()),
        (moment_residual.size(), limits.moment_peak * moment, None),
        (measured.cone(), limits.cone * weight, None),
        (measured.swing_force(), limits.swing_force * weight, None),
        (measured.contact_gap(), limits.contact_gap_m, None),
        (measured.slip(), limits.slip_m, None),
        (measured.penetration(), limits.penetration_m, None),
        (measured.reach(), limits.reach_m, None),
        (measured.trunk(), limits.trunk_m, None),
    )
    found = []
    for (group, unit), (series, limit, value) in zip(GROUPS.items(), rows, strict=True):
        worst, where, time_s = series.worst()
        found.append(GroupViolation(group, worst if value is None else value, limit, unit, where, time_s))
    return tuple(found)


def _refused(trajectory: Trajectory, limits: Limits, defect: str) -> GaitReport:
    groups = tuple(GroupViolation(group, math.inf, 0.0, unit, "", math.nan) for group, unit in GROUPS.items())
    return GaitReport(accepted=False, groups=groups, limits=limits, trajectory=trajectory, defect=defect)


def _or_null(number: float) -> float | None:
    return number if math.isfinite(number) else None
