"""Planners of leaps: choose contacts, try them by SCP, learn cuts from what fails, and prove what
no choice solves.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from ..answer.answer import Answer, Effort, Status
from ..answer.plan import LeapPlan
from ..equilibrium.layout import Index
from ..equilibrium.programs import Programs, programs_of_this_thread
from ..files.arrays import Array
from ..problem.leap import Leap
from ..verify import check_certificate
from ..verify.leap_proof import Refuter
from ..verify.leaps import check_leap
from .method import FRICTION_SHARE, STOP, LeapFinder as LeapFinder, Order as Order
from .numbers import LeapNumbers
from .prove import (
    MARGIN,
    Cut,
    ProofSearch,
    Prover,
    certificate_of,
    guide,
    plan_cut,
    proof_cut,
    ray,
    refuting_ray,
)
from .scp import LeapAttempt, attempt, plan_of

_HEADS = 96
"""Combinations of each half that are looked at in pairs."""
_MOST = 8_192
"""Combinations of a half; with more, the worst candidates of every toe are left out."""


class Picker:
    """Choices of one leap, what was tried, and the cuts so far.

    Arguments:
        scores: of every candidate, shape (P, options), −inf where there is none.
        price: what a unit of predicted cost takes off a score.
    """

    def __init__(self, scores: Array, price: float) -> None:
        self._scores, self._price = scores, price
        options = np.isfinite(scores).sum(axis=1)
        free = np.flatnonzero(options > 1)
        self._halves = (free[: (len(free) + 1) // 2], free[(len(free) + 1) // 2 :])
        self._fixed = np.flatnonzero(options == 1)
        self._combos = [_combos(half, scores, options) for half in self._halves]
        self._sums = self._of(scores)
        self._bounds = [sums.copy() for sums in self._sums]
        self._soft: list[tuple[float, Array, Array]] = []
        self._hard: list[tuple[float, Array, Array]] = []
        self.cuts: list[Cut] = []
        self.tried: set[tuple[int, ...]] = set()

    def refute(self, cut: Cut) -> None:
        """Leave out every choice that a cut refutes."""
        constant, (first, second) = self._constant(cut), self._of(cut.table)
        self._hard.append((constant, first, second))
        self.cuts.append(cut)
        for one, other, bound in (
            (first, second, self._bounds[0]),
            (second, first, self._bounds[1]),
        ):
            bound[constant + one + other.min() > MARGIN] = -np.inf

    def charge(self, cut: Cut) -> None:
        """Take what a cut predicts off the score of every choice."""
        constant, (first, second) = self._constant(cut), self._of(cut.table)
        self._soft.append((constant, first, second))
        for one, other, bound in (
            (first, second, self._bounds[0]),
            (second, first, self._bounds[1]),
        ):
            bound -= self._price * np.maximum(constant + one + other.min(), 0.0)

    def best(self) -> Index | None:
        """The untried choice of the best score that no cut refutes; None where none is found."""
        for heads in (_HEADS, 8 * _HEADS):
            a, b = (_top(bound, heads) for bound in self._bounds)
            if not len(a) or not len(b):
                return None
            value = self._sums[0][a][:, None] + self._sums[1][b]
            for constant, first, second in self._soft:
                value = value - self._price * np.maximum(
                    constant + first[a][:, None] + second[b], 0.0
                )
            for constant, first, second in self._hard:
                value[constant + first[a][:, None] + second[b] > MARGIN] = -np.inf
            order = np.argsort(-value, axis=None, kind="stable")
            for flat in order[: len(self.tried) + 1].tolist():
                i, j = divmod(flat, len(b))
                if value[i, j] == -np.inf:
                    break
                choice = np.zeros(len(self._scores), dtype=np.int_)
                choice[self._halves[0]], choice[self._halves[1]] = (
                    self._combos[0][a[i]],
                    self._combos[1][b[j]],
                )
                if tuple(choice.tolist()) not in self.tried:
                    return choice
        return None

    def allowed(self, choice: Index) -> bool:
        """Tell whether a choice is untried and no cut refutes it."""
        return tuple(choice.tolist()) not in self.tried and all(
            cut.value(choice) <= MARGIN for cut in self.cuts
        )

    def _of(self, table: Array) -> list[Array]:
        """The sums of a table over the combinations of either half."""
        return [
            table[half, combo].sum(axis=1)
            for half, combo in zip(self._halves, self._combos, strict=True)
        ]

    def _constant(self, cut: Cut) -> float:
        """C, and a of the footholds with one candidate."""
        return cut.constant + float(cut.table[self._fixed, 0].sum())


def _combos(half: Index, scores: Array, options: Index) -> Index:
    """Combinations of the candidates of some footholds, shape (·, footholds)."""
    counts = options[half].copy()
    while np.prod(counts, dtype=np.float64) > _MOST:
        counts[counts.argmax()] -= 1
    lists = [
        np.argsort(-scores[j], kind="stable")[:count] for j, count in zip(half, counts, strict=True)
    ]
    rows = list(itertools.product(*lists))
    return np.array(rows, dtype=np.int_).reshape(len(rows), len(half))


def _top(values: Array, count: int) -> Index:
    """The places of the largest finite values, at most ``count``."""
    at = np.argpartition(-values, count)[:count] if len(values) > count else np.arange(len(values))
    return np.asarray(at[values[at] > -np.inf])


_DECIDED = 1e-3
"""A first step that costs less than this says nothing of other choices."""


def find_leap(
    leap: Leap,
    method: LeapFinder | None = None,
    *,
    programs: Programs | None = None,
    time_limit_s: float = 60.0,
) -> Answer[LeapPlan]:
    """Search for a leap, and for a proof that there is none where no plan is found.

    Returns an outcome that is feasible with a plan that ``check_leap`` accepted, infeasible with a
    certificate that ``check_certificate`` accepted, or undecided.
    """
    begin, method = time.perf_counter(), method or LeapFinder()
    deadline = begin + time_limit_s
    search = LeapSearch(leap, method, programs or programs_of_this_thread())
    for leap_attempt in search.attempts():
        if leap_attempt.solved:
            plan = plan_of(search.last.numbers, leap_attempt, method.order)
            report = check_leap(plan)
            if report.accepted:
                return Answer(
                    status=Status.FEASIBLE,
                    method=method.order,
                    problem=leap,
                    solution=plan,
                    report=report,
                    residual=report.worst,
                    effort=search.effort(time.perf_counter() - begin),
                )
        if time.perf_counter() > deadline:
            break
    tried = search.solves
    proves = method.proof and not leap.robot.own  # whose hips move with its legs
    certificate = certificate_of(search.proofs(deadline)) if proves else None
    message = "no choice that was tried has a leap, and nothing is proved"
    if certificate is not None:
        certificate = certificate.of(leap)
        check = check_certificate(certificate)
        if not check.accepted:
            certificate, message = None, f"the proof was refused: {check.message}"
    return Answer(
        status=Status.UNDECIDED if certificate is None else Status.INFEASIBLE,
        method=method.order,
        problem=leap,
        certificate=certificate,
        effort=search.effort(time.perf_counter() - begin),
        message=message if certificate is None else "",
        details={"search_solves": float(tried)},
    )


class _Timing:
    """Knowledge about one timing: its numbers, scores, cuts, and multipliers."""

    def __init__(self, leap: Leap, timing: int, method: LeapFinder) -> None:
        self.numbers = LeapNumbers.of(leap, timing)
        self.scores = method.rule.scores(self.numbers)
        self.picker = Picker(self.scores, method.price)
        self.rows: list[Array] = []
        self.best: tuple[float, Index] | None = None
        self.exhausted = False


class LeapSearch:
    """A search as far as it has come: attempts one by one, then proofs."""

    def __init__(self, leap: Leap, method: LeapFinder, programs: Programs) -> None:
        self._method, self._programs = method, programs
        self._timings = [_Timing(leap, k, method) for k in range(len(leap.timings_s))]
        self._rng = np.random.default_rng(method.seed)
        self.last = self._timings[0]
        self.tries = self.solves = 0
        self._order, self._before = method.order, 0

    @property
    def _own(self) -> int:
        """Number of tries that the present order has made."""
        return self.tries - self._before

    def effort(self, seconds: float) -> Effort:
        """Cost of the search so far, in this much time [s]."""
        return Effort(solves=self.solves, tries=self.tries, seconds=seconds)

    def attempts(self, order: Order | None = None) -> Iterator[LeapAttempt]:
        """Attempts, timing by timing in turn, until the solves are spent or nothing is left to try.

        Arguments:
            order: another one than the method's; it goes on from what the search has tried and
                learned so far.
        """
        method = self._method
        self._order, self._before = order or method.order, self.tries
        for timing in self._timings:
            timing.exhausted = False  # another order may find what this one's did not
        if self.solves >= method.solves:
            return
        for _, choice in self.choices():
            leap_attempt = attempt(
                self._programs, self.last.numbers, choice, share=method.share, stop=method.stop
            )
            self.solves += leap_attempt.solves
            self._learn(self.last, leap_attempt)
            yield leap_attempt
            if self.solves >= method.solves:
                return

    def choices(self) -> Iterator[tuple[int, Index]]:
        """Choices as ``attempts`` tries them, each with its timing."""
        for timing in self._turns():
            choice = self._choice(timing)
            if choice is None:
                timing.exhausted = True
                continue
            self.tries += 1
            timing.picker.tried.add(tuple(choice.tolist()))
            yield timing.numbers.timing, choice

    def _turns(self) -> Iterator[_Timing]:
        """The timings in turn, until nothing is left to try on any."""
        k = 0
        while not all(each.exhausted for each in self._timings):
            self.last = timing = self._timings[k % len(self._timings)]
            k += 1
            if not timing.exhausted:
                yield timing

    def proofs(self, deadline: float) -> list[ProofSearch]:
        """A search for a proof for every timing, until one has none."""
        searches: list[ProofSearch] = []
        for timing in self._timings:
            if time.perf_counter() > deadline:
                searches.append(ProofSearch(tree=None, rows=[], solves=0))
                break
            prover = Prover(self._programs, timing.numbers, timing.rows[-8:], self._method.proof)
            searches.append(prover.prove())
            self.solves += searches[-1].solves
            if searches[-1].tree is None:
                break
        return searches

    def _learn(self, timing: _Timing, found: LeapAttempt) -> None:
        """Keep the cuts of an attempt that failed."""
        picker, order = timing.picker, self._order
        if timing.best is None or found.cost < timing.best[0]:
            timing.best = (found.cost, found.choice)
        if found.solved:
            return
        if found.refuted:
            row = ray(timing.numbers, found.solution)
            timing.rows.append(row)
            if order in ("farkas", "finder"):
                cut = plan_cut(timing.numbers, row, self._method.share)
                if cut.value(found.choice) > 0.0:
                    picker.refute(cut)
        elif order == "finder" and found.first > _DECIDED:
            picker.charge(guide(timing.numbers, found))

    def _choice(self, timing: _Timing) -> Index | None:
        """The next choice of a timing, None where there is none left."""
        order, picker = self._order, timing.picker
        if order == "random":
            return self._drawn(timing, np.where(np.isfinite(timing.scores), 0.0, -np.inf), 1.0)
        if order == "noise" and self.tries > 0:
            return self._drawn(timing, timing.scores, min(1.0, 0.4 + 0.1 * self._own))
        return picker.best()

    def _drawn(self, timing: _Timing, scores: Array, noise: float) -> Index | None:
        """A choice with noise on the scores; every other one changes one toe of the best so far."""
        rows = np.arange(len(scores))
        for _ in range(60):
            gumbel = self._rng.gumbel(size=scores.shape)
            choice = np.asarray((scores + noise * gumbel).argmax(axis=1))
            if self._order == "noise" and self._own % 2 == 0 and timing.best is not None:
                j = int(self._rng.choice(np.flatnonzero(np.isfinite(scores).sum(axis=1) > 1)))
                choice = np.where(rows == j, choice, timing.best[1])
            if timing.picker.allowed(choice):
                return choice
        return None


_ORDERS: tuple[Order, ...] = ("random", "rule", "farkas", "finder", "noise")
"""In which a leap's tries are made: random ones before there are cuts, noise about the best that
the others found."""
LABELS = MappingProxyType(
    {Status.FEASIBLE: "solved", Status.INFEASIBLE: "refuted", Status.UNDECIDED: "unsolved"}
)
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
        mix: how many choices of each order, made in the sequence of ``_ORDERS``; fewer where there
            are no more.
        seed: of random choices and of noise.
        stop: cost of a first step above which a choice is given up.
        share: share of the friction that plans use.

    Returns:
        The tries in the order in which they were made. What one of them is refuted by is held
        against all others.
    """
    programs = programs or programs_of_this_thread()
    labeller = _Labeller(leap, programs)
    search = LeapSearch(leap, LeapFinder(solves=10**9, seed=seed, stop=stop, share=share), programs)
    for order in _ORDERS:
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
