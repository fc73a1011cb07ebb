"""Rows of labelled data sets as arrays: what a surrogate learns from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stancekit.envs.data.dataset import Dataset
from stancekit.planners.equilibrium.batch import PointBatch, ScaledBatch
from stancekit.planners.equilibrium.slacks import slacks
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import parse_json
from stancekit.planners.problem import PostureBatch

from .features import Seer

COLUMNS = ["problem", "label", "trivial", "lower_bound", "com_m", "rotation_rad", "toes_m"]
COLUMNS += ["forces_n"]
FARTHEST = 0.1
"""Margins beyond this count as this: near to the border is what matters."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledBatch:
    """Posture problems with their labels.

    Arguments:
        kinds: "feasible", "infeasible" or "trivial", shape (B,).
        margins: of a feasible one the least room that its witness has, of an infeasible one minus
            the moment that its proof says cannot be balanced, non-dimensional, shape (B,).
        screened: whether a row is of a screened set, which may teach and not calibrate, shape (B,);
            None for none.
    """

    batch: PostureBatch
    kinds: NDArray[np.str_]
    margins: Array
    screened: NDArray[np.bool_] | None = None

    def __len__(self) -> int:
        return len(self.kinds)

    @classmethod
    def of(cls, datasets: Sequence[Dataset]) -> LabelledBatch:
        """The decided rows of data sets of one class, each problem once.

        Raises InvalidInput for rows of several classes or robots, and for rows on other than
        triangles.
        """
        check_alike(datasets)
        first = datasets[0]
        like = next(iter(first.problems()), None)
        if like is None:
            raise InvalidInput(f"{first.ledger.folder}: expected labelled rows, got none")
        seen, patches, kinds, margins, screened = set[str](), [], [], [], []
        postures: dict[int, list[Array]] = {}
        for one in datasets:
            for raw in _raw(one):
                if raw["problem"] in seen or raw["label"] == "undecided":
                    continue
                seen.add(raw["problem"])
                contacts = parse_json(raw["problem"], "problem")["contacts"]
                patches.append([(c["vertices_m"], c["normal"], c["friction"]) for c in contacts])
                kinds.append("trivial" if raw["trivial"] else raw["label"])
                screened.append(one.header.plan.screen is not None)
                bound = float(raw["lower_bound"] or 0.0)
                margins.append(-1.0 if raw["trivial"] or not np.isfinite(bound) else -bound)
                if raw["label"] == "feasible" and raw["com_m"] is not None:
                    postures[len(kinds) - 1] = [
                        np.array(raw[name])
                        for name in ("com_m", "rotation_rad", "toes_m", "forces_n")
                    ]
        try:
            vertices, normals, friction = (
                np.array([[contact[k] for contact in row] for row in patches]) for k in range(3)
            )
        except ValueError:
            raise InvalidInput(
                f"{first.ledger.folder}: expected patches of as many corners each, got something else"
            ) from None
        batch = PostureBatch(like=like, vertices_m=vertices, normals=normals, friction=friction)
        values = np.array(margins)
        if postures:
            values[list(postures)] = _rooms(batch, postures)
        return cls(
            batch=batch,
            kinds=np.array(kinds, dtype=np.str_),
            margins=np.clip(values, -FARTHEST, FARTHEST),
            screened=np.array(screened) if any(screened) else None,
        )

    def select(self, chosen: NDArray[np.intp]) -> LabelledBatch:
        """Some of them, by index."""
        return LabelledBatch(
            batch=self.batch.select(chosen),
            kinds=self.kinds[chosen],
            margins=self.margins[chosen],
            screened=None if self.screened is None else self.screened[chosen],
        )

    def without(self, other: LabelledBatch) -> LabelledBatch:
        """Rows that are not in another batch."""
        seen = {corners.tobytes() for corners in other.batch.vertices_m}
        fresh = [k for k, each in enumerate(self.batch.vertices_m) if each.tobytes() not in seen]
        return self.select(np.array(fresh, dtype=np.intp))


def check_alike(datasets: Sequence[Dataset]) -> None:
    """Raise InvalidInput unless data sets are of one class, robot and legs."""
    first = datasets[0]
    for other in datasets[1:]:
        for name in ("problem_class", "robot"):
            mine, theirs = (getattr(one, name) or "the default hexapod" for one in (first, other))
            if mine != theirs:
                raise InvalidInput(
                    f"data sets: expected rows of one class and robot, got {mine} and {theirs}"
                )
        if other.header.legs != first.header.legs:
            raise InvalidInput(
                f"data sets: expected rows of the same legs, got {first.header.legs} and "
                f"{other.header.legs}"
            )


def _raw(dataset: Dataset) -> list[dict[str, Any]]:
    """Columns of the chosen rows."""
    shards = range(dataset.header.plan.shards)
    rows = [row for k in shards for row in dataset.ledger.read(k, COLUMNS).to_pylist()]
    return [rows[k] for k in dataset.chosen.tolist()]


def _rooms(batch: PostureBatch, postures: dict[int, list[Array]]) -> Array:
    """The least room of witnesses, by the index of their problem."""
    index = np.array(list(postures), dtype=np.intp)
    some = ScaledBatch.of(batch.select(index))
    one, contacts = some.like, batch.like.contacts
    com, rotation, toes, forces = (np.array(part) for part in zip(*postures.values(), strict=True))
    shape = (len(index), len(contacts), 3)
    turned = np.matmul(some.frames.swapaxes(2, 3), forces.reshape(shape)[..., None])[..., 0]
    points = PointBatch(
        com=com.reshape(-1, 3) / one.length_m,
        rotation=rotation.reshape(-1, 3),
        toes=toes.reshape(shape) / one.length_m,
        forces=turned / one.force_n,
    )
    return np.asarray(slacks(some, points, list(Seer.of(batch.like).half_spaces)).min(axis=1))
