"""One shard of a data set: its stream of samples is decided in blocks, anywhere, and kept in order
(Algorithm E1).

A block is decided together because that is cheaper, and apart from others because several workers
can then draw one shard. Neither changes a row: where a block begins and ends, and who decides it,
leaves no trace.
"""

from __future__ import annotations

import logging
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stancekit.envs.data import ledger
from stancekit.envs.data.dataset import LabelledPosture, table_of
from stancekit.envs.data.ledger import Counts, Header, LabelPlan, Shard, Tally
from stancekit.envs.distributions.postures import Distribution, distribution
from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.programs import Programs, programs_of_this_thread
from stancekit.planners.errors import StancekitError
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.search.answer import Acceptance
from stancekit.planners.search.batch import Decided, decide_all, solved
from stancekit.planners.search.exact import Exact

if TYPE_CHECKING:
    import pyarrow as pa

    from ..surrogates.surrogate import Surrogate

BLOCK = 512
"""Samples that are decided together, at most."""
SCREENED = 8192
"""Samples that are drawn together, at most, where a surrogate passes most of them over."""
LEAST = 32
"""Samples that are decided together, at least, where several workers share a shard: a block costs
as much as 50 to 100 samples before its first one is decided."""
_KEPT_BYTES = 1 << 24
"""Once a block of memory of this size was freed, glibc keeps as much for later, instead of giving
it back at once."""
BARREN = 10_000
"""After so many draws without a single row of a label that is wanted, a shard gives up."""

log = logging.getLogger(__name__)


def planned(plan: LabelPlan) -> Distribution:
    """The distribution of a plan.

    Raises InvalidInput where there is none of its name, for its robot and terrain.
    """
    return distribution(plan.distribution, robot=plan.robot, terrain=plan.terrain)


def samples(plan: LabelPlan, shard: int, source: Distribution | None = None) -> Iterator[Problem]:
    """The endless stream of samples that a shard is drawn from; a row's ``sample`` counts from
    0.
    """
    source, rng = source or planned(plan), _stream(plan, shard)
    while True:
        yield source.sample(rng)


def _stream(plan: LabelPlan, shard: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(plan.seed, spawn_key=(shard,)))


_KINDS = ("feasible", "infeasible", "trivial", "undecided")
"""Labels of samples, those of ``Counts``."""
_CALLED = ("feasible", "infeasible")
"""Names by which a surrogate calls a draw that it is sure of."""
_Place = tuple[int, Mapping[str, Any]]
"""A number of samples, and the state of a shard's random stream after so many."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelBlock:
    """Neighbouring samples of a shard, decided.

    Arguments:
        kinds: each one's label, "trivial" set apart, and "screened" for one that was not decided.
        rows: those that may be kept, as a shard's table, with ``row`` 0.
        after: the place in the stream behind the block.
        solve_ms: by sample.
        called: what a surrogate calls each; None without one.
        draw_cpu_s, screen_cpu_s: the parts of cpu_s in which they were drawn and screened.
    """

    shard: int
    first: int
    kinds: list[str]
    rows: pa.Table
    after: _Place
    solve_ms: list[float]
    cpu_s: float
    called: list[str] | None = None
    draw_cpu_s: float = 0.0
    screen_cpu_s: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Screen:
    """A surrogate that decides which draws are skipped, with the error rate that it may have on
    each label and the limits on its score that keep it within that rate.
    """

    surrogate: Surrogate
    error: float
    limits: tuple[float, float]

    @classmethod
    def of(cls, surrogate: Surrogate, error: float) -> Screen:
        """The screen of ``surrogate`` at this error."""
        return cls(surrogate=surrogate, error=error, limits=surrogate.thresholds(error))

    def called(self, batch: PostureBatch) -> list[str]:
        """Name that the surrogate gives each problem: "feasible", "infeasible" or "ask"."""
        answers = self.surrogate.answered(batch, self.limits, self.error).answers
        called: list[str] = answers.tolist()
        return called


def _decide_block(
    plan: LabelPlan,
    source: Distribution,
    shard: int,
    start: _Place | None,
    first: int,
    count: int,
    kinds: frozenset[str],
    kept: KeptPrograms,
    screen: Screen | None = None,
) -> LabelBlock:
    """Decide ``count`` samples of a shard from number ``first`` on, and make rows of these kinds.

    Arguments:
        start: a known place in the stream at or before the first sample; None for its beginning.
        kept: programs that other blocks used before; no row depends on them.
        screen: what it calls of another kind is not decided.
    """
    begin, rng = time.process_time(), _stream(plan, shard)
    np.empty(
        _KEPT_BYTES, dtype=np.uint8
    )  # or the arrays of a block would come anew from the system, step by step
    at, state = start or (0, rng.bit_generator.state)
    rng.bit_generator.state = state
    while at < first:
        skipped = min(first - at, BLOCK)
        source.batch(rng, skipped)
        at += skipped
    batch = source.batch(rng, count)
    after = (first + count, rng.bit_generator.state)
    after_draw, wall = time.process_time(), time.perf_counter()
    called = None if screen is None else screen.called(batch)
    after_screen, share_ms = time.process_time(), 1e3 * (time.perf_counter() - wall) / count
    left = [k for k in range(count) if called is None or _open(called[k], kinds)]
    some = batch if called is None else batch.select(np.array(left, dtype=np.intp))
    labeller = _Labeller(plan, shard, [first + k for k in left], kinds, kept.programs)
    rows, decided, took_ms = labeller.rows(some) if left else ([], [], [])
    labels, solve_ms = ["screened"] * count, [round(share_ms, 3)] * count
    for k, kind, each_ms in zip(left, decided, took_ms, strict=True):
        labels[k], solve_ms[k] = kind, each_ms
    return LabelBlock(
        shard=shard,
        first=first,
        kinds=labels,
        rows=table_of(rows, len(batch.like.contacts)),
        after=after,
        solve_ms=solve_ms,
        cpu_s=time.process_time() - begin,
        called=called,
        draw_cpu_s=after_draw - begin,
        screen_cpu_s=after_screen - after_draw,
    )


def _open(called: str, kinds: frozenset[str]) -> bool:
    """Tell whether a draw that is called so has to be decided where rows of these kinds are
    wanted.
    """
    return called == "ask" or called in kinds


class KeptPrograms:
    """The programs of one call of ``label``; in a worker process, those of its thread, which blocks
    share.
    """

    def __init__(self, programs: Programs | None = None) -> None:
        self.programs = programs or Programs()

    def __reduce__(self) -> tuple[Any, ...]:
        return _of_this_thread, ()


def _of_this_thread() -> KeptPrograms:
    return KeptPrograms(programs_of_this_thread())


class _Labeller:
    """Lines 4 to 11 of Algorithm E1 for one block.

    No clock takes part: slow machines label as fast ones do.
    """

    def __init__(
        self,
        plan: LabelPlan,
        shard: int,
        samples: Sequence[int],
        kinds: frozenset[str],
        programs: Programs,
    ) -> None:
        self._plan, self._shard, self._samples, self._kinds = plan, shard, samples, kinds
        acceptance = Acceptance(tolerance=plan.tolerance, gap=plan.gap)
        self._exact = Exact(
            acceptance=acceptance,
            max_nodes=plan.max_nodes,
            time_limit_s=math.inf,
            programs=programs,
        )

    def rows(self, batch: PostureBatch) -> tuple[list[LabelledPosture], list[str], list[float]]:
        """The rows of the kinds that are asked for; of every sample its label and how long it took
        [ms].
        """
        decided = decide_all(self._exact, batch, points="infeasible" in self._kinds)
        kinds, points = (
            [_kind(outcome) for outcome in decided.outcomes],
            self._points(batch, decided),
        )
        rows = [
            self._row(self._samples[k], batch.problems[k], outcome, points.get(k))
            for k, outcome in enumerate(decided.outcomes)
            if kinds[k] in self._kinds
        ]
        return rows, kinds, [round(1e3 * outcome.effort.seconds, 3) for outcome in decided.outcomes]

    def _row(
        self, sample: int, problem: Problem, outcome: Answer[Plan], point: Array | None
    ) -> LabelledPosture:
        """The row as it will be kept; undecided if P̄ has no answer to keep although it should have
        one.
        """
        status, certificate, bound = outcome.status, outcome.certificate, outcome.bound
        if _kind(outcome) == "infeasible" and point is None:
            status, certificate, bound = Status.UNDECIDED, None, 0.0
        return LabelledPosture(
            shard=self._shard,
            row=0,
            sample=sample,
            problem=problem,
            status=status,
            trivial=_kind(outcome) == "trivial",
            posture=outcome.solution,
            point=point,
            certificate=certificate,
            lower_bound=bound,
            solves=outcome.effort.solves,
            nodes=int(outcome.details["nodes"]),
        )

    def _points(self, batch: PostureBatch, decided: Decided) -> dict[int, Array]:
        """[p, f] by index: of the witness; for what is infeasible, of an answer of P̄ that violates
        nothing else.
        """
        postures, outcomes = dict[int, Plan](), decided.outcomes
        if "feasible" in self._kinds:
            postures |= {
                k: outcome.solution
                for k, outcome in enumerate(outcomes)
                if outcome.solution is not None
            }
        if "infeasible" in self._kinds:
            of = [k for k, outcome in enumerate(outcomes) if _kind(outcome) == "infeasible"]
            postures |= {k: decided.relaxed[k] for k in of if k in decided.relaxed}
            rows = np.array([k for k in of if k not in decided.relaxed], dtype=np.intp)
            points = solved(self._exact.kept, batch.select(rows), tolerance=self._plan.tolerance)
            postures |= {int(rows[k]): posture for k, posture in points.items()}
        pairs = ScaledBatch.of(batch.select(np.array(list(postures), dtype=np.intp))).pairs(
            list(postures.values())
        )
        return dict(zip(postures, pairs, strict=True))


class ShardDraft:
    """A shard that is put together from its blocks: whichever comes when, they are taken in the
    stream's order.

    Arguments:
        came: labels of all samples of this run so far, which others add to, too; by it the draft
            knows how many it needs.
        kept: programs for its blocks.
        screen: passes over what it calls of a kind of which the shard has all its rows, by then and
            in the stream's order, so that it does not matter which of these happened to be decided.
    """

    def __init__(
        self,
        header: Header,
        shard: int,
        draws_per_row: int,
        came: Counter[str],
        kept: KeptPrograms,
        screen: Screen | None = None,
    ) -> None:
        self._screen, self._screened = screen, Counter[str]()
        self._draw_cpu_s = self._screen_cpu_s = 0.0
        self._header, self._plan, self._came, self._programs = header, header.plan, came, kept
        self.shard = shard
        self._room = Counter(
            dict(zip(("feasible", "infeasible"), header.plan.quota(shard), strict=True))
        )
        self._wanted = self._room.total()
        self._limit = draws_per_row * self._wanted
        self._asked, self._places = 0, list[_Place]()
        self._waiting = dict[int, LabelBlock]()
        self._drawn, self._kept = list[str](), Counter[str]()
        self._rows: list[pa.Table] = []
        self._solve_ms, self._cpu_s = list[float](), 0.0

    @property
    def missing(self) -> str:
        """Number of rows of each kind that are missing, in words; empty where none is."""
        if self._plan.natural:
            return (
                f"{self._wanted - self._kept.total()}" if self._kept.total() < self._wanted else ""
            )
        return " and ".join(f"{count} {kind}" for kind, count in self._room.items() if count > 0)

    @property
    def lacking(self) -> int:
        """Number of further samples that will do, by the yield so far, beyond those that are being
        decided.
        """
        if self._plan.natural:
            expected = self._wanted - len(self._drawn)
        else:
            samples = self._came.total() + 2
            expected = max(
                -(-count * samples // (self._came[kind] + 1)) for kind, count in self._room.items()
            )
        return max(min(expected - (self._asked - len(self._drawn)), self._most - self._asked), 0)

    @property
    def most(self) -> int:
        """Samples that are decided together, at most."""
        return BLOCK if self._screen is None or all(map(self._wants, _CALLED)) else SCREENED

    def block(self, source: Distribution, count: int) -> Callable[[], LabelBlock]:
        """The task that decides the next ``count`` samples."""
        first, self._asked = self._asked, self._asked + count
        start = max(
            (place for place in self._places if place[0] <= first),
            key=lambda place: place[0],
            default=None,
        )
        kinds = frozenset(kind for kind in _KINDS if self._wants(kind))
        place = (self._plan, source, self.shard, start, first, count)
        return partial(_decide_block, *place, kinds, self._programs, self._screen)

    def take(self, block: LabelBlock) -> Shard | None:
        """Keep what is wanted of a block, once all before it are there; the shard, where it has
        become whole.

        Raises StancekitError where too many samples were drawn.
        """
        if not self.missing:
            return None
        self._came.update(block.kinds)
        self._places.append(block.after)
        self._waiting[block.first] = block
        while self.missing and len(self._drawn) in self._waiting:
            self._keep(self._waiting.pop(len(self._drawn)))
        return None if self.missing else self._whole()

    def _keep(self, block: LabelBlock) -> None:
        """Keep the rows of the next block that are wanted, in its order; what comes after the last
        row was not drawn.
        """
        begin, chosen = len(self._drawn), list[int]()
        rows = zip(
            *(block.rows.column(name).to_pylist() for name in ("sample", "trivial", "label")),
            strict=True,
        )
        made = {
            sample: (k, "trivial" if trivial else label)
            for k, (sample, trivial, label) in enumerate(rows)
        }
        for sample, label in enumerate(block.kinds, block.first):
            if not self.missing:
                break
            kind = label
            called = "ask" if block.called is None else block.called[sample - block.first]
            if called != "ask" and not self._wants(called):
                self._drawn.append("screened")
                self._screened[called] += 1
                continue
            if self._wants(kind):
                k, kind = made[sample]
                if self._wants(kind):
                    chosen.append(k)
                    self._kept[kind] += 1
                    self._room[kind] -= 1
            self._drawn.append(kind)
        self._rows.append(block.rows.take(np.array(chosen, dtype=np.int64)))
        self._solve_ms += block.solve_ms[: len(self._drawn) - begin]
        self._cpu_s += block.cpu_s
        self._draw_cpu_s += block.draw_cpu_s
        self._screen_cpu_s += block.screen_cpu_s
        if self.missing and len(self._drawn) >= self._most:
            came = ", ".join(
                f"{count} {kind}" for kind, count in sorted(Counter(self._drawn).items())
            )
            lacks = f"lacks {self.missing} rows after {self._most} draws: {came}"
            raise StancekitError(f"{self._plan.distribution}: shard {self.shard} {lacks}")

    def _wants(self, kind: str) -> bool:
        """Tell whether there is room for another row of this kind."""
        return self._plan.natural or self._room[kind] > 0

    @property
    def _most(self) -> int:
        """Largest number of samples that may be drawn.

        It is smaller as long as some wanted label has not been found at all.
        """
        lacks = (count > 0 and not self._kept[kind] for kind, count in self._room.items())
        return min(self._limit, BARREN) if not self._plan.natural and any(lacks) else self._limit

    def _whole(self) -> Shard:
        undecided = [sample for sample, kind in enumerate(self._drawn) if kind == "undecided"]
        if undecided:
            log.warning(
                "shard %d: %d of %d samples stayed undecided: %s",
                self.shard,
                len(undecided),
                len(self._drawn),
                undecided,
            )
        counts = Counter(self._drawn)
        counts.pop("screened", None)
        tally = Tally(
            dataset=self._header.digest,
            shard=self.shard,
            rows=Counts(**self._kept),
            drawn=Counts(**counts),
            undecided_samples=undecided,
            software=ledger.software(),
            screened=None if self._screen is None else Counts(**self._screened),
        )
        import pyarrow as pa  # large, and no question of one problem needs it

        rows = pa.concat_tables(self._rows).combine_chunks()
        numbers = pa.array(np.arange(len(rows)), pa.int32())
        rows = rows.set_column(
            rows.schema.get_field_index("row"), rows.schema.field("row"), numbers
        )
        timing = ledger.ShardTiming(
            shard=self.shard,
            cpu_s=self._cpu_s,
            solve_ms=self._solve_ms,
            draw_cpu_s=None if self._screen is None else self._draw_cpu_s,
            screen_cpu_s=None if self._screen is None else self._screen_cpu_s,
        )
        return Shard(table=rows, tally=tally, timing=timing)


def _kind(outcome: Answer[Plan]) -> str:
    """The label, "trivial" set apart."""
    trivial = outcome.status is Status.INFEASIBLE and outcome.details["trivial"] > 0.0
    return "trivial" if trivial else str(outcome.status)
