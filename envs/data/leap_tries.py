"""Tries of leaps as arrays: the columns of a shard, one row per try, and what a learner reads of
them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.answer.plan import LeapPlan
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.leap.finder import LABELS, Try
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import plan_from
from stancekit.planners.problem.leap import BodyState, Leap
from stancekit.planners.problem.leap_classes import leap_from_keys, leap_to_json

from .dataset import Dataset, Summary, as_column
from .ledger import Ledger, TryHeader, folder_of, part_of, read_header, shard_name

if TYPE_CHECKING:
    import pyarrow as pa

_Arrays = dict[str, NDArray[Any]]
_STATE = ("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad")
"""Rows of ``start`` and ``goal``."""
_OF_SCENE = (
    "start",
    "goal",
    "candidates",
    "corners",
    "vertices_m",
    "normals",
    "shear_references",
    "friction",
    "stands_m",
)
"""Columns that are the same in all rows of a scene."""
_OF_TRY = (
    "scene",
    "number",
    "order",
    "timing",
    "choice",
    "label",
    "solves",
    "first_cost",
    "cost",
    "toes_m",
    "forces_n",
    "multipliers",
)
"""The other columns."""


@dataclass(frozen=True, kw_only=True)
class TrySummary:
    """Summary of a data set of tries.

    Arguments:
        tries_per_cpu_s: NaN without timing files.
    """

    scenes: int
    solved: int
    refuted: int
    unsolved: int
    tries_per_cpu_s: float

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values; NaN becomes null."""
        rate = self.tries_per_cpu_s
        return {**vars(self), "tries_per_cpu_s": rate if np.isfinite(rate) else None}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LeapTries:
    """Labelled tries of a class of leaps: choices of contacts, and whether each one has a leap.

    ``tries()`` and ``scenes()`` are two tables as numpy arrays; ``leap(k)`` is a scene as a
    question, and ``plan(k)`` the plan of a try that is solved.

    Arguments:
        ledger: the folder's files, see ``LeapTries.open``.

    Raises:
        InvalidInput: from ``open``, for a folder that is missing, foreign, damaged or of another
            version.
    Source:
        docs/concepts/leaps.md.

    Example:
        >>> import stancekit
        >>> tries = stancekit.label("leap-few", "few", scenes=1, tries={"random": 3})
        >>> tries.tries()["choice"].shape, tries.scenes()["friction"].shape
        ((3, 8), (1, 8, 2))
    """

    ledger: Ledger

    @classmethod
    def open(cls, path: str | Path) -> LeapTries:
        """Open a folder that ``label`` has filled with tries; reads no rows yet.

        Raises InvalidInput.
        """
        return cls(ledger=Ledger.whole(path, TryHeader))

    @property
    def header(self) -> TryHeader:
        """Header of the set: the problems, what all scenes share, and what the labels mean."""
        header = self.ledger.header
        assert isinstance(header, TryHeader)
        return header

    @property
    def problem_class(self) -> str:
        """Name of the class of leaps."""
        return self.header.problem_class

    def __len__(self) -> int:
        return self.ledger.starts[-1]

    def __repr__(self) -> str:
        return f"LeapTries({str(self.ledger.folder)!r}, {self.problem_class}, {len(self)} tries)"

    def summary(self) -> TrySummary:
        """Counts and costs of the whole folder."""
        result = Summary.of(self.ledger)
        return TrySummary(
            scenes=self.header.plan.scenes,
            solved=result.rows.feasible,
            refuted=result.rows.infeasible,
            unsolved=result.rows.undecided,
            tries_per_cpu_s=1e3 / result.cpu_s_per_1000,
        )

    def tries(self) -> _Arrays:
        """One entry per try, by name: the K tries of all scenes, scene by scene in the order in
        which they were made.

        scene: number of the scene, an index into ``scenes()``; number: of the try in its scene;
        order: how it was chosen; timing: number of the timing; choice: a candidate per foothold,
        shape (K, P); label: "solved", "refuted" or "unsolved"; solves: convex problems; first_cost,
        cost: of the first step, and at the end, inf where the first step has no answer. Evidence,
        NaN where there is none: toes_m, shape (K, P, 3) [m], and forces_n, shape (K, M, N, 3) [N],
        of what is solved; multipliers of what is refuted, shape (K, R).
        """
        columns: dict[str, list[NDArray[Any]]] = {name: [] for name in _OF_TRY}
        for shard in range(self.header.plan.shards):
            table = self._read(shard, _OF_TRY)
            for name in _OF_TRY:
                columns[name].append(_array(table, name, self._shape(name)))
        arrays = {name: np.concatenate(parts) for name, parts in columns.items()}
        for name in ("first_cost", "cost"):
            arrays[name] = np.where(np.isnan(arrays[name]), np.inf, arrays[name])
        return arrays

    def scenes(self) -> _Arrays:
        """One entry per scene, by name: S scenes of P footholds with R candidates of V corners at
        most.

        start, goal: rows c, v, L per mass and Θ of the body, shape (S, 4, 3); candidates: how many
        each foothold has, shape (S, P); vertices_m: shape (S, P, R, V, 3) [m]; normals,
        shear_references: shape (S, P, R, 3); friction: shape (S, P, R); stands_m: the toe that
        stands already, shape (S, P, 3) [m]. NaN where there is none.
        """
        rows = [
            row
            for shard in range(self.header.plan.shards)
            for row in _firsts(self._scene_table(shard))
        ]
        footholds = self.header.shapes["choice"][0]
        options = max(int(max(row["candidates"])) for row in rows)
        corners = max(max(row["corners"]) for row in rows)
        one = (len(rows), footholds, options)
        arrays: _Arrays = {
            "vertices_m": np.full((*one, corners, 3), np.nan),
            "normals": np.full((*one, 3), np.nan),
            "shear_references": np.full((*one, 3), np.nan),
            "friction": np.full(one, np.nan),
        }
        for s, row in enumerate(rows):
            for j, r, (vertices, normal, shear, friction) in _patches(row):
                arrays["vertices_m"][s, j, r, : len(vertices)] = vertices
                arrays["normals"][s, j, r] = normal
                arrays["shear_references"][s, j, r] = shear
                arrays["friction"][s, j, r] = friction
        whole = {
            "start": (4, 3),
            "goal": (4, 3),
            "candidates": (footholds,),
            "stands_m": (footholds, 3),
        }
        for name, shape in whole.items():
            arrays[name] = np.array([row[name] for row in rows]).reshape(len(rows), *shape)
        return arrays

    def leaps(self) -> Iterator[Leap]:
        """Yield every scene as the ``Leap`` problem that it poses, in the order of the data set."""
        for shard in range(self.header.plan.shards):
            first = self.header.plan.scenes_of(shard).start
            for k, row in enumerate(_firsts(self._scene_table(shard)), first):
                yield self._leap(shard, k, row)

    def leap(self, scene: int) -> Leap:
        """A scene as a question, equal to what was drawn to the last bit.

        Raises IndexError, and InvalidInput.
        """
        plan = self.header.plan
        if not 0 <= scene < plan.scenes:
            raise IndexError(f"scene {scene} of {plan.scenes}")
        shard = scene // plan.scenes_a_shard
        rows = _firsts(self._scene_table(shard))
        return self._leap(shard, scene, rows[scene - plan.scenes_of(shard).start])

    def parts(self) -> list[str]:
        """Part of every scene, "train", "test" or "calibration", by a hash of its class, seed and
        number: the same in whatever data set.
        """
        plan = self.header.plan
        names = (scene_name(plan.distribution, plan.seed, number) for number in range(plan.scenes))
        return [part_of(name) for name in names]

    def plan(self, index: int) -> LeapPlan:
        """The plan of a try, its body worked out from toes and forces.

        Raises InvalidInput for one without any.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"try {index} of {len(self)}")
        shard = int(np.searchsorted(self.ledger.starts, index, side="right")) - 1
        table = self._read(shard, _OF_TRY).slice(index - self.ledger.starts[shard], 1)
        row = {name: _array(table, name, self._shape(name))[0] for name in _OF_TRY}
        if str(row["label"]) != "solved":
            raise InvalidInput(
                f"try {index}: expected one that is solved, got one that is {row['label']}"
            )
        return plan_of_row(LeapNumbers.of(self.leap(int(row["scene"])), int(row["timing"])), row)

    def _shape(self, name: str) -> tuple[int, ...]:
        return tuple(self.header.shapes.get(name, ()))

    def _scene_table(self, shard: int) -> pa.Table:
        table = self._read(shard, ("scene", *_OF_SCENE))
        other = [name for name in _OF_SCENE if not _same_in_scenes(table, name)]
        if other:
            where = self.ledger.folder / shard_name(shard)
            raise InvalidInput(
                f"{where}: {other[0]}: expected the same in all rows of a scene, got other values"
            )
        return table

    def _read(self, shard: int, columns: Sequence[str]) -> pa.Table:
        """Columns of a shard, scene among them, whose rows are those of its scenes in their
        order.
        """
        table = self.ledger.read(shard, list(columns))
        result, wanted = table.column("scene").to_numpy(), self.header.plan.scenes_of(shard)
        if not (
            np.all(np.diff(result) >= 0) and np.array_equal(np.unique(result), np.asarray(wanted))
        ):
            where = self.ledger.folder / shard_name(shard)
            scenes = f"expected rows of scenes {wanted[0]} to {wanted[-1]} in their order"
            raise InvalidInput(f"{where}: scene: {scenes}, got other values")
        return table

    def _leap(self, shard: int, scene: int, row: Mapping[str, Any]) -> Leap:
        where = f"{self.ledger.folder / shard_name(shard)}: scene {scene}"
        try:
            return leap_from_keys(_keys(self.header, scene, row), where)
        except (TypeError, ValueError, KeyError, IndexError) as error:
            if isinstance(error, InvalidInput):
                raise
            raise InvalidInput(f"{where}: {error}") from None


def open_rows(path: str | Path) -> Dataset | LeapTries:
    """Open a data set of either kind, by its folder or, where it ships, by its name.

    Raises InvalidInput.
    """
    leaps = isinstance(read_header(folder_of(path)), TryHeader)
    return LeapTries.open(path) if leaps else Dataset.open(path)


def scene_name(problem_class: str, seed: int, scene: int) -> str:
    """Name of the leap that is scene number ``scene`` of a seed."""
    return f"{problem_class}-{seed}-{scene}"


def shared_keys(leap: Leap) -> dict[str, Any]:
    """The keys of a leap that all scenes of its class share; of footholds limb and phase."""
    keys = {
        name: value
        for name, value in leap_to_json(leap).items()
        if name not in ("name", "start", "goal")
    }
    footholds = [{"limb": foothold.limb, "phase": foothold.frame} for foothold in leap.footholds]
    return {**keys, "footholds": footholds}


def shapes_of(leap: Leap) -> dict[str, list[int]]:
    """Shapes of a row's arrays."""
    from stancekit.planners.leap.prove import shapes

    footholds, limbs = len(leap.footholds), len(leap.robot.limbs)
    multipliers = sum(
        int(np.prod(shape, dtype=int)) for shape in shapes(LeapNumbers.of(leap)).values()
    )
    return {
        "choice": [footholds],
        "toes_m": [footholds, 3],
        "forces_n": [leap.intervals, limbs, 3],
        "multipliers": [multipliers],
        "start": [4, 3],
        "goal": [4, 3],
        "candidates": [footholds],
        "stands_m": [footholds, 3],
    }


def table_of_tries(header: TryHeader, scene: int, leap: Leap, tries: Sequence[Try]) -> pa.Table:
    """The tries of a scene as a part of a shard's table."""
    import pyarrow as pa

    schema = header.columns()
    rows = [{"scene": scene, "number": k, **_cells(one)} for k, one in enumerate(tries)]
    cells = {name: [value] * len(tries) for name, value in _scene_cells(leap).items()}
    cells |= {name: [row[name] for row in rows] for name in _OF_TRY}
    columns = [as_column(cells[field.name], field.type) for field in schema]
    return pa.Table.from_arrays(columns, schema=schema)


def plan_of_row(numbers: LeapNumbers, row: Mapping[str, Any]) -> LeapPlan:
    """The plan that a row's toes and forces make."""
    return plan_from(numbers, row["choice"], row["toes_m"], row["forces_n"], str(row["order"]))


def _cells(one: Try) -> dict[str, Any]:
    """A try's own columns."""
    cells = {name: getattr(one, name) for name in ("order", "timing", "choice", "solves")}
    multipliers, plan = one.multipliers, one.plan
    return {
        **cells,
        "label": LABELS[one.status],
        "first_cost": one.first if np.isfinite(one.first) else None,
        "cost": one.cost if np.isfinite(one.cost) else None,
        "toes_m": None if plan is None else plan.toes_m.ravel(),
        "forces_n": None if plan is None else plan.forces_n.ravel(),
        "multipliers": None if multipliers is None else multipliers.astype(np.float32),
    }


def _scene_cells(leap: Leap) -> dict[str, Any]:
    """The scene's columns of a leap: patches flattened in the order of footholds and candidates."""
    patches = [patch for foothold in leap.footholds for patch in foothold.candidates]
    none = np.full(3, np.nan)
    stands = [none if foothold.toe_m is None else foothold.toe_m for foothold in leap.footholds]
    return {
        "start": _state(leap.start),
        "goal": _state(leap.goal),
        "candidates": [len(foothold.candidates) for foothold in leap.footholds],
        "corners": [len(patch.vertices_m) for patch in patches],
        "vertices_m": np.concatenate([patch.vertices_m for patch in patches]).ravel(),
        "normals": np.concatenate([patch.normal for patch in patches]),
        "shear_references": np.concatenate([patch.shear_reference for patch in patches]),
        "friction": [patch.friction for patch in patches],
        "stands_m": np.concatenate(stands),
    }


def _state(state: BodyState) -> Array:
    return np.concatenate([getattr(state, name) for name in _STATE])


def _firsts(table: pa.Table) -> list[dict[str, Any]]:
    """The first row of every scene of a shard."""
    scenes = table.column("scene").to_numpy()
    firsts = np.flatnonzero(np.diff(scenes, prepend=-1))
    rows: list[dict[str, Any]] = table.take(firsts).to_pylist()
    return rows


def _same_in_scenes(table: pa.Table, name: str) -> bool:
    """Tell whether every row of a scene has the value of its first row in this column."""
    scenes = table.column("scene").to_numpy()
    firsts = np.searchsorted(scenes, scenes)
    column = table.column(name).combine_chunks()
    storage = getattr(column, "storage", column)
    first = storage.take(firsts)
    if not np.array_equal(storage.value_lengths(), first.value_lengths()):
        return False
    return np.array_equal(
        storage.flatten().to_numpy(False), first.flatten().to_numpy(False), equal_nan=True
    )


def _patches(
    row: Mapping[str, Any],
) -> Iterator[tuple[int, int, tuple[Array, Array, Array, float]]]:
    """(foothold, candidate, (corners, normal, shear reference, friction)) of a scene's patches."""
    numbers = {
        name: np.reshape(row[name], (-1, 3))
        for name in ("vertices_m", "normals", "shear_references")
    }
    ends = np.cumsum([0, *row["corners"]])
    places = [(j, r) for j, count in enumerate(row["candidates"]) for r in range(count)]
    for k, (j, r) in enumerate(places):
        corners = numbers["vertices_m"][ends[k] : ends[k + 1]]
        yield (
            j,
            r,
            (corners, numbers["normals"][k], numbers["shear_references"][k], row["friction"][k]),
        )


def _keys(header: TryHeader, scene: int, row: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a scene's leap."""
    footholds = [{**foothold, "candidates": []} for foothold in header.leap["footholds"]]
    for j, _, (corners, normal, shear, friction) in _patches(row):
        patch = {
            "vertices_m": corners.tolist(),
            "normal": normal.tolist(),
            "shear_reference": shear.tolist(),
        }
        footholds[j]["candidates"].append({**patch, "friction": friction})
    for foothold, toe in zip(footholds, np.reshape(row["stands_m"], (-1, 3)), strict=True):
        if not np.isnan(toe).any():
            foothold["toe_m"] = toe.tolist()
    ends = {
        name: dict(zip(_STATE, np.reshape(row[name], (4, 3)).tolist(), strict=True))
        for name in ("start", "goal")
    }
    name = scene_name(header.problem_class, header.plan.seed, scene)
    return {**header.leap, "name": name, "footholds": footholds, **ends}


def _array(table: pa.Table, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """A column as an array, NaN where it is null."""
    column = table.column(name).combine_chunks()
    if not shape:
        result: NDArray[Any] = column.to_numpy(zero_copy_only=False)
        return result.astype(np.str_) if result.dtype == object else result
    there = column.is_valid().to_numpy(zero_copy_only=False)
    valid = column.drop_null()
    values = valid.to_numpy_ndarray() if len(valid) else np.zeros((0, *shape))
    if there.all():
        return np.asarray(values)
    array = np.full((len(column), *shape), np.nan)
    array[there] = values
    return array
