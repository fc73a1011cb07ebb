"""Report on a run: planned against measured, what was sent, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .acceptance import JointNeeds, load
from .control.estimation import odometry_error_m
from .control.friction import FrictionInterval, estimated
from .execution import Execution
from .log import Record
from .prepared import BodyFrom, Prepared, body_from
from .safety.guard import Ended, SafeWorld
from .settings import RunSettings
from .worlds.hardware import ReplayWorld


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
        replay_rad: largest difference of a command from that in the log which is replayed [rad].
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
    replay_rad: float | None = None
    needs: JointNeeds | None = None
    loads: JointNeeds | None = None
    friction: FrictionInterval | None = None
    loop_share: float = 1.0
    stopped_s: float | None = None
    after: int = 0
    after_s: float = 0.0
    load: float = float("nan")
    lacks: str = ""

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
        execution, measured = None, world.capabilities.has_body_pose and not world.dry
        if measured and record.pairs:
            execution = prepared.execution(world, record, settings, wall_s)
            message = message or execution.message
        angles = np.array([state.angles_rad for _, state in record.pairs]).reshape(
            -1, len(world.joints)
        )
        away = np.abs(
            angles
            - np.array([target.angles_rad for target, _ in record.pairs]).reshape(angles.shape)
        )
        planned, felt = _needs(record, world)
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
            odometry_m=_by_odometry(record, prepared, world, settings),
            body_from=body_from(world, settings),
            replay_rad=world.world.worst_rad if isinstance(world.world, ReplayWorld) else None,
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
        )

    def to_json(self) -> dict[str, Any]:
        """JSON-ready."""
        record = {name: value for name, value in self.__dict__.items() if name not in _NESTED}
        numbers = {
            n: None if isinstance(v, float) and not np.isfinite(v) else v for n, v in record.items()
        }
        nested = {
            "execution": self.execution,
            "needs": self.needs,
            "loads": self.loads,
            "friction": self.friction,
        }
        return numbers | {
            "ended": self.ended.to_json(),
            "cycle_s": [None if not np.isfinite(value) else value for value in self.cycle_s],
            **{name: values and values.to_json() for name, values in nested.items()},
        }


_NESTED = ("ended", "execution", "cycle_s", "needs", "loads", "friction")


def _by_odometry(
    record: Record, prepared: Prepared, world: SafeWorld, settings: RunSettings
) -> float:
    """Largest distance of the body from the plan, where joints alone measure it
    [m].
    """
    seen = world.dry or body_from(world, settings) == "the world"
    return (
        float("nan") if seen or not record.pairs else odometry_error_m(record, prepared.kinematics)
    )


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
