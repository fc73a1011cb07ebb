"""Posture problems of one robot as tensors: what proposals are made of, and what they are measured
by.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.features import ROOM

from ..selectors.network import SceneTensors


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenes:
    """B problems of N contacts on triangles that differ in their patches alone, non-dimensional
    (``Scaled``).

    Arguments:
        vertices: (B, N, 3, 3).
        frames: (B, N, 3, 3), columns n, y, z.
        friction: (B, N).
        shoulders: (N, 3).
        reach: (N,).
        com: nominal, (3,).
        normal: least and most f_n of every contact, (2, N).
        com_radius, tilt, weight: numbers.
    """

    vertices: Tensor
    frames: Tensor
    friction: Tensor
    shoulders: Tensor
    reach: Tensor
    com: Tensor
    normal: Tensor
    com_radius: float
    tilt: float
    weight: float

    @classmethod
    def of(cls, scaled: ScaledBatch, dtype: torch.dtype = torch.float32) -> Scenes:
        """The problems of a batch.

        Arguments:
            dtype: single precision to learn in, double to propose in.
        """
        like = scaled.like

        def tensor(values: object) -> Tensor:
            return torch.tensor(np.asarray(values), dtype=dtype)

        return cls(
            vertices=tensor(scaled.vertices),
            frames=tensor(scaled.frames),
            friction=tensor(scaled.friction),
            shoulders=tensor(like.shoulders),
            reach=tensor(like.reach),
            com=tensor(like.com[0]),
            normal=tensor(
                [np.maximum(like.force_min[:, 0], 0.0), np.maximum(like.force_max[:, 0], 0.0)]
            ),
            com_radius=float(like.com_radius[0]),
            tilt=like.tilt,
            weight=like.weight,
        )

    def __len__(self) -> int:
        return len(self.friction)

    def __getitem__(self, rows: Tensor | slice) -> Scenes:
        return replace(
            self,
            vertices=self.vertices[rows],
            frames=self.frames[rows],
            friction=self.friction[rows],
        )

    def observed(self) -> SceneTensors:
        """View of the same problems that a policy gets, single precision."""

        def seen(values: Tensor, room: float = ROOM) -> Tensor:
            return values.clamp(-room, room).float()

        each = (len(self), *self.shoulders.shape)
        return SceneTensors(
            vertices=seen(self.vertices),
            frames=seen(self.frames, 1.0),
            friction=seen(self.friction),
            shoulders=seen(self.shoulders).expand(each),
            reach=seen(self.reach).expand(each[:2]),
        )
