"""A row of a data set: a labelled posture problem, and the columns of a shard that it is kept
in.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.answer.plan import Plan
from stancekit.planners.files.arrays import Array, read_only
from stancekit.planners.files.documents import parse_json
from stancekit.planners.problem import Problem
from stancekit.planners.robot import Robot

from .ledger import shard_schema

if TYPE_CHECKING:
    import pyarrow as pa

POSTURE: dict[str, tuple[int, ...]] = {
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


def problem_of(raw: dict[str, Any], robot: Robot) -> Problem:
    """The problem of a shard's row, equal to what was drawn to the last bit.

    Arguments:
        robot: any with the legs of the set.
    """
    return Problem.from_json(parse_json(raw["problem"], "problem"), robot=robot)


def row_of(raw: dict[str, Any], robot: Robot) -> LabelledPosture:
    """Posture and label in a row of a shard, whose columns have these names."""
    problem, certificate = problem_of(raw, robot), None
    if raw["tree"] is not None:
        rows = sum(len(c.reach_rows.bounds_m) for c in problem.contacts if c.reach_rows is not None)
        multipliers = np.reshape(raw["multipliers"], (-1, 6 + 3 * len(problem.contacts) + rows))
        nodes = 2 * len(multipliers) - 1  # of a binary tree with so many leaves
        certificate = Certificate.from_arrays(np.reshape(raw["tree"], (nodes, -1)), multipliers).of(
            problem
        )
    witness = {
        name: np.reshape(raw[name], shape)
        for name, shape in POSTURE.items()
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
        [_arrow([_cell(row, f.name) for row in rows], f.type) for f in schema], schema=schema
    )


def _cell(row: LabelledPosture, name: str) -> Any:
    if name == "problem":
        return json.dumps(row.problem.to_json(), separators=(",", ":"))
    if name == "label":
        return str(row.status)
    if name in POSTURE:
        return None if row.posture is None else getattr(row.posture, name).ravel()
    if name in ("tree", "multipliers"):
        return None if row.certificate is None else getattr(row.certificate, name).ravel()
    value = getattr(row, name)
    return value.ravel() if name == "point" and value is not None else value


def _arrow(values: list[Any], kind: pa.DataType) -> pa.Array:
    import pyarrow as pa

    if isinstance(kind, pa.FixedShapeTensorType):
        return pa.ExtensionArray.from_storage(kind, pa.array(values, kind.storage_type))
    return pa.array(values, kind)
