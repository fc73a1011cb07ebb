"""What the tests of key-frame planners share: small courses between two walls, and the lift written a second time."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import cvxpy as cp
import numpy as np
import pytest

from stancekit.planners.keyframes.twostage import CourseModels
from stancekit.planners.scene import Patch, hexapod
from stancekit.planners.scene.course import Course, Placement, StepLimits
from stancekit.planners.scene.robot import Robot

LIMBS = ("LF", "LR", "RF", "RR")
STEP_M = 0.04


@pytest.fixture(scope="session")
def models() -> CourseModels:
    """The compiled models, once a process."""
    return CourseModels()


@pytest.fixture(scope="session")
def climb() -> Callable[..., Course]:
    """``climb(seed, frames=2, regions=1, ice=0.0)``: four limbs on tilted patches of two walls, one limb moves a frame.

    Some seeds have a plan and some do not. ice: the chance that a patch has no friction.
    """
    return cache(_climb)


def _climb(seed: int, frames: int = 2, regions: int = 1, ice: float = 0.0) -> Course:
    rng = np.random.default_rng(seed)
    robot = Robot(name="four", mass_kg=10.0, limbs=hexapod().select(LIMBS))
    com = np.array([[0.0, 0.0, STEP_M * k] for k in range(frames)])
    lifts = ((), *((LIMBS[k % 4],) for k in range(frames - 1)))
    placements = tuple(
        Placement(limb=limb.name, frame=k, candidates=tuple(_patch(rng, com[k], limb, ice) for _ in range(regions)))
        for k in range(frames)
        for limb in robot.limbs
        if k == 0 or limb.name in lifts[k]
    )
    return Course(
        name=f"climb-{seed}", robot=robot, terrain=tuple(p for put in placements for p in put.candidates),
        placements=placements, lifts=lifts, next_lift=(LIMBS[(frames - 1) % 4],) if frames == 1 else (),
        com_nominal_m=com, com_radius_m=np.full(frames, 0.05), goal_m=com[-1] + rng.uniform(-0.1, 0.1, 3),
        steps=StepLimits(com_m=0.09, toe_m=0.3, progress_m=0.01),
    )  # fmt: skip


def _patch(rng: np.random.Generator, com: np.ndarray, limb: object, ice: float) -> Patch:
    side = np.sign(limb.shoulder_m[1])
    normal = np.array([*rng.uniform(-0.25, 0.25, 1), -side, *rng.uniform(-0.25, 0.25, 1)])
    normal /= np.linalg.norm(normal)
    first = np.cross(normal, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    second = np.cross(first, normal)
    away = [0.06 * np.sign(limb.shoulder_m[0]), side * 0.36, -0.03]
    centre = com + np.add(away, [limb.shoulder_m[0], 0.0, 0.0]) + rng.uniform(-0.06, 0.06, 3)
    corners = 0.05 * np.array([first + second, first - second, -first - second, second - first])
    friction = 0.0 if rng.random() < ice else rng.uniform(0.35, 0.9)
    return Patch(vertices_m=centre + corners, normal=normal, shear_reference=[0.0, 0.0, 1.0], friction=friction)


@pytest.fixture(scope="session")
def written() -> Callable[[Course], tuple[cp.Problem, list[list[cp.Variable]]]]:
    """``written(course)``: the lift from the course's own numbers, one sentence of the paper after another.

    The problem, objective in m², and the shares λ by placement and candidate. No line is shared with the planners.
    """
    return _written


def _written(course: Course) -> tuple[cp.Problem, list[list[cp.Variable]]]:
    frames, robot = course.frames, course.robot
    com, turn = cp.Variable((frames, 3)), cp.Variable((frames, 3))
    shares = [
        [cp.Variable(len(patch.vertices_m), nonneg=True) for patch in put.candidates] for put in course.placements
    ]
    toes = [
        sum(patch.vertices_m.T @ share for patch, share in zip(put.candidates, row, strict=True))
        for put, row in zip(course.placements, shares, strict=True)
    ]
    rows = [sum(cp.sum(share) for share in row) == 1 for row in shares]
    standing = {}
    for k in range(frames):
        rows += [cp.norm(com[k] - course.com_nominal_m[k]) <= course.com_radius_m[k]]
        rows += [cp.abs(turn[k]) <= course.tilt_limit_rad]
        for put_index, put in enumerate(course.placements):
            if put.frame <= k:
                standing[k, put.limb] = put_index
        for limb in robot.limbs:
            shoulder = com[k] + limb.shoulder_m - _times(limb.shoulder_m) @ turn[k]  # Θ × v = −v × Θ
            rows.append(cp.norm(toes[standing[k, limb.name]] - shoulder) <= limb.reach_m)
    for stance in course.stances:
        force, moment = np.array([0.0, 0.0, -1.0]), _times(np.array([0.0, 0.0, -1.0])) @ com[stance.frame] * -1.0
        for i in stance.limbs:
            p = standing[stance.frame, robot.limb_names[i]]
            for patch, share in zip(course.placements[p].candidates, shares[p], strict=True):
                for u, vertex in enumerate(patch.vertices_m):
                    f = cp.Variable(3)  # λ_u f in the contact frame
                    rows += [cp.norm(f[1:]) <= patch.friction * f[0]]
                    rows += [f <= share[u] * course.force_max, f >= share[u] * course.force_min]
                    force = force + patch.frame @ f
                    moment = moment + _times(vertex) @ patch.frame @ f
        rows += [force == 0, moment == 0]
    cost = course.weights.goal * cp.sum_squares(com[frames - 1] - course.goal_m)
    cost += course.weights.tilt * cp.sum_squares(turn)
    for k in range(1, frames):
        rows += [cp.norm(com[k] - com[k - 1]) <= course.steps.com_m]
        rows += [cp.norm(turn[k] - turn[k - 1]) <= course.steps.rotation_rad]
        ahead = course.com_nominal_m[k] - course.com_nominal_m[k - 1]
        rows += [(com[k] - com[k - 1]) @ (ahead / np.linalg.norm(ahead)) >= course.steps.progress_m]
        cost += course.weights.com_step * cp.sum_squares(com[k] - com[k - 1])
        for name in robot.limb_names:
            before, after = standing[k - 1, name], standing[k, name]
            if before != after:
                rows += [cp.norm(toes[after] - toes[before]) <= course.steps.toe_m]
                cost += course.weights.toe_step * cp.sum_squares(toes[after] - toes[before])
    return cp.Problem(cp.Minimize(cost), rows), shares


def _times(v: np.ndarray) -> np.ndarray:
    """The matrix of v × ·."""
    return np.cross(v, np.eye(3)).T
