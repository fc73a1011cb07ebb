"""Neural selectors: the terrain's own box for every contact, learned from solutions and through
P1's margins.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.episodes import MemorylessPolicy, Observation
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.codec import ALL_KEYS
from stancekit.planners.files.validation import validated
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.relaxed import FEASIBLE_MARGIN
from stancekit.planners.relaxation.table import RELAXATIONS

from .network import Architecture, BoxNetwork, SceneTensors, as_arrays
from .neural_training import NeuralSettings, Progress, Trainer, TrainingRows
from .tensors import load_weights, read_tensors, write_tensors

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
    def load(
        cls,
        path: str | Path,
        *,
        problem_class: str | None = None,
        legs: Sequence[str] | None = None,
    ) -> NeuralSelector:
        """Read a selector.

        Raises InvalidInput for a file that is damaged or foreign, or made for other problems.

        Arguments:
            problem_class, legs: what it must have been learned for, where given.
        """
        header, tensors = read_tensors(path, FORMAT)
        raw = validated(_Header, header, str(path))
        if problem_class is not None and raw.problem_class != problem_class:
            raise InvalidInput(
                f"{path}: expected a selector for {problem_class}, got one for {raw.problem_class}"
            )
        if legs is not None and raw.legs != list(legs):
            raise InvalidInput(
                f"{path}: expected a selector for legs {list(legs)}, got one for {raw.legs}"
            )
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

    def _boxes(self, scenes: SceneTensors) -> tuple[list[Envelope], Array]:
        with torch.no_grad():
            lows, highs, points = as_arrays(*self.network(scenes))
        return [roomy(low, high, self.room) for low, high in zip(lows, highs, strict=True)], points


def fit_neural(
    dataset: Dataset,
    settings: NeuralSettings = NeuralSettings(),
    progress: Progress | None = None,
    *,
    calibration: Dataset | None = None,
    checkpoint: Path | None = None,
) -> NeuralSelector:
    """Train and calibrate a selector on a data set; see ``NeuralSettings``.

    Uses one torch thread.

    Arguments:
        calibration: rows for the calibration, else a part of ``dataset`` is kept for it; never use
            test rows.
        checkpoint: file to go on from when training was stopped.

    Raises:
        InvalidInput: where rows of a label are missing.
    """
    torch.set_num_threads(1)
    train = dataset
    if calibration is None:
        train, calibration = dataset.split((1.0 - settings.calibration, settings.calibration))
    elif calibration.problem_class != dataset.problem_class:
        raise InvalidInput(
            f"calibration: expected {dataset.problem_class}, got {calibration.problem_class}"
        )
    feasible = TrainingRows.of(train, "feasible")
    infeasible = TrainingRows.of(train, "infeasible") if settings.margin_epochs else None
    programs = Programs()
    digest = f"{dataset.header.digest} {len(train)}"
    trainer = Trainer(feasible, infeasible, programs, settings, digest, checkpoint)
    network = trainer.run(progress)
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
            "history": trainer.history,
        },
    )


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

    def admits(index: int, room: float) -> bool:
        problem, box = rows.problems[index], roomy(lows[index], highs[index], room)
        return (
            RELAXATIONS.get(settings.relaxation).margin(programs, problem, box).margin
            <= FEASIBLE_MARGIN
        )

    open_rows, admitted, needed = list(range(len(rows))), 0, math.ceil(settings.target * len(rows))
    for _ in range(14):
        room = 0.5 * (least + most)
        inside = [index for index in open_rows if admits(index, room)]
        if admitted + len(inside) >= needed:
            most, open_rows = room, inside
        else:
            least, admitted = room, admitted + len(inside)
            open_rows = sorted(set(open_rows) - set(inside))
    return most


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

    def admits(label: int, index: int, room: float) -> bool:
        problem, (low, high, _) = rows[label].problems[index], sides[label]
        box = roomy(low[index], high[index], room)
        return (
            RELAXATIONS.get(settings.relaxation).margin(programs, problem, box).margin
            <= FEASIBLE_MARGIN
        )

    def cost(room: float) -> float:
        for label, open_rows in enumerate(left_out):
            left_out[label] = [index for index in open_rows if not admits(label, index, room)]
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
