"""Data sets of labelled posture problems (Algorithm E1): what ``labelling`` writes and selectors
learn from.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stancekit.planners.cached import cached_property
from stancekit.planners.equilibrium.features import observe
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.robot import Limb, Robot

from .labelled_posture import LabelledPosture, problem_of, row_of
from .ledger import Header, Ledger, shard_name
from .summary import Summary

if TYPE_CHECKING:
    import pyarrow as pa

Index = NDArray[np.intp]
Observation = dict[str, NDArray[np.float32]]
Read = TypeVar("Read")
Part = Literal["all", "train", "test"]
"""Part of a data set's rows: see ``Dataset.only``."""
TEST_SHARE = 5
"""One row in so many is of the part "test"."""
LABELS = {"feasible": 1, "infeasible": 0, "undecided": -1}
"""Labels that ``Dataset[k]`` gives to a row."""
OPEN_SHARDS = 4
"""Number of shards that a data set keeps decompressed."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Dataset:
    """Rows of one problem class, read from the disk when they are asked for.

    ``split`` gives data sets, too.

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
    chosen: Index
    part: Part = "all"
    _open: dict[int, pa.Table] = field(default_factory=dict)

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

    def __getitem__(self, index: int) -> tuple[Observation, int]:
        """Observation of a row's scene, and its label.

        Raises as ``row`` does.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"row {index} of {len(self)}")
        problem = self._read(index % len(self), self._problem)
        return observe(Scaled.of(problem)), LABELS[str(self.labels[index])]

    def __iter__(self) -> Iterator[tuple[Observation, int]]:
        """The pairs of all rows in their order."""
        return map(self.__getitem__, range(len(self)))

    def rows(self) -> Iterator[LabelledPosture]:
        """All rows, shard by shard: memory stays flat."""
        return map(self.row, range(len(self)))

    def row(self, index: int) -> LabelledPosture:
        """One row.

        Raises IndexError, and InvalidInput where the file is damaged.
        """
        return self._read(index, self._decoded)

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
    def feasible(self) -> Index:
        """Indices of the feasible rows, ascending."""
        return np.flatnonzero(self._kinds == "feasible")

    @property
    def infeasible(self) -> Index:
        """Indices of the infeasible rows that are not trivial, ascending."""
        return np.flatnonzero(self._kinds == "infeasible")

    @property
    def trivial(self) -> Index:
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
        """The data set of these rows."""
        return replace(self, chosen=self.chosen[np.asarray(indices, dtype=np.intp)], _open={})

    def only(self, part: Part) -> Dataset:
        """The rows of "train" or of "test", one in TEST_SHARE, by a hash of their problems; or
        "all".

        A problem is of the same part in whatever data set it is: what was learned from "train" has
        seen nothing of "test". Raises InvalidInput for another part.
        """
        if part not in get_args(Part):
            raise InvalidInput(f"part: expected one of {', '.join(get_args(Part))}, got {part!r}")
        if part == "all":
            return self
        shards = [self.ledger.read(shard, ["problem"]) for shard in range(self.header.plan.shards)]
        texts = [text for shard in shards for text in shard.column("problem").to_pylist()]
        members = [is_test(texts[k]) == (part == "test") for k in self.chosen]
        return replace(self, chosen=self.chosen[np.array(members, dtype=bool)], part=part, _open={})

    @property
    def origin(self) -> dict[str, str]:
        """Origin of these rows, which a selector keeps: digest of the set, of its draws, and the
        part.
        """
        return {
            "dataset": self.header.digest,
            "first_sample": self.header.first_sample,
            "part": self.part,
        }

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
        return problem_of(raw, self._robot)

    def _decoded(self, raw: dict[str, Any]) -> LabelledPosture:
        return row_of(raw, self._robot)

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


def is_test(problem: str) -> bool:
    """Tell whether the problem, as a shard has it, belongs to the part "test"."""
    return int.from_bytes(hashlib.sha256(problem.encode()).digest()[:8], "big") % TEST_SHARE == 0
