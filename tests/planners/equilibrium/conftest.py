"""What the tests of the core share: random problems of every kind, postures and courses."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from stancekit.planners.equilibrium.scaled import Point, Scaled
from stancekit.planners.scene import Patch, hexapod
from stancekit.planners.scene.course import Course, Placement, StepLimits
from stancekit.planners.scene.robot import Limb, Robot

LIMBS = ("LF", "LR", "RF", "RR")
STEP_M = 0.04


@pytest.fixture(scope="session")
def ragged() -> Callable[..., Course]:
    """``ragged(seed, frames=2, candidates=3, ice=0.3)``: four limbs between two walls, one moves a frame.

    A toe has up to so many candidate patches, each of 3 to 5 corners, with no friction at the chance of ``ice``. One
    toe of the first frame already stands where frames > 1. Some seeds have a plan and some do not.
    """
    return cache(_ragged)


@pytest.fixture(scope="session")
def near() -> Callable[[Scaled, int], Point]:
    """``near(scaled, seed)``: toes on one candidate a foothold, body and forces about nominal."""
    return _near


def _ragged(seed: int, frames: int = 2, candidates: int = 3, ice: float = 0.3) -> Course:
    rng = np.random.default_rng(seed)
    robot = Robot(name="four", mass_kg=10.0, limbs=hexapod().select(LIMBS))
    com = np.array([[0.0, 0.0, STEP_M * k] for k in range(frames)])
    lifts = ((), *((LIMBS[k % 4],) for k in range(frames - 1)))
    placements = []
    for k in range(frames):
        for limb in robot.limbs:
            if k == 0 or limb.name in lifts[k]:
                stands = k == 0 and frames > 1 and limb.name == LIMBS[1]
                count = 1 if stands else int(rng.integers(1, candidates + 1))
                patches = tuple(_patch(rng, com[k], limb, 0.0 if stands else ice) for _ in range(count))
                toe = patches[0].vertices_m.mean(axis=0) if stands else None
                placements.append(Placement(limb=limb.name, frame=k, candidates=patches, toe_m=toe))
    return Course(
        name=f"ragged-{seed}", robot=robot, terrain=tuple(p for put in placements for p in put.candidates),
        placements=tuple(placements), lifts=lifts, next_lift=(LIMBS[(frames - 1) % 4],) if frames == 1 else (),
        com_nominal_m=com, com_radius_m=np.full(frames, 0.05), goal_m=com[-1] + rng.uniform(-0.1, 0.1, 3),
        steps=StepLimits(com_m=0.09, toe_m=0.3, progress_m=0.01),
    )  # fmt: skip


def _patch(rng: np.random.Generator, com: np.ndarray, limb: Limb, ice: float) -> Patch:
    side = np.sign(limb.shoulder_m[1])
    normal = np.array([rng.uniform(-0.25, 0.25), -side, rng.uniform(-0.25, 0.25)])
    normal /= np.linalg.norm(normal)
    first = np.cross(normal, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    count = int(rng.integers(3, 6))
    angle = -2.0 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    corners = np.outer(np.cos(angle), first) + np.outer(np.sin(angle), np.cross(first, normal))
    away = [0.06 * np.sign(limb.shoulder_m[0]) + limb.shoulder_m[0], side * 0.36, -0.03]
    centre = com + away + rng.uniform(-0.06, 0.06, 3)
    friction = 0.0 if rng.random() < ice else rng.uniform(0.35, 0.9)
    return Patch(vertices_m=centre + 0.07 * corners, normal=normal, shear_reference=[0.0, 0.0, 1.0], friction=friction)


def _near(scaled: Scaled, seed: int) -> Point:
    rng, layout = np.random.default_rng(seed), scaled.layout
    weights = rng.uniform(0.1, 1.0, len(layout.vertex_footholds))
    weights /= np.bincount(layout.vertex_footholds, weights)[layout.vertex_footholds]
    toes = np.zeros((layout.footholds, 3))
    np.add.at(toes, layout.vertex_footholds, weights[:, None] * scaled.vertices)
    return Point(
        com=scaled.com + rng.normal(scale=0.02, size=scaled.com.shape),
        rotation=rng.normal(scale=0.02, size=scaled.com.shape),
        toes=toes,
        forces=rng.uniform(0.1, 0.6, (len(layout.contacts[0]), 3)),
        residual=float("inf"),
    )
