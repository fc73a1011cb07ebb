"""Data sets of labelled posture problems (Algorithm E1): what ``labelling`` writes and selectors
learn from.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial, reduce
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.answer.plan import Plan
from stancekit.planners.arguments import cached_property
from stancekit.planners.equilibrium.batch import ScaledBatch
from stancekit.planners.equilibrium.scaled import Scaled, observe, observe_batch
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, read_only
from stancekit.planners.files.documents import parse_json
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.robot import Limb, Robot

from ..scenes import LabelledScene
from .ledger import (
    Counts,
    Header,
    Ledger,
    Part,
    folder_and_part,
    part_of,
    shard_name,
    shard_schema,
)

if TYPE_CHECKING:
    import pyarrow as pa


_POSTURE: dict[str, tuple[int, ...]] = {
    "com_m": (3,),
    "rotation_rad": (3,),
    "toes_m": (-1, 3),
    "forces_n": (-1, 3),
}
"""Columns of the witness, and the shapes of what they hold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledPosture:
    """One row: a problem, its label, and what proves the label.

    Arguments:
        shard, row: shard, and row in it, in which it is kept.
        sample: number of the draw in the shard's stream (``labelling.samples``).
        trivial: True if infeasible even without the moment balance (P̄ infeasible, too).
        posture: the witness; None unless feasible.
        certificate: the proof; None unless infeasible. Its multipliers are rounded to float32, and
            lower_bound is what they still prove (0 if nothing is proved).
        point: [p, f], shape (N, 6), non-dimensional, see ``ScaledProblem.point``: that of the
            witness for a feasible row, that of an answer of P̄ for an infeasible one (line 11 of
            Algorithm E1), None for a trivial or undecided one.
        solves, nodes: numbers of convex problems solved and of nodes visited for the verdict.
    """

    shard: int
    row: int
    sample: int
    problem: Problem
    status: Status
    trivial: bool = False
    posture: Plan | None = None
    point: Array | None = None
    certificate: Certificate | None = None
    lower_bound: float = 0.0
    solves: int
    nodes: int

    def __post_init__(self) -> None:
        if self.point is not None:
            object.__setattr__(
                self, "point", read_only(self.point, (len(self.problem.contacts), 6), "point")
            )

    @property
    def kind(self) -> str:
        """The label, "trivial" set apart: a name of ``Counts``."""
        return "trivial" if self.trivial else str(self.status)


def _problem_of(raw: dict[str, Any], robot: Robot) -> Problem:
    """The problem of a shard's row, equal to what was drawn to the last bit.

    Arguments:
        robot: any with the legs of the set.
    """
    return Problem.from_json(parse_json(raw["problem"], "problem"), robot=robot)


def _row_of(raw: dict[str, Any], robot: Robot) -> LabelledPosture:
    """Posture and label in a row of a shard, whose columns have these names."""
    problem, certificate = _problem_of(raw, robot), None
    if raw["tree"] is not None:
        rows = sum(len(c.reach_rows.bounds_m) for c in problem.contacts if c.reach_rows is not None)
        multipliers = np.reshape(raw["multipliers"], (-1, 6 + 3 * len(problem.contacts) + rows))
        nodes = 2 * len(multipliers) - 1  # of a binary tree with so many leaves
        certificate = Certificate.from_arrays(np.reshape(raw["tree"], (nodes, -1)), multipliers).of(
            problem
        )
    witness = {
        name: np.reshape(raw[name], shape)
        for name, shape in _POSTURE.items()
        if raw[name] is not None
    }
    return LabelledPosture(
        problem=problem,
        status=Status(raw["label"]),
        posture=Plan.of_posture(problem, **witness) if witness else None,
        point=None if raw["point"] is None else np.reshape(raw["point"], (-1, 6)),
        certificate=certificate,
        **{
            name: raw[name]
            for name in ("shard", "row", "sample", "trivial", "lower_bound", "solves", "nodes")
        },
    )


def table_of(rows: Sequence[LabelledPosture], contacts: int) -> pa.Table:
    """The rows as a shard's table."""
    import pyarrow as pa

    schema = shard_schema(contacts)
    return pa.Table.from_arrays(
        [as_column([_cell(row, f.name) for row in rows], f.type) for f in schema], schema=schema
    )


def _cell(row: LabelledPosture, name: str) -> Any:
    if name == "problem":
        return json.dumps(row.problem.to_json(), separators=(",", ":"))
    if name == "label":
        return str(row.status)
    if name in _POSTURE:
        return None if row.posture is None else getattr(row.posture, name).ravel()
    if name in ("tree", "multipliers"):
        return None if row.certificate is None else getattr(row.certificate, name).ravel()
    value = getattr(row, name)
    return value.ravel() if name == "point" and value is not None else value


def as_column(values: list[Any], kind: pa.DataType) -> pa.Array:
    """Values as a column of this type."""
    import pyarrow as pa

    if isinstance(kind, pa.FixedShapeTensorType):
        return pa.ExtensionArray.from_storage(kind, pa.array(values, kind.storage_type))
    return pa.array(values, kind)


_ALWAYS = ("rows", "drawn", "cpu_s_per_1000", "solve_ms_median", "solve_ms_p99")
"""Figures that the summary of every data set has."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Contents and cost of a data set.

    Arguments:
        rows: rows kept, by label.
        drawn: samples drawn, kept or not, by label.
        cpu_s_per_1000: processor seconds for 1000 samples drawn.
        solve_ms_median, solve_ms_p99: median and 99th percentile of the wall-clock time to decide a
            sample, or of its share of a block [ms]; NaN without timing files.
        screened: draws that a surrogate skipped undecided, by predicted label, which ``drawn``
            leaves out; None without one.
        screen_error: largest share of the rows of the other label that may be among them, and so be
            missing here; None without a surrogate.
        draw_cpu_s_per_1000, screen_cpu_s_per_1000: the parts of cpu_s_per_1000 in which problems
            were drawn and the surrogate was asked; None without one.
    """

    rows: Counts
    drawn: Counts
    cpu_s_per_1000: float
    solve_ms_median: float
    solve_ms_p99: float
    screened: Counts | None = None
    screen_error: float | None = None
    draw_cpu_s_per_1000: float | None = None
    screen_cpu_s_per_1000: float | None = None

    @classmethod
    def of(cls, ledger: Ledger) -> Summary:
        """Count what the shards hold."""
        tallies, timings = ledger.tallies.values(), ledger.timings()
        solve_ms = np.concatenate([np.zeros(0), *(timing.solve_ms for timing in timings)])
        timed = len(solve_ms) > 0
        plan = ledger.header.plan
        error = getattr(plan, "screen_error", None)
        screened = reduce(add, (tally.screened or Counts() for tally in tallies), Counts())
        parts = {
            f"{name}_per_1000": 1e3
            * sum(getattr(timing, name) or 0.0 for timing in timings)
            / len(solve_ms)
            for name in ("draw_cpu_s", "screen_cpu_s")
            if error is not None and timed
        }
        return cls(
            rows=reduce(add, (tally.rows for tally in tallies), Counts()),
            drawn=reduce(add, (tally.drawn for tally in tallies), Counts()),
            cpu_s_per_1000=1e3 * sum(timing.cpu_s for timing in timings) / len(solve_ms)
            if timed
            else math.nan,
            solve_ms_median=float(np.median(solve_ms)) if timed else math.nan,
            solve_ms_p99=float(np.quantile(solve_ms, 0.99)) if timed else math.nan,
            screened=None if error is None else screened,
            screen_error=error,
            **parts,
        )

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; NaN becomes null, and what only a surrogate has is left out
        without one.
        """
        return finite(
            {
                name: value
                for name, value in asdict(self).items()
                if value is not None or name in _ALWAYS
            }
        )


def finite(values: dict[str, Any]) -> dict[str, Any]:
    """Replace numbers that JSON lacks by None."""
    return {
        k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()
    }


_Index = NDArray[np.intp]
_Observation = dict[str, NDArray[np.float32]]
Read = TypeVar("Read")
_LABELS = {"feasible": 1, "infeasible": 0, "undecided": -1}
"""Labels that ``Dataset[k]`` gives to a row."""
OPEN_SHARDS, OPEN_TEXTS = 4, 64
"""Numbers of shards that a data set keeps decompressed, and of those whose problems alone it keeps:
rows are asked for in any order.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Like:
    """The data that the problems of a set share.

    Arguments:
        rest: the JSON form without what the patches say.
        corners: corners of each patch.
    """

    rest: Any
    problem: Problem
    scaled: Scaled
    corners: int


class _Scene(NamedTuple):
    """The visible part of a scaled problem."""

    patches: Array
    frames: Array
    friction: Array
    shoulders: Array
    reach: Array


def _patches(text: str) -> tuple[Array, Array, Array, Any]:
    """Vertices, normals and friction of a problem's patches, with an axis before, and the rest."""
    rest = parse_json(text, "problem")
    names = ("vertices_m", "normal", "friction")
    values = [np.array([[each.pop(name) for each in rest["contacts"]]]) for name in names]
    return values[0], values[1], values[2], rest


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Dataset:
    """Rows of one problem class, read from the disk when they are asked for.

    ``split`` gives data sets, too. What ``ds[k]`` gives is kept once it was asked for, some 1,000
    bytes a row.

    It is what ``torch.utils.data.DataLoader`` takes: ``len(ds)``, and ``ds[k]`` is the pair of the
    scene as a policy sees it (``planners.equilibrium.features.observe``: float32 arrays by name)
    and the label: 1 feasible, 0 infeasible, −1 undecided. ``ds.row(k)`` is the whole row with its
    evidence, ``ds.rows()`` all of them.

    Arguments:
        ledger: the folder's files, see ``Dataset.open``.
        chosen: indices of the rows of the folder that belong to it, in this order, shape (K,).
        part: name of the part that the rows were confined to, see ``only``.

    Raises:
        InvalidInput: from ``open``, for a folder that is missing, foreign, damaged or of another
            version.
    Source:
        Algorithm E1.

    Example:
        >>> import stancekit
        >>> rows = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> observation, label = rows[0]
        >>> observation["friction"].shape, label == (rows.labels[0] == "feasible")
        ((3,), True)
    """

    ledger: Ledger
    chosen: _Index
    part: Part = "all"
    _open: dict[int, pa.Table] = field(default_factory=dict)
    _texts: dict[int, list[str]] = field(default_factory=dict)
    _seen: dict[int, _Observation] = field(default_factory=dict)

    @classmethod
    def open(cls, path: str | Path) -> Dataset:
        """Open a folder that ``labelling.label`` has filled, or a data set that ships by its name;
        reads no rows yet.

        Raises InvalidInput for what is missing, foreign, damaged or of another version.
        """
        ledger = Ledger.whole(path, Header)
        return cls(ledger=ledger, chosen=np.arange(ledger.starts[-1]))

    @property
    def header(self) -> Header:
        """Header of the set: the problems that were planned, and the settings."""
        header = self.ledger.header
        assert isinstance(header, Header)
        return header

    @property
    def problem_class(self) -> str:
        """Name of the class of problems, e.g. ``wall-3``."""
        return self.header.problem_class

    @property
    def robot(self) -> str:
        """Identity of the robot that the rows are of, see ``Robot``; empty for the default
        hexapod.
        """
        return self.header.robot or ""

    def __repr__(self) -> str:
        return f"Dataset({str(self.ledger.folder)!r}, {self.problem_class}, {len(self)} rows)"

    def __len__(self) -> int:
        return len(self.chosen)

    def __getitem__(self, index: int) -> tuple[_Observation, int]:
        """Observation of a row's scene, and its label.

        Raises as ``row`` does.
        """
        if isinstance(index, slice):
            raise InvalidInput("index: expected a whole number, got a slice: select gives several")
        if not -len(self) <= index < len(self):
            raise IndexError(f"row {index} of {len(self)}")
        place = int(self.chosen[index])
        scene = self._seen.get(place)
        if scene is None:
            scene = self._observed(place)
            if scene is None:
                scene = observe(Scaled.of(self._read(index % len(self), self._problem)))
            self._seen[place] = scene
        return {name: values.copy() for name, values in scene.items()}, int(self._answers[index])

    def _observed(self, place: int) -> _Observation | None:
        """Observation of a row of the folder; None where its problem differs from the first one's
        in more than its patches, or cannot be read so.
        """
        shard = int(np.searchsorted(self.ledger.starts, place, side="right")) - 1
        texts = self._texts.get(shard)
        if texts is None:  # another thread may be reading, too
            for old in list(self._texts)[: 1 - OPEN_TEXTS]:
                self._texts.pop(old, None)
            column = self.ledger.read(shard, ["problem"]).column("problem")
            texts = self._texts[shard] = column.to_pylist()
        try:
            vertices, normals, friction, rest = _patches(texts[place - self.ledger.starts[shard]])
            if self._like is None or rest != self._like.rest:
                return None
            batch = PostureBatch(
                like=self._like.problem,
                vertices_m=vertices,
                normals=normals,
                friction=friction,
                convex=True,
            )
        except (InvalidInput, TypeError, ValueError, KeyError, IndexError, AttributeError):
            return None  # a row that is damaged is told when it is read whole
        if vertices.shape[2] != self._like.corners:
            return None
        scaled, like = ScaledBatch.of(batch, self._like.scaled), self._like.scaled
        scene = _Scene(
            scaled.vertices[0], scaled.frames[0], scaled.friction[0], like.shoulders, like.reach
        )
        return {name: values[0] for name, values in observe_batch([scene]).items()}

    @cached_property
    def _like(self) -> _Like | None:
        """What all problems share with the first of the folder; None where that cannot be read."""
        try:
            text = self.ledger.read(0, ["problem"]).column("problem")[0].as_py()
            vertices, normals, friction, rest = _patches(text)
            problem = self._problem({"problem": text})
            batch = PostureBatch(
                like=problem, vertices_m=vertices, normals=normals, friction=friction
            )
        except (InvalidInput, TypeError, ValueError, KeyError, IndexError, AttributeError):
            return None
        like = ScaledBatch.of(batch).like
        return _Like(rest=rest, problem=problem, scaled=like, corners=vertices.shape[2])

    def __iter__(self) -> Iterator[tuple[_Observation, int]]:
        """The pairs of all rows in their order."""
        return map(self.__getitem__, range(len(self)))

    def rows(self) -> Iterator[LabelledPosture]:
        """All rows, shard by shard: memory stays flat."""
        return map(self.row, range(len(self)))

    def row(self, index: int) -> LabelledPosture:
        """One row.

        Raises IndexError, and InvalidInput where the file is damaged.
        """
        return self._read(index, partial(_row_of, robot=self._robot))

    def problems(self) -> Iterator[Problem]:
        """The problems of all rows, one after the other; equal to what was drawn to the last
        bit.
        """
        return (self._read(index, self._problem) for index in range(len(self)))

    @property
    def labels(self) -> NDArray[np.str_]:
        """Labels, "feasible", "infeasible" or "undecided", shape (K,)."""
        return np.asarray(np.where(self._kinds == "trivial", "infeasible", self._kinds))

    @property
    def feasible(self) -> _Index:
        """Indices of the feasible rows, ascending."""
        return np.flatnonzero(self._kinds == "feasible")

    @property
    def infeasible(self) -> _Index:
        """Indices of the infeasible rows that are not trivial, ascending."""
        return np.flatnonzero(self._kinds == "infeasible")

    @property
    def trivial(self) -> _Index:
        """Indices of the trivially infeasible rows, ascending; a balanced set has none."""
        return np.flatnonzero(self._kinds == "trivial")

    @property
    def points(self) -> Array:
        """S of Algorithm E1: [p, f] of the rows ``feasible``, shape (len(feasible), N, 6)."""
        return np.asarray(self._points[self.feasible])

    @property
    def infeasible_points(self) -> Array:
        """S̄ of Algorithm E1: [p̄, f̄] of the rows ``infeasible``, shape (len(infeasible), N,
        6).
        """
        return np.asarray(self._points[self.infeasible])

    def summary(self) -> Summary:
        """Counts and costs of the whole folder."""
        return Summary.of(self.ledger)

    def select(self, indices: ArrayLike) -> Dataset:
        """The data set of these rows, by their numbers or by a mask, as NumPy takes them.

        Raises InvalidInput for anything else.
        """
        try:
            rows = np.asarray(indices)
            found = self.chosen[rows if rows.size else rows.astype(np.intp)]
            # a row of rows is none that numbers can be broadcast to
            return replace(self, chosen=np.broadcast_to(found, found.size), _open={})
        except (IndexError, ValueError) as error:
            raise InvalidInput(
                f"indices: expected numbers of rows or a mask of {len(self)}: {error}"
            ) from None

    def only(self, part: Part) -> Dataset:
        """The rows of "train", of "test", two in ten, or of "calibration", one in ten, by a hash of
        their problems; or "all".

        A problem is of the same part in whatever data set it is: what was learned from "train" has
        seen nothing of the others. Raises InvalidInput for another part.
        """
        if part not in get_args(Part):
            raise InvalidInput(f"part: expected one of {', '.join(get_args(Part))}, got {part!r}")
        if part == "all":
            return self
        shards = [self.ledger.read(shard, ["problem"]) for shard in range(self.header.plan.shards)]
        texts = [text for shard in shards for text in shard.column("problem").to_pylist()]
        members = [part_of(texts[k]) == part for k in self.chosen]
        return replace(self.select(members), part=part)

    @property
    def origin(self) -> dict[str, str]:
        """Origin of these rows, which a selector keeps: digest of the set, of its draws, the part,
        and which rows of the set they are where they are not all, a bit each.
        """
        origin = {
            "dataset": self.header.digest,
            "first_sample": self.header.first_sample,
            "part": self.part,
        }
        mine = np.zeros(self.ledger.starts[-1], dtype=bool)
        mine[self.chosen] = True
        return origin if mine.all() else {**origin, "chosen": np.packbits(mine).tobytes().hex()}

    def split(self, fractions: Sequence[float]) -> tuple[Dataset, ...]:
        """Disjoint data sets of these shares of every kind of rows, always the same ones, e.g. (.6,
        .2, .2).

        Rows are independent draws, so each part takes the next ones of each kind: no chance is
        needed. Raises InvalidInput unless the fractions are positive and add up to 1 at most.
        """
        if not fractions or min(fractions) <= 0.0 or sum(fractions) > 1.0 + 1e-9:
            raise InvalidInput(
                "fractions: expected positive numbers that add up to 1 at most, got "
                f"{list(fractions)}"
            )
        kinds = [np.flatnonzero(self._kinds == kind) for kind in np.unique(self._kinds)]
        parts = []
        for begin, end in itertools.pairwise(np.minimum(np.cumsum([0.0, *fractions]), 1.0)):
            chosen = [kind[round(begin * len(kind)) : round(end * len(kind))] for kind in kinds]
            parts.append(self.select(np.sort(np.concatenate(chosen))))
        return tuple(parts)

    @cached_property
    def _answers(self) -> NDArray[np.int64]:
        """Labels as ``Dataset[k]`` gives them."""
        return np.array([_LABELS[label] for label in self.labels.tolist()], dtype=np.int64)

    @cached_property
    def _kinds(self) -> NDArray[np.str_]:
        """Labels with "trivial" set apart, shape (K,)."""
        names = ["label", "trivial"]
        tables = [self.ledger.read(shard, names) for shard in range(self.header.plan.shards)]
        label, trivial = (
            np.concatenate([table.column(name).to_numpy() for table in tables]) for name in names
        )
        return np.where(trivial, "trivial", label).astype(np.str_)[self.chosen]

    @cached_property
    def _points(self) -> Array:
        """Points of all rows, NaN where there is none, shape (K, N, 6)."""
        result = []
        for shard in range(self.header.plan.shards):
            column = self.ledger.read(shard, ["point"]).column("point").combine_chunks()
            points = np.full((len(column), len(self.header.legs), 6), np.nan)
            there = column.drop_null()
            if len(there):
                points[column.is_valid().to_numpy(zero_copy_only=False)] = there.to_numpy_ndarray()
            result.append(points)
        return np.asarray(np.concatenate(result)[self.chosen])

    @cached_property
    def _robot(self) -> Robot:
        """Any robot with the legs of the set: the problems carry their own shoulders and
        reaches.
        """
        limbs = tuple(
            Limb(name=leg, shoulder_m=np.zeros(3), reach_m=1.0) for leg in self.header.legs
        )
        return Robot(name=self.problem_class, mass_kg=1.0, limbs=limbs)

    def _problem(self, raw: dict[str, Any]) -> Problem:
        return _problem_of(raw, self._robot)

    def _read(self, index: int, decode: Callable[[dict[str, Any]], Read]) -> Read:
        """Columns of one row, decoded."""
        place = int(self.chosen[index])
        shard = int(np.searchsorted(self.ledger.starts, place, side="right")) - 1
        table = self._open.get(shard)
        if table is None:  # another thread may be reading, too
            for old in list(self._open)[: 1 - OPEN_SHARDS]:
                self._open.pop(old, None)
            table = self._open[shard] = self.ledger.read(shard)
        row = place - self.ledger.starts[shard]
        try:
            return decode(table.slice(row, 1).to_pylist()[0])
        except (TypeError, ValueError, OverflowError, KeyError, AttributeError) as error:
            raise InvalidInput(
                f"{self.ledger.folder / shard_name(shard)}: row {row}: {error}"
            ) from None


def scenes_of(dataset: Dataset) -> list[LabelledScene]:
    """The data set's feasible and hard infeasible rows as scenes."""
    return [
        scene_of(row)
        for row in dataset.rows()
        if row.status is not Status.UNDECIDED and not row.trivial
    ]


def scene_of(row: LabelledPosture) -> LabelledScene:
    """A decided row as a scene."""
    return LabelledScene(
        problem=row.problem,
        feasible=row.status is Status.FEASIBLE,
        posture=row.posture,
        lower_bound=row.lower_bound,
    )


class ScenePool:
    """Scenes of a labelled data set, drawn at random; all are in memory, and keep their scaled
    numbers once drawn.

    Arguments:
        balanced: toss a coin for the label, then any row of it is as likely, the trivially
            infeasible left out; else any row of all.

    Raises:
        InvalidInput: for undecided rows, and where no rows of a label are there to draw.
    """

    def __init__(self, dataset: Dataset, *, balanced: bool = True) -> None:
        where = f"{dataset.ledger.folder}: part {dataset.part}"
        if undecided := int((dataset.labels == "undecided").sum()):
            raise InvalidInput(
                f"{where}: expected labelled rows, got {undecided} undecided of {len(dataset)}"
            )
        parts = {"infeasible": dataset.infeasible, "feasible": dataset.feasible}
        for name, rows in (parts if balanced else {"any": dataset.chosen}).items():
            if not len(rows):
                raise InvalidInput(
                    f"{where}: expected rows of the label {name}, got none of {len(dataset)}"
                )
        sets = [dataset.select(rows) for rows in parts.values()] if balanced else [dataset]
        self._scenes = tuple(tuple(scene_of(row) for row in rows.rows()) for rows in sets)

    @classmethod
    def open(
        cls,
        rows: Dataset | str | Path,
        *,
        of: str,
        legs: Sequence[str],
        balanced: bool = True,
    ) -> ScenePool:
        """The pool of a data set, or of a folder's part, FOLDER:PART, "train" where it names none.

        Arguments:
            of, legs: the class of problems that it has to be of, which names the robot, too.

        Raises:
            InvalidInput: for a folder that is none, of another version or of other problems, or
                with undecided rows.
        """
        if isinstance(rows, Dataset):
            dataset, folder = rows, str(rows.ledger.folder)
        else:
            folder, part = folder_and_part(rows)
            dataset = Dataset.open(folder).only(part)
        if (dataset.problem_class, tuple(dataset.header.legs)) != (of, tuple(legs)):
            got = f"{dataset.problem_class} on the legs {', '.join(dataset.header.legs)}"
            raise InvalidInput(
                f"{folder}: expected scenes of {of} on the legs {', '.join(legs)}, got some of "
                f"{got}"
            )
        return cls(dataset, balanced=balanced)

    def __len__(self) -> int:
        return sum(map(len, self._scenes))

    def draw(self, rng: np.random.Generator) -> LabelledScene:
        """Return a scene."""
        scenes = self._scenes[int(rng.integers(2)) if len(self._scenes) > 1 else 0]
        return scenes[int(rng.integers(len(scenes)))]
