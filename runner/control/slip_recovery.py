"""Immediate reaction of a robot whose feet slide: stay where it is, press harder, put down what is
in the air.

No plan is made for that. The body stays at the pose that was measured, the feet that stand press
with forces that hold on the friction that they just felt, with a reserve (``force_distribution``),
and feet in the air go straight to the surface next to them. Then there is time to plan anew.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.motion import Played, Samples
from stancekit.planners.projection.force_distribution import ForceDistribution, wrench_at
from stancekit.planners.robot.kinematics import Kinematics

from ..log import Record
from ..prepared import Tracked
from ..run import Runner
from ..worlds.world import State
from .estimation import measured_com_m, nearest_on
from .tracker import Target, Tracker

Shares = tuple[float, ...]
"""Shares of the friction that a plan counts on, that there may be: the most cautious first."""
_Estimate = Callable[[Record, float], Shares]
_WINDOW_S = 0.05
_SLID_M = 0.0015
"""A loaded foot that moved so far along its surface within the window slides."""
_STOOD_S = 0.1
"""A foot that was put down less than this ago may still find its place."""
_LOADED_N = 3.0
LAND_M_S = 0.3
STAND_S = 0.3
"""Feet in the air come down with this mean speed; then everybody stands for a while."""
_KNOTS = 9
_ATTEMPTS = 8
"""So often forces are chosen anew while feet slide on."""
_GRIP_S = 0.1
"""So long new forces take to stop a foot."""


class SlipDetector:
    """Detector of feet that slide, from the measurements of every control period."""

    def __init__(self, rate_hz: float) -> None:
        self._window, self._stood = max(1, round(_WINDOW_S * rate_hz)), round(_STOOD_S * rate_hz)
        self._feet = deque[Array](maxlen=self._window + 1)
        self._foothold: NDArray[np.int_] | None = None
        self._since = np.zeros(0, dtype=int)

    def slipping(self, target: Target, state: State) -> NDArray[np.bool_]:
        """shape (N,)."""
        sample = target.sample
        if self._foothold is None:
            self._since = np.full(len(sample.foothold), self._stood)
        else:
            same = sample.foothold == self._foothold
            self._since = np.where(same, self._since + 1, 0)
        self._foothold = sample.foothold
        self._feet.append(state.feet_m - target.rolled_m)
        moved = self._feet[-1] - self._feet[0]
        along = moved - np.einsum("ij,ij->i", moved, sample.normals)[:, None] * sample.normals
        loaded = np.einsum("ij,ij->i", state.forces_n, sample.normals) > _LOADED_N
        stands = sample.stands & (self._since >= self._stood)
        return np.asarray(stands & loaded & (np.linalg.norm(along, axis=1) > _SLID_M))


def standing_motion(
    now: Samples,
    *,
    com_m: Array,
    rotation_rad: Array,
    feet_m: Array,
    toes_m: Array,
    normals: Array,
    forces_n: tuple[Array, Array],
    foothold: NDArray[np.int_],
) -> Played:
    """A motion that goes nowhere: the body stays, feet in the air are put down.

    Arguments:
        now: whose feet stand, at which frame.
        com_m, rotation_rad: the measured body.
        feet_m: the measured centres of the feet, shape (N, 3) [m].
        toes_m, normals: where all feet shall stand.
        forces_n: before and after feet in the air came down, shape (N, 3) [N] each.
        foothold: after that.
    """
    goes, air = toes_m + now.radii_m[:, None] * normals - feet_m, ~now.stands
    land_s = float(np.linalg.norm(goes, axis=1)[air].max(initial=0.0)) / LAND_M_S

    def at(times_s: float | Array) -> Samples:
        when, limbs = np.asarray(times_s, dtype=np.float64), len(feet_m)
        down = when >= land_s
        moved = np.where(down, 1.0, when / max(land_s, 1e-9))[..., None, None] * goes
        landed, still = down[..., None], np.zeros((*when.shape, 3))
        return Samples(
            com_m=still + com_m,
            velocity_m_s=still,
            rotation_rad=still + rotation_rad,
            rotation_rate_rad_s=still,
            frame=np.broadcast_to(now.frame, when.shape),
            feet_m=feet_m + np.where(air[:, None], moved, 0.0),
            radii_m=now.radii_m,
            forces_n=np.where(landed[..., None], forces_n[1], forces_n[0]),
            foothold=np.where(landed, foothold, now.foothold),
            normals=np.broadcast_to(normals, (*when.shape, limbs, 3)),
            friction=np.broadcast_to(now.friction, (*when.shape, limbs)),
        )

    return Played(at=at, knots_s=np.linspace(0.0, land_s + STAND_S, _KNOTS))


class SlipRecovery:
    """Brings a robot whose feet slide to a stand on a runner's world.

    Arguments:
        kinematics: of its robot.
    """

    def __init__(self, runner: Runner, kinematics: Kinematics) -> None:
        self._runner, self._kinematics = runner, kinematics
        self._distribution = ForceDistribution(len(kinematics.robot.limbs))

    def recover(
        self, plan: Plan, record: Record, shares: Shares, estimate: _Estimate
    ) -> tuple[Target, State, float]:
        """Recover and return the last target, the last state and the time that it took [s].

        Arguments:
            record: of the plan's motion so far.
            estimate: the shares by what was measured with forces for such a share.

        Raises Stopped, HardwareFault.
        """
        target, state = record.pairs[-1]
        now, rate_hz, periods = target.sample, self._runner.world.rate_hz, 0
        for _ in range(_ATTEMPTS):
            self._runner.decide(
                "stand", f"feet slide, counting on {shares[0]:.2f} of the planned friction"
            )
            record, slips = Record(), SlipDetector(rate_hz)
            tracked = self._tracked(self._motion(plan, now, state, shares), state)
            still = self._runner.follow(
                tracked, record, partial(_still_slips, slips, record, rate_hz)
            )
            periods += len(record.pairs)
            target, state = record.pairs[-1]
            now, shares = target.sample, estimate(record, shares[0])
            if still:
                break
        return target, state, periods / rate_hz

    def _motion(self, plan: Plan, now: Samples, state: State, shares: Shares) -> Played:
        """Standing where the robot is, with forces for the first share that has any, else those of
        now.
        """
        course, index = plan.problem, round(float(now.frame))
        holds = course.holds[index]
        patches = [course.patch(int(foothold), plan.choice) for foothold in holds]
        normals, friction = (
            np.array([getattr(patch, name) for patch in patches]) for name in ("normal", "friction")
        )
        under = state.feet_m - now.radii_m[:, None] * normals
        toes = np.array([nearest_on(patch, toe) for patch, toe in zip(patches, under, strict=True)])
        com_m, stands = measured_com_m(self._kinematics, state), now.stands
        wrench = wrench_at(course, index)
        turned = Rotation.from_matrix(state.rotation).as_rotvec()

        def shared(legs: NDArray[np.bool_]) -> Array | None:
            for share in shares:
                dulled = [patch.with_friction(share * patch.friction) for patch in patches]
                forces_n = self._distribution.forces(
                    course, toes - com_m, dulled, legs, wrench=wrench
                )
                if forces_n is not None:
                    return forces_n
            return None

        first, then = shared(stands), shared(np.full_like(stands, True))
        first = now.forces_n if first is None else first
        return standing_motion(
            replace(now, frame=np.array(float(index)), friction=shares[0] * friction),
            com_m=com_m,
            rotation_rad=turned,
            feet_m=state.feet_m,
            toes_m=toes,
            normals=normals,
            forces_n=(first, first if then is None else then),
            foothold=holds,
        )

    def _tracked(self, motion: Played, state: State) -> Tracked:
        """Ready to be followed from where the robot was measured, with the forces that its feet
        feel now.
        """
        robot, servo = self._kinematics.robot, self._kinematics.servo
        near = Kinematics(
            robot, servo, gravity_m_s2=self._kinematics.gravity_m_s2, near_rad=state.angles_rad
        )
        world = self._runner.world
        tracker = Tracker(
            motion, near, world.rate_hz, self._runner.settings.feedback, drives=world.drives
        )
        first = tracker.start()
        felt = replace(first, sample=replace(first.sample, forces_n=state.forces_n))
        return Tracked(motion=motion, tracker=tracker, first=felt, sees=True)


def _still_slips(
    slips: SlipDetector, record: Record, rate_hz: float, target: Target, state: State
) -> bool:
    """Tell whether feet slide although they were pressed for a while."""
    return bool(slips.slipping(target, state).any()) and len(record.pairs) > _GRIP_S * rate_hz
