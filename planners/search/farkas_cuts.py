"""Farkas cuts: multipliers that refuted one part of the choices, tried on others; what a search
learns from failures.

The bound that multipliers prove (``verify.certificate``) is a constant plus, for each foothold, the
least of a number a candidate. So a table of these says at once which other parts they refute, and
which footholds' candidates are to blame (logic-based Benders).
"""

from __future__ import annotations

import numpy as np

from ..equilibrium.layout import Index
from ..equilibrium.programs import multiplier_shapes
from ..equilibrium.scaled import Scaled
from ..files.arrays import Array
from ..relaxation.lift import LiftAnswer

MARGIN = 1e-3
"""A bound above this, for multipliers of at most 1, is refused by no rounding and no tolerance of
the verifier."""


class FarkasCuts:
    """The cuts found so far on one problem. rows: multipliers, as a leaf of a certificate has
    them.
    """

    def __init__(self, scaled: Scaled) -> None:
        self._scaled = scaled
        self.rows: list[Array] = []
        self.constants = np.zeros(0)
        self.tables = np.zeros((0, scaled.layout.footholds, scaled.options))

    def add(self, row: Array) -> int:
        """Keep multipliers that refuted something; their number."""
        parts = split(self._scaled, row)
        self.rows.append(row)
        self.constants = np.append(self.constants, self._constant(parts))
        self.tables = np.concatenate([self.tables, self._table(parts)[None]])
        return len(self.rows) - 1

    def refuting(self, opened: Array) -> int | None:
        """A cut that refutes these open candidates, shape (P, options), or None."""
        if not self.rows:
            return None
        least = np.where(opened > 0.0, self.tables, np.inf).min(axis=2).sum(axis=1) + self.constants
        best = int(least.argmax())
        return best if least[best] > MARGIN else None

    def relief(self, choice: Index, opened: Array) -> Array:
        """Amounts by which other open candidates of every foothold would weaken the cuts that
        refute a choice, shape (P,).

        Each in shares of what it proves; zeros where none refutes the choice.
        """
        against = self.tables[:, np.arange(len(choice)), choice]
        proved = against.sum(axis=1) + self.constants
        refuting = proved > MARGIN
        best = np.where(opened > 0.0, self.tables[refuting], np.inf).min(axis=2)
        return np.asarray(((against[refuting] - best) / proved[refuting, None]).sum(axis=0))

    def _constant(self, parts: dict[str, Array]) -> float:
        """All of the bound but the toes."""
        scaled, layout, norm = self._scaled, self._scaled.layout, np.linalg.norm
        reach, nu_M = self._pulls(parts), parts["nu_M"]
        pull, twist = -reach.sum(axis=1), -np.cross(scaled.shoulders, reach).sum(axis=1)
        across = np.column_stack(
            [nu_M[:, 1], -nu_M[:, 0], 0.0 * nu_M[:, 0]]
        )  # −ν·(c × e_z) = (−e_z × ν)·c
        np.add.at(pull, layout.stance_frames, scaled.weight * across)
        pushed = 0.0
        if layout.loaded:
            np.add.at(pull, layout.stance_frames, np.cross(scaled.wrench[:, :3], nu_M))
            pushed = float(
                np.sum(parts["nu_F"] * scaled.wrench[:, :3] + nu_M * scaled.wrench[:, 3:])
            )
        step = parts["com_step"] - parts["progress"][:, None] * scaled.direction
        linear = np.matmul(parts["linear_step"][:, None], scaled.linear[..., :6])[:, 0]
        step, turn = step + linear[:, :3], parts["rotation_step"] + linear[:, 3:]
        for slope, change in ((pull, step), (twist, turn)):
            slope[1:] += change
            slope[:-1] -= change
        com_step, toe_step, rotation_step = scaled.steps
        return float(
            np.sum(pull * scaled.com)
            - scaled.weight * parts["nu_F"][:, 2].sum()
            + pushed
            - norm(pull, axis=1) @ scaled.com_radius
            - scaled.tilt * np.abs(twist).sum()
            - np.sum(parts["reach"] * scaled.shoulders)
            - norm(parts["reach"], axis=2).sum(axis=0) @ scaled.reach
            - parts["reach_rows"].sum(axis=0) @ scaled.half_spaces.outer_bounds
            - com_step * norm(parts["com_step"], axis=1).sum()
            - rotation_step * norm(parts["rotation_step"], axis=1).sum()
            - toe_step * norm(parts["toe_step"], axis=1).sum()
            - parts["relative_reach"] @ scaled.relative.bounds[layout.relative_rows[0]]
            + parts["progress"] @ scaled.progress
            - np.sum(parts["linear_step"] * scaled.linear[..., 6])
        )

    def _pulls(self, parts: dict[str, Array]) -> Array:
        """Pull of reach on every toe, its ball and its half-spaces, shape (M, N, 3)."""
        limbs = self._scaled.layout.row_limbs[:, None] == np.arange(self._scaled.layout.limbs)
        rows = (
            parts["reach_rows"][:, :, None, None]
            * limbs[:, :, None]
            * self._scaled.half_spaces.normals[:, None]
        )
        return np.asarray(parts["reach"] + rows.sum(axis=1))

    def _table(self, parts: dict[str, Array]) -> Array:
        """The least that a toe and the forces on it contribute, by foothold and candidate, shape
        (P, options).

        Of the force box only f_n counts here, which makes the bound weaker and never wrong.
        """
        scaled, layout = self._scaled, self._scaled.layout
        pull = np.zeros((layout.footholds, 3))
        np.add.at(pull, np.array(layout.holds).ravel(), self._pulls(parts).reshape(-1, 3))
        np.add.at(pull, layout.moves[:, 1], parts["toe_step"])
        np.add.at(pull, layout.moves[:, 0], -parts["toe_step"])
        row, which = layout.relative_rows
        apart = parts["relative_reach"][:, None] * scaled.relative.normals[row]
        np.add.at(pull, layout.relative_pairs[which, 1], apart)
        np.add.at(pull, layout.relative_pairs[which, 0], -apart)
        value = np.sum(scaled.vertices * pull[layout.vertex_footholds], axis=1)
        contact, vertex = layout.contact_vertices
        stance, candidate = layout.contacts[0][contact], layout.vertex_candidates[vertex]
        nu = parts["nu_F"][stance] + np.cross(
            parts["nu_M"][stance], scaled.bearing_vertices
        )  # ν·(v × F) = (ν × v)·F
        slope = np.matmul(nu[:, None], scaled.frames[candidate])[:, 0]
        along = slope[:, 0] - scaled.friction[candidate] * np.hypot(
            slope[:, 1], slope[:, 2]
        )  # of f_n, in the cone
        normal = np.stack(
            [np.maximum(scaled.force_min[contact, 0], 0.0), scaled.force_max[contact, 0]]
        )
        np.add.at(value, vertex, (along * normal).min(axis=0))
        ends = np.cumsum(np.bincount(layout.vertex_candidates))
        return scaled.by_candidate(np.minimum.reduceat(value, np.r_[0, ends[:-1]]), np.inf)


def of_stance(scaled: Scaled, stance: int, lift: LiftAnswer) -> Array:
    """A certificate's row with the multipliers of one stance alone (``cuts.alone``), and zeros for
    all others.
    """
    row = np.zeros(sum(int(np.prod(shape)) for shape in multiplier_shapes(scaled.layout).values()))
    whole, multipliers = split(scaled, row), split(lift.scaled, lift.multipliers)
    whole["nu_F"][stance], whole["nu_M"][stance] = multipliers["nu_F"][0], multipliers["nu_M"][0]
    frame = scaled.layout.stances[stance][0]
    whole["reach"][frame], whole["reach_rows"][frame] = (
        multipliers["reach"][0],
        multipliers["reach_rows"][0],
    )
    return row


def split(scaled: Scaled, row: Array) -> dict[str, Array]:
    """The groups of a certificate's row by name."""
    shapes = multiplier_shapes(scaled.layout)
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
    parts = np.split(row, ends[:-1])
    return {
        name: part.reshape(shape) for (name, shape), part in zip(shapes.items(), parts, strict=True)
    }
