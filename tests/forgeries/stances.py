"""Forged plans, postures and proofs, and a judge of stances that is a page of numpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from stancekit import Certificate, Motion
from stancekit.configs import config_path
from stancekit.envs.distributions.postures import distribution
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.two_stage import TwoStage

TOLERANCE = 1e-6
"""The verifier's, non-dimensional: of forces by the weight, of lengths by the course's length
scale."""


def honest_plan() -> Motion:
    """Three key frames between walls."""
    plan = TwoStage().solve(read_course(config_path("courses/walls.yaml"), 3)).solution
    assert plan is not None
    return plan


def honest_posture() -> Motion:
    """A problem on three patches with its witness."""
    rng = np.random.default_rng(3)
    while True:
        problem = distribution("ground-3").sample(rng)
        posture = Exact().solve(problem).solution
        if posture is not None:
            return posture


# -------------------------------------------------------------------------------------------------------
# judge


def stance_fault(
    com: Array, turn: Array, toes: Array, forces: Array, weight: float, length: float
) -> str:
    """Balance of one stance, toes and forces of the limbs that carry, shape (N, 3)."""
    net = forces.sum(axis=0) - [0.0, 0.0, weight]
    if abs(net).max() > 1.5 * TOLERANCE * weight:
        return "forces do not carry the weight"
    if abs(np.cross(toes - com, forces).sum(axis=0)).max() > 1.5 * TOLERANCE * weight * length:
        return "forces turn the body"
    return ""


def contact_fault(
    toe: Array, force: Array, patch: Any, weight: float, length: float, bounds: Any
) -> str:
    """One toe on its patch, and its force in the cone and within its bounds."""
    corners, room = patch.vertices_m, 1.5 * TOLERANCE * length
    high = (corners - corners.mean(axis=0)) @ patch.normal
    if abs((toe - corners.mean(axis=0)) @ patch.normal) > room + abs(high).max():
        return "a toe is off the plane of its patch"
    along = np.roll(corners, -1, axis=0) - corners
    inward = np.cross(patch.normal, along)
    sides = np.einsum("ui,ui->u", inward, toe - corners) / np.linalg.norm(along, axis=1)
    if min(sides.min(), 0.0) < -room and min(-sides.max(), 0.0) < -room:
        return "a toe is beside its patch"
    local = patch.frame.T @ force
    beyond = max(np.linalg.norm(local[1:]) - patch.friction * local[0], -local[0])
    if beyond > 1.3 * TOLERANCE * weight:
        return "a force is outside its cone"
    if (local < bounds[0] - 1.5 * TOLERANCE * weight).any() or (
        local > bounds[1] + 1.5 * TOLERANCE * weight
    ).any():
        return "a force is larger than a limb's"
    return ""


def posture_fault(posture: Motion) -> str:
    """Why nobody stands like that; empty where the judge does not know."""
    problem, com, turn, forces = (
        posture.problem,
        posture.com_m[0],
        posture.rotation_rad[0],
        posture.forces_n[0],
    )
    length, weight = problem.length_scale_m, problem.weight_n
    room = 1.5 * TOLERANCE * length
    if np.linalg.norm(com - problem.com_nominal_m[0]) > problem.com_radius_m[0] + room:
        return "the body is elsewhere"
    if abs(turn).max() > problem.tilt_limit_rad + 1.5 * TOLERANCE:
        return "the body is tilted"
    for contact, toe, force in zip(problem.contacts, posture.toes_m, forces, strict=True):
        shoulder = com + contact.shoulder_m + np.cross(turn, contact.shoulder_m)
        if np.linalg.norm(toe - shoulder) > contact.reach_m + room:
            return "a limb is too short"
        bounds = contact.force_min * weight, contact.force_max * weight
        if reason := contact_fault(toe, force, contact.patch, weight, length, bounds):
            return reason
    return stance_fault(com, turn, posture.toes_m, forces, weight, length)


def plan_fault(plan: Motion) -> str:
    """Why nobody climbs like that; empty where the judge does not know."""
    course, length, weight = plan.problem, plan.problem.length_scale_m, plan.problem.weight_n
    room = 1.5 * TOLERANCE * length
    if (
        np.linalg.norm(plan.com_m - course.com_nominal_m, axis=1) > course.com_radius_m + room
    ).any():
        return "the body is elsewhere"
    if abs(plan.rotation_rad).max() > course.tilt_limit_rad + 1.5 * TOLERANCE:
        return "the body is tilted"
    if (np.linalg.norm(np.diff(plan.com_m, axis=0), axis=1) > course.steps.com_m + room).any():
        return "the body goes too far at once"
    if (
        np.linalg.norm(np.diff(plan.rotation_rad, axis=0), axis=1)
        > course.steps.rotation_rad + 1.5 * TOLERANCE
    ).any():
        return "the body turns too far at once"
    for frame in range(1, course.frames):
        moved = plan.toes_at(frame) - plan.toes_at(frame - 1)
        if (np.linalg.norm(moved, axis=1) > course.steps.toe_m + room).any():
            return "a toe goes too far at once"
    bounds = course.force_min * weight, course.force_max * weight
    for row, stance in enumerate(course.stances):
        limbs, com, turn = (
            list(stance.limbs),
            plan.com_m[stance.frame],
            plan.rotation_rad[stance.frame],
        )
        toes, forces = plan.toes_at(stance.frame)[limbs], plan.forces_n[row]
        if abs(np.delete(forces, limbs, axis=0)).max(initial=0.0) > 0.0:
            return "a limb that moves carries"
        for limb, toe, force in zip(limbs, toes, forces[limbs], strict=True):
            of = course.robot.limbs[limb]
            if (
                np.linalg.norm(toe - com - of.shoulder_m - np.cross(turn, of.shoulder_m))
                > of.reach_m + room
            ):
                return "a limb is too short"
            held = course.holds[stance.frame][limb]
            patch = course.footholds[held].candidates[plan.choice[held]]
            if reason := contact_fault(toe, force, patch, weight, length, bounds):
                return reason
        if reason := stance_fault(com, turn, toes, forces[limbs], weight, length):
            return reason
    return ""


# --------------------------------------------------------------------------------------------------------
# kinds


def _moved(
    name: str, change: Callable[[Any, Array, float, np.random.Generator], Array]
) -> Callable[..., Any]:
    """A forgery of one array of a plan or a posture."""

    def forge(plan: Motion, size: float, rng: np.random.Generator) -> Motion:
        scale, length = plan.problem.weight_n, plan.problem.length_scale_m
        array = np.array(getattr(plan, name))
        unit = (
            TOLERANCE
            * size
            * (scale if name == "forces_n" else 1.0 if name == "rotation_rad" else length)
        )
        return replace(plan, **{name: change(plan, array, unit, rng)})

    return forge


def _way(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _one(array: Array, rng: np.random.Generator) -> tuple[int, ...]:
    """The place of one carrying force, or one toe."""
    rows = np.argwhere(abs(array).max(axis=-1) > 0.0)
    return tuple(int(at) for at in rows[rng.integers(len(rows))])


def _push(_: Any, array: Array, unit: float, rng: np.random.Generator) -> Array:
    array[_one(array, rng)] += 2.0 * unit * _way(rng)
    return array


def _light(_: Any, array: Array, unit: float, rng: np.random.Generator) -> Array:
    array[_one(array, rng)] -= [0.0, 0.0, 2.0 * unit]
    return array


def _couple(_: Any, array: Array, unit: float, rng: np.random.Generator) -> Array:
    stance = array[rng.integers(len(array))]
    first, second = np.flatnonzero(abs(stance).max(axis=1) > 0.0)[:2]
    push = 30.0 * unit * _way(rng)
    stance[first] += push
    stance[second] -= push
    return array


def _pulling(_: Any, array: Array, unit: float, rng: np.random.Generator) -> Array:
    stance = array[rng.integers(len(array))]
    at = np.flatnonzero(abs(stance).max(axis=1) > 0.0)[0]
    stance[at] = -1e6 * unit * 1e-4 * stance[at] / np.linalg.norm(stance[at])
    return array


def _all(factor: float) -> Callable[[Any, Array, float, np.random.Generator], Array]:
    def change(_: Any, array: Array, unit: float, rng: np.random.Generator) -> Array:
        return np.asarray(array * (1.0 + factor * 3.0 * unit / abs(array).max()))

    return change


def _toe(_: Any, array: Array, unit: float, rng: np.random.Generator) -> Array:
    array[rng.integers(len(array))] += 10.0 * unit * _way(rng)
    return array


def _far_toe(_: Any, array: Array, unit: float, rng: np.random.Generator) -> Array:
    array[rng.integers(len(array))] += (0.5 + unit) * _way(rng)
    return array


def _body(_: Any, array: Array, unit: float, rng: np.random.Generator) -> Array:
    body = array[rng.integers(len(array))]
    body[rng.integers(2)] += 40.0 * unit * rng.choice([-1.0, 1.0])
    return array


def _far_body(_: Any, array: Array, unit: float, rng: np.random.Generator) -> Array:
    body = array[rng.integers(len(array))]
    body += (0.3 + unit) * _way(rng)
    return array


def _tilt(plan: Motion, array: Array, unit: float, rng: np.random.Generator) -> Array:
    limit = plan.problem.tilt_limit_rad
    body = array[rng.integers(len(array))]
    body[rng.integers(3)] = rng.choice([-1.0, 1.0]) * (limit + unit)
    return array


SHARED: dict[str, Callable[..., Any]] = {
    "a force pushed": _moved("forces_n", _push),
    "weight missing": _moved("forces_n", _light),
    "a couple of forces": _moved("forces_n", _couple),
    "a foot pulling": _moved("forces_n", _pulling),
    "forces too large": _moved("forces_n", _all(1.0)),
    "forces too small": _moved("forces_n", _all(-1.0)),
    "a toe moved": _moved("toes_m", _toe),
    "a toe far away": _moved("toes_m", _far_toe),
    "the body moved": _moved("com_m", _body),
    "the body far away": _moved("com_m", _far_body),
    "the body tilted": _moved("rotation_rad", _tilt),
}
POSTURES = SHARED


def _idle(plan: Motion, size: float, rng: np.random.Generator) -> Motion:
    forces = np.array(plan.forces_n)
    rows = [row for row, one in enumerate(plan.problem.stances) if len(one.limbs) < forces.shape[1]]
    row = rows[rng.integers(len(rows))]
    limb = next(k for k in range(forces.shape[1]) if k not in plan.problem.stances[row].limbs)
    forces[row, limb] = size * TOLERANCE * plan.problem.weight_n * _way(rng)
    return replace(plan, forces_n=forces)


def _swapped_frames(plan: Motion, size: float, rng: np.random.Generator) -> Motion:
    return replace(plan, com_m=plan.com_m[::-1])


def _swapped_stances(plan: Motion, size: float, rng: np.random.Generator) -> Motion:
    return replace(plan, forces_n=np.roll(plan.forces_n, 1 + int(size) % 2, axis=0))


def _icy(plan: Motion, size: float, rng: np.random.Generator) -> Motion:
    """The patches of a foothold without friction: another task under the same answer."""
    footholds = tuple(
        replace(
            one,
            candidates=tuple(
                patch.with_friction(patch.friction / (3.0 * size)) for patch in one.candidates
            ),
        )
        for one in plan.problem.footholds
    )
    return replace(plan, problem=replace(plan.problem, footholds=footholds))


def _heavier(plan: Motion, size: float, rng: np.random.Generator) -> Motion:
    robot = replace(
        plan.problem.robot, mass_kg=plan.problem.robot.mass_kg * (1.0 + 2.0 * TOLERANCE * size)
    )
    return replace(plan, problem=replace(plan.problem, robot=robot))


PLANS: dict[str, Callable[..., Any]] = SHARED | {
    "a limb that moves carries": _idle,
    "frames backwards": _swapped_frames,
    "forces of another stance": _swapped_stances,
    "less friction under it": _icy,
    "a heavier robot": _heavier,
}


# -------------------------------------------------------------------------------------------------------
# proofs


def has_witness(problem: Problem) -> bool:
    """Whether the judge finds nothing wrong with a posture: then no proof of the contrary is
    one.
    """
    posture = Exact().solve(problem).solution
    return posture is not None and posture_fault(posture) == ""


def proof_kinds() -> dict[str, Callable[..., Any]]:
    """Proofs about icy patches, put to the problem with its friction, which has a posture."""
    problem = honest_posture().problem
    for friction in (0.2, 0.1, 0.05, 0.02, 0.0):
        contacts = tuple(
            replace(one, patch=one.patch.with_friction(friction)) for one in problem.contacts
        )
        proof = Exact().solve(problem.posture_with(contacts=contacts)).certificate
        if proof is not None:
            break
    assert proof is not None
    kinds: dict[str, Callable[[Certificate, float, np.random.Generator], Certificate]] = {
        "of another problem": lambda one, size, rng: one,
        "multipliers larger": lambda one, size, rng: replace(
            one, multipliers=size * one.multipliers
        ),
        "multipliers smaller": lambda one, size, rng: replace(
            one, multipliers=one.multipliers / size**4
        ),
        "multipliers turned round": lambda one, size, rng: replace(
            one, multipliers=-size * one.multipliers
        ),
        "multipliers shuffled": lambda one, size, rng: replace(
            one, multipliers=rng.permuted(one.multipliers, axis=1)
        ),
        "noise on multipliers": lambda one, size, rng: replace(
            one, multipliers=one.multipliers + 0.01 * size * rng.normal(size=one.multipliers.shape)
        ),
        "multipliers beyond numbers": lambda one, size, rng: replace(
            one,
            multipliers=one.multipliers
            * np.where(rng.random(one.multipliers.shape) < 0.1, np.inf, 1e150),
        ),
        "nothing is left to prove": lambda one, size, rng: Certificate(
            tree=np.array([[1.0, 0.0, 0.0, 0.0, 0.0]]),
            multipliers=np.zeros((0, one.multipliers.shape[1])),
        ),
        "a cut that covers nothing": lambda one, size, rng: Certificate(
            tree=np.array([[2.0, 0.0, 0.0, 0.5, 0.5 + 1e-6 * size], *np.zeros((2, 5))]),
            multipliers=np.repeat(one.multipliers[:1], 2, axis=0),
        ),
        "forces split beyond their box": lambda one, size, rng: Certificate(
            tree=np.array([[3.0, 0.0, 0.0, 1e3 * size, 0.0], *np.zeros((2, 5))]),
            multipliers=np.repeat(one.multipliers[:1], 2, axis=0),
        ),
    }

    def forged(forge: Any, size: float, rng: np.random.Generator) -> tuple[Problem, Certificate]:
        return problem, forge(proof, size, rng)

    return {name: partial(forged, forge) for name, forge in kinds.items()}
