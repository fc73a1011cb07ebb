"""The groups in which a trajectory is judged, and what it may miss in each."""

from __future__ import annotations

from dataclasses import dataclass

from ..answer.certificate import WALK_BODY as WHOLE_BODY
from ..answer.trajectory import STEP_S

__all__ = ["GROUPS", "WHOLE_BODY", "WalkLimits"]

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
"""The groups in the order of a report, and the unit of what is measured; ``docs/verifier.md`` has
their formulas."""


@dataclass(frozen=True, kw_only=True)
class WalkLimits:
    """Tolerances for a trajectory, the same for every chart; forces in units of m·g, moments of
    m·g·stand height.

    The two balances are judged by their root mean square over all samples, and by a wide limit on
    the single sample.

    Arguments:
        cone: how far the tangential force may exceed ν times the normal one; 1e-3 m·g on a foot
            that carries half the weight is an error of .002 in ν, which nobody knows that well, and
            ten times the optimiser's own tolerance.
        continuity_m: ‖x₋ − 2x + x₊‖ of torso and feet; 5 mm at 5 ms is 200 m/s², a jump and no
            swing.
        slip_m: distance of a standing foot from where it came down.
        trunk_m: depth of the trunk's box in the terrain.
        impulse_s, impulse_rate: what a window may gather, and what more for each second of it
            [m·g·s, m·g].
        traction: of what cones cannot give.
        traction_impulse_s: of the same over the whole walk [m·g·s].
        traction_way_m, traction_turn_rad: how far it gets by that, and how far it turns by moments
            that feet cannot give.
        angular_residual, rest_acceleration: in units of g a stand height, and of g. least_…: what a
            phase has at least.
        joints_m: distance of a foot from its toe, with all joints within their limits.
        joint_speed, torque: shares of what the robot's file gives a joint; the rest is what a
            controller corrects by.
        legs_moment: as moment_balance, of the whole robot, whose legs weigh something.
        bodies_m: of one link in another, or in the ground; of the latter what is within 1 mm counts
            as 0. ``docs/verifier.md`` says of each why it is what it is.
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
    force_peak: float = 0.4
    moment_balance: float = 0.05
    moment_peak: float = 0.3
    impulse_s: float = 0.01
    impulse_rate: float = 0.016
    angular_impulse_s: float = 0.015
    angular_impulse_rate: float = 2e-3
    angular_residual: float = 1.0
    traction: float = 0.04
    traction_impulse_s: float = 2e-3
    traction_way_m: float = 0.02
    traction_turn_rad: float = 0.02
    cone: float = 1e-3
    force_foot: float = 2.0
    swing_force: float = 1e-3
    contact_gap_m: float = 1e-3
    slip_m: float = 1e-3
    foot_velocity_m_s: float = 0.01
    touch_speed_m_s: float = 0.6
    least_stance_s: float = 0.1
    least_swing_s: float = 0.1
    least_lift_m: float = 5e-3
    least_clearance_m: float = 1e-3
    drag_m: float = 0.12
    penetration_m: float = 1e-3
    reach_m: float = 3e-3
    trunk_m: float = 0.0
    heading_rad: float = 0.01
    rest_m_s: float = 5e-3
    rest_acceleration: float = 0.02
    joints_m: float = 1e-4
    joint_speed: float = 0.9
    torque: float = 0.9
    legs_moment: float = 0.05
    bodies_m: float = 1e-4
