"""Posture problems of one robot in non-dimensional numbers, and points of them, many at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.motion import Motion
from ..answer.plan import Plan
from ..arguments import cached_property
from ..files.arrays import Array, locked
from ..problem import PostureBatch, Problem
from ..problem.problem import made
from .layout import Index
from .scaled import Scaled, skew


@dataclass(frozen=True, kw_only=True, eq=False)
class ScaledBatch:
    """B problems that differ from ``like`` in their patches alone.

    Arguments:
        vertices: v_u, shape (B, N, U, 3).
        frames: R_WC, (B, N, 3, 3).
        friction: (B, N).
    """

    like: Scaled
    vertices: Array
    frames: Array
    friction: Array

    @classmethod
    def of(cls, batch: PostureBatch, like: Scaled | None = None) -> ScaledBatch:
        """Scale a batch.

        Arguments:
            like: that of a batch of the same ``like`` and as many corners, where there was one.
        """
        if like is None:
            like, corners = Scaled.of(batch.like), (batch.vertices_m.shape[2],)
            like = replace(
                like, layout=replace(like.layout, corners=(corners,) * len(like.friction))
            )
        return cls(
            like=like,
            vertices=(batch.vertices_m - like.origin_m) / like.length_m,
            frames=batch.frames,
            friction=batch.friction,
        )

    def __len__(self) -> int:
        return len(self.friction)

    def select(self, chosen: Index) -> ScaledBatch:
        """Some of them, by index."""
        return replace(
            self,
            vertices=self.vertices[chosen],
            frames=self.frames[chosen],
            friction=self.friction[chosen],
        )

    def held(self, toes: Array) -> ScaledBatch:
        """Batch with patches of one point each.

        Arguments:
            toes: shape (B, N, 3).
        """
        return replace(self, vertices=np.broadcast_to(toes[:, :, None], self.vertices.shape))

    def problem(self, index: int) -> Scaled:
        """One problem; all share one layout, and quantities that are computed for all at once."""
        shared, (implied, bearing, arms) = self._shared, self._of_each
        scaled = object.__new__(Scaled)
        vars(scaled).update(
            shared,
            vertices=self.vertices[index].reshape(-1, 3),
            frames=self.frames[index],
            friction=self.friction[index],
            box_implied=implied[index],
            bearing_vertices=bearing[index],
            arms=arms[index],
        )
        return scaled

    @cached_property
    def near_corners(self) -> Array:
        """Corner of every patch that is nearest to its limb's shoulder, c and Θ nominal, shape (B,
        N, 3).
        """
        away = self.vertices - (self.like.com[0] + self.like.shoulders)[:, None]
        nearest = np.vecdot(away, away).argmin(axis=2)
        return np.asarray(
            np.take_along_axis(self.vertices, nearest[:, :, None, None], axis=2)[:, :, 0]
        )

    @cached_property
    def _shared(self) -> dict[str, Any]:
        """Numbers that are the same in every problem."""
        return {each.name: getattr(self.like, each.name) for each in fields(Scaled)} | {
            "numbers": self.like.numbers
        }

    @cached_property
    def _of_each(self) -> tuple[list[bool], Array, Array]:
        """``box_implied``, ``bearing_vertices`` and ``arms`` of every problem."""
        vertex = self.like.layout.contact_vertices[1]
        bearing = self.vertices.reshape(len(self), -1, 3)[:, vertex]
        arms = np.matmul(skew(bearing), self.frames[:, self.like.layout.vertex_candidates[vertex]])
        return self.like.boxes_implied(self.friction), bearing, arms

    def plans(self, points: PointBatch, problems: Sequence[Problem]) -> list[Plan]:
        """Give the points of these problems, one each, their units back.

        Arguments:
            problems: in units.
        """
        forces = np.matmul(self.frames, points.forces[..., None])[..., 0] * self.like.force_n
        com, toes = self.like.places_m(points.com), self.like.places_m(points.toes)
        rest: dict[str, Any] = dict.fromkeys(("points_m", "point_forces_n", "joints_rad", "modes"))
        rest |= {"choice": locked(self.like.numbers), "provenance": {}}
        com, rotation, toes, forces = locked((com, points.rotation.copy(), toes, forces))
        return [
            made(
                Motion,
                problem=problem,
                com_m=com[k : k + 1],
                rotation_rad=rotation[k : k + 1],
                toes_m=toes[k],
                forces_n=forces[k : k + 1],
                **rest,
            )
            for k, problem in enumerate(problems)
        ]

    def pairs(self, postures: Sequence[Plan]) -> Array:
        """[p, f] of postures, one a problem: ``Scaled.point`` of each, shape (B, N, 6)."""
        shape = (len(postures), *self.friction.shape[1:], 3)
        com = np.array([posture.com_m for posture in postures]).reshape(-1, 1, 3)
        toes = np.array([posture.toes_m for posture in postures]).reshape(shape)
        forces = np.array([posture.forces_n for posture in postures]).reshape(shape)
        turned = np.matmul(self.frames.swapaxes(2, 3), forces[..., None])[..., 0]
        return np.concatenate(
            [(toes - com) / self.like.length_m, turned / self.like.force_n], axis=2
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PointBatch:
    """Points of B posture problems with N contacts, as in ``Point``.

    Arguments:
        com, rotation: shape (B, 3).
        toes: (B, N, 3).
        forces: contact frames, (B, N, 3).
    """

    com: Array
    rotation: Array
    toes: Array
    forces: Array

    @classmethod
    def none(cls, contacts: int) -> PointBatch:
        """Empty batch."""
        nothing, each = np.zeros((0, 3)), np.zeros((0, contacts, 3))
        return cls(com=nothing, rotation=nothing, toes=each, forces=each)

    @classmethod
    def joined(cls, parts: Sequence[PointBatch]) -> PointBatch:
        """All of these, one after the other."""
        return cls(
            **{
                f.name: np.concatenate([getattr(part, f.name) for part in parts])
                for f in fields(cls)
            }
        )

    def __len__(self) -> int:
        return len(self.com)

    def select(self, chosen: Index | NDArray[np.bool_]) -> PointBatch:
        """Some of them."""
        return PointBatch(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})

    def legs(self, like: Scaled) -> Array:
        """p_w − c − (I + [Θ]×) s of every limb (E11), shape (B, N, 3)."""
        turned = np.matmul(skew(self.rotation)[:, None], like.shoulders[..., None])[..., 0]
        return np.asarray(self.toes - self.com[:, None] - like.shoulders - turned)


LIMITS = ("friction", "force", "reach", "body")
"""Kinds of limits: friction cones, bounds of the normal force, reach of the limbs, and the room of
the centre of mass."""


def slacks(
    scaled: ScaledBatch, points: PointBatch, half_spaces: list[tuple[Array, Array]]
) -> Array:
    """The least room per kind of limit, shape (B, len(``LIMITS``)), non-dimensional: of friction
    and force in units of the force scale, of reach and body in units of the length scale.

    Arguments:
        half_spaces: of reach, normals (K, 3) and bounds (K,) per limb.
    """
    one, forces = scaled.like, points.forces
    tangent = np.hypot(forces[..., 1], forces[..., 2])
    friction = (scaled.friction * forces[..., 0] - tangent).min(axis=1)
    force = np.minimum(
        one.force_max[:, 0] - forces[..., 0], forces[..., 0] - one.force_min[:, 0]
    ).min(axis=1)
    legs = points.legs(one)
    reach = (one.reach - np.linalg.norm(legs, axis=-1)).min(axis=1)
    local = points.toes - points.com[:, None]
    for limb, (normals, bounds) in enumerate(half_spaces):
        if len(bounds):
            back = local[:, limb] + np.cross(local[:, limb], points.rotation)  # (I − [Θ]×) p
            reach = np.minimum(reach, (bounds - back @ normals.T).min(axis=-1))
    body = one.com_radius[0] - np.linalg.norm(points.com - one.com[0], axis=-1)
    return np.stack([friction, force, reach, body], axis=-1)
