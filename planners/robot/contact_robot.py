"""A robot's model as the contact planner sees it: a mass, and for each leg the half-spaces that its toe is in.

Plans take inner sets, proofs outer ones. A toe planned in the inner polytope is one that the leg reaches; that no plan
exists within inner sets proves nothing of the robot. The outer set holds all that the leg reaches, so that a proof over
outer sets is one. The toe is on the foot's surface, a radius away from the foot's centre in a direction that the
terrain decides: the inner set is that much smaller, the outer one that much larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from .leg import Leg
from .model import Limb, Robot
from .outer import enclosing_ball
from .reach import ReachRows
from .robot_model import RobotModel
from .workspace import Workspace

Sets = Literal["inner", "outer"]
SAME_M = 1e-12
"""Sets whose numbers differ by no more than this are the same [m]."""


def contact_robot(robot: RobotModel, workspaces: Sequence[Workspace], sets: Sets = "inner") -> Robot:
    """The robot with its body's origin at its centre of mass, which is taken to stay where it is as it stands.

    Raises InvalidInput for a leg whose foot is larger than its inner set, and where a person has to say first
    what a leg touches with, or which way is up.
    """
    robot.check_known()
    limbs = tuple(_limb(*each, robot.body.com_m, sets) for each in zip(robot.legs, workspaces, strict=True))
    return Robot(name=robot.name, mass_kg=robot.body.mass_kg, limbs=limbs, model=robot)


def with_sets(robot: Robot, sets: Sets) -> Robot:
    """The robot with these sets of its model's legs as the reach of its limbs.

    Raises InvalidInput for a robot without a model, and for a leg without a workspace that has an inside.
    """
    model = robot.source.own_model()
    from .workspace_cache import workspaces_of  # measures where nobody has

    return _over(robot, model, workspaces_of(model), sets)


def sets_of(robot: Robot) -> Sets | None:
    """The sets of its model's legs that a robot's limbs have; None where it has no model, or they have others."""
    from .workspace_cache import workspaces_of

    try:
        model = robot.source.own_model()
        measured = workspaces_of(model)
    except InvalidInput:  # no legs of its own, or some without an inside, whose limbs were given other sets
        return None
    each = {sets: _over(robot, model, measured, sets) for sets in get_args(Sets)}
    return next((sets for sets, made in each.items() if _same_reach(made, robot)), None)


def _over(robot: Robot, model: RobotModel, workspaces: Sequence[Workspace], sets: Sets) -> Robot:
    made = contact_robot(model, workspaces, sets)
    limbs = tuple(replace(limb, sole_m=own.sole_m) for limb, own in zip(made.limbs, robot.limbs, strict=True))
    return replace(robot, limbs=limbs)


def _same_reach(one: Robot, other: Robot) -> bool:
    """Whether the toes of both are in the same sets, to the rounding of a file."""
    numbers = [(_numbers(mine), _numbers(its)) for mine, its in zip(one.limbs, other.limbs, strict=True)]
    return all(mine.shape == its.shape and np.allclose(mine, its, rtol=0.0, atol=SAME_M) for mine, its in numbers)


def _numbers(limb: Limb) -> Array:
    """The numbers of a limb's sets, in a row."""
    rows = [] if limb.reach_rows is None else [limb.reach_rows.normals.ravel(), limb.reach_rows.bounds_m]
    return np.concatenate([limb.shoulder_m, [limb.reach_m], *rows])


def _limb(leg: Leg, workspace: Workspace, com_m: Array, sets: Sets) -> Limb:
    """One leg: its set as half-spaces, and a ball that holds them."""
    if sets == "outer":
        outer = workspace.outer
        normals, bounds, centre, radius = outer.normals, outer.offsets_m + leg.radius_m, outer.centre_m, outer.radius_m
        radius = radius + leg.radius_m
    else:
        inner = workspace.inner
        normals, bounds = inner.normals, inner.offsets_m - leg.radius_m
        centre, radius = enclosing_ball(inner.vertices)
    rows = ReachRows(normals=normals, bounds_m=bounds - normals @ com_m)
    hip_m = leg.hip_m - com_m
    return Limb(name=leg.name, shoulder_m=centre - com_m, reach_m=radius, reach_rows=rows, hip_m=hip_m)


def standing_toes(robot: RobotModel) -> Array:
    """Where the toes are as the robot stands on level ground, from its centre of mass, shape (N, 3) [m]."""
    down = np.array([0.0, 0.0, 1.0])
    return np.array([leg.nominal_m - leg.radius_m * down - robot.body.com_m for leg in robot.legs])
