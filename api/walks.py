"""Walks: gaits over curved ground."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from stancekit.planners.arguments import checked
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.gait.method.attempt import Attempt
from stancekit.planners.gait.method.portfolio import Caps, GaitPlan, plan_gait
from stancekit.planners.gait.task import GaitTask
from stancekit.planners.robot.single_body import GaitRobot
from stancekit.planners.robot.walker import named_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import named_terrain


@checked
def walk(
    terrain: HeightField | str,
    goal_xy_m: Array | Sequence[float],
    *,
    start_xy_m: Array | Sequence[float] = (0.0, 0.0),
    heading_rad: float = 0.0,
    heading_end_rad: float | None = None,
    robot: GaitRobot | str | Path | None = None,
    gait: Literal["trot", "walk", "pace", "bound", "gallop", "tripod"] = "trot",
    cycle_s: float | None = None,
    duration_s: float = 10.0,
    friction: float = 0.75,
    adhesive: Sequence[str] = (),
    suction_n: float | None = None,
    chart: str = "portfolio",
    total_s: float = 240.0,
) -> GaitPlan:
    """Find a walk over a terrain: the motion of the torso, footholds and contact forces.

    Arguments:
        terrain: a ``HeightField``, a name ("ripple", "cone", "hill", "pit", ...), a random one as "rough:0.5:7"
            (family, difficulty, seed), a file of heights, or a function of x and y as "FILE.py:NAME".
        goal_xy_m, start_xy_m: where the torso ends and begins, shape (2,) [m].
        heading_rad: which way the robot faces at the start, from x towards y [rad].
        heading_end_rad: which way it faces at the end; None where nothing is asked. It turns by the difference of the
            two, on the spot where the goal is the start [rad].
        robot: "anymal", "hexapod", a .urdf file, a .yaml file that names one or has a walker's numbers, or what
            ``load`` gives of such a file; ANYmal where there is none.
        gait: order of the steps; tripod is for six feet, the others are for four.
        cycle_s: how long a cycle of it lasts; its own if missing, shorter for a low robot that balances on two
            feet [s].
        duration_s: time to walk [s].
        friction: Coulomb coefficient ν of the ground.
        adhesive: names of feet that stick: they may pull.
        suction_n: what such a foot may pull with, and where its friction cone begins; twice the weight if missing [N].
        chart: coordinates to solve in ("decoupled", "warped-exact", "ambient", ..., or "FILE.py:NAME"); "portfolio"
            tries one after another until the verifier accepts.
        total_s: processor time of all solves; the best walk until then is the answer [s].
    Returns:
        A ``GaitPlan``: ``trajectory`` is the walk that the verifier accepted, None where there is none, and ``message``
        says in one line what came of it.
    Raises:
        InvalidInput: for a place off the terrain, ground that the robot cannot stand on there, feet that the
            robot lacks, a walk longer than its time.
    Source:
        Paper W §III (W1-W7), §IV (charts), §V.
    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
        >>> found = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled")
        >>> found.verified, found.trajectory.feet_m.shape[1:]
        (True, (4, 3))
    """
    body = robot if isinstance(robot, GaitRobot) else named_walker(robot or "anymal")
    if strange := [name for name in adhesive if name not in body.foot_names]:
        raise InvalidInput(f"adhesive: expected some of {', '.join(body.foot_names)}, got {', '.join(strange)}")
    task = GaitTask(
        robot=body,
        terrain=named_terrain(terrain) if isinstance(terrain, str) else terrain,
        start_xy_m=np.asarray(start_xy_m, dtype=np.float64),
        goal_xy_m=np.asarray(goal_xy_m, dtype=np.float64),
        start_yaw_rad=heading_rad,
        end_yaw_rad=heading_end_rad,
        duration_s=duration_s,
        friction=friction,
        adhesive=tuple(name in adhesive for name in body.foot_names),
        suction_n=suction_n,
        gait=gait,
        cycle_s=cycle_s,
    )
    attempts = None if chart == "portfolio" else [Attempt(chart=chart)]
    return plan_gait(task, caps=Caps(total_s=total_s), attempts=attempts)
