"""The structure of a posture or a plan: who stands where, who carries, on how many candidates.

Rows, in the order in which arrays have them:

* foothold: a toe put down by a limb; it stays until the limb's next one. P of them, M key frames, N limbs;
* candidate: a patch that a foothold may be on, K in all, by foothold;
* vertex: of a candidate, V in all, by candidate;
* stance: a set of limbs that must carry the robot alone at a frame, S of them;
* stance contact: a limb that carries in a stance, B in all, by stance; of a sole each of its points is one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import attrgetter
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, cached_arrays

Index = NDArray[np.int_]
LIFTED = -1
"""In place of a foothold: the limb stands on nothing at that frame."""


@dataclass(frozen=True)
class Layout:
    """Shape that decides the rows and columns of a program; programs of equal layouts differ in
    their numbers only.

    Arguments:
        holds: the foothold under each limb at each frame, LIFTED where there is none, (M, N).
        stances: (frame, limbs) of each.
        corners: how many vertices each open candidate has, by foothold.
        reach_rows: how many half-spaces each limb's reach has, by limb; empty where none has any.
        points: how many each limb's foot has; empty where all are point feet.
        linear: how many further rows a step of the body has (``problem.limits.LINEAR``).
        stands: whether toes are drawn to where they are as the robot stands (``Weights.stance``).
        pushes: how often all stances come again at the end, with the same feet and a push that they
            bear.
        wrench: whether forces and moments in any direction are on the body beside its weight, not
            pushes alone.
        relative: (limb, other, how many half-spaces) of every pair of feet whose distance is
            limited where the limb moves.
        level: whether the body is never tilted.
        least_toes: whether each step of a toe has a row of least length, which is one of relative
            reach between the foothold before and the one after.
    """

    holds: tuple[tuple[int, ...], ...]
    stances: tuple[tuple[int, tuple[int, ...]], ...]
    corners: tuple[tuple[int, ...], ...]
    reach_rows: tuple[int, ...] = ()
    points: tuple[int, ...] = ()
    relative: tuple[tuple[int, int, int], ...] = ()
    least_toes: bool = False
    linear: int = 0
    pushes: int = 0
    stands: bool = False
    wrench: bool = False
    level: bool = False

    def __hash__(self) -> int:
        return self._hash

    @cached_arrays
    def _hash(self) -> int:
        """Programs are looked up by it at every solve."""
        feet = self.holds, self.stances, self.corners, self.reach_rows, self.points, self.relative
        return hash((*feet, self.pushes, self.wrench))

    @property
    def frames(self) -> int:
        """M."""
        return len(self.holds)

    @property
    def limbs(self) -> int:
        """N."""
        return len(self.holds[0])

    @property
    def footholds(self) -> int:
        """P."""
        return len(self.corners)

    @property
    def loaded(self) -> bool:
        """Tell whether the body bears anything beside its weight: ``Scaled.wrench`` then has a row
        for every stance.
        """
        return self.wrench or self.pushes > 0

    @property
    def unpushed(self) -> int:
        """The number of stances without a push, which come first."""
        return len(self.stances) // (1 + self.pushes)

    @cached_arrays
    def contacts(self) -> tuple[Index, Index, Index]:
        """(stance, limb, foothold) of every stance contact, each of shape (B,)."""
        triples = [
            (index, limb, self.holds[frame][limb])
            for index, (frame, limbs) in enumerate(self.stances)
            for limb in limbs
            for _ in range(self.points[limb] if self.points else 1)
        ]
        stance, limb, foothold = np.array(triples, dtype=np.int_).T
        return stance, limb, foothold

    @cached_arrays
    def contact_points(self) -> Index:
        """Point of its foot that every stance contact is, shape (B,)."""
        limbs = [limb for _, limbs in self.stances for limb in limbs]
        if not self.points:
            return np.zeros(len(limbs), dtype=np.int_)
        return np.array([k for limb in limbs for k in range(self.points[limb])], dtype=np.int_)

    def check_point_feet(self, what: str) -> None:
        """Raise InvalidInput where a foot is a sole.

        Arguments:
            what: is made for point feet alone.
        """
        if self.points:
            raise InvalidInput(
                f"{what}: expected point feet, got soles, which the lift can plan for"
            )

    @cached_arrays
    def row_limbs(self) -> Index:
        """The limb of every half-space of reach, shape (H,)."""
        return np.repeat(np.arange(len(self.reach_rows)), np.array(self.reach_rows, dtype=np.int_))

    @cached_arrays
    def stance_frames(self) -> Index:
        """The frame of every stance, shape (S,)."""
        return np.array([frame for frame, _ in self.stances], dtype=np.int_)

    @cached_arrays
    def standing(self) -> tuple[Index, Index, Index]:
        """(frame, limb, foothold) wherever a limb stands, by frame, then limb, each of shape
        (T,).
        """
        table = np.array(self.holds, dtype=np.int_)
        frame, limb = np.nonzero(table != LIFTED)
        return frame, limb, table[frame, limb]

    @cached_arrays
    def standing_rows(self) -> tuple[Index, Index]:
        """(row in ``standing``, half-space) of every half-space of a limb that stands, by frame;
        each of shape (·,).
        """
        number = np.full((self.frames, self.limbs), LIFTED)
        number[self.standing[:2]] = np.arange(len(self.standing[0]))
        table = number[:, self.row_limbs]
        stands = table != LIFTED
        return table[stands], np.broadcast_to(np.arange(len(self.row_limbs)), table.shape)[stands]

    @cached_arrays
    def moves(self) -> Index:
        """(foothold before, foothold after) of every toe that moves, by frame, then limb; shape
        (moves, 2).

        A limb that is lifted, or that was, takes no step.
        """
        table = np.array(self.holds, dtype=np.int_)
        changed = np.argwhere(
            (table[1:] != table[:-1]) & (table[1:] != LIFTED) & (table[:-1] != LIFTED)
        )
        return np.array(
            [(table[k, i], table[k + 1, i]) for k, i in changed], dtype=np.int_
        ).reshape(-1, 2)

    @cached_arrays
    def relative_pairs(self) -> Index:
        """(foothold of a limb that moved, foothold of the other, which pair of limbs), by frame,
        then the moves whose length has a least; shape (pairs, 3).
        """
        table = np.array(self.holds, dtype=np.int_)
        triples = [
            (table[k + 1, limb], table[k + 1, other], pair)
            for k, i in np.argwhere((table[1:] != table[:-1]) & (table[1:] != LIFTED)).tolist()
            for pair, (limb, other, _) in enumerate(self.relative)
            if limb == i and table[k + 1, other] != LIFTED
        ]
        first = len(self.relative)
        if self.least_toes:
            triples += [(*move, first + k) for k, move in enumerate(self.moves.tolist())]
        return np.array(triples, dtype=np.int_).reshape(-1, 3)

    @cached_arrays
    def relative_rows(self) -> tuple[Index, Index]:
        """(number of its half-space, row in ``relative_pairs``) of every row of relative reach,
        each of shape (R,).
        """
        counts = [n for *_, n in self.relative] + [1] * len(self.moves) * self.least_toes
        which, half_space = _expanded(self.relative_pairs[:, 2], np.array(counts, dtype=np.int_))
        return half_space, which

    @cached_arrays
    def candidate_footholds(self) -> Index:
        """The foothold of every candidate, shape (K,)."""
        return np.repeat(np.arange(self.footholds), [len(counts) for counts in self.corners])

    @cached_arrays
    def vertex_candidates(self) -> Index:
        """The candidate of every vertex, shape (V,)."""
        counts = [count for counts in self.corners for count in counts]
        return np.repeat(np.arange(len(counts)), counts)

    @cached_arrays
    def candidate_starts(self) -> Index:
        """The first vertex of every candidate, shape (K,)."""
        return np.searchsorted(self.vertex_candidates, np.arange(len(self.candidate_footholds)))

    @cached_arrays
    def vertex_footholds(self) -> Index:
        """The foothold of every vertex, shape (V,)."""
        return np.asarray(self.candidate_footholds[self.vertex_candidates])

    @cached_arrays
    def contact_vertices(self) -> tuple[Index, Index]:
        """(stance contact, vertex) for every vertex of every candidate under a contact, each of
        shape (F,).
        """
        return self.under(self.contacts[2])

    @cached_arrays
    def contact_candidates(self) -> tuple[Index, Index]:
        """(stance contact, candidate) for every candidate under a contact, each of shape (Q,)."""
        return _expanded(
            self.contacts[2], np.array([len(counts) for counts in self.corners], dtype=np.int_)
        )

    def under(self, footholds: Index) -> tuple[Index, Index]:
        """(which of these footholds, vertex) for every vertex of their candidates; ``footholds``
        may repeat.
        """
        return _expanded(
            footholds, np.array([sum(counts) for counts in self.corners], dtype=np.int_)
        )


@lru_cache(maxsize=256)
def shared(layout: Layout) -> Layout:
    """The layout, or an equal one met before, whose index arrays are there already."""
    return layout


def _expanded(groups: Index, sizes: Index) -> tuple[Index, Index]:
    """Every member of every group asked for: members are numbered group by group.

    Arguments:
        sizes: of each group.
    """
    starts = np.concatenate([[0], np.cumsum(sizes)])
    counts = sizes[groups]
    which = np.repeat(np.arange(len(groups)), counts)
    within = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    return which, np.asarray(starts[groups[which]] + within)


D = TypeVar("D")


@dataclass(frozen=True, eq=False)
class Of:
    """Values that are numbers of the problem as they are, times a factor.

    Arguments:
        name: of an attribute of the data, dotted.
        index: into it; None: all of it.
    """

    name: str
    index: Any = None
    factor: float = 1.0

    def __neg__(self) -> Of:
        return replace(self, factor=-self.factor)

    def __rmul__(self, factor: float) -> Of:
        return replace(self, factor=factor * self.factor)


Fill: TypeAlias = Callable[[D], Array | float]
"""A function of the problem; its values are broadcast to the block's shape."""
Values: TypeAlias = float | Of | Fill[D]
"""Values of a block."""


class GatheredNumbers:
    """Places of the numbers that some values are made of, laid end to end; the first one is 1.

    Arguments:
        data: any problem, for their shapes.
    """

    def __init__(self, values: Sequence[object], data: object) -> None:
        names = list(dict.fromkeys(one.name for one in values if isinstance(one, Of)))
        several = len(names) > 1  # attrgetter then reads all in one call
        self._read = (
            attrgetter(*names)
            if several
            else lambda data: [attrgetter(name)(data) for name in names]
        )
        self._places, end = {}, 1
        for name, number in zip(names, self._read(data), strict=True):
            numbers = np.asarray(number)
            self._places[name] = end + np.arange(numbers.size).reshape(numbers.shape)
            end += numbers.size

    def of(self, data: object) -> Array:
        """The numbers of a problem."""
        return np.concatenate((1.0, *self._read(data)), axis=None)

    def places(self, values: Of) -> Index:
        """Places of these values."""
        places = self._places[values.name]
        return np.asarray(places if values.index is None else places[values.index])


class Gather(Generic[D]):
    """An array whose entries are numbers of the problem times factors, added up, and values of
    functions.
    """

    def __init__(self, size: int, numbers: GatheredNumbers) -> None:
        self._size, self._numbers = size, numbers
        self._parts: list[tuple[Index, Index, float]] = []
        self._fills: list[tuple[Index, Fill[D]]] = []

    def add(self, at: Index, values: Values[D]) -> None:
        """Add values at these entries, which are all different."""
        if isinstance(values, Of):
            source = self._numbers.places(values)
            self._parts.append(
                (at.ravel(), np.broadcast_to(source, at.shape).ravel(), values.factor)
            )
        elif isinstance(values, int | float):
            self._parts.append((at.ravel(), np.zeros(at.size, dtype=np.int_), values))
        else:
            self._fills.append((at, values))

    @cached_property
    def _once(self) -> tuple[Index, Index, Array, bool]:
        """(entry, number, factor) of all parts, and whether every entry is met once, in order."""
        nothing = np.zeros(0, dtype=np.int_)
        at = np.concatenate([nothing, *(part[0] for part in self._parts)])
        source = np.concatenate([nothing, *(part[1] for part in self._parts)])
        factor = np.concatenate(
            [nothing, *(np.full(len(at), factor) for at, _, factor in self._parts)]
        )
        order = np.argsort(at, kind="stable")
        whole = np.array_equal(at[order], np.arange(self._size))
        return at[order], source[order], factor[order].astype(np.float64), whole

    @cached_property
    def constant(self) -> Array | None:
        """The array, where it is the same for every problem."""
        at, source, factor, _ = self._once
        return (
            None
            if self._fills or source.any()
            else np.bincount(at, factor, minlength=self._size).astype(np.float64)
        )

    def load(self, numbers: Array, data: D) -> Array:
        """The array for this problem."""
        if self.constant is not None:
            return self.constant
        at, source, factor, whole = self._once
        values = numbers[source]
        values *= factor
        out = (
            values
            if whole
            else np.bincount(at, values, minlength=self._size).astype(np.float64, copy=False)
        )
        for entries, fill in self._fills:
            out[entries] += fill(data)
        return out
