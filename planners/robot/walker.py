"""A robot's model as a walker: one rigid body, and for every foot the box of its inner set about
where it stands (W4).

The box R_i of W4 is "the largest rectangular reachable set". Here it is the upright box in the
leg's inner polytope that has most room about the standing foot, up and down, ahead and back, in and
out (the largest product of the six distances: the largest volume alone leaves a foot on the border
of its box). Boxes of two feet do not cross: each is on its own side of the plane half way between
where the two stand, so that every foot is nearer to its own place than to another's.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import cast, get_args
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.documents import YAML, read_yaml
from .hulls import Polytope
from .leg_sources import no_legs
from .limb import Foot, half_sides
from .meshes import shape_points, solid_shapes
from .model import DEEPEST, Limb, Robot
from .reach_sets import Sets, limbs_over, soles_apart, standing_toes
from .robot_file import ROBOTS, model_of_keys, named_robot, read_keys, robot_path, unknown
from .robot_model import RobotModel, model_of
from .single_body import anymal, hexapod_walker, legged_anymal, read_walker
from .urdf_reader import pinocchio
from .workspace import Workspace, workspaces_of

_SAME_M = 1e-12
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
        relative_reach=soles_apart(robot) if sets == "inner" else (),
        model=robot,
    )


def sets_of(robot: Robot) -> Sets | None:
    """The sets of its model's legs that a robot's limbs have; None where it has no model, or they
    have others.
    """
    for sets in get_args(Sets):
        # of robots without legs of their own, and of legs without an inside, there are none
        with suppress(InvalidInput):
            if _same_reach(robot.sets(sets), robot):
                return cast(Sets, sets)
    return None


def _same_reach(one: Robot, other: Robot) -> bool:
    """Tell whether the toes of both are in the same sets, to the rounding of a file."""
    numbers = [
        (_numbers(mine), _numbers(theirs))
        for mine, theirs in zip(one.limbs, other.limbs, strict=True)
    ]
    return all(
        mine.shape == theirs.shape and np.allclose(mine, theirs, rtol=0.0, atol=_SAME_M)
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


_SHAPES = "collision", "visual"


def on_limbs(robot: Robot, limbs: Sequence[Limb], mass_kg: float) -> Robot:
    """The robot on these limbs, each with the leg of its name.

    Other legs of its file are held as the robot stands: they weigh, and nobody looks at their
    shapes, since a posture does not say where they are. Legs that are drawn up are drawn for these
    limbs alone. ``absent`` names them, and verdicts say that their bodies are not judged.

    Arguments:
        limbs: the limbs, in the robot's order.
        mass_kg: the whole mass [kg].

    Raises:
        InvalidInput: for a robot whose legs are not known, and a mass that is not that of its file.
    """
    names = tuple(limb.name for limb in limbs)
    idle = tuple(name for name in robot.limb_names if name not in names)
    if not robot.source.own and robot.drawn is None:
        raise no_legs(robot.name)
    model = _on_legs(robot.source.own_model(), names) if robot.source.own else None
    return Robot(
        name=robot.name,
        mass_kg=mass_kg,
        limbs=tuple(limbs),
        model=model,
        drawn=robot.drawn,
        absent=idle,
    )


@lru_cache(maxsize=8)
def _on_legs(model: RobotModel, names: tuple[str, ...]) -> RobotModel:
    """The model whose other legs are part of its base, without shapes; whoever reads its URDF reads
    it so.
    """
    if names == model.leg_names:
        return model
    root, legs = deepcopy(model.tree), [leg for leg in model.legs if leg.name in names]
    idle = [leg for leg in model.legs if leg.name not in names]
    held = {
        name: angle
        for leg in idle
        for name, angle in zip(leg.joint_names, leg.stance_rad.tolist(), strict=True)
    }
    for joint in root.findall("joint"):
        if (name := joint.get("name", "")) in held:
            _hold(joint, held[name])
    unseen = {
        link
        for link, mount in model.mounts.items()
        if mount.leg is not None and model.legs[mount.leg] in idle
    }
    for link in root.findall("link"):
        for kind in _SHAPES if link.get("name") in unseen else ():
            for shape in link.findall(kind):
                link.remove(shape)
    again = model_of(
        ElementTree.tostring(root, encoding="unicode"),
        where=model.name,
        folder=None,
        hulls={},
        feet={leg.name: leg.foot for leg in legs},
        name=model.name,
        contacts={leg.name: leg.contact for leg in legs if leg.contact is not None},
        posture_rad={
            joint: angle
            for leg in legs
            for joint, angle in zip(leg.joint_names, leg.stance_rad.tolist(), strict=True)
        },
    )
    shapes = tuple(shape for shape in model.shapes if shape.link not in unseen)
    return again.changed(legs=tuple(legs), shapes=shapes, disabled_pairs=model.disabled_pairs)


def _hold(joint: Element, angle: float) -> None:
    """Make a joint one that does not move, at this angle [rad, or m where it slides]."""
    pin = pinocchio()
    origin = joint.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(joint, "origin")
    place, turn = (
        np.array(origin.get(key, "0 0 0").split(), dtype=np.float64) for key in ("xyz", "rpy")
    )
    axis_element = joint.find("axis")
    axis = np.array(
        (axis_element.get("xyz", "1 0 0") if axis_element is not None else "1 0 0").split(),
        dtype=np.float64,
    )
    axis, rotation = axis / np.linalg.norm(axis), np.array(pin.rpy.rpyToMatrix(*turn))
    if joint.get("type") == "prismatic":
        place = place + rotation @ (angle * axis)
    else:
        rotation = rotation @ np.array(pin.exp3(angle * axis))
    origin.set("xyz", " ".join(map(repr, place.tolist())))
    origin.set("rpy", " ".join(map(repr, np.array(pin.rpy.matrixToRpy(rotation)).tolist())))
    joint.set("type", "fixed")


BUILT_IN = {"anymal": legged_anymal, "anymal-boxes": anymal, "hexapod": hexapod_walker}
_LEGS = (4, 6)
"""Numbers of legs that there are gaits for (``problem.gaits.GAITS``)."""
_ROOM = 0.05
"""Share of the leg's length: a foot stands so far inside what it reaches, or farther."""
_CROUCHES = 101
"""Number of heights that are tried."""
_UP = np.array([0.0, 0.0, 1.0])
_UP.setflags(write=False)


def named_walker(name: str | Path) -> Robot:
    """The walker of a name, a ``.urdf`` file, or a ``.yaml`` file that names one or has a walker's
    numbers.

    Raises InvalidInput, in one line, for anything else.
    """
    path = robot_path(name)
    if path.suffix in YAML:
        data = read_yaml(path)
        if isinstance(data, dict) and "urdf" not in data:
            return read_walker(path)
        keys = read_keys(path)
        return walker_of(
            model_of_keys(keys, path),
            trunk_half_m=keys.trunk_half_m,
            ceiling_m=keys.ceiling_m,
            inner_m=keys.inner_m,
        )
    if path.suffix in ROBOTS:
        return walker_of(named_robot(path))
    if str(name) in BUILT_IN:
        return BUILT_IN[str(name)]()
    raise unknown(name, tuple(BUILT_IN))


def walker_from(robot: Robot | str | Path) -> Robot:
    """A robot as walks have it: with feet. One that has them is as it is; boxes of others are
    measured on the legs of their files, or read by ``named_walker``.

    Raises InvalidInput for a ``Robot`` that is but its limbs, and is not the default hexapod.
    """
    if not isinstance(robot, Robot):
        return named_walker(robot)
    if robot.feet:
        return robot
    if robot.source.own:
        return walker_of(robot.source.own_model())
    default = hexapod_walker()
    if robot.limb_names == default.limb_names and robot.mass_kg == default.mass_kg:
        return default
    raise InvalidInput(
        f"robot: expected one whose legs are known for a walk, got {robot.name}, of which only the "
        "limbs are known"
    )


def walker_of(
    model: RobotModel,
    workspaces: Sequence[Workspace] | None = None,
    *,
    trunk_half_m: Sequence[float] | None = None,
    ceiling_m: float = 0.0,
    inner_m: float = 0.0,
) -> Robot:
    """The walker of a robot's model: its mass and inertia as it stands, reach boxes (W4), and its
    trunk.

    Where a foot has no room about it as the model stands, the walker stands a little lower, and its
    feet where they are.

    Arguments:
        workspaces: workspaces of the legs; None to measure them, or take them from the cache.
        trunk_half_m: half sides of the trunk's box, shape (3,) [m]; of the shapes that no leg
            carries where not given.
        ceiling_m: how high above the centre of mass a foot may be.
        inner_m: how far a foot stays from the planes half way to the others [m].

    Raises:
        InvalidInput: for a leg without a workspace, or whose foot has no room about it at any
            height, for a robot without a trunk, and for one that no gait is for.
    """
    if len(model.legs) not in _LEGS:
        raise InvalidInput(
            f"robot {model.name}: expected four or six legs for a walk, got {len(model.legs)}: "
            "walks of bipeds and of "
            "eight legs are not planned yet, key frames are (stancekit plan)"
        )
    measured = workspaces_of(model) if workspaces is None else workspaces
    toes = standing_toes(model)
    inner = list[Polytope]()
    for i, limb in enumerate(contact_robot(model, measured).limbs):
        rows = limb.reach_rows
        assert rows is not None
        sides = _own_side(toes, i, ceiling_m, inner_m)
        inner.append(Polytope(normals=rows.normals, offsets_m=rows.bounds_m).cut(*sides))
    room = _ROOM * np.array([leg.chain.length_m for leg in model.legs])
    crouch_m = _crouch(model, inner, toes, room)
    toes = toes + crouch_m * _UP
    boxes = [
        each.box_about(toe, 0.99 * least)
        for each, toe, least in zip(inner, toes, room, strict=True)
    ]
    feet = [
        Foot(
            name=leg.name,
            nominal_m=toe,
            reach_min_m=low,
            reach_max_m=high,
            hip_m=leg.hip_m - model.body.com_m,
        )
        for leg, toe, (low, high) in zip(model.legs, toes, boxes, strict=True)
    ]
    trunk = _trunk(model) if trunk_half_m is None else half_sides(trunk_half_m, "trunk_half_m")
    return Robot(
        name=model.name,
        mass_kg=model.body.mass_kg,
        inertia_kgm2=model.body.inertia_kgm2,
        feet=tuple(feet),
        stand_height_m=model.stand_height_m - crouch_m,
        trunk_half_m=trunk,
        model=model,
    )


def _crouch(model: RobotModel, inner: Sequence[Polytope], toes: Array, room_m: Array) -> float:
    """Depth that the body goes down from its standing height until every foot has room about it, 0
    where it has [m].

    Raises InvalidInput, with the foot that lacks most, where none is deep enough.
    """
    depths = np.linspace(0.0, DEEPEST * model.stand_height_m, _CROUCHES)
    lack = np.array(
        [
            [
                least - float(np.min(each.offsets_m - each.normals @ (toe + depth * _UP)))
                for each, toe, least in zip(inner, toes, room_m, strict=True)
            ]
            for depth in depths
        ]
    )
    enough = np.flatnonzero(np.all(lack <= 0.0, axis=1))
    if len(enough):
        return float(depths[enough[0]])
    worst = int(np.argmax(lack[int(np.argmin(lack.max(axis=1)))]))
    raise InvalidInput(
        f"leg {model.legs[worst].name}: expected a height to stand at with "
        f"{1e3 * room_m[worst]:.0f} mm of reach about "
        f"the foot, found none with it at ({toes[worst, 0]:.3g}, {toes[worst, 1]:.3g}) m from the "
        "centre of mass: say "
        "another posture_rad in a YAML file"
    )


def _own_side(toes: Array, foot: int, ceiling_m: float, inner_m: float) -> tuple[Array, Array]:
    """Half-spaces below the ceiling, and nearer to the foot's own place than to another's, seen
    from above.
    """
    normals, offsets = [_UP], [ceiling_m]
    for other in np.delete(toes, foot, axis=0):
        away = (other - toes[foot]) * [1.0, 1.0, 0.0]
        if (far := float(np.linalg.norm(away))) > 1e-9:
            normals.append(away / far)
            offsets.append(float(away @ (other + toes[foot])) / (2.0 * far) - inner_m)
    return np.array(normals), np.array(offsets)


def _trunk(model: RobotModel) -> Array:
    """Half sides of a box about the centre of mass that has the lower face of what no leg carries,
    shape (3,) [m].

    Only the lower face is ever asked for: what is above the centre of mass does not count.
    """
    corners = []
    for shape in solid_shapes(model.shapes):
        mount = model.mounts[shape.link]
        if mount.leg is None and (points := shape_points(shape)) is not None:
            corners.append(
                (shape.origin_m + points @ shape.rotation.T) @ mount.rotation.T + mount.origin_m
            )
    if not corners:
        raise InvalidInput(
            "trunk_half_m: expected shapes of the base, found none: say it in a YAML file"
        )
    points = np.vstack(corners) - model.body.com_m
    below = max(-float(points[:, 2].min()), 1e-3)
    return np.array([*np.abs(points[:, :2]).max(axis=0), below])
