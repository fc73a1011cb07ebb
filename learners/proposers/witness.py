"""A posture out of a network's numbers, and by how much it breaks its problem: the primal half.

Toes are convex combinations of the corners, c lies in its ball and Θ in its box, whatever the
numbers; forces are moved onto the balances (E5, E6) by the least change. What is left to break are
the friction cones (E10), the limits of the normal forces and the reach (E11).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .scenes import Scenes

INSIDE = 0.999
"""Balls and boxes are made smaller by this factor, so that rounding does not lead out of them."""
FORCE = 0.3
"""Unit of the forces that the network says, non-dimensional."""
OF_CONTACT, OF_BODY = 6, 6
"""Numbers a contact (toe, force) and a scene (c, Θ)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Claims:
    """Postures, one a problem: com, rotation, shape (B, 3); toes, forces in contact frames, (B, N,
    3).

    Arguments:
        violation: of every cone, limit and leg, below 0 where it is met, (B, 4N).
    """

    com: Tensor
    rotation: Tensor
    toes: Tensor
    forces: Tensor
    violation: Tensor


def claims(scenes: Scenes, of_contact: Tensor, of_body: Tensor) -> Claims:
    """Postures from numbers of every contact, (B, N, 6), and every scene, (B, 6)."""
    toes = (torch.softmax(of_contact[..., :3], dim=-1)[..., None] * scenes.vertices).sum(dim=2)
    away = of_body[:, :3] / torch.sqrt(1.0 + (of_body[:, :3] ** 2).sum(dim=-1, keepdim=True))
    com = scenes.com + INSIDE * scenes.com_radius * away
    rotation = INSIDE * scenes.tilt * torch.tanh(of_body[:, 3:])
    share = torch.zeros_like(of_contact[..., 3:])
    share[..., 0] = scenes.weight / toes.shape[1]
    forces = _balanced(scenes, toes, com, share + FORCE * of_contact[..., 3:])
    turned = torch.cross(
        rotation[:, None].expand_as(toes), scenes.shoulders.expand_as(toes), dim=-1
    )
    legs = toes - com[:, None] - scenes.shoulders - turned
    low, high = scenes.normal
    normal = forces[..., 0]
    broken = (
        torch.linalg.vector_norm(forces[..., 1:], dim=-1)
        - scenes.friction * normal,  # ‖(f_y, f_z)‖ ≤ μ f_n
        low - normal,  # f_n ≥ low
        normal - high,  # f_n ≤ high
        torch.linalg.vector_norm(legs, dim=-1) - scenes.reach,  # ‖u‖ ≤ ρ
    )
    return Claims(
        com=com, rotation=rotation, toes=toes, forces=forces, violation=torch.cat(broken, dim=1)
    )


def _balanced(scenes: Scenes, toes: Tensor, com: Tensor, forces: Tensor) -> Tensor:
    """The nearest forces with Σ C f = w e_z and Σ q × C f = w c × e_z, in double precision."""
    arms = torch.cross(toes[..., None].expand_as(scenes.frames), scenes.frames, dim=2)
    rows = torch.cat([scenes.frames, arms], dim=2).transpose(1, 2).flatten(2).double()  # (B, 6, 3N)
    nothing = torch.zeros_like(com[:, 0])
    right = (
        torch.stack([nothing, nothing, nothing + 1.0, com[:, 1], -com[:, 0], nothing], dim=-1)
        * scenes.weight
    )
    flat = forces.flatten(1).double()
    off = right.double() - torch.einsum("brd,bd->br", rows, flat)
    square = rows @ rows.transpose(1, 2) + 1e-10 * torch.eye(6, dtype=torch.float64)
    flat = flat + torch.einsum("brd,br->bd", rows, torch.linalg.solve(square, off))
    return flat.reshape(forces.shape).to(forces.dtype)
