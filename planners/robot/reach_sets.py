"""Limbs of a robot's model as the contact planner sees them: for each leg the half-spaces that its
toe is in.

Plans take inner sets, proofs outer ones. A toe planned in the inner polytope is one that the leg
reaches; that no plan exists within inner sets proves nothing of the robot. The outer set holds all
that the leg reaches, so that a proof over outer sets is one. The toe is on the foot's surface, a
radius away from the foot's centre in a direction that the terrain decides: the inner set is that
much smaller, the outer one that much larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from ..files.arrays import Array
from .leg import Leg
from .limb import Limb
from .outer import enclosing_ball
from .reach import ReachRows
from .robot_model import RobotModel
from .workspace import Workspace
from .workspace_cache import workspaces_of

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
    measured = workspaces_of(robot) if workspaces is None else workspaces
    return tuple(
        _limb(*each, robot.body.com_m, sets) for each in zip(robot.legs, measured, strict=True)
    )


def standing_toes(robot: RobotModel) -> Array:
    """Places of the toes as the robot stands on level ground, from its centre of mass, shape (N, 3)
    [m].
    """
    down = np.array([0.0, 0.0, 1.0])
    return np.array([leg.nominal_m - leg.radius_m * down - robot.body.com_m for leg in robot.legs])


def _limb(leg: Leg, workspace: Workspace, com_m: Array, sets: Sets) -> Limb:
    """One leg: its set as half-spaces, and a ball that holds them."""
    if sets == "outer":
        outer = workspace.outer
        normals, bounds, centre, radius = (
            outer.normals,
            outer.offsets_m + leg.radius_m,
            outer.centre_m,
            outer.radius_m,
        )
        radius = radius + leg.radius_m
    else:
        inner = workspace.inner
        normals, bounds = inner.normals, inner.offsets_m - leg.radius_m
        centre, radius = enclosing_ball(inner.vertices)
    rows = ReachRows(normals=normals, bounds_m=bounds - normals @ com_m)
    hip_m = leg.hip_m - com_m
    return Limb(
        name=leg.name, shoulder_m=centre - com_m, reach_m=radius, reach_rows=rows, hip_m=hip_m
    )
