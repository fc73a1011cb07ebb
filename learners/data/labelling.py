"""Algorithm E1, DataGeneration: draw posture problems, decide them exactly, keep S and S̄ as a data
set.

Rows come in shards. A shard is drawn from a random stream of its own, and the planner's answers do
not depend on what it answered before, so its rows depend on nothing but the plan. Any executor may
decide its samples, in blocks; this process puts them together in order and writes a shard once,
when it is whole. A run that was killed goes on from the shards that are there, and no folder need
be shared.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar

import numpy as np

from stancekit.envs.data import ledger
from stancekit.envs.data.dataset import Dataset, Summary, finite
from stancekit.envs.data.ledger import Header, LabelPlan, Part, Shard, TryHeader
from stancekit.envs.distributions.postures import Distribution
from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.motion import doubts_of
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import Strict
from stancekit.planners.files.writing import make_folder, write_bytes
from stancekit.planners.plugins import code_of, differing
from stancekit.planners.robot.model import BUILT_IN
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.verify import check_certificate, check_plan

from .executors import Executor, Task, processes
from .shards import LEAST, KeptPrograms, LabelBlock, Screen, ShardDraft, planned, samples

if TYPE_CHECKING:
    from ..surrogates.surrogate import Surrogate


H = TypeVar("H", Header, TryHeader)
Made = TypeVar("Made")

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Progress of a run.

    Arguments:
        rows, drawn: of all shards that are done.
        rate: samples drawn per second in this run.
    """

    shards_done: int
    shards: int
    rows: int
    drawn: int
    rate: float


class Drafts(Protocol[Made]):
    """The shards that are being made: which tasks come next, and which shard has become whole by an
    answer.
    """

    def tasks(self) -> Iterable[Task[Made] | None]:
        """Tasks for an executor."""

    def take(self, answer: Made) -> Shard | None:
        """Keep an answer; the shard that it completes."""


def fill(
    folder: Path,
    drafts_of: Callable[[Sequence[int]], Drafts[Made]],
    execute: Executor,
    progress: Callable[[Progress], None] | None = None,
) -> None:
    """Make the shards that a folder with a header lacks, and write each one once, when it is whole.

    Arguments:
        drafts_of: given the numbers of the shards that are missing.
        progress: called once at the start and after every shard.
    """
    there = ledger.Ledger.open(folder)
    done, begin = dict(there.tallies), time.perf_counter()
    earlier = sum(tally.drawn.total for tally in done.values())
    shards = there.header.plan.shards

    def report() -> None:
        count, rows = (
            sum(getattr(tally, name).total for tally in done.values()) for name in ("drawn", "rows")
        )
        rate = (count - earlier) / max(time.perf_counter() - begin, 1e-9)
        log.info(
            "label: %d of %d shards, %d rows of %d drawn, %.0f a second",
            len(done),
            shards,
            rows,
            count,
            rate,
        )
        if progress is not None:
            progress(
                Progress(shards_done=len(done), shards=shards, rows=rows, drawn=count, rate=rate)
            )

    report()
    drafts = drafts_of(there.missing)
    for answer in execute(drafts.tasks()):
        shard = drafts.take(answer)
        if shard is not None:
            ledger.write_shard(folder, shard.table, shard.tally, shard.timing)
            done[shard.tally.shard] = shard.tally
            report()


def begin(folder: Path, header: H) -> H:
    """Write the header of a new data set, or read that of the one begun here after checking that it
    is the same.

    Raises InvalidInput where the folder holds another data set.
    """
    make_folder(folder)
    ledger.remove_leftovers(folder)
    if not (folder / ledger.HEADER).exists() and not any(folder.glob("shard-*.parquet")):
        write_bytes(
            folder / ledger.HEADER, header.model_dump_json(indent=1, exclude_none=True).encode()
        )
        return header
    there = ledger.read_header(folder)
    where = f"{folder / ledger.HEADER}"
    if not isinstance(there, type(header)):
        raise InvalidInput(f"{where}: format: expected {header.format!r}, got {there.format!r}")
    begun: dict[str, Any] = asdict(there.plan)
    for key, wanted in asdict(header.plan).items():
        if wanted != begun[key]:
            raise InvalidInput(
                f"{where}: {key}: expected {wanted!r} as planned, got {begun[key]!r}"
            )
    if differs := differing(there.code or {}, header.code or {}):
        raise InvalidInput(
            f"{where}: code: expected that with which the folder was begun, got another {differs}: "
            "take another folder"
        )
    if there.digest != header.digest:
        distribution = header.plan.distribution
        raise InvalidInput(
            f"{where}: first_sample: expected what {distribution!r} draws here and now, got another"
        )
    if there.software != header.software:
        log.warning(
            "%s was begun with %s, goes on with %s", folder, there.software, header.software
        )
    return there


@dataclass(frozen=True, kw_only=True)
class Quota(Strict):
    """Number of rows per label, and their seed."""

    feasible: int
    infeasible: int
    seed: int


def rows_of(
    source: Dataset | str | Path,
    part: Part = "all",
    robot: str | None = None,
    terrain: str | Path | None = None,
) -> Dataset:
    """The rows of a data set, of its folder, or of one that ships by its name; or a part of them,
    which FOLDER:PART names, too.

    Arguments:
        robot, terrain: robot and terrain that the rows have to be of, if given.

    Raises:
        InvalidInput: for a folder that is no data set, and for rows of another robot or terrain.
    """
    if not isinstance(source, Dataset):
        folder, part = ledger.folder_and_part(source, part)
        source = Dataset.open(folder)
    dataset = source.only(part)
    _check_of(dataset, robot, terrain)
    return dataset


def _check_of(dataset: Dataset, robot: str | None, terrain: str | Path | None) -> None:
    """Raise InvalidInput unless the rows are of this robot and this terrain's file, where they are
    given.
    """
    where = dataset.ledger.folder
    if robot is not None:
        identity = "" if robot in BUILT_IN else named_robot(robot).identity
        if identity != dataset.robot:
            wanted, got = (name or BUILT_IN[0] for name in (identity, dataset.robot))
            raise InvalidInput(f"{where}: robot: expected a data set of {wanted}, got one of {got}")
    if terrain is None:
        return
    from stancekit.envs.distributions.cut import identity_of  # loads scipy

    wanted = identity_of(terrain)
    if not dataset.problem_class.endswith(f"-on-{wanted}"):
        raise InvalidInput(
            f"{where}: terrain: expected a data set of {wanted}, got one of {dataset.problem_class}"
        )


def check_unseen(dataset: Dataset, provenance: Mapping[str, Any], where: str) -> None:
    """Raise InvalidInput where a selector learned from rows of this data set, or from draws of the
    same seed.

    Arguments:
        provenance: the selector's, with what ``Dataset.origin`` says of its rows, or the set
            alone. Two different parts of the split by hash have no row in common, and parts of one
            set may have none.
    """
    mine, theirs = (
        dataset.origin,
        {name: provenance.get(name) for name in ("dataset", "first_sample")},
    )
    known = [mine.get("chosen"), provenance.get("chosen")]
    if theirs["dataset"] == mine["dataset"] and None not in known:
        seen, asked = (int(str(each), 16) for each in known)
        if not seen & asked:
            theirs = {}
    if isinstance(provenance.get("calibration"), dict):
        check_unseen(dataset, provenance["calibration"], where)
    parts = {mine["part"], provenance.get("part", "all")}
    if len(parts) == 2 and "all" not in parts:
        return
    same = [name for name, value in theirs.items() if value is not None and value == mine[name]]
    if same:
        origin = (
            "these rows"
            if same[0] == "dataset"
            else f"draws of the same seed, {dataset.header.plan.seed}"
        )
        raise InvalidInput(
            f"{where}: expected rows that it was not trained on, got {origin}: "
            f"{dataset.ledger.folder}; fit it to "
            "--part train and evaluate it on --part test, or label with another seed"
        )


_WITNESS: Literal["canonical/1"] = "canonical/1"
"""Choice of postures and points now (``search.canonical``); another choice gets another name."""

_INNER = (
    "feasible: of the robot, whose feet reach the inner sets of its legs; infeasible: of these "
    "inner sets and a level "
    "body, which proves nothing of the robot"
)
"""Note on a data set whose legs are half-spaces, see ``planners.robot.contact_robot``."""


@dataclass(frozen=True, kw_only=True)
class RecheckReport:
    """The verifier's word on all stored witnesses and certificates of a data set.

    Arguments:
        witnesses: how many postures or plans were checked.
        certificates: how many proofs were checked.
        refused: indices of the rows whose proof is missing, is not accepted or proves less than its
            row says; of tries of leaps also of those that are solved, and that a proof of another
            try of the scene speaks against.
        worst_residual: largest violation by a witness, non-dimensional; NaN without any.
        smallest_bound: least that the certificates of rows that are not trivial prove, likewise.
        seconds: time taken [s].
    Source:
        E1-E11.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> stancekit.verify(train).accepted
        True
    """

    witnesses: int
    certificates: int
    refused: tuple[int, ...]
    worst_residual: float
    smallest_bound: float
    seconds: float

    @property
    def accepted(self) -> bool:
        """Tell whether the verifier accepted all rows."""
        return not self.refused

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; what is not finite becomes null."""
        return {"accepted": self.accepted, **finite(asdict(self))}


def label(
    plan: LabelPlan,
    path: str | Path,
    *,
    workers: int = 1,
    progress: Callable[[Progress], None] | None = None,
    source: Distribution | None = None,
    run: Executor | None = None,
    draws_per_row: int = 10_000,
    surrogate: Surrogate | None = None,
) -> Summary:
    """Make the planned data set in this folder, or what is missing of it (Algorithm E1).

    Arguments:
        workers: processes; the rows do not depend on them.
        progress: called once at the start and after every shard.
        source: the distribution, where its name is not a registered one.
        run: the executor, in place of ``processes``.
        draws_per_row: a shard gives up after this many draws a row.
        surrogate: the one whose digest is planned, which screens the draws.

    Raises:
        InvalidInput: where the folder holds another data set, StancekitError where a shard gives
            up.
    """
    execute = run or processes(workers)
    if source is not None and source.name != plan.distribution:
        raise InvalidInput(
            f"distribution: expected the planned {plan.distribution!r}, got {source.name!r}"
        )
    folder, source = Path(path), source or planned(plan)
    ledger.check_arrow()
    if plan.screen != (None if surrogate is None else surrogate.digest):
        raise InvalidInput("surrogate: expected the one whose digest is planned")
    screen = None
    if surrogate is not None and plan.screen_error is not None:
        surrogate.check_drawn(source.name, source.sample(np.random.default_rng(0)))
        screen = Screen.of(surrogate, plan.screen_error)
    header = begin(folder, _header(plan, source))

    def drafts(missing: Sequence[int]) -> _Drafts:
        return _Drafts(header, missing, execute, source, draws_per_row, screen)

    fill(folder, drafts, execute, progress)
    return Dataset.open(folder).summary()


class _Drafts:
    """The shards that are being drawn: which samples are decided next, and which shard has become
    whole by it.
    """

    def __init__(
        self,
        header: Header,
        missing: Sequence[int],
        executor: Executor,
        source: Distribution,
        draws_per_row: int,
        screen: Screen | None = None,
    ) -> None:
        self._source, self._executor = source, executor
        came, programs = Counter[str](), KeptPrograms()
        self._unopened = iter(
            [ShardDraft(header, shard, draws_per_row, came, programs, screen) for shard in missing]
        )
        self._left, self._open = len(missing), list[ShardDraft]()

    def tasks(self) -> Iterator[Callable[[], LabelBlock] | None]:
        """Blocks to decide, of the first shards first; None where there are none until another
        block is decided.
        """
        while self._left or self._open:
            if self._left and not any(draft.lacking for draft in self._open):
                self._open.append(next(self._unopened))
                self._left -= 1
            lacking = [draft.lacking for draft in self._open]
            k = next((k for k, count in enumerate(lacking) if count), None)
            if k is None:
                yield None
                continue
            expected = sum(lacking) + self._left * lacking[-1]
            share = max(math.ceil(expected / max(self._executor.workers, 1)), LEAST)
            yield self._open[k].block(self._source, min(lacking[k], share, self._open[k].most))

    def take(self, block: LabelBlock) -> Shard | None:
        """The shard that this block completes.

        Raises StancekitError.
        """
        draft = next((draft for draft in self._open if draft.shard == block.shard), None)
        shard = None if draft is None else draft.take(block)
        if draft is not None and shard is not None:
            self._open.remove(draft)
        return shard


def recheck(dataset: Dataset) -> RecheckReport:
    """Let the verifier judge every stored witness and certificate again: no solver takes part."""
    began, plan = time.perf_counter(), dataset.header.plan
    refused, residuals, bounds, certificates = [], [], [], 0
    for index, row in enumerate(dataset.rows()):
        accepted = row.status is Status.UNDECIDED
        if row.status is Status.FEASIBLE and row.posture is not None and row.point is not None:
            report = check_plan(row.posture, tolerance=plan.tolerance)
            residuals.append(report.worst)
            off = float(np.abs(Scaled.of(row.problem).point(row.posture) - row.point).max())
            accepted = report.accepted and off < 1e-9
        elif row.status is Status.INFEASIBLE and row.certificate is not None:
            proof = check_certificate(row.certificate, tolerance=plan.gap)
            certificates += 1
            bounds += [] if row.trivial else [proof.figures["lower_bound"]]
            accepted = (
                proof.accepted and proof.figures["lower_bound"] >= (1.0 - 1e-9) * row.lower_bound
            )
        refused += [] if accepted else [index]
    return RecheckReport(
        witnesses=len(residuals),
        certificates=certificates,
        refused=tuple(refused),
        worst_residual=max(residuals, default=math.nan),
        smallest_bound=min(bounds, default=math.nan),
        seconds=time.perf_counter() - began,
    )


def _header(plan: LabelPlan, source: Distribution) -> Header:
    """The header of a new data set."""
    first = next(samples(plan, 0, source))
    return Header(
        problem_class=source.name,
        legs=list(first.legs),
        plan=plan,
        first_sample=hashlib.sha256(json.dumps(first.to_json()).encode()).hexdigest(),
        software=ledger.software(),
        code=code_of(plan.distribution, plan.terrain or "") or None,
        witness=_WITNESS,
        robot=first.robot.identity or None,
        speaks_of=_INNER
        if any(contact.reach_rows is not None for contact in first.contacts)
        else None,
        doubts=list(doubts_of(source)) or None,
    )
