"""Policies that reinforcement learns: their networks, what their actions mean, and a file that is
never unpickled.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from pydantic import Field
from stable_baselines3.common.policies import ActorCriticPolicy, MultiInputActorCriticPolicy
from torch import Tensor, nn

from stancekit.envs.distributions.postures import distribution
from stancekit.envs.episodes import Observation
from stancekit.envs.refinement import refinement_space
from stancekit.envs.selection import scene_space
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked_int
from stancekit.planners.files.documents import Strict, shown, validated
from stancekit.planners.relaxation.envelope import Envelope

from .network import load_weights, read_tensors, undisturbed, write_tensors

FORMAT = "stancekit/policy/1"
EnvironmentName = Literal["stancekit/EnvelopeSelection-v0", "stancekit/EnvelopeRefinement-v0"]
Width = Annotated[int, Field(ge=1, le=4096)]


@dataclass(frozen=True, kw_only=True)
class PolicyShape(Strict):
    """Purpose and size of a policy: all that is needed to build it again.

    Arguments:
        problem: name of the distribution.
        legs: those of its problems, where they are not the default hexapod's.
        hidden: widths of the layers.
        spread: initial standard deviation of a bound's move in units of ``offset``.
        offset: how far a bound may move from the base envelope, non-dimensional. Both: selection
            only.
    """

    environment: EnvironmentName
    problem: str
    hidden: Annotated[tuple[Width, ...], Field(min_length=1, max_length=16)] = (128, 128)
    spread: Annotated[float, Field(gt=0.0, le=1e3)] = 0.2
    offset: Annotated[float, Field(gt=0.0, le=1e3)] = 0.25
    legs: tuple[str, ...] = ()

    @property
    def contacts(self) -> int:
        """N."""
        return len(self.legs or distribution(self.problem).legs)

    @property
    def selects(self) -> bool:
        """Tell whether the policy chooses envelopes; else it cuts boxes."""
        return self.environment == "stancekit/EnvelopeSelection-v0"

    @property
    def spaces(self) -> tuple[spaces.Dict, spaces.Space[Any]]:
        """Observation and action space of the policy."""
        if self.selects:
            return scene_space(self.contacts), spaces.Box(
                -1.0, 1.0, (12 * self.contacts,), np.float32
            )
        return refinement_space(self.contacts), spaces.Discrete(6 * self.contacts)

    @property
    def policy(self) -> tuple[type[ActorCriticPolicy], dict[str, Any]]:
        """The policy's class and arguments, as stable-baselines3 wants them."""
        arch = list(self.hidden)
        if self.selects:
            options = {
                "net_arch": {"pi": arch, "vf": arch},
                "log_std_init": float(np.log(self.spread)),
            }
            return MultiInputActorCriticPolicy, options
        return DimensionPolicy, {"hidden": arch}

    def build(self) -> ActorCriticPolicy:
        """An untrained policy."""
        kind, arguments = self.policy
        return kind(*self.spaces, lambda _: 0.0, **arguments)


class DimensionPolicy(MultiInputActorCriticPolicy):
    """Scores every dimension of the current box by one network, so that all dimensions share what
    is learned.

    The logits are the scores plus learned multiples of log(gap) and log(width): an untrained policy
    leans to the largest gap, and among equal gaps to the wider dimension.
    """

    def __init__(self, *args: Any, hidden: list[int], **kwargs: Any) -> None:
        self._hidden = hidden
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        assert isinstance(self.observation_space, spaces.Dict)
        self.mlp_extractor = DimensionScores(self.observation_space, self._hidden)  # type: ignore[assignment]

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net = nn.Identity()  # the scores are the logits
        nn.init.orthogonal_(self.mlp_extractor.score[-1].weight, 0.01)  # type: ignore[union-attr,index]
        self.optimizer = self.optimizer_class(
            self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs
        )  # type: ignore[call-arg]


class DimensionScores(nn.Module):
    """From the flat observation of ``EnvelopeRefinement-v0`` to a logit a dimension and the
    critic's features.
    """

    per_dimension, overall = 14, 4

    def __init__(self, space: spaces.Dict, hidden: list[int]) -> None:
        super().__init__()
        sizes = {name: int(np.prod(box.shape or ())) for name, box in space.spaces.items()}
        ends = np.cumsum(list(sizes.values())).tolist()
        self._columns = {
            name: slice(end - size, end)
            for (name, size), end in zip(sizes.items(), ends, strict=True)
        }
        self.latent_dim_pi, self.latent_dim_vf = sizes["gap"], hidden[-1]
        self.score = _layers([self.per_dimension + self.overall, *hidden], last=1)
        self.embed = _layers([self.per_dimension + self.overall, *hidden])
        self.lean = nn.Parameter(torch.tensor([6.0, 1.0]))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Logits, shape (B, 6N), and features of the critic, shape (B, hidden[-1])."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: Tensor) -> Tensor:
        """Logits."""
        seen = self._seen(features)
        gap, low, high = (features[:, self._columns[name]] for name in ("gap", "low", "high"))
        gap, width = gap + 1e-4, (high - low).clamp(min=1e-6)
        leaning = [
            torch.log(part / part.amax(dim=1, keepdim=True)).clamp(min=-5.0)
            for part in (gap, width)
        ]
        return torch.add(
            self.score(seen)[..., 0], self.lean[0] * leaning[0] + self.lean[1] * leaning[1]
        )

    def forward_critic(self, features: Tensor) -> Tensor:
        """The mean embedding of all dimensions."""
        return torch.as_tensor(self.embed(self._seen(features)).mean(dim=1))

    def _seen(self, features: Tensor) -> Tensor:
        """Features of every dimension, and of the search, shape (B, 6N, 18)."""
        part = {name: features[:, columns] for name, columns in self._columns.items()}
        low, high, gap = part["low"], part["high"], part["gap"]
        width = high - low
        place = (part["point"] - low) / width.clamp(min=1e-6)
        mean = 0.5 * (low + high)
        friction = part["friction"].repeat_interleave(6, dim=1)
        worst = gap / gap.amax(dim=1, keepdim=True).clamp(min=1e-6)
        widest = width / width.amax(dim=1, keepdim=True).clamp(min=1e-6)
        of_dimensions = [
            width,
            1e2 * gap,
            place.clamp(0.0, 1.0),
            mean,
            friction,
            worst,
            widest,
            torch.log(gap + 1e-4) / 5.0,
        ]
        kinds = (
            torch.eye(6, device=gap.device).repeat(gap.shape[1] // 6, 1).expand(len(gap), -1, -1)
        )
        whole = [1e2 * part["margin"], part["depth"], part["open"], part["left"]]
        overall = torch.cat(whole, dim=1)[:, None].expand(-1, gap.shape[1], -1)
        return torch.cat([torch.stack(of_dimensions, dim=2), kinds, overall], dim=2)


def _layers(widths: list[int], last: int | None = None) -> nn.Sequential:
    layers: list[nn.Module] = []
    for before, after in itertools.pairwise(widths):
        layers += [nn.Linear(before, after), nn.Tanh()]
    if last is not None:
        layers.append(nn.Linear(widths[-1], last))
    return nn.Sequential(*layers)


class TrainedPolicy:
    """A policy with what its actions mean; predicts as stable-baselines3's policies do.

    Arguments:
        base: bounds that the actions of a selecting policy move, all low and then all high, shape
            (12N,); else empty.
        steps: of the environment that it was trained for.
        provenance: how it was trained, for people.
    """

    name = "reinforced"

    def __init__(
        self,
        shape: PolicyShape,
        policy: ActorCriticPolicy,
        base: Array,
        *,
        steps: int = 0,
        provenance: Mapping[str, Any] | None = None,
    ) -> None:
        self.shape, self.policy, self.base, self.steps = shape, policy, base, steps
        self.problem_class = shape.problem
        self.provenance = dict(provenance or {})

    @undisturbed()
    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[Any], Any]:
        """Return (action, state): an action of the environment, or a row an observation of a batch.

        Raises InvalidInput where its numbers are so large that they overflow.
        """
        try:
            action, _ = self.policy.predict(dict(observation), deterministic=deterministic)
        except ValueError as error:
            raise InvalidInput(
                f"policy: expected finite actions, got none: {shown(str(error))}"
            ) from None
        return (
            moved(self.base, self.shape.offset, action) if self.shape.selects else action
        ), state

    def save(self, path: str | Path) -> None:
        """Write the policy as one safetensors file."""
        header = {"shape": asdict(self.shape), "steps": self.steps, "provenance": self.provenance}
        tensors = {f"policy.{name}": value for name, value in self.policy.state_dict().items()}
        write_tensors(path, FORMAT, header, tensors | {"base": torch.from_numpy(self.base)})

    @classmethod
    @undisturbed(0)
    def load(cls, path: str | Path) -> TrainedPolicy:
        """Read a policy.

        Raises InvalidInput for a file that is damaged or foreign.
        """
        header, tensors = read_tensors(path, FORMAT)
        shape = validated(PolicyShape, header.get("shape"), str(path))
        provenance = header.get("provenance")
        steps = checked_int(header.get("steps"), f"{path}: steps")
        if not isinstance(provenance, dict):
            raise InvalidInput(f"{path}: provenance: expected an object, got {shown(provenance)}")
        sizes = sum(a * b for a, b in itertools.pairwise(shape.hidden))
        if sizes > sum(tensor.numel() for tensor in tensors.values()):
            raise InvalidInput(
                f"{path}: hidden: expected the widths of its tensors, got {list(shape.hidden)}"
            )
        policy = shape.build()
        base = tensors.pop("base", torch.zeros(0))
        weights = {name.removeprefix("policy."): value for name, value in tensors.items()}
        load_weights(policy, weights, path)
        if tuple(base.shape) != ((12 * shape.contacts,) if shape.selects else (0,)):
            raise InvalidInput(
                f"{path}: tensor base: expected the bounds of {shape.contacts} contacts, got something else"
            )
        policy.set_training_mode(False)
        return cls(
            shape, policy, base.numpy().astype(np.float64), steps=steps, provenance=provenance
        )


def moved(base: Array, offset: float, action: NDArray[np.float32]) -> NDArray[np.float32]:
    """Bounds of the envelopes: base + offset · action, within [−1, 1].

    Arguments:
        action: shape (..., 12N) in [−1, 1].
    """
    bounds: NDArray[np.float32] = np.clip(base + offset * np.asarray(action), -1.0, 1.0).astype(
        np.float32
    )
    return bounds


def bounds_of(envelope: Envelope) -> Array:
    """The base bounds of an envelope, kept within the actions' domain."""
    return np.clip(envelope.to_vector(), -1.0, 1.0)
