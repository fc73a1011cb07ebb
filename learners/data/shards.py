"""One shard of a data set, drawn in blocks: sample, decide, and keep what is wanted (Algorithm E1, lines 4–11).

A block is decided together because that is cheaper, and for no other reason: where it begins and ends changes nothing.
"""

from __future__ import annotations

import logging
import math
import time
from collections import Counter
from collections.abc import Iterator

import numpy as np

from stancekit.envs.data import ledger
from stancekit.envs.data.labelled_posture import LabelledPosture, table_of
from stancekit.envs.data.ledger import Counts, Header, LabelPlan, Shard, Tally
from stancekit.envs.distributions.postures import Distribution, distribution
from stancekit.planners.answer.outcome import Outcome, Posture, Status
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import PostureBatch, PostureProblem
from stancekit.planners.search.answer import Acceptance
from stancekit.planners.search.batch import Decided, decide_all
from stancekit.planners.search.canonical import solved
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.proposals import Proposer

BLOCK = 512
"""Samples that are decided together, at most."""
KEPT_BYTES = 1 << 24
"""Once a block of memory of this size was freed, glibc keeps as much for later, instead of giving it back at once."""
BARREN = 10_000
"""After so many draws without a single row of a label that is wanted, a shard gives up."""

log = logging.getLogger(__name__)


class LabellingFailed(StancekitError):
    """The distribution does not give the rows that were planned."""


def planned(plan: LabelPlan) -> Distribution:
    """The distribution of a plan. Raises InvalidInput where there is none of its name, for its robot and terrain."""
    return distribution(plan.distribution, robot=plan.robot, terrain=plan.terrain)


def samples(plan: LabelPlan, shard: int, source: Distribution | None = None) -> Iterator[PostureProblem]:
    """The endless stream of samples that a shard is drawn from; a row's ``sample`` counts from 0."""
    source, rng = source or planned(plan), _stream(plan, shard)
    while True:
        yield source.sample(rng)


def _stream(plan: LabelPlan, shard: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(plan.seed, spawn_key=(shard,)))


def label_shard(
    header: Header,
    source: Distribution,
    shard: int,
    draws_per_row: int,
    proposers: Proposer | None = None,
    programs: Programs | None = None,
) -> Shard:
    """Draw one shard until its quotas are full, block by block; no row depends on where a block begins.

    programs: those of the shards before, in this process; no row depends on them.
    """
    begin, plan = time.process_time(), header.plan
    np.empty(KEPT_BYTES, dtype=np.uint8)  # or the arrays of a block would come anew from the system, step by step
    labeller = _Labeller(plan, shard, proposers, programs or Programs())
    limit, rng = draws_per_row * labeller.wanted, _stream(plan, shard)
    while labeller.missing:
        most = min(limit, BARREN) if labeller.barren else limit
        if len(labeller.drawn) >= most:
            came = ", ".join(f"{count} {kind}" for kind, count in sorted(Counter(labeller.drawn).items()))
            lacks = f"lacks {labeller.missing} rows after {most} draws: {came}"
            raise LabellingFailed(f"{plan.distribution}: shard {shard} {lacks}")
        labeller.take(source.batch(rng, min(labeller.expected, BLOCK, most - len(labeller.drawn))))
    undecided = [sample for sample, kind in enumerate(labeller.drawn) if kind == "undecided"]
    if undecided:
        drawn = len(labeller.drawn)
        log.warning("shard %d: %d of %d samples stayed undecided: %s", shard, len(undecided), drawn, undecided)
    tally = Tally(
        dataset=header.digest,
        shard=shard,
        rows=Counts(**Counter(row.kind for row in labeller.kept)),
        drawn=Counts(**Counter(labeller.drawn)),
        undecided_samples=undecided,
        software=ledger.software(),
    )
    table = table_of(labeller.kept, len(header.legs))
    timing = ledger.Timing(shard=shard, cpu_s=time.process_time() - begin, solve_ms=labeller.solve_ms)
    return Shard(table=table, tally=tally, timing=timing)


class _Labeller:
    """Lines 4 to 11 of Algorithm E1, a block at a time. No clock takes part: slow machines label as fast ones do.

    kept: rows so far; drawn: the kind of every sample so far; solve_ms: what each took, of a block its share.
    """

    def __init__(self, plan: LabelPlan, shard: int, proposers: Proposer | None, programs: Programs) -> None:
        self._plan, self._shard = plan, shard
        self._room = Counter(dict(zip(("feasible", "infeasible"), plan.quota(shard), strict=True)))
        self.wanted = self._room.total()
        self.kept: list[LabelledPosture] = []
        self.drawn: list[str] = []
        self.solve_ms: list[float] = []
        acceptance = Acceptance(tolerance=plan.tolerance, gap=plan.gap)
        self._exact = ExactPlanner(
            acceptance=acceptance, max_nodes=plan.max_nodes, time_limit_s=math.inf, programs=programs,
            proposers=proposers,
        )  # fmt: skip

    @property
    def missing(self) -> str:
        """How many rows of which kind are missing, in words; empty where none is."""
        if self._plan.natural:
            return f"{self.wanted - len(self.kept)}" if len(self.kept) < self.wanted else ""
        return " and ".join(f"{count} {kind}" for kind, count in self._room.items() if count > 0)

    @property
    def barren(self) -> bool:
        """Whether rows of some kind are wanted and none has come yet."""
        came = {row.kind for row in self.kept}
        return not self._plan.natural and any(count > 0 and kind not in came for kind, count in self._room.items())

    @property
    def expected(self) -> int:
        """How many samples will do, by what came so far; as many as are missing where everything is kept."""
        if self._plan.natural:
            return self.wanted - len(self.kept)
        came = Counter(self.drawn)
        return max(-(-count * (len(self.drawn) + 2) // (came[kind] + 1)) for kind, count in self._room.items())

    def take(self, batch: PostureBatch) -> None:
        """Decide a block and keep of it what is wanted, in its order; what comes after the last row was not drawn."""
        decided = decide_all(self._exact, batch, points=self._wants("infeasible"))
        outcomes, points = decided.outcomes, self._points(batch, decided)
        for k, outcome in enumerate(outcomes):
            if not self.missing:
                break
            kind = _kind(outcome)
            if self._wants(kind):
                row = self._row(batch.problems[k], outcome, points.get(k))
                kind = row.kind
                if self._wants(kind):
                    self.kept.append(row)
                    self._room[kind] -= 1
            self.drawn.append(kind)
            self.solve_ms.append(round(1e3 * outcome.seconds, 3))

    def _wants(self, kind: str) -> bool:
        """Whether there is room for another row of this kind."""
        return self._plan.natural or self._room[kind] > 0

    def _row(self, problem: PostureProblem, outcome: Outcome, point: Array | None) -> LabelledPosture:
        """The row as it will be kept; undecided if P̄ has no answer to keep although it should have one."""
        status, certificate, bound = outcome.status, outcome.certificate, outcome.lower_bound
        if _kind(outcome) == "infeasible" and point is None:
            status, certificate, bound = Status.UNDECIDED, None, 0.0
        return LabelledPosture(
            shard=self._shard, row=len(self.kept), sample=len(self.drawn), problem=problem, status=status,
            trivial=_kind(outcome) == "trivial", posture=outcome.posture, point=point, certificate=certificate,
            lower_bound=bound, solves=outcome.solves, nodes=int(outcome.details["nodes"]),
        )  # fmt: skip

    def _points(self, batch: PostureBatch, decided: Decided) -> dict[int, Array]:
        """[p, f] by index: of the witness; for what is infeasible, of an answer of P̄ that violates nothing else."""
        postures, outcomes = dict[int, Posture](), decided.outcomes
        if self._wants("feasible"):
            postures |= {k: outcome.posture for k, outcome in enumerate(outcomes) if outcome.posture is not None}
        if self._wants("infeasible"):
            of = [k for k, outcome in enumerate(outcomes) if _kind(outcome) == "infeasible"]
            postures |= {k: decided.relaxed[k] for k in of if k in decided.relaxed}
            rows = np.array([k for k in of if k not in decided.relaxed], dtype=np.intp)
            found = solved(self._exact.programs, batch.select(rows), tolerance=self._plan.tolerance)
            postures |= {int(rows[k]): posture for k, posture in found.items()}
        pairs = ScaledBatch.of(batch.select(np.array(list(postures), dtype=np.intp))).pairs(list(postures.values()))
        return dict(zip(postures, pairs, strict=True))


def _kind(outcome: Outcome) -> str:
    """The label, "trivial" set apart."""
    trivial = outcome.status is Status.INFEASIBLE and outcome.details["trivial"] > 0.0
    return "trivial" if trivial else str(outcome.status)
