"""A robot's model as one that walks or leaps: one rigid body, for every foot the box of its inner set
about where it stands (Pan et al. §III-A, W4), and limits of legs that move fast.

The box R_i of W4 is "the largest rectangular reachable set". Here it is the upright box in the
leg's inner polytope that has most room about the standing foot, up and down, ahead and back, in and
out (the largest product of the six distances: the largest volume alone leaves a foot on the border
of its box). Boxes of two feet do not cross: each is on its own side of the plane half way between
where the two stand, so that every foot is nearer to its own place than to another's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast, get_args
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import BaseModel, ConfigDict

from ..errors import InvalidInput
from ..files.arrays import Array, checked
from ..files.codec import LATER, from_json
from ..files.documents import YAML, read_text, read_yaml, validated
from .hulls import Polytope
from .leg import Leg
from .meshes import Shape, link_points, solid_shapes
from .model import DEEPEST, Foot, LegLimits, Limb, Robot, half_sides, hexapod, no_legs, robot_of
from .reach_sets import Sets, Workspace, limbs_over, soles_apart, standing_toes, workspaces_of
from .robot_file import (
    ROBOTS,
    LegKeys,
    model_from_json,
    model_of_keys,
    named_robot,
    read_keys,
    robot_path,
    unknown,
)
from .robot_model import RobotModel, model_of
from .urdf_reader import hold, matching, speed_doubts


@dataclass(frozen=True, kw_only=True, eq=False)
class WalkerKeys:
    """The keys of a robot that walks, by its feet, see ``Robot``.

    Arguments:
        model: the model from the robot's own file.
        legs: limits of the legs in leaps, by name or pattern.
        source: origin of the numbers, for readers.
    """

    name: str
    mass_kg: float
    inertia_kgm2: Array
    feet: tuple[Foot, ...]
    stand_height_m: float
    trunk_half_m: Array
    model: Mapping[str, Any] | None = field(default=None, metadata=LATER)
    source: Any = field(default=None, metadata=LATER)
    legs: Any = field(default=None, metadata=LATER)

    def value(self) -> Robot:
        """The robot.

        Raises InvalidInput.
        """
        model = model_from_json(self.model, self.name)
        numbers = {each.name: getattr(self, each.name) for each in fields(self)[:6]}
        return Robot(**numbers, model=model)


def walker_from_json(data: Any, where: str = "") -> Robot:
    """The robot that walks which ``Robot.to_json`` wrote, or a person, as in
    ``configs/robots/anymal.yaml``.

    Arguments:
        where: the file, which the message begins with.

    Raises:
        InvalidInput: in one line, with all that is wrong.
    """
    keys = from_json(WalkerKeys, data, where=where)
    try:
        return keys.value()
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}" if where else str(error)) from None


def read_walker(path: str | Path) -> Robot:
    """Read a file of the numbers of a robot that walks, as ``configs/robots/anymal.yaml`` is.

    Raises InvalidInput.
    """
    return walker_from_json(read_yaml(path), str(path))


def anymal() -> Robot:
    """ANYmal, the robot of Pan et al. §V, by its boxes alone; the file says where its numbers come
    from.
    """
    from stancekit.configs import config_path

    return read_walker(config_path("robots/anymal.yaml"))


def legged_anymal() -> Robot:
    """ANYmal with the same boxes and with legs, those of ``configs/robots/anymal.urdf``.

    Without pinocchio no legs can be read, and it is its boxes.
    """
    return anymal() if find_spec("pinocchio") is None else replace(anymal(), model=_anymal_legs())


@lru_cache(maxsize=1)
def _anymal_legs() -> RobotModel:
    from stancekit.configs import config_path

    urdf, srdf = (read_text(config_path(f"robots/anymal.{kind}")) for kind in ("urdf", "srdf"))
    feet = {name: f"{name}_FOOT" for name in ("LF", "RF", "LH", "RH")}
    return model_of(urdf, where="anymal.urdf", srdf=srdf, feet=feet, name="anymal")


def hexapod_walker() -> Robot:
    """The default hexapod of Lin et al. (``robot.model.hexapod``) as a walker: a uniform disc with
    six feet.

    The feet stand .15 m outward of the shoulders and .2 m below them, as in Lin et al.'s ground
    problems; their boxes are .2 × .2 × .12 m, whose corners are within the limbs' reach of .35 m.
    """
    robot = hexapod()
    radius_m = float(np.linalg.norm(robot.limbs[0].shoulder_m))
    feet = []
    for limb in robot.limbs:
        nominal = limb.shoulder_m * (1.0 + 0.15 / radius_m) - np.array([0.0, 0.0, 0.2])
        half = np.array([0.1, 0.1, 0.06])
        feet.append(
            Foot(
                name=limb.name,
                nominal_m=nominal,
                reach_min_m=nominal - half,
                reach_max_m=nominal + half,
                hip_m=limb.shoulder_m,
            )
        )
    thick_m = 0.08
    across = robot.mass_kg * (3.0 * radius_m**2 + thick_m**2) / 12.0
    return Robot(
        name=robot.name,
        mass_kg=robot.mass_kg,
        inertia_kgm2=np.diag([across, across, 0.5 * robot.mass_kg * radius_m**2]),
        feet=tuple(feet),
        stand_height_m=0.2,
        trunk_half_m=np.array([0.127, 0.127, 0.04]),
    )


def with_mass(model: RobotModel, mass_kg: float) -> RobotModel:
    """The model with another mass: the heaviest link that no leg moves has the difference, at its
    own centre of mass.

    It is another robot, with another digest; whoever reads its URDF reads it so. Raises
    InvalidInput for a mass that the legs alone have, or that is not a positive number.
    """
    wanted = checked(mass_kg, "mass_kg", above=0.0)
    root = deepcopy(model.tree)
    loads = {
        link.get("name", ""): mass
        for link in root.findall("link")
        if (mass := link.find("inertial/mass")) is not None
        and (mount := model.mounts.get(link.get("name", ""))) is not None
        and mount.leg is None
    }
    if not loads:
        raise InvalidInput(
            f"mass_kg: expected a robot with a body that has a mass, got {model.name} without one"
        )
    heaviest = max(loads.values(), key=lambda mass: float(mass.get("value", "0")))
    others = model.mass_kg - float(heaviest.get("value", "0"))
    if wanted <= others:
        raise InvalidInput(
            f"mass_kg: expected more than the {others:.3g} kg of all but the body, got {wanted:g}"
        )
    heaviest.set("value", repr(wanted - others))
    return _again(model, root, model.legs, model.shapes)


def _again(
    model: RobotModel, root: Element, legs: tuple[Leg, ...], shapes: tuple[Shape, ...]
) -> RobotModel:
    """The model of a changed URDF that stands on these of its legs as it did."""
    again = model_of(
        ElementTree.tostring(root, encoding="unicode"),
        where=model.name,
        folder=None,
        hulls={},
        feet={leg.name: leg.foot for leg in legs},
        name=model.name,
        contacts={leg.name: leg.contact for leg in legs if leg.contact is not None},
        posture_rad=_standing_rad(legs),
    )
    return again.changed(legs=legs, shapes=shapes, disabled_pairs=model.disabled_pairs)


def _standing_rad(legs: Sequence[Leg]) -> dict[str, float]:
    """Angles in which legs stand, by joint."""
    return {
        joint: angle
        for leg in legs
        for joint, angle in zip(leg.joint_names, leg.stance_rad.tolist(), strict=True)
    }


_SAME_M = 1e-12
"""Sets whose numbers differ by no more than this are the same [m]."""


def contact_robot(
    robot: RobotModel,
    workspaces: Sequence[Workspace] | None = None,
    sets: Sets = "inner",
    tilt_rad: float = 0.0,
) -> Robot:
    """The robot with its body's origin at its centre of mass, which is taken to stay where it is as
    it stands.

    Arguments:
        workspaces, sets, tilt_rad: as for ``limbs_over``, which raises InvalidInput.
    """
    return Robot(
        name=robot.name,
        mass_kg=robot.mass_kg,
        limbs=limbs_over(robot, sets, workspaces, tilt_rad),
        relative_reach=soles_apart(robot) if sets == "inner" else (),
        model=robot,
    )


def sets_of(robot: Robot, tilt_rad: float = 0.0) -> Sets | None:
    """The sets of its model's legs that a robot's limbs have, the outer ones within this limit of the
    tilt; None where it has no model, or they have others.
    """
    for sets in get_args(Sets):
        # of robots without legs of their own, and of legs without an inside, there are none
        with suppress(InvalidInput):
            over = robot.sets(sets, tilt_rad)
            limbs = zip(over.limbs, robot.limbs, strict=True)
            pairs = [(_numbers(one), _numbers(other)) for one, other in limbs]
            if over.relative_reach == robot.relative_reach and all(
                a.shape == b.shape and np.abs(a - b).max() <= _SAME_M for a, b in pairs
            ):
                return cast(Sets, sets)
    return None


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

    Other legs of its file are held as the robot stands: they weigh, and their shapes are not
    checked, since a posture does not say where they are. Legs that are drawn up are drawn for these
    limbs alone. ``absent`` names them, and verdicts say that their bodies are not judged.

    Arguments:
        limbs: the limbs, in the robot's order.
        mass_kg: the whole mass [kg].

    Raises:
        InvalidInput: for a robot whose legs are not known, and a mass that is not that of its file.
    """
    names = tuple(limb.name for limb in limbs)
    idle = tuple(name for name in robot.limb_names if name not in names)
    if not robot.own and robot.drawn is None:
        raise no_legs(robot.name)
    model = _on_legs(robot.own_model(), names) if robot.own else None
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
    root, legs = deepcopy(model.tree), tuple(leg for leg in model.legs if leg.name in names)
    idle = [leg for leg in model.legs if leg.name not in names]
    hold(root, _standing_rad(idle))
    unseen = {
        link
        for link, mount in model.mounts.items()
        if mount.leg is not None and model.legs[mount.leg] in idle
    }
    for link in root.findall("link"):
        for kind in _SHAPES if link.get("name") in unseen else ():
            for shape in link.findall(kind):
                link.remove(shape)
    return _again(model, root, legs, tuple(s for s in model.shapes if s.link not in unseen))


BUILT_IN = MappingProxyType(
    {"anymal": legged_anymal, "anymal-boxes": anymal, "hexapod": hexapod_walker}
)
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
    if robot.own:
        return walker_of(robot.own_model())
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
    if any(leg.sole is not None for leg in model.legs):
        raise InvalidInput(
            f"robot {model.name}: expected feet that are balls for a walk, got soles: walks on them "
            "are not planned yet, key frames are (stancekit plan)"
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
            hip_m=leg.hip_m - model.com_m,
        )
        for leg, toe, (low, high) in zip(model.legs, toes, boxes, strict=True)
    ]
    trunk = _trunk(model) if trunk_half_m is None else half_sides(trunk_half_m, "trunk_half_m")
    return Robot(
        name=model.name,
        mass_kg=model.mass_kg,
        inertia_kgm2=model.inertia_kgm2,
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
        if mount.leg is None and (points := link_points(shape)) is not None:
            corners.append(mount.placed(points))
    if not corners:
        raise InvalidInput(
            "trunk_half_m: expected shapes of the base, found none: say it in a YAML file"
        )
    points = np.vstack(corners) - model.com_m
    below = max(-float(points[:, 2].min()), 1e-3)
    return np.array([*np.abs(points[:, :2]).max(axis=0), below])


_ANGLES = 9
"""Postures per joint that are looked at for the shortest and the longest leg."""


class _File(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, defer_build=True)
    legs: dict[str, LegKeys] = {}


def leaping_robot(robot: Robot | str | Path) -> Robot:
    """A robot as leaps have it: inertia, and for every limb a hip with limits of speed, power and
    length.

    Arguments:
        robot: a ``Robot`` with both, which is returned as it is; a robot's name or file. A model's
            legs reach as far from their hips as their joints let them, in any direction; a walker's
            file gives boxes, and that of ``anymal`` has the legs of ``configs/robots/anymal.urdf``
            besides. Its key ``legs`` (by name or pattern) says limits; those of a model follow from
            the efforts and velocities of its joints.

    Raises:
        InvalidInput: for a robot without inertia.
    """
    if not isinstance(robot, Robot):
        path = robot_path(robot)
        if str(robot) == "anymal":
            from stancekit.configs import config_path

            path = config_path("robots/anymal.yaml")
        data = read_yaml(path) if path.suffix in YAML else {}
        keys = validated(_File, data, str(path)).legs
        if data and "urdf" not in data:
            walker = legged_anymal() if str(robot) == "anymal" else read_walker(path)
            robot = _corrected(replace(walker, feet=()), keys)
        else:
            keys = read_keys(path).legs if data else {}
            robot = _with_limits(robot_of(named_robot(robot)), keys)
    if robot.inertia is None:
        raise InvalidInput(
            f"robot {robot.name}: inertia_kgm2: expected the inertia of a body that leaps, got none"
        )
    return robot


def no_motors(model: RobotModel) -> str:
    """Gaps in a robot's file about its joints' efforts and velocities, in words; empty where there
    are all.
    """
    guessed = speed_doubts(model.tree)
    slow = [
        f"joint {joint.name}"
        for leg in model.legs
        for joint in leg.joints
        if joint.velocity_rad_s <= 0.0 or joint.name in guessed
    ]
    lacks = [*model.lines_of(model.torque_doubts)]
    if slow:
        lacks.append(f"no velocity limit of {', '.join(slow[:4])}{' …' * (len(slow) > 4)}")
    if not lacks:
        return ""
    return f"expected limits of its joints' torque and speed, which leaps need: {'; '.join(lacks)}"


def _limits_of(leg: Leg, com_m: Array) -> LegLimits:
    """The limits that a leg's joints give: their velocities along the standing leg, all their
    power, its shortest fold.

    Joints without a limit leave the leg without one.

    Arguments:
        com_m: the centre of mass in the base's frame, shape (3,) [m].
    """
    foot, jacobian = (part[0] for part in leg.chain.feet_and_jacobian(leg.stance_rad[None]))
    along = (foot - leg.hip_m) / max(float(np.linalg.norm(foot - leg.hip_m)), 1e-9)
    velocity = np.array([joint.velocity_rad_s for joint in leg.joints])
    power = float(leg.torque_nm @ velocity)
    speed = float(np.abs(along @ jacobian) @ velocity)
    shortest, _ = _lengths(leg)
    return LegLimits(
        hip_m=leg.hip_m - com_m,
        speed_m_s=speed if np.all(velocity > 0.0) else math.inf,
        power_w=power if np.all(velocity > 0.0) and np.all(leg.torque_nm > 0.0) else math.inf,
        fold_m=max(shortest - leg.radius_m, 0.0),
    )


def _lengths(leg: Leg) -> tuple[float, float]:
    """Shortest and longest distance of hip and foot's centre within the joints' limits [m]."""
    lines = [
        np.linspace(low, high, _ANGLES)
        for low, high in zip(leg.lower_rad, leg.upper_rad, strict=True)
    ]
    angles = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(leg.joints))
    lengths = np.linalg.norm(leg.chain.feet(angles) - leg.hip_m, axis=1)
    return float(lengths.min()), float(lengths.max())


def _with_limits(robot: Robot, keys: Mapping[str, LegKeys]) -> Robot:
    model = robot.own_model()
    limits = [_limits_of(leg, model.com_m) for leg in model.legs]
    limbs = tuple(
        replace(limb, leg=each, reach_m=_lengths(leg)[1] + leg.radius_m)
        for limb, each, leg in zip(robot.limbs, limits, model.legs, strict=True)
    )
    return _corrected(replace(robot, limbs=limbs), keys)


def _corrected(robot: Robot, keys: Mapping[str, LegKeys]) -> Robot:
    """The robot with the limits that its file says.

    Raises InvalidInput for a leg that it does not have.
    """
    limbs = {limb.name: limb for limb in robot.limbs}
    for pattern, keys_of_leg in keys.items():
        for name in matching(pattern, limbs, f"robot {robot.name}: legs"):
            leg = limbs[name].leg
            assert leg is not None
            values = {
                key: value for key, value in keys_of_leg.model_dump().items() if value is not None
            }
            limbs[name] = replace(limbs[name], leg=replace(leg, **values))
    return replace(robot, limbs=tuple(limbs.values()))
