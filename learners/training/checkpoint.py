"""Checkpoints of training runs: weights, the optimiser's state and the curve so far, whole or not
at all.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.writing import write_text

from ..selectors.policy import check_shapes
from ..selectors.tensors import read_tensors, write_tensors
from .held_out import CurvePoint
from .train_config import TrainConfig

CHECKPOINT_FORMAT = "stancekit/training/1"
NAME = "checkpoint.safetensors"


def write_checkpoint(
    folder: Path,
    config: TrainConfig,
    curve: Sequence[CurvePoint],
    weights: Mapping[str, Tensor],
    optimizer: torch.optim.Optimizer,
    **more: Any,
) -> None:
    """Write the checkpoint; then ``curve.jsonl``, which people read.

    Arguments:
        more: JSON-ready, into the header.
    """
    tensors = {f"policy.{name}": value for name, value in weights.items()}
    for index, slot in optimizer.state_dict()["state"].items():
        tensors |= {
            f"optimizer.{index}.{name}": torch.as_tensor(value) for name, value in slot.items()
        }
    header = {"config": asdict(config), "curve": [asdict(point) for point in curve], **more}
    write_tensors(folder / NAME, CHECKPOINT_FORMAT, header, tensors)
    write_text(folder / "curve.jsonl", "".join(json.dumps(asdict(point)) + "\n" for point in curve))


def read_checkpoint(
    path: Path, config: TrainConfig, module: torch.nn.Module, optimizer: torch.optim.Optimizer
) -> tuple[dict[str, Any], list[CurvePoint]]:
    """Put weights and optimiser back as they were; return the header and the curve.

    Raises InvalidInput where the file is damaged, or of another configuration in more than
    ``steps``.
    """
    header, tensors = read_tensors(path, CHECKPOINT_FORMAT)
    mine, theirs = json.loads(json.dumps(asdict(config))), header.get("config")
    if not isinstance(theirs, dict):
        raise InvalidInput(f"{path}: expected a configuration in the header, got none")
    odd = [key for key in mine if key not in ("steps", "workers") and mine[key] != theirs.get(key)]
    if odd:
        raise InvalidInput(
            f"{path}: {odd[0]}: expected {theirs.get(odd[0])} as in the run, got {mine[odd[0]]}"
        )
    wanted = {f"policy.{name}": tuple(value.shape) for name, value in module.state_dict().items()}
    check_shapes(
        path, wanted, {name: value for name, value in tensors.items() if name.startswith("policy.")}
    )
    module.load_state_dict({name.removeprefix("policy."): tensors[name] for name in wanted})
    state: dict[int, dict[str, Any]] = {}
    for name, value in tensors.items():
        if name.startswith("optimizer."):
            _, index, slot = name.split(".")
            state.setdefault(int(index), {})[slot] = value
    optimizer.load_state_dict(
        {"state": state, "param_groups": optimizer.state_dict()["param_groups"]}
    )
    return header, [CurvePoint(**point) for point in header["curve"]]
