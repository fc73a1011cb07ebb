"""Mode switching (Lin et al. §IV-A, end): envelopes of several terrains, and one binary a posture
that says which.

The forces of these boxes are in world axes: "up" on the ground is a normal force and on a wall a
shear force, so that boxes in contact frames could not tell walking from climbing. A posture is a
stance: while one tripod has moved from the ground to the wall, the other still stands on the
ground. The mode of a key frame is that of its last stance, which stands on the toes put down last.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..equilibrium.layout import Index, Layout
from ..equilibrium.scaled import Scaled
from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.codec import fields_to_json, from_json
from ..problem import Problem
from .domain import domain_of
from .envelope import Envelope, EnvelopeSet
from .mccormick import Axes


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """One envelope per kind of terrain, each over [p, f] with f in world axes, between which
    ``plan`` switches.

    Arguments:
        names: of the kinds of terrain, in the order in which ``Problem.modes`` counts them (0
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
