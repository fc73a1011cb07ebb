"""Tries of a leap: choices of contacts, each solved with a plan, refuted by a cut, or unsolved
without a claim.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..answer.answer import Status
from ..answer.plan import LeapPlan
from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs, programs_of_this_thread
from ..files.arrays import Array
from ..problem.leap import Leap
from ..verify.leap_proof import Refuter
from ..verify.leaps import check_leap
from .cuts import MARGIN, Cut, proof_cut, ray
from .finder import LeapFinder, LeapSearch, Order
from .numbers import LeapNumbers
from .prove import refuting_ray
from .scp import FRICTION_SHARE, STOP, LeapAttempt, plan_of

ORDERS: tuple[Order, ...] = ("random", "rule", "farkas", "finder", "noise")
"""In which a leap's tries are made: random ones before there are cuts, noise about the best that
the others found."""
LABELS = {Status.FEASIBLE: "solved", Status.INFEASIBLE: "refuted", Status.UNDECIDED: "unsolved"}
"""Labels of a try: has its choice of contacts a leap?"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Try:
    """One choice of contacts, and what is known of it.

    Arguments:
        order: how it was chosen.
        timing: number of the timing.
        choice: a candidate per foothold, shape (P,).
        status: feasible with a plan that ``check_leap`` accepted, infeasible with a row of
            multipliers that refutes the choice by ``verify.leap_proof``, else undecided.
        first: cost of the first convex step.
        cost: of what is left at the end; inf where the first step has no answer.
        solves: convex problems.
        seconds: wall clock.
    """

    order: Order
    timing: int
    choice: Index
    status: Status
    first: float
    cost: float
    solves: int
    seconds: float
    plan: LeapPlan | None = None
    multipliers: Array | None = None


def tries_of(
    leap: Leap,
    mix: Mapping[Order, int],
    *,
    seed: int,
    stop: float = STOP,
    share: float = FRICTION_SHARE,
    programs: Programs | None = None,
) -> list[Try]:
    """Try different choices of a leap's contacts, and label each one.

    Arguments:
        mix: how many choices of each order, made in the sequence of ``ORDERS``; fewer where there
            are no more.
        seed: of random choices and of noise.
        stop: cost of a first step above which a choice is given up.
        share: of the friction, that plans use.

    Returns:
        The tries in the order in which they were made. What one of them is refuted by is held
        against all others.
    """
    programs = programs or programs_of_this_thread()
    labeller = _Labeller(leap, programs)
    search = LeapSearch(leap, LeapFinder(solves=10**9, seed=seed, stop=stop, share=share), programs)
    for order in ORDERS:
        attempts = search.attempts(order)
        for _ in range(mix.get(order, 0)):
            begin = time.perf_counter()
            leap_attempt = next(attempts, None)
            if leap_attempt is None:
                break
            labeller.add(search.last.numbers, leap_attempt, order, begin)
    return labeller.tries()


class _Labeller:
    """The tries of one leap so far, and the cuts that prove something of it by timing."""

    def __init__(self, leap: Leap, programs: Programs) -> None:
        self._programs, self._refuter = programs, Refuter(leap)
        self._tries: list[Try] = []
        self._cuts: list[tuple[int, Cut, Array]] = []

    def add(self, numbers: LeapNumbers, found: LeapAttempt, order: Order, begin: float) -> None:
        """Label an attempt."""
        plan, solves = None, found.solves
        if found.solved:
            plan = plan_of(numbers, found, order)
            plan = plan if check_leap(plan).accepted else None
        elif found.refuted:
            solves += self._learn(numbers, found)
        self._tries.append(
            Try(
                order=order,
                timing=numbers.timing,
                choice=found.choice,
                plan=plan,
                status=Status.UNDECIDED if plan is None else Status.FEASIBLE,
                first=found.first,
                cost=found.cost,
                solves=solves,
                seconds=time.perf_counter() - begin,
            )
        )

    def _learn(self, numbers: LeapNumbers, found: LeapAttempt) -> int:
        """Keep a cut that refutes a choice: of its own multipliers, or else of the relaxation's.

        Returns solves.
        """
        if any(
            cut.value(found.choice) > MARGIN
            for timing, cut, _ in self._cuts
            if timing == numbers.timing
        ):
            return 0
        row, solves = ray(numbers, found.solution), 0
        cut = proof_cut(numbers, row)
        if cut.value(found.choice) <= MARGIN:
            again, solves = refuting_ray(self._programs, numbers, found.choice), 1
            if again is None:
                return solves
            row, cut = again, proof_cut(numbers, again)
        self._cuts.append((numbers.timing, cut, row))
        return solves

    def _refuting(self, timing: int, choice: Index) -> Array | None:
        """Multipliers that the verifier accepts against a choice, of the cut that says most; None
        without any.
        """
        values = [(cut.value(choice), row) for at, cut, row in self._cuts if at == timing]
        value, row = max(values, key=lambda each: each[0], default=(0.0, None))
        if (
            row is None
            or value <= MARGIN
            or self._refuter.bounds(timing, row, choice[None])[0] <= MARGIN
        ):
            return None
        return row

    def tries(self) -> list[Try]:
        """All of them, those that are not solved held against all cuts."""
        made = []
        for one in self._tries:
            row = None if one.plan is not None else self._refuting(one.timing, one.choice)
            made.append(
                one if row is None else replace(one, status=Status.INFEASIBLE, multipliers=row)
            )
        return made
