"""Planned against measured: what the record of a run says where the world measures body and
forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stancekit.planners.files.arrays import Array, check_numbers
from stancekit.planners.robot.kinematics import Kinematics

from .log import Record, Trace
from .safety.guard import SafeWorld


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """When a run is a success, and how far from its plan it is stopped.

    Arguments:
        com_m: largest distance of the final centre of mass from the plan's.
        joint_rad: the same of the joints.
        slip_m: longest distance that a foot slides while it should stand.
        body_m, body_rad: a body farther than this from where it should be has fallen, and stops the
            run, where the world measures it.
    """

    com_m: float = 0.03
    joint_rad: float = 0.1
    slip_m: float = 0.02
    body_m: float = 0.10
    body_rad: float = 0.5

    def __post_init__(self) -> None:
        check_numbers(self, "tolerance.", above=self.__annotations__)


@dataclass(frozen=True, kw_only=True, eq=False)
class Execution:
    """Record of how a motion was followed; P footholds, J joints.

    Arguments:
        succeeded: True within ``Tolerance``.
        message: why not.
        fallen_s: when it fell, None if it did not.
        com_final_m: distance of the final centre of mass from the plan's.
        com_worst_m, tilt_worst_rad: largest on the path.
        body_rms_m, body_worst_m, body_final_m: distance of the body's origin from where it should
            be.
        slip_m: of every foothold since it touched, and late_s: how long after it should have that
            was, shape (P,).
        force_rms_n: root mean square, over time and the feet that should stand, of the difference
            between measured and planned forces.
        torque_worst_nm, planned_torque_nm: largest of any joint, measured and as planned.
        torque_limit_nm: the strongest joint's.
        torque_share: largest measured torque of every joint in units of its own limit, shape (J,).
        error_m: worst of the inverse kinematics.
        shift_m: largest distance of the centre of mass from the body's origin.
        bump_s: how long anything but feet was touched.
        seconds: duration in the world's time.
        wall_s: what that took.
    """

    world: str
    succeeded: bool
    message: str
    fallen_s: float | None
    com_final_m: float
    com_worst_m: float
    tilt_worst_rad: float
    body_rms_m: float
    body_worst_m: float
    body_final_m: float
    slip_m: Array
    late_s: Array
    force_rms_n: float
    torque_worst_nm: float
    planned_torque_nm: float
    torque_limit_nm: float
    torque_share: Array
    error_m: float
    shift_m: float
    bump_s: float
    seconds: float
    wall_s: float
    trace: Trace

    @classmethod
    def of(
        cls,
        record: Record,
        kinematics: Kinematics,
        world: SafeWorld,
        *,
        goal_m: Array,
        stances: Sequence[str],
        tolerance: Tolerance,
        wall_s: float,
        touch_downs_m: Array | None = None,
    ) -> Execution:
        """Compare a record, of one period or more, with what was planned.

        Arguments:
            goal_m: where the centre of mass should end, shape (3,).
            stances: what every foothold is called in a message.
            wall_s: real time taken [s].
            touch_downs_m: how far beyond its place the ground of each foothold may be, 0 of what is
                exact, shape (P,); None where feet do not feel.
        """
        trace = Trace.of(record, kinematics)
        planned = Rotation.from_rotvec([target.sample.rotation_rad for target, _ in record.pairs])
        turned = (planned.inv() * Rotation.from_matrix(trace.rotation)).magnitude()
        away = np.linalg.norm(
            trace.origin_m - [target.origin_m for target, _ in record.pairs], axis=1
        )
        down = np.flatnonzero((away > tolerance.body_m) | (turned > tolerance.body_rad))
        fallen_s = float(trace.time_s[down[0]]) if len(down) else None
        final = float(np.linalg.norm(trace.com_m[-1] - goal_m))
        slip = trace.slips(len(stances))
        limits_nm = world.capabilities.torque_nm
        between = trace.forces_n - trace.planned_forces_n
        wrong = _wrong(stances, tolerance, trace, fallen_s, final, slip)
        if touch_downs_m is not None:
            wrong += _not_found(stances, trace, touch_downs_m)
        return cls(
            world=world.name,
            succeeded=not wrong,
            message="; ".join(wrong),
            fallen_s=fallen_s,
            com_final_m=final,
            com_worst_m=float(np.linalg.norm(trace.com_m - trace.planned_com_m, axis=1).max()),
            tilt_worst_rad=float(turned.max()),
            body_rms_m=float(np.sqrt(np.mean(away**2))),
            body_worst_m=float(away.max()),
            body_final_m=float(away[-1]),
            slip_m=slip,
            late_s=trace.late(len(stances)),
            force_rms_n=float(np.sqrt(np.mean(np.sum(between[trace.foothold >= 0] ** 2, axis=-1)))),
            torque_worst_nm=float(np.abs(trace.torques_nm).max()),
            planned_torque_nm=float(np.abs(trace.planned_torques_nm).max()),
            torque_limit_nm=float(limits_nm.max()),
            torque_share=np.abs(trace.torques_nm).max(axis=0) / limits_nm,
            error_m=max(float(target.error_m.max()) for target, _ in record.pairs),
            shift_m=max(float(np.linalg.norm(target.shift_m)) for target, _ in record.pairs),
            bump_s=float(np.count_nonzero(trace.bump_n > 0.0) / world.rate_hz),
            seconds=float(trace.time_s[-1]),
            wall_s=wall_s,
            trace=trace,
        )

    def to_json(self) -> dict[str, Any]:
        """The figures without their trace, JSON-ready."""
        record = {
            item.name: getattr(self, item.name) for item in fields(self) if item.name != "trace"
        }
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in record.items()
        }


def _wrong(
    stances: Sequence[str],
    tolerance: Tolerance,
    trace: Trace,
    fallen_s: float | None,
    final: float,
    slip: Array,
) -> list[str]:
    """Faults against the tolerance, in words."""
    worst, wrong = int(np.argmax(slip)), list[str]()
    if fallen_s is not None:
        wrong.append(f"fell after {fallen_s:.2f} s, at frame {trace.frame[-1]:.1f}")
    if final > tolerance.com_m:
        wrong.append(f"the centre of mass ended {1e3 * final:.0f} mm from the plan's")
    if slip[worst] > tolerance.slip_m:
        wrong.append(f"{stances[worst]} slipped {1e3 * slip[worst]:.0f} mm")
    return wrong


def _not_found(stances: Sequence[str], trace: Trace, touch_downs_m: Array) -> list[str]:
    """The footholds on noisy ground whose feet felt nothing all the while they should stand, in
    words.
    """
    missed = np.flatnonzero((touch_downs_m > 0.0) & ~trace.found(len(stances)))
    if not len(missed):
        return []
    first = int(missed[0])
    more = f", nor did {len(missed) - 1} others" if len(missed) > 1 else ""
    return [
        f"{stances[first]} found no ground within {1e3 * touch_downs_m[first]:.0f} mm of its "
        f"place{more}"
    ]
