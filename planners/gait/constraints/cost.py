"""Objective of a second phase: acceleration and force rate, and the distance from a reference (E(c)
of W1).

Non-dimensional: accelerations in g, moments in m·g·(stand height), force rates in m·g a second,
integrated over time.
"""

from __future__ import annotations

import casadi as cs
import numpy as np
from scipy.sparse import csr_array, vstack

from ..transcription.blocks import Block
from ..transcription.taylor import ExpansionPoint
from ..variables import Structure
from .dynamics import UP, inertia_block


def acceleration(structure: Structure) -> Block:
    """A part of E(c) (W1): ∫ ‖p̈/g‖² + ‖d/dt (R I ω)‖² dt as a sum over the nodes; one row."""
    nodes = np.arange(structure.nodes)
    inner = inertia_block(structure, nodes, np.zeros((len(nodes), 1), dtype=np.intp))
    step_s = structure.settings.step_s

    def kernel(features: list[cs.SX], expansions: list[ExpansionPoint | None]) -> cs.SX:
        felt = -inner.kernel(features, expansions) - cs.DM([*UP, 0.0, 0.0, 0.0])
        return step_s * cs.sumsqr(felt)

    return Block(kernel, inner.selections, inner.scatter, inner.order)


def force_rate(structure: Structure) -> csr_array:
    """Rows r with ‖r x‖² = Σ_i ∫ ‖d f̄_i/dt‖² dt, by the middles of the steps."""
    step_s = structure.settings.step_s
    middles = structure.times_s[:-1] + 0.5 * step_s
    rows = [structure.layout.force_rows(foot, middles, order=1) for foot in range(structure.feet)]
    return csr_array(np.sqrt(step_s) * vstack(rows))
