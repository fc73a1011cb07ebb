"""Posture problems of one robot in non-dimensional numbers, many at a time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from ..files.arrays import Array
from ..problem import PostureBatch
from .layout import Index
from .scaled import Scaled


@dataclass(frozen=True, kw_only=True, eq=False)
class ScaledBatch:
    """B problems that differ from ``like`` in their patches alone.

    vertices: v_u, shape (B, N, U, 3); frames: R_WC, (B, N, 3, 3); friction: (B, N).
    """

    like: Scaled
    vertices: Array
    frames: Array
    friction: Array

    @classmethod
    def of(cls, batch: PostureBatch) -> ScaledBatch:
        """Scale a batch."""
        like, corners = Scaled.of(batch.like), (batch.vertices_m.shape[2],)
        layout = replace(like.layout, corners=(corners,) * len(like.friction))
        return cls(
            like=replace(like, layout=layout), vertices=batch.vertices_m / like.length_m, frames=batch.frames,
            friction=batch.friction,
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.friction)

    def select(self, chosen: Index) -> ScaledBatch:
        """Some of them, by index."""
        return replace(self, vertices=self.vertices[chosen], frames=self.frames[chosen], friction=self.friction[chosen])

    @cached_property
    def problems(self) -> list[Scaled]:
        """Each of them; they share one layout."""
        count, contacts, corners, _ = self.vertices.shape
        flat = self.vertices.reshape(count, contacts * corners, 3)
        return [
            replace(self.like, vertices=flat[k], frames=self.frames[k], friction=self.friction[k])
            for k in range(len(self))
        ]
