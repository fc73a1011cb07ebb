"""Learn the scores of leaps' candidates from labelled tries: does a choice of contacts have a
leap?
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import Field, PositiveFloat, PositiveInt
from torch import Tensor
from torch.nn import functional

from stancekit.envs.data.leap_tries import LeapTries
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_choice
from stancekit.planners.files.validation import check_fields
from stancekit.planners.leap.features import OF_CANDIDATE, OF_LEAP, LeapFeatures
from stancekit.planners.leap.numbers import LeapNumbers

from .kinds import KINDS, Kind
from .scorer import FEATURES, LeapScorer, ScoreNetwork, with_caps

MIRRORED = 0.5
"""Share of the batches that are mirrored left to right, which is a symmetry of the physics."""
_FLIPPED = ("_y", "_y_m", "_y_m_s")
_MOMENTS = ("moment_x_m", "moment_z_m")
"""In the mirror y → −y lengths and forces along y change their sign, and moments about x and z
do."""
_SIGNS = torch.ones(FEATURES)
_LEAP_SIGNS = torch.tensor([-1.0 if name.endswith(_FLIPPED) else 1.0 for name in OF_LEAP])
for _k, _name in enumerate(OF_CANDIDATE):
    if _name in _MOMENTS or (_name.endswith(_FLIPPED) and not _name.startswith("moment")):
        _SIGNS[_k] = -1.0


@dataclass(frozen=True, kw_only=True)
class ScorerSettings:
    """Settings of learning a scorer.

    Arguments:
        part: of the scenes, all of them or a part of the split by hash: what learns from "train"
            can be judged on "test".
        scenes: so many of them, the first ones; all where None.
        width, layers: size of a set network.
        epochs: passes over the tries.
        batch: scenes per step.
        rate: of AdamW.
        decay: of its weights.
        held_out: share of the scenes by which the best pass is chosen.
        ranking: weight of the loss that puts solved tries of a scene before its others, beside that
            of the odds.
        seed: of weights, batches and parts.
    """

    part: Literal["all", "train", "test"] = "all"
    scenes: PositiveInt | None = None
    width: PositiveInt = 64
    layers: PositiveInt = 2
    epochs: PositiveInt = 60
    batch: PositiveInt = 32
    rate: PositiveFloat = 2e-3
    decay: Annotated[float, Field(ge=0.0)] = 1e-2
    held_out: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.15
    ranking: Annotated[float, Field(ge=0.0)] = 1.0
    seed: Annotated[int, Field(ge=0)] = 0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tries:
    """Tries by scene and timing, padded.

    Arguments:
        candidates: shape (S, P, R, F).
        mask: (S, P, R).
        leap: (S, G).
        choice: (S, K, P).
        solved, there: (S, K), whether a try is solved, and is one.
    """

    candidates: Tensor
    mask: Tensor
    leap: Tensor
    choice: Tensor
    solved: Tensor
    there: Tensor

    def __len__(self) -> int:
        return len(self.leap)

    def __getitem__(self, rows: Tensor) -> _Tries:
        return _Tries(**{name: value[rows] for name, value in vars(self).items()})


def fit_scorer(
    tries: LeapTries,
    kind: Kind = "set",
    settings: ScorerSettings = ScorerSettings(),
    progress: Callable[[int, int], None] | None = None,
) -> LeapScorer:
    """Learn from the tries of a data set, or of a part of it.

    Raises InvalidInput where none of them or all are solved.

    The best pass is that after which most held-out scenes have a solved try before all others that
    were made of them.
    """
    checked_choice(kind, "method", KINDS)
    rows = _rows(tries, settings.part, settings.scenes)
    solved = float(rows.solved.sum())
    if not 0.0 < solved < float(rows.there.sum()):
        raise InvalidInput(
            f"data set: expected tries that are solved and others, got {solved:.0f} of "
            f"{rows.there.sum():.0f} solved"
        )
    generator = torch.Generator().manual_seed(settings.seed)
    order = torch.randperm(len(rows), generator=generator)
    held = max(1, round(settings.held_out * len(rows)))
    test, train = rows[order[:held]], rows[order[held:]]
    with torch.random.fork_rng():
        torch.manual_seed(settings.seed)
        network = ScoreNetwork(kind, settings.width, settings.layers)
    _fit_scales(network, train)
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=settings.rate, weight_decay=settings.decay
    )
    steps = settings.epochs * -(-len(train) // settings.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.rate, total_steps=steps + 1)
    best: tuple[float, dict[str, Tensor]] = (np.inf, {})
    for epoch in range(settings.epochs):
        network.train()
        for part in torch.split(torch.randperm(len(train), generator=generator), settings.batch):
            batch = train[part]
            if torch.rand((), generator=generator) < MIRRORED:
                batch = _mirrored(batch)
            optimiser.zero_grad()
            _loss(network, batch, settings.ranking).backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimiser.step()
            schedule.step()
        network.eval()
        with torch.no_grad():
            loss = float(_loss(network, test, settings.ranking))
        if loss < best[0]:
            best = (loss, {name: value.clone() for name, value in network.state_dict().items()})
        if progress is not None:
            progress(epoch + 1, settings.epochs)
    network.load_state_dict(best[1])
    origin = {
        "method": kind,
        "settings": vars(settings),
        "rows": int(rows.there.sum()),
        "class": tries.problem_class,
        "seed": tries.header.plan.seed,
        "held_out_loss": best[0],
    }
    return LeapScorer(network=network.eval(), origin=origin)


def _rows(tries: LeapTries, part: str = "all", most: int | None = None) -> _Tries:
    table = tries.tries()
    of_part = np.array([part in ("all", rows_of_scene) for rows_of_scene in tries.parts()])
    if not of_part.any():
        raise InvalidInput(f"part: expected scenes in the part {part}, got none of {len(of_part)}")
    pairs = np.unique(np.stack([table["scene"], table["timing"]], axis=1), axis=0)
    pairs = pairs[np.isin(pairs[:, 0], np.flatnonzero(of_part)[:most])]
    features, rows_of_scene = [], []
    leaps = enumerate(tries.leaps())
    number, leap = next(leaps)
    for scene, timing in pairs.tolist():
        while number < scene:
            number, leap = next(leaps)
        features.append(LeapFeatures.of(LeapNumbers.of(leap, timing)))
        rows_of_scene.append(
            np.flatnonzero((table["scene"] == scene) & (table["timing"] == timing))
        )
    options, most = max(each.mask.shape[1] for each in features), max(map(len, rows_of_scene))
    footholds = table["choice"].shape[1]

    def padded(values: Any) -> Any:
        return np.pad(
            values, [(0, 0), (0, options - values.shape[1]), *[(0, 0)] * (values.ndim - 2)]
        )

    choice = np.zeros((len(rows_of_scene), most, footholds), dtype=np.int64)
    solved, there = np.zeros((len(rows_of_scene), most)), np.zeros((len(rows_of_scene), most))
    for s, index in enumerate(rows_of_scene):
        choice[s, : len(index)] = table["choice"][index]
        solved[s, : len(index)] = table["label"][index] == "solved"
        there[s, : len(index)] = 1.0
    numbers: dict[str, Any] = {
        "candidates": np.stack([padded(with_caps(each.candidates)) for each in features]),
        "mask": np.stack([padded(each.mask) for each in features]),
        "leap": np.stack([each.leap for each in features]),
        "solved": solved,
        "there": there,
    }
    tensors = {name: torch.as_tensor(value, dtype=torch.float32) for name, value in numbers.items()}
    return _Tries(choice=torch.as_tensor(choice), **tensors)


def _fit_scales(network: ScoreNetwork, rows: _Tries) -> None:
    """Set the scales of the inputs from scenes like these."""
    seen = rows.candidates[rows.mask > 0.0]
    network.mean, network.scale = seen.mean(dim=0), seen.std(dim=0).clamp(min=1e-3)
    network.leap_mean, network.leap_scale = (
        rows.leap.mean(dim=0),
        rows.leap.std(dim=0).clamp(min=1e-3),
    )


def _loss(network: ScoreNetwork, rows: _Tries, ranking: float) -> Tensor:
    """Cross-entropy of the odds of all tries, and of which tries of a scene are the solved ones."""
    scores, odds = network(rows.candidates, rows.mask, rows.leap)
    picked = torch.gather(
        scores[:, None].expand(-1, rows.choice.shape[1], -1, -1), 3, rows.choice[..., None]
    )
    sums = picked[..., 0].sum(dim=2)
    each = functional.binary_cross_entropy_with_logits(
        sums + odds[:, None], rows.solved, reduction="none"
    )
    loss = (each * rows.there).sum() / rows.there.sum()
    mixed = (rows.solved.sum(dim=1) > 0) & (rows.solved.sum(dim=1) < rows.there.sum(dim=1))
    if ranking == 0.0 or not bool(mixed.any()):
        return loss
    logits = sums.masked_fill(rows.there == 0.0, -torch.inf)[mixed]
    wanted = logits.masked_fill(rows.solved[mixed] == 0.0, -torch.inf)
    return loss + ranking * (logits.logsumexp(dim=1) - wanted.logsumexp(dim=1)).mean()


def _mirrored(rows: _Tries) -> _Tries:
    """The tries in the mirror y → −y."""
    return _Tries(
        **{**vars(rows), "candidates": rows.candidates * _SIGNS, "leap": rows.leap * _LEAP_SIGNS}
    )
