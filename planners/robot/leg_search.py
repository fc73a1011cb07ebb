"""Legs of a robot: chains of joints under the base that reach lower than the others.

Nothing has to be said of a usual robot. One chain is looked at for each child of the base, the one
with most joints; a leg is a chain whose feet go below LOW times what the lowest chain's do (arms
and heads do not); its foot is the link at its end that is called so, or else the farthest. What is
found in this way is a guess, and is marked as one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
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
from .urdf_reader import axes_of, base_joint, matching, pinocchio

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


Found = tuple[tuple[Leg, ...], tuple[str, ...], tuple[tuple[str, str], ...], tuple[str, ...]]
"""Legs; what of them was guessed, a line each; what is hard to believe: of which joint or link, and
what; and entries that a YAML file has to add before anything can be planned, a line each."""


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
        tree.check_apart(list(ends.values()))
    else:
        lowest, arms, gaps = tree.lowest_chains()
        if arms:
            names = ", ".join(map(tree.foot, arms))
            guesses.append(f"no legs though they reach as low, by their shape and names: {names}")
        lowest.sort(key=lambda end: order.index(tree.names(end)[0]))
        ends = dict(zip(tree.leg_names(lowest), lowest, strict=True))
        names = ", ".join(f"{name} ({tree.foot(end)})" for name, end in ends.items())
        guesses.append(f"legs and feet, by their shape and names: {names}")
    tree.doubts.clear()  # of chains that are no legs
    owners = {tree.foot(end): name for name, end in ends.items()} | {name: name for name in ends}
    known = dict[str, FootContact]()
    for pattern, contact in (contacts or {}).items():  # later patterns win
        known |= {owners[name]: contact for name in matching(pattern, owners, "contacts")}
    tree.flat = len(ends) == 2
    legs = tuple(tree.leg(name, end, known.get(name)) for name, end in ends.items())
    tree.doubts += [(f"link {leg.foot}", leg.doubt) for leg in legs if leg.doubt]
    soles = [(leg.foot, *leg.sole.size_m) for leg in legs if leg.sole and not leg.contact]
    if soles:
        sizes = ", ".join(f"{foot} {long:.3f} × {wide:.3f} m" for foot, long, wide in soles)
        guesses.append(f"soles, by their shapes: {sizes}")
    return legs, tuple(guesses), tuple(tree.doubts), tuple(gaps)


class _Tree:
    """The chains of one model, each by the number of the frame of the link that may be its foot."""

    def __init__(self, model: Any, shapes: Sequence[Shape]) -> None:
        self._model, self._shapes = model, shapes
        self.flat = False  # feet may be soles, as of who stands on two
        self.doubts, self._fits = list[tuple[str, str]](), Fits()
        pin = pinocchio()
        self._bodies = {
            i: frame for i, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY
        }
        self._base = base_joint(model)
        data = model.createData()
        pin.forwardKinematics(model, data, pin.neutral(model))
        self._axes = axes_of(model)
        base = data.oMi[self._base]
        self._in_base = [base.actInv(data.oMi[j]) for j in range(model.njoints)]

    def joints(self, end: int) -> tuple[int, ...]:
        """Joints of a chain from the base outward, as pinocchio numbers them."""
        carriers = self._model.supports[self._bodies[end].parentJoint]
        return tuple(j for j in carriers if j > self._base)

    def names(self, end: int) -> tuple[str, ...]:
        """Names of these joints."""
        return tuple(self._model.names[j] for j in self.joints(end))

    def foot(self, end: int) -> str:
        """Name of a chain's last link."""
        return str(self._bodies[end].name)

    def _tip(self, end: int) -> Array:
        """Place of that link in the last joint's frame, shape (3,) [m]."""
        return np.array(self._bodies[end].placement.translation)

    def lowest_chains(self) -> tuple[list[int], list[int], list[str]]:
        """Chains that are legs, chains that reach as low and are arms, and the points of this that
        a person has to settle. Raises InvalidInput where there are none.
        """
        parents = list(self._model.parents)
        leaves = [j for j in range(self._base + 1, len(parents)) if j not in parents]
        ends = [self._end(leaf) for leaf in leaves if self._base in self._model.supports[leaf]]
        ends = [
            end for end in ends if 2 <= len(self.joints(end)) <= _MOST_JOINTS and self._simple(end)
        ]
        ends = [end for end in ends if self._length(end) > _SHORTEST_M]
        if not ends:
            raise InvalidInput(
                "legs: expected chains of two joints or more under the base, found none"
            )
        depth = {end: self._depth(end) for end in ends}
        arms = self._arms(ends)  # which may hang down lower than legs go
        least = _LOW * min(depth[end] for end in ends if end not in arms)
        legs = [end for end in ends if end not in arms and depth[end] < least]
        chains = dict[int, list[int]]()
        for end in legs:
            chains.setdefault(self.joints(end)[0], []).append(end)
        for each in chains.values():
            self._check_waist(each)
        branched = {first for first, each in chains.items() if self._second(each) is not None}
        alone = [self._longest(each) for first, each in chains.items() if first not in branched]
        if len(alone) < 2 and branched:  # or else what branches is a trunk with arms
            first = min(branched)
            best, other = self._longest(chains[first]), self._second(chains[first])
            raise InvalidInput(
                f"legs: expected one foot a leg, joint {shown(self.names(best)[0])} carries "
                f"{self.foot(best)} and {'?' if other is None else self.foot(other)}"
            )
        if not alone:
            raise InvalidInput(
                "legs: expected chains of joints that reach below the base, found none"
            )
        low = [end for end in arms if depth[end] < least]
        gaps = self._lying([end for end in ends if end not in arms], alone)
        if len(alone) < 2 and not gaps:
            gaps = [
                f"legs: expected two or more, found one, {self.foot(alone[0])}, as of an arm; say which "
                "feet there are in a YAML file"
            ]
        return alone, low, gaps

    def _check_waist(self, ends: list[int]) -> None:
        """Raise Waist where two legs that are alike hang below joints that they share."""
        best = self._longest(ends)
        for end in ends:
            shared = sum(j in self.joints(end) for j in self.joints(best))
            own = [len(self.joints(each)) - shared for each in (best, end)]
            long_m = [self._length(each, shared) for each in (best, end)]
            if (
                shared
                and min(own) >= _WHOLE_LEG
                and own[0] == own[1]
                and 2.0 * min(long_m) > self._length(best)
            ):
                raise Waist(self.names(best)[:shared], self.foot(best), self.foot(end))

    def _arms(self, ends: Sequence[int]) -> list[int]:
        """Chains that are called arms, and those in the middle that are made otherwise than all the
        others; none where fewer than two chains are left.
        """
        named = [end for end in ends if self._called(end, ARM) and not self._called(end, _LEG)]
        left = [end for end in ends if end not in named]
        others = {end: [other for other in left if other != end] for end in left}
        odd = [
            end
            for end in left
            if abs(self._in_base[self.joints(end)[0]].translation[1]) < _ALIKE * self._length(end)
            and not any(self._alike(end, o) for o in others[end])
        ]
        if len(left) - len(odd) < 2:
            odd = []
        return [] if len(left) < 2 else [*named, *odd]

    def _lying(self, ends: Sequence[int], legs: Sequence[int]) -> list[str]:
        """Reasons to think that z does not point up: chains made as the legs are that do not go
        down, or legs that go up.
        """
        twins = [
            end for end in ends if end not in legs and any(self._alike(end, leg) for leg in legs)
        ]
        firsts = {self.joints(end)[0] for end in legs}
        twins = [end for end in twins if self.joints(end)[0] not in firsts]
        bodies = self._bodies.values()
        base = next((frame.name for frame in bodies if frame.parentJoint == self._base), "?")
        hint = "say root_rpy_rad, or which feet there are, in a YAML file"
        if twins:
            feet = ", ".join(map(self.foot, twins))
            return [
                f"link {base}: its z does not point up: {feet} are ends of chains like the legs' "
                "that do not go down: "
                f"{hint}"
            ]
        if legs and all(points_up(self.leg("", end)) for end in legs):
            return [f"link {base}: its z does not point up: the legs do: {hint}"]
        return []

    def _called(self, end: int, word: re.Pattern[str]) -> bool:
        """Tell whether a name of a chain's joints, or of its last link, has a word in it."""
        return any(word.search(name) for name in (*self.names(end), self.foot(end)))

    def _alike(self, one: int, other: int) -> bool:
        """Tell whether two chains have as many joints and are as long."""
        a, b = self._length(one), self._length(other)
        return len(self.joints(one)) == len(self.joints(other)) and abs(a - b) <= _ALIKE * max(a, b)

    def end_at(self, foot: str) -> int:
        """The chain that ends in a link.

        Raises InvalidInput where there is no such link, or no joint before it.
        """
        end = next((i for i, frame in self._bodies.items() if frame.name == foot), None)
        if end is None:
            known = ", ".join([frame.name for frame in self._bodies.values()][:12])
            raise InvalidInput(
                f"feet: expected a link ({known}, …), found none that is called {shown(foot)}"
            )
        if not self.joints(end):
            raise InvalidInput(
                f"feet: expected joints between the base and {shown(foot)}, all of them are fixed"
            )
        return end

    def leg(self, name: str, end: int, contact: FootContact | None = None) -> Leg:
        """The leg that ends at this link, with the middle of its joint limits as its stance.

        Arguments:
            contact: contact shape, if a YAML file gives one.

        Raises:
            InvalidInput: for joints of more than one angle.
        """
        numbers = self.joints(end)
        if not self._simple(end):
            wrong = next(j for j in numbers if self._model.joints[j].nv != 1)
            raise InvalidInput(
                f"joint {shown(self._model.names[wrong])}: expected one angle, it has more"
            )
        if len(numbers) > _MOST_JOINTS:
            raise InvalidInput(
                f"leg {shown(name)}: expected {_MOST_JOINTS} joints or fewer, got {len(numbers)}"
            )
        joints = tuple(self._joint(j) for j in numbers)
        (foot, centre, radius_m, doubt), sole = self._touch(end, contact, joints[-1])
        return Leg(
            name=name,
            joints=joints,
            chain=self._chain(numbers, centre),
            foot=foot,
            radius_m=radius_m,
            stance_rad=np.array([0.5 * (joint.lower_rad + joint.upper_rad) for joint in joints]),
            contact=contact,
            doubt=doubt,
            sole=sole,
        )

    def _simple(self, end: int) -> bool:
        return all(self._model.joints[j].nv == 1 for j in self.joints(end))

    def _length(self, end: int, first: int = 0) -> float:
        """Length of a chain by way of its joints, or of what is left of it from one of them on [m]."""
        joints = self.joints(end)[first + 1 :]
        places = [self._model.jointPlacements[j].translation for j in joints]
        return float(sum(map(np.linalg.norm, places)) + np.linalg.norm(self._tip(end)))

    def _end(self, joint: int) -> int:
        """The end of the chain of a last joint: the link on it that is called a foot, or the
        farthest.
        """
        links = [i for i, frame in self._bodies.items() if frame.parentJoint == joint]
        links = [i for i in links if not _SENSOR.search(self.foot(i))] or links
        far = {i: float(np.linalg.norm(self._tip(i))) for i in links}
        most = max(far.values())
        called = [i for i in links if FOOT.search(self.foot(i)) and far[i] >= _NEAR * most]
        return max(called or links, key=lambda i: far[i])

    def _depth(self, end: int) -> float:
        """Depth of the chain's end below the base's origin or its lowest hip, whichever is higher
        [m].
        """
        leg = self.leg("", end)
        feet = leg.chain.feet(leg.random_angles(_SAMPLES, np.random.default_rng(0)))
        hips = (
            float(self._in_base[j].translation[2])
            for j in range(self._base + 1, self._model.njoints)
            if self._model.parents[j] == self._base
        )
        return float(feet[:, 2].min()) - max(0.0, min(hips))

    def _longest(self, ends: list[int]) -> int:
        """Longest of the ends of one child of the base."""
        return max(ends, key=lambda end: (len(self.joints(end)), self._length(end)))

    def _second(self, ends: list[int]) -> int | None:
        """A second foot beside the longest chain's, where one child of the base has two: fingers
        and heels are none.
        """
        best = self._longest(ends)
        place = self._at_zero(best)
        for end in ends:
            count = len(set(self.joints(end)) - set(self.joints(best)))
            if count > 1 and float(
                np.linalg.norm(self._at_zero(end) - place)
            ) > _APART * self._length(best):
                return end
        return None

    def _at_zero(self, end: int) -> Array:
        joints = self.joints(end)
        return np.asarray(self._chain(joints, self._tip(end)).feet(np.zeros((1, len(joints))))[0])

    def _chain(self, joints: Sequence[int], tip: Array) -> Chain:
        model = self._model
        places = [self._in_base[joints[0]], *(model.jointPlacements[j] for j in joints[1:])]
        return Chain(
            rotations=np.array([place.rotation for place in places]),
            origins=np.array([place.translation for place in places]),
            axes=np.array([self._axes[j][0] for j in joints]),
            slides=np.array([self._axes[j][1] for j in joints]),
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
        slides = self._axes[j][1]
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
        self, end: int, contact: FootContact | None, last: Joint
    ) -> tuple[Touch, FootSole | None]:
        """What touches of the leg whose last joint this is, and the sole that it is."""
        number, foot, tip = self.joints(end)[-1], self.foot(end), self._tip(end)
        places = {
            frame.name: (np.array(frame.placement.rotation), np.array(frame.placement.translation))
            for frame in self._bodies.values()
            if frame.parentJoint == number
        }
        base, axis = self._in_base[number].rotation.T, self._axes[number][0]
        if contact is not None:
            centre, flat = tip + places[foot][0] @ contact.point_m, contact.sole_m
            sole = None if flat is None else FootSole(points_m=flat, rotation=base)
            return (foot, centre, contact.radius_m, ""), sole
        pieces = placed_shapes(self._shapes, places, self._fits)
        free = last.upper_rad - last.lower_rad > FULL_TURN and not last.slides
        if free and is_wheel(pieces, axis, base[:, 2]):
            doubt = "is a wheel, whose axis is along the ground: no foot stands on it"
            return (foot, tip, 0.0, doubt), None
        level = self.flat and len(self.joints(end)) >= _LEVEL
        if level and (found := sole_of(pieces, base)) is not None:
            sole, middle, link = found
            return (link, middle, 0.0, ""), sole
        touch = touch_of(pieces)
        if touch is not None and not touch[-1]:
            return touch, None
        link, farthest, _, doubt = touch or (foot, None, 0.0, "")
        if np.linalg.norm(tip) > _SHORTEST_M:
            return (foot, tip, 0.0, doubt), None
        if not doubt:
            self.doubts.append(
                (f"link {link}", "has no link for its foot, its farthest end is taken for it")
            )
        lever = 2.0 * np.array(self._model.inertias[number].lever)
        return (link, lever if farthest is None else farthest, 0.0, doubt), None

    def check_apart(self, ends: Sequence[int]) -> None:
        """Raise Waist, or InvalidInput, for a joint that is part of two legs."""
        seen = dict[int, int]()
        for end in ends:
            joints = self.joints(end)
            for joint, name in zip(joints, self.names(end), strict=True):
                if joint in seen:
                    others, feet = self.joints(seen[joint]), map(self.foot, (seen[joint], end))
                    if len(set(joints) ^ set(others)) >= 2 * _WHOLE_LEG:
                        shared = sum(j in others for j in joints)
                        raise Waist(self.names(end)[:shared], *feet)
                    raise InvalidInput(
                        f"feet: expected one foot a leg, joint {shown(name)} carries "
                        f"{' and '.join(feet)}"
                    )
                seen[joint] = end

    def leg_names(self, ends: Sequence[int]) -> list[str]:
        """A leg's name is what its joints' names begin with, or end with, or its foot's."""
        joints = [self.names(end) for end in ends]
        for names in (
            [_shared(each).rstrip("_-. ") for each in joints],
            [
                _shared([_JOINT_WORD.sub("", name)[::-1] for name in each])[::-1].strip("_-. ")
                for each in joints
            ],
            [self.foot(end) for end in ends],
        ):
            if all(names) and len(set(names)) == len(names):
                return names
        return [f"leg{i + 1}" for i in range(len(ends))]


def _shared(names: Sequence[str]) -> str:
    """Beginning that all names share."""
    same = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    return "".join(letters[0] for letters in same)
