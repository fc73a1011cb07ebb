"""Data that P1 is loaded with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arguments import cached_property
from ..equilibrium.terms import Given
from ..files.arrays import Array
from .envelope import Corners, Envelope


@dataclass(frozen=True, kw_only=True, eq=False)
class Boxed(Given):
    """Data that P1 is loaded with: boxes over the stance contacts.

    Arguments:
        allowed: which of them a stance may use, (S, E).
    """

    boxes: Sequence[Envelope]
    allowed: Array | None = None

    @cached_property
    def corners(self) -> Corners:
        """Corners of the box, or of all boxes."""
        if len(self.boxes) == 1:
            return self.boxes[0].corners
        parts = zip(*(box.corners for box in self.boxes), strict=True)
        return Corners(*(np.stack(part) for part in parts))
