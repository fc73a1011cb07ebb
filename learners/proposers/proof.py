"""Proofs of infeasibility from the numbers of a network, and the bound that they prove: the dual
half.

The multipliers are ν_F, ν_M of the balances (E5, E6) and r of each limb's reach (E11). They prove
that a problem is infeasible if the minimum of

    ν_F·(Σ C f − w e_z) + ν_M·(Σ q × C f − c × w e_z) + Σ [r·(q − c − s − Θ × s) − ρ‖r‖]

over all q, c, Θ, f that satisfy the other constraints is positive. With ν_M = 0 they prove it even
without the balance of moments. This is the bound of one leaf (``planners.verify.lagrangian``)
except for shear limits and rounding, in a form that gradient descent can be used on.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .scenes import Scenes

OF_CONTACT, OF_BODY = 6, 9
"""Numbers a contact (r twice) and a scene (ν_F, ν_M; ν_F): of a proof with moments and of one
without."""


def multipliers(of_contact: Tensor, of_body: Tensor) -> Tensor:
    """(ν_F, ν_M, r) of unit length, shape (B, 2, 6 + 3N): of a proof with moments, and of one
    without.
    """
    whole = torch.cat([of_body[:, :6], of_contact[..., :3].flatten(1)], dim=1)
    nothing = torch.zeros_like(of_body[:, :3])
    flat = torch.cat([of_body[:, 6:9], nothing, of_contact[..., 3:].flatten(1)], dim=1)
    both = torch.stack([whole, flat], dim=1)
    return torch.as_tensor(both / (torch.linalg.vector_norm(both, dim=-1, keepdim=True) + 1e-9))


def least_values(scenes: Scenes, rows: Tensor) -> Tensor:
    """The least value of the above, shape (B, K), for K rows of multipliers a problem, (B, K, 6 +
    3N).
    """
    force, moment = rows[..., None, None, :3], rows[..., None, None, 3:6]
    pulls = rows[..., 6:].reshape(*rows.shape[:2], -1, 3)  # r, (B, K, N, 3)
    corners = scenes.vertices[:, None]
    along = force + torch.cross(
        moment.expand(*moment.shape[:2], *corners.shape[2:]),
        corners.expand(len(rows), rows.shape[1], *corners.shape[2:]),
        dim=-1,
    )
    works = torch.einsum("bnjk,binuj->binuk", scenes.frames, along)
    least = works[..., 0] - scenes.friction[:, None, :, None] * torch.linalg.vector_norm(
        works[..., 1:], dim=-1
    )
    low, high = scenes.normal[..., None]
    carried = torch.minimum(
        low * least, high * least
    )  # f_n between its limits, the shear against it
    placed = (
        (carried + torch.einsum("binj,bnuj->binu", pulls, scenes.vertices)).amin(dim=-1).sum(dim=-1)
    )
    nu = rows[..., 3:6]
    turn = torch.stack([nu[..., 1], -nu[..., 0], torch.zeros_like(nu[..., 0])], dim=-1)
    pull = scenes.weight * turn - pulls.sum(dim=2)
    twist = torch.cross(scenes.shoulders.expand_as(pulls), pulls, dim=-1).sum(dim=2)
    return torch.as_tensor(
        placed
        + pull @ scenes.com
        - scenes.com_radius * torch.linalg.vector_norm(pull, dim=-1)  # ‖c − c_nominal‖ ≤ com_radius
        - scenes.tilt * twist.abs().sum(dim=-1)  # |Θ_k| ≤ tilt
        - (pulls * scenes.shoulders).sum(dim=(2, 3))
        - torch.linalg.vector_norm(pulls, dim=-1) @ scenes.reach  # ‖q − c − s − Θ × s‖ ≤ ρ
        - scenes.weight * rows[..., 2]
    )
