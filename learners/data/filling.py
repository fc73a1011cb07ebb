"""Filling a data set's folder: whatever is drawn, shard by shard, on any executor, going on from
what is there.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from stancekit.envs.data import ledger
from stancekit.envs.data.ledger import Header, Shard, TryHeader
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.writing import write_bytes

from .executor import Executor, Task

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
        ...

    def take(self, answer: Made) -> Shard | None:
        """Keep an answer; the shard that it completes."""
        ...


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
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(
            f"{folder}: expected a folder or room for one, got {error.strerror}"
        ) from None
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
