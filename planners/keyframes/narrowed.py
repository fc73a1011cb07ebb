"""A course confined to a part of it: closed slots, pieces of patches, and a force box for every bearing.

What branch and bound in space hands to the lift: it is data alone, so that every node is solved by one compiled model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..conic import ConicModel
from ..contact.exact import cut, halving_chord
from ..contact.scaled import padded
from ..contact.terms import Body, Toes
from .layout import Layout, one_hot
from .lift import LiftedCourse, lifted_values
from .scaled import ScaledCourse
from .terms import Candidates, LiftedForces, Steps, objective


@dataclass(frozen=True, kw_only=True, eq=False)
class NarrowedCourse(ScaledCourse):
    """A part of a course.

    low, high: bounds of (f_n, f_y, f_z) of every bearing, shape (B, 3). pieces: the border of every slot's piece, no
    vertex twice, (·, 3) each; a single point where a toe already stands.
    """

    low: Array
    high: Array
    pieces: tuple[Array, ...]

    @classmethod
    def whole(cls, scaled: ScaledCourse) -> NarrowedCourse:
        """The whole course, in a layout whose lift has rows for every force bound; boxes no wider than the cones."""
        course = scaled.course
        layout = replace(scaled.layout, whole_box=True)
        friction = scaled.friction.reshape(layout.placements, layout.regions).max(axis=1)[layout.bearing[2]]
        shear = (friction * max(float(course.force_max[0]), 0.0))[:, None]
        low, high = (np.tile(bound, (len(friction), 1)) for bound in (course.force_min, course.force_max))
        low[:, 0] = np.maximum(low[:, 0], 0.0)
        low[:, 1:], high[:, 1:] = np.maximum(low[:, 1:], -shear), np.minimum(high[:, 1:], shear)
        borders = []
        for placement in course.placements:
            for r in range(layout.regions):
                patch = placement.candidates[min(r, len(placement.candidates) - 1)]
                border = patch.vertices_m if placement.toe_m is None else placement.toe_m[None]
                borders.append(border / course.length_scale_m)
        given = {name: getattr(scaled, name) for name in ScaledCourse.__dataclass_fields__}
        return cls(**given | {"layout": layout}, low=low, high=high, pieces=tuple(borders))

    def typical(self) -> NarrowedCourse:
        """A plain course of this layout, force boxes as wide as the course's."""
        low, high = (np.tile(bound, (len(self.low), 1)) for bound in (self.course.force_min, self.course.force_max))
        return replace(self, **vars(super().typical()) | {"low": low, "high": high})

    def values(self) -> dict[str, Array | float]:
        """Data of the terms that every model of key frames shares, and every bearing's force box."""
        return super().values() | {"bearing_min": self.low, "bearing_max": self.high}

    def only(self, opened: Array) -> NarrowedCourse:
        """The course with these slots open, shape (P, R), of those that there are."""
        return replace(self, opened=self.opened * np.ravel(opened))

    def halved(self, slot: int) -> list[NarrowedCourse]:
        """Two courses whose pieces of this slot cover its piece."""
        return [self._with_piece(slot, part) for part in cut(self.pieces[slot], *halving_chord(self.pieces[slot]))]

    def split(self, bearing: int, axis: int, value: float) -> list[NarrowedCourse]:
        """Two courses: this component of a bearing's force up to the value, and from it on."""
        high, low = self.high.copy(), self.low.copy()
        high[bearing, axis] = low[bearing, axis] = value
        return [replace(self, high=high), replace(self, low=low)]

    def size(self, slot: int) -> float:
        """Largest distance of two points of a slot's piece."""
        piece = self.pieces[slot]
        return float(np.max(np.linalg.norm(piece[:, None] - piece[None], axis=-1)))

    def _with_piece(self, slot: int, piece: Array) -> NarrowedCourse:
        vertices = self.vertices.copy()
        vertices[slot] = padded(piece, self.layout.vertices)
        return replace(self, vertices=vertices, pieces=(*self.pieces[:slot], piece, *self.pieces[slot + 1 :]))


class NarrowedLift(LiftedCourse):
    """The lift with a force box for every bearing."""

    def __init__(self, layout: Layout, typical: NarrowedCourse) -> None:
        course = typical.course
        body = Body(layout.frames * layout.limbs, layout.frame_of_limbs)
        toes = Toes(layout.slots, layout.vertices, layout.toe_of_slots)
        forces, position = BoxedForces(layout, toes), toes.position()
        named: dict[str, cp.Constraint] = {
            "balance": forces.balance(),
            "moment": forces.moment(body, layout.frame_of_stances) == 0,
            "reach": body.within_reach(layout.toe_of_limbs @ position),
            **Steps(layout).limits(body, position),
        }
        constraints = [
            *named.values(), *toes.on_patches(), forces.in_cones(), *forces.in_box(shear=True), *body.within_limits(),
        ]  # fmt: skip
        if layout.regions > 1:
            constraints.append(Candidates(layout).only_open(toes))
        cost = objective(layout, course.weights, course.length_scale_m, body, position)
        self._layout, self._soft = layout, False
        self._model = ConicModel(
            cp.Problem(cp.Minimize(cost), constraints), equilibrate=lifted_values(typical), duals=named
        )


class BoxedForces(LiftedForces):
    """Forces of the lift whose bounds are each bearing's own."""

    def __init__(self, layout: Layout, toes: Toes) -> None:
        super().__init__(layout, toes)
        bearings = len(layout.bearing[0])
        self._bearing = one_hot(np.repeat(np.arange(bearings), layout.regions * layout.vertices), bearings)
        self._least = cp.Parameter((bearings, 3), name="bearing_min")
        self._most = cp.Parameter((bearings, 3), name="bearing_max")

    def in_box(self, *, shear: bool) -> list[cp.Constraint]:
        """λ_u f_min ≤ f_u ≤ λ_u f_max; shear: for the shear components, too."""
        share = cp.vec(self._pieces @ self._toes.weights, order="C")
        found: list[cp.Constraint] = []
        for k, axis in enumerate(self._axes if shear else self._axes[:1]):
            component = self._along(axis)
            found.append(component <= cp.multiply(self._bearing @ self._most[:, k], share))
            found.append(component >= cp.multiply(self._bearing @ self._least[:, k], share))
        return found
