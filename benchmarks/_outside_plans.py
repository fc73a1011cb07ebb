"""Forged plans of key frames, by somebody who had not read the verifier.

A kind takes an honest plan, a size from 1 (gross) towards 0, and a generator. It changes the plan
in place and returns why a robot cannot do it.
"""

from __future__ import annotations

from collections.abc import Callable

import _outside_judge as judge
import numpy as np
from _outside_files import Opened

from stancekit.planners.problem import Problem

Kind = Callable[[Opened, float, np.random.Generator], str]
TOLERANCE = 1e-3
"""What the judge lets pass of a toe beside its terrain [m]."""


def _each(plan: Opened):  # type: ignore[no-untyped-def]
    for placement in plan.head["question"]["placements"]:
        yield from placement["candidates"]


def floats(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """Footholds float off their walls, towards each other; the terrain stays where it is."""
    nearer = 1.0 - 0.1 * size - 0.006
    for patch in _each(plan):
        patch["vertices_m"] = [[x, nearer * y, z] for x, y, z in patch["vertices_m"]]
    plan.arrays["toes_m"][:, 1] *= nearer
    plan.arrays["forces_n"][..., 1] /= nearer
    return judge.off_terrain(plan, TOLERANCE)


def elsewhere(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """The terrain is not where the footholds are."""
    for patch in plan.head["question"]["terrain"]:
        patch["vertices_m"] = (
            judge.corners_of(patch) + np.array([1.0 + 10.0 * size, 0.0, rng.uniform(-1, 1)])
        ).tolist()
    return judge.off_terrain(plan, TOLERANCE)


def halved(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """One of the terrain's walls is gone; every foothold on it stays."""
    gone = plan.head["question"]["terrain"].pop(int(rng.integers(2)))
    del gone
    plan.head["question"]["goal_m"][0] += 1e-3 * size  # one file, one parameter
    return judge.off_terrain(plan, TOLERANCE)


def rougher(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """Footholds are rougher than the terrain they are cut from."""
    for patch in plan.head["question"]["terrain"]:
        patch["friction"] = 0.55 * (1.0 - size)
    return judge.slips(plan)


def wedges(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """Footholds are wedges on a wall that has none: turned upward about their toes, to where forces
    point.
    """
    angle = 0.15 + 0.25 * size
    for patch in plan.head["question"]["terrain"]:
        patch["friction"] = 0.45
    for hold, placement in enumerate(plan.head["question"]["placements"]):
        patch = placement["candidates"][plan.arrays["choice"][hold]]
        side = np.sign(patch["normal"][1])
        turn = np.array(
            [
                [1, 0, 0],
                [0, np.cos(angle), -side * np.sin(angle)],
                [0, side * np.sin(angle), np.cos(angle)],
            ]
        )
        about = plan.arrays["toes_m"][hold]
        patch["vertices_m"] = ((judge.corners_of(patch) - about) @ turn.T + about).tolist()
        patch["normal"] = (turn @ patch["normal"]).tolist()
        patch["friction"] = 0.62
    return judge.slips(plan)


def lighter(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """A part of the weight is carried by nobody."""
    plan.arrays["forces_n"] *= 1.0 - 0.5 * size - 0.005
    return judge.unbalanced(plan)


def leans(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """The body is beside the place where forces balance, at every frame alike."""
    plan.arrays["com_m"][:, :2] += (0.005 + 0.015 * size) * _direction(rng)
    return judge.unbalanced(plan)


def corners(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """Two feet on one wall push against each other along the diagonal of a friction pyramid; both
    balances stay.
    """
    course = Problem.from_json(plan.head["question"])
    row = int(rng.integers(len(course.stances)))
    limbs = list(course.stances[row].limbs)
    at = course.holds[course.stances[row].frame][limbs]
    walls = np.sign(plan.arrays["toes_m"][at, 1])
    wall = 1.0 if (walls > 0).sum() == 2 else -1.0
    one, other = (limb for limb, side in zip(limbs, walls, strict=True) if side == wall)
    forces, holds = plan.arrays["forces_n"][row], course.holds[course.stances[row].frame]
    line = plan.arrays["toes_m"][holds[one]] - plan.arrays["toes_m"][holds[other]]
    push = (
        (0.75 + 0.2 * size) * abs(forces[one, 1]) * line / np.linalg.norm(line)
    )  # along their line: no moment
    forces[one] += push
    forces[other] -= push
    for patch in plan.head["question"]["terrain"]:
        patch["friction"] = 0.8
    for patch in _each(plan):
        patch["friction"] = 0.8
    return judge.slips(plan, 1e-3)


def pulls(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """Feet pull at their walls; the course's own bounds of forces let them, and turn with them."""
    plan.head["question"] |= {"force_min": [-9.0, -9.0, -9.0], "force_max": [9.0, 9.0, 9.0]}
    plan.arrays["forces_n"][..., 1] *= -(0.05 + 0.95 * size)
    return judge.slips(plan)


def reversed_course(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """Footholds' corners run the other way around, and a toe leaves its patch and the wall."""
    for patch in _each(plan):
        patch["vertices_m"] = patch["vertices_m"][::-1]
    plan.arrays["toes_m"][int(rng.integers(len(plan.arrays["toes_m"]))), 0] += 0.9 + size
    return judge.off_terrain(plan, TOLERANCE)


def tolerant(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """The file says that its verdict is of a tolerance of its own, and that much is missing."""
    plan.head["verdict"]["tolerance"] = 10.0 ** (9.0 * size)
    plan.arrays["forces_n"] *= 0.9
    return judge.unbalanced(plan)


def scaled(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """The course's length scale, over which moments and lengths are judged, is a hundred
    kilometres; the body leans.
    """
    plan.head["question"]["length_scale_m"] = 10.0 ** (1.0 + 5.0 * size)
    plan.arrays["com_m"][:, 1] += 0.01
    return judge.unbalanced(plan)


def weak(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """The robot's own motors are too weak, in a file that lists torque as checked."""
    plan.urdf('effort="[^"]*"', f'effort="{5.0 - 4.0 * size}"')
    return judge.overloaded(plan)


def unlimited(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """Motors without a limit that can be believed, in a file that lists torque as checked: nobody
    has checked it.
    """
    plan.urdf('effort="[^"]*"', f'effort="{1e3 + 1e6 * size}"')
    return "torque listed as checked, without a limit to check it by"


def stiff(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """The URDF's calves do not bend as far as the plan bends them."""
    plan.urdf(r'lower="-2\.[^"]*"', f'lower="{-1.4 + 0.4 * size}"')
    return judge.beyond_joints(plan, 1e-3)


def bent(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """A joint's angle is not the one that puts the foot on its toe."""
    frame, joint = rng.integers(plan.arrays["joints_rad"].shape)
    frame, joint = (int(rng.integers(n)) for n in plan.arrays["joints_rad"].shape)
    plan.arrays["joints_rad"][frame, joint] += 1e-3 + 0.2 * size
    return judge.toes_missed(plan, 1e-5)


def ascetic(plan: Opened, size: float, rng: np.random.Generator) -> str:
    """The course's robot has a mass that its URDF has not; forces are as light as that."""
    share = 0.2 + 0.7 * (1.0 - size)
    plan.robot["mass_kg"] *= share
    plan.arrays["forces_n"] *= share
    return f"the links of the URDF have {1 / share:.2f} times this mass"


def _direction(rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


CLIMBS: tuple[Kind, ...] = (
    floats,
    elsewhere,
    halved,
    rougher,
    wedges,
    lighter,
    leans,
    corners,
    pulls,
    reversed_course,
    tolerant,
    scaled,
)
"""Of a climb between two walls by a robot without a file."""
STEPS: tuple[Kind, ...] = (weak, unlimited, stiff, bent, ascetic)
"""Of a step by a robot of a URDF."""
