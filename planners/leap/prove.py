"""A proof that no leap exists: a tree over the toes' candidates with one cut per leaf
(``verify.leap_proof``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..answer.certificate import Certificate
from ..equilibrium.layout import Index, Layout
from ..equilibrium.programs import ConicSolution, ConicStatus, Programs
from ..equilibrium.scaled import Scaled
from ..files.arrays import Array
from .cuts import MARGIN, Cut, proof_cut, ray, widened
from .numbers import LeapGiven, LeapNumbers
from .program import LeapLift
from .scp import LEAST_FRICTION

LEAF, CHOICE, TIMING = 0.0, 1.0, 4.0
"""Kinds of a certificate's nodes that a leap's has."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ProofSearch:
    """Result of a search for a proof: rows of the tree and of multipliers, None without a proof;
    solves.
    """

    tree: list[tuple[float, ...]] | None
    rows: list[Array]
    solves: int


class Prover:
    """Branch and bound over the candidates of one timing.

    Arguments:
        rows: multipliers from earlier solves, which may refute something.
        solves: convex problems at most.
    """

    def __init__(
        self, programs: Programs, numbers: LeapNumbers, rows: list[Array], solves: int
    ) -> None:
        self._programs, self._numbers, self._left = programs, numbers, solves
        self._most = solves
        self._cuts: list[Cut] = [proof_cut(numbers, row) for row in rows]
        self._rows = list(rows)
        self._leaves: list[Array] = []
        self._shares = numbers.scaled.opened()

    def prove(self) -> ProofSearch:
        """Search until all choices are refuted, one is not, or the solves are spent."""
        tree = self._node(self._numbers.scaled.opened())
        return ProofSearch(tree=tree, rows=self._leaves, solves=self._most - self._left)

    def _node(self, opened: Array) -> list[tuple[float, ...]] | None:
        """The rows of a subtree, None where its choices are not refuted."""
        refutation = self._refuting(opened)
        if refutation is None and self._left > 0:
            whole = self._solve(opened)
            refutation = self._refuting(opened)
            if refutation is None and whole.status is not ConicStatus.SOLVED:
                return None
            if refutation is None:
                single = self._favourite(opened)
                if (opened.sum(axis=1) == 1.0).all() or self._left <= 0:
                    return None
                if self._solve(single).status is not ConicStatus.INFEASIBLE:
                    return None
                refutation = self._refuting(opened)
        if refutation is not None:
            self._leaves.append(self._rows[refutation])
            return [(LEAF, 0.0, 0.0, 0.0, 0.0)]
        if self._left <= 0:
            return None
        p, r = self._torn(opened)
        on, off = opened.copy(), opened.copy()
        on[p], off[p, r] = 0.0, 0.0
        on[p, r] = 1.0
        first = self._node(on)
        second = self._node(off) if first is not None else None
        if first is None or second is None:
            return None
        return [(CHOICE, float(p), float(r), 0.0, 0.0), *first, *second]

    def _refuting(self, opened: Array) -> int | None:
        """The number of a cut that refutes all choices of open candidates."""
        for k, cut in enumerate(self._cuts):
            if cut.least(opened) > MARGIN:
                return k
        return None

    def _solve(self, opened: Array) -> ConicSolution:
        """Solve the relaxation over open candidates, and keep the cut of one that has no answer."""
        self._left -= 1
        numbers = self._numbers
        solution, scaled = _relaxed(self._programs, numbers, opened)
        if solution.status is ConicStatus.INFEASIBLE:
            row = ray(numbers, solution)
            self._rows.append(row)
            self._cuts.append(proof_cut(numbers, row))
        elif solution.solved:
            self._shares = scaled.by_candidate(
                _shares(scaled.layout, solution.value("weights")), 0.0
            )
        return solution

    def _favourite(self, opened: Array) -> Array:
        """One open candidate per foothold, that of the largest share."""
        single = np.zeros_like(opened)
        single[
            np.arange(len(opened)), np.where(opened > 0.0, self._shares, -1.0).argmax(axis=1)
        ] = 1.0
        return single

    def _torn(self, opened: Array) -> tuple[int, int]:
        """The foothold with several open candidates that is least decided, and its best one."""
        shares = np.where(opened > 0.0, self._shares, -1.0)
        p = int(np.where(opened.sum(axis=1) > 1.0, 1.0 - shares.max(axis=1), -1.0).argmax())
        return p, int(shares[p].argmax())


def refuting_ray(programs: Programs, numbers: LeapNumbers, choice: Index) -> Array | None:
    """Multipliers that refute one choice of contacts, by one convex problem; None where it has an
    answer.
    """
    single = np.zeros_like(numbers.scaled.opened())
    single[np.arange(len(choice)), choice] = 1.0
    solution, _ = _relaxed(programs, numbers, single)
    if solution.status is not ConicStatus.INFEASIBLE:
        return None
    row = ray(numbers, solution)
    return row if proof_cut(numbers, row).value(choice) > MARGIN else None


def _relaxed(
    programs: Programs, numbers: LeapNumbers, opened: Array
) -> tuple[ConicSolution, Scaled]:
    """The relaxation over open candidates, solved, and what its program was loaded with."""
    reach, rows = widened(numbers)
    spaces = replace(numbers.scaled.half_spaces, outer_bounds=rows)
    scaled = replace(
        numbers.scaled,
        reach=reach,
        half_spaces=spaces,
        friction=np.maximum(numbers.scaled.friction, LEAST_FRICTION),
    ).only(opened)
    program = programs.get(LeapLift, scaled.layout, numbers.leap.still)
    return program.solve(LeapGiven(scaled, loaded_numbers=numbers)), scaled


def _shares(layout: Layout, weights: Array) -> Array:
    """Σ_u λ_u of every candidate."""
    return np.asarray(np.bincount(layout.vertex_candidates, weights))


def certificate_of(searches: list[ProofSearch]) -> Certificate | None:
    """The certificate of the proofs of every timing, None unless each has one."""
    tree: list[tuple[float, ...]] = []
    rows: list[Array] = []
    for k, search in enumerate(searches):
        if search.tree is None:
            return None
        if k + 1 < len(searches):
            tree.append((TIMING, float(k), 0.0, 0.0, 0.0))
        tree += search.tree
        rows += search.rows
    return Certificate(tree=np.array(tree), multipliers=np.array(rows))
