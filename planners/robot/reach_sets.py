"""Limbs of a robot's model as the contact planner sees them: for each leg the half-spaces that its
toe is in.

Plans take inner sets, proofs outer ones. A toe planned in the inner polytope is one that the leg
reaches, about the centre of mass of the standing robot; that no plan exists within inner sets proves
nothing of the robot. The outer set holds every place of the toe about the centre of mass, wherever
legs and other joints take that (``outer_sets``), so that a proof over outer sets is one. The toe is
on the foot's surface, a radius away from the foot's centre in a direction that the terrain decides:
the inner set is that much smaller, the outer one that much larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..files.arrays import Array
from .leg import Leg
from .limb import Limb
from .outer import enclosing_ball
from .outer_sets import contact_radii_m, outer_sets
from .reach import ReachRows
from .robot_model import RobotModel
from .workspace import Workspace
from .workspace_cache import workspaces_of

if TYPE_CHECKING:
    from .model import Robot

Sets = Literal["inner", "outer"]


def limbs_over(
    robot: RobotModel, sets: Sets = "inner", workspaces: Sequence[Workspace] | None = None
) -> tuple[Limb, ...]:
    """The limbs of a model over these sets of its legs, from its centre of mass as it stands.

    Arguments:
        workspaces: workspaces of the legs; None to measure them, or take them from the cache.

    Raises:
        InvalidInput: for a leg whose foot is larger than its inner set, for one whose workspace has
            no inside, and where a person has to say first what a leg touches with, or which way is
            up.
    """
    robot.check_known()
    if sets == "outer":
        return _outer_limbs(robot)
    measured = workspaces_of(robot) if workspaces is None else workspaces
    return tuple(
        _limb(leg, each, robot.body.com_m) for leg, each in zip(robot.legs, measured, strict=True)
    )


def contains_all(robot: Robot) -> bool:
    """Tell whether a robot's limbs may reach all that the legs of its own file may.

    Raises InvalidInput for a robot without such legs.
    """
    model = robot.source.own_model()
    return outer_sets(model).within(robot.limbs, contact_radii_m(model))


def standing_toes(robot: RobotModel) -> Array:
    """Places of the toes as the robot stands on level ground, from its centre of mass, shape (N, 3)
    [m].
    """
    down = np.array([0.0, 0.0, 1.0])
    return np.array([leg.nominal_m - leg.radius_m * down - robot.body.com_m for leg in robot.legs])


def _outer_limbs(robot: RobotModel) -> tuple[Limb, ...]:
    """The limbs over all that the legs may reach, wherever the centre of mass is."""
    sets, limbs = outer_sets(robot), []
    for leg, bounds, ball, radius in zip(
        robot.legs, sets.feet_m, sets.balls_m, contact_radii_m(robot), strict=True
    ):
        limbs.append(
            Limb(
                name=leg.name,
                shoulder_m=ball[:3],
                reach_m=float(ball[3] + radius),
                reach_rows=ReachRows(normals=sets.normals, bounds_m=bounds + radius),
                hip_m=leg.hip_m - robot.body.com_m,
            )
        )
    return tuple(limbs)


def _limb(leg: Leg, workspace: Workspace, com_m: Array) -> Limb:
    """One leg: its inner set as half-spaces, and a ball that holds them."""
    inner = workspace.inner
    centre, radius = enclosing_ball(inner.vertices)
    rows = ReachRows(
        normals=inner.normals, bounds_m=inner.offsets_m - leg.radius_m - inner.normals @ com_m
    )
    return Limb(
        name=leg.name,
        shoulder_m=centre - com_m,
        reach_m=radius,
        reach_rows=rows,
        hip_m=leg.hip_m - com_m,
    )
