"""Execution of a plan on a world, and how what happened compares with what was planned."""

from __future__ import annotations

import io
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array, checked, gathered
from stancekit.planners.robot.kinematics import Kinematics, rotation_of
from stancekit.planners.robot.urdf import Servo

from .control.force_distribution import shared_forces
from .control.tracker import Feel, Target, Tracker
from .motion.timeline import Motion, Timing
from .worlds import make_world
from .worlds.world import State, World


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """When an execution is a success.

    com_m: largest distance of the final centre of mass from the plan's. slip_m: longest way that a foot slides
    while it should stand. fall_m, fall_rad: a body farther from where it should be at any time has fallen.
    """

    com_m: float = 0.03
    slip_m: float = 0.02
    fall_m: float = 0.10
    fall_rad: float = 0.5

    def __post_init__(self) -> None:
        gathered(*(lambda n=n: checked(getattr(self, n), f"tolerance.{n}", above=0.0) for n in self.__annotations__))


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """What was recorded, a row a control period, T of them; N limbs, J joints.

    com_m, planned_com_m: shape (T, 3). frame: progress in key frames, shape (T,). origin_m, rotation: of the body's
    frame, shape (T, 3), (T, 3, 3). feet_m: centres, shape (T, N, 3); rolled_m: of that, what they should have rolled
    since they were put down. forces_n, planned_forces_n: shape (T, N, 3).
    angles_rad, torques_nm, planned_torques_nm: shape (T, J). placement: what every limb should stand on, −1 in the
    air, shape (T, N). bump_n: terrain on anything but feet, shape (T,).
    """

    time_s: Array
    frame: Array
    com_m: Array
    planned_com_m: Array
    origin_m: Array
    rotation: Array
    feet_m: Array
    rolled_m: Array
    forces_n: Array
    planned_forces_n: Array
    angles_rad: Array
    torques_nm: Array
    planned_torques_nm: Array
    placement: Array
    bump_n: Array

    def to_npz(self) -> bytes:
        """All arrays by their names, as a NumPy archive."""
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **{item.name: getattr(self, item.name) for item in fields(self)})
        return buffer.getvalue()


@dataclass(frozen=True, kw_only=True, eq=False)
class Execution:
    """How an execution went.

    succeeded: by ``Tolerance``; message: why not. fallen_s: when it fell, None if it did not. com_final_m: distance of
    the final centre of mass from the plan's; com_worst_m, tilt_worst_rad: largest on the way. slip_m: of every
    placement, shape (P,). force_rms_n: root mean square, over time and the feet that should stand, of the difference
    between simulated and planned forces. torque_worst_nm, planned_torque_nm: largest of any joint, simulated and as
    planned; torque_limit_nm: the servo's. error_m: worst of the inverse kinematics. shift_m: largest distance of the
    centre of mass from the body's origin, zero in paper E. bump_s: how long the terrain pressed on anything but feet.
    seconds: simulated; wall_s: what that took.
    """

    world: str
    succeeded: bool
    message: str
    fallen_s: float | None
    com_final_m: float
    com_worst_m: float
    tilt_worst_rad: float
    slip_m: Array
    force_rms_n: float
    torque_worst_nm: float
    planned_torque_nm: float
    torque_limit_nm: float
    error_m: float
    shift_m: float
    bump_s: float
    seconds: float
    wall_s: float
    trace: Trace

    def to_json(self) -> dict[str, Any]:
        """The report without its trace, JSON-ready."""
        found = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "trace"}
        return found | {"slip_m": self.slip_m.tolist()}


def simulate(plan: Plan, world: str, *, servo: Servo = Servo(), rate_hz: float = 200.0, **options: Any) -> Execution:
    """Make a world by name, execute the plan on it, close it. options: of ``execute``."""
    course = plan.course
    with make_world(world, course.robot, servo, rate_hz=rate_hz, gravity_m_s2=course.gravity_m_s2) as made:
        return execute(plan, made, **options)


def execute(
    plan: Plan,
    world: World,
    *,
    timing: Timing = Timing(),
    feel: Feel = Feel(),
    tolerance: Tolerance = Tolerance(),
    forces: Literal["shared", "planned"] = "shared",
) -> Execution:
    """Execute a plan on a world and compare.

    forces: press as planned, or shared anew among the limbs of every stance with a reserve of friction
    (``planners.force_share``). Raises InvalidInput for a schedule that lifts all limbs at once, or without pinocchio.
    """
    begin = time.perf_counter()
    kinematics = Kinematics(plan.course.robot, world.servo, gravity_m_s2=plan.course.gravity_m_s2)
    motion = Motion(plan, timing, shared_forces(plan) if forces == "shared" else None)
    tracker = Tracker(motion, kinematics, world.rate_hz, feel)
    first = tracker.start()
    state = world.reset(plan.course.terrain, first.angles_rad, first.origin_m, rotation_of(first.instant.rotation_rad))
    rows, fallen = list[tuple[Target, State]](), None
    felt = first.instant.forces_n
    while fallen is None and (target := tracker.next(felt)) is not None:
        state = world.step(target.targets_rad)
        felt = state.forces_n
        rows.append((target, state))
        away = float(np.linalg.norm(state.position_m - target.origin_m))
        if away > tolerance.fall_m or _turned(target, state) > tolerance.fall_rad:
            fallen = state.time_s
    return judged(plan, world, rows, traced(rows, kinematics), tolerance, fallen, time.perf_counter() - begin)


def slips(trace: Trace, placements: int) -> Array:
    """How far every placement's foot slid from where it first stood, while it should stand, shape (P,) [m].

    That is its centre's way less what it should have rolled.
    """
    found, feet = np.zeros(placements), trace.feet_m - trace.rolled_m
    for placement in range(placements):
        rows, limbs = np.nonzero(trace.placement == placement)
        if len(rows):
            way = feet[rows, limbs] - feet[rows[0], limbs[0]]
            found[placement] = float(np.linalg.norm(way, axis=1).max())
    return found


def _turned(target: Target, state: State) -> float:
    """Angle between the body's rotation and the planned one [rad]."""
    between = rotation_of(target.instant.rotation_rad).T @ state.rotation
    return float(np.arccos(np.clip((np.trace(between) - 1.0) / 2.0, -1.0, 1.0)))


def traced(rows: list[tuple[Target, State]], kinematics: Kinematics) -> Trace:
    """What was recorded, from the targets and states of every control period."""
    return Trace(
        time_s=np.array([s.time_s for _, s in rows]),
        frame=np.array([t.instant.frame for t, _ in rows]),
        com_m=np.array([s.position_m + s.rotation @ kinematics.com_offset(s.angles_rad) for _, s in rows]),
        planned_com_m=np.array([t.instant.com_m for t, _ in rows]),
        origin_m=np.array([s.position_m for _, s in rows]),
        rotation=np.array([s.rotation for _, s in rows]),
        feet_m=np.array([s.feet_m for _, s in rows]),
        rolled_m=np.array([t.rolled_m for t, _ in rows]),
        forces_n=np.array([s.forces_n for _, s in rows]),
        planned_forces_n=np.array([t.instant.forces_n for t, _ in rows]),
        angles_rad=np.array([s.angles_rad for _, s in rows]),
        torques_nm=np.array([s.torques_nm for _, s in rows]),
        planned_torques_nm=np.array([t.torques_nm for t, _ in rows]),
        placement=np.array([t.instant.placement for t, _ in rows]),
        bump_n=np.array([s.bump_n for _, s in rows]),
    )


def judged(
    plan: Plan,
    world: World,
    rows: list[tuple[Target, State]],
    trace: Trace,
    tolerance: Tolerance,
    fallen: float | None,
    wall: float,
) -> Execution:
    """Compare a trace with its plan. fallen: when the robot fell [s], None if it did not; wall: real time taken [s]."""
    stances = [f"{each.limb}, put down at frame {each.frame}," for each in plan.course.placements]
    return compared(plan.com_m[-1], stances, world, rows, trace, tolerance, fallen, wall)


def compared(
    goal_m: Array,
    stances: Sequence[str],
    world: World,
    rows: list[tuple[Target, State]],
    trace: Trace,
    tolerance: Tolerance,
    fallen: float | None,
    wall: float,
) -> Execution:
    """As ``judged``, of any motion. goal_m: where the centre of mass should end, shape (3,). stances: what every
    placement is called in a message."""
    final = float(np.linalg.norm(trace.com_m[-1] - goal_m))
    slip = slips(trace, len(stances))
    between = trace.forces_n - trace.planned_forces_n
    wrong = _wrong(stances, tolerance, trace, fallen, final, slip)
    return Execution(
        world=world.name,
        succeeded=not wrong,
        message="; ".join(wrong),
        fallen_s=fallen,
        com_final_m=final,
        com_worst_m=float(np.linalg.norm(trace.com_m - trace.planned_com_m, axis=1).max()),
        tilt_worst_rad=max(_turned(target, state) for target, state in rows),
        slip_m=slip,
        force_rms_n=float(np.sqrt(np.mean(np.sum(between[trace.placement >= 0] ** 2, axis=-1)))),
        torque_worst_nm=float(np.abs(trace.torques_nm).max()),
        planned_torque_nm=float(np.abs(trace.planned_torques_nm).max()),
        torque_limit_nm=world.servo.torque_nm,
        error_m=max(float(target.error_m.max()) for target, _ in rows),
        shift_m=max(float(np.linalg.norm(target.shift_m)) for target, _ in rows),
        bump_s=float(np.count_nonzero(trace.bump_n > 0.0) / world.rate_hz),
        seconds=float(trace.time_s[-1]),
        wall_s=wall,
        trace=trace,
    )


def _wrong(
    stances: Sequence[str], tolerance: Tolerance, trace: Trace, fallen: float | None, final: float, slip: Array
) -> list[str]:
    """What is against the tolerance, in words."""
    worst, wrong = int(np.argmax(slip)), list[str]()
    if fallen is not None:
        wrong.append(f"fell after {fallen:.2f} s, at frame {trace.frame[-1]:.1f}")
    if final > tolerance.com_m:
        wrong.append(f"the centre of mass ended {1e3 * final:.0f} mm from the plan's")
    if slip[worst] > tolerance.slip_m:
        wrong.append(f"{stances[worst]} slipped {1e3 * slip[worst]:.0f} mm")
    return wrong
