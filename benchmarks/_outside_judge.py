"""Why a robot cannot do what a file says: by numpy and pinocchio, with nothing of the verifier's.

Every function returns a sentence, or raises NoForgery where it finds nothing wrong.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
from _outside_files import Array, NoForgery, Opened
from numpy.typing import ArrayLike

from stancekit.planners.problem import Problem


def more(what: str, value: float, limit: float, unit: str) -> str:
    """``what`` is ``value``, more than twice the limit."""
    if not value > 2.0 * limit:
        raise NoForgery(f"{what}: {value:.3g} {unit}, twice the limit is {2 * limit:.3g}")
    return f"{what}: {value:.3g} {unit}, limit {limit:.3g}"


def rows_of(plan: Opened) -> list[tuple[int, list[int], Array, list[dict[str, Any]]]]:
    """Of every stance: frame, limbs, which footholds they stand on, and the patches these chose."""
    course: Problem = Problem.from_json(plan.head["question"])
    found = []
    for stance in course.stances:
        limbs = list(stance.limbs)
        at = course.holds[stance.frame][limbs]
        patches = [
            plan.head["question"]["placements"][p]["candidates"][plan.arrays["choice"][p]]
            for p in at
        ]
        found.append((stance.frame, limbs, at, patches))
    return found


def off_terrain(plan: Opened, metres: float) -> str:
    """A toe is farther than this from every patch of the terrain."""
    patches = [corners_of(patch) for patch in plan.head["question"]["terrain"]]
    gaps = [min(_distance(toe, patch) for patch in patches) for toe in plan.arrays["toes_m"]]
    return more("toe off the terrain", max(gaps), metres, "m")


def slips(plan: Opened, share: float = 1e-3) -> str:
    """A foot pushes outside of the cone of the terrain under it, by this share of the robot's
    weight.
    """
    terrain = plan.head["question"]["terrain"]
    worst = 0.0
    for row, (_, limbs, at, _) in enumerate(rows_of(plan)):
        for limb, hold in zip(limbs, at, strict=True):
            toe = plan.arrays["toes_m"][hold]
            patch = min(terrain, key=lambda candidate: _distance(toe, corners_of(candidate)))
            worst = max(
                worst,
                outside(plan.arrays["forces_n"][row, limb], patch["normal"], patch["friction"]),
            )
    return more("tangential force beyond friction", worst, share * weight_of(plan), "N")


def outside(force: Array, normal: ArrayLike, friction: float) -> float:
    """How far a force is outside of its cone [N]."""
    across = float(force @ np.asarray(normal))
    return float(np.linalg.norm(force - across * np.asarray(normal)) - friction * max(across, 0.0))


def unbalanced(plan: Opened, share: float = 1e-3) -> str:
    """Forces and weight do not balance, or moments do not, in some stance, by this share of the
    weight (and metre).
    """
    worst = 0.0
    for row, (frame, limbs, at, _) in enumerate(rows_of(plan)):
        forces, arms = (
            plan.arrays["forces_n"][row],
            plan.arrays["toes_m"][at] - plan.arrays["com_m"][frame],
        )
        net = forces.sum(axis=0) - [0.0, 0.0, weight_of(plan)]
        moment = np.cross(arms, forces[limbs]).sum(axis=0)
        worst = max(worst, float(np.abs(np.r_[net, moment]).max()))
    return more("net force or moment", worst, share * weight_of(plan), "N or Nm")


def configuration(plan: Opened, model: Any, standing: Array, rest: Array, frame: int) -> Array:
    """Pinocchio's coordinates of a key frame."""
    turn = pinocchio.exp3(plan.arrays["rotation_rad"][frame])
    place = standing.copy()
    place[:3] = plan.arrays["com_m"][frame] - turn @ rest
    place[3:7] = pinocchio.Quaternion(turn).coeffs()
    for name, angle in zip(
        plan.head["columns"]["joints"], plan.arrays["joints_rad"][frame], strict=True
    ):
        place[model.joints[model.getJointId(name)].idx_q] = angle
    return place


def toes_missed(plan: Opened, metres: float) -> str:
    """A foot of the URDF, at the plan's own angles, is farther than this from its toe."""
    model, data, standing = _model(plan.robot["model"])
    rest = pinocchio.centerOfMass(model, data, standing).copy()
    course = Problem.from_json(plan.head["question"])
    worst = 0.0
    for frame in range(len(plan.arrays["com_m"])):
        pinocchio.framesForwardKinematics(
            model, data, configuration(plan, model, standing, rest, frame)
        )
        for limb, leg in enumerate(plan.robot["model"]["legs"]):
            foot = data.oMf[model.getFrameId(leg["foot"])].translation
            worst = max(
                worst,
                float(np.linalg.norm(foot - plan.arrays["toes_m"][course.holds[frame, limb]])),
            )
    return more("foot off its toe", worst, metres, "m")


def overloaded(plan: Opened) -> str:
    """A joint needs more than twice its limit at rest, under the plan's own forces."""
    model, data, standing = _model(plan.robot["model"])
    rest = pinocchio.centerOfMass(model, data, standing).copy()
    worst = 0.0
    for row, (frame, limbs, _, _) in enumerate(rows_of(plan)):
        place = configuration(plan, model, standing, rest, frame)
        pinocchio.computeJointJacobians(model, data, place)
        needed = pinocchio.computeGeneralizedGravity(model, data, place)
        for limb in limbs:
            foot = model.getFrameId(plan.robot["model"]["legs"][limb]["foot"])
            columns = pinocchio.getFrameJacobian(model, data, foot, pinocchio.LOCAL_WORLD_ALIGNED)[
                :3
            ]
            needed = needed - columns.T @ plan.arrays["forces_n"][row, limb]
        worst = max(worst, float((np.abs(needed[6:]) / model.effortLimit[6:]).max()))
    return more("share of a joint's torque", worst, 1.0, "")


def beyond_joints(plan: Opened, radians: float) -> str:
    """An angle is outside of its joint's limits."""
    model, _, _ = _model(plan.robot["model"])
    worst = 0.0
    for name, angles in zip(
        plan.head["columns"]["joints"], plan.arrays["joints_rad"].T, strict=True
    ):
        at = model.joints[model.getJointId(name)].idx_q
        low, high = model.lowerPositionLimit[at], model.upperPositionLimit[at]
        worst = max(worst, float(np.max(low - angles)), float(np.max(angles - high)))
    return more("joint beyond its limits", worst, radians, "rad")


def weight_of(plan: Opened) -> float:
    """m g [N]."""
    return float(plan.robot["mass_kg"] * plan.head["question"]["gravity_m_s2"])


def corners_of(patch: dict[str, Any]) -> Array:
    """Corners of a patch, (V, 3) [m]."""
    return np.asarray(patch["vertices_m"], dtype=float)


def _model(said: dict[str, Any]) -> tuple[Any, Any, Array]:
    model = pinocchio.buildModelFromXML(said["urdf"], pinocchio.JointModelFreeFlyer())
    place = pinocchio.neutral(model)
    for leg in said["legs"]:
        for name, angle in leg["stance_rad"].items():
            place[model.joints[model.getJointId(name)].idx_q] = angle
    return model, model.createData(), place


def _distance(point: Array, corners: Array) -> float:
    """From a point to a flat convex polygon [m]."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
    normal /= np.linalg.norm(normal)
    edges = np.roll(corners, -1, axis=0) - corners
    if (np.cross(normal, edges) * (point - corners)).sum(axis=1).min() >= 0.0:
        return float(abs(normal @ (point - corners[0])))
    along = np.clip(((point - corners) * edges).sum(axis=1) / (edges**2).sum(axis=1), 0.0, 1.0)
    return float(np.linalg.norm(point - corners - along[:, None] * edges, axis=1).min())
