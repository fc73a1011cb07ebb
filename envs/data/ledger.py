"""The files of a data set, a JSON header and Parquet shards, each written whole or not at all.

``header.json`` says what was planned; ``shard-00000.parquet`` holds rows and, in its metadata, how
they were drawn. They follow from the plan to the last byte. How long it took does not, and is kept
apart in ``timing-00000.json``.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field, fields
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files import writing
from stancekit.planners.files.documents import open_file, read_json, shown, validation_errors
from stancekit.planners.files.writing import write_bytes
from stancekit.planners.robot.model import BUILT_IN

if TYPE_CHECKING:
    import pyarrow as pa

_MOST_ROWS, _MOST_SHARDS = 10**9, 10**5
STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)
_ORDERS = ("random", "rule", "farkas", "finder", "noise")
"""Orders in which a leap's contacts are chosen, see ``planners.leap.tries``."""
USUAL_TRIES: Mapping[str, int] = MappingProxyType({"random": 8, "finder": 4, "noise": 4})
"""Tries of a scene unless given: half of them spread over all choices, the others near
those that succeed."""


@dataclass(frozen=True, kw_only=True)
class RowPlan(ABC):
    """Request to label rows of any kind.

    Arguments:
        counted: settings that say how many rows there are in how many shards.
    """

    counted: ClassVar[tuple[str, ...]]

    @property
    @abstractmethod
    def rows(self) -> int:
        """Rows of the whole set, at most."""

    @property
    @abstractmethod
    def shards(self) -> int:
        """Number of shards over which the rows are spread."""

    def _check_counts(self, least: Mapping[str, int]) -> None:
        """Raise InvalidInput for a setting below its least integer, and for more than fits a
        folder.
        """
        for name, smallest in least.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < smallest:
                raise InvalidInput(
                    f"{name}: expected an integer of at least {smallest}, got {value!r}"
                )
        if self.rows > _MOST_ROWS or self.shards > _MOST_SHARDS:
            raise InvalidInput(
                f"{', '.join(self.counted)}: expected {_MOST_ROWS:.0e} rows, {_MOST_SHARDS:.0e} "
                "shards or fewer, "
                f"got {self.rows} in {self.shards}"
            )


@dataclass(frozen=True, kw_only=True)
class LabelPlan(RowPlan):
    """Request to label postures.

    The rows follow from it to the last bit, whoever draws them (on processors of one kind).

    Raises InvalidInput.

    Arguments:
        distribution: name of the distribution of problems.
        robot, terrain: files of the robot and of the terrain, if it is not the default hexapod and
            if there is one.
        feasible, infeasible: rows of each label; the infeasible ones are never trivial, that is,
            infeasible even without the moment balance.
        natural: keep the first ``feasible + infeasible`` samples as they come instead, whatever
            their label.
        shard_size: rows per shard, give or take one: as many are drawn and written at once, and an
            interruption loses as many; every process compiles its models once.
        seed: the samples of shard k are the stream of ``SeedSequence(seed, spawn_key=(k,))``: sets
            for training and for testing need different seeds.
        tolerance, gap, max_nodes: as in ``Acceptance`` and ``Exact``; one sample in 3000
            wants more nodes than the default, at 1 ms a node.
        screen: digest of a surrogate: a draw whose predicted label needs no more rows in the shard
            is skipped without being decided.
        screen_error: share of the other label's rows that it may skip so.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    counted: ClassVar[tuple[str, ...]] = ("feasible", "infeasible", "shard_size")

    distribution: str
    feasible: int
    infeasible: int
    shard_size: int = 500
    seed: int = 0
    natural: bool = False
    tolerance: float = 1e-6
    gap: float = 1e-4
    max_nodes: int = 500
    robot: str | None = None
    terrain: str | None = None
    screen: str | None = None
    screen_error: float | None = None

    def __post_init__(self) -> None:
        if self.robot in BUILT_IN:
            object.__setattr__(self, "robot", None)  # what nothing named is
        self._check_counts(
            {"feasible": 0, "infeasible": 0, "shard_size": 1, "seed": 0, "max_nodes": 1}
        )
        for name in ("tolerance", "gap"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise InvalidInput(
                    f"{name}: expected a number between 0 and 1, got {getattr(self, name)!r}"
                )
        if (self.screen is None) != (self.screen_error is None):
            raise InvalidInput("screen, screen_error: expected both or none, got one of them")
        if self.screen_error is not None and not 0.0 < self.screen_error < 1.0:
            raise InvalidInput(
                f"screen_error: expected a number between 0 and 1, got {self.screen_error!r}"
            )
        if self.screen is not None and self.natural:
            raise InvalidInput("screen: expected none with natural rows, which are all kept")
        if not self.rows:
            raise InvalidInput("feasible, infeasible: expected one row or more, got none")

    @property
    def rows(self) -> int:
        """Rows of the whole set."""
        return self.feasible + self.infeasible

    @property
    def shards(self) -> int:
        """Number of shards over which the rows are spread."""
        return -(-self.rows // self.shard_size)

    def quota(self, shard: int) -> tuple[int, int]:
        """(feasible, infeasible) rows of one shard; with ``natural`` only their sum counts."""

        def share(count: int, k: int) -> int:
            return (k + 1) * count // self.shards - k * count // self.shards

        return share(self.feasible, shard), share(self.infeasible, self.shards - 1 - shard)


@dataclass(frozen=True, kw_only=True)
class TryPlan(RowPlan):
    """Request to label tries of leaps.

    The rows follow from it to the last bit, whoever makes them (as of ``LabelPlan``).

    Raises InvalidInput.

    Arguments:
        distribution: a class of ``configs/leaps.yaml``.
        scenes: number of leaps; number k is drawn from a generator of (seed, k), as in benchmarks.
        tries: choices of contacts per scene of each order of ``LeapFinder``; fewer where a scene
            has no more.
        shard_size: rows per shard, but never less than one scene.
        seed: seed; sets for training and for testing need different ones.
        stop: cost of a first step above which a try is given up.
        share: share of the friction that plans use.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    counted: ClassVar[tuple[str, ...]] = ("scenes", "tries", "shard_size")

    distribution: str
    scenes: int
    tries: dict[str, int] = field(default_factory=lambda: dict(USUAL_TRIES))
    shard_size: int = 500
    seed: int = 0
    stop: float = 0.05
    share: float = 0.8

    def __post_init__(self) -> None:
        wanted = f"a count for some of {', '.join(_ORDERS)}"
        for order, count in self.tries.items():
            if order not in _ORDERS:
                raise InvalidInput(f"tries: expected {wanted}, got {order!r}")
            if isinstance(count, bool) or not isinstance(count, int) or count < 0:
                raise InvalidInput(
                    f"tries: expected an integer of at least 0 for {order}, got {count!r}"
                )
        orders = {order: self.tries[order] for order in _ORDERS if self.tries.get(order)}
        if not orders:
            raise InvalidInput(f"tries: expected {wanted}, got none")
        object.__setattr__(self, "tries", orders)
        self._check_counts({"scenes": 1, "shard_size": 1, "seed": 0})
        for name in ("stop", "share"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InvalidInput(
                    f"{name}: expected a number above 0 and up to 1, got {getattr(self, name)!r}"
                )

    @property
    def rows(self) -> int:
        """Tries of all scenes, where none has too few choices."""
        return self.scenes * sum(self.tries.values())

    @property
    def shards(self) -> int:
        """Number of shards over which the rows are spread."""
        return -(-self.scenes // self.scenes_a_shard)

    @property
    def scenes_a_shard(self) -> int:
        """Scenes of every shard but the last."""
        return max(self.shard_size // sum(self.tries.values()), 1)

    def scenes_of(self, shard: int) -> range:
        """Numbers of the scenes of a shard."""
        first = shard * self.scenes_a_shard
        return range(first, min(first + self.scenes_a_shard, self.scenes))


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Numbers of rows of each kind; ``infeasible`` leaves out the trivially infeasible.

    Tries that are solved, refuted and unsolved count as feasible, infeasible and undecided.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    feasible: int = 0
    infeasible: int = 0
    trivial: int = 0
    undecided: int = 0

    @property
    def total(self) -> int:
        """Sum of the four counts."""
        return sum(astuple(self))

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            **{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)}
        )


def pools() -> dict[str, Path]:
    """The folder of each data set that ships, by its name, pool-CLASS."""
    folder = Path(str(resources.files("stancekit.envs.pools")))
    return {path.parent.name: path.parent for path in sorted(folder.glob("pool-*/header.json"))}


def folder_of(path: str | Path) -> Path:
    """This folder; that of a data set that ships where there is none of this name."""
    folder = Path(path)
    return folder if os.path.exists(folder) else pools().get(str(path), folder)


def check_there(path: str | Path) -> None:
    """Raise InvalidInput where there is neither a file nor a data set of this name."""
    if not os.path.exists(folder_of(path)):
        raise InvalidInput(f"{path}: expected a plan, proof, gait or data set, found nothing there")


Part = Literal["all", "train", "test", "calibration"]
"""Part of a data set's rows: see ``Dataset.only``."""


def part_of(scene: str) -> Part:
    """The part of a scene, by a hash of what says all of it: a problem as a shard has it, or a
    leap's class, seed and number.
    """
    number = int.from_bytes(hashlib.sha256(scene.encode()).digest()[:8], "big")
    return "test" if number % 5 == 0 else "calibration" if number % 10 == 1 else "train"


def folder_and_part(path: str | Path, usual: Part = "train") -> tuple[str, Part]:
    """A folder and the part of it that is named, FOLDER:PART; the usual one where none is."""
    folder, _, part = str(path).rpartition(":")
    named = [each for each in get_args(Part) if folder and part == each]
    return (folder, named[0]) if named else (str(path), usual)


_SHARD_FORMAT = "stancekit/shard/1"
HEADER = "header.json"
_SOFTWARE = ("stancekit", "numpy", "clarabel", "cvxpy")
_MOST_SHARD_BYTES = 512_000_000
"""That a shard may unfold to."""

Model = TypeVar("Model", bound=BaseModel)


class Head(BaseModel, ABC):
    """Head of the header of every data set.

    Arguments:
        legs: limbs, in their order.
        first_sample: SHA-256 of what is drawn first, to know the distribution by.
        software: versions at the beginning.
        code: SHA-256 of each file of the code of one's own that it was drawn by; None without any.
    """

    model_config = STRICT
    format: str
    problem_class: str
    legs: list[str] = Field(min_length=1)
    plan: RowPlan
    first_sample: str
    software: dict[str, str]
    code: dict[str, str] | None = None

    @property
    def digest(self) -> str:
        """SHA-256 of everything but the software and the doubts: what ties a shard to its data set."""
        return hashlib.sha256(
            self.model_dump_json(exclude={"software", "doubts"}, exclude_none=True).encode()
        ).hexdigest()

    @abstractmethod
    def columns(self) -> pa.Schema:
        """Columns of the shards."""


class Header(Head):
    """``header.json``: the plan, and what else is true of every row.

    Arguments:
        legs: names of the legs in contact, in the order of the contacts.
        first_sample: SHA-256 of the first problem drawn, which identifies the distribution.
        software: versions of packages at the beginning.
        code: SHA-256 of each file of the code of one's own that they are drawn by.
        witness: how postures and points were chosen: as ``search.canonical`` says.
        robot: identity of the model that the legs belong to, see ``Robot``; None for the default
            hexapod.
        speaks_of: subject of the labels, in words, unless it is the robot itself.
        doubts: of the robot's file and of the terrain's, one line each; None for none.
    """

    format: Literal["stancekit/dataset/1"] = "stancekit/dataset/1"
    plan: LabelPlan
    witness: Literal["canonical/1"]
    robot: str | None = None
    speaks_of: str | None = None
    doubts: list[str] | None = None

    def columns(self) -> pa.Schema:
        """Columns of the shards."""
        return shard_schema(len(self.legs))


class TryHeader(Head):
    """``header.json`` of tries of leaps, the data set's card: what was planned, and what else is
    true of every row.

    Arguments:
        plan: plan of the data set, as it was requested.
        legs: names of the robot's limbs, in their order.
        leap: keys of ``stancekit/leap/1`` that all scenes share; for footholds limb and phase.
        shapes: shapes of the columns that are arrays.
        speaks_of: meaning of each label.
        first_sample: SHA-256 of the first leap.
        software: versions at the beginning.
        code: as of rows of postures; no class of leaps has any.
    """

    format: Literal["stancekit/tries/1"] = "stancekit/tries/1"
    plan: TryPlan
    leap: dict[str, Any]
    shapes: dict[str, list[int]]
    speaks_of: dict[str, str]

    def columns(self) -> pa.Schema:
        """Columns of the shards."""
        return _try_schema(self.shapes)


_HEADERS: Mapping[str, type[Header | TryHeader]] = MappingProxyType(
    {kind.model_fields["format"].default: kind for kind in (Header, TryHeader)}
)
"""The headers that there are, by their formats."""


class Tally(BaseModel):
    """Tally that a shard keeps in its metadata.

    Arguments:
        dataset: the header's digest.
        rows: kept.
        drawn: kept or not.
        undecided_samples: sample numbers of the undecided.
        software: versions that the shard was made with.
        screened: draws that a surrogate passed over undecided, by what it called them, and that
            ``drawn`` leaves out; None without one.
    """

    model_config = STRICT
    format: Literal["stancekit/shard/1"] = "stancekit/shard/1"
    dataset: str
    shard: int
    rows: Counts
    drawn: Counts
    undecided_samples: list[int]
    software: dict[str, str]
    screened: Counts | None = None


class ShardTiming(BaseModel):
    """``timing-00000.json``.

    Arguments:
        cpu_s: processor time of the shard [s].
        solve_ms: wall-clock time of every sample, or its share of the time of a block [ms].
        draw_cpu_s, screen_cpu_s: the parts of cpu_s in which problems were drawn and a surrogate was
            asked; None without one.
    """

    model_config = STRICT
    format: Literal["stancekit/timing/1"] = "stancekit/timing/1"
    shard: int
    cpu_s: float
    solve_ms: list[float]
    draw_cpu_s: float | None = None
    screen_cpu_s: float | None = None


def software() -> dict[str, str]:
    """Versions of what the labels depend on."""
    return {name: version(name) for name in _SOFTWARE}


def check_arrow() -> None:
    """Raise InvalidInput where pyarrow, which reads and writes the rows, is not installed."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise not_installed("data set", "pyarrow", "rows", "data") from None


def shard_schema(contacts: int) -> pa.Schema:
    """Columns of a shard of problems with N contacts; ``problem`` is JSON.

    What a row does not have is null.
    """
    import pyarrow as pa

    body, feet, point = (
        pa.fixed_shape_tensor(pa.float64(), s) for s in ([3], [contacts, 3], [contacts, 6])
    )
    int32, int64, float64, text = pa.int32(), pa.int64(), pa.float64(), pa.string()
    of_all = {
        "shard": int32,
        "row": int32,
        "sample": int64,
        "problem": text,
        "label": text,
        "trivial": pa.bool_(),
    }
    of_all |= {"lower_bound": float64, "solves": int32, "nodes": int32}
    of_some = {
        "com_m": body,
        "rotation_rad": body,
        "toes_m": feet,
        "forces_n": feet,
        "point": point,
    }
    of_some |= {
        "tree": pa.list_(float64),
        "multipliers": pa.list_(pa.float32()),
    }  # 5 a node; 6 + 3N a leaf
    columns = [pa.field(name, kind, nullable=False) for name, kind in of_all.items()]
    return pa.schema(columns + [pa.field(name, kind) for name, kind in of_some.items()])


def _try_schema(shapes: Mapping[str, list[int]]) -> pa.Schema:
    """Columns of a shard of tries; what a row does not have is null.

    The scene's are the same in all of its rows.
    """
    import pyarrow as pa

    int32, float64, text = pa.int32(), pa.float64(), pa.string()
    kinds = {"choice": int32, "candidates": int32, "multipliers": pa.float32()}
    arrays = {
        name: pa.fixed_shape_tensor(kinds.get(name, float64), shape)
        for name, shape in shapes.items()
    }
    of_all = {
        "scene": pa.int64(),
        "number": int32,
        "order": text,
        "timing": int32,
        "choice": arrays["choice"],
    }
    of_all |= {"label": text, "solves": int32}
    of_some = {"first_cost": float64, "cost": float64}
    of_some |= {name: arrays[name] for name in ("toes_m", "forces_n", "multipliers")}
    of_scene = {name: arrays[name] for name in ("start", "goal", "candidates")} | {
        "corners": pa.list_(int32)
    }
    of_scene |= {
        name: pa.list_(float64)
        for name in ("vertices_m", "normals", "shear_references", "friction")
    }
    columns = [pa.field(name, kind, nullable=False) for name, kind in of_all.items()]
    columns += [pa.field(name, kind) for name, kind in of_some.items()]
    columns += [pa.field(name, kind, nullable=False) for name, kind in of_scene.items()]
    return pa.schema([*columns, pa.field("stands_m", arrays["stands_m"])])


@dataclass(frozen=True, kw_only=True, eq=False)
class Ledger:
    """Shards of one data set.

    Arguments:
        tallies: tallies by shard number.
    """

    folder: Path
    header: Header | TryHeader
    tallies: Mapping[int, Tally] = field(default_factory=dict)

    @classmethod
    def open(cls, folder: Path) -> Ledger:
        """Read header and metadata of all shards that are there.

        Raises InvalidInput.
        """
        header = read_header(folder)
        check_arrow()
        tallies = [_read_tally(path, header) for path in sorted(folder.glob("shard-*.parquet"))]
        return cls(folder=folder, header=header, tallies={tally.shard: tally for tally in tallies})

    @classmethod
    def whole(cls, path: str | Path, kind: type[Head]) -> Ledger:
        """Open a data set of a kind, by its folder or, where it ships, by its name.

        Raises InvalidInput, also where shards are missing.
        """
        ledger = cls.open(folder_of(path))
        if not isinstance(ledger.header, kind):
            wanted = kind.model_fields["format"].default
            raise InvalidInput(
                f"{ledger.folder / HEADER}: format: expected {wanted!r}, got "
                f"{ledger.header.format!r}"
            )
        if ledger.missing:
            first, count = shard_name(ledger.missing[0]), len(ledger.missing)
            raise InvalidInput(
                f"{path}: {first} and {count - 1} more shards are missing: label this plan again"
            )
        return ledger

    @cached_property
    def starts(self) -> list[int]:
        """Number of rows before every shard and, last, of all; no shard may be missing."""
        return list(
            itertools.accumulate(
                (self.tallies[k].rows.total for k in range(len(self.tallies))), initial=0
            )
        )

    @property
    def missing(self) -> list[int]:
        """Numbers of the shards that are not there."""
        return [shard for shard in range(self.header.plan.shards) if shard not in self.tallies]

    def read(self, shard: int, columns: list[str] | None = None) -> pa.Table:
        """All rows of a shard, of these columns only if given.

        Raises InvalidInput for a damaged file.
        """
        import pyarrow.parquet as pq

        path = self.folder / shard_name(shard)
        try:
            return pq.read_table(
                path, columns=columns, page_checksum_verification=True, use_threads=False
            )
        except Exception as error:  # what Arrow's readers meet
            raise InvalidInput(
                f"{path}: expected a whole Parquet file, got {_line(error)}"
            ) from None

    def timings(self) -> list[ShardTiming]:
        """Times of the shards, of those that have any."""
        paths = (self.folder / _timing_name(shard) for shard in self.tallies)
        return [_read_json(path, ShardTiming) for path in paths if path.exists()]


@dataclass(frozen=True, kw_only=True, eq=False)
class Shard:
    """A shard as it comes from where it was drawn; ``write_shard`` makes files of it."""

    table: pa.Table
    tally: Tally
    timing: ShardTiming


def write_shard(folder: Path, table: pa.Table, tally: Tally, timing: ShardTiming) -> None:
    """Commit a shard: once its file is there, it counts."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    write_bytes(
        folder / _timing_name(tally.shard), timing.model_dump_json(exclude_none=True).encode()
    )
    sink = pa.BufferOutputStream()
    table = table.replace_schema_metadata({"stancekit": tally.model_dump_json(exclude_none=True)})
    pq.write_table(table, sink, compression="zstd", write_page_checksum=True)
    write_bytes(folder / shard_name(tally.shard), sink.getvalue().to_pybytes())


def read_header(folder: Path) -> Header | TryHeader:
    """The header of the data set in this folder.

    Raises InvalidInput.
    """
    if not folder.is_dir():
        what = "a file" if folder.exists() else "nothing"
        raise InvalidInput(f"{folder}: expected the folder of a data set, found {what}")
    path = folder / HEADER
    if not path.exists():
        raise InvalidInput(f"{path}: expected the header of a data set, found nothing")
    data: Any = read_json(path)
    format_ = data.get("format") if isinstance(data, dict) else None
    return _read_json(path, _HEADERS.get(format_, Header) if isinstance(format_, str) else Header)


def _read_tally(path: Path, header: Head) -> Tally:
    """Metadata of a shard, checked against the header.

    Raises InvalidInput.
    """
    import pyarrow.parquet as pq

    with open_file(path):
        pass
    try:
        file = pq.ParquetFile(path)
    except Exception as error:  # what Arrow's readers meet
        raise InvalidInput(f"{path}: expected a whole Parquet file, got {_line(error)}") from None
    with file:
        schema, rows = file.schema_arrow, file.metadata.num_rows
        size = sum(
            file.metadata.row_group(k).total_byte_size for k in range(file.metadata.num_row_groups)
        )
    if size > _MOST_SHARD_BYTES:
        raise InvalidInput(
            f"{path}: expected {_MOST_SHARD_BYTES} bytes of rows or fewer, got {size}"
        )
    try:
        tally = Tally.model_validate_json((schema.metadata or {}).get(b"stancekit", b""))
    except ValidationError:
        raise InvalidInput(
            f"{path}: expected a shard ({_SHARD_FORMAT}), got another Parquet file"
        ) from None
    if (
        tally.dataset != header.digest
        or path.name != shard_name(tally.shard)
        or tally.shard >= header.plan.shards
    ):
        raise InvalidInput(
            f"{path}: expected a shard of this data set, got shard {tally.shard} of another"
        )
    if rows != tally.rows.total or not schema.remove_metadata().equals(header.columns()):
        raise InvalidInput(
            f"{path}: expected {tally.rows.total} rows of the columns of {_SHARD_FORMAT}, got other rows"
        )
    return tally


def remove_leftovers(folder: Path) -> None:
    """Remove what killed runs were writing; what a living process writes stays."""
    writing.remove_leftovers(
        folder, lambda name: name == HEADER or name.startswith(("shard-", "timing-"))
    )


def shard_name(shard: int) -> str:
    """File name of a shard."""
    return f"shard-{shard:05d}.parquet"


def _timing_name(shard: int) -> str:
    """File name of a shard's times."""
    return f"timing-{shard:05d}.json"


def _read_json(path: Path, model: type[Model]) -> Model:
    expected = model.model_fields["format"].default
    data: Any = read_json(path)
    if not isinstance(data, dict) or data.get("format") != expected:
        got = data.get("format") if isinstance(data, dict) else data
        raise InvalidInput(f"{path}: format: expected {expected!r}, got {shown(got)}")
    try:
        return model.model_validate_json(json.dumps(data))
    except ValidationError as error:
        raise InvalidInput(f"{path}: " + "; ".join(validation_errors(error, model))) from None


def _line(error: Exception) -> str:
    """The first line of what another library says."""
    return (str(error) or type(error).__name__).splitlines()[0]
