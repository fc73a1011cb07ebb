"""Methods that learn networks, and need torch."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from stancekit.envs.data.dataset import scenes_of
from stancekit.planners.files.documents import typed
from stancekit.planners.files.writing import make_folder

from ..selectors.neural import NeuralSelector, NeuralSettings, fit_neural, kept_apart
from ..selectors.policy import TrainedPolicy, bounds_of
from .fitting import FitRequest, fit
from .held_out import TrainingScenes
from .reinforce import train

_JOINT_TARGET = 0.99
"""Share of the feasible rows that the joint P1 must admit where nothing is said: chosen on
validation rows."""


def neural(request: FitRequest) -> NeuralSelector:
    """A network from terrain to box."""
    knobs = typed(NeuralSettings, request.settings.neural, "neural")
    return fit_neural(
        request.dataset,
        knobs,
        request.progress,
        calibration=request.calibration,
        checkpoint=request.checkpoint,
    )


def joint(request: FitRequest) -> NeuralSelector:
    """A network from terrain to box and point, for the P1 that is joined with the lift."""
    settings = request.settings
    joint_settings = replace(
        settings, neural={"target": _JOINT_TARGET, **settings.neural, "relaxation": "joint"}
    )
    return neural(replace(request, settings=joint_settings))


def reinforcement(request: FitRequest) -> TrainedPolicy | NeuralSelector:
    """A policy trained on the data set's scenes; its learning curve is drawn on the calibration
    rows.
    """
    dataset, calibration, settings = request.dataset, request.calibration, request.settings
    learned, held_out = (
        (dataset, calibration)
        if calibration is not None
        else kept_apart(dataset, 0.15, ("feasible", "infeasible"))
    )
    count = {
        "feasible": len(learned.feasible),
        "infeasible": len(learned.infeasible),
        "seed": learned.header.plan.seed,
    }
    config = settings.training(
        dataset.problem_class, dataset.header.legs if dataset.robot else None, count
    )
    base = bounds_of(fit(config.base, dataset, settings).envelopes[0])
    scenes = TrainingScenes(
        train=scenes_of(learned), held_out=scenes_of(held_out), base=base, rows=learned
    )
    with tempfile.TemporaryDirectory() as spare:
        where = request.checkpoint or Path(spare)
        make_folder(where)
        resume = (where / "checkpoint.safetensors").exists()
        return train(config, where, resume=resume, scenes=scenes, progress=request.progress).policy
