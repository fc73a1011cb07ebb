"""Sparse matrices by columns, as Clarabel reads them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from .arrays import Array

Index = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class Columns:
    """A sparse matrix by columns, as Clarabel reads one; importing ``scipy.sparse`` takes longer
    than most solves.

    Arguments:
        data, indices: values and rows of the entries, in order.
        indptr: where each column begins and the last one ends.
    """

    data: Array
    indices: Index
    indptr: Index
    shape: tuple[int, int]
    has_canonical_format: ClassVar[bool] = True

    @property
    def columns(self) -> Index:
        """The column of every entry."""
        return np.repeat(np.arange(self.shape[1]), np.diff(self.indptr))

    def transposed_times(self, z: Array) -> Array:
        """A'z."""
        return np.bincount(
            self.columns, self.data * z[self.indices], minlength=self.shape[1]
        ).astype(np.float64, copy=False)
