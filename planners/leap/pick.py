"""The next choice of candidates: the best sum of scores under all cuts, over two halves of the
footholds.
"""

from __future__ import annotations

import itertools

import numpy as np

from ..equilibrium.layout import Index
from ..files.arrays import Array
from .cuts import MARGIN, Cut

HEADS = 96
"""Combinations of each half that are looked at in pairs."""
MOST = 8_192
"""Combinations of a half; with more, the worst candidates of every toe are left out."""


class Picker:
    """Choices of one leap, what was tried, and the cuts so far.

    Arguments:
        scores: of every candidate, shape (P, options), −inf where there is none.
        price: what a unit of predicted cost takes off a score.
    """

    def __init__(self, scores: Array, price: float) -> None:
        self._scores, self._price = scores, price
        options = np.isfinite(scores).sum(axis=1)
        free = np.flatnonzero(options > 1)
        self._halves = (free[: (len(free) + 1) // 2], free[(len(free) + 1) // 2 :])
        self._fixed = np.flatnonzero(options == 1)
        self._combos = [_combos(half, scores, options) for half in self._halves]
        self._sums = self._of(scores)
        self._bounds = [sums.copy() for sums in self._sums]
        self._soft: list[tuple[float, Array, Array]] = []
        self._hard: list[tuple[float, Array, Array]] = []
        self.cuts: list[Cut] = []
        self.tried: set[tuple[int, ...]] = set()

    def refute(self, cut: Cut) -> None:
        """Leave out every choice that a cut refutes."""
        constant, (first, second) = self._constant(cut), self._of(cut.table)
        self._hard.append((constant, first, second))
        self.cuts.append(cut)
        for one, other, bound in (
            (first, second, self._bounds[0]),
            (second, first, self._bounds[1]),
        ):
            bound[constant + one + other.min() > MARGIN] = -np.inf

    def charge(self, cut: Cut) -> None:
        """Take what a cut predicts off the score of every choice."""
        constant, (first, second) = self._constant(cut), self._of(cut.table)
        self._soft.append((constant, first, second))
        for one, other, bound in (
            (first, second, self._bounds[0]),
            (second, first, self._bounds[1]),
        ):
            bound -= self._price * np.maximum(constant + one + other.min(), 0.0)

    def best(self) -> Index | None:
        """The untried choice of the best score that no cut refutes; None where none is found."""
        for heads in (HEADS, 8 * HEADS):
            a, b = (_top(bound, heads) for bound in self._bounds)
            if not len(a) or not len(b):
                return None
            value = self._sums[0][a][:, None] + self._sums[1][b]
            for constant, first, second in self._soft:
                value = value - self._price * np.maximum(
                    constant + first[a][:, None] + second[b], 0.0
                )
            for constant, first, second in self._hard:
                value[constant + first[a][:, None] + second[b] > MARGIN] = -np.inf
            order = np.argsort(-value, axis=None, kind="stable")
            for flat in order[: len(self.tried) + 1].tolist():
                i, j = divmod(flat, len(b))
                if value[i, j] == -np.inf:
                    break
                choice = np.zeros(len(self._scores), dtype=np.int_)
                choice[self._halves[0]], choice[self._halves[1]] = (
                    self._combos[0][a[i]],
                    self._combos[1][b[j]],
                )
                if tuple(choice.tolist()) not in self.tried:
                    return choice
        return None

    def allowed(self, choice: Index) -> bool:
        """Tell whether a choice is untried and no cut refutes it."""
        return tuple(choice.tolist()) not in self.tried and all(
            cut.value(choice) <= MARGIN for cut in self.cuts
        )

    def _of(self, table: Array) -> list[Array]:
        """The sums of a table over the combinations of either half."""
        return [
            table[half, combo].sum(axis=1)
            for half, combo in zip(self._halves, self._combos, strict=True)
        ]

    def _constant(self, cut: Cut) -> float:
        """C, and a of the footholds with one candidate."""
        return cut.constant + float(cut.table[self._fixed, 0].sum())


def _combos(half: Index, scores: Array, options: Index) -> Index:
    """Combinations of the candidates of some footholds, shape (·, footholds)."""
    counts = options[half].copy()
    while np.prod(counts, dtype=np.float64) > MOST:
        counts[counts.argmax()] -= 1
    lists = [
        np.argsort(-scores[j], kind="stable")[:count] for j, count in zip(half, counts, strict=True)
    ]
    rows = list(itertools.product(*lists))
    return np.array(rows, dtype=np.int_).reshape(len(rows), len(half))


def _top(values: Array, count: int) -> Index:
    """The places of the largest finite values, at most ``count``."""
    at = np.argpartition(-values, count)[:count] if len(values) > count else np.arange(len(values))
    return np.asarray(at[values[at] > -np.inf])
