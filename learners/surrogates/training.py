"""Learn a surrogate from labelled rows, and calibrate it on rows of each class that it has not
seen.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, PositiveInt
from torch import Tensor
from torch.nn import functional

from stancekit.envs.data.dataset import Dataset
from stancekit.planners.equilibrium.batch import PointBatch, ScaledBatch, slacks
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import check_fields, parse_json
from stancekit.planners.problem import PostureBatch

from ..selectors.network import Architecture, undisturbed
from .calibration import CONFIDENCE, KINDS, Likeness
from .features import Features, Seer
from .surrogate import Surrogate, SurrogateNetwork, numbers

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
        _check_alike(datasets)
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


def _check_alike(datasets: Sequence[Dataset]) -> None:
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


_WARM = 0.1
"""Share of the steps in which the rate grows."""


@dataclass(frozen=True, kw_only=True)
class SurrogateSettings:
    """Settings of learning a surrogate.

    Arguments:
        width, layers, heads: size of the network.
        epochs: passes over the rows.
        batch: rows per step.
        rate: of AdamW.
        decay: of its weights.
        calibration: share of the rows of each class that is kept to calibrate on: more of them hold
            a smaller error, fewer teach more.
        margin: weight of the loss of the margin beside that of the answer.
        seed: of weights, batches and parts.
    """

    width: PositiveInt = 64
    layers: PositiveInt = 2
    heads: PositiveInt = 4
    epochs: PositiveInt = 40
    batch: PositiveInt = 256
    rate: Annotated[float, Field(gt=0.0, le=10.0)] = 2e-3
    decay: Annotated[float, Field(ge=0.0)] = 1e-2
    calibration: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.35
    margin: Annotated[float, Field(ge=0.0)] = 0.3
    seed: Annotated[int, Field(ge=0)] = 0

    def __post_init__(self) -> None:
        check_fields(self)


def fit_surrogate(
    datasets: Sequence[Dataset],
    settings: SurrogateSettings = SurrogateSettings(),
    progress: Callable[[int, int], None] | None = None,
    *,
    calibration: Dataset | None = None,
) -> Surrogate:
    """Learn from the rows of data sets of one class.

    Arguments:
        calibration: rows to calibrate on, besides the part of the others that is kept for that.

    Raises:
        InvalidInput: where feasible or infeasible rows are missing, or rows to calibrate on.
    """
    rows = LabelledBatch.of(datasets)
    origin = [one.origin for one in datasets]
    held = None
    if calibration is not None:
        _check_alike([datasets[0], calibration])
        held = LabelledBatch.of([calibration])
        if held.screened is not None:
            raise InvalidInput(
                "calibration: expected rows as they are drawn, got screened ones of "
                f"{calibration.ledger.folder}"
            )
        held = held.without(rows)
        origin.append(calibration.origin)
    surrogate = fit_rows(
        rows,
        settings,
        progress,
        problem_class=datasets[0].problem_class,
        origin={"datasets": origin},
        held=held,
    )
    if not any(map(len, surrogate.calibration.values())):
        raise InvalidInput(
            "calibration: expected rows as they are drawn, not screened ones, to calibrate on, got a "
            f"share of {settings.calibration:g} of {len(rows)} rows, which has none: more rows, a "
            "larger share, or a data set for it"
        )
    return surrogate


@undisturbed()
def fit_rows(
    rows: LabelledBatch,
    settings: SurrogateSettings,
    progress: Callable[[int, int], None] | None = None,
    *,
    problem_class: str,
    origin: dict[str, Any],
    held: LabelledBatch | None = None,
) -> Surrogate:
    """Learn from labelled problems.

    Arguments:
        held: further rows to calibrate on.
    """
    begin = time.process_time()
    known = {kind: int((rows.kinds == kind).sum()) for kind in KINDS}
    if not known["feasible"] or not known["infeasible"] + known["trivial"]:
        counts = ", ".join(f"{count} {kind}" for kind, count in known.items())
        raise InvalidInput(f"data set: expected feasible and infeasible rows, got {counts}")
    learned, held_out = _parts(rows, settings.calibration, settings.seed)
    if len(set((rows.kinds[learned] == "feasible").tolist())) < 2:
        raise InvalidInput(
            "calibration: expected a share that leaves feasible and infeasible rows to learn "
            "from, got "
            f"{settings.calibration:g} of {len(rows)} rows"
        )
    seer = Seer.of(rows.batch.like)
    seen = seer.features(rows.batch)
    with undisturbed(settings.seed):
        sizes = {name: getattr(settings, name) for name in ("width", "layers", "heads")}
        network = SurrogateNetwork(Architecture(**sizes))
        _train(network, _part(seen, learned), rows.select(learned), settings, progress)
    surrogate = Surrogate(
        network,
        like=rows.batch.like,
        problem_class=problem_class,
        calibration={kind: np.zeros(0) for kind in KINDS},
        ranges=_ranges(rows, held),
    )
    parts = [rows.select(held_out)] + ([] if held is None else [held])
    kinds = np.concatenate([part.kinds for part in parts])
    scores = [surrogate.scores(part.batch)[0] for part in parts]
    compared = [
        surrogate.compared(part.batch, each) for part, each in zip(parts, scores, strict=True)
    ]
    calibrated = {kind: np.concatenate(scores)[kinds == kind] for kind in KINDS}
    likeness = Likeness.of({kind: np.concatenate(compared)[kinds == kind] for kind in KINDS})
    return Surrogate(
        network,
        like=rows.batch.like,
        problem_class=problem_class,
        calibration=calibrated,
        ranges=surrogate.ranges,
        likeness=likeness,
        provenance={
            **origin,
            "method": "surrogate",
            "settings": asdict(settings),
            "learned_from": {kind: int((rows.kinds[learned] == kind).sum()) for kind in KINDS},
            "calibrated_on": {kind: len(each) for kind, each in calibrated.items()},
            "confidence": CONFIDENCE,
            "symmetries": len(seer.turns),
            "right_alone": _right_alone(calibrated),
            "cpu_s": round(time.process_time() - begin, 1),
        },
    )


def _parts(
    rows: LabelledBatch, share: float, seed: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows to learn from and rows to calibrate on, of each class its share, drawn by the seed;
    never screened ones, which are not as they are drawn.
    """
    rng, held_out = np.random.default_rng(seed), []
    plain = np.ones(len(rows), dtype=bool) if rows.screened is None else ~rows.screened
    for kind in KINDS:
        mine = np.flatnonzero((rows.kinds == kind) & plain)
        held_out.append(rng.permutation(mine)[: round(share * len(mine))])
    chosen = np.sort(np.concatenate(held_out))
    return np.setdiff1d(np.arange(len(rows)), chosen), chosen


def _part(seen: Features, chosen: NDArray[np.intp]) -> Features:
    return Features(seen.tokens[chosen], seen.corners[chosen])


def _train(
    network: SurrogateNetwork,
    seen: Features,
    rows: LabelledBatch,
    settings: SurrogateSettings,
    progress: Callable[[int, int], None] | None,
) -> None:
    tokens, corners = map(torch.from_numpy, seen)
    network.fit_scales(tokens, corners)
    wanted = torch.from_numpy((rows.kinds == "feasible").astype(np.float32))
    margins = torch.from_numpy(rows.margins.astype(np.float32)) / FARTHEST
    share = float(wanted.mean())
    weights = torch.where(wanted > 0.0, 0.5 / share, 0.5 / (1.0 - share))
    weights = weights.clamp(max=20.0)
    generator = torch.Generator().manual_seed(settings.seed)
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=settings.rate, weight_decay=settings.decay
    )
    steps = settings.epochs * -(-len(wanted) // settings.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, settings.rate, total_steps=steps + 1, pct_start=_WARM
    )
    network.train()
    for epoch in range(settings.epochs):
        order = torch.randperm(len(wanted), generator=generator)
        for part in torch.split(order, settings.batch):
            optimiser.zero_grad()
            score, margin = network(tokens[part], corners[part])
            loss = _loss(score, margin, wanted[part], margins[part], weights[part], settings.margin)
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimiser.step()
            schedule.step()
        if progress is not None:
            progress(epoch + 1, settings.epochs)
    with torch.no_grad():  # margins come back in their own unit
        last = network.head[-1]
        assert isinstance(last, torch.nn.Linear)
        last.weight[1] *= FARTHEST
        last.bias[1] *= FARTHEST
    network.eval()


def _loss(
    score: Tensor, margin: Tensor, wanted: Tensor, margins: Tensor, weights: Tensor, share: float
) -> Tensor:
    """Cross-entropy of the answers, both classes alike, and the margins' absolute error, smooth
    near 0.
    """
    answer = functional.binary_cross_entropy_with_logits(score, wanted, weight=weights)
    return answer + share * functional.smooth_l1_loss(margin, margins, beta=0.2)


def _ranges(rows: LabelledBatch, held: LabelledBatch | None) -> Array:
    """Least and largest of each number of the patches, shape (2, N, K)."""
    values = numbers(rows.batch)
    if held is not None:
        values = np.concatenate([values, numbers(held.batch)])
    return np.stack([values.min(axis=0), values.max(axis=0)])


def _right_alone(scores: dict[str, Array]) -> dict[str, float]:
    """Share of the rows of each class that the sign of the score alone gets right."""
    return {
        kind: round(float(np.mean((each > 0.0) == (kind == "feasible"))), 4)
        for kind, each in scores.items()
        if len(each)
    }
