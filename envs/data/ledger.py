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
from dataclasses import dataclass, field
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

from pydantic import BaseModel, Field, ValidationError

from stancekit.planners.arguments import cached_property
from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files import writing
from stancekit.planners.files.documents import open_file, read_json, shown, validation_errors
from stancekit.planners.files.writing import write_bytes

from .label_plan import (
    STRICT,
    Counts as Counts,
    LabelPlan as LabelPlan,
    RowPlan,
    TryPlan as TryPlan,
)

if TYPE_CHECKING:
    import pyarrow as pa


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
        """SHA-256 of everything but the software: what ties a shard to its data set."""
        return hashlib.sha256(
            self.model_dump_json(exclude={"software"}, exclude_none=True).encode()
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
    """

    format: Literal["stancekit/dataset/1"] = "stancekit/dataset/1"
    plan: LabelPlan
    witness: Literal["canonical/1"]
    robot: str | None = None
    speaks_of: str | None = None

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
