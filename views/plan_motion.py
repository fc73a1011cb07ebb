"""A plan as a motion for the eye: what happens between its key frames, for videos and pages."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stancekit.planners.answer.plan import Plan
from stancekit.planners.cached import cached_property
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.rotation import rotation_of
from stancekit.planners.robot.toes import ToeKinematics

GHOSTS = 3
"""Key frames beside the one in full, at most."""
LOAD = 0.25
"""Share of a step in which the load goes from one stance of a frame to the next; the body moves in the rest of it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """The robot at one moment: com_m (3,) [m], rotation_rad (3,), toes_m (N, 3) [m], forces_n (N, 3) [N].

    frame: the key frame it comes from. moving: the limbs that are in the air, by index.
    joints_rad: of the robot's model, near which its posture is, shape (J,); None where nobody worked them out.
    """

    frame: int
    com_m: Array
    rotation_rad: Array
    toes_m: Array
    forces_n: Array
    moving: tuple[int, ...] = ()
    joints_rad: Array | None = None


class PlanMotion:
    """Moments of a plan: at time k it is at key frame k; between two, the load shifts, then body and limbs move."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        size = float(np.mean([limb.reach_m for limb in plan.course.robot.limbs]))
        self._clearance_m = 0.25 * size

    @property
    def end(self) -> float:
        """Time of the last key frame."""
        return float(self.plan.course.frames - 1)

    def key(self, frame: int) -> Moment:
        """A key frame with the mean force of its stances."""
        plan = self.plan
        return Moment(
            frame=frame, com_m=plan.com_m[frame], rotation_rad=plan.rotation_rad[frame],
            toes_m=plan.toes_at(frame), forces_n=plan.forces_at(frame), joints_rad=self._joints(frame, 0.0),
        )  # fmt: skip

    def at(self, time: float) -> Moment:
        """The moment at a time from 0 to ``end``; a stance of the supporting limbs holds all the way."""
        last = self.plan.course.frames - 1
        if time >= last:
            forces = self._forces(last, self._support(last - 1)) if last else self.plan.forces_at(last)
            return replace(self.key(last), forces_n=forces)
        k = max(int(time), 0)
        share = max(time - k, 0.0)
        before, after = self._forces(k, self._support(k)), self._forces(k + 1, self._support(k))
        arrival = self._forces(k, self._support(k - 1)) if k else before
        if share < LOAD:
            part = smooth(share / LOAD)
            return replace(self.key(k), forces_n=(1.0 - part) * arrival + part * before)
        part = smooth((share - LOAD) / (1.0 - LOAD))
        plan = self.plan
        return Moment(
            frame=k,
            com_m=(1.0 - part) * plan.com_m[k] + part * plan.com_m[k + 1],
            rotation_rad=(1.0 - part) * plan.rotation_rad[k] + part * plan.rotation_rad[k + 1],
            toes_m=self._toes(k, part),
            forces_n=(1.0 - part) * before + part * after,
            moving=tuple(i for i, name in enumerate(self._names) if name in plan.course.lifts[k + 1]),
            joints_rad=self._joints(k, part),
        )

    def angles(self, moment: Moment) -> list[Array]:
        """Of every leg of the robot's model, shape (n,) [rad]; feet face the patches of the moment's key frame."""
        course = self.plan.course
        normals = np.array([course.patch(int(p), self.plan.choice).normal for p in course.holds[moment.frame]])
        turn = rotation_of(moment.rotation_rad)
        near = None if moment.joints_rad is None else moment.joints_rad[None]
        found = self._kinematics.solve(moment.com_m[None], turn[None], moment.toes_m[None], normals[None], near)
        return [angles[0] for angles in found.angles]

    def _joints(self, frame: int, part: float) -> Array | None:
        """The plan's angles on the way from a key frame to the next, straight."""
        joints = self.plan.joints_rad
        after = min(frame + 1, self.plan.course.frames - 1)
        return None if joints is None else np.asarray((1.0 - part) * joints[frame] + part * joints[after])

    @cached_property
    def _kinematics(self) -> ToeKinematics:
        return ToeKinematics(self.plan.course.robot.source.own_model())

    def swing(self, foothold: int, part: float | Array) -> Array:
        """Where a toe is on its way to a foothold: off its old patch, over, and onto the new one.

        part: of the way, or several, shape (K,). Returns shape (3,) or (K, 3) [m].
        """
        course, toes = self.plan.course, self.plan.toes_m
        put = course.footholds[foothold]
        old = int(course.holds[put.frame - 1, self._names.index(put.limb)])
        lift = sum(course.patch(p, self.plan.choice).normal for p in (old, foothold))
        share = np.asarray(part)[..., None]
        way = (1.0 - share) * toes[old] + share * toes[foothold]
        return np.asarray(way + self._clearance_m * np.sin(np.pi * share) * 0.5 * lift)

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return self.plan.course.robot.limb_names

    def _support(self, step: int) -> frozenset[int]:
        """The limbs that stay from frame ``step`` to the next; all of them where everybody moves at once."""
        lifted = self.plan.course.lifts[step + 1]
        kept = frozenset(i for i, name in enumerate(self._names) if name not in lifted)
        return kept or frozenset(range(len(self._names)))

    def _forces(self, frame: int, limbs: frozenset[int]) -> Array:
        """Forces of a stance of these limbs at a frame, shape (N, 3) [N]; the mean where none is of them alone."""
        for row, stance in enumerate(self.plan.course.stances):
            if stance.frame == frame and set(stance.limbs) <= limbs:
                return np.asarray(self.plan.forces_n[row])
        return self.plan.forces_at(frame)

    def _toes(self, step: int, part: float) -> Array:
        toes = self.plan.toes_at(step).copy()
        for i, foothold in enumerate(self.plan.course.holds[step + 1]):
            if foothold != self.plan.course.holds[step, i]:
                toes[i] = self.swing(int(foothold), part)
        return toes


def smooth(share: float) -> float:
    """From 0 to 1 without a jolt: 3 s² − 2 s³."""
    return share * share * (3.0 - 2.0 * share)


def ghosts(plan: Plan, shown: int) -> list[int]:
    """Key frames to show beside one, evenly spread and the first among them."""
    others = np.linspace(0, plan.course.frames - 1, GHOSTS + 1).round().astype(int).tolist()
    return sorted(set(others) - {shown})[:GHOSTS]
