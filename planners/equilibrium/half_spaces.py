"""Half-spaces of reach: their numbers, and the rows that stand in for a·R(Θ)ᵀ(p − c) ≤ b
(``robot.reach``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..files.arrays import Array
from ..problem import Contact
from ..robot.model import Limb, ReachRows, Robot, turned_most
from .layout import Index, Layout, Of
from .rows import Rows


@dataclass(frozen=True, kw_only=True, eq=False)
class HalfSpaces:
    """Non-dimensional numbers of H half-spaces, by limb.

    Arguments:
        normals: a.
        bounds: b. Of the inner sets levers: a × z.
        arms: t(a) U(a), with ‖U(a) x‖ = ‖a × x‖: two rows across a, as long as a.
        offsets: t(a) U(a) z. Of the outer ones outer_levers: a × s.
        outer_bounds: b + t(a) (ρ + t(s)).
    """

    normals: Array  # (H, 3)
    bounds: Array  # (H,)
    levers: Array  # (H, 3)
    arms: Array  # (H, 2, 3)
    offsets: Array  # (H, 2)
    outer_levers: Array  # (H, 3)
    outer_bounds: Array  # (H,)

    @classmethod
    def of(cls, limbs: Sequence[Limb | Contact], length_m: float, tilt_rad: float) -> HalfSpaces:
        """Half spaces of some limbs."""
        parts = [
            (
                rows.normals,
                rows.bounds_m,
                np.tile([*limb.shoulder_m, limb.reach_m, *_centre(limb, rows)], (count, 1)),
            )
            for limb, count in zip(limbs, cls.counts(limbs), strict=False)
            if (rows := limb.reach_rows) is not None
        ]
        if not parts:
            return cls.none()
        normals, bounds, owners = (np.concatenate(part) for part in zip(*parts, strict=True))
        bounds, owners, turned = (
            bounds / length_m,
            owners / length_m,
            turned_most(normals, tilt_rad),
        )
        shoulders, reach, levers = owners[:, :3], owners[:, 3], np.cross(normals, owners[:, 4:])
        arms = turned[:, None, None] * _across(normals)
        return cls(
            normals=normals,
            bounds=bounds,
            levers=levers,
            offsets=(arms @ owners[:, 4:, None])[:, :, 0],
            arms=arms,
            outer_levers=np.cross(normals, shoulders),
            outer_bounds=bounds + turned * (reach + turned_most(shoulders, tilt_rad)),
        )

    @classmethod
    def none(cls) -> HalfSpaces:
        """No half-spaces."""
        line, vectors = np.zeros(0), np.zeros((0, 3))
        return cls(
            normals=vectors,
            bounds=line,
            levers=vectors,
            arms=np.zeros((0, 2, 3)),
            offsets=np.zeros((0, 2)),
            outer_levers=vectors,
            outer_bounds=line,
        )

    @staticmethod
    def counts(limbs: Sequence[Limb | Contact]) -> tuple[int, ...]:
        """Number of half spaces per limb; () where none has any."""
        result = tuple(
            0 if limb.reach_rows is None else len(limb.reach_rows.bounds_m) for limb in limbs
        )
        return result if any(result) else ()


def _across(normals: Array) -> Array:
    """U(a) of vectors of shape (H, 3): with the axis that is least along a, a × e and a × (a × e),
    both as long as a; shape (H, 2, 3).
    """
    axes = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, axes)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    first *= length / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first) / length], axis=1)


def _centre(limb: Limb | Contact, rows: ReachRows) -> Array:
    """z: the middle of the half-spaces, drawn into the ball."""
    out = rows.centre_m - limb.shoulder_m
    return limb.shoulder_m + out * min(1.0, limb.reach_m / max(float(np.linalg.norm(out)), 1e-12))


def within_half_spaces(
    rows: Rows[Any],
    layout: Layout,
    com: Index,
    rotation: Index,
    put_toes: Callable[[Index, Index, float], None],
    inner: bool,
) -> None:
    """a·d + Θ·(a × s) ≤ b + t(a) (ρ + t(s)), the outer set, or a·d + Θ·(a × z) + t(a) ‖a × (d − z)‖
    ≤ b, the inner one.

    The rows are all half-spaces of the limbs that stand, frame by frame; d = p_w − c has columns of
    its own.

    Arguments:
        com, rotation: columns of c and Θ, (M, 3).
        put_toes: see ``terms.Toes``.
    """
    frame, _, foothold = layout.standing
    leg, is_leg = rows.variable("leg", len(frame), 3), rows.equal("leg", len(frame), 3)
    rows.put(is_leg, leg, 1.0)
    rows.put(is_leg, com[frame], 1.0)
    put_toes(is_leg, foothold, -1.0)
    which, row = layout.standing_rows
    rows_of_leg = leg[which]
    if inner and not layout.level:  # else both sets are a·d ≤ b
        cone = rows.cones("reach_rows", len(row), 3)
        at, levers, bounds = cone[:, 0], "levers", "bounds"
        rows.put(cone[:, 1:, None], rows_of_leg[:, None], -Of("scaled.half_spaces.arms", row))
        rows.right(cone[:, 1:], -Of("scaled.half_spaces.offsets", row))
    else:
        at, levers, bounds = rows.at_most("reach_rows", len(row)), "outer_levers", "outer_bounds"
    rows.put(at[:, None], rows_of_leg, Of("scaled.half_spaces.normals", row))
    rows.put(at[:, None], rotation[frame[which]], Of(f"scaled.half_spaces.{levers}", row))
    rows.right(at, Of(f"scaled.half_spaces.{bounds}", row))


def relative_half_spaces(robot: Robot, length_m: float, sides: Array) -> Array:
    """Non-dimensional half-spaces a·(p_other − p_limb) ≤ b, by pair of feet (``robot.reach``), and
    those that sides n·(p′ − p) ≥ b of least steps of toes are: (a, b), shape (G, 4).

    Arguments:
        sides: (n, b), shape (K, 4) [m].
    """
    pairs = [
        np.column_stack([each.rows.normals, each.rows.bounds_m]) for each in robot.relative_reach
    ]
    return np.concatenate([np.zeros((0, 4)), *pairs, -sides]) / [1.0, 1.0, 1.0, length_m]


def pairs_of_feet(robot: Robot) -> tuple[tuple[int, int, int], ...]:
    """``Layout.relative``."""
    number = {name: index for index, name in enumerate(robot.limb_names)}
    return tuple(
        (number[e.limb], number[e.other], len(e.rows.bounds_m)) for e in robot.relative_reach
    )


def within_relative_reach(
    rows: Rows[Any], layout: Layout, put_toes: Callable[[Index, Index, float], None]
) -> None:
    """a·(p_other − p_limb) ≤ b wherever the limb has moved; the difference has columns of its
    own.
    """
    (half_space, which), (moved, other, _) = layout.relative_rows, layout.relative_pairs.T
    apart, is_apart = rows.variable("apart", len(moved), 3), rows.equal("apart", len(moved), 3)
    rows.put(is_apart, apart, 1.0)
    put_toes(is_apart, other, -1.0)
    put_toes(is_apart, moved, 1.0)
    at = rows.at_most("relative_reach", len(half_space))
    rows.put(at[:, None], apart[which], Of("scaled.relative", np.s_[half_space, :3]))
    rows.right(at, Of("scaled.relative", np.s_[half_space, 3]))
