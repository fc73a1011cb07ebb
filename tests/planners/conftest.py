"""What the tests of plans share: a walk over level ground whose forces are known in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stancekit.planners.plan import Plan
from stancekit.planners.scene import Patch, hexapod
from stancekit.planners.scene.course import Course, Placement, StepLimits

STEP_M, HEIGHT_M = 0.03, 0.2
TRIPODS = (("RF", "RR", "LM"), ("RM", "LF", "LR"))
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])


@pytest.fixture(scope="session")
def walk() -> Callable[..., Plan]:
    """``walk(frames, gait)``: level ground, the body at constant speed, every stance held by vertical forces.

    Three toes that carry share the weight as barycentric coordinates do, more toes by the least sum of squares.
    """
    return _walk


def _walk(frames: int = 5, gait: str = "tripod") -> Plan:
    robot = hexapod()
    lifted = {
        "tripod": [TRIPODS[k % 2] for k in range(frames)],
        "wave": [(robot.limb_names[k % 6],) for k in range(frames)],
        "all": [robot.limb_names] * frames,
        "shift": [()] * frames,
    }[gait]
    lifts = ((), *lifted[: frames - 1])
    com = np.array([[STEP_M * k, 0.0, HEIGHT_M] for k in range(frames)])
    placements, toes = [], []
    for k in range(frames):
        for limb in robot.limbs:
            if k == 0 or limb.name in lifts[k]:
                toe = np.array([*(com[k] + 1.8 * limb.shoulder_m)[:2], 0.0])
                patches = (_square(toe + 0.1 * np.eye(3)[2], 0.0), _square(toe, 0.6))
                start = k == 0
                stands = toe if start else None
                placements.append(Placement(limb=limb.name, frame=k, candidates=patches[start:], toe_m=stands))
                toes.append(toe)
    course = Course(
        name=f"walk-{gait}", robot=robot, terrain=(_square(np.zeros(3), 0.6, 2.0),), placements=tuple(placements),
        lifts=lifts, next_lift=lifted[frames - 1], com_nominal_m=com, com_radius_m=np.full(frames, 0.02),
        goal_m=com[-1] + [0.1, 0.0, 0.0], steps=StepLimits(com_m=0.05, toe_m=0.2, progress_m=0.02),
    )  # fmt: skip
    forces = np.zeros((len(course.stances), 6, 3))
    for row, stance in enumerate(course.stances):
        limbs = list(stance.limbs)
        under = np.array(toes)[course.holds[stance.frame, limbs]]
        balance = np.vstack([np.ones(len(limbs)), under[:, :2].T])
        forces[row, limbs, 2] = course.weight_n * np.linalg.pinv(balance) @ [1.0, *com[stance.frame, :2]]
    choice = [len(placement.candidates) - 1 for placement in placements]
    return Plan(
        course=course, com_m=com, rotation_rad=np.zeros((frames, 3)), toes_m=toes, choice=choice, forces_n=forces,
        provenance={"method": "closed form"},
    )  # fmt: skip


def _square(centre: np.ndarray, friction: float, half: float = 0.1) -> Patch:
    return Patch(vertices_m=centre + half * SQUARE, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=friction)
