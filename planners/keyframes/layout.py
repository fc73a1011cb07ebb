"""What of a course decides the shape of a compiled model, and the constant selections between its rows.

Rows, in the order in which arrays have them:

* slot: a candidate patch of a placement, P·R of them (R candidates, padded with closed ones);
* bearing: a limb that carries in a stance;
* piece: a bearing on one of its toe's slots.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..arrays import Array
from ..scene.course import Course

Index = NDArray[np.int_]


@dataclass(frozen=True)
class Layout:
    """The structure of a course; equal layouts share a compiled model.

    holds: the placement under each limb at each frame, (M, N); stances: (frame, limbs) of each.
    regions: R; vertices: U, the most that a patch has. whole_box: whether the shear bounds need rows of their own.
    """

    holds: tuple[tuple[int, ...], ...]
    stances: tuple[tuple[int, tuple[int, ...]], ...]
    regions: int
    vertices: int
    whole_box: bool

    @classmethod
    def of(cls, course: Course) -> Layout:
        """Layout of a course."""
        patches = [patch for placement in course.placements for patch in placement.candidates]
        shear = min(float(course.force_max[1:].min()), float(-course.force_min[1:].max()))
        return cls(
            holds=tuple(tuple(int(index) for index in row) for row in course.holds),
            stances=tuple((stance.frame, stance.limbs) for stance in course.stances),
            regions=max(len(placement.candidates) for placement in course.placements),
            vertices=max(len(patch.vertices_m) for patch in patches),
            whole_box=max(patch.friction for patch in patches) * float(course.force_max[0]) > shear,
        )

    @property
    def frames(self) -> int:
        """M."""
        return len(self.holds)

    @property
    def limbs(self) -> int:
        """N."""
        return len(self.holds[0])

    @cached_property
    def placements(self) -> int:
        """P."""
        return 1 + max(max(row) for row in self.holds)

    @property
    def slots(self) -> int:
        """P·R."""
        return self.placements * self.regions

    @cached_property
    def bearing(self) -> tuple[Index, Index, Index]:
        """(stance, limb, placement) of every bearing, each of shape (B,)."""
        found = [
            (index, limb, self.holds[frame][limb])
            for index, (frame, limbs) in enumerate(self.stances)
            for limb in limbs
        ]
        stance, limb, placement = np.array(found).T
        return stance, limb, placement

    @cached_property
    def piece_slots(self) -> Index:
        """The slot of every piece, shape (B·R,)."""
        placement = self.bearing[2]
        return np.asarray((placement[:, None] * self.regions + np.arange(self.regions)).ravel())

    @cached_property
    def moves(self) -> Index:
        """(placement before, placement after) of every limb that moves, shape (K, 2)."""
        table = np.array(self.holds)
        changed = np.argwhere(table[1:] != table[:-1])
        return np.array([(table[k, i], table[k + 1, i]) for k, i in changed], dtype=np.int_).reshape(-1, 2)

    @cached_property
    def frame_of_limbs(self) -> sp.csr_matrix:
        """The frame of every (frame, limb), shape (M·N, M)."""
        return one_hot(np.repeat(np.arange(self.frames), self.limbs), self.frames)

    @cached_property
    def toe_of_limbs(self) -> sp.csr_matrix:
        """The placement of every (frame, limb), shape (M·N, P)."""
        return one_hot(np.array(self.holds).ravel(), self.placements)

    @cached_property
    def toe_of_slots(self) -> sp.csr_matrix:
        """Whose slots they are, shape (P, P·R)."""
        return sp.csr_matrix(one_hot(np.repeat(np.arange(self.placements), self.regions), self.placements).T)

    @cached_property
    def slot_of_pieces(self) -> sp.csr_matrix:
        """The slot of every piece, shape (B·R, P·R)."""
        return one_hot(self.piece_slots, self.slots)

    @cached_property
    def frame_of_stances(self) -> sp.csr_matrix:
        """The frame of every stance, shape (S, M)."""
        return one_hot(np.array([k for k, _ in self.stances]), self.frames)

    def balances(self, columns_per_bearing: int) -> tuple[tuple[int, ...], sp.csr_matrix]:
        """For ``terms.Equilibrium``: how many force components each stance has, and its frame."""
        sizes = tuple(len(limbs) * columns_per_bearing for _, limbs in self.stances)
        return sizes, self.frame_of_stances

    def split(self, name: str, array: Array) -> dict[str, Array]:
        """A map over all bearings, side by side, shape (3, K·B), as data of its stances: ``name_0`` and so on."""
        width = array.shape[1] // len(self.bearing[0])
        ends = np.cumsum([len(limbs) * width for _, limbs in self.stances])
        return {f"{name}_{s}": part for s, part in enumerate(np.split(array, ends[:-1], axis=1))}


def one_hot(columns: Index, count: int) -> sp.csr_matrix:
    """Rows of zeros and a one, shape (len(columns), count)."""
    rows = np.arange(len(columns))
    return sp.csr_matrix((np.ones(len(columns)), (rows, columns)), shape=(len(columns), count))
