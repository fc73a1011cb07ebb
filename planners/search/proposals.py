"""Proposals from elsewhere, postures and proofs in batches: only what the verifier accepts of them
counts.

Whoever proposes needs to know nothing of certificates: it says points and multipliers, right or
wrong, a solver's, a network's or a forger's. What is accepted changes when a problem is decided,
never how: its verdict is the verifier's, and its witness the canonical one.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..answer.certificate import Certificate
from ..equilibrium.batch import PointBatch, ScaledBatch
from ..files.arrays import Array
from ..problem import PostureBatch, Problem
from ..verify import check_certificates, check_postures
from ..verify.half_spaces import row_counts
from .answer import Acceptance
from .canonical import Found, Index, canonical, with_toes

LEAF = np.zeros((1, 5))
"""The tree of a certificate that splits nothing."""


class Proposer(Protocol):
    """Proposer for the problems of one class. digest: of all that its proposals follow from."""

    @property
    def digest(self) -> str:
        """SHA-256 of what it is."""
        ...

    def check_fits(self, problem: Problem) -> None:
        """Raise InvalidInput unless the problem is of the class that this proposes for."""
        ...

    def postures(self, scaled: ScaledBatch) -> tuple[Index, PointBatch]:
        """Claimed points, non-dimensional, for some of the problems, by their indices, ascending;
        right or wrong.
        """
        ...

    def proofs(self, scaled: ScaledBatch) -> Array:
        """Claimed multipliers (ν_F, ν_M, r) of K proofs a problem, the first to be looked at first,
        right or wrong.

        Shape (B, K, 6 + 3N), zeros for none.
        """
        ...


def witnessed(proposer: Proposer, batch: PostureBatch, accept: Acceptance) -> Found:
    """Canonical postures of the problems that accepted postures show to be feasible, by index."""
    if not len(batch):
        return {}
    scaled = ScaledBatch.of(batch)
    index, points = proposer.postures(scaled)
    with np.errstate(all="ignore"):  # whatever the numbers are
        postures = scaled.select(index).plans(points, [batch.problems[k] for k in index.tolist()])
    worst = check_postures(postures)
    shown = {
        int(k): at
        for k, at, off in zip(index, postures, worst, strict=True)
        if off <= accept.tolerance
    }
    rows = np.array(list(shown), dtype=np.intp)
    result = {
        int(rows[k]): at
        for k, at in canonical(batch.select(rows), tolerance=accept.tolerance).items()
    }
    return result | with_toes(
        batch, {k: at for k, at in shown.items() if k not in result}, tolerance=accept.tolerance
    )


def proved(
    proposer: Proposer, batch: PostureBatch, accept: Acceptance
) -> dict[int, tuple[Certificate, float]]:
    """The first of every problem's proofs that the verifier accepts, and what it proves, by
    index.
    """
    if not len(batch):
        return {}
    rows, proofs = proposer.proofs(ScaledBatch.of(batch)), dict[int, tuple[Certificate, float]]()
    half_spaces = sum(row_counts(batch.like.contacts))
    for nth in range(rows.shape[1]):
        left = np.array(
            [k for k in range(len(batch)) if k not in proofs and _finite(rows[k, nth])],
            dtype=np.intp,
        )
        certificates = [
            _certificate(row, half_spaces).of(batch.problems[k])
            for k, row in zip(left.tolist(), rows[left, nth], strict=True)
        ]
        bounds = check_certificates(certificates).tolist()
        for k, certificate, bound in zip(left.tolist(), certificates, bounds, strict=True):
            if bound > accept.gap:
                proofs[k] = (certificate, bound)
    return proofs


def _finite(row: Array) -> bool:
    return bool(np.isfinite(row).all() and np.any(row))


def _certificate(row: Array, half_spaces: int) -> Certificate:
    """A leaf in single precision, its largest entry ±1, as a solver's are; half-spaces of reach
    take no part.
    """
    flat = (row / np.abs(row).max()).astype(np.float32).astype(np.float64)
    return Certificate(tree=LEAF, multipliers=np.append(flat, np.zeros(half_spaces))[None])
