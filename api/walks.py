"""Walks: gaits over curved ground."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from stancekit.planners.arguments import checked
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, read_only
from stancekit.planners.files.arrays import checked as checked_number
from stancekit.planners.gait.method.attempt import Attempt
from stancekit.planners.gait.method.portfolio import Caps, GaitPlan, plan_gait
from stancekit.planners.gait.task import GaitTask
from stancekit.planners.interrupts import interruptible
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.single_body import GaitRobot
from stancekit.planners.robot.walker import walker_from
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import named_terrain

from .upgrading import old_arguments

FURTHER = (
    "start_yaw_rad",
    "end_yaw_rad",
    "friction",
    "adhesive",
    "suction_n",
    "cycle_s",
    "timings",
    "total_iterations",
)
"""A limit, and fields of a ``GaitTask``, that ``walk`` takes by their names."""
OLD = {
    "heading_rad": "walk(..., start_yaw_rad=...)",
    "heading_end_rad": "walk(..., end_yaw_rad=...)",
    "total_s": "walk(..., time_limit_s=...)",
}
NOW = {"heading_rad": "start_yaw_rad", "heading_end_rad": "end_yaw_rad", "total_s": "time_limit_s"}


@checked
def walk(
    terrain: HeightField | str | Path,
    goal_xy_m: Array | Sequence[float],
    *,
    start_xy_m: Array | Sequence[float] = (0.0, 0.0),
    robot: Robot | GaitRobot | str | Path = "anymal",
    gait: Literal["trot", "walk", "pace", "bound", "gallop", "tripod"] = "trot",
    duration_s: float = 10.0,
    chart: str = "portfolio",
    time_limit_s: float = 240.0,
    **task: Any,
) -> GaitPlan:
    """Find a walk over a terrain: the motion of the torso, footholds and contact forces.

    Arguments:
        terrain: a ``HeightField``, a name ("ripple", "cone", "hill", "pit", ...), a random one as "rough:0.5:7"
            (family, difficulty, seed), a file of heights, or a function of x and y as "FILE.py:NAME".
        goal_xy_m, start_xy_m: where the torso ends and begins, shape (2,) [m].
        robot: "anymal", "hexapod", another name, a .urdf file, a .yaml file that names one or has a walker's numbers, a
            ``Robot`` with legs of its own, or what ``load`` gives of such a file.
        gait: order of the steps; tripod is for six feet, the others are for four.
        duration_s: time to walk [s].
        chart: coordinates to solve in ("decoupled", "warped-exact", "ambient", ..., or "FILE.py:NAME"); "portfolio"
            tries one after another until the verifier accepts.
        time_limit_s: processor time of all solves; the best walk until then is the answer [s].
        task: further fields of ``GaitTask``: start_yaw_rad, end_yaw_rad (which way it faces at the start, from x
            towards y, and at the end; it turns by the difference of the two [rad]), friction (Coulomb's ν of the
            ground, 0.75), adhesive (names of feet that stick: they may pull), suction_n (with how much; twice the
            weight where it is missing [N]), cycle_s (of the gait; its own where it is missing [s]), timings. Beside
            them total_iterations, a limit of the solvers' iterations: with a ``time_limit_s`` that is never met, 1e6,
            the walk is the same on a busy computer.
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
    beside = ("terrain", "goal_xy_m", "start_xy_m", "robot", "gait", "duration_s", "chart", "time_limit_s", *FURTHER)
    old = {name: value for name, value in task.items() if name not in FURTHER}
    given = {name: value for name, value in task.items() if name in FURTHER}
    moved = {NOW[name]: value for name, value in old_arguments("walk", old, OLD, beside).items()}
    if both := given.keys() & moved.keys():
        raise InvalidInput(f"{both.pop()}: expected it once, got it in its old form, too")
    given |= moved
    limit_s = given.pop("time_limit_s", time_limit_s)
    checked_number(limit_s, "time_limit_s", above=0.0)
    iterations = given.pop("total_iterations", None)
    caps = Caps(total_s=limit_s, total_iterations=iterations)
    if iterations is not None:
        caps = replace(caps, solve_s=limit_s)
    body = walker_from(robot)
    sticky = given.pop("adhesive", ())
    if isinstance(sticky, str) or not isinstance(sticky, Sequence):
        raise InvalidInput(f"adhesive: expected a sequence (text each), got {sticky!r}")
    if strange := [name for name in sticky if name not in body.foot_names]:
        wanted = f"some of {', '.join(body.foot_names)}"
        raise InvalidInput(f"adhesive: expected {wanted}, got {', '.join(map(str, strange))}")
    asked = GaitTask(
        robot=body,
        terrain=named_terrain(str(terrain)) if isinstance(terrain, str | Path) else terrain,
        start_xy_m=read_only(start_xy_m, (2,), "start_xy_m"),
        goal_xy_m=read_only(goal_xy_m, (2,), "goal_xy_m"),
        duration_s=duration_s,
        adhesive=tuple(name in sticky for name in body.foot_names),
        gait=gait,
        **given,
    )
    attempts = None if chart == "portfolio" else [Attempt(chart=chart)]
    with interruptible(signal.SIGINT) as interrupted:
        found = plan_gait(asked, progress=lambda *at: interrupted(), caps=caps, attempts=attempts)
    if found.stopped:
        raise KeyboardInterrupt
    return found
