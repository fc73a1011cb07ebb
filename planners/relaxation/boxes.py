"""Learned envelopes over the stance contacts of a course: which box belongs to which limb of which
stance.

An envelope is learned for some legs, RF, RR and LM for one. The other tripod LF, LR and RM is its
mirror image about the sagittal plane. With S = diag(1, −1, 1) a toe at p goes to S p and a force F
to S F. The shear axes of the house, up on walls and forward on ground, are their own images, z' = S
z, and n' = S n; but y' = z' × n' = S z × S n = −S y. So in the mirrored contact frame f_n and f_z
stay, while f_y changes its sign; so does F_y in world axes, while F_x and F_z stay. Either way the
box mirrors p_y and the second force component.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from ..equilibrium.layout import Index, Layout
from ..equilibrium.scaled import Scaled
from ..errors import InvalidInput, located
from ..files.arrays import Array
from ..files.codec import fields_to_json, from_json
from ..problem import Problem
from ..problem.problem import Stance
from ..robot.model import Robot
from ..terrain.polygon import shear_of
from .envelope import Envelope, EnvelopeSet
from .mccormick import Axes, domain_of


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """One envelope per kind of terrain, each over [p, f] with f in world axes, between which
    ``plan`` switches.

    Arguments:
        names: names of the kinds of terrain, in the order in which ``Problem.modes`` counts them (0
            ground, 1 wall).
        boxes: as many envelopes; their legs may be mirrored.
    Source:
        Lin et al. §IV-A, mode switching.

    Example:
        >>> import numpy as np
        >>> from stancekit import Envelope, EnvelopeSet, Modes, sample
        >>> box = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
        >>> learned = EnvelopeSet.for_problems("wall-3", sample("wall-3", 1), [box])
        >>> Modes(names=("wall",), boxes=learned).names
        ('wall',)
    """

    FORMAT: ClassVar = "stancekit/modes/1"

    names: tuple[str, ...]
    boxes: EnvelopeSet

    def __post_init__(self) -> None:
        if len(self.names) != len(self.boxes.envelopes) or len(set(self.names)) != len(self.names):
            raise InvalidInput(
                f"names: expected {len(self.boxes.envelopes)} different ones, one an envelope, got "
                f"{list(self.names)}"
            )

    @classmethod
    def around(cls, samples: Mapping[str, tuple[Sequence[Problem], Sequence[Envelope]]]) -> Modes:
        """Modes by name: the problems that each was learned from, and its one envelope."""
        problems = [problem for some, _ in samples.values() for problem in some]
        boxes = [box for _, boxes in samples.values() for box in boxes]
        learned = EnvelopeSet.for_problems("+".join(samples), problems, boxes, {"axes": "world"})
        return cls(names=tuple(samples), boxes=learned)

    def to_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return fields_to_json(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Modes:
        """Read the JSON form.

        Raises InvalidInput.
        """
        return from_json(cls, data)


def world_points(problems: Sequence[Problem], points: Array) -> Array:
    """[p, f] of postures with f turned from contact frames to world axes, shape (K, N, 6).

    Arguments:
        problems: K of them, N contacts each.
        points: p in the world, f in contact frames, shape (K, N, 6).
    """
    frames = np.stack([Scaled.of(problem).frames for problem in problems])
    forces = np.matmul(frames, points[..., 3:, None])[..., 0]
    return np.concatenate([points[..., :3], forces], axis=-1)


def allowed_boxes(scaled: Scaled, boxes: Sequence[Envelope], axes: Axes) -> Array:
    """1 where a stance may use a box, 0 where the course's own bounds on one of its contacts miss
    it; shape (S, E).
    """
    layout, domain = scaled.layout, domain_of(scaled, axes)
    meets = [np.all((box.low <= domain.high) & (domain.low <= box.high), axis=1) for box in boxes]
    missed = np.zeros((len(layout.stances), len(boxes)))
    np.add.at(missed, layout.contacts[0], 1.0 - np.stack(meets, axis=1))
    return np.asarray((missed == 0.0).astype(np.float64))


def composed(layout: Layout, boxes: Sequence[Envelope], chosen: Index) -> Envelope:
    """One box over the stance contacts, that of the chosen mode in each stance.

    Arguments:
        boxes: one a mode, over the B stance contacts.
        chosen: the mode of each stance, shape (S,).
    """
    mode, rows = chosen[layout.contacts[0]], np.arange(len(layout.contacts[0]))
    return Envelope(
        low=np.stack([box.low for box in boxes])[mode, rows],
        high=np.stack([box.high for box in boxes])[mode, rows],
    )


def modes_of_frames(layout: Layout, chosen: Index) -> Index:
    """z of every frame: that of its last stance, which stands on the toes put down last; shape
    (M,).
    """
    last = {frame: index for index, (frame, _) in enumerate(layout.stances)}
    return np.asarray(chosen[[last[frame] for frame in range(layout.frames)]])


MIRROR = np.array([1.0, -1.0, 1.0])
"""S: world to mirrored world."""
_NEARLY = 0.25
"""Share of a limb's reach by which measured limbs of one robot may miss each other's mirror
images."""
_MIRRORED_BOX = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
"""The same for [p, f], f in either axes (see the module)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StanceBoxes:
    """Boxes that were chosen for the very stances of a course: each over its B stance contacts, as
    ``boxes_of`` gives them.

    Arguments:
        problem_class: of the problems that whoever chose them learned from.
    """

    problem_class: str
    boxes: tuple[Envelope, ...]


def mirrored_box(box: Envelope) -> Envelope:
    """The box of the mirrored stance: p_y and the second force component change their sign (see the
    module).
    """
    ends = _MIRRORED_BOX * box.low, _MIRRORED_BOX * box.high
    return Envelope(low=np.minimum(*ends), high=np.maximum(*ends))


def mirrored(envelopes: EnvelopeSet, robot: Robot) -> EnvelopeSet:
    """Mirror envelopes for the legs on the other side: p_y and f_y change their sign, as normals
    do.

    Arguments:
        robot: whose legs are paired by their shoulders.

    Raises:
        InvalidInput: for a robot that is not symmetric.
    """
    return replace(
        envelopes,
        problem_class=f"{envelopes.problem_class} mirrored",
        legs=tuple(_partner(robot, leg) for leg in envelopes.legs),
        normals=envelopes.normals * MIRROR,
        envelopes=tuple(map(mirrored_box, envelopes.envelopes)),
    )


def boxes_of(
    course: Problem, envelopes: EnvelopeSet | Sequence[EnvelopeSet], axes: Axes = "contact"
) -> tuple[Envelope, ...]:
    """Every envelope of the set, as a box over the B stance contacts of a course.

    Arguments:
        envelopes: or several sets of as many boxes, for different limbs: a stance takes the first
            that has its limbs.

    Raises:
        InvalidInput: that names the first stance whose limbs or patches no set was learned for, and
            for envelopes of another robot.
    """
    sets = (envelopes,) if isinstance(envelopes, EnvelopeSet) else tuple(envelopes)
    for one in sets:
        one.check_robot(course.robot.identity)
        if len(one.envelopes) != len(sets[0].envelopes):
            raise InvalidInput(
                f"envelopes: expected {len(sets[0].envelopes)} for {one.problem_class}, as for "
                f"{sets[0].problem_class}, got {len(one.envelopes)}"
            )
    boxes = [one.measured_in(course.unit_m) if one.robot else one for one in sets]
    either = (*boxes, *_images(boxes, course.robot))
    low, high = list[Array](), list[Array]()
    for stance in course.stances:
        fitting = _fitting(course, stance, either)
        _check(course, stance, fitting, axes)
        for limb in stance.limbs if axes == "contact" else ():
            _check_one_frame(course, limb, int(course.holds[stance.frame, limb]))
        columns = [fitting.legs.index(course.robot.limb_names[limb]) for limb in stance.limbs]
        low.append(np.stack([box.low[columns] for box in fitting.envelopes]))
        high.append(np.stack([box.high[columns] for box in fitting.envelopes]))
    ends = (np.concatenate(side, axis=1) for side in (low, high))
    return tuple(Envelope(low=below, high=above) for below, above in zip(*ends, strict=True))


def check_fits_one(course: Problem, envelopes: EnvelopeSet) -> None:
    """Raise InvalidInput, for the first stance, unless the limbs and patches of some stance are
    those of the set.

    For what is asked of a course stance by stance, or window by window, as ``boxes_of`` is of all.
    """
    envelopes.check_robot(course.robot.identity)
    boxes = envelopes.measured_in(course.unit_m) if envelopes.robot else envelopes
    either, first = (boxes, *_images([boxes], course.robot)), None
    for stance in course.stances:
        try:
            return _check(course, stance, _fitting(course, stance, either), "contact")
        except InvalidInput as error:
            first = first or error
    assert first is not None
    raise first


def _images(envelopes: Sequence[EnvelopeSet], robot: Robot) -> list[EnvelopeSet]:
    """The sets for the legs on the other side, of those whose legs have such."""
    images = []
    for one in envelopes:
        with suppress(InvalidInput):
            images.append(mirrored(one, robot))
    return images


def _partner(robot: Robot, leg: str) -> str:
    """The leg whose shoulder is the mirror image of this one's; of measured legs the one that is
    nearest to it.
    """
    (member,) = robot.select([leg])
    apart = [
        max(
            float(np.abs(limb.shoulder_m - MIRROR * member.shoulder_m).max()),
            abs(limb.reach_m - member.reach_m),
        )
        for limb in robot.limbs
    ]
    nearest = int(np.argmin(apart))
    if apart[nearest] < (_NEARLY * member.reach_m if robot.identity else 1e-6):
        return robot.limbs[nearest].name
    raise InvalidInput(
        f"robot {robot.name}: expected a limb opposite to {leg}, to mirror its envelope, got none"
    )


def _fitting(course: Problem, stance: Stance, either: tuple[EnvelopeSet, ...]) -> EnvelopeSet:
    names = [course.robot.limb_names[limb] for limb in stance.limbs]
    for envelopes in either:
        if set(envelopes.legs) == set(names):
            return envelopes
    known = " or ".join(", ".join(envelopes.legs) for envelopes in either)
    raise InvalidInput(
        f"frame {stance.frame}: expected a stance on {known}, as the envelope learned for "
        f"{either[0].problem_class} has it, got one on {', '.join(names)}"
    )


def _check_one_frame(course: Problem, limb: int, foothold: int) -> None:
    """Raise InvalidInput unless the candidates of a foothold share one contact frame."""
    stood_on = course.footholds[foothold]
    frames = np.array([patch.frame for patch in stood_on.candidates])
    if np.abs(frames - frames[0]).max() > 1e-6:
        raise InvalidInput(
            f"frame {stood_on.frame}, limb {course.robot.limb_names[limb]}: expected candidate "
            "patches that share one "
            "contact frame, for boxes on the forces in it; got several: use boxes in world axes, "
            "or one candidate"
        )


def _check(course: Problem, stance: Stance, envelopes: EnvelopeSet, axes: Axes) -> None:
    """Raise InvalidInput unless every candidate patch under the stance is of the kind that was
    learned.
    """
    names = course.robot.limb_names
    limbs = tuple(names.index(leg) for leg in envelopes.legs)
    under = [course.footholds[int(course.holds[stance.frame, limb])] for limb in limbs]
    for option in range(max(len(stood_on.candidates) for stood_on in under)):
        choice = np.zeros(len(course.footholds), dtype=np.int_)
        choice[course.holds[stance.frame, list(limbs)]] = [
            min(option, len(one.candidates) - 1) for one in under
        ]
        where = f"frame {stance.frame}, stance on {', '.join(envelopes.legs)}"
        with located(where):
            envelopes.check_fits(course.posture_problem(Stance(stance.frame, limbs), choice))
        for stood_on in under if axes == "contact" else []:
            patch = stood_on.candidates[min(option, len(stood_on.candidates) - 1)]
            if _turned(patch.shear_reference, patch.normal) > 1e-3:
                raise InvalidInput(
                    f"{where}, limb {stood_on.limb}: expected the shear axis z up on walls and "
                    "forward on ground, "
                    f"as envelopes are learned, got {np.round(patch.shear_reference, 3).tolist()}"
                )


def _turned(shear_reference: Array, normal: Array) -> float:
    """Sine of the angle between a patch's own z axis and the house's."""
    turned, house = (v - (v @ normal) * normal for v in (shear_reference, shear_of(normal)))
    turned, house = turned / np.linalg.norm(turned), house / np.linalg.norm(house)
    return float(np.linalg.norm(turned - house))
