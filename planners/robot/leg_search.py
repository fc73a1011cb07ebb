"""Where a robot's legs are: chains of joints under the base that reach lower than the others.

Nothing has to be said of a usual robot. One chain is looked at for each child of the base, the one with most joints; a
leg is a chain whose feet go below LOW times what the lowest chain's do (arms and heads do not); its foot is the link
at its end that is called so, or else the farthest. What is found in this way is a guess, and is marked as one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.validation import shown
from .chain import Chain
from .leg import FULL_TURN, Joint, Leg
from .shapes import Shape
from .urdf_reader import base_joint, pinocchio

LOW = 0.6
"""Of the lowest chain's depth below the base: what goes lower is a leg."""
SAMPLES = 3000
"""Postures by which a chain's depth is measured."""
FOOT = re.compile("foot|toe|sole|ankle", re.IGNORECASE)
SENSOR = re.compile("imu|sensor|fsr|camera", re.IGNORECASE)
JOINT_WORD = re.compile("_j(oin)?t?$", re.IGNORECASE)
NEAR = 0.3
"""A link that is called a foot has to be this share of the farthest link's distance away from its joint."""
APART = 0.2
"""Two ends of one chain that are farther apart than this share of its length are two feet."""
SHORTEST_M = 0.02
MOST_JOINTS = 24
"""Of a leg."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """Legs, what of them was guessed, a line each, and what is hard to believe: of which joint or link, and what."""

    legs: tuple[Leg, ...]
    guesses: tuple[str, ...]
    doubts: tuple[tuple[str, str], ...]


def legs_of(model: Any, shapes: Sequence[Shape], order: Sequence[str], feet: Mapping[str, str]) -> Found:
    """The legs of pinocchio's model of a URDF.

    order: names of its joints as the file has them, which is the order of the legs. feet: links that are feet, by the
    name of their leg; empty to look for them. Raises InvalidInput where there are no legs, for two feet on one leg, and
    for a leg with joints that have more than one angle.
    """
    tree = _Tree(model, shapes)
    guesses = list[str]()
    if feet:
        ends = {name: tree.end_at(foot) for name, foot in feet.items()}
        _check_apart(ends)
    else:
        lowest = tree.lowest_chains()
        lowest.sort(key=lambda end: order.index(model.names[end.joints[0]]))
        ends = dict(zip(_names(lowest), lowest, strict=True))
        said = ", ".join(f"{name} ({end.foot})" for name, end in ends.items())
        guesses.append(f"legs and feet, by their shape and names: {said}")
    tree.doubts.clear()  # of chains that are no legs
    legs = tuple(tree.leg(name, end) for name, end in ends.items())
    return Found(legs=legs, guesses=tuple(guesses), doubts=tuple(tree.doubts))


@dataclass(frozen=True, kw_only=True, eq=False)
class _End:
    """The end of a chain: its joints from the base outward (pinocchio's numbers), and the link that may be a foot."""

    joints: tuple[int, ...]
    foot: str
    tip_m: Array
    names: tuple[str, ...]


class _Tree:
    """The chains of one model."""

    def __init__(self, model: Any, shapes: Sequence[Shape]) -> None:
        self._model, self._shapes = model, shapes
        self.doubts = list[tuple[str, str]]()
        pin = pinocchio()
        self._bodies = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
        self._base = base_joint(model)
        data = model.createData()
        pin.computeJointJacobians(model, data, pin.neutral(model))
        local = [pin.getJointJacobian(model, data, j, pin.ReferenceFrame.LOCAL) for j in range(model.njoints)]
        self._twists = {j: local[j][:, model.joints[j].idx_v] for j in range(self._base + 1, model.njoints)}
        base = data.oMi[self._base]
        self._in_base = [base.actInv(data.oMi[j]) for j in range(model.njoints)]

    def lowest_chains(self) -> list[_End]:
        """Those that are legs. Raises InvalidInput where there are none."""
        parents = list(self._model.parents)
        leaves = [j for j in range(self._base + 1, len(parents)) if j not in parents]
        ends = [self._end(self._support(leaf)) for leaf in leaves if self._base in self._model.supports[leaf]]
        ends = [end for end in ends if 2 <= len(end.joints) <= MOST_JOINTS and self._simple(end)]
        ends = [end for end in ends if self._length(end) > SHORTEST_M]
        if not ends:
            raise InvalidInput("legs: expected chains of two joints or more under the base, found none")
        depth = {end: self._depth(end) for end in ends}
        legs = [end for end in ends if depth[end] < LOW * min(depth.values())]
        chains = dict[int, list[_End]]()
        for end in legs:
            chains.setdefault(end.joints[0], []).append(end)
        branched = {first for first, each in chains.items() if self._second(each) is not None}
        alone = [self._longest(each) for first, each in chains.items() if first not in branched]
        if len(alone) < 2 and branched:  # or else what branches is a trunk with arms
            first = min(branched)
            best, other = self._longest(chains[first]), self._second(chains[first])
            raise InvalidInput(
                f"legs: expected one foot a leg, joint {shown(best.names[0])} carries {best.foot} and "
                f"{other.foot if other else '?'}"
            )
        return alone

    def end_at(self, foot: str) -> _End:
        """The chain that ends in a link. Raises InvalidInput where there is no such link, or no joint before it."""
        frame = next((frame for frame in self._bodies if frame.name == foot), None)
        if frame is None:
            known = ", ".join(each.name for each in self._bodies[:12])
            raise InvalidInput(f"feet: expected a link ({known}, …), found none that is called {shown(foot)}")
        joints = self._support(frame.parentJoint)
        if not joints:
            raise InvalidInput(f"feet: expected joints between the base and {shown(foot)}, all of them are fixed")
        return _End(
            joints=joints, foot=foot, tip_m=frame.placement.translation.copy(),
            names=tuple(self._model.names[j] for j in joints),
        )  # fmt: skip

    def leg(self, name: str, end: _End) -> Leg:
        """The leg of a chain's end; its stance is the middle of its limits. Raises InvalidInput for joints of more
        than one angle."""
        if not self._simple(end):
            wrong = next(j for j in end.joints if self._model.joints[j].nv != 1)
            raise InvalidInput(f"joint {shown(self._model.names[wrong])}: expected one angle, it has more")
        if len(end.joints) > MOST_JOINTS:
            raise InvalidInput(f"leg {shown(name)}: expected {MOST_JOINTS} joints or fewer, got {len(end.joints)}")
        tip, radius = self._contact(end)
        chain = self._chain(end, tip)
        joints = tuple(self._joint(j) for j in end.joints)
        middle = np.array([0.5 * (joint.lower_rad + joint.upper_rad) for joint in joints])
        return Leg(name=name, joints=joints, chain=chain, foot=end.foot, radius_m=radius, stance_rad=middle)

    def _support(self, joint: int) -> tuple[int, ...]:
        return tuple(j for j in self._model.supports[joint] if j > self._base)

    def _simple(self, end: _End) -> bool:
        return all(self._model.joints[j].nv == 1 for j in end.joints)

    def _length(self, end: _End) -> float:
        places = [self._model.jointPlacements[j].translation for j in end.joints[1:]]
        return float(sum(np.linalg.norm(place) for place in places) + np.linalg.norm(end.tip_m))

    def _end(self, joints: tuple[int, ...]) -> _End:
        """The end of a chain of joints: the link at its last one that is called a foot, or the farthest."""
        links = [frame for frame in self._bodies if frame.parentJoint == joints[-1]]
        far = {frame.name: float(np.linalg.norm(frame.placement.translation)) for frame in links}
        links = [frame for frame in links if not SENSOR.search(frame.name)] or links
        most = max(far[frame.name] for frame in links)
        called = [frame for frame in links if FOOT.search(frame.name) and far[frame.name] >= NEAR * most]
        foot = max(called or links, key=lambda frame: far[frame.name])
        return _End(
            joints=joints, foot=foot.name, tip_m=foot.placement.translation.copy(),
            names=tuple(self._model.names[j] for j in joints),
        )  # fmt: skip

    def _depth(self, end: _End) -> float:
        """How low the chain's end goes, from the base's origin or from its lowest hip, whichever is higher [m]."""
        leg = self.leg("", end)
        feet = leg.chain.feet(leg.random_angles(SAMPLES, np.random.default_rng(0)))
        return float(feet[:, 2].min()) - max(0.0, min(float(self._in_base[j].translation[2]) for j in self._firsts()))

    def _firsts(self) -> list[int]:
        return [j for j in range(self._base + 1, self._model.njoints) if self._model.parents[j] == self._base]

    def _longest(self, ends: list[_End]) -> _End:
        """Of the ends of one child of the base."""
        return max(ends, key=lambda end: (len(end.joints), self._length(end)))

    def _second(self, ends: list[_End]) -> _End | None:
        """A second foot beside the longest chain's, where one child of the base has two: fingers and heels are none."""
        best = self._longest(ends)
        place = self._at_zero(best)
        for end in ends:
            own = len(set(end.joints) - set(best.joints))
            if own > 1 and float(np.linalg.norm(self._at_zero(end) - place)) > APART * self._length(best):
                return end
        return None

    def _at_zero(self, end: _End) -> Array:
        return np.asarray(self._chain(end, end.tip_m).feet(np.zeros((1, len(end.joints))))[0])

    def _chain(self, end: _End, tip: Array) -> Chain:
        model, joints = self._model, end.joints
        twists = [self._twists[j] for j in joints]
        slides = np.array([np.linalg.norm(twist[3:]) < 0.5 for twist in twists])
        first = self._in_base[joints[0]]
        places = [first, *(model.jointPlacements[j] for j in joints[1:])]
        return Chain(
            rotations=np.array([place.rotation for place in places]),
            origins=np.array([place.translation for place in places]),
            axes=np.array([twist[:3] if flat else twist[3:] for twist, flat in zip(twists, slides, strict=True)]),
            slides=slides,
            tip_m=tip,
        )

    def _joint(self, j: int) -> Joint:
        """A joint's limits, a whole turn where it has none."""
        model, name = self._model, str(self._model.names[j])
        column, row = model.joints[j].idx_q, model.joints[j].idx_v
        lower, upper = float(model.lowerPositionLimit[column]), float(model.upperPositionLimit[column])
        slides = bool(np.linalg.norm(self._twists[j][3:]) < 0.5)
        if slides and not lower < upper:
            raise InvalidInput(
                f"joint {shown(name)}: expected a lower limit below the upper one, got {lower:g}, {upper:g}"
            )
        if not slides and (model.joints[j].nq == 2 or not lower < upper or upper - lower > FULL_TURN):
            inside = lower <= -np.pi and upper >= np.pi
            lower = -np.pi if inside or model.joints[j].nq == 2 or not lower < upper else lower
            upper = lower + 2.0 * np.pi
            self.doubts.append((f"joint {name}", "turns freely, its limits are a whole turn apart or more"))
        torque, velocity = float(model.effortLimit[row]), float(model.velocityLimit[row])
        return Joint(
            name=name, lower_rad=lower, upper_rad=upper, slides=slides,
            torque_nm=torque if np.isfinite(torque) else 0.0, velocity_rad_s=velocity if np.isfinite(velocity) else 0.0,
        )  # fmt: skip

    def _contact(self, end: _End) -> tuple[Array, float]:
        """The foot's centre in the last joint's frame, shape (3,) [m], and its radius [m]."""
        frame = next(frame for frame in self._bodies if frame.name == end.foot)
        own = [shape for shape in self._shapes if shape.collides and shape.link == end.foot]
        turn, place = frame.placement.rotation, frame.placement.translation
        balls = [shape for shape in own if shape.kind == "sphere"]
        if balls:
            return np.asarray(place + turn @ balls[0].origin_m), float(balls[0].size_m[0])
        if np.linalg.norm(end.tip_m) > SHORTEST_M:
            return np.array(place), 0.0
        ends = [place + turn @ shape.far_m for shape in own]
        ends = ends or [2.0 * self._model.inertias[end.joints[-1]].lever]
        tip = max(ends, key=lambda point: float(np.linalg.norm(point)))
        self.doubts.append((f"link {end.foot}", "has no link for its foot, its farthest end is taken for it"))
        return np.asarray(tip), 0.0


def _check_apart(ends: Mapping[str, _End]) -> None:
    seen = dict[int, _End]()
    for end in ends.values():
        for joint, name in zip(end.joints, end.names, strict=True):
            if joint in seen:
                raise InvalidInput(
                    f"feet: expected one foot a leg, joint {shown(name)} carries {seen[joint].foot} and {end.foot}"
                )
            seen[joint] = end


def _names(ends: Sequence[_End]) -> list[str]:
    """A leg's name is what its joints' names begin with, or end with, or its foot's."""
    for guess in (_beginning, _ending, lambda end: end.foot):
        found = [guess(end) for end in ends]
        if all(found) and len(set(found)) == len(found):
            return found
    return [f"leg{i + 1}" for i in range(len(ends))]


def _beginning(end: _End) -> str:
    return _shared(end.names).rstrip("_-. ")


def _ending(end: _End) -> str:
    return _shared([JOINT_WORD.sub("", name)[::-1] for name in end.names])[::-1].strip("_-. ")


def _shared(names: Sequence[str]) -> str:
    """What all names begin with."""
    same = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    return "".join(letters[0] for letters in same)
