"""What networks learn and say depends on nothing that is set for the whole process, and changes
nothing of it.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

import stancekit
import stancekit.envs
from stancekit.envs.data.dataset import Dataset
from stancekit.learners.leaps.policy import LeapScorer
from stancekit.learners.selectors.neural import NeuralSelector
from stancekit.learners.zoo import shipped

SETTINGS: dict[str, Callable[[], Any]] = {
    "two threads": lambda: torch.set_num_threads(2),
    "streams": lambda: (torch.manual_seed(5), random.seed(5), np.random.seed(5)),  # noqa: NPY002
    "double precision": lambda: torch.set_default_dtype(torch.float64),
    "another device": lambda: torch.set_default_device("meta"),
    "no gradients": lambda: torch.set_grad_enabled(False),
    "coarse products": lambda: torch.set_float32_matmul_precision("medium"),
    "strict algorithms": lambda: torch.use_deterministic_algorithms(True),
    "NumPy raises": lambda: np.seterr(all="raise"),
}


def state() -> list[Any]:
    """What is set for the process, and where its streams are."""
    return [
        torch.get_num_threads(),
        torch.get_default_dtype(),
        torch.get_default_device(),
        torch.is_grad_enabled(),
        torch.get_float32_matmul_precision(),
        torch.are_deterministic_algorithms_enabled(),
        np.geterr(),
        torch.get_rng_state().tolist(),
        random.getstate(),
        np.random.get_state()[1].tolist(),  # type: ignore[index]  # noqa: NPY002
    ]


@contextmanager
def put_back() -> Iterator[None]:
    """Leave the process as it was."""
    with ExitStack() as kept:
        kept.callback(torch.set_num_threads, torch.get_num_threads())
        kept.callback(torch.set_default_dtype, torch.float32)
        kept.callback(torch.set_default_device, None)
        kept.callback(torch.set_grad_enabled, True)
        kept.callback(torch.set_float32_matmul_precision, "highest")
        kept.callback(torch.use_deterministic_algorithms, False)
        kept.callback(np.seterr, **np.geterr())  # type: ignore[arg-type]
        yield


def weights(network: torch.nn.Module) -> bytes:
    return b"".join(each.numpy().tobytes() for each in network.state_dict().values())


@pytest.fixture(scope="module")
def uses(labelled: Callable[..., Dataset]) -> dict[str, Callable[[], Any]]:
    rows, problems = labelled(20, 20, 4, shard_size=20), stancekit.sample("wall-3", 100, rng=3)
    leap, _ = gymnasium.make("stancekit/LeapChoice-v0").reset(seed=1)
    scene, _ = gymnasium.make("stancekit/EnvelopeSelection-v0").reset(seed=1)
    neural, epochs = shipped("selectors")["neural-wall-3"], {"epochs": 1, "margin_epochs": 1}

    def learned(method: str, **settings: Any) -> bytes:
        return weights(stancekit.fit(rows, method, **settings).selector.network)

    return {
        "surrogate": lambda: stancekit.fit(rows, "surrogate", epochs=1).digest,
        "neural": lambda: learned("neural", neural=epochs),
        "screen": lambda: stancekit.screen(problems, error=0.005).scores.tolist(),
        "predict": lambda: NeuralSelector.load(neural).predict(scene)[0].tolist(),
        "scores": lambda: LeapScorer.read("set-leap-hard").predict(leap)[0].tolist(),
    }


def test_no_setting_and_no_other_call_changes_what_networks_give(
    uses: dict[str, Callable[[], Any]],
) -> None:
    first = {use: ask() for use, ask in uses.items()}
    for name, do in SETTINGS.items():
        with put_back():
            do()
            before = state()
            assert {use: ask() for use, ask in uses.items()} == first, name
            assert state() == before, name
