"""A posture problem in non-dimensional numbers (eqs. 3 and 4), stacked over its contacts: what the models are fed.

Lengths are in units of the length scale, forces of the force scale, moments of their product.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..outcome import Posture
from ..scene import PostureBatch, PostureProblem


def skew(vectors: Array) -> Array:
    """[v]×, so that [v]× w = v × w; shape (..., 3) to (..., 3, 3)."""
    out = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class ScaledProblem:
    """The numbers of one posture problem of N contacts whose patches have up to U vertices.

    vertices: v_u, shape (N, U, 3), a shorter border repeats its last vertex; frames: R_WC, shape (N, 3, 3);
    shoulders: shape (N, 3); reach, friction: shape (N,); force_min, force_max: shape (N, 3);
    weight: m·g; com: nominal centre of mass, shape (3,); com_radius, tilt: limits.
    Of a batch, vertices, frames and friction have an axis more, their first one.
    """

    vertices: Array
    frames: Array
    shoulders: Array
    reach: Array
    friction: Array
    force_min: Array
    force_max: Array
    weight: float
    com: Array
    com_radius: float
    tilt: float
    length_m: float = 1.0
    force_n: float = 1.0

    @classmethod
    def of(cls, problem: PostureProblem) -> ScaledProblem:
        """Scale a problem."""
        length_m, force_n = problem.length_scale_m, float(problem.force_scale_n or 1.0)
        contacts = problem.contacts
        most = max(len(contact.patch.vertices_m) for contact in contacts)
        return cls(
            vertices=np.stack([padded(contact.patch.vertices_m, most) for contact in contacts]) / length_m,
            frames=np.stack([contact.patch.frame for contact in contacts]),
            shoulders=np.stack([contact.shoulder_m for contact in contacts]) / length_m,
            reach=np.array([contact.reach_m for contact in contacts]) / length_m,
            friction=np.array([contact.patch.friction for contact in contacts]),
            force_min=np.stack([contact.force_min for contact in contacts]),
            force_max=np.stack([contact.force_max for contact in contacts]),
            weight=problem.weight_n / force_n,
            com=problem.com_nominal_m / length_m,
            com_radius=problem.com_radius_m / length_m,
            tilt=problem.tilt_limit_rad,
            length_m=length_m,
            force_n=force_n,
        )

    @classmethod
    def of_batch(cls, batch: PostureBatch) -> ScaledProblem:
        """Scale a batch; ``one`` gives what ``of`` gives for one of its problems."""
        vertices = batch.vertices_m / batch.like.length_scale_m
        return replace(cls.of(batch.like), vertices=vertices, frames=batch.frames, friction=batch.friction)

    def select(self, chosen: NDArray[np.intp] | int) -> ScaledProblem:
        """Those problems of a batch, or one of them."""
        vertices, frames, friction = (part[chosen] for part in (self.vertices, self.frames, self.friction))
        return replace(self, vertices=vertices, frames=frames, friction=friction)

    @classmethod
    def typical(cls, contacts: int, vertices: int) -> ScaledProblem:
        """A plain scene of this size, limbs on level ground around the body: the data on which solvers are scaled."""
        angle = 2.0 * np.pi * (np.arange(contacts) + 0.5) / contacts
        ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(contacts)])
        corner = 2.0 * np.pi * np.arange(vertices) / vertices
        polygon = 0.1 * np.column_stack([np.cos(corner), np.sin(corner), np.zeros(vertices)])
        return cls(
            vertices=0.5 * ring[:, None] + polygon - np.array([0.0, 0.0, 0.3]),
            frames=np.tile(np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]), (contacts, 1, 1)),
            shoulders=0.3 * ring,
            reach=np.full(contacts, 0.6),
            friction=np.full(contacts, 0.5),
            force_min=np.tile([0.0, -1.0, -1.0], (contacts, 1)),
            force_max=np.ones((contacts, 3)),
            weight=1.0,
            com=np.zeros(3),
            com_radius=0.15,
            tilt=0.25,
        )

    @property
    def size(self) -> tuple[int, int]:
        """(N, U)."""
        return self.vertices.shape[-3], self.vertices.shape[-2]

    @cached_property
    def box_implied(self) -> bool:
        """Whether cone and normal-force limit imply the rest of the force box, so that its rows can be left out."""
        return bool(np.all(self.boxes_implied))

    @property
    def boxes_implied(self) -> NDArray[np.bool_]:
        """``box_implied`` of every problem of a batch, shape (B,)."""
        normal = self.force_max[:, 0]
        shear = self.friction * normal
        implied = (
            (self.friction > 1e-3)  # on ice the cone says nothing of f_n
            & (self.force_min[:, 0] <= 0.0)
            & (normal > 0.0)
            & (shear <= np.minimum(self.force_max[:, 1:], -self.force_min[:, 1:]).min(axis=1))
        )
        return np.asarray(implied.all(axis=-1))

    def narrowed(self, index: int, vertices: Array, force_min: Array, force_max: Array) -> ScaledProblem:
        """The problem with one contact confined to a piece of its patch and of its force box."""
        pieces, low, high = self.vertices.copy(), self.force_min.copy(), self.force_max.copy()
        pieces[index], low[index], high[index] = padded(vertices, self.size[1]), force_min, force_max
        return replace(self, vertices=pieces, force_min=low, force_max=high)

    def values(self) -> dict[str, Array | float]:
        """Data of the terms that every model shares, by parameter name (``terms.py``)."""
        return {
            "shoulders": self.shoulders,
            "reach": self.reach,
            "com_nominal": self.com,
            "com_radius": self.com_radius,
            "tilt": self.tilt,
            "vertices_x": self.vertices[..., 0],
            "vertices_y": self.vertices[..., 1],
            "vertices_z": self.vertices[..., 2],
            "friction": self.friction,
            "force_min": self.force_min,
            "force_max": self.force_max,
            "force_map": side_by_side(self.frames),
            "weight": self.weight,
        }

    def posture(self, *, com: Array, rotation: Array, toes: Array, forces: Array) -> Posture:
        """Give a solution its units back; forces in the contact frames, shape (N, 3)."""
        return Posture(
            com_m=com * self.length_m,
            rotation_rad=rotation,
            toes_m=toes * self.length_m,
            forces_n=np.matmul(self.frames, forces[..., None])[..., 0] * self.force_n,
        )

    def point(self, posture: Posture) -> Array:
        """[p, f] of a posture, the columns p_x p_y p_z f_n f_y f_z: p in world axes, f in the frames; shape (N, 6)."""
        position = (posture.toes_m - posture.com_m) / self.length_m
        forces = np.matmul(self.frames.transpose(0, 2, 1), posture.forces_n[..., None])[..., 0] / self.force_n
        return np.concatenate([position, forces], axis=1)


def side_by_side(blocks: Array) -> Array:
    """Put K blocks of shape (..., K, 3, 3) side by side into one map of shape (..., 3, 3K)."""
    return blocks.swapaxes(-3, -2).reshape(*blocks.shape[:-3], 3, 3 * blocks.shape[-3])


def padded(vertices: Array, count: int) -> Array:
    """A border with its last vertex repeated up to ``count`` vertices."""
    short = count - len(vertices)
    return vertices if short == 0 else np.concatenate([vertices, np.repeat(vertices[-1:], short, axis=0)])
