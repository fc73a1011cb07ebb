"""Patterns of sparse matrices by columns."""

from __future__ import annotations

import numpy as np

from ..files.columns import Columns as Columns
from .layout import Index


def pattern_of(rows: Index, columns: Index, shape: tuple[int, int]) -> Columns:
    """A matrix of zeros at these entries, which are sorted by columns."""
    indptr = np.searchsorted(columns, np.arange(shape[1] + 1))
    return Columns(np.zeros(len(rows)), rows.astype(np.int32), indptr.astype(np.int32), shape)
