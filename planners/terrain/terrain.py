"""A terrain: its patches, where toes may stand on them, and its heights. Patches and heights show
one surface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..arguments import cached_property
from ..files.arrays import Array, checked
from .patch import Patch
from .polygon import EDGE_M, UPRIGHT, VOID_M, half_planes

if TYPE_CHECKING:
    from .heightfield import HeightField  # splines are slow to import


@dataclass(frozen=True, eq=False)
class Terrain:
    """One ground, for key frames as patches and for walks as heights.

    Arguments:
        patches: every surface, in order.
        footing: per patch, whether a toe may stand on it; risers, for one, are only in the way.
        footholds: where toes may stand instead: pieces of the patches that keep ``inset_m`` from
            their borders [m].
        rise: rise of the mean ground per metre along x; None between walls, where the way is up.
        figures: what was drawn, by name, in SI units.
        begin_m: point of the ground over which a course begins, shape (3,) [m].
        laid: makes the heights where they go on beyond the patches; without it they are those of
            the patches.
    """

    patches: tuple[Patch, ...]
    footing: tuple[bool, ...]
    footholds: tuple[Patch, ...] | None = None
    inset_m: float = 0.0
    rise: float | None = 0.0
    figures: Mapping[str, float] = field(default_factory=dict)
    begin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    laid: Callable[[], HeightField | None] | None = None

    @property
    def standing(self) -> tuple[tuple[str, Patch], ...]:
        """Surfaces that toes may stand on, each with its name in messages."""
        if self.footholds is not None:
            return tuple((f"foothold {i}", patch) for i, patch in enumerate(self.footholds))
        return tuple(
            (f"terrain patch {i}", self.patches[i])
            for i, footing in enumerate(self.footing)
            if footing
        )

    @property
    def surfaces(self) -> tuple[tuple[Patch, bool], ...]:
        """Every surface, footholds last, and whether a toe may stand on it."""
        pieces = tuple((patch, True) for patch in self.footholds or ())
        return (*zip(self.patches, self.footing, strict=True), *pieces)

    @cached_property
    def heights(self) -> HeightField | None:
        """The surface for walks, its edges rounded (``heightfield.rounded``); None where nothing faces up, as
        between walls.
        """
        if self.laid is not None:
            return self.laid()
        from .heightfield import rounded

        return rounded(self.patches)

    def grid(self, x_m: Array, y_m: Array) -> Array:
        """Heights at grid lines, shapes (n,) and (m,), shape (n, m) [m].

        Of polygons those of the highest one that faces up, edges sharp, or ``VOID_M``.
        """
        places = np.stack(np.meshgrid(x_m, y_m, indexing="ij"), axis=-1)
        if (
            self.footholds is not None and self.heights is not None
        ):  # its patches are pieces of its heights
            return self.heights.height(places)
        heights = np.full(places.shape[:2], -np.inf)
        for patch in self.patches:
            if patch.normal[2] < UPRIGHT:
                continue
            normals, offsets = half_planes(patch.vertices_m[:, :2])
            within = np.all(places @ normals.T <= offsets + EDGE_M, axis=-1)
            lifted = (
                patch.centre_m[2]
                - (places - patch.centre_m[:2]) @ patch.normal[:2] / patch.normal[2]
            )
            heights = np.where(within, np.maximum(heights, lifted), heights)
        return np.where(np.isfinite(heights), heights, VOID_M)

    def with_friction(self, factor: float) -> Terrain:
        """Ground with this factor on every friction."""
        checked(factor, "friction", least=0.0)
        patches, footholds = (
            None
            if each is None
            else tuple(patch.with_friction(factor * patch.friction) for patch in each)
            for each in (self.patches, self.footholds)
        )
        return replace(self, patches=patches or (), footholds=footholds)
