"""A robot from its URDF, as everything that needs more than shoulders and reach sees it: legs,
joints, masses, shapes.

Joints are always meant by name. The order is the file's: legs as their first joints come in it,
joints from the base outward; pinocchio has an order of its own, by name, which stays in
``leg_search``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_name
from ..files.documents import shown
from ..physics import GRAVITY_M_S2
from .contacts import check_contacts, with_balls
from .hulls import with_hulls, with_known_hulls, with_same_hulls
from .inverse_kinematics import REACHED_M, descend
from .leg import FootContact, Leg, Mount, Servo
from .leg_search import Found, Waist, legs_of
from .meshes import (
    Shape,
    disabled_pairs,
    remove_empty_shapes,
    shapes_of,
    solid_shapes,
    unknown_shapes,
)
from .plausibility import (
    Inertias,
    body_doubts,
    foot_doubts,
    inertias_of,
    leg_doubts,
    rest_angles,
    rest_gaps,
    shape_doubts,
    shapeless,
    unknown_doubts,
    wrong_links,
)
from .urdf_reader import (
    GUESSED_RAD_S,
    JointCorrection,
    at_rest,
    built,
    corrected,
    hold,
    limit_doubts,
    matching,
    mend_limits,
    parsed,
    pinocchio,
    remove_root_joint,
    root_doubts,
    speed_doubts,
    turned,
)

if TYPE_CHECKING:
    from .mjcf import Mjcf

_LONG_M = 0.05
"""A part of a leg that is longer than this has a shape, or is said to have none [m]."""
_DROP = 0.75
"""Share of how far below its hip a foot can be, at which it stands."""
_SAMPLES = 4000
_NEAREST = 200
_ALONG = 0.1
"""A joint's axis is along the first of x, y and z that it has more of."""
_EASINGS, _EASING = 100, 0.1
"""Steps towards the middle of the limits, and the longest of one, in halves of them."""
_BACKWARD = 0.2
"""Preference of a knee to the rear, where both ways are as good: all legs then bend alike."""


def standing(leg: Leg) -> Array:
    """The most comfortable posture found with the foot below the leg's hip, shape (n,) [rad].

    The foot is below the joint that swings it fore and aft, at DROP times the depth that it
    reaches. Of the sampled postures whose feet are near, the one nearest the middle of its limits
    is brought there.
    """
    if leg.sole is not None:
        return _standing_flat(leg)
    rest = np.clip(np.zeros(len(leg.joints)), leg.lower_rad, leg.upper_rad)
    turns, places = (each[0] for each in leg.chain.frames(rest[None]))
    hip = places[min(1, len(leg.joints) - 1)]
    axes = np.einsum("nij,nj->ni", turns, leg.chain.axes)
    if hip[1] < 0.0:  # as of its mirror image on the left: the same joints are drawn the same way
        axes = axes * np.array([-1.0, 1.0, -1.0])
    angles = leg.random_angles(_SAMPLES, np.random.default_rng(0))
    backward = np.array([axis[np.argmax(np.abs(axis) > _ALONG)] < 0.0 for axis in axes])
    angles = np.where(backward, leg.lower_rad + leg.upper_rad - angles, angles)
    feet = leg.chain.feet(angles)
    straight = leg.chain.feet(rest[None])[0]
    target = np.array(
        [hip[0], 0.5 * (hip[1] + straight[1]), hip[2] + _DROP * (float(feet[:, 2].min()) - hip[2])]
    )
    near = np.argsort(np.linalg.norm(feet - target, axis=1))[:_NEAREST]
    middle, half = 0.5 * (leg.lower_rad + leg.upper_rad), 0.5 * (leg.upper_rad - leg.lower_rad)
    angles_found, error = descend(leg, np.repeat(target[None], len(near), axis=0), angles[near])
    strain = np.max(
        np.abs(angles_found - middle) / np.maximum(half, 1e-9), axis=1
    ) + 1e3 * np.maximum(error - REACHED_M, 0.0)
    knees = leg.chain.frames(angles_found)[1][:, -1]
    strain = strain + _BACKWARD * (knees[:, 0] - hip[0]) / max(leg.chain.length_m, 1e-9)
    best = np.asarray(angles_found[int(np.argmin(strain))])
    return best if len(best) <= 3 else _eased(leg, best)


def _eased(leg: Leg, angles: Array) -> Array:
    """The posture with the foot of this one whose joints are nearest to the middle of their limits.

    A leg of more than three joints has one by its geometry alone, and not by a draw: legs that are
    each other's mirror images stand as mirror images. min ‖u‖ under f(u) = f(q), linearised.
    """
    middle, half = 0.5 * (leg.lower_rad + leg.upper_rad), 0.5 * (leg.upper_rad - leg.lower_rad)
    target, eased = leg.chain.feet(angles[None]), (angles - middle) / np.maximum(half, 1e-9)
    for _ in range(_EASINGS):
        foot, jacobian = leg.chain.feet_and_jacobian((middle + half * eased)[None])
        free = np.ones(len(eased), dtype=bool)
        for _ in range(2):  # the second time without joints that are held at their limits
            rows = jacobian[0] * half * free
            step = free * (np.linalg.pinv(rows) @ (rows @ eased + (target - foot)[0]) - eased)
            free &= (np.abs(eased) < 1.0) | (step * eased < 0.0)
        eased = np.clip(eased + np.clip(step, -_EASING, _EASING), -1.0, 1.0)
    found, error = descend(leg, target, (middle + half * eased)[None])
    return found[0] if error[0] <= REACHED_M else angles


_BENT_DEPTH = 0.95
"""Share of its greatest depth at which a sole stands: thighs and shanks of one length bend by 0.65
rad."""
_DEPTHS, _STARTS, _SPREAD_RAD = 41, 60, 0.4
"""Depths that are tried for a sole, and postures that it is brought there from, so far from rest."""


def _standing_flat(leg: Leg) -> Array:
    """Posture of a leg with a sole: level, its ankle under the hip, no wider than at rest, the knee a
    little bent, shape (n,) [rad].
    """
    rest = np.clip(np.zeros(len(leg.joints)), leg.lower_rad, leg.upper_rad)
    places, foot = leg.chain.frames(rest[None])[1][0], leg.chain.feet(rest[None])[0]
    hip = places[:3].mean(axis=0)
    off = np.random.default_rng(0).normal(0.0, _SPREAD_RAD, (_STARTS, len(rest)))
    starts = np.clip(rest + off, leg.lower_rad, leg.upper_rad)
    column = np.array([hip[0] + foot[0] - places[-1, 0], foot[1], 0.0])
    targets = np.repeat(column[None], _DEPTHS, axis=0)
    targets[:, 2] = hip[2] + np.linspace(0.5, 1.1, _DEPTHS) * (foot[2] - hip[2])
    reached = np.zeros(_DEPTHS, dtype=np.bool_)
    for start in (rest, *starts[:3]):
        reached |= descend(leg, targets, np.tile(start, (_DEPTHS, 1)))[1] <= REACHED_M
    if not reached.any():
        return rest
    column[2] = hip[2] + _BENT_DEPTH * (targets[reached, 2].min() - hip[2])
    found, error = descend(leg, np.tile(column, (_STARTS, 1)), starts)
    half = np.maximum(0.5 * (leg.upper_rad - leg.lower_rad), 1e-9)
    strain = np.linalg.norm(found / half, axis=1) + 1e3 * np.maximum(error - REACHED_M, 0.0)
    return np.asarray(found[int(np.argmin(strain))])


_MIRROR = np.array([1.0, -1.0, 1.0])
_SAME_M = 1e-3
"""Legs whose feet stand so near to each other's mirror images are these."""


def _mirrored(leg: Leg, other: Leg) -> Array | None:
    """Posture of a leg that is the mirror image of another one, as that stands, shape (n,) [rad];
    None where it is not its image.
    """
    if len(leg.joints) != len(other.joints):
        return None
    mine, theirs = (
        np.einsum(
            "nij,nj->ni", one.chain.frames(np.zeros((1, len(one.joints))))[0][0], one.chain.axes
        )
        for one in (leg, other)
    )
    angles = np.sign(np.vecdot(mine, -_MIRROR * theirs)) * other.stance_rad
    angles = np.clip(angles, leg.lower_rad, leg.upper_rad)
    off = leg.chain.feet(angles[None])[0] - _MIRROR * other.nominal_m
    return angles if float(np.linalg.norm(off)) <= _SAME_M else None


_STANCES = ("standing", "stand", "half_sitting", "home", "default")
"""Postures of an SRDF that are taken for the one in which the robot stands, the first that is
there."""
_ROTOR_S2 = 2e-4
"""A rotor's inertia behind its gears, of joints that a robot's file says nothing of [kg m²], in
units of what holds the robot's weight at a leg's length [Nm]."""
DAMPING_S, _SMALL = 0.04, 0.75
"""Kd / Kp [s] of drives that a robot's file says nothing of; of a robot smaller than this size it is
less, as what falls from a smaller height falls in less time, √(h / g)."""
_IN_SERIES = 2.0
"""Factor on the stiffness of legs with soles: the body is a pendulum upside down over ankle, knee and
hip, which give way one after the other."""
_STRONGEST = 10.0
"""A joint that holds this many times the robot's weight at its leg's length is not believed."""
_SLIDES, _IDLE = "slides, which no world's joints do", "no torque limit or no velocity limit"
_STRAIGHT, _BENT = 0.94, 0.9
"""Shares of the greatest distance from its hip that a foot or an ankle gets to: beyond the first
a leg is straight, and it bends if it gets to the second."""
_KNEE_RAD = 0.6
"""Angle by which the knee of a straight leg is bent."""
_LEG_M = 0.48
"""Length of the links of a leg of a robot whose size is 1 [m]."""
_STANDS = 0.25
"""Share of its length by which a leg's foot is below its hip, where a robot stands."""
IDENTITY_DIGITS = 12
"""Number of digits of a digest in a name."""


_SLOW_RAD_S = 0.1
"""Joints that turn faster meet their dry friction, slower ones a part of it [rad/s]."""


def resisting_nm(damping_nms_rad: Array, friction_nm: Array, rates_rad_s: Array) -> Array:
    """Torque that joints themselves turn against at these speeds [Nm]."""
    slowed = friction_nm * np.tanh(rates_rad_s / _SLOW_RAD_S)
    return np.asarray(damping_nms_rad * rates_rad_s + slowed)


_OF_URDF = ("tree", "built", "inertias")
"""What a model holds that follows from its URDF alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotModel:
    """A legged robot.

    Arguments:
        urdf: text of the URDF, with corrections written into it, so that any parser of it sees this
            robot.
        mass_kg, com_m, inertia_kgm2: of the whole robot in its standing posture: mass [kg], centre
            of mass p_BC in the base's frame, shape (3,) [m], and inertia about it, shape (3, 3) [kg
            m²].
        mounts: place of every link, by name.
        disabled_pairs: links that may touch, from the SRDF.
        guesses, doubts: how its file was read, to be confirmed, and its numbers that are hard to
            believe, one line each.
        gaps: entries that a YAML file has to add before anything can be planned, one line each.
        servo: the drive of every joint of legs that are drawn up; None where a robot's own file
            says what its joints can.
    """

    name: str
    urdf: str
    legs: tuple[Leg, ...]
    mass_kg: float
    com_m: Array
    inertia_kgm2: Array
    shapes: tuple[Shape, ...]
    mounts: Mapping[str, Mount]
    disabled_pairs: frozenset[frozenset[str]] = frozenset()
    guesses: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    gaps: tuple[str, ...] = ()
    servo: Servo | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in _OF_URDF}

    def changed(self, **fields: Any) -> RobotModel:
        """The model with other values of some fields, and with what was parsed and built of the
        same URDF.
        """
        made = replace(self, **fields)
        if made.urdf is self.urdf:
            vars(made).update({name: vars(self)[name] for name in _OF_URDF if name in vars(self)})
        return made

    @cached_property
    def tree(self) -> Element:
        """The URDF as XML, parsed once; who changes it takes a copy."""
        return parsed(self.urdf, self.name)

    @cached_property
    def built(self) -> Any:
        """pinocchio's model of it on a free-flying base, made once; who changes it takes a copy."""
        return built(self.urdf, self.name)

    @cached_property
    def inertias(self) -> Inertias:
        """Mass, centre and principal moments of every link."""
        return inertias_of(self.tree)

    @cached_property
    def link_shapes(self) -> tuple[list[tuple[Shape, Array]], tuple[str, ...]]:
        """The shapes of its links with points whose hulls they are, and what has no shape, one
        line each.

        Meshes that cannot be had have none, and long parts of legs that their file gives no shape.
        """
        solids, missing = list[tuple[Shape, Array]](), dict[str, list[str]]()
        for shape in solid_shapes(self.shapes):
            if shape.points_m is not None:
                solids.append((shape, shape.points_m))
            elif shape.link not in missing.setdefault("link|: no mesh", []):
                missing["link|: no mesh"].append(shape.link)
        feet = {
            leg.foot
            for leg in self.legs
            if np.linalg.norm(self.mounts[leg.foot].origin_m) > _LONG_M
        }
        shaped = {
            (mount.leg, mount.joint)
            for shape, _ in solids
            if shape.link not in feet
            for mount in [self.mounts[shape.link]]
        }
        for i, leg in enumerate(self.legs):
            ends = [*leg.chain.origins[1:], leg.chain.tip_m]
            missing.setdefault("joint|: no shape of what they carry", []).extend(
                leg.joint_names[k]
                for k, end in enumerate(ends)
                if np.linalg.norm(end) > _LONG_M and (i, k) not in shaped
            )
        missing["link|: no shape about its centre of mass"] = shapeless(
            self.inertias, self.shapes, self.mounts
        )
        unread = dict.fromkeys(link for link, _ in unknown_shapes(self.tree))
        missing["link|: a shape that is not known"] = list(unread)
        lines = [(*key.split("|"), names) for key, names in missing.items() if names]
        return solids, tuple(
            f"{kind}{'s' if len(names) > 1 else ''} {', '.join(names)}{why}"
            for kind, why, names in lines
        )

    @property
    def size(self) -> float:
        """Length of the longest leg's links, in those of a dog of ``_LEG_M``."""
        return max(leg.chain.length_m for leg in self.legs) / _LEG_M

    @property
    def leg_names(self) -> tuple[str, ...]:
        """Names of the legs, in the robot's order."""
        return tuple(leg.name for leg in self.legs)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints of all legs, leg by leg, from the base outward."""
        return tuple(name for leg in self.legs for name in leg.joint_names)

    @property
    def digest(self) -> str:
        """SHA-256 of the corrected URDF, the legs and their feet, and the hulls of the meshes that
        it names.
        """
        legs = (f"{leg.name}\0{leg.foot}\0{leg.stance_rad.tolist()}" for leg in self.legs)
        content = hashlib.sha256("\0".join([self.urdf, *legs]).encode())
        for leg in self.legs:
            if leg.contact is not None:
                content.update(
                    f"\0contact\0{leg.contact.point_m.tolist()}\0{leg.contact.radius_m}".encode()
                )
            if leg.sole is not None:
                content.update(f"\0sole\0{leg.sole.points_m.tolist()}".encode())
        for i, shape in enumerate(self.shapes):
            if shape.corners_m is not None:
                for part in (shape.corners_m, *shape.parts_m):
                    content.update(f"\0hull\0{i}\0".encode() + np.ascontiguousarray(part).tobytes())
        return content.hexdigest()

    @property
    def identity(self) -> str:
        """Name and the beginning of the digest: what data sets and envelopes say that they were
        learned for.
        """
        return f"{self.name}-{self.digest[:IDENTITY_DIGITS]}"

    @property
    def stand_height_m(self) -> float:
        """Height of the centre of mass over the ground under its feet, as it stands [m]."""
        grounds = [float(leg.nominal_m[2]) - leg.radius_m for leg in self.legs]
        return float(self.com_m[2]) - float(np.mean(grounds))

    @property
    def unrunnable(self) -> tuple[str, ...]:
        """Why plans and walks of the robot cannot be run as its file is, a line each: joints that
        slide, and passive ones, which only a file of actuators gives something to hold with.
        """
        idle = [
            (joint.name, _IDLE)
            for leg in self.legs
            for joint in leg.joints
            if not joint.slides and (joint.torque_nm <= 0.0 or joint.velocity_rad_s <= 0.0)
        ]
        return self.lines_of([*_sliding(self.legs), *idle])

    def check_known(self) -> None:
        """Raise InvalidInput, in one line, where a person has to say something of the robot before
        it is planned for: what a leg touches with, or which way is up.
        """
        if self.gaps:
            raise InvalidInput(f"robot {self.name}: {self.gaps[0]}")
        check_contacts(self.legs, self.name, self.shapes, self.mounts)

    def leg(self, name: str) -> Leg:
        """The leg of a name.

        Raises InvalidInput for one that is not there.
        """
        for leg in self.legs:
            if leg.name == name:
                return leg
        raise InvalidInput(f"leg: expected one of {', '.join(self.leg_names)}, got {shown(name)}")

    @property
    def drive(self) -> tuple[float, float, float]:
        """Kp [Nm/rad], Kd [Nm s/rad] and the rotor's inertia behind the gears [kg m²] of every
        joint, where no file of actuators says them: the servo's where legs are drawn up, else those
        that such a weight needs.

        The verifier, the runner and the worlds of simulation have them from here.
        """
        if self.servo is not None:
            return self.servo.stiffness_nm_rad, self.servo.damping_nms_rad, self.servo.rotor_kg_m2
        # holds the robot's whole weight at the end of one leg
        carried_nm = self.mass_kg * GRAVITY_M_S2
        carried_nm *= float(np.mean([leg.chain.length_m for leg in self.legs]))
        stiffness = carried_nm * (_IN_SERIES if any(leg.sole for leg in self.legs) else 1.0)
        damping = DAMPING_S * min(self.size / _SMALL, 1.0) ** 0.5 * stiffness
        return stiffness, damping, _ROTOR_S2 * carried_nm

    @cached_property
    def rotors_kg_m2(self) -> Array:
        """The rotors' inertia behind the gears as every joint feels it, shape (J,): what an MJCF
        says, else that of ``drive``.
        """
        told = self._dynamics("armature")
        return np.where(told > 0.0, told, self.drive[2])

    @cached_property
    def resistance(self) -> tuple[Array, Array]:
        """Damping [Nm s/rad] and dry friction [Nm] of the joints themselves, as the file has them,
        shape (J,) each; 0 where it says nothing.
        """
        return self._dynamics("damping"), self._dynamics("friction")

    def _dynamics(self, name: str) -> Array:
        """An attribute of the joints' ``dynamics``, shape (J,); 0 where there is none.

        Raises InvalidInput for one below 0.
        """
        said = {
            joint.get("name", ""): checked(
                _angle(moved.get(name, "0"), f"joint {joint.get('name')}: {name}"),
                f"joint {joint.get('name')}: {name}",
                least=0.0,
            )
            for joint in self.tree.findall("joint")
            if (moved := joint.find("dynamics")) is not None
        }
        return np.array([said.get(joint, 0.0) for joint in self.joint_names])

    @property
    def torque_doubts(self) -> tuple[tuple[str, str], ...]:
        """Joints whose torque limit counts for nothing, by name, and why: there is none, or one
        that none has.

        A servo's limit, which someone says, is believed.
        """
        if self.servo is not None:
            return ()
        return tuple(
            (subject.removeprefix("joint "), text)
            for subject, text in _torque_doubts(self.legs, self.mass_kg)
        )

    @cached_property
    def limit_doubts(self) -> tuple[str, ...]:
        """Joints of legs whose limits were guessed, and why, a line for all of the same."""
        moved = set(self.joint_names)
        return self.lines_of([each for each in limit_doubts(self.tree) if each[0] in moved])

    def lines_of(self, doubts: Sequence[tuple[str, str]]) -> tuple[str, ...]:
        """Doubts on joints, a line for all joints of the same."""
        return tuple(_joined([(f"joint {name}", text) for name, text in doubts]))


def model_of(
    text: str,
    *,
    where: str = "urdf",
    folder: Path | None = Path(),
    packages: Sequence[Path] = (),
    hulls: Mapping[int, Sequence[Array]] | None = None,
    srdf: str = "",
    feet: Mapping[str, str] | Sequence[str] = (),
    contacts: Mapping[str, FootContact] | None = None,
    joints: Mapping[str, JointCorrection] | None = None,
    posture_rad: Mapping[str, float] | None = None,
    name: str = "",
    root_rpy_rad: Sequence[float] = (),
    mjcf: Mjcf | None = None,
) -> RobotModel:
    """The robot of a URDF's text.

    Arguments:
        where: name of the file for messages.
        folder, packages: folders of meshes; folder None to look for none.
        hulls: convex hulls of meshes, each followed by its parts, by the index of their shape, in
            place of their files.
        srdf: text of an SRDF, for pairs of links that may touch and a posture to stand in.
        feet: links that are feet, by the names of their legs or alone; empty to search for them.
        contacts: contact shapes of feet, by leg, foot or pattern, for feet that are not a ball at
            the leg's end.
        joints: corrections, by name or pattern.
        posture_rad: joint angles of the standing robot, by joint or pattern [rad].
        name: name of the robot, in place of the URDF's.
        root_rpy_rad: roll, pitch and yaw of the root in a frame whose z points up, for a root whose
            own z does not [rad].
        mjcf: the MJCF that the text was made of, for what a URDF does not say.

    Raises:
        InvalidInput: in one line, for a file that is no URDF of a robot with legs and masses.
    """
    if mjcf is not None:
        hulls, srdf = mjcf.hulls, srdf or mjcf.srdf
    text = corrected(text.strip("\0 \t\r\n"), joints or {}, where)
    root = parsed(text, where)
    mended, in_degrees = mend_limits(root, where)
    empty, tied = remove_empty_shapes(root), root_doubts(root)
    if remove_root_joint(root) or mended or empty:
        text = ElementTree.tostring(root, encoding="unicode")
    if len(root_rpy_rad):
        text = turned(text, root_rpy_rad, where)
        root = parsed(text, where)
    try:
        shapes, missing = shapes_of(root, folder, packages)
        shapes, broken = (
            with_hulls(shapes) if hulls is None else (with_known_hulls(shapes, hulls), [])
        )
        named = feet if isinstance(feet, Mapping) else {foot: foot for foot in feet}
        model, found, held = _legs(root, text, shapes, named, contacts)
        text = ElementTree.tostring(root, encoding="unicode") if held else text
        legs, guessed, doubted, lacks = found
        guesses = [*held, *guessed]
        rounded, balls = with_balls(root, legs, shapes, _mounts(model, legs, at_rest(model)))
        if balls:
            text, again = rounded, shapes_of(parsed(rounded, where), folder, packages)[0]
            shapes = with_same_hulls(again, shapes)
            guesses.insert(0, f"balls for {', '.join(balls)}")
        _check_mimics(root, legs)
        semantics = parsed(srdf, "srdf") if srdf else None
        moved = {name for leg in legs for name in leg.joint_names}
        gaps = (*lacks, *rest_gaps(root, legs))
        gaps = (*(gap for name, gap in in_degrees.items() if name in moved), *gaps)
        if mjcf is not None:
            guesses, gaps = [*mjcf.guesses, *guesses], (*mjcf.gaps, *gaps)
        legs, more = _stand(legs, posture_rad, semantics)
        mass_kg, com_m, inertia_kgm2, rest = _weighed(model, legs, root)
        called = checked_name(name or model.name, "name")
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}") from None
    mounts = _mounts(model, legs, rest)
    doubts = [*tied, *doubted, *_torque_doubts(legs, mass_kg), *leg_doubts(legs)]
    doubts += [] if mjcf is None else mjcf.doubts_of(moved)
    doubts += [(f"joint {name}", why) for name, why in limit_doubts(root) if name in moved]
    doubts += [*((f"mesh {each}", _not_there(each)) for each in missing), *broken]
    doubts += [(f"joint {name}", text) for name, text in _sliding(legs)]
    unsaid = f"no velocity limit, taken for {GUESSED_RAD_S:g} rad/s, not for leaps"
    doubts += [(f"joint {name}", unsaid) for name in speed_doubts(root) if name in moved]
    inertias = inertias_of(root)
    doubts += [*body_doubts(root, inertias, legs, shapes, mounts), *foot_doubts(inertias, legs)]
    doubts += [*shape_doubts(inertias, legs, shapes, mounts), *unknown_doubts(root)]
    doubts += [(f"link {each}", "a shape of no size, which is left out") for each in empty]
    made = RobotModel(
        name=called,
        urdf=text,
        legs=legs,
        mass_kg=mass_kg,
        com_m=com_m,
        inertia_kgm2=inertia_kgm2,
        shapes=shapes,
        mounts=mounts,
        gaps=gaps,
        disabled_pairs=frozenset() if semantics is None else disabled_pairs(semantics),
        guesses=(*guesses, *more),
        doubts=(*gaps, *_joined(doubts)),
    )
    if not balls:
        vars(made).update(tree=root, built=model, inertias=inertias)
    return made


def _legs(
    root: Element,
    text: str,
    shapes: Sequence[Shape],
    feet: Mapping[str, str],
    contacts: Mapping[str, FootContact] | None,
) -> tuple[Any, Found, list[str]]:
    """The legs of a URDF, in whose tree joints are held that carry two legs, or that no leg has and
    that cannot rest at 0.

    Returns:
        pinocchio's model, the legs, and what was held, one line each.
    """
    order, held = [joint.get("name", "") for joint in root.findall("joint")], list[str]()
    while True:
        model = built(text, "urdf")
        try:
            found = legs_of(model, shapes, order, feet, contacts)
            angles = {} if found[-1] else rest_angles(root, found[0])
            why = "the angle nearest to 0 that it has"
        except Waist as waist:
            angles, why = dict.fromkeys(waist.joints, 0.0), "since two legs hang below it"
        if not angles:
            return model, found, held
        held += [f"joint {name} held at {angle:.3g}, {why}" for name, angle in angles.items()]
        hold(root, angles)
        text = ElementTree.tostring(root, encoding="unicode")


def _check_mimics(root: Element, legs: Sequence[Leg]) -> None:
    of_legs = {name for leg in legs for name in leg.joint_names}
    for joint in root.findall("joint"):
        name, mimic = joint.get("name", ""), joint.find("mimic")
        if name in of_legs and mimic is not None:
            raise InvalidInput(
                f"joint {shown(name)}: expected a joint of its own, it mimics {mimic.get('joint')}"
            )


def _stand(
    legs: tuple[Leg, ...], posture_rad: Mapping[str, float] | None, srdf: Element | None
) -> tuple[tuple[Leg, ...], list[str]]:
    """The legs with the posture that a person or the SRDF says, or a guessed one; and what was
    guessed.
    """
    guesses = list[str]()
    angles, names = dict[str, float](), {name: None for leg in legs for name in leg.joint_names}
    states = (
        {}
        if srdf is None
        else {state.get("name", ""): state for state in srdf.findall("group_state")}
    )
    state = next((states[name] for name in _STANCES if name in states), None)
    if state is not None:
        for joint in state.findall("joint"):
            name, value = joint.get("name", ""), joint.get("value", "")
            if name in names and len(value.split()) <= 1:  # several: of a joint that is no leg's
                angles[name] = _angle(
                    value, f"srdf: group_state {shown(state.get('name'))}: joint {shown(name)}"
                )
        source = state.get("from", f"the SRDF: {state.get('name')}")
        if not all(_below(leg, angles) for leg in legs):
            guesses.append(f"not the posture of {source}, whose feet are not below its hips")
            state, angles = None, {}
        else:
            straight = [leg.name for leg in legs if _unbent(leg, angles)]
            if straight:
                guesses.append(f"knees are bent that are straight in the posture of {source}")
    for pattern, angle in (posture_rad or {}).items():
        angles.update(dict.fromkeys(matching(pattern, names, "posture_rad"), float(angle)))
    stood, unsaid = list[Leg](), list[str]()
    for leg in legs:
        if all(name in angles for name in leg.joint_names):
            stance = np.clip(
                [angles[name] for name in leg.joint_names], leg.lower_rad, leg.upper_rad
            )
        else:
            alike = [each for each in stood if leg.sole is not None and each.name in unsaid]
            image = _mirrored(leg, alike[0]) if alike else None
            stance = standing(leg) if image is None else image
            unsaid.append(leg.name)
        if leg.sole is not None:
            level, error = descend(leg, leg.chain.feet(stance[None]), stance[None])
            stance = level[0] if error[0] <= REACHED_M else stance
        stood.append(replace(leg, stance_rad=stance))
    if unsaid:
        guesses.append(f"posture to stand in, of {', '.join(unsaid)}")
    elif state is not None and not posture_rad:
        guesses.append(f"posture to stand in, from {source}")
    return tuple(stood), guesses


def _below(leg: Leg, angles: Mapping[str, float]) -> bool:
    """Tell whether a leg's foot is below its hip in a posture, as far as that says its angles."""
    if not all(name in angles for name in leg.joint_names):
        return True
    foot = leg.chain.feet(np.array([[angles[name] for name in leg.joint_names]]))[0]
    return float(leg.hip_m[2] - foot[2]) > _STANDS * leg.chain.length_m


def _lengths(leg: Leg, angles: Array) -> Array:
    """Distance of a leg's ankle from its hip, or of its foot where the last joint is its knee, shape
    (K,) [m].

    Arguments:
        angles: shape (K, n), over much of what the joints do.
    """
    ankle = np.linalg.norm(leg.chain.frames(angles)[1][:, -1] - leg.hip_m, axis=1)
    if ankle.min() < _BENT * ankle.max():
        return np.asarray(ankle)
    return np.asarray(np.linalg.norm(leg.chain.feet(angles) - leg.hip_m, axis=1))


def _unbent(leg: Leg, angles: dict[str, float]) -> bool:
    """Tell whether a leg is straight in a posture, and bend its knee if so: the joint that shortens
    it most.
    """
    if not all(name in angles for name in leg.joint_names):
        return False
    stood = np.array([angles[name] for name in leg.joint_names])
    side = np.where(leg.upper_rad - stood > stood - leg.lower_rad, _KNEE_RAD, -_KNEE_RAD)
    tries = np.clip(stood + np.diag(side), leg.lower_rad, leg.upper_rad)
    every = leg.random_angles(_SAMPLES, np.random.default_rng(0))
    far = _lengths(leg, np.concatenate([stood[None], tries, every]))
    if far[0] < _STRAIGHT * far.max():
        return False
    bent = tries[int(np.argmin(far[1 : 1 + len(tries)]))][None]
    straight, foot = (leg.chain.feet(each) - leg.hip_m for each in (stood[None], bent))
    down = straight * (np.linalg.norm(foot) / np.linalg.norm(straight))
    bent = descend(leg, leg.hip_m + down, bent)[0]
    angles |= dict(zip(leg.joint_names, bent[0].tolist(), strict=True))
    return True


def _angle(text: str, where: str) -> float:
    """A joint's value in an SRDF.

    Raises InvalidInput for anything but one finite number.
    """
    try:
        return checked(float(text), where)
    except ValueError:  # InvalidInput is one
        raise InvalidInput(f"{where}: expected a number, got {shown(text)}") from None


def _weighed(model: Any, legs: Sequence[Leg], root: Element) -> tuple[float, Array, Array, Array]:
    """Mass, centre and inertia in the standing posture; and that posture as pinocchio has it, base
    at the origin.
    """
    pin = pinocchio()
    data, rest = model.createData(), at_rest(model)
    for leg in legs:
        for name, angle in zip(leg.joint_names, leg.stance_rad, strict=True):
            joint = model.joints[model.getJointId(name)]
            rest[joint.idx_q : joint.idx_q + joint.nq] = (
                angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
            )
    pin.ccrba(model, data, rest, np.zeros(model.nv))
    mass, inertia, com = float(data.Ig.mass), np.array(data.Ig.inertia), np.array(data.com[0])
    sound = bool(np.isfinite([mass, *com, *inertia.ravel()]).all())
    if not sound or not mass > 0.0 or not np.linalg.eigvalsh(inertia)[0] > 0.0:
        wrong = wrong_links(inertias_of(root))
        raise InvalidInput(
            f"expected links with mass and inertia, got {mass:g} kg in "
            f"all{wrong and ': '}{wrong:.300}"
        )
    return mass, com, 0.5 * (inertia + inertia.T), rest


def _mounts(model: Any, legs: Sequence[Leg], rest: Array) -> dict[str, Mount]:
    """Mount of each link: the body that carries it."""
    pin = pinocchio()
    data = model.createData()
    pin.framesForwardKinematics(model, data, rest)
    carriers = {
        name: (i, k) for i, leg in enumerate(legs) for k, name in enumerate(leg.joint_names)
    }
    mounts = dict[str, Mount]()
    for number, frame in enumerate(model.frames):
        if frame.type != pin.FrameType.BODY:
            continue
        leg, joint = carriers.get(model.names[frame.parentJoint], (None, -1))
        place = frame.placement if leg is not None else data.oMf[number]
        mounts[frame.name] = Mount(
            leg=leg,
            joint=joint,
            rotation=np.array(place.rotation),
            origin_m=np.array(place.translation),
        )
    return mounts


def _not_there(mesh: str) -> str:
    """Message about a mesh that is missing."""
    hint = (
        "; a YAML file's packages: say where package:// leads"
        if mesh.startswith("package:")
        else ""
    )
    return f"no such file, not drawn{hint}"


def _joined(doubts: Sequence[tuple[str, str]]) -> list[str]:
    """One line a doubt, whatever number of joints, links or meshes it is of."""
    subjects = dict[str, list[str]]()
    for subject, text in doubts:
        subjects.setdefault(f"{subject.partition(' ')[0]}\0{text}", []).append(
            subject.partition(" ")[2]
        )
    lines = []
    for key, names in subjects.items():
        kind, _, text = key.partition("\0")
        plural = "es" if kind == "mesh" else "s"
        lines.append(f"{kind}{plural if len(names) > 1 else ''} {', '.join(names)}: {text}")
    return lines


def _sliding(legs: Sequence[Leg]) -> list[tuple[str, str]]:
    """Joints that slide, by name, and what that means."""
    return [(joint.name, _SLIDES) for leg in legs for joint in leg.joints if joint.slides]


def _torque_doubts(legs: Sequence[Leg], mass_kg: float) -> list[tuple[str, str]]:
    """Torque limits that are not said, or that no joint of such a robot has."""
    doubts = []
    for leg in legs:
        most = _STRONGEST * mass_kg * GRAVITY_M_S2 * leg.chain.length_m
        for joint in leg.joints:
            if joint.torque_nm <= 0.0:
                doubts.append(
                    (f"joint {joint.name}", f"no {'force' if joint.slides else 'torque'} limit")
                )
            elif not joint.slides and joint.torque_nm > most:
                doubts.append((f"joint {joint.name}", f"a torque limit of {joint.torque_nm:g} Nm"))
    return doubts
