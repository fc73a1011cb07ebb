"""Report on a run: planned against measured, what was sent, and how it ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics

from .acceptance import JointNeeds, load
from .control.estimation import FrictionInterval, estimated, odometry_error_m
from .log import Record, Trace, plain
from .prepared import BodyFrom, Prepared, body_from
from .safety.guard import Ended, SafeWorld
from .settings import RunSettings, Tolerance


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
        return dict(plain({name: each for name, each in vars(self).items() if name != "trace"}))


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


@dataclass(frozen=True, kw_only=True, eq=False)
class RunReport:
    """Report on a run.

    Arguments:
        world: where it ran; digest: of the verdict on what was run; dry: nothing was sent.
        succeeded: to its end, with joints and, where it is measured, the body where they should be.
        message: why not.
        ended: how the robot was left.
        counted: what frames and frames_done, so many of all, count.
        seconds: duration of the motion [s].
        pace: of that asked for; bound_by: what slowed it down.
        sent, clipped, refused: commands, see ``SafeWorld``.
        joint_worst_rad, joint_rms_rad: measured against planned angles, NaN where the motion never
            began; joint_worst: the joint, then empty.
        body_measured: whether the body's pose was measured; body_from: the source of where
            it is.
        cycle_s: median and 99th percentile of the control period, from one command to the next [s].
        wall_s: wall-clock time [s].
        execution: planned against measured, where body and forces are measured; what ``film``
            shows.
        odometry_m: where the world did not tell it, how far the body was from the plan at most by
            ``leg_odometry``, NaN elsewhere and in a dry run [m].
        needs, loads: of the joints, as planned, and as measured where torques are; None where the
        motion never began.
        friction: what feet felt of it, as a share of what was planned with, None where body or
            forces are not measured.
        loop_share: share of their stiffness that the joint loops showed, 1 if unknown.
        stopped_s: when the latch was tripped, on the monotonic clock that all processes of a
            machine share, None where it was not; after: commands on their way at that moment, or
            by which a leap of a simulation landed, whose write returned up to after_s later.
        load: processes that wanted a processor in the last minute, for each that there is; NaN if
            unknown.
        lacks: properties of the robot that the world lacks, empty if it reports none.
        doubts: of the motion's robot and ground, one line each.
    Source:
        None: planned against measured.

    Example:
        >>> import stancekit
        >>> report = stancekit.simulate("plan.json")  # doctest: +SKIP
        >>> stancekit.RunReport.__name__
        'RunReport'
    """

    world: str
    digest: str
    dry: bool
    succeeded: bool
    message: str
    ended: Ended
    counted: str
    frames: float
    frames_done: float
    seconds: float
    pace: float
    bound_by: str
    sent: int
    clipped: int
    refused: int
    joint_worst_rad: float
    joint_worst: str
    joint_rms_rad: float
    body_measured: bool
    cycle_s: tuple[float, float]
    wall_s: float
    execution: Execution | None
    odometry_m: float = float("nan")
    body_from: BodyFrom = "nothing"
    needs: JointNeeds | None = None
    loads: JointNeeds | None = None
    friction: FrictionInterval | None = None
    loop_share: float = 1.0
    stopped_s: float | None = None
    after: int = 0
    after_s: float = 0.0
    load: float = float("nan")
    lacks: str = ""
    doubts: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        record: Record,
        prepared: Prepared,
        world: SafeWorld,
        settings: RunSettings,
        *,
        ended: Ended,
        message: str,
        wall_s: float,
    ) -> RunReport:
        """The report of what was recorded.

        Arguments:
            message: what stopped it, empty where nothing did.
        """
        execution, measured = None, world.senses and not world.dry
        if measured and record.pairs:
            execution = Execution.of(
                record,
                prepared.kinematics,
                world,
                goal_m=prepared.ends_m[1],
                stances=prepared.motion.stances,
                tolerance=settings.tolerance,
                wall_s=wall_s,
                touch_downs_m=prepared.touch_downs_m if prepared.sees else None,
            )
            message = message or execution.message
        angles = np.array([state.angles_rad for _, state in record.pairs]).reshape(
            -1, len(world.joints)
        )
        away = np.abs(
            angles
            - np.array([target.angles_rad for target, _ in record.pairs]).reshape(angles.shape)
        )
        planned, felt = _needs(record, world)
        seen = world.dry or not record.pairs or body_from(world, settings) == "the world"
        latch, last = world.latch, record.pairs[-1] if record.pairs else None
        cycles = np.diff(record.began_s) if len(record.began_s) > 1 else np.array([np.nan])
        return cls(
            world=world.name,
            digest=prepared.accepted.digest,
            dry=world.dry,
            succeeded=not message,
            message=message,
            ended=ended,
            counted=prepared.counted,
            frames=prepared.last_frame + 1,
            frames_done=0.0 if last is None else float(last[0].sample.frame),
            seconds=0.0 if last is None else float(last[1].time_s - record.pairs[0][1].time_s),
            pace=prepared.motion.pace,
            bound_by=prepared.motion.bound_by,
            sent=world.sent,
            clipped=world.clipped,
            refused=world.refused,
            joint_worst_rad=float(away.max()) if away.size else float("nan"),
            joint_worst=world.joints[int(np.argmax(away.max(axis=0)))] if away.size else "",
            joint_rms_rad=float(np.sqrt(np.mean(away**2))) if away.size else float("nan"),
            body_measured=measured,
            cycle_s=(float(np.median(cycles)), float(np.percentile(cycles, 99.0))),
            wall_s=wall_s,
            execution=execution,
            odometry_m=float("nan") if seen else odometry_error_m(record, prepared.kinematics),
            body_from=body_from(world, settings),
            needs=planned,
            loads=felt if measured else None,
            friction=estimated(record, 1.0 / world.rate_hz)
            if execution is not None and prepared.sees
            else None,
            loop_share=1.0 if last is None else last[0].loop_share,
            stopped_s=latch.time_s if latch.tripped else None,
            after=latch.after,
            after_s=latch.after_s,
            load=load(),
            lacks=getattr(world.world, "lacks", ""),
            doubts=prepared.accepted.plan.doubts,
        )

    def to_json(self) -> dict[str, Any]:
        """JSON-ready."""
        record = {name: value for name, value in vars(self).items() if name not in _NESTED}
        return dict(plain(record)) | {
            "ended": plain(self.ended),
            "cycle_s": plain(self.cycle_s),
            **{
                name: (each := getattr(self, name)) and each.to_json()
                for name in ("execution", "needs", "loads")
            },
            "friction": plain(self.friction),
        }


_NESTED = ("ended", "execution", "cycle_s", "needs", "loads", "friction")


def _needs(record: Record, world: SafeWorld) -> tuple[JointNeeds | None, JointNeeds | None]:
    """Torques that the joints were to give, with what moves them, and torques that they gave."""
    if not record.pairs:
        return None, None
    planned, felt = (
        [target.torques_nm for target, _ in record.pairs],
        [s.torques_nm for _, s in record.pairs],
    )
    make = partial(
        JointNeeds.of, world.joints, world.drives.actuators, period_s=1.0 / world.rate_hz
    )
    return make(torques_nm=np.array(planned)), make(torques_nm=np.array(felt))
