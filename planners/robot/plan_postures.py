"""Joint angles for every key frame of a plan, by the robot's own model: is every toe where the plan has it?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..answer.plan import Plan
from ..errors import InvalidInput
from ..files.arrays import Array
from .inverse_kinematics import REACHED_M, InverseKinematics, Seeds
from .robot_model import RobotModel
from .rotation import rotation_of

SEEDS = 8000


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanPostures:
    """Postures of M key frames, N legs.

    names: of the legs. joints: names of each leg's joints. angles: a leg each, shape (M, n) [rad]. error_m: of every
    foot, shape (M, N) [m].
    """

    names: tuple[str, ...]
    joints: tuple[tuple[str, ...], ...]
    angles: tuple[Array, ...]
    error_m: Array

    @property
    def reached(self) -> bool:
        """Every foot is where the plan has it."""
        return bool(np.all(self.error_m <= REACHED_M))

    @property
    def message(self) -> str:
        """One line: does every foot get there, and if not, which one is farthest from it?"""
        worst = 1e3 * float(self.error_m.max())
        if self.reached:
            return f"joints: every foot of {self.error_m.size} is reached, within {worst:.2g} mm"
        frame, leg = np.unravel_index(int(np.argmax(self.error_m)), self.error_m.shape)
        missed = int(np.count_nonzero(self.error_m > REACHED_M))
        return (
            f"joints: {missed} of {self.error_m.size} feet are out of reach, {self.names[leg]} at frame {frame} by "
            f"{worst:.3g} mm"
        )

    def to_json(self) -> dict[str, object]:
        """Angles by leg, frame and joint, and whether and how far every foot is from its place."""
        legs = zip(self.names, self.joints, self.angles, self.error_m.T, strict=True)
        return {
            "reached": self.reached,
            "message": self.message,
            "legs": [
                {"leg": name, "joints": list(joints), "angles_rad": angles.tolist(), "error_m": error.tolist()}
                for name, joints, angles, error in legs
            ],
        }


def plan_postures(robot: RobotModel, plan: Plan) -> PlanPostures:
    """Angles for the body poses and toes of a plan, rotations taken exactly, each near those of the frame before.

    The body's origin is the centre of mass of the standing robot. Raises InvalidInput for the plan of another robot.
    """
    course = plan.course
    if course.robot.limb_names != robot.leg_names:
        raise InvalidInput(
            f"plan: expected limbs {', '.join(robot.leg_names)}, got {', '.join(course.robot.limb_names)}"
        )
    feet = np.array([_feet(robot, plan, k) for k in range(course.frames)])
    rng = np.random.default_rng(0)
    solver = InverseKinematics([Seeds(leg, leg.random_angles(SEEDS, rng)) for leg in robot.legs])
    near = [leg.stance_rad[None] for leg in robot.legs]
    angles, errors = [], []
    for k in range(course.frames):
        found = solver.solve(feet[k : k + 1], near=near)
        near = list(found.angles)
        angles.append(near)
        errors.append(found.error_m[0])
    return PlanPostures(
        names=robot.leg_names,
        joints=tuple(leg.joint_names for leg in robot.legs),
        angles=tuple(np.vstack([frame[i] for frame in angles]) for i in range(len(robot.legs))),
        error_m=np.array(errors),
    )


def _feet(robot: RobotModel, plan: Plan, frame: int) -> Array:
    """Centres of the feet at one key frame, in the base's frame, shape (N, 3) [m]."""
    course = plan.course
    normals = np.array([course.patch(int(p), plan.choice).normal for p in course.holds[frame]])
    radii = np.array([[leg.radius_m] for leg in robot.legs])
    centres = plan.toes_at(frame) + radii * normals
    return np.asarray((centres - plan.com_m[frame]) @ rotation_of(plan.rotation_rad[frame]) + robot.body.com_m)
