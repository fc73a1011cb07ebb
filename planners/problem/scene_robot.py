"""The robot of a published scene: with its own polytopes, with those of a folder, or another robot
in its place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InvalidInput
from ..robot.model import Limb, Robot
from ..robot.reach_file import ReachSets, read_reach, same_limb
from ..robot.single_body import anymal
from .posture import TILT_LIMIT_RAD
from .scene_keys import SceneSpec

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets

BOXES = "anymal"
"""A robot by the boxes of reach that walks have (``configs/robots/anymal.yaml``)."""


def published_robot(spec: SceneSpec, folder: Path, reach: str | Path | None = None) -> Robot:
    """The robot of a scene with its published reach, or with that of another folder.

    Raises InvalidInput.
    """
    if reach is not None:
        return _of_sets(spec, read_reach(reach, spec.limbs))
    packaged = Path(str(resources.files("stancekit.configs.reach"))) / spec.reach.folder
    data_folder = packaged if packaged.is_dir() else folder / spec.reach.folder
    return _of_sets(spec, read_reach(data_folder, spec.limbs, com_stretch=spec.reach.com_stretch))


def other_robot(
    spec: SceneSpec, robot: Robot | str, folder: Path, sets: Sets = "inner"
) -> tuple[SceneSpec, Robot, float]:
    """The scene with the names of another robot's legs, the robot, and its tilt limit.

    Raises InvalidInput.

    Arguments:
        robot: ``anymal``, the boxes that walks have, what ``named_robot`` takes, or a ``Robot``.
            Legs are matched by how their names begin. A robot's soles are the scene's; it has no
            joints then, which are for point feet. Plans keep the body level, as the published do,
            since that costs inner sets nothing; proofs are of one that tilts.
    """
    if isinstance(robot, str) and robot == BOXES:
        boxes = anymal()
        limbs = tuple(replace(limb, leg=None) for limb in boxes.limbs)
        made = Robot(name=boxes.name, mass_kg=boxes.mass_kg, limbs=limbs)
    elif isinstance(robot, Robot) and not robot.source.own:
        made = robot
    else:
        from ..robot.contact_robot import contact_robot
        from ..robot.robot_file import named_robot

        if isinstance(robot, Robot):
            model = robot.source.own_model()
        else:
            model = named_robot(folder / robot if Path(robot).suffix else robot)
        made = contact_robot(model, sets=sets)
        if spec.ours.sole_m is not None:
            sole = np.array(spec.ours.sole_m)
            limbs = tuple(replace(limb, sole_m=sole, hip_m=None) for limb in made.limbs)
            made = Robot(name=made.name, mass_kg=made.mass_kg, limbs=limbs)
    return renamed(spec, _matched(spec, made)), made, TILT_LIMIT_RAD if sets == "outer" else 0.0


def renamed(spec: SceneSpec, names: Mapping[str, str]) -> SceneSpec:
    """The scene with other names of its limbs."""
    phases = [
        phase
        if isinstance(phase.moving, str)
        else phase.model_copy(update={"moving": [names[limb] for limb in phase.moving]})
        for phase in spec.phases
    ]
    contacts = spec.initial_contacts
    return spec.model_copy(
        update={
            "limbs": [names[limb] for limb in spec.limbs],
            "phases": phases,
            "initial_contacts": None
            if contacts is None
            else {names[limb]: toe for limb, toe in contacts.items()},
            "ours": spec.ours.model_copy(
                update={"order": [names[limb] for limb in spec.ours.order]}
            ),
        }
    )


def _matched(spec: SceneSpec, robot: Robot) -> dict[str, str]:
    """The robot's leg of every limb of the scene."""
    matches = {
        limb: [leg for leg in robot.limb_names if same_limb(limb, leg)] for limb in spec.limbs
    }
    if any(len(legs) != 1 for legs in matches.values()) or len(robot.limbs) != len(spec.limbs):
        raise InvalidInput(
            f"robot: expected legs whose names begin as {', '.join(spec.limbs)}, got "
            f"{', '.join(robot.limb_names)}"
        )
    return {limb: legs[0] for limb, legs in matches.items()}


def _of_sets(spec: SceneSpec, sets: ReachSets) -> Robot:
    sole = None if spec.ours.sole_m is None else np.array(spec.ours.sole_m)
    limbs = tuple(
        Limb(name=name, shoulder_m=np.zeros(3), reach_m=1.0, sole_m=sole) for name in spec.limbs
    )
    return sets.applied(Robot(name=spec.robot, mass_kg=spec.ours.mass_kg, limbs=limbs))
