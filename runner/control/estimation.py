"""What the closed loop makes of measurements: where the robot stands, how far off that is, what friction there is."""

from __future__ import annotations

from itertools import pairwise
from math import inf

import numpy as np
from scipy.spatial.transform import Rotation

from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.search.plan_window import Standing
from stancekit.planners.terrain import Patch

from ..record import Record
from ..worlds.capabilities import WorldCapabilities
from ..worlds.world import State
from .tracker import Target

SLIDES_M_S = 0.01
"""A foot that should stand and moves faster than this slides."""
LOADED_N = 3.0
BORDER_M = 0.02
"""So far beyond its patch's border a foot may have slid and still be taken for standing on the border."""


def measured_com_m(kinematics: Kinematics, state: State) -> Array:
    """The measured centre of mass, shape (3,) [m]."""
    return np.asarray(state.position_m + state.rotation @ kinematics.com_offset(state.angles_rad))


def deviation_m(target: Target, state: State, kinematics: Kinematics, can: WorldCapabilities) -> float:
    """How far the body or a foot that stands is from the plan [m]; 0 where the world does not measure the body."""
    if not can.has_body_pose:
        return 0.0
    sample = target.sample
    body = float(np.linalg.norm(measured_com_m(kinematics, state) - sample.com_m))
    stands = np.array(sample.foothold) >= 0
    feet = np.linalg.norm(state.feet_m - target.rolled_m - sample.feet_m, axis=1)[stands]
    return max(body, float(feet.max(initial=0.0)))


def estimate_standing(plan: Plan, frame: int, target: Target, state: State, kinematics: Kinematics) -> Standing | None:
    """Where the robot is measured to stand at a key frame of its plan; None where a foot left its patch.

    Feet are put back into the plane of their patch, and onto its border where they slid a little beyond.
    """
    course = plan.course
    patches = tuple(course.patch(int(p), plan.choice) for p in course.holds[frame])
    toes = []
    for foot, radius, patch in zip(state.feet_m, kinematics.radii_m, patches, strict=True):
        toe = foot - radius * patch.normal
        inside = nearest_on(patch, toe)
        if np.linalg.norm(inside - toe) > BORDER_M:
            return None
        toes.append(inside)
    return Standing(
        com_m=measured_com_m(kinematics, state),
        rotation_rad=Rotation.from_matrix(state.rotation).as_rotvec(),
        toes_m=np.array(toes),
        patches=patches,
    )


def estimate_friction(plan: Plan, record: Record, period_s: float, last_s: float = inf) -> float:
    """The share of the plan's friction that sliding feet felt: the median of |tangential| over μ · normal; 1 where none
    slid. last_s: look at no more than so much of the end."""
    felt = []
    pairs = record.pairs[-int(min(last_s / period_s, len(record.pairs))) - 1 :]
    for (_, before), (target, state) in pairwise(pairs):
        for limb, foothold in enumerate(target.sample.foothold):
            if foothold < 0:
                continue
            patch = plan.course.patch(foothold, plan.choice)
            normal = float(state.forces_n[limb] @ patch.normal)
            moved = state.feet_m[limb] - before.feet_m[limb]
            along = float(np.linalg.norm(moved - (moved @ patch.normal) * patch.normal))
            if normal < LOADED_N or along < SLIDES_M_S * period_s or patch.friction <= 0.0:
                continue
            tangential = float(np.linalg.norm(state.forces_n[limb] - normal * patch.normal))
            felt.append(tangential / (normal * patch.friction))
    return min(1.0, float(np.median(felt))) if felt else 1.0


def nearest_on(patch: Patch, point: Array) -> Array:
    """The point of a patch's surface nearest to a point, shape (3,) [m]."""
    corners, normal = patch.vertices_m, patch.normal
    flat = point - ((point - patch.centre_m) @ normal) * normal
    nearest = list[Array]()
    inside = True
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = b - a
        inwards = np.cross(normal, edge)
        inwards = inwards * np.sign(inwards @ (patch.centre_m - a))
        inside &= bool((flat - a) @ inwards >= 0.0)
        s = np.clip((flat - a) @ edge / max(float(edge @ edge), 1e-18), 0.0, 1.0)
        nearest.append(a + s * edge)
    return flat if inside else min(nearest, key=lambda p: float(np.linalg.norm(p - flat)))
