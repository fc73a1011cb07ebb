"""A robot's model as the contact planner sees it: a mass, and limbs over the inner or the outer
sets of its legs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from .limb import Limb
from .model import Robot
from .reach_sets import Sets, limbs_over
from .robot_model import RobotModel
from .workspace import Workspace

SAME_M = 1e-12
"""Sets whose numbers differ by no more than this are the same [m]."""


def contact_robot(
    robot: RobotModel, workspaces: Sequence[Workspace] | None = None, sets: Sets = "inner"
) -> Robot:
    """The robot with its body's origin at its centre of mass, which is taken to stay where it is as
    it stands.

    Arguments:
        workspaces, sets: as for ``limbs_over``, which raises InvalidInput.
    """
    return Robot(
        name=robot.name,
        mass_kg=robot.body.mass_kg,
        limbs=limbs_over(robot, sets, workspaces),
        model=robot,
    )


def sets_of(robot: Robot) -> Sets | None:
    """The sets of its model's legs that a robot's limbs have; None where it has no model, or they
    have others.
    """
    try:
        each = {sets: robot.sets(sets) for sets in get_args(Sets)}
    except (
        InvalidInput
    ):  # no legs of its own, or some without an inside, whose limbs were given other sets
        return None
    return next((sets for sets, made in each.items() if _same_reach(made, robot)), None)


def _same_reach(one: Robot, other: Robot) -> bool:
    """Tell whether the toes of both are in the same sets, to the rounding of a file."""
    numbers = [
        (_numbers(mine), _numbers(theirs))
        for mine, theirs in zip(one.limbs, other.limbs, strict=True)
    ]
    return all(
        mine.shape == theirs.shape and np.allclose(mine, theirs, rtol=0.0, atol=SAME_M)
        for mine, theirs in numbers
    )


def _numbers(limb: Limb) -> Array:
    """The numbers of a limb's sets, in a row."""
    rows = (
        []
        if limb.reach_rows is None
        else [limb.reach_rows.normals.ravel(), limb.reach_rows.bounds_m]
    )
    return np.concatenate([limb.shoulder_m, [limb.reach_m], *rows])
