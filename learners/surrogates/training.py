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
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.validation import check_fields

from ..selectors.network import Architecture
from .calibration import CONFIDENCE, KINDS
from .features import Features, Seer
from .likeness import Likeness
from .network import SurrogateNetwork
from .rows import FARTHEST, LabelledBatch, check_alike
from .surrogate import Surrogate, numbers

WARM = 0.1
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
        check_alike([datasets[0], calibration])
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
            "calibration: expected rows as they are drawn, not screened ones, to calibrate on, got "
            "none of "
            f"{len(rows)}: a larger share, or a data set for it"
        )
    return surrogate


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
    with torch.random.fork_rng():
        torch.manual_seed(settings.seed)
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
        optimiser, settings.rate, total_steps=steps + 1, pct_start=WARM
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
