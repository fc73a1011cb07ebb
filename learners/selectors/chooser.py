"""A chooser among several envelopes: the terrain decides which box P1 gets (Lin et al.'s one binary
a box, learned).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt
from torch import Tensor, nn
from torch.nn import functional

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.episodes import MemorylessPolicy, Observation
from stancekit.envs.selection import ADMITTED
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.codec import ALL_KEYS
from stancekit.planners.files.documents import check_fields, validated
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import McCormick, domain_of

from .network import (
    Architecture,
    ChoiceNetwork,
    SceneTensors,
    load_weights,
    read_tensors,
    write_tensors,
)

BAND = 1e-6
"""A witness must have this margin to spare, a certificate must exclude this margin: ten times what
P1 forgives."""
ROUNDS = 8
"""Number of times that the moments of a witness are tried again with the largest held at their
bounds."""
Bools = NDArray[np.bool_]
Index = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class DualBounds:
    """P boxes.

    Arguments:
        low, high: shape (P, N, 6).
        products: p_j f_k of the ends, in the order of the envelope rows and with their signs in the
            Lagrangian, shape (36 N, P).
    """

    low: Array
    high: Array
    products: Array

    @classmethod
    def of(cls, boxes: Sequence[Envelope]) -> DualBounds:
        """Stack some boxes."""
        low, high = np.stack([box.low for box in boxes]), np.stack([box.high for box in boxes])
        p_low, p_high = low[..., :3, None], high[..., :3, None]
        f_low, f_high = low[..., None, 3:], high[..., None, 3:]
        signed = np.stack([-p_low * f_low, -p_high * f_high, p_low * f_high, p_high * f_low])
        products = np.moveaxis(signed, 1, -1).reshape(-1, len(low))
        return cls(low=low, high=high, products=np.ascontiguousarray(products))

    def take(self, which: Index) -> DualBounds:
        """Some of the boxes."""
        return DualBounds(
            low=self.low[which], high=self.high[which], products=self.products[:, which]
        )


def witnessed(point: Array, excess: Array, axes: Array, bounds: DualBounds, open_: Bools) -> Bools:
    """Tell whether points settle P1 over boxes with BAND to spare, shape (K, W, P), False where not
    open, shape (K, P).

    A point [p, f] in the box is one of P1 if some moments m = p f + e balance there under the
    envelope rows, which read −(p − p_low)(f − f_low) ≤ e, −(p_high − p)(f_high − f) ≤ e, e ≤ (p −
    p_low)(f_high − f) and e ≤ (p_high − p)(f − f_low).

    Arguments:
        point, excess: of K × W witnesses (``DualBound``).
        axes: E9 is axes · m = 0, shape (K, 3, 9N).
    """
    at = point[:, :, None]
    inside = np.all((at >= bounds.low + BAND) & (at <= bounds.high - BAND), axis=(3, 4))
    hits: Bools = np.asarray(inside & open_[:, None])
    k, w, b = np.nonzero(hits)
    if not len(k):
        return hits
    above, below = point[k, w] - bounds.low[b], bounds.high[b] - point[k, w]
    (p_above, f_above), (p_below, f_below) = (
        (side[..., :3, None], side[..., None, 3:]) for side in (above, below)
    )
    bottom = BAND - np.minimum(p_above * f_above, p_below * f_below).reshape(len(k), -1)
    top = np.minimum(p_above * f_below, p_below * f_above).reshape(len(k), -1) - BAND
    hits[k, w, b] = balanced(axes[k], excess[k, w].reshape(len(k), -1), bottom, top)
    return hits


def balanced(axes: Array, excess: Array, bottom: Array, top: Array) -> Bools:
    """Tell whether some e in [bottom, top] has the same axes · e as ``excess``; a False may be
    wrong. Shapes (T, 9N).

    Scaled to |s| ≤ 1 about the middle, the smallest s is tried, then what is too large in it is
    held at ±1 and the rest solved again, ROUNDS times.
    """
    middle, half = 0.5 * (top + bottom), 0.5 * (top - bottom)
    flags = np.zeros(len(axes), dtype=bool)
    rows = np.flatnonzero(np.all(half > 0.0, axis=1))
    scaled = axes[rows] * half[rows][:, None]
    target = np.einsum("trc,tc->tr", axes[rows], excess[rows] - middle[rows])
    held = np.zeros((len(rows), axes.shape[2]))
    for _ in range(ROUNDS):
        free = scaled * (held == 0.0)[:, None]
        gram = free @ scaled.swapaxes(1, 2) + 1e-14 * np.eye(3)
        rest = target - np.einsum("trc,tc->tr", scaled, held)
        s = held + np.einsum("trc,tr->tc", free, np.linalg.solve(gram, rest[..., None])[..., 0])
        off = np.abs(target - np.einsum("trc,tc->tr", scaled, s)).max(axis=1)
        done = np.all(np.abs(s) <= 1.0, axis=1) & (off < 1e-10)
        flags[rows[done]] = True
        held = np.where(np.abs(s) > 1.0, np.sign(s), held)
        rows, scaled, target, held = rows[~done], scaled[~done], target[~done], held[~done]
        if not len(rows):
            break
    return flags


def least(
    rows: Array, slope: Array, constant: Array, bounds: DualBounds, low: Array, high: Array
) -> Array:
    """Least value of the Lagrangian over [p, f] in the overlap at a margin of BAND, shape (K, C,
    P).

    Where it is positive, P1's margin is larger than BAND.

    Arguments:
        rows, slope, constant: of K × C certificates (``DualBound``).
        low, high: the overlap, shape (K, P, N, 6).
    """
    k, c = rows.shape[:2]
    value = (rows.reshape(k * c, -1) @ bounds.products).reshape(k, c, -1)
    value += (constant - BAND * rows.sum(axis=(2, 3, 4, 5)))[..., None]
    (p_low, f_low), (p_high, f_high) = (
        (np.moveaxis(side[..., :3], 0, -1), np.moveaxis(side[..., 3:], 0, -1))
        for side in (bounds.low, bounds.high)
    )  # each of shape (N, 3, P)
    u = np.moveaxis(rows, 2, 0)
    by_p = (
        (u[0] - u[3]) @ f_low + (u[1] - u[2]) @ f_high + slope[..., :3, None]
    )  # shape (K, C, N, 3, P)
    turned = u.swapaxes(-1, -2)
    by_f = (turned[0] - turned[2]) @ p_low + (turned[1] - turned[3]) @ p_high + slope[..., 3:, None]
    middle, half = (
        np.moveaxis(side, 1, -1)[:, None] for side in (0.5 * (high + low), 0.5 * (high - low))
    )
    for by, part in ((by_p, slice(0, 3)), (by_f, slice(3, 6))):
        value = value + np.sum(
            by * middle[..., part, :] - np.abs(by) * half[..., part, :], axis=(2, 3)
        )
    return np.asarray(value)


def ranges(problem: Scaled) -> tuple[Array, Array]:
    """Bounds of [p, f] in any answer, each of shape (N, 6).

    That is, the patches as seen from the ball of the centre of mass, and the forces in their boxes
    and cones.
    """
    whole = domain_of(problem, reach=False)
    room = 1e-7  # what the solver forgives
    return whole.low - room, whole.high + room


FORMAT = "stancekit/chooser/1"
Progress = Callable[[int, int], None]


@dataclass(frozen=True, kw_only=True)
class ChooserSettings:
    """Settings of training a chooser.

    Arguments:
        epochs, batch, rate: of AdamW.
        projection: what a feasible problem costs that P1 admits but fix-p does not solve; a wrong
            answer of P1 costs 1.
        caution: how much more a feasible problem counts than an infeasible one.
    """

    architecture: Architecture = field(default_factory=lambda: Architecture(width=48, layers=2))
    epochs: PositiveInt = 20
    batch: PositiveInt = 64
    rate: PositiveFloat = 1e-3
    projection: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5
    caution: PositiveFloat = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_fields(self)


class Chooser(MemorylessPolicy):
    """A network that picks one envelope of a set for every scene."""

    name = "chooser"

    def __init__(self, network: ChoiceNetwork, envelopes: EnvelopeSet) -> None:
        self.network = network.eval()
        self.envelopes = envelopes
        self.provenance = envelopes.provenance
        self._actions = np.stack([envelope.to_vector() for envelope in envelopes.envelopes]).astype(
            np.float32
        )

    def choose(self, observation: Observation) -> NDArray[np.int64]:
        """Index of the envelope for each scene, shape (B,): an action where the environment has the
        set as library.
        """
        with torch.no_grad():
            cost = self.network(SceneTensors.of_observation(observation, len(self.envelopes.legs)))
        return np.asarray(cost.argmin(dim=1).numpy(), dtype=np.int64)

    def action(self, observation: Observation) -> NDArray[Any]:
        """The chosen box's bounds, shape (12N,), or (B, 12N) for a batch."""
        actions = self._actions[self.choose(observation)]
        return actions if np.ndim(observation["friction"]) == 2 else actions[0]

    def save(self, path: str | Path) -> None:
        """Write network and envelopes as one safetensors file."""
        header = {
            "architecture": asdict(self.network.architecture),
            "envelopes": self.envelopes.to_json(),
        }
        write_tensors(path, FORMAT, header, self.network.state_dict())

    @classmethod
    def load(cls, path: str | Path, *, problem_class: str | None = None) -> Chooser:
        """Read a chooser.

        Raises InvalidInput for a file that is damaged or foreign, or made for another class.
        """
        header, tensors = read_tensors(path, FORMAT)
        raw = validated(_Header, header, str(path))
        try:
            envelopes = EnvelopeSet.from_json(raw.envelopes)
        except InvalidInput as error:
            raise InvalidInput(f"{path}: {error}") from None
        if problem_class not in (None, envelopes.problem_class):
            raise InvalidInput(
                f"{path}: expected a chooser for {problem_class}, got one for "
                f"{envelopes.problem_class}"
            )
        with torch.device("meta"):
            network = ChoiceNetwork(raw.architecture, len(envelopes.envelopes))
        load_weights(network, tensors, path)
        return cls(network, envelopes)


def fit_chooser(
    dataset: Dataset,
    envelopes: EnvelopeSet,
    settings: ChooserSettings = ChooserSettings(),
    progress: Progress | None = None,
) -> Chooser:
    """Learn which envelope suits a terrain: the network predicts what each box costs, and the
    cheapest is chosen.

    The cost of every box on every row is solved for once (``costs``). Uses one torch thread;
    ``progress`` is told rows solved and rows in all. Raises InvalidInput for a data set of another
    class or without rows of a label.
    """
    torch.set_num_threads(1)
    if dataset.problem_class != envelopes.problem_class:
        raise InvalidInput(
            f"envelopes: expected some for {dataset.problem_class}, got {envelopes.problem_class}"
        )
    kinds = (dataset.feasible, dataset.infeasible)
    if not all(len(rows) for rows in kinds):
        raise InvalidInput(
            f"data set: expected rows of both labels, got {len(kinds[0])} and {len(kinds[1])}"
        )
    problems = [Scaled.of(problem) for rows in kinds for problem in dataset.select(rows).problems()]
    feasible = np.arange(len(problems)) < len(kinds[0])
    cost = costs(
        problems,
        feasible,
        envelopes.envelopes,
        Programs(),
        projection=settings.projection,
        progress=progress,
    )
    weight = (
        np.where(feasible, settings.caution / len(kinds[0]), 1.0 / len(kinds[1]))
        * len(problems)
        / 2.0
    )
    targets, weights = (
        torch.as_tensor(array, dtype=torch.float32) for array in (cost, weight[:, None])
    )
    return Chooser(
        _train(SceneTensors.of_problems(problems), targets, weights, settings), envelopes
    )


def costs(
    problems: Sequence[Scaled],
    feasible: NDArray[np.bool_],
    envelopes: Sequence[Envelope],
    programs: Programs,
    *,
    projection: float = 0.5,
    progress: Progress | None = None,
) -> Array:
    """Cost of every box on every problem, shape (len(problems), K).

    1 where P1's answer is wrong; ``projection`` where it admits a feasible problem and fix-p does
    not solve it; else 0.

    Arguments:
        feasible: the labels, shape (len(problems),).
    """
    cost = np.zeros((len(problems), len(envelopes)))
    for i, problem in enumerate(problems):
        for k, envelope in enumerate(envelopes):
            answer = programs.get(McCormick, problem.layout).solve(problem, envelope)
            if not answer.known or answer.feasible != feasible[i]:
                cost[i, k] = 1.0
            elif feasible[i] and projection > 0.0 and answer.point is not None:
                solved = project(programs, "fix-p", problem, answer.point).residual <= ADMITTED
                cost[i, k] = 0.0 if solved else projection
        if progress is not None:
            progress(i + 1, len(problems))
    return cost


def _train(
    scenes: SceneTensors, cost: Tensor, weight: Tensor, settings: ChooserSettings
) -> ChoiceNetwork:
    """Regress every box's cost, shape (B, K), by cross-entropy.

    Minimising the expected cost of a softmax choice instead was tried: it settles on the one box
    that is best overall.

    Arguments:
        weight: of each row, shape (B, 1).
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        network = ChoiceNetwork(settings.architecture, cost.shape[1])
    network.encoder.fit_scales(scenes)
    chance = torch.Generator().manual_seed(settings.seed)
    optimizer = torch.optim.AdamW(network.parameters(), lr=settings.rate, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, settings.epochs)
    for _ in range(settings.epochs):
        for rows in torch.split(torch.randperm(len(scenes), generator=chance), settings.batch):
            loss = functional.binary_cross_entropy_with_logits(
                network(scenes[rows]), cost[rows], weight=weight[rows]
            )
            optimizer.zero_grad()
            torch.autograd.backward(loss)
            nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
        schedule.step()
    return network


class _Header(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    architecture: Annotated[Architecture, ALL_KEYS]
    envelopes: dict[str, Any]
