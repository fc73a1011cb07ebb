"""Neural selectors: the terrain's own box for every contact, learned from solutions and through
P1's margins.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, PositiveFloat, PositiveInt
from torch import Tensor

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.episodes import MemorylessPolicy, Observation
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.codec import ALL_KEYS
from stancekit.planners.files.documents import check_fields, typed, validated
from stancekit.planners.relaxation.envelope import FEASIBLE_MARGIN, RELAXATIONS, Envelope

from ..training.loop import Checkpoint, Record, StepsDone, run
from .network import (
    Architecture,
    Boxes,
    BoxNetwork,
    Descent,
    Mirror,
    SceneTensors,
    as_arrays,
    load_weights,
    pinball,
    read_tensors,
    undisturbed,
    write_tensors,
)

if TYPE_CHECKING:
    from ..training.fitting import FitRequest


class Margin(torch.autograd.Function):
    """Margins that ``margins`` applies."""

    @staticmethod
    def forward(
        ctx: Any,
        low: Tensor,
        high: Tensor,
        problems: Sequence[Scaled],
        programs: Programs,
        relaxation: str,
    ) -> Tensor:
        """Solve P1 once a scene."""
        lows, highs = as_arrays(low, high)
        values, slopes = np.zeros(len(problems)), np.zeros((2, *lows.shape))
        for i, problem in enumerate(problems):
            box = Envelope(low=lows[i], high=highs[i])
            answer = RELAXATIONS.get(relaxation).margin(programs, problem, box, gradient=True)
            if answer.gradient is not None:
                values[i], slopes[:, i] = answer.margin, answer.gradient
        ctx.save_for_backward(torch.as_tensor(slopes, dtype=low.dtype))
        return torch.as_tensor(values, dtype=low.dtype)

    @staticmethod
    def backward(ctx: Any, *outputs: Tensor) -> tuple[Tensor, Tensor, None, None, None]:
        """Chain rule."""
        (slopes,) = ctx.saved_tensors
        grown = outputs[0][:, None, None]
        return slopes[0] * grown, slopes[1] * grown, None, None, None


def margins(
    low: Tensor,
    high: Tensor,
    problems: Sequence[Scaled],
    programs: Programs | None = None,
    relaxation: str = "p1",
) -> Tensor:
    """The signed margin of P1 of each scene over its box: 0 or less where P1 admits the scene, and
    by how much.

    Returns shape (B,), in the precision of ``low``; where P1 has no margin, P̄ having no answer, it
    is 0 and nothing flows back. Differentiable once, on the processor.

    Arguments:
        low, high: bounds of [p, f], non-dimensional, shape (B, N, 6), low ≤ high.
        problems: B of them, with N contacts.
        programs: compiled models, which a loop keeps from call to call; new ones where None.
        relaxation: which P1, "p1" or "joint".

    Raises:
        InvalidInput: for boxes of other shapes, not finite or reversed.
    """
    wanted = (len(problems), problems[0].size[0], 6) if problems else (0,)
    if tuple(low.shape) != wanted or tuple(high.shape) != wanted:
        raise InvalidInput(
            f"low, high: expected shape {wanted}, got {tuple(low.shape)} and {tuple(high.shape)}"
        )
    margins_of_boxes: Tensor = Margin.apply(low, high, problems, programs or Programs(), relaxation)  # type: ignore[no-untyped-call]
    return margins_of_boxes


_Share = Annotated[float, Field(gt=0.0, lt=1.0)]
_DECAY = 1e-4
"""Of the weights, in both stages."""


@dataclass(frozen=True, kw_only=True)
class NeuralSettings:
    """Settings of training a neural selector.

    Arguments:
        share: share of the solutions outside the first stage's boxes, on each side.
        epochs: epochs of the first stage, over the feasible rows.
        batch: batch size of the first stage.
        rate: learning rate of AdamW there.
        margin_epochs: epochs of the second stage, over the scarcer label; 0 skips it.
        margin_batch: problems of each label per step.
        margin_rate: learning rate there.
        softness: τ, the margin over which P1's answer turns from wrong to right in the loss
            σ(±t/τ), non-dimensional.
        caution: weight of a feasible problem lost relative to an infeasible one let in.
        anchor: weight of the first stage's loss in the second, which keeps solutions in the boxes.
        target: share of the feasible calibration rows that P1 must admit.
        relaxation: P1 whose margins count: "p1", or "joint", which learns a point in every box,
            too, the median of the solutions, about which the gap is linearised.
        calibration: share of the rows kept for calibration where no data set is given for it.
    """

    architecture: Architecture = field(default_factory=Architecture)
    share: _Share = 0.05
    epochs: PositiveInt = 20
    batch: PositiveInt = 128
    rate: PositiveFloat = 2e-3
    margin_epochs: NonNegativeInt = 4
    margin_batch: PositiveInt = 64
    margin_rate: PositiveFloat = 3e-4
    softness: PositiveFloat = 5e-4
    caution: float = 2.0
    anchor: float = 30.0
    relaxation: str = "p1"
    target: _Share = 0.985
    calibration: _Share = 0.15
    seed: int = 0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingRows:
    """Problems of one label: as the solver wants them, as the network sees them, and with solutions
    where feasible.
    """

    problems: tuple[Scaled, ...]
    scenes: SceneTensors
    points: Tensor

    @classmethod
    def of(cls, dataset: Dataset, label: str) -> TrainingRows:
        """The rows ``feasible`` or ``infeasible`` of a data set.

        Raises InvalidInput where there are none.
        """
        indices = dataset.feasible if label == "feasible" else dataset.infeasible
        if not len(indices):
            raise InvalidInput(f"data set: expected one or more {label} rows, got none")
        problems = tuple(Scaled.of(problem) for problem in dataset.select(indices).problems())
        points = dataset.points if label == "feasible" else np.zeros((0, problems[0].size[0], 6))
        return cls(
            problems=problems,
            scenes=SceneTensors.of_problems(problems),
            points=torch.tensor(points, dtype=torch.float32),
        )

    def __len__(self) -> int:
        return len(self.problems)


class _Trainer(Descent):
    """Both stages over one data set, an epoch at a time."""

    def __init__(
        self,
        feasible: TrainingRows,
        infeasible: TrainingRows | None,
        programs: Programs,
        settings: NeuralSettings,
    ) -> None:
        self._feasible, self._infeasible = feasible, infeasible
        self._programs, self._settings = programs, settings
        self._mirror = Mirror.of(feasible.scenes)
        with undisturbed(settings.seed):
            self.boxes = BoxNetwork.of_data(settings.architecture, feasible.scenes, feasible.points)
        self.total = settings.epochs + (settings.margin_epochs if infeasible else 0)
        super().__init__(self.boxes, settings.rate, _DECAY)

    def step(self, number: int) -> Record:
        """One epoch; the second stage begins with an optimiser of its own."""
        settings, stage = self._settings, 1 if number < self._settings.epochs else 2
        if number == settings.epochs:
            super().__init__(self.boxes, settings.margin_rate, _DECAY)
        self.boxes.train()
        loss = self._regress(number) if stage == 1 else self._descend(number)
        self.boxes.eval()
        return {"stage": stage, "epoch": number + 1, "loss": loss}

    def _regress(self, epoch: int) -> float:
        """One pass of quantile regression over the feasible rows."""
        settings, chance = self._settings, self._chance(epoch)
        order = torch.split(torch.randperm(len(self._feasible), generator=chance), settings.batch)
        total = 0.0
        for step, rows in enumerate(order):
            self._set_rate(settings.rate, (epoch + step / len(order)) / settings.epochs)
            flipped = self._flipped(len(rows), chance)
            scenes, points = self._feasible.scenes[rows], self._feasible.points[rows]
            if self._mirror is not None:
                scenes, points = (
                    self._mirror.scenes(scenes, flipped),
                    self._mirror.points(points, flipped),
                )
            loss = self._regression(self.boxes(scenes), points)
            total += self.down(loss) * len(rows)
        return total / len(self._feasible)

    def _descend(self, epoch: int) -> float:
        """One pass over the scarcer label through P1's margins: a smooth count of its mistakes, and
        the anchor.
        """
        assert self._infeasible is not None
        settings, chance = self._settings, self._chance(epoch)
        size = min(settings.margin_batch, len(self._feasible), len(self._infeasible))
        steps = max(min(len(self._feasible), len(self._infeasible)) // size, 1)
        orders = [
            torch.randperm(len(rows), generator=chance)
            for rows in (self._feasible, self._infeasible)
        ]
        total = 0.0
        for step in range(steps):
            self._set_rate(
                settings.margin_rate,
                (epoch - settings.epochs + step / steps) / settings.margin_epochs,
            )
            batch_rows, lost = (order[step * size : (step + 1) * size] for order in orders)
            boxes, margins = self._margins(self._feasible, batch_rows, chance)
            loss = settings.caution * torch.sigmoid(margins / settings.softness).mean()
            loss = loss + settings.anchor * self._regression(
                boxes, self._feasible.points[batch_rows]
            )
            loss = (
                loss
                + torch.sigmoid(
                    -self._margins(self._infeasible, lost, chance)[1] / settings.softness
                ).mean()
            )
            total += self.down(loss)
        return total / steps

    def _regression(self, boxes: Boxes, points: Tensor) -> Tensor:
        """Quantile loss of the sides, and of the point as the median where it is of use."""
        low, high, point = boxes
        loss = pinball(low, high, points, self._settings.share).mean()
        if not RELAXATIONS.get(self._settings.relaxation).about_points:
            return loss
        return loss + 0.5 * (points - point).abs().mean()

    def _margins(
        self, rows: TrainingRows, chosen: Tensor, chance: torch.Generator
    ) -> tuple[Boxes, Tensor]:
        """((low, high, point), margin) of scenes; some are shown mirrored, and their boxes mirrored
        back.
        """
        flipped = self._flipped(len(chosen), chance)
        scenes = rows.scenes[chosen]
        boxes = self.boxes(scenes if self._mirror is None else self._mirror.scenes(scenes, flipped))
        if self._mirror is not None:
            boxes = self._mirror.boxes(boxes, flipped)
        low, high, _ = boxes
        problems = [rows.problems[int(i)] for i in chosen]
        return boxes, margins(low, high, problems, self._programs, self._settings.relaxation)

    def _set_rate(self, rate: float, done: float) -> None:
        """Rise over the first tenth of a stage, then fall along a cosine."""
        factor = (
            min(done / 0.1, 1.0)
            if done < 0.1
            else 0.5 * (1.0 + math.cos(math.pi * (done - 0.1) / 0.9))
        )
        for group in self.optimiser.param_groups:
            group["lr"] = rate * max(factor, 1e-3)

    def _chance(self, epoch: int) -> torch.Generator:
        state = np.random.SeedSequence([self._settings.seed, epoch]).generate_state(1)
        return torch.Generator().manual_seed(int(state[0]))

    def _flipped(self, count: int, chance: torch.Generator) -> Tensor:
        return torch.rand(count, generator=chance) < 0.5


FORMAT = "stancekit/neural/1"
STEP, STEPS = 0.004, 8
"""Rooms that are tried beyond the one that the target needs."""


class NeuralSelector(MemorylessPolicy):
    """A trained network with its calibration, for one class of problems.

    Arguments:
        room: how far every side of the network's boxes is moved out, non-dimensional.
        relaxation: the P1 that its boxes are for; for "joint" an action has a point in every box,
            too.
        provenance: how it was learned.
    """

    name = "neural"

    def __init__(
        self,
        network: BoxNetwork,
        *,
        problem_class: str,
        legs: Sequence[str],
        force_scale_n: float,
        length_scale_m: float,
        room: float = 0.0,
        relaxation: str = "p1",
        provenance: Mapping[str, Any] | None = None,
    ) -> None:
        self.network = network.eval()
        self.problem_class = problem_class
        self.legs = tuple(legs)
        self.force_scale_n = force_scale_n
        self.length_scale_m = length_scale_m
        self.room = room
        self.relaxation = relaxation
        self.provenance = dict(provenance or {})

    def action(self, observation: Observation) -> NDArray[Any]:
        """The box's bounds, shape (12N,), or (B, 12N) for a batch; for "joint" the point as well,
        18N in all.

        Raises InvalidInput for another N.
        """
        boxes, points = self._boxes(SceneTensors.of_observation(observation, len(self.legs)))
        flat = np.stack([box.to_vector() for box in boxes])
        if RELAXATIONS.get(self.relaxation).about_points:
            flat = np.concatenate([flat, points.reshape(len(flat), -1)], axis=1)
        actions: NDArray[Any] = flat.astype(np.float32)
        return actions if np.ndim(observation["friction"]) == 2 else actions[0]

    def envelopes(self, problems: Sequence[Scaled]) -> list[Envelope]:
        """The boxes for these problems, for a planner."""
        return self._boxes(SceneTensors.of_problems(problems))[0]

    def save(self, path: str | Path, *, half: bool = False) -> None:
        """Write the selector as one safetensors file.

        Arguments:
            half: with its weights rounded to half precision.
        """
        header = {
            "problem_class": self.problem_class,
            "legs": list(self.legs),
            "force_scale_n": self.force_scale_n,
            "length_scale_m": self.length_scale_m,
            "architecture": asdict(self.network.architecture),
            "calibration": {"room": self.room},
            "relaxation": self.relaxation,
            "provenance": self.provenance,
        }
        write_tensors(path, FORMAT, header, self.network.state_dict(), half=half)

    @classmethod
    @undisturbed()
    def load(cls, path: str | Path) -> NeuralSelector:
        """Read a selector.

        Raises InvalidInput for a file that is damaged or foreign.
        """
        header, tensors = read_tensors(path, FORMAT)
        raw = validated(_Header, header, str(path))
        with torch.device("meta"):
            network = BoxNetwork(raw.architecture)
        load_weights(network, tensors, path)
        return cls(
            network,
            problem_class=raw.problem_class,
            legs=raw.legs,
            force_scale_n=raw.force_scale_n,
            length_scale_m=raw.length_scale_m,
            room=raw.calibration.room,
            relaxation=raw.relaxation,
            provenance=raw.provenance,
        )

    @undisturbed()
    def _boxes(self, scenes: SceneTensors) -> tuple[list[Envelope], Array]:
        with torch.no_grad():
            lows, highs, points = as_arrays(*self.network(scenes))
        return [roomy(low, high, self.room) for low, high in zip(lows, highs, strict=True)], points


@undisturbed()
def fit_neural(
    dataset: Dataset,
    settings: NeuralSettings = NeuralSettings(),
    progress: StepsDone | None = None,
    *,
    calibration: Dataset | None = None,
    checkpoint: Path | None = None,
) -> NeuralSelector:
    """Train and calibrate a selector on a data set; see ``NeuralSettings``.

    Arguments:
        calibration: rows for the calibration, else a part of ``dataset`` is kept for it; never use
            test rows.
        checkpoint: file to go on from when training was stopped.

    Raises:
        InvalidInput: where rows of a label are missing.
    """
    train = dataset
    labels = ("feasible", "infeasible") if settings.margin_epochs else ("feasible",)
    if calibration is None:
        train, calibration = kept_apart(dataset, settings.calibration, labels)
    elif calibration.problem_class != dataset.problem_class:
        raise InvalidInput(
            f"calibration: expected {dataset.problem_class}, got {calibration.problem_class}"
        )
    feasible = TrainingRows.of(train, "feasible")
    infeasible = TrainingRows.of(train, "infeasible") if settings.margin_epochs else None
    programs = Programs()
    trainer = _Trainer(feasible, infeasible, programs, settings)
    about = {"settings": asdict(settings), "data": f"{dataset.header.digest} {len(train)}"}
    history = run(trainer, progress, Checkpoint.of(checkpoint, about))
    network = trainer.boxes.eval()
    held = TrainingRows.of(calibration, "feasible")
    room = calibrated_room(network, held, programs, settings)
    if settings.relaxation != "p1" and len(calibration.infeasible):
        room = roomiest(
            network,
            (held, TrainingRows.of(calibration, "infeasible")),
            programs,
            settings,
            least=room,
        )
    first = feasible.problems[0]
    return NeuralSelector(
        network,
        problem_class=dataset.problem_class,
        legs=dataset.header.legs,
        force_scale_n=first.force_n,
        length_scale_m=first.length_m,
        room=room,
        relaxation=settings.relaxation,
        provenance={
            "method": "neural" if settings.relaxation == "p1" else settings.relaxation,
            "settings": asdict(settings),
            "rows": len(train),
            "calibration_rows": len(held),
            "calibration": calibration.origin,
            **dataset.origin,
            "history": history,
        },
    )


_JOINT_TARGET = 0.99
"""Share of the feasible rows that the joint P1 must admit where nothing is said: chosen on
validation rows."""


def neural(request: FitRequest) -> NeuralSelector:
    """A network from terrain to box."""
    return fit_neural(
        request.dataset,
        typed(NeuralSettings, request.settings.neural, "neural"),
        request.progress,
        calibration=request.calibration,
        checkpoint=request.checkpoint,
    )


def joint(request: FitRequest) -> NeuralSelector:
    """A network from terrain to box and point, for the P1 that is joined with the lift."""
    settings = request.settings
    keys = {"target": _JOINT_TARGET, **settings.neural, "relaxation": "joint"}
    return neural(replace(request, settings=replace(settings, neural=keys)))


def kept_apart(dataset: Dataset, share: float, labels: Sequence[str]) -> tuple[Dataset, Dataset]:
    """Rows to learn from, and a share of them that is kept to calibrate on.

    Raises InvalidInput where two rows of a label are not there, or one to calibrate on.
    """
    given = {label: len(getattr(dataset, label)) for label in ("feasible", "infeasible")}
    counts = " and ".join(f"{count} {label}" for label, count in given.items())
    if min(given[label] for label in labels) < 2:
        wanted = "each label" if len(labels) > 1 else f"the label {labels[0]}"
        raise InvalidInput(f"data set: expected two or more rows of {wanted}, got {counts}")
    train, kept = dataset.split((1.0 - share, share))
    if not len(kept.feasible):
        raise InvalidInput(
            f"data set: expected a feasible row or more to calibrate on, got a share of {share:g} "
            f"of {counts}, which is none: more rows, a larger share, or a data set for it"
        )
    return train, kept


def calibrated_room(
    network: BoxNetwork,
    rows: TrainingRows,
    programs: Programs,
    settings: NeuralSettings,
    *,
    least: float = -0.01,
    most: float = 0.1,
) -> float:
    """Distance by which every side moves out (in, where negative) so that P1 admits the target's
    share of these problems.

    P1 is monotone in the box, so each bisection step solves only the problems that are not settled
    yet. Returns the smallest room found to reach the target, or ``most``.
    """
    with torch.no_grad():
        lows, highs, _ = as_arrays(*network(rows.scenes))

    open_rows, admitted, needed = list(range(len(rows))), 0, math.ceil(settings.target * len(rows))
    for _ in range(14):
        room = 0.5 * (least + most)
        inside = [
            index
            for index in open_rows
            if _admits(rows.problems[index], lows[index], highs[index], room, programs, settings)
        ]
        if admitted + len(inside) >= needed:
            most, open_rows = room, inside
        else:
            least, admitted = room, admitted + len(inside)
            open_rows = sorted(set(open_rows) - set(inside))
    return most


def _admits(
    problem: Scaled,
    low: Array,
    high: Array,
    room: float,
    programs: Programs,
    settings: NeuralSettings,
) -> bool:
    """Tell whether P1 admits a problem over its box with this room."""
    relaxation, box = RELAXATIONS.get(settings.relaxation), roomy(low, high, room)
    return relaxation.margin(programs, problem, box).margin <= FEASIBLE_MARGIN


def roomiest(
    network: BoxNetwork,
    rows: tuple[TrainingRows, TrainingRows],
    programs: Programs,
    settings: NeuralSettings,
    *,
    least: float,
) -> float:
    """Room, from ``least`` on in steps of STEP, with which P1 makes the fewest mistakes on these
    rows.

    Arguments:
        rows: feasible, infeasible. A feasible one that is lost counts ``settings.caution`` times.
            P1 is monotone in the box: what it admits once it admits with more room, too.
    """
    with torch.no_grad():
        sides = [as_arrays(*network(each.scenes)) for each in rows]
    left_out = [list(range(len(each))) for each in rows]

    def cost(room: float) -> float:
        for label, open_rows in enumerate(left_out):
            problems, (low, high, _) = rows[label].problems, sides[label]
            left_out[label] = [
                index
                for index in open_rows
                if not _admits(problems[index], low[index], high[index], room, programs, settings)
            ]
        lost, refused = (
            len(open_rows) / len(each) for open_rows, each in zip(left_out, rows, strict=True)
        )
        return settings.caution * lost + 1.0 - refused

    costs = {room: cost(room) for room in (least + STEP * np.arange(STEPS + 1)).tolist()}
    return float(min(costs, key=lambda room: (costs[room], room)))


def roomy(low: Array, high: Array, room: float) -> Envelope:
    """The box with every side moved by ``room``, no further in than its middle, and within the
    domain [−1, 1].
    """
    middle = 0.5 * (low + high)
    return Envelope(
        low=np.clip(np.minimum(low - room, middle), -1.0, 1.0),
        high=np.clip(np.maximum(high + room, middle), -1.0, 1.0),
    )


class _Calibration(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    room: float = Field(ge=-1.0, le=1.0)


class _Header(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    problem_class: str
    legs: list[str] = Field(min_length=1)
    force_scale_n: float
    length_scale_m: float
    architecture: Annotated[Architecture, ALL_KEYS]
    calibration: _Calibration
    relaxation: str = "p1"
    provenance: dict[str, Any]
