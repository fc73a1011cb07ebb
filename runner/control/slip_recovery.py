"""What a robot does at once when its feet slide: stay where it is, press harder, put down what is in the air.

No plan is made for that. The body stays at the pose that was measured, the feet that stand press with forces that hold
on the friction that they just felt, with a reserve (``planners.force_share``), and feet in the air go straight to the
surface next to them. Then there is time to plan anew.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.urdf import FOOT_RADIUS_M
from stancekit.planners.terrain.prism import Solid

from ..motion.timeline import Instant
from ..report import Rows
from ..run import Runner
from ..worlds.world import State
from .estimation import com_of, nearest_on
from .force_distribution import ForceShare
from .tracker import Continued, Target, Tracker

WINDOW_S = 0.05
SLID_M = 0.0015
"""A loaded foot that moved so far along its surface within the window slides."""
STOOD_S = 0.1
"""A foot that was put down less than this ago may still find its place."""
LOADED_N = 3.0
LAND_M_S = 0.3
STAND_S = 0.3
"""Feet in the air come down with this mean speed; then everybody stands for a while."""
KNOTS = 9
CATCHES = 8
"""So often forces are chosen anew while feet slide on."""
GRIP_S = 0.1
"""So long new forces take to stop a foot."""


class SlideWatch:
    """Which feet slide, from what is measured in every control period."""

    def __init__(self, rate_hz: float) -> None:
        self._window, self._stood = max(1, round(WINDOW_S * rate_hz)), round(STOOD_S * rate_hz)
        self._feet = deque[Array](maxlen=self._window + 1)
        self._placement: tuple[int, ...] = ()
        self._since = np.zeros(0, dtype=int)

    def slides(self, target: Target, state: State) -> NDArray[np.bool_]:
        """shape (N,)."""
        instant = target.instant
        if not self._placement:
            self._since = np.full(len(instant.placement), self._stood)
        else:
            same = np.array(instant.placement) == np.array(self._placement)
            self._since = np.where(same, self._since + 1, 0)
        self._placement = instant.placement
        self._feet.append(state.feet_m - target.rolled_m)
        moved = self._feet[-1] - self._feet[0]
        along = moved - np.einsum("ij,ij->i", moved, instant.normals)[:, None] * instant.normals
        loaded = np.einsum("ij,ij->i", state.forces_n, instant.normals) > LOADED_N
        stands = (np.array(instant.placement) >= 0) & (self._since >= self._stood)
        return np.asarray(stands & loaded & (np.linalg.norm(along, axis=1) > SLID_M))


class Stand:
    """A motion that goes nowhere, ``Followed`` by a tracker: the body stays, feet in the air are put down.

    now: whose feet stand, at which frame. com_m, rotation_rad: the measured body; feet_m: the measured centres of the
    feet, shape (N, 3) [m]; toes_m, normals: where all feet shall stand. forces_n: before and after feet in the air came
    down, shape (N, 3) [N] each; placement: after that.
    """

    solids: tuple[Solid, ...] = ()

    def __init__(
        self, now: Instant, *, com_m: Array, rotation_rad: Array, feet_m: Array, toes_m: Array, normals: Array,
        forces_n: tuple[Array, Array], placement: tuple[int, ...],
    ) -> None:  # fmt: skip
        self._now, self._com, self._rotation, self._feet = now, com_m, rotation_rad, feet_m
        self._down, self._normals, self._forces = toes_m + FOOT_RADIUS_M * normals, normals, forces_n
        self._placement, self._air = placement, np.array(now.placement) < 0
        way = np.linalg.norm(self._down - feet_m, axis=1)[self._air]
        self._land_s = float(way.max(initial=0.0)) / LAND_M_S

    @property
    def seconds(self) -> float:
        """How long it takes [s]."""
        return self._land_s + STAND_S

    @property
    def knots_s(self) -> Array:
        """As of ``Followed``."""
        return np.linspace(0.0, self.seconds, KNOTS)

    def at(self, time_s: float) -> Instant:
        """What should be at a time; the ends are held."""
        down = time_s >= self._land_s
        part = 1.0 if down else time_s / self._land_s
        way = part * (self._down - self._feet)
        return Instant(
            com_m=self._com, rotation_rad=self._rotation, frame=self._now.frame,
            feet_m=self._feet + np.where(self._air[:, None], way, 0.0),
            forces_n=self._forces[1] if down else self._forces[0],
            placement=self._placement if down else self._now.placement, normals=self._normals,
        )  # fmt: skip


class Catcher:
    """Brings a robot whose feet slide to a stand on a runner's world. kinematics: of its robot."""

    def __init__(self, runner: Runner, kinematics: Kinematics) -> None:
        self._runner, self._kinematics = runner, kinematics
        self._sharing = ForceShare(len(kinematics.robot.limbs))

    def stand(self, plan: Plan, rows: Rows, believed: Callable[[Rows], float]) -> tuple[State, float]:
        """Where that leads to, and how long it took [s].

        rows: of the plan's motion so far. believed: the share of the plan's friction that is believed in, after a look
        at what was measured. Raises Stopped, HardwareFault.
        """
        (target, state), share = rows.pairs[-1], believed(rows)
        now, rate_hz, periods = target.instant, self._runner.world.rate_hz, 0
        for _ in range(CATCHES):
            self._runner.decide("stand", f"feet slide, {share:.2f} of the planned friction believed in")
            tracker = Tracker(
                self._motion(plan, now, state, share), self._continued(state), rate_hz, self._runner.settings.feel
            )
            rows, still = self._followed(tracker, state)
            periods += len(rows.pairs)
            target, state = rows.pairs[-1]
            now, share = target.instant, believed(rows)
            if still:
                break
        return state, periods / rate_hz

    def _motion(self, plan: Plan, now: Instant, state: State, share: float) -> Stand:
        """Standing where the robot is, with the forces for this share of the friction; those of now where none are."""
        course, index = plan.course, round(now.frame)
        holds = tuple(int(placement) for placement in course.holds[index])
        patches = [course.patch(placement, plan.choice) for placement in holds]
        patches = [replace(patch, friction=share * patch.friction) for patch in patches]
        normals = np.array([patch.normal for patch in patches])
        under = state.feet_m - FOOT_RADIUS_M * normals
        toes = np.array([nearest_on(patch, toe) for patch, toe in zip(patches, under, strict=True)])
        com_m, stands = com_of(self._kinematics, state), np.array(now.placement) >= 0
        turned = Rotation.from_matrix(state.rotation).as_rotvec()
        first = self._sharing.forces(course, toes - com_m, patches, stands)
        first = now.forces_n if first is None else first
        then = self._sharing.forces(course, toes - com_m, patches, np.full_like(stands, True))
        return Stand(
            replace(now, frame=float(index)), com_m=com_m, rotation_rad=turned,
            feet_m=state.feet_m, toes_m=toes, normals=normals, forces_n=(first, first if then is None else then),
            placement=holds,
        )  # fmt: skip

    def _followed(self, tracker: Tracker, state: State) -> tuple[Rows, bool]:
        """To the end, or until feet slide although they were pressed for a while; whether none did."""
        runner, rows, watch = self._runner, Rows(), SlideWatch(self._runner.world.rate_hz)
        tracker.start()
        while (target := tracker.next(state.forces_n)) is not None:
            state = runner.send(target.targets_rad, target.angles_rad)
            runner.check_body(target, state)
            rows.add(target, state, 0.0, 0.0)
            if watch.slides(target, state).any() and len(rows.pairs) > GRIP_S * runner.world.rate_hz:
                return rows, False
        return rows, True

    def _continued(self, state: State) -> Kinematics:
        robot, servo = self._kinematics.robot, self._kinematics.servo
        return Continued(robot, servo, gravity_m_s2=self._kinematics.gravity_m_s2, near=state.angles_rad)
