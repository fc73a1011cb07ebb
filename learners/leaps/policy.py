"""Learned scores as a policy of sb3-contrib's MaskablePPO: imitation first, then rewards."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat, PositiveInt
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn
from torch.nn import functional

from stancekit.envs.data.leap_tries import LeapTries
from stancekit.envs.data.ledger import Part
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked_choice
from stancekit.planners.files.documents import check_fields, file_or_named, validated
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.leap.scp import OF_CANDIDATE, OF_LEAP, LeapFeatures

from ..selectors.network import (
    Architecture,
    AttentionBlock,
    Epochs,
    load_weights,
    read_tensors,
    undisturbed,
    write_tensors,
)
from ..training.loop import Checkpoint, Record, State, StepsDone, run
from ..zoo import shipped
from .kinds import FORMAT, KINDS, Kind

_CAPS = {"grip": (0.0, 0.1, 0.3), "room_m": (-0.06, -0.03, 0.0, 0.03)}
"""More than this of a feature may be worth nothing: the smaller of the two is a feature, too."""
_FEATURES = len(OF_CANDIDATE) + sum(map(len, _CAPS.values()))
_FOOTHOLDS = 8
"""P of LeapChoice-v0: all of its classes are of robots with four legs, which push off and land."""
_NONE = -1e8
"""Score where there is no candidate."""
_CLIP = 8.0
"""Standard deviations beyond which a feature counts for no more."""


def with_caps(candidates: Array) -> Array:
    """Features of candidates, and those of ``_CAPS`` up to their caps; shape (…, F) to (…,
    ``_FEATURES``).
    """
    capped = [
        np.minimum(candidates[..., OF_CANDIDATE.index(name)], cap)
        for name, caps in _CAPS.items()
        for cap in caps
    ]
    return np.concatenate([candidates, np.stack(capped, axis=-1)], axis=-1)


class ScoreNetwork(nn.Module):
    """Scores of candidates, shape (B, P, R), and the odds of the scene, shape (B,), whose sum over
    a choice is a logit.

    additive: a score is linear in the candidate's own features. set: an attention network sees all
    candidates of all toes, whatever their order, and adds to the linear score.
    """

    mean: Tensor
    scale: Tensor
    leap_mean: Tensor
    leap_scale: Tensor

    def __init__(self, kind: Kind, width: int = 64, layers: int = 2, heads: int = 4) -> None:
        super().__init__()
        self.kind, self.width, self.layers, self.heads = kind, width, layers, heads
        for name, size in (
            ("mean", _FEATURES),
            ("scale", _FEATURES),
            ("leap_mean", len(OF_LEAP)),
            ("leap_scale", len(OF_LEAP)),
        ):
            self.register_buffer(
                name, torch.zeros(size) if name.endswith("mean") else torch.ones(size)
            )
        self.linear = nn.Linear(_FEATURES, 1, bias=False)
        self.scene = nn.Sequential(nn.Linear(len(OF_LEAP), 32), nn.SiLU(), nn.Linear(32, 1))
        if kind == "set":
            self.embed = nn.Sequential(
                nn.Linear(_FEATURES + len(OF_LEAP), width), nn.SiLU(), nn.Linear(width, width)
            )
            self.toe = nn.Linear(2 * width, width)
            self.blocks = nn.ModuleList(AttentionBlock(width, heads) for _ in range(layers))
            self.head = nn.Sequential(
                nn.LayerNorm(2 * width), nn.Linear(2 * width, width), nn.SiLU(), nn.Linear(width, 1)
            )
            self.odds = nn.Linear(width, 1)

    @property
    def sizes(self) -> dict[str, Any]:
        """The arguments that make such a network."""
        names = ("kind", "width", "layers", "heads")
        return {name: getattr(self, name) for name in names}

    def forward(self, candidates: Tensor, mask: Tensor, leap: Tensor) -> tuple[Tensor, Tensor]:
        """Scores and odds.

        Arguments:
            candidates: shape (B, P, R, ``_FEATURES``).
            mask: (B, P, R).
            leap: (B, G).
        """
        seen = ((candidates - self.mean) / self.scale).clamp(-_CLIP, _CLIP) * mask[..., None]
        task = ((leap - self.leap_mean) / self.leap_scale).clamp(-_CLIP, _CLIP)
        scores, odds = self.linear(seen)[..., 0], self.scene(task)[:, 0]
        if self.kind == "additive":
            return scores, odds
        hidden = self.embed(
            torch.cat([seen, task[:, None, None].expand(*seen.shape[:3], -1)], dim=-1)
        )
        hidden = hidden * mask[..., None]
        mean = hidden.sum(dim=2) / mask.sum(dim=2).clamp(min=1.0)[..., None]
        most = hidden.masked_fill(mask[..., None] == 0.0, -1e4).amax(dim=2)
        tokens = self.toe(torch.cat([mean, most], dim=-1))
        for block in self.blocks:
            tokens = block(tokens)
        beside = tokens[:, :, None].expand_as(hidden)
        scores = scores + self.head(torch.cat([hidden, beside], dim=-1))[..., 0]
        return scores, odds + self.odds(tokens.mean(dim=1))[:, 0]

    def seen(self, candidates: Tensor, mask: Tensor, leap: Tensor) -> tuple[Tensor, Tensor]:
        """Scores, very low where there is no candidate, and odds, from the flat parts of
        LeapChoice-v0's observations.

        Arguments:
            candidates: shape (B, P * R * F).
            mask: (B, P * R).
            leap: (B, G).
        """
        table = candidates.reshape(len(candidates), _FOOTHOLDS, -1, len(OF_CANDIDATE))
        there = mask.reshape(len(mask), _FOOTHOLDS, -1)
        capped = [
            table[..., OF_CANDIDATE.index(name), None].clamp(max=cap)
            for name, caps in _CAPS.items()
            for cap in caps
        ]
        scores, odds = self(torch.cat([table, *capped], dim=-1), there, leap)
        return scores.masked_fill(there == 0.0, _NONE), odds


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapScorer:
    """Scores that a network gives, for ``LeapFinder(rule=...)``.

    Arguments:
        network: the scores are its logits.
        origin: what it was learned from, for people.

    Raises:
        InvalidInput: from ``read``, for a file that holds no scorer, and a name that does not ship.
    Source:
        None: logistic regression, and self-attention over sets.

    Example:
        >>> import stancekit
        >>> tries = stancekit.label("leap-few", "few", scenes=2, tries={"random": 4})
        >>> scorer = stancekit.fit(tries, "additive", epochs=2)
        >>> stancekit.plan("leap-few:0", stancekit.LeapFinder(rule=scorer, solves=5, proof=0)).method
        'finder'
    """

    network: ScoreNetwork
    origin: dict[str, Any]

    @undisturbed()
    def scores(self, numbers: LeapNumbers) -> Array:
        """The score of every candidate, the larger the better, shape (P, options); −inf where there
        is none.
        """
        seen = LeapFeatures.of(numbers)
        with torch.no_grad():
            inputs = (with_caps(seen.candidates), seen.mask, seen.leap)
            scores, _ = self.network(
                *(torch.as_tensor(each, dtype=torch.float32)[None] for each in inputs)
            )
        return np.where(seen.mask > 0.0, scores[0].numpy().astype(np.float64), -np.inf)

    @undisturbed()
    def predict(
        self,
        observation: Mapping[str, NDArray[np.float32]],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.int64], Any]:
        """Choices from observations of LeapChoice-v0, single ones or batches, as policies of
        stable-baselines3 do.

        Arguments:
            deterministic: the best candidate per foothold; otherwise drawn by the softmax of the
                scores, by torch's own generator.
        """
        seen = torch.as_tensor(np.atleast_2d(observation["candidates"]))
        mask = torch.as_tensor(np.atleast_2d(observation["mask"]))
        with torch.no_grad():
            scores = self.network.seen(
                seen, mask, torch.as_tensor(np.atleast_2d(observation["leap"]))
            )[0]
        if deterministic:
            choice = scores.argmax(dim=2).numpy()
        else:
            odds = scores.flatten(0, 1).softmax(dim=1)
            choice = torch.multinomial(odds, 1).reshape(scores.shape[:2]).numpy()
        return choice if np.ndim(observation["leap"]) > 1 else choice[0], state

    def write(self, path: str | Path) -> None:
        """Write a safetensors file."""
        header = {**self.network.sizes, "origin": self.origin}
        write_tensors(path, FORMAT, header, self.network.state_dict())

    @classmethod
    @undisturbed()
    def read(cls, path: str | Path) -> LeapScorer:
        """Read what ``write`` wrote, or the scorer of that name that ships."""
        path = file_or_named(path, shipped("scorers"))
        header, tensors = read_tensors(path, FORMAT)
        kind = checked_choice(header.get("kind"), f"{path}: kind", KINDS)
        given = {name: header.get(name) for name in ("width", "layers", "heads")}
        sizes = validated(Architecture, given, str(path))
        with torch.device("meta"):
            network = ScoreNetwork(cast(Kind, kind), sizes.width, sizes.layers, sizes.heads)
        load_weights(network, tensors, path)
        return cls(network=network.eval(), origin=dict(header.get("origin") or {}))


_WARM = 0.3
"""Share of the steps in which the rate rises."""
_MIRRORED = 0.5
"""Share of the batches that are mirrored left to right, which is a symmetry of the physics."""
_FLIPPED = ("_y", "_y_m", "_y_m_s")
_MOMENTS = ("moment_x_m", "moment_z_m")
"""In the mirror y → −y lengths and forces along y change their sign, and moments about x and z
do."""
_SIGNS = torch.ones(_FEATURES, dtype=torch.float32, device="cpu")
_LEAP_SIGNS = torch.tensor(
    [-1.0 if name.endswith(_FLIPPED) else 1.0 for name in OF_LEAP],
    dtype=torch.float32,
    device="cpu",
)
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

    part: Part = "all"
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


_BEST = "best."


class _Passes(Epochs):
    """Epochs, of which that with the least loss of held-out scenes is kept."""

    held_out: Callable[[], Tensor]
    best: tuple[float, dict[str, Tensor]] = (np.inf, {})

    def step(self, number: int) -> Record:
        """One epoch."""
        super().step(number)
        with torch.no_grad():
            loss = float(self.held_out())
        if loss < self.best[0]:
            weights = self.network.state_dict().items()
            self.best = (loss, {name: value.clone() for name, value in weights})
        return {"held_out_loss": loss}

    def state(self) -> State:
        """Also the best weights."""
        best = {f"{_BEST}{name}": value.numpy() for name, value in self.best[1].items()}
        return {**super().state(), **best}

    def restore(self, state: State, history: list[Record]) -> None:
        """Put them back, too."""
        super().restore(state, history)
        best = {
            name.removeprefix(_BEST): torch.tensor(values)
            for name, values in state.items()
            if name.startswith(_BEST)
        }
        self.best = min(record["held_out_loss"] for record in history), best


@undisturbed()
def fit_scorer(
    tries: LeapTries,
    kind: Kind = "set",
    settings: ScorerSettings = ScorerSettings(),
    progress: StepsDone | None = None,
    checkpoint: Path | None = None,
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
            f"data set: expected solved and unsolved tries, got {solved:.0f} of "
            f"{rows.there.sum():.0f} solved"
        )
    generator = torch.Generator().manual_seed(settings.seed)
    order = torch.randperm(len(rows), generator=generator)
    held = max(1, round(settings.held_out * len(rows)))
    test, train = rows[order[:held]], rows[order[held:]]
    with undisturbed(settings.seed):
        network = ScoreNetwork(kind, settings.width, settings.layers)
    _fit_scales(network, train)

    def loss_of(part: Tensor) -> Tensor:
        mirrored = bool(torch.rand((), generator=generator) < _MIRRORED)
        batch = _mirrored(train[part]) if mirrored else train[part]
        return _loss(network, batch, settings.ranking)

    knobs = {name: getattr(settings, name) for name in ("epochs", "batch", "rate", "decay")}
    fit = _Passes(network, loss_of, len(train), generator, warm=_WARM, **knobs)
    fit.held_out = lambda: _loss(network, test, settings.ranking)
    about = {
        "method": kind,
        "settings": vars(settings),
        "rows": int(rows.there.sum()),
        "class": tries.problem_class,
        "seed": tries.header.plan.seed,
    }
    run(fit, progress, Checkpoint.of(checkpoint, {**about, "data": tries.header.digest}))
    network.load_state_dict(fit.best[1])
    return LeapScorer(network=network.eval(), origin={**about, "held_out_loss": fit.best[0]})


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


class ScorePolicy(MaskableActorCriticPolicy):  # type: ignore[misc, unused-ignore]
    """Draw a candidate per foothold of LeapChoice-v0 by the softmax of a score network, which is
    the whole actor.

    ``MaskablePPO(ScorePolicy, env, policy_kwargs={"scorer": "set.safetensors"})`` goes on from what
    ``fit`` learned; ``scorer()`` gives back what ``plan``, ``bench room`` and ``LeapFinder`` take.

    Arguments:
        observation_space, action_space, lr_schedule: as stable-baselines3 passes them.
        scorer: file or name of the scores to begin with; untrained ones where None.
        kind: "set" or "additive", of untrained scores.
        more: other keywords of sb3-contrib's policy.

    Raises:
        InvalidInput: for a file that holds no scorer, another kind, and another environment.
    Source:
        None: proximal policy optimisation with masks, as sb3-contrib has it.

    Example:
        >>> import gymnasium, stancekit.envs
        >>> from sb3_contrib import MaskablePPO
        >>> env = gymnasium.make("stancekit/LeapChoice-v0", problem="leap-few", tries=1)
        >>> agent = MaskablePPO(ScorePolicy, env, n_steps=8, batch_size=8)
        >>> agent.policy.scorer().network.kind
        'set'
    """

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.MultiDiscrete,
        lr_schedule: Callable[[float], float],
        *,
        scorer: str | Path | None = None,
        kind: Kind = "set",
        **more: Any,
    ) -> None:
        if "mask" not in getattr(observation_space, "spaces", {}):
            raise InvalidInput("environment: expected stancekit/LeapChoice-v0, got another one")
        checked_choice(kind, "kind", KINDS)
        self._begins = {"scorer": None if scorer is None else str(scorer), "kind": kind}
        defaults = {
            "net_arch": [],
            "ortho_init": False,
            "features_extractor_class": _Scored,
            "features_extractor_kwargs": self._begins,
        }
        super().__init__(observation_space, action_space, lr_schedule, **{**more, **defaults})

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        super()._build(lr_schedule)
        heads: Any = (_Actor(), _Critic())
        self.action_net, self.value_net = heads
        self._optimise(lr_schedule(1))

    def _optimise(self, rate: float) -> None:
        make: Any = self.optimizer_class
        self.optimizer = make(self.parameters(), lr=rate, **self.optimizer_kwargs)

    def load_state_dict(self, state_dict: Mapping[str, Any], *further: Any, **options: Any) -> Any:
        """Take over weights, with the sizes and the origin of the scores that they are of."""
        extractor: Any = self.features_extractor
        known = state_dict.get(_STATE)
        if known is not None and known["sizes"] != extractor.network.sizes:
            extractor.network = ScoreNetwork(**known["sizes"]).to(self.device)
            self._optimise(self.optimizer.param_groups[0]["lr"])
        return super().load_state_dict(state_dict, *further, **options)

    @undisturbed(0)
    def scorer(self) -> LeapScorer:
        """The scores as they are now."""
        extractor: Any = self.features_extractor
        network = ScoreNetwork(**extractor.network.sizes)
        network.load_state_dict(extractor.network.state_dict())
        return LeapScorer(
            network=network.eval(), origin={**extractor.origin, "method": "maskable-ppo"}
        )

    def _get_constructor_parameters(self) -> dict[str, Any]:
        fixed = ("net_arch", "ortho_init", "features_extractor_class", "features_extractor_kwargs")
        rest = {
            name: value
            for name, value in super()._get_constructor_parameters().items()
            if name not in fixed
        }
        extractor: Any = self.features_extractor
        return {**rest, "scorer": None, "kind": extractor.network.kind}


class _Scored(BaseFeaturesExtractor):
    """Scores of all candidates; after them, for the value, how likely the best choice has a leap,
    and ``left``.
    """

    def __init__(self, space: spaces.Dict, scorer: str | None, kind: Kind) -> None:
        super().__init__(space, int(np.prod(space["mask"].shape or ())) + _EXTRA)
        read = None if scorer is None or _loading() else LeapScorer.read(scorer)
        self.network = ScoreNetwork(kind) if read is None else read.network
        self.origin = {} if read is None else read.origin

    def get_extra_state(self) -> dict[str, Any]:
        """The data beside the weights in their file."""
        return {"sizes": self.network.sizes, "origin": self.origin}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Take the origin of weights over."""
        self.origin = state["origin"]

    def forward(self, observation: dict[str, Tensor]) -> Tensor:
        scores, odds = self.network.seen(
            *(observation[name] for name in ("candidates", "mask", "leap"))
        )
        tables = scores.reshape(len(scores), _FOOTHOLDS, -1)
        likely = torch.sigmoid(tables.amax(dim=2).sum(dim=1) + odds)
        return torch.cat([scores.flatten(1), likely[:, None], observation["left"]], dim=1)


_STATE = "features_extractor._extra_state"
"""Key of that in a policy's weights."""


def _loading() -> bool:
    """Tell whether stable-baselines3 makes the policy of an agent's file, which has the weights and
    their origin: a file that they once began from is not asked for.
    """
    frame = sys._getframe(1)
    while frame.f_back is not None:
        frame = frame.f_back
        module = str(frame.f_globals.get("__name__"))
        if frame.f_code.co_name == "load" and module.startswith("stable_baselines3."):
            return True
    return False


_EXTRA = 3
"""Numbers for the value: how likely the best choice has a leap, and the two of ``left``."""


class _Actor(nn.Module):
    """Logits."""

    def forward(self, features: Tensor) -> Tensor:
        return features[:, :-_EXTRA]


class _Critic(nn.Module):
    """A value that is linear in how likely the best choice has a leap, and in what is left."""

    def __init__(self) -> None:
        super().__init__()
        self.linear = nn.Linear(_EXTRA, 1)

    def forward(self, features: Tensor) -> Tensor:
        value: Tensor = self.linear(features[:, -_EXTRA:].detach())
        return value
