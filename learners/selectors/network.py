"""The network of the neural selectors: a scene's contacts in, a box for each contact out.

Equivariant to the order of the contacts (self-attention over one token a contact, no positions) and
invariant to the order of a patch's corners (a mean over them), so neither has to be learned.
"""

from __future__ import annotations

import json
import os
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import torch
from pydantic import Field, PositiveInt
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn
from torch.nn import functional

from stancekit.envs.episodes import Observation
from stancekit.planners.equilibrium.scaled import Scaled, observe
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import check_fields, open_file, parse_json
from stancekit.planners.files.writing import write_bytes

from ..training.loop import Fit, Record, State

_KEY = "stancekit"
"""The one key of a file's metadata, which holds the JSON header with its ``format``; several have
no fixed order."""


@contextmanager
def undisturbed(seed: int | None = None) -> Iterator[None]:
    """Keep what networks give apart from what a user has set for the whole process, and the other
    way round: within, torch computes on one thread of the processor in single precision, without
    autocasting, and what was set is put back.

    Arguments:
        seed: of torch's own stream of chance, which is left where it was, as those of Python and
            NumPy are; None where nothing is drawn by the process's streams.
    """
    with ExitStack() as kept:
        for now, put, wanted in _USUAL:
            if (before := now()) != wanted:  # else other threads find nothing changed, either
                kept.callback(put, before)
                put(wanted)
        kept.enter_context(torch.device("cpu"))
        kept.enter_context(torch.inference_mode(False))
        kept.enter_context(torch.enable_grad())
        kept.enter_context(torch.autocast("cpu", enabled=False))
        if seed is not None:
            kept.callback(random.setstate, random.getstate())
            kept.callback(np.random.set_state, np.random.get_state())  # noqa: NPY002
            kept.enter_context(torch.random.fork_rng(devices=[]))
            torch.manual_seed(seed)
        yield


_USUAL: tuple[tuple[Callable[[], Any], Callable[[Any], None], Any], ...] = (
    (torch.get_num_threads, torch.set_num_threads, 1),
    (torch.get_default_dtype, torch.set_default_dtype, torch.float32),
    (torch.get_float32_matmul_precision, torch.set_float32_matmul_precision, "highest"),
    (torch.are_deterministic_algorithms_enabled, torch.use_deterministic_algorithms, False),
)
"""Settings of the process that numbers depend on: how each is read and set, and to what."""


_MOST_BYTES = 512_000_000
_DTYPES = (torch.float16, torch.float32, torch.float64, torch.int64)


def write_tensors(
    path: str | Path,
    kind: str,
    header: Mapping[str, Any],
    tensors: Mapping[str, Tensor],
    *,
    half: bool = False,
) -> None:
    """Write tensors and a JSON header, whole or not at all.

    Arguments:
        kind: the format's name with its version.
        half: round what is in single precision to half of it, in half the room.
    """
    plain = {name: tensor.detach().contiguous() for name, tensor in tensors.items()}
    if half:
        plain = {
            name: each.half() if each.dtype is torch.float32 else each
            for name, each in plain.items()
        }
    write_bytes(path, save(plain, {_KEY: json.dumps({**header, "format": kind}, sort_keys=True)}))


def read_tensors(path: str | Path, kind: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Return (header, tensors), those of half precision in single precision.

    Raises InvalidInput for what is missing, truncated, foreign or not finite.
    """
    path = Path(path)
    with open_file(path) as stream:
        size = os.fstat(stream.fileno()).st_size
    if size > _MOST_BYTES:
        raise InvalidInput(f"{path}: expected a file of {_MOST_BYTES} bytes or fewer, got {size}")
    try:
        with safe_open(path, framework="pt") as file:
            header = parse_json((file.metadata() or {}).get(_KEY, "null"), "header")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 — not a dictionary
    except (SafetensorError, OSError, ValueError, RuntimeError, TypeError) as error:
        raise InvalidInput(
            f"{path}: expected a whole file of format {kind}: {' '.join(str(error).split())}"
        ) from None
    format_name = header.pop("format", None) if isinstance(header, dict) else None
    if format_name != kind:
        raise InvalidInput(
            f"{path}: expected format {kind}, got "
            f"{'none' if format_name is None else str(format_name)[:60]}"
        )
    for name, tensor in tensors.items():
        if tensor.ndim > 8:
            raise InvalidInput(
                f"{path}: tensor {name}: expected 8 dimensions or fewer, got {tensor.ndim}"
            )
        if tensor.dtype not in _DTYPES:
            raise InvalidInput(
                f"{path}: tensor {name}: expected half, single or double precision, got "
                f"{tensor.dtype}"
            )
        if not bool(torch.isfinite(tensor).all()):
            raise InvalidInput(f"{path}: tensor {name}: expected finite numbers, got other values")
    return header, {
        name: each.float() if each.dtype is torch.float16 else each
        for name, each in tensors.items()
    }


def load_weights(network: nn.Module, tensors: Mapping[str, Tensor], path: str | Path) -> None:
    """Put a file's tensors into a network.

    Raises InvalidInput unless names and shapes are the network's.

    Make the network on ``torch.device("meta")`` where a file says how large it is: nothing is
    allocated then before the shapes are those of the file's tensors.
    """
    wanted = {name: tuple(value.shape) for name, value in network.state_dict().items()}
    check_shapes(path, wanted, tensors)
    if any(value.is_meta for value in network.state_dict().values()):
        network.to_empty(device="cpu")
    network.load_state_dict(tensors)


def check_shapes(
    path: str | Path, wanted: Mapping[str, tuple[int, ...]], tensors: Mapping[str, Tensor]
) -> None:
    """Raise InvalidInput that names the first tensor that is missing, unknown or of another
    shape.
    """
    shapes = {name: tuple(value.shape) for name, value in tensors.items()}
    odd = sorted(name for name in {**wanted, **shapes} if wanted.get(name) != shapes.get(name))
    if odd:
        raise InvalidInput(
            f"{path}: tensor {odd[0]}: expected shape {wanted.get(odd[0])}, got "
            f"{shapes.get(odd[0])}"
        )


_ADAM, _NETWORK = "adam.", "network."


class Descent(Fit):
    """A network that is fitted by AdamW.

    Arguments:
        rate, decay: AdamW's, and that of its weights.
    """

    def __init__(self, network: nn.Module, rate: float, decay: float) -> None:
        self.network = network
        self.optimiser: torch.optim.Optimizer = torch.optim.AdamW(
            network.parameters(), lr=rate, weight_decay=decay
        )

    def down(self, loss: Tensor) -> float:
        """One step down a loss, its gradient clipped to 1; the loss."""
        self.optimiser.zero_grad()
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self.optimiser.step()
        return float(loss.detach())

    def state(self) -> State:
        """Weights, and what the optimiser has seen."""
        tensors = {f"{_NETWORK}{name}": each for name, each in self.network.state_dict().items()}
        for index, slot in self.optimiser.state_dict()["state"].items():
            tensors |= {f"{_ADAM}{index}.{name}": value for name, value in slot.items()}
        return {name: torch.as_tensor(value).numpy() for name, value in tensors.items()}

    def restore(self, state: State, history: list[Record]) -> None:
        """Put them back."""
        seen: dict[int, dict[str, Tensor]] = {}
        for name in filter(lambda name: name.startswith(_ADAM), state):
            _, index, slot = name.split(".")
            seen.setdefault(int(index), {})[slot] = torch.tensor(state[name])
        weights = {
            name.removeprefix(_NETWORK): torch.tensor(values)
            for name, values in state.items()
            if name.startswith(_NETWORK)
        }
        load_weights(self.network, weights, "checkpoint")
        self.optimiser.load_state_dict({**self.optimiser.state_dict(), "state": seen})


class Epochs(Descent):
    """A network fitted to its rows in shuffled batches, at a rate that rises and falls once; after
    every epoch it is as it is to be used.

    Arguments:
        loss: of the rows with these numbers.
        rate: the largest.
        warm: share of the steps in which the rate rises.
    """

    def __init__(
        self,
        network: nn.Module,
        loss: Callable[[Tensor], Tensor],
        rows: int,
        chance: torch.Generator,
        *,
        epochs: int,
        batch: int,
        rate: float,
        decay: float,
        warm: float,
    ) -> None:
        super().__init__(network, rate, decay)
        self._loss, self._rows, self._chance = loss, rows, chance
        self.total, self._batch = epochs, batch
        self._steps = -(-rows // batch)
        steps = epochs * self._steps
        if warm * (steps + 1) == 1.0:  # the rate would rise in no time at all
            warm *= 2.0
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(
            self.optimiser, rate, total_steps=steps + 1, pct_start=warm
        )

    def step(self, number: int) -> Record:
        """One epoch."""
        self.network.train()
        for part in torch.split(torch.randperm(self._rows, generator=self._chance), self._batch):
            self.down(self._loss(part))
            self._schedule.step()
        self.network.eval()
        return {}

    def state(self) -> State:
        """Weights, optimiser, and the generator."""
        return {**super().state(), "chance": self._chance.get_state().numpy()}

    def restore(self, state: State, history: list[Record]) -> None:
        """Put them back, and the rate."""
        super().restore(state, history)
        self._chance.set_state(torch.tensor(state["chance"]))
        done = len(history) * self._steps
        self._schedule.load_state_dict({"last_epoch": done - 1, "_step_count": done})
        self._schedule.step()


_CORNERS = 3
"""Corners of a patch in the environment's observation."""
_TOKEN = 27
"""Numbers a contact besides the corners: the patch's middle, also from the shoulder, its second
moments (6), the frame (9), the shoulder, friction, reach, and the vertical force that a unit normal
force allows."""

Boxes: TypeAlias = tuple[Tensor, Tensor, Tensor]
"""(low, high, point), each of shape (B, N, 6); low ≤ point ≤ high."""


@dataclass(frozen=True, kw_only=True)
class Architecture:
    """Size of a network; limited, so that a file cannot ask for all memory.

    Arguments:
        width: features of a token.
        layers: layers of attention.
        heads: heads of each layer.
        corner_width: pooled features of a patch.
    """

    width: Annotated[PositiveInt, Field(le=1024)] = 96
    layers: Annotated[PositiveInt, Field(le=32)] = 3
    heads: Annotated[PositiveInt, Field(le=32)] = 4
    corner_width: Annotated[PositiveInt, Field(le=1024)] = 32

    def __post_init__(self) -> None:
        check_fields(self)
        if self.width % self.heads:
            raise InvalidInput(
                f"width: expected a multiple of {self.heads} heads, got {self.width}"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneTensors:
    """A batch of B scenes of N contacts as the environment observes them, non-dimensional, float32.

    Arguments:
        vertices: (B, N, 3, 3), corner by row.
        frames: (B, N, 3, 3), columns n, y, z.
        friction, reach: (B, N).
        shoulders: (B, N, 3).
    """

    vertices: Tensor
    frames: Tensor
    friction: Tensor
    shoulders: Tensor
    reach: Tensor

    @classmethod
    def of_observation(cls, observation: Observation, contacts: int) -> SceneTensors:
        """Read one flat observation, or a batch.

        Raises InvalidInput where sizes are not those of N contacts.
        """
        shapes = {
            "vertices": (contacts, _CORNERS, 3),
            "frames": (contacts, 3, 3),
            "friction": (contacts,),
            "shoulders": (contacts, 3),
            "reach": (contacts,),
        }
        tensors = {}
        for name, shape in shapes.items():
            if name not in observation:
                raise InvalidInput(
                    f"observation: expected the key {name!r}, got {sorted(observation)}"
                )
            values = np.asarray(observation[name], dtype=np.float32)
            size = int(np.prod(shape))
            if values.ndim not in (1, 2) or values.shape[-1] != size:
                raise InvalidInput(
                    f"observation {name!r}: expected {size} numbers a scene for {contacts} "
                    "contacts, "
                    f"got shape {values.shape}"
                )
            tensors[name] = torch.from_numpy(values.reshape(-1, *shape).copy())
        return cls(**tensors)

    @classmethod
    def of_problems(cls, problems: Sequence[Scaled]) -> SceneTensors:
        """The observations of these problems, which have the same number of contacts, on
        triangles.
        """
        seen = [observe(problem) for problem in problems]
        stacked = {name: np.stack([one[name] for one in seen]) for name in seen[0]}
        return cls.of_observation(stacked, problems[0].size[0])

    def __len__(self) -> int:
        return len(self.friction)

    def __getitem__(self, rows: Tensor) -> SceneTensors:
        return SceneTensors(
            vertices=self.vertices[rows],
            frames=self.frames[rows],
            friction=self.friction[rows],
            shoulders=self.shoulders[rows],
            reach=self.reach[rows],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Mirror:
    """The reflection x → −x, front to rear: an exact symmetry of a class whose limbs lie symmetric
    about the middle.

    It keeps gravity, reach and cones. A contact frame (n, y, z) becomes (M n, −s M y, s M z),
    right-handed again, the sign s keeping z on the side of the class's shear reference. Tokens need
    no relabelling: the limb is known by its shoulder.

    Arguments:
        flips: signs of [p, f], shape (N, 6).
    """

    flips: Tensor

    @classmethod
    def of(cls, scenes: SceneTensors) -> Mirror | None:
        """The symmetry where the class has it, else None: the mirrored limbs must be the same set
        of limbs.
        """
        limbs = torch.cat([scenes.shoulders[0], scenes.reach[0][:, None]], dim=1)
        mirrored = limbs * torch.tensor([-1.0, 1.0, 1.0, 1.0])
        apart = (mirrored[:, None] - limbs[None]).abs().amax(dim=-1)
        if not bool((apart.min(dim=1).values < 1e-5).all()):
            return None
        shear = scenes.frames[..., 2].mean(dim=0)  # mean z of each contact
        twin = apart.argmin(dim=1)
        sign = torch.sign((shear * torch.tensor([-1.0, 1.0, 1.0]) * shear[twin]).sum(dim=-1))
        sign = torch.where(sign == 0.0, torch.ones_like(sign), sign)
        one = torch.ones_like(sign)
        return cls(flips=torch.stack([-one, one, one, one, -sign, sign], dim=1))

    def scenes(self, scenes: SceneTensors, flipped: Tensor) -> SceneTensors:
        """The scenes, those mirrored for which ``flipped``, shape (B,), is True."""
        x = torch.tensor([-1.0, 1.0, 1.0])
        where = flipped[:, None, None]
        turned = scenes.frames * x[:, None] * self.flips[:, None, 3:]
        return replace(
            scenes,
            vertices=torch.where(where[..., None], scenes.vertices * x, scenes.vertices),
            shoulders=torch.where(where, scenes.shoulders * x, scenes.shoulders),
            frames=torch.where(where[..., None], turned, scenes.frames),
        )

    def points(self, points: Tensor, flipped: Tensor) -> Tensor:
        """Points [p, f], shape (B, N, 6), mirrored with their scenes."""
        return torch.where(flipped[:, None, None], points * self.flips, points)

    def boxes(self, boxes: Boxes, flipped: Tensor) -> Boxes:
        """Boxes mirrored with their scenes: a side changes places with its opposite."""
        low, high, point = boxes
        first, second = self.points(low, flipped), self.points(high, flipped)
        return (
            torch.minimum(first, second),
            torch.maximum(first, second),
            self.points(point, flipped),
        )


class _Encoder(nn.Module):
    """Scenes to a token a contact that knows of the other contacts."""

    token_mean: Tensor
    token_scale: Tensor

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        width, corner = architecture.width, architecture.corner_width
        self.corners = nn.Sequential(nn.Linear(6, corner), nn.SiLU(), nn.Linear(corner, corner))
        self.embed = nn.Sequential(
            nn.Linear(_TOKEN + corner, width), nn.SiLU(), nn.Linear(width, width)
        )
        self.blocks = nn.ModuleList(
            AttentionBlock(width, architecture.heads) for _ in range(architecture.layers)
        )
        self.register_buffer("token_mean", torch.zeros(_TOKEN))
        self.register_buffer("token_scale", torch.ones(_TOKEN))

    def fit_scales(self, scenes: SceneTensors) -> None:
        """Set the scales of the inputs from scenes like these."""
        tokens = _tokens(scenes).reshape(-1, _TOKEN)
        self.token_mean = tokens.mean(dim=0)
        self.token_scale = tokens.std(dim=0).clamp(min=1e-3)

    def forward(self, scenes: SceneTensors) -> Tensor:
        """Tokens, shape (B, N, width)."""
        spokes = (scenes.vertices - scenes.vertices.mean(dim=2, keepdim=True)) / 0.1
        in_frame = torch.einsum("bnuk,bnkj->bnuj", spokes, scenes.frames)
        patch = self.corners(torch.cat([spokes, in_frame], dim=-1)).mean(dim=2)
        tokens = (_tokens(scenes) - self.token_mean) / self.token_scale
        hidden: Tensor = self.embed(torch.cat([tokens, patch], dim=-1))
        for block in self.blocks:
            hidden = block(hidden)
        return hidden


class BoxNetwork(nn.Module):
    """Scenes to boxes: a head a contact gives a point and a width to either side of it.

    The point's p starts at the patch's middle relative to the nominal centre of mass; widths are
    positive, so that low ≤ high holds for whatever weights. Boxes stay in the domain [−1, 1].
    ``of_data`` sets the scales of inputs and outputs.
    """

    scale: Tensor
    offset: Tensor

    def __init__(self, architecture: Architecture = Architecture()) -> None:
        super().__init__()
        self.architecture = architecture
        width = architecture.width
        self.encoder = _Encoder(architecture)
        self.head = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, width), nn.SiLU(), nn.Linear(width, 18)
        )
        self.register_buffer("scale", torch.ones(6))
        self.register_buffer("offset", torch.zeros(6))

    @classmethod
    def of_data(
        cls, architecture: Architecture, scenes: SceneTensors, points: Tensor
    ) -> BoxNetwork:
        """A new network for scenes and solutions like these; weights come from torch's
        generator.
        """
        network = cls(architecture)
        network.encoder.fit_scales(scenes)
        rest = points - _nominal(scenes)
        network.offset = rest.mean(dim=(0, 1))
        network.scale = rest.std(dim=(0, 1)).clamp(min=1e-3)
        return network

    def forward(self, scenes: SceneTensors) -> Boxes:
        """A box and a point in it for every contact."""
        raw = self.head(self.encoder(scenes))
        point = _nominal(scenes) + self.offset + self.scale * raw[..., :6]
        below, above = (
            self.scale * functional.softplus(raw[..., 6:12]),
            self.scale * functional.softplus(raw[..., 12:]),
        )
        return (
            (point - below).clamp(-1.0, 1.0),
            (point + above).clamp(-1.0, 1.0),
            point.clamp(-1.0, 1.0),
        )


class AttentionBlock(nn.Module):
    """One round of self-attention over the contacts and one of thought a contact, both residual."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.before = nn.LayerNorm(width)
        self.mixed = nn.Linear(width, 3 * width)
        self.out = nn.Linear(width, width)
        self.thought = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.SiLU(), nn.Linear(2 * width, width)
        )

    def forward(self, hidden: Tensor) -> Tensor:
        """Tokens, shape (B, N, width), to tokens."""
        batch, count, width = hidden.shape
        split = (
            self.mixed(self.before(hidden))
            .reshape(batch, count, 3, self.heads, -1)
            .permute(2, 0, 3, 1, 4)
        )
        weights = torch.softmax(
            split[0] @ split[1].transpose(-1, -2) / split[0].shape[-1] ** 0.5, dim=-1
        )
        hidden = hidden + self.out(
            (weights @ split[2]).transpose(1, 2).reshape(batch, count, width)
        )
        return torch.as_tensor(hidden + self.thought(hidden))


def pinball(low: Tensor, high: Tensor, points: Tensor, share: float) -> Tensor:
    """Quantile loss per scene: ``low`` is trained towards the quantile ``share`` of the solutions,
    and ``high`` towards the quantile 1 − ``share``.

    Arguments:
        low, high: lower and upper bounds of the box, shape (B, N, 6).
        points: solutions, shape (B, N, 6).
        share: level of the quantile, in (0, 1).
    """
    under, over = points - low, points - high
    lower = torch.maximum(share * under, (share - 1.0) * under)
    upper = torch.maximum((1.0 - share) * over, -share * over)
    return (lower + upper).mean(dim=(1, 2))


def as_arrays(*tensors: Tensor) -> tuple[Array, ...]:
    """In double precision, for the solver."""
    return tuple(tensor.detach().numpy().astype(np.float64) for tensor in tensors)


def _nominal(scenes: SceneTensors) -> Tensor:
    """[p, 0] with the toes in the middle of their patches and the body in its nominal place, shape
    (B, N, 6).
    """
    middle = scenes.vertices.mean(dim=2)
    return torch.cat([middle, torch.zeros_like(middle)], dim=-1)


def _tokens(scenes: SceneTensors) -> Tensor:
    """Numbers that describe each contact, shape (B, N, TOKEN)."""
    middle = scenes.vertices.mean(dim=2)
    spokes = scenes.vertices - middle[:, :, None]
    moments = torch.einsum("bnuj,bnuk->bnjk", spokes, spokes)
    row, column = torch.triu_indices(3, 3)
    friction = scenes.friction[..., None]
    vertical = scenes.frames[..., 2, 0][..., None] + friction * scenes.frames[..., 2, 2][..., None]
    parts = [
        middle,
        middle - scenes.shoulders,
        moments[..., row, column],
        scenes.frames.flatten(2),
        scenes.shoulders,
        friction,
        scenes.reach[..., None],
        vertical,
    ]
    return torch.cat(parts, dim=-1)
