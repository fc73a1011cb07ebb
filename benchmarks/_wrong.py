"""What of a robot, or of what it stands on, is not as planned: options, and worlds that have it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stancekit import Motion
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.terrain.polygon import clipped, half_planes
from stancekit.runner.acceptance import Accepted
from stancekit.runner.worlds.world import Ground, Imperfections

PAD_M, CORNERS = 0.03, 16
"""Where feet stand at first the ground is as planned: a disc of this radius on patches,"""
LEVEL_M, SLOPE_M = 0.05, 0.05
"""and on heights so far around them; as far again it sinks to what is farther."""


class Asked(Protocol):
    """What of a robot, or its terrain, is not as planned: joints' offsets [deg], delay [ms], shares
    of the rest.
    """

    offset_deg: float
    delay_ms: float
    mass: float
    stiffness: float
    friction: float


@dataclass(frozen=True, kw_only=True)
class Wrong:
    """The same as a world takes it. friction: share of what was counted on. farther_m: how much
    farther away surfaces are than planned, but for where feet stand at first.
    """

    imperfections: Imperfections = field(default_factory=Imperfections)
    friction: float = 1.0
    farther_m: float = 0.0

    @classmethod
    def of(cls, asked: Asked) -> Wrong:
        """From options."""
        imperfections = Imperfections(
            offset_rad=np.deg2rad(asked.offset_deg),
            delay_s=1e-3 * asked.delay_ms,
            mass_share=asked.mass,
            stiffness_share=asked.stiffness,
        )
        return cls(imperfections=imperfections, friction=asked.friction)

    def patches(self, plan: Motion) -> tuple[Patch, ...]:
        """The terrain of a plan's course."""
        patches = slippery(plan.problem, self.friction).terrain
        if self.farther_m == 0.0:
            return patches
        away = (
            patch.with_vertices(patch.vertices_m - self.farther_m * patch.normal)
            for patch in patches
        )
        held = (plan.problem.patch(int(p), plan.choice) for p in plan.problem.holds[0])
        pads = (
            pad(patch, toe, self.friction) for patch, toe in zip(held, plan.toes_at(0), strict=True)
        )
        return (*away, *pads)

    def ground(self, accepted: Accepted) -> Ground:
        """The terrain of a gait."""
        ground = accepted.plan.ground(self.friction)
        if self.farther_m == 0.0:
            return ground
        field, gait = ground.heights, accepted.plan
        return Ground(
            heights=sunk(field, gait.feet_m[0, :, :2], self.farther_m), friction=ground.friction
        )


def pad(patch: Patch, toe_m: NDArray[np.float64], friction: float) -> Patch:
    """The part of a patch around a toe, with this share of its friction."""
    turns = np.linspace(0.0, 2.0 * np.pi, CORNERS, endpoint=False)
    axes, disc = patch.frame[:, 1:], PAD_M * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    inside = clipped(disc, *half_planes((patch.vertices_m - toe_m) @ axes))
    return Patch(
        vertices_m=toe_m + inside @ axes.T,
        normal=patch.normal,
        shear_reference=patch.shear_reference,
        friction=friction * patch.friction,
    )


def sunk(heights: HeightField, feet_m: NDArray[np.float64], by_m: float) -> HeightField:
    """Lower heights, but not about these feet, shape (N, 2) [m]."""
    grid = np.stack(np.meshgrid(heights.x_m, heights.y_m, indexing="ij"), axis=-1)
    away = np.linalg.norm(grid[:, :, None] - feet_m, axis=-1).min(axis=-1)
    share = np.clip((away - LEVEL_M) / SLOPE_M, 0.0, 1.0)
    return HeightField(
        x_m=heights.x_m,
        y_m=heights.y_m,
        heights_m=heights.heights_m - by_m * share,
        name=heights.name,
    )
