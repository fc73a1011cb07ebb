"""Numbers of a robot's file that no robot has: doubts, a line each, that name the link.

A body's principal moments a ≤ b ≤ c are at least 0, c ≤ a + b, and c ≤ m R² where all of it is
within R of its centre of mass. A robot with a trunk that weighs nothing, or feet that do, is one
whose masses were forgotten.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from xml.etree.ElementTree import Element

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.documents import shown
from .leg import Leg, Mount
from .meshes import Shape, link_points, pose_of, unknown_shapes
from .urdf_reader import number_in

Inertias = Mapping[str, tuple[float, Array, Array]]
"""By link: ``link_inertia``."""
_Doubt = tuple[str, str]
"""Of what, e.g. ``link trunk``, and what is hard to believe of it."""
_ROUNDED, _ROUNDED_KGM2 = 0.05, 4e-6
"""By how much rounding may break the triangle's inequality: as a share of the largest moment, and
in all [kg m²].

A placeholder, 1e-6 in all six entries of a frame that weighs nothing, has a largest moment of
3e-6."""
_SLIGHT = 1e-3
"""A moment of this share of M L², M the robot's mass and L its leg, changes nothing: a sensor's
frame with a placeholder, or with moments that no body has."""
_FAR = 10.0
"""A moment of this many times m R² is one in other units."""
_NO_SHAPE = "no shape about its centre of mass"
_VAST = 20.0
"""A shape of so many lengths of a leg is in other units."""
_LEAST_SHARE = 0.01
"""Share of the robot's mass that its trunk has at least; a link with as much has moments of inertia."""
_SHAPED_SHARE = 0.05
"""A link of the trunk with this share of the robot's mass has a shape of its own, or lies in one."""
_OSMIUM_KG_M3 = 22_590.0
"""Density that no body exceeds."""
_KNOWN = {
    "link": "inertial visual collision contact collision_checking gravity kinematic self_filter",
    "joint": "origin parent child axis limit dynamics mimic calibration safety_controller joint_properties",
}
"""Elements of links and joints, those among them that simulators have added."""
_SMALLEST_M, _LARGEST_M = 0.02, 5.0
"""Lengths of legs between which robots are."""
BETWEEN = "between"
"""Attribute of a link that is there to have two joints at one place, and need not weigh anything."""
_CLOSED = 0.07
"""Two legs whose feet are so near to each other, as a share of their length, hold one foot."""
_UPWARD = 0.25
"""A leg whose foot is on average this share of its length above its hip points up."""
_SAMPLES = 500
_REST = 0.05
"""A joint that no leg has rests at 0; its limits may be so far from that [rad or m]."""


def link_inertia(link: Element) -> tuple[float, Array, Array]:
    """Mass [kg], centre in the link, shape (3,) [m], and principal moments, shape (3,) [kg m²],
    zeros for a link without. Raises InvalidInput for what is no number.
    """
    where = f"link {shown(link.get('name', ''))}"
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0, np.zeros(3), np.zeros(3)
    mass = number_in(inertial.find("mass"), "value", where)
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    entries = [number_in(inertial.find("inertia"), name, where) for name in names]
    if not np.isfinite([mass, *entries]).all():
        raise InvalidInput(
            f"{where}: expected a finite mass and finite moments of inertia, got something else"
        )
    xx, xy, xz, yy, yz, zz = entries
    moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return mass, pose_of(inertial.find("origin"), where)[1], moments


def inertias_of(root: Element) -> Inertias:
    """Mass, centre and principal moments of every link.

    Raises InvalidInput as ``link_inertia`` does.
    """
    return {link.get("name", ""): link_inertia(link) for link in root.findall("link")}


def body_doubts(
    root: Element,
    inertias: Inertias,
    legs: Sequence[Leg],
    shapes: Sequence[Shape],
    mounts: Mapping[str, Mount],
) -> Iterator[_Doubt]:
    """Doubts about the masses of a robot's links."""
    reach = max((leg.chain.length_m for leg in legs), default=1.0)
    masses = dict[tuple[int | None, int], float]()
    slight = _SLIGHT * sum(mass for mass, *_ in inertias.values()) * reach**2
    for name, (mass, centre, moments) in inertias.items():
        if (mount := mounts.get(name)) is not None:
            masses[mount.leg, mount.joint] = masses.get((mount.leg, mount.joint), 0.0) + mass
        if why := _inertia_doubt(mass, moments, _size_m(name, centre, shapes, reach), slight):
            yield f"link {name}", why
    total = sum(masses.values())
    between = {link.get("name") for link in root.findall("link") if link.get(BETWEEN)}
    if masses.get((None, -1), 0.0) < _LEAST_SHARE * total:
        yield f"link {_first(mounts, None, -1)}", "the trunk weighs nothing, or next to nothing"
    for i, leg in enumerate(legs):
        for k in range(len(leg.joints)):
            name = leg.foot if k == len(leg.joints) - 1 else _first(mounts, i, k)
            if masses.get((i, k), 0.0) <= 0.0 and name not in between:
                yield f"link {name}", "weighs nothing"


def foot_doubts(inertias: Inertias, legs: Sequence[Leg]) -> Iterator[_Doubt]:
    """Links that are feet and have no mass of their own."""
    for leg in legs:
        if leg.foot not in inertias or inertias[leg.foot][0] <= 0.0:
            yield f"link {leg.foot}", "a foot without a mass"


def unknown_doubts(root: Element) -> Iterator[_Doubt]:
    """Unknown elements of links and joints, and shapes of no kind that is known."""
    for kind, known in _KNOWN.items():
        for element in root.findall(kind):
            for tag in dict.fromkeys(child.tag for child in element if isinstance(child.tag, str)):
                if tag not in known.split():
                    yield (
                        f"{kind} {element.get('name')}",
                        f"<{tag}>, which is not known, is left out",
                    )
    for link, shape in unknown_shapes(root):
        yield f"link {link}", f"a shape of {shape}, which is not known, is left out"


def shape_doubts(
    inertias: Inertias, legs: Sequence[Leg], shapes: Sequence[Shape], mounts: Mapping[str, Mount]
) -> Iterator[_Doubt]:
    """Doubts that keep nothing from being simulated: a trunk without a shape, shapes in other
    units, and a moment of inertia of 0 beside others.
    """
    reach = max((leg.chain.length_m for leg in legs), default=1.0)
    for name in shapeless(inertias, shapes, mounts):
        yield f"link {name}", _NO_SHAPE
    for shape in shapes:
        size = 0.0 if shape.points_m is None else float(np.ptp(shape.points_m, axis=0).max())
        if size > _VAST * reach:
            yield f"link {shape.link}", f"a shape of {size:.3g} m: other units?"
    total = sum(mass for mass, *_ in inertias.values())
    for link, (mass, _, (small, middle, large)) in inertias.items():
        densest = 0.4 * mass * (0.75 * max(mass, 0.0) / (np.pi * _OSMIUM_KG_M3)) ** (2 / 3)
        if large < 0.1 * densest and mass > _LEAST_SHARE * total:
            yield (
                f"link {link}",
                f"a moment of inertia of {large:.3g} kg m² of {mass:.3g} kg: denser than any body",
            )
        flat = large > middle + _ROUNDED * large  # a rod has two moments that are the same
        if mass > 0.0 and small <= 0.0 and large > _ROUNDED_KGM2 and flat:
            yield (
                f"link {link}",
                f"a moment of inertia of {small:.3g} kg m² beside others",
            )


def impossible(mass_kg: float, moments: Array) -> str:
    """Why no body has this mass and these principal moments, in order, shape (3,) [kg m²]; empty
    where one may.
    """
    small, middle, large = (float(moment) for moment in moments)
    room = max(_ROUNDED * abs(large), _ROUNDED_KGM2)
    if mass_kg < 0.0:
        return f"a mass of {mass_kg:g} kg"
    if small < -room:
        return f"a moment of inertia of {small:.3g} kg m²"
    if large > small + middle + room:
        return f"moments of inertia that no body has, {large:.3g} kg m² beside {small:.3g} and {middle:.3g}"
    return ""


def _inertia_doubt(mass: float, moments: Array, size_m: float, slight: float) -> str:
    why = impossible(mass, moments)
    if why and not (mass >= 0.0 and moments[0] >= -_ROUNDED_KGM2 and moments[2] <= slight):
        return why
    if mass > 0.0 and moments[2] > max(_FAR * mass * size_m**2 + _ROUNDED_KGM2, slight):
        return f"a moment of inertia of {moments[2]:.3g} kg m², of {mass:.3g} kg within {size_m:.2g} m: other units?"
    return ""


def _size_m(name: str, centre: Array, shapes: Sequence[Shape], reach_m: float) -> float:
    """Extent of a link from its centre of mass; where it has no shape, as far as a leg [m]."""
    own = [shape for shape in shapes if shape.link == name]
    points = [each for each in map(link_points, own) if each is not None]
    if not points:
        return reach_m
    return float(np.linalg.norm(np.vstack(points) - centre, axis=1).max())


def shapeless(
    inertias: Inertias, shapes: Sequence[Shape], mounts: Mapping[str, Mount]
) -> list[str]:
    """Links of the trunk that nothing can touch: the first where none has a shape, or those of some
    weight whose centre is in no other link's.
    """
    solid = [shape for shape in shapes if (at := mounts.get(shape.link)) and at.leg is None]
    if not solid:
        return [_first(mounts, None, -1)]
    least = _SHAPED_SHARE * sum(mass for mass, *_ in inertias.values())
    heavy = [name for name, (mass, *_) in inertias.items() if mass > least and name in mounts]
    return [
        name
        for name in heavy
        if mounts[name].leg is None
        for place in [mounts[name].placed(inertias[name][1])]
        if not any(_within(shape, mounts[shape.link], place) for shape in solid)
    ]


def _within(shape: Shape, mount: Mount, place: Array) -> bool:
    """Tell whether a place is in the box about a shape, or may be: a mesh that is not there."""
    points = link_points(shape)
    if points is None:
        return True
    corners = mount.placed(points)
    return bool(np.all((corners.min(axis=0) <= place) & (place <= corners.max(axis=0))))


def _first(mounts: Mapping[str, Mount], leg: int | None, joint: int) -> str:
    """A link that a joint, or none, carries."""
    return next(
        (name for name, mount in mounts.items() if (mount.leg, mount.joint) == (leg, joint)), "?"
    )


def wrong_links(inertias: Inertias) -> str:
    """The links whose mass or inertia no body has, and why, in one line; empty where there is
    none.
    """
    whys = [(name, impossible(mass, moments)) for name, (mass, _, moments) in inertias.items()]
    return "; ".join(f"link {shown(name)}: {why}" for name, why in whys if why)


def leg_doubts(legs: Sequence[Leg]) -> Iterator[_Doubt]:
    """Legs that are longer or shorter than robots', which are in other units, and those that end at
    one place.
    """
    for leg in legs:
        if not _SMALLEST_M <= leg.chain.length_m <= _LARGEST_M:
            yield f"link {leg.foot}", f"a leg of {leg.chain.length_m:.3g} m: other units?"
    for one, two in combinations(legs, 2):
        apart, before = (
            float(np.linalg.norm(getattr(one, place) - getattr(two, place)))
            for place in ("nominal_m", "hip_m")
        )
        if apart < min(before, _CLOSED * one.chain.length_m):
            yield (
                f"link {one.foot}",
                f"ends where {two.foot} does: a closed chain, which no URDF has?",
            )


def rest_angles(root: Element, legs: Sequence[Leg]) -> dict[str, float]:
    """Angles at which joints rest that no leg has and that cannot rest at 0: at the limit that is
    nearest to 0, or at their offset from a joint that they follow [rad, or m where they slide].
    """
    of_legs = {name for leg in legs for name in leg.joint_names}
    angles = dict[str, float]()
    for joint in root.findall("joint"):
        name, kind, limit = joint.get("name", ""), joint.get("type"), joint.find("limit")
        where, mimic = f"joint {name}", joint.find("mimic")
        if name in of_legs or kind == "fixed":
            continue
        if mimic is not None:
            rest = number_in(mimic, "offset", f"{where}: mimic")
        elif limit is not None and kind in ("revolute", "prismatic"):
            low, high = (number_in(limit, key, where) for key in ("lower", "upper"))
            rest = min(max(0.0, low), high)
        else:
            continue
        if abs(rest) > _REST and (mimic is None or mimic.get("joint") not in of_legs):
            angles[name] = rest
    return angles


def rest_gaps(root: Element, legs: Sequence[Leg]) -> Iterator[str]:
    """Points to settle of the joints that no leg has: those that follow a joint of a leg."""
    of_legs = {name for leg in legs for name in leg.joint_names}
    mimics = {
        joint.get("name", ""): mimic
        for joint in root.findall("joint")
        if joint.get("type") != "fixed" and (mimic := joint.find("mimic")) is not None
    }
    for name in mimics:
        if name not in of_legs:
            leader = _leader(name, mimics)
            if leader in of_legs or leader in mimics:
                yield (
                    f"joint {name}: expected a joint of its own or a fixed one, got one that follows "
                    f"{leader}"
                )


def _leader(name: str, mimics: Mapping[str, Element]) -> str:
    """The joint that one follows in the end."""
    seen = [name]
    while (mimic := mimics.get(seen[-1])) is not None and (
        further := mimic.get("joint", "")
    ) not in seen:
        seen.append(further)
    return seen[-1]


def points_up(leg: Leg) -> bool:
    """Tell whether a leg's foot is mostly above its hip."""
    feet = leg.chain.feet(leg.random_angles(_SAMPLES, np.random.default_rng(0)))
    return float(feet[:, 2].mean() - leg.hip_m[2]) > _UPWARD * leg.chain.length_m
