"""Legs of a robot: chains of joints under the base that reach lower than the others.

Nothing has to be said of a usual robot. One chain is looked at for each child of the base, the one
with most joints; a leg is a chain whose feet go below LOW times what the lowest chain's do (arms
and heads do not); its foot is the link at its end that is called so, or else the farthest. What is
found in this way is a guess, and is marked as one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.documents import shown
from .contacts import Fits, Touch, is_wheel, placed_shapes, sole_of, touch_of
from .leg import FULL_TURN, Chain, FootContact, FootSole, Joint, Leg
from .meshes import Shape
from .plausibility import points_up
from .urdf_reader import base_joint, matching, pinocchio

_LOW = 0.6
"""Share of the lowest chain's depth below the base: what goes lower is a leg."""
_SAMPLES = 3000
"""Postures by which a chain's depth is measured."""
FOOT = re.compile("foot|toe|sole|ankle", re.IGNORECASE)
_SENSOR = re.compile("imu|sensor|fsr|camera", re.IGNORECASE)
ARM = re.compile("arm|grip|hand|finger|wrist|manip|head|neck|tail", re.IGNORECASE)
_LEG = re.compile(
    "leg|hip|thigh|knee|calf|shank|foot|toe|ankle|h[af]e|haa|kfe|coxa|femur|tibia", re.IGNORECASE
)
_ALIKE = 0.05
"""Share of their length by which two chains that are made alike may differ."""
_JOINT_WORD = re.compile("_j(oin)?t?$", re.IGNORECASE)
_NEAR = 0.3
"""A link that is called a foot has to be this share of the farthest link's distance away from its
joint."""
_APART = 0.2
"""Two ends of one chain that are farther apart than this share of its length are two feet."""
_WHOLE_LEG = 3
"""Joints of a leg of its own, at least: what hangs below a waist."""
_LEVEL = 5
"""Joints of a leg that keeps a sole level somewhere, at least."""
_SHORTEST_M = 0.02
_MOST_JOINTS = 24
"""Most joints of a leg."""


class Waist(InvalidInput):
    """Two legs hang below the same joints.

    Arguments:
        joints: names of these joints, from the base outward.
        feet: what the two legs end in.
    """

    def __init__(self, joints: Sequence[str], *feet: str) -> None:
        self.joints = tuple(joints)
        super().__init__(
            f"legs: expected one foot a leg, joint {shown(joints[-1])} carries {' and '.join(feet)}"
        )


Found = tuple[
    tuple[Leg, ...],
    tuple[int, ...],
    tuple[str, ...],
    tuple[tuple[str, str], ...],
    tuple[str, ...],
]
"""Legs; for every leg the index of the shape that touches, −1 if there is none; what of them was
guessed, a line each; what is hard to believe: of which joint or link, and what; and entries that a
YAML file has to add before anything can be planned, a line each."""


def legs_of(
    model: Any,
    shapes: Sequence[Shape],
    order: Sequence[str],
    feet: Mapping[str, str],
    contacts: Mapping[str, FootContact] | None = None,
) -> Found:
    """The legs of pinocchio's model of a URDF.

    Arguments:
        order: names of its joints as the file has them, which is the order of the legs.
        feet: links that are feet, by the name of their leg; empty to look for them.
        contacts: contact shapes of feet, by the name of a leg or of its foot, or by a pattern of
            either.

    Raises:
        InvalidInput: where there are no legs, for two feet on one leg, for a leg with joints that
            have more than one angle, and for contacts of no leg.
    """
    tree = _Tree(model, shapes)
    guesses, gaps = list[str](), list[str]()
    if feet:
        ends = {name: tree.end_at(foot) for name, foot in feet.items()}
        _check_apart(ends)
    else:
        lowest, arms, gaps = tree.lowest_chains()
        if arms:
            names = ", ".join(arm.foot for arm in arms)
            guesses.append(f"no legs though they reach as low, by their shape and names: {names}")
        lowest.sort(key=lambda end: order.index(model.names[end.joints[0]]))
        ends = dict(zip(_names(lowest), lowest, strict=True))
        names = ", ".join(f"{name} ({end.foot})" for name, end in ends.items())
        guesses.append(f"legs and feet, by their shape and names: {names}")
    tree.doubts.clear()  # of chains that are no legs
    known = _contacts(ends, contacts or {})
    tree.flat = len(ends) == 2
    result = [tree.leg(name, end, known.get(name)) for name, end in ends.items()]
    tree.doubts += [(f"link {leg.foot}", leg.doubt) for leg, _ in result if leg.doubt]
    soles = [(leg.foot, *leg.sole.size_m) for leg, _ in result if leg.sole and not leg.contact]
    if soles:
        sizes = ", ".join(f"{foot} {long:.3f} × {wide:.3f} m" for foot, long, wide in soles)
        guesses.append(f"soles, by their shapes: {sizes}")
    legs, indices = tuple(leg for leg, _ in result), tuple(index for _, index in result)
    return legs, indices, tuple(guesses), tuple(tree.doubts), tuple(gaps)


def _contacts(
    ends: Mapping[str, _End], contacts: Mapping[str, FootContact]
) -> dict[str, FootContact]:
    """Contact that a person gives each leg, by its name; later patterns win.

    Raises InvalidInput for one that fits no leg.
    """
    owners = {**{end.foot: name for name, end in ends.items()}, **{name: name for name in ends}}
    result = dict[str, FootContact]()
    for pattern, contact in contacts.items():
        result |= {owners[name]: contact for name in matching(pattern, owners, "contacts")}
    return result


@dataclass(frozen=True, kw_only=True, eq=False)
class _End:
    """The end of a chain: its joints from the base outward (pinocchio's numbers), and the link that
    may be a foot.
    """

    joints: tuple[int, ...]
    foot: str
    tip_m: Array
    names: tuple[str, ...]


class _Tree:
    """The chains of one model."""

    def __init__(self, model: Any, shapes: Sequence[Shape]) -> None:
        self._model, self._shapes = model, shapes
        self.flat = False  # feet may be soles, as of who stands on two
        self.doubts, self._fits = list[tuple[str, str]](), Fits()
        pin = pinocchio()
        self._bodies = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
        self._base = base_joint(model)
        data = model.createData()
        pin.computeJointJacobians(model, data, pin.neutral(model))
        local = [
            pin.getJointJacobian(model, data, j, pin.ReferenceFrame.LOCAL)
            for j in range(model.njoints)
        ]
        self._twists = {
            j: local[j][:, model.joints[j].idx_v] for j in range(self._base + 1, model.njoints)
        }
        base = data.oMi[self._base]
        self._in_base = [base.actInv(data.oMi[j]) for j in range(model.njoints)]

    def lowest_chains(self) -> tuple[list[_End], list[_End], list[str]]:
        """Chains that are legs, chains that reach as low and are arms, and the points of this that
        a person has to settle. Raises InvalidInput where there are none.
        """
        parents = list(self._model.parents)
        leaves = [j for j in range(self._base + 1, len(parents)) if j not in parents]
        ends = [
            self._end(self._support(leaf))
            for leaf in leaves
            if self._base in self._model.supports[leaf]
        ]
        ends = [end for end in ends if 2 <= len(end.joints) <= _MOST_JOINTS and self._simple(end)]
        ends = [end for end in ends if self._length(end) > _SHORTEST_M]
        if not ends:
            raise InvalidInput(
                "legs: expected chains of two joints or more under the base, found none"
            )
        depth = {end: self._depth(end) for end in ends}
        arms = self._arms(ends)  # which may hang down lower than legs go
        least = _LOW * min(depth[end] for end in ends if end not in arms)
        legs = [end for end in ends if end not in arms and depth[end] < least]
        chains = dict[int, list[_End]]()
        for end in legs:
            chains.setdefault(end.joints[0], []).append(end)
        for each in chains.values():
            self._check_waist(each)
        branched = {first for first, each in chains.items() if self._second(each) is not None}
        alone = [self._longest(each) for first, each in chains.items() if first not in branched]
        if len(alone) < 2 and branched:  # or else what branches is a trunk with arms
            first = min(branched)
            best, other = self._longest(chains[first]), self._second(chains[first])
            raise InvalidInput(
                f"legs: expected one foot a leg, joint {shown(best.names[0])} carries {best.foot} "
                "and "
                f"{other.foot if other else '?'}"
            )
        if not alone:
            raise InvalidInput(
                "legs: expected chains of joints that reach below the base, found none"
            )
        low = [end for end in arms if depth[end] < least]
        gaps = self._lying([end for end in ends if end not in arms], alone)
        if len(alone) < 2 and not gaps:
            gaps = [
                f"legs: expected two or more, found one, {alone[0].foot}, as of an arm; say which "
                "feet there are in a YAML file"
            ]
        return alone, low, gaps

    def _check_waist(self, ends: list[_End]) -> None:
        """Raise Waist where two legs that are alike hang below joints that they share."""
        best = self._longest(ends)
        for end in ends:
            shared = [j for j in best.joints if j in end.joints]
            own = [replace(each, joints=each.joints[len(shared) :]) for each in (best, end)]
            if (
                shared
                and min(len(each.joints) for each in own) >= _WHOLE_LEG
                and len(own[0].joints) == len(own[1].joints)
                and 2.0 * min(map(self._length, own)) > self._length(best)
            ):
                raise Waist(best.names[: len(shared)], best.foot, end.foot)

    def _arms(self, ends: Sequence[_End]) -> list[_End]:
        """Chains that are called arms, and those in the middle that are made otherwise than all the
        others; none where fewer than two chains are left.
        """
        named = [end for end in ends if self._called(end, ARM) and not self._called(end, _LEG)]
        left = [end for end in ends if end not in named]
        others = {end: [other for other in left if other is not end] for end in left}
        odd = [
            end
            for end in left
            if self._in_middle(end) and not any(self._alike(end, o) for o in others[end])
        ]
        if len(left) - len(odd) < 2:
            odd = []
        return [] if len(left) < 2 else [*named, *odd]

    def _in_middle(self, end: _End) -> bool:
        """Tell whether a chain begins in the plane between left and right."""
        return abs(float(self._in_base[end.joints[0]].translation[1])) < _ALIKE * self._length(end)

    def _lying(self, ends: Sequence[_End], legs: Sequence[_End]) -> list[str]:
        """Reasons to think that z does not point up: chains made as the legs are that do not go
        down, or legs that go up.
        """
        twins = [
            end for end in ends if end not in legs and any(self._alike(end, leg) for leg in legs)
        ]
        firsts = {end.joints[0] for end in legs}
        twins = [end for end in twins if end.joints[0] not in firsts]
        base = next((frame.name for frame in self._bodies if frame.parentJoint == self._base), "?")
        hint = "say root_rpy_rad, or which feet there are, in a YAML file"
        if twins:
            feet = ", ".join(end.foot for end in twins)
            return [
                f"link {base}: its z does not point up: {feet} are ends of chains like the legs' "
                "that do not go down: "
                f"{hint}"
            ]
        if legs and all(points_up(self.leg("", end)[0]) for end in legs):
            return [f"link {base}: its z does not point up: the legs do: {hint}"]
        return []

    def _called(self, end: _End, word: re.Pattern[str]) -> bool:
        """Tell whether a name of a chain's joints, or of its last link, has a word in it."""
        return any(word.search(name) for name in (*end.names, end.foot))

    def _alike(self, one: _End, other: _End) -> bool:
        """Tell whether two chains have as many joints and are as long."""
        a, b = self._length(one), self._length(other)
        return len(one.joints) == len(other.joints) and abs(a - b) <= _ALIKE * max(a, b)

    def end_at(self, foot: str) -> _End:
        """The chain that ends in a link.

        Raises InvalidInput where there is no such link, or no joint before it.
        """
        frame = next((frame for frame in self._bodies if frame.name == foot), None)
        if frame is None:
            known = ", ".join(each.name for each in self._bodies[:12])
            raise InvalidInput(
                f"feet: expected a link ({known}, …), found none that is called {shown(foot)}"
            )
        joints = self._support(frame.parentJoint)
        if not joints:
            raise InvalidInput(
                f"feet: expected joints between the base and {shown(foot)}, all of them are fixed"
            )
        return _End(
            joints=joints,
            foot=foot,
            tip_m=frame.placement.translation.copy(),
            names=tuple(self._model.names[j] for j in joints),
        )

    def leg(self, name: str, end: _End, contact: FootContact | None = None) -> tuple[Leg, int]:
        """The leg that ends at this link, with the middle of its joint limits as its stance; and
        the number of the shape with which it touches the ground.

        Arguments:
            contact: contact shape, if a YAML file gives one.

        Raises:
            InvalidInput: for joints of more than one angle.
        """
        if not self._simple(end):
            wrong = next(j for j in end.joints if self._model.joints[j].nv != 1)
            raise InvalidInput(
                f"joint {shown(self._model.names[wrong])}: expected one angle, it has more"
            )
        if len(end.joints) > _MOST_JOINTS:
            raise InvalidInput(
                f"leg {shown(name)}: expected {_MOST_JOINTS} joints or fewer, got {len(end.joints)}"
            )
        joints = tuple(self._joint(j) for j in end.joints)
        touch, sole = self._touch(end, contact, joints)
        chain = self._chain(end, touch.centre_m)
        middle = np.array([0.5 * (joint.lower_rad + joint.upper_rad) for joint in joints])
        leg = Leg(
            name=name,
            joints=joints,
            chain=chain,
            foot=touch.link,
            radius_m=touch.radius_m,
            stance_rad=middle,
            contact=contact,
            doubt=touch.doubt,
            sole=sole,
        )
        return leg, touch.index

    def _support(self, joint: int) -> tuple[int, ...]:
        return tuple(j for j in self._model.supports[joint] if j > self._base)

    def _simple(self, end: _End) -> bool:
        return all(self._model.joints[j].nv == 1 for j in end.joints)

    def _length(self, end: _End) -> float:
        places = [self._model.jointPlacements[j].translation for j in end.joints[1:]]
        return float(sum(np.linalg.norm(place) for place in places) + np.linalg.norm(end.tip_m))

    def _end(self, joints: tuple[int, ...]) -> _End:
        """The end of a chain of joints: the link at its last one that is called a foot, or the
        farthest.
        """
        links = [frame for frame in self._bodies if frame.parentJoint == joints[-1]]
        far = {frame.name: float(np.linalg.norm(frame.placement.translation)) for frame in links}
        links = [frame for frame in links if not _SENSOR.search(frame.name)] or links
        most = max(far[frame.name] for frame in links)
        called = [
            frame for frame in links if FOOT.search(frame.name) and far[frame.name] >= _NEAR * most
        ]
        foot = max(called or links, key=lambda frame: far[frame.name])
        return _End(
            joints=joints,
            foot=foot.name,
            tip_m=foot.placement.translation.copy(),
            names=tuple(self._model.names[j] for j in joints),
        )

    def _depth(self, end: _End) -> float:
        """Depth of the chain's end below the base's origin or its lowest hip, whichever is higher
        [m].
        """
        leg, _ = self.leg("", end)
        feet = leg.chain.feet(leg.random_angles(_SAMPLES, np.random.default_rng(0)))
        return float(feet[:, 2].min()) - max(
            0.0, min(float(self._in_base[j].translation[2]) for j in self._firsts())
        )

    def _firsts(self) -> list[int]:
        return [
            j
            for j in range(self._base + 1, self._model.njoints)
            if self._model.parents[j] == self._base
        ]

    def _longest(self, ends: list[_End]) -> _End:
        """Longest of the ends of one child of the base."""
        return max(ends, key=lambda end: (len(end.joints), self._length(end)))

    def _second(self, ends: list[_End]) -> _End | None:
        """A second foot beside the longest chain's, where one child of the base has two: fingers
        and heels are none.
        """
        best = self._longest(ends)
        place = self._at_zero(best)
        for end in ends:
            count = len(set(end.joints) - set(best.joints))
            if count > 1 and float(
                np.linalg.norm(self._at_zero(end) - place)
            ) > _APART * self._length(best):
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
            axes=np.array(
                [
                    twist[:3] if flat else twist[3:]
                    for twist, flat in zip(twists, slides, strict=True)
                ]
            ),
            slides=slides,
            tip_m=tip,
        )

    def _joint(self, j: int) -> Joint:
        """A joint's limits, a whole turn where it has none."""
        model, name = self._model, str(self._model.names[j])
        column, row = model.joints[j].idx_q, model.joints[j].idx_v
        lower, upper = (
            float(model.lowerPositionLimit[column]),
            float(model.upperPositionLimit[column]),
        )
        slides = bool(np.linalg.norm(self._twists[j][3:]) < 0.5)
        if slides and not lower < upper:
            raise InvalidInput(
                f"joint {shown(name)}: expected a lower limit below the upper one, got {lower:g}, "
                f"{upper:g}"
            )
        if not slides and (
            model.joints[j].nq == 2 or not lower < upper or upper - lower > FULL_TURN
        ):
            free = model.joints[j].nq == 2 or not lower < upper
            middle = 0.0 if free else float(np.clip(0.0, lower + np.pi, upper - np.pi))
            lower, upper = middle - np.pi, middle + np.pi
            self.doubts.append(
                (f"joint {name}", "turns freely, its limits are a whole turn apart or more")
            )
        torque, velocity = float(model.effortLimit[row]), float(model.velocityLimit[row])
        return Joint(
            name=name,
            lower_rad=lower,
            upper_rad=upper,
            slides=slides,
            torque_nm=torque if np.isfinite(torque) else 0.0,
            velocity_rad_s=velocity if np.isfinite(velocity) else 0.0,
        )

    def _touch(
        self, end: _End, contact: FootContact | None, joints: Sequence[Joint]
    ) -> tuple[Touch, FootSole | None]:
        """Shape with which the leg touches, in the last joint's frame, and the sole that it is."""
        body = [frame for frame in self._bodies if frame.parentJoint == end.joints[-1]]
        places = {
            frame.name: (np.array(frame.placement.rotation), np.array(frame.placement.translation))
            for frame in body
        }
        turn, place = places[end.foot]
        base = self._in_base[end.joints[-1]].rotation.T
        if contact is not None:
            centre, flat = place + turn @ contact.point_m, contact.sole_m
            sole = None if flat is None else FootSole(points_m=flat, rotation=base)
            return Touch(link=end.foot, centre_m=centre, radius_m=contact.radius_m, index=-1), sole
        pieces = placed_shapes(self._shapes, places, self._fits)
        free = joints[-1].upper_rad - joints[-1].lower_rad > FULL_TURN and not joints[-1].slides
        if free and is_wheel(pieces, self._twists[end.joints[-1]][3:], base[:, 2]):
            doubt = "is a wheel, whose axis is along the ground: no foot stands on it"
            wheel = Touch(link=end.foot, centre_m=place, radius_m=0.0, index=-1, doubt=doubt)
            return wheel, None
        found = sole_of(pieces, base) if self.flat and len(joints) >= _LEVEL else None
        if found is not None:
            sole, middle, link = found
            return Touch(link=link, centre_m=middle, radius_m=0.0, index=-1), sole
        return self._pointed(end, touch_of(pieces), place), None

    def _pointed(self, end: _End, touch: Touch | None, place: Array) -> Touch:
        """Shape with which a leg touches that is no sole.

        Arguments:
            touch: as its shapes show it.
            place: of its foot in the last joint's frame, shape (3,) [m].
        """
        if touch is not None and not touch.doubt:
            return touch
        doubt, link = ("", end.foot) if touch is None else (touch.doubt, touch.link)
        if np.linalg.norm(end.tip_m) > _SHORTEST_M:
            return Touch(link=end.foot, centre_m=place, radius_m=0.0, index=-1, doubt=doubt)
        tip = 2.0 * self._model.inertias[end.joints[-1]].lever if touch is None else touch.centre_m
        if not doubt:
            self.doubts.append(
                (f"link {link}", "has no link for its foot, its farthest end is taken for it")
            )
        return Touch(link=link, centre_m=np.asarray(tip), radius_m=0.0, index=-1, doubt=doubt)


def _check_apart(ends: Mapping[str, _End]) -> None:
    seen = dict[int, _End]()
    for end in ends.values():
        for joint, name in zip(end.joints, end.names, strict=True):
            if joint in seen:
                own = len(set(end.joints) ^ set(seen[joint].joints))
                if own >= 2 * _WHOLE_LEG:
                    shared = sum(j in seen[joint].joints for j in end.joints)
                    raise Waist(end.names[:shared], seen[joint].foot, end.foot)
                raise InvalidInput(
                    f"feet: expected one foot a leg, joint {shown(name)} carries "
                    f"{seen[joint].foot} and {end.foot}"
                )
            seen[joint] = end


def _names(ends: Sequence[_End]) -> list[str]:
    """A leg's name is what its joints' names begin with, or end with, or its foot's."""
    for guess in (_beginning, _ending, lambda end: end.foot):
        names = [guess(end) for end in ends]
        if all(names) and len(set(names)) == len(names):
            return names
    return [f"leg{i + 1}" for i in range(len(ends))]


def _beginning(end: _End) -> str:
    return _shared(end.names).rstrip("_-. ")


def _ending(end: _End) -> str:
    return _shared([_JOINT_WORD.sub("", name)[::-1] for name in end.names])[::-1].strip("_-. ")


def _shared(names: Sequence[str]) -> str:
    """Beginning that all names share."""
    same = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    return "".join(letters[0] for letters in same)
