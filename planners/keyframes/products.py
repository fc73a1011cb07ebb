"""Key frames with m = p f of every bearing as variables (paper E eqs. 8 and 9): what P1 and MICP have in common.

The forces of m are measured in the axes of its *box*: the contact frame where all candidates of a toe share one, which
is what envelopes are learned in, or world axes, in which candidates of different slopes can be compared.
"""

from __future__ import annotations

from typing import Literal

import cvxpy as cp
import numpy as np

from ..arrays import Array
from ..contact.terms import Body, Toes, friction_cones
from ..outcome import InvalidInput
from ..relaxation.envelope import Envelope
from .layout import Layout, one_hot
from .scaled import ScaledCourse
from .terms import Candidates, Steps

Axes = Literal["contact", "world"]


class Products:
    """Every term of a course but m = p f and the objective, for one layout.

    position, box_forces: [p, f] of every bearing, (B, 3) each; moments: m_jk in column 3j + k, (B, 9).
    """

    def __init__(self, layout: Layout, axes: Axes) -> None:
        pieces, bearings = len(layout.piece_slots), len(layout.bearing[0])
        self.body = Body(layout.frames * layout.limbs, layout.frame_of_limbs)
        self.toes = Toes(layout.slots, layout.vertices, layout.toe_of_slots)
        self.forces = cp.Variable((pieces, 3), name="forces")
        self.position = cp.Variable((bearings, 3), name="position")
        self.moments = cp.Variable((bearings, 9), name="moments")
        turns = turned(layout, axes)
        self.box_forces = cp.Variable((bearings, 3), name="box_forces") if turns else self.forces
        self._box_axes = [cp.Parameter((bearings, 3), name=f"box_axes_{k}") for k in range(3)]
        self.on_toes = self.toes.position()
        self.constraints = [
            *self._patches(layout), *self.body.within_limits(), *self._cones(layout),
            self.body.within_reach(layout.toe_of_limbs @ self.on_toes),
            *Steps(layout).limits(self.body, self.on_toes).values(),
            *self._balances(layout, axes), *(self._turned(layout) if turns else []),
        ]  # fmt: skip

    def _patches(self, layout: Layout) -> list[cp.Constraint]:
        stance, _, placement = layout.bearing
        frame = np.array([k for k, _ in layout.stances])[stance]
        legs = one_hot(placement, layout.placements) @ self.on_toes - one_hot(frame, layout.frames) @ self.body.com
        closed = [Candidates(layout).only_open(self.toes)] if layout.regions > 1 else []
        return [*self.toes.on_patches(), *closed, self.position == legs]  # p of eq. 2

    def _cones(self, layout: Layout) -> list[cp.Constraint]:
        """Cone and force box of every piece, as large as its slot's share of the toe."""
        friction = cp.Parameter(len(layout.piece_slots), name="friction")
        low, high = cp.Parameter(3, name="force_min"), cp.Parameter(3, name="force_max")
        share = layout.slot_of_pieces @ self.toes.shares()
        rows = [friction_cones(self.forces, friction)]
        for k in range(3) if layout.whole_box else (0,):
            rows += [self.forces[:, k] <= high[k] * share, self.forces[:, k] >= low[k] * share]
        return rows

    def _balances(self, layout: Layout, axes: Axes) -> list[cp.Constraint]:
        """Eq. 5 and eq. 9 in every stance: the forces and the rows of m turned to world axes, added up."""
        force = self._in_world(self.box_forces, axes)
        by_p = [self._in_world(self.moments[:, 3 * j : 3 * j + 3], axes) for j in range(3)]  # p_j F
        net = [by_p[i][j] - by_p[j][i] for i, j in ((1, 2), (2, 0), (0, 1))]  # (p × F)_k
        up = np.tile([[0.0], [0.0], [1.0]], (1, len(layout.stances)))
        return [
            cp.vstack([_by_stance(part, layout) for part in force]) == up,
            cp.vstack([_by_stance(part, layout) for part in net]) == 0,
        ]

    def _in_world(self, vectors: cp.Expression, axes: Axes) -> list[cp.Expression]:
        """Components in world axes of a vector a bearing in its box's axes, three of shape (B,)."""
        if axes == "world":
            return [vectors[:, k] for k in range(3)]
        return [cp.sum(cp.multiply(axis, vectors), axis=1) for axis in self._box_axes]

    def _turned(self, layout: Layout) -> list[cp.Constraint]:
        """The forces of a bearing, those of its pieces added up in the axes of its box."""
        bearings = len(layout.bearing[0])
        added = one_hot(np.repeat(np.arange(bearings), layout.regions), bearings).T
        turns = [cp.Parameter((bearings * layout.regions, 3), name=f"turn_{k}") for k in range(3)]
        return [
            self.box_forces[:, k] == added @ cp.sum(cp.multiply(turn, self.forces), axis=1)
            for k, turn in enumerate(turns)
        ]


def _by_stance(part: cp.Expression, layout: Layout) -> cp.Expression:
    """Sums over the bearings of every stance, shape (S,). cvxpy is slow in multiplying data by a constant matrix."""
    counts = {len(limbs) for _, limbs in layout.stances}
    if len(counts) == 1:  # bearings are in order of stance
        return cp.sum(cp.reshape(part, (len(layout.stances), counts.pop()), order="C"), axis=1)
    return one_hot(layout.bearing[0], len(layout.stances)).T @ part


def turned(layout: Layout, axes: Axes) -> bool:
    """Whether a box's forces are variables of their own, not those of the one piece of the bearing."""
    return layout.regions > 1 or axes == "world"


def box_frames(scaled: ScaledCourse, axes: Axes) -> Array:
    """The axes of every bearing's box in the world, in columns, shape (B, 3, 3). Raises InvalidInput."""
    layout = scaled.layout
    _, limb, placement = layout.bearing
    if axes == "world":
        return np.broadcast_to(np.eye(3), (len(placement), 3, 3))
    frames = scaled.frames.reshape(layout.placements, layout.regions, 3, 3)
    off = np.abs(frames - frames[:, :1]).max(axis=(1, 2, 3))  # padding repeats a candidate
    for row in np.flatnonzero(off[placement] > 1e-6):
        frame, name = scaled.course.placements[placement[row]].frame, scaled.course.robot.limb_names[limb[row]]
        raise InvalidInput(
            f"frame {frame}, limb {name}: expected candidate patches that share one contact frame, for boxes on the "
            "forces in it; got several: use boxes in world axes, or one candidate"
        )
    return np.asarray(frames[placement, 0])


def product_values(scaled: ScaledCourse, frames: Array) -> dict[str, Array | float]:
    """Data of ``Products``; frames: of ``box_frames``."""
    layout = scaled.layout
    slots = layout.piece_slots
    turns = np.matmul(np.repeat(frames, layout.regions, axis=0).transpose(0, 2, 1), scaled.frames[slots])
    return (
        scaled.values()
        | {"force_min": scaled.course.force_min, "force_max": scaled.course.force_max}
        | {f"turn_{k}": turns[:, k] for k in range(3)}
        | {f"box_axes_{k}": frames[:, k] for k in range(3)}
        | {"friction": scaled.friction[slots]}
    )


def domain_of(scaled: ScaledCourse, axes: Axes) -> Envelope:
    """Bounds on [p, f] of every bearing that the course implies.

    p: open patches against the ball of the centre of mass, met with the shoulder's reach at any tilt. f: the force box
    met with the cone's, over the open patches; in world axes the box around those boxes.
    """
    course, layout = scaled.course, scaled.layout
    stance, limb, placement = layout.bearing
    frame = np.array([k for k, _ in layout.stances])[stance]
    shape = (layout.placements, layout.regions, layout.vertices, 3)
    opened = scaled.opened.reshape(shape[:2])[..., None, None] > 0.0
    low, high = (np.where(opened, scaled.vertices.reshape(shape), worst) for worst in (np.inf, -np.inf))
    radius, scale = scaled.com_radius[frame][:, None], course.length_scale_m
    shoulders = np.stack([one.shoulder_m for one in course.robot.limbs])[limb] / scale
    reach = np.array([[one.reach_m] for one in course.robot.limbs])[limb] / scale
    size = np.abs(shoulders)
    reach = reach + course.tilt_limit_rad * (size.sum(axis=1, keepdims=True) - size)  # |(Θ × v)_j| ≤ tilt Σ |v_k|
    p_low = np.maximum(low.min(axis=(1, 2))[placement] - scaled.com[frame] - radius, shoulders - reach)
    p_high = np.minimum(high.max(axis=(1, 2))[placement] - scaled.com[frame] + radius, shoulders + reach)
    f_low, f_high = _force_domain(scaled, axes)
    return Envelope.from_vector(np.concatenate([np.hstack([p_low, f_low]), np.hstack([p_high, f_high])], axis=None))


def _force_domain(scaled: ScaledCourse, axes: Axes) -> tuple[Array, Array]:
    """Bounds on the forces of every bearing in its box's axes, (B, 3) each."""
    course, layout = scaled.course, scaled.layout
    slots, normal = layout.piece_slots, max(float(course.force_max[0]), 0.0)
    friction = scaled.friction[slots]
    cone = normal * np.column_stack([np.ones_like(friction), friction, friction])
    low, high = np.maximum(course.force_min, cone * [0.0, -1.0, -1.0]), np.minimum(course.force_max, cone)
    if axes == "world":
        turn = scaled.frames[slots]
        middle = np.matmul(turn, 0.5 * (low + high)[..., None])[..., 0]
        half = np.matmul(np.abs(turn), 0.5 * (high - low)[..., None])[..., 0]
        low, high = middle - half, middle + half
    opened = scaled.opened[slots][:, None] > 0.0
    low = np.where(opened, low, np.inf).reshape(-1, layout.regions, 3).min(axis=1)
    high = np.where(opened, high, -np.inf).reshape(-1, layout.regions, 3).max(axis=1)
    return low, high
