"""Labels of leaps: scenes of a class, tries of each one's contacts, and what each try's evidence is
worth.

A scene and its tries follow from (seed, number of the scene) alone, so any executor may make scenes
in any order; they are put together in theirs, and a shard is written once, when all of its scenes
are there.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from stancekit.envs.data import ledger
from stancekit.envs.data.leap_tries import (
    LeapTries,
    TrySummary,
    plan_of_row,
    scene_name,
    shapes_of,
    shared_keys,
    table_of_tries,
)
from stancekit.envs.data.ledger import Counts, Shard, ShardTiming, Tally, TryHeader, TryPlan
from stancekit.planners.files.arrays import Array
from stancekit.planners.leap.finder import LABELS, Order, tries_of
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class, leap_to_json
from stancekit.planners.verify.leap_proof import GUARD, Refuter
from stancekit.planners.verify.leaps import check_leap

from .executors import Executor, Task, processes
from .labelling import Progress, RecheckReport, begin, fill

if TYPE_CHECKING:
    import pyarrow as pa


_SPEAKS_OF = {
    "solved": "toes and forces that the verifier of leaps accepts; joints and bodies are not judged",
    "refuted": "multipliers that prove that no leap of this timing has these contacts",
    "unsolved": "nothing is claimed: the search gave this choice up",
}
"""The meaning of each label."""


def scene(plan: TryPlan, number: int) -> Leap:
    """The scene of a number: each has a generator of its own.

    Raises InvalidInput for a class that there is not.
    """
    name = scene_name(plan.distribution, plan.seed, number)
    return leap_class(plan.distribution).draw(np.random.default_rng([plan.seed, number]), name)


def label_leaps(
    plan: TryPlan,
    path: str | Path,
    *,
    run: Executor | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> TrySummary:
    """Make the planned tries in this folder, or what is missing of them.

    Arguments:
        plan: which.
        path: of the folder.
        run: the executor; one process where None. The rows do not depend on it.
        progress: called once at the start and after every shard.

    Raises:
        InvalidInput: for a class that there is not, and where the folder holds another data set.
    """
    ledger.check_arrow()
    header = begin(Path(path), _header(plan))
    fill(Path(path), lambda missing: _Drafts(header, missing), run or processes(1), progress)
    return LeapTries.open(path).summary()


def recheck_leaps(tries: LeapTries) -> RecheckReport:
    """Let the verifier judge every stored plan and every row of multipliers again: no solver takes
    part.

    A try that is solved is refused, too, where an accepted row of multipliers of its scene refutes
    it.
    """
    began, report = time.perf_counter(), _Recheck()
    rows = tries.tries()
    for number, leap in enumerate(tries.leaps()):
        report.judge(leap, rows, np.flatnonzero(rows["scene"] == number))
    return RecheckReport(
        witnesses=len(report.residuals),
        certificates=len(report.bounds),
        refused=tuple(sorted(report.refused)),
        worst_residual=max(report.residuals, default=math.nan),
        smallest_bound=min(report.bounds, default=math.nan),
        seconds=time.perf_counter() - began,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scene:
    """A scene's tries, labelled.

    Arguments:
        number: of the scene.
        table: of its rows.
        labels: of the tries.
        ms: of each one.
    """

    number: int
    table: pa.Table
    labels: list[str]
    ms: list[float]
    cpu_s: float


def _tried(header: TryHeader, number: int) -> _Scene:
    """Draw a scene, try it, and label the tries."""
    begin_s, plan = time.process_time(), header.plan
    leap = scene(plan, number)
    seed = int(np.random.default_rng([plan.seed, number, 1]).integers(2**62))
    mix = {cast(Order, order): count for order, count in plan.tries.items()}
    tries = tries_of(leap, mix, seed=seed, stop=plan.stop, share=plan.share)
    table = table_of_tries(header, number, leap, tries)
    return _Scene(
        number=number,
        table=table,
        labels=[LABELS[one.status] for one in tries],
        ms=[round(1e3 * one.seconds, 3) for one in tries],
        cpu_s=time.process_time() - begin_s,
    )


class _Drafts:
    """The shards that are being made of scenes."""

    def __init__(self, header: TryHeader, missing: Sequence[int]) -> None:
        self._header, self._missing = header, missing
        self._there: dict[int, dict[int, _Scene]] = {shard: {} for shard in missing}

    def tasks(self) -> Iterator[Task[_Scene]]:
        """The scenes of all shards that are missing, one per task."""
        for shard in self._missing:
            for number in self._header.plan.scenes_of(shard):
                yield partial(_tried, self._header, number)

    def take(self, answer: _Scene) -> Shard | None:
        """Keep a scene; the shard that it completes."""
        plan = self._header.plan
        shard = answer.number // plan.scenes_a_shard
        there, wanted = self._there[shard], plan.scenes_of(shard)
        there[answer.number] = answer
        if len(there) < len(wanted):
            return None
        del self._there[shard]
        return self._whole(shard, [there[number] for number in wanted])

    def _whole(self, shard: int, scenes: list[_Scene]) -> Shard:
        import pyarrow as pa

        labels = Counter(label for each in scenes for label in each.labels)
        counts = Counts(
            feasible=labels["solved"], infeasible=labels["refuted"], undecided=labels["unsolved"]
        )
        tally = Tally(
            dataset=self._header.digest,
            shard=shard,
            rows=counts,
            drawn=counts,
            undecided_samples=[],
            software=ledger.software(),
        )
        timing = ShardTiming(
            shard=shard,
            cpu_s=sum(each.cpu_s for each in scenes),
            solve_ms=[ms for each in scenes for ms in each.ms],
        )
        table = pa.concat_tables([each.table for each in scenes]).combine_chunks()
        return Shard(table=table, tally=tally, timing=timing)


class _Recheck:
    """Tally of what the verifier has said so far. refused: rows; residuals: of plans; bounds: of
    multipliers.
    """

    def __init__(self) -> None:
        self.refused: set[int] = set()
        self.residuals: list[float] = []
        self.bounds: list[float] = []

    def judge(self, leap: Leap, rows: dict[str, Any], own: NDArray[np.intp]) -> None:
        """Judge the rows of a scene, by their indices."""
        refuter, cuts = Refuter(leap), dict[bytes, tuple[int, Array]]()
        solved = list[int]()
        for index in own.tolist():
            label, timing = str(rows["label"][index]), int(rows["timing"][index])
            accepted = label == "unsolved"
            if label == "solved" and timing in range(len(leap.timings_s)):
                plan = plan_of_row(
                    LeapNumbers.of(leap, timing), {name: rows[name][index] for name in rows}
                )
                report = check_leap(plan)
                self.residuals.append(report.worst)
                accepted = report.accepted
                solved += [index] if accepted else []
            elif label == "refuted":
                row = np.asarray(rows["multipliers"][index], dtype=np.float64)
                bound = float(refuter.bounds(timing, row, rows["choice"][index][None])[0])
                self.bounds.append(bound)
                accepted = bound > GUARD
                if accepted:
                    cuts[row.tobytes()] = (timing, row)
            self.refused |= set() if accepted else {index}
        for timing, row in cuts.values():
            against = [index for index in solved if rows["timing"][index] == timing]
            bounds = refuter.bounds(timing, row, rows["choice"][against])
            self.refused |= {
                index for index, bound in zip(against, bounds, strict=True) if bound > GUARD
            }


def _header(plan: TryPlan) -> TryHeader:
    """The header of a new data set."""
    first = scene(plan, 0)
    return TryHeader(
        problem_class=plan.distribution,
        legs=list(first.robot.limb_names),
        plan=plan,
        leap=json.loads(json.dumps(shared_keys(first))),
        shapes=shapes_of(first),
        speaks_of=_SPEAKS_OF,
        first_sample=hashlib.sha256(json.dumps(leap_to_json(first)).encode()).hexdigest(),
        software=ledger.software(),
    )
