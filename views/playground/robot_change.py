"""Another robot on a course in keys: it stands, spreads its feet and steps as it does, not as the
one before it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from stancekit.planners.problem.course_file import spec_from
from stancekit.planners.problem.course_keys import CourseSpec
from stancekit.planners.robot.model import hexapod
from stancekit.planners.robot.reach_sets import standing_toes
from stancekit.planners.robot.robot_file import named_robot

OURS = ("stance", "gait", "robot", "mass_kg")
"""Keys that say how the robot before stood."""


def with_robot(keys: Mapping[str, Any], folder: Path, robot: str) -> tuple[dict[str, Any], float]:
    """The keys for another robot, a built-in name or a file, and its mass [kg].

    Raises InvalidInput for none.

    On ground its path is as much higher as it stands higher; between walls it stays.
    """
    name = str(Path(robot).resolve()) if Path(robot).suffix else robot
    changed = {key: value for key, value in keys.items() if key not in OURS} | {"robot": name}
    model = named_robot(robot)
    down = _stands_m(keys, folder)
    if robot == "hexapod":
        changed["gait"], height = "tripod", 0.20
        changed["stance"] = (
            {"outward_m": 0.13, "down_m": 0.20}
            if down > 0.02
            else {"outward_m": 0.08, "down_m": 0.0}
        )
    else:
        changed["gait"] = "tripod" if len(model.legs) >= 6 and len(model.legs) % 2 == 0 else "wave"
        height = -float(standing_toes(model)[:, 2].mean())
    if down > 0.02:
        for key in ("start_m", "goal_m"):
            changed[key] = _raised(changed[key], height - down)
        changed["via_m"] = [
            _raised(each, height - down)
            if isinstance(each, list | tuple)
            else {"at_m": _raised(each["at_m"], height - down)}
            for each in changed.get("via_m", ())
        ]
    return changed, hexapod().mass_kg if robot == "hexapod" else model.body.mass_kg


def own_kg(spec: CourseSpec, folder: Path) -> float:
    """Mass of a course's robot without what its key mass_kg says [kg]."""
    plain = spec.model_copy(update={"mass_kg": None})
    return plain.make_robot(folder).mass_kg


def _stands_m(keys: Mapping[str, Any], folder: Path) -> float:
    """Height of the centre of mass above its toes on the course as it is [m]; 0 between walls."""
    spec = spec_from(keys)
    robot = spec.make_robot(folder)
    if not robot.source.own:
        return spec.stance.down_m
    return -float(np.mean(standing_toes(robot.source.own_model())[:, 2]))


def _raised(place: Any, by_m: float) -> Any:
    """A place (x, y, z), higher; one of x and y alone stays."""
    return place if len(place) == 2 else [place[0], place[1], round(float(place[2]) + by_m, 4)]
