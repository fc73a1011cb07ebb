"""Files of tensors: safetensors with a JSON header. Nothing in them is ever run or unpickled."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import open_file, parse_json
from stancekit.planners.files.writing import write_bytes

KEY = "stancekit"
"""The one key of a file's metadata, which holds the JSON header with its ``format``; several have
no fixed order."""


MOST_BYTES = 512_000_000
DTYPES = (torch.float16, torch.float32, torch.float64, torch.int64)


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
    write_bytes(path, save(plain, {KEY: json.dumps({**header, "format": kind}, sort_keys=True)}))


def read_tensors(path: str | Path, kind: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Return (header, tensors), those of half precision in single precision.

    Raises InvalidInput for what is missing, truncated, foreign or not finite.
    """
    path = Path(path)
    with open_file(path) as stream:
        size = os.fstat(stream.fileno()).st_size
    if size > MOST_BYTES:
        raise InvalidInput(f"{path}: expected a file of {MOST_BYTES} bytes or fewer, got {size}")
    try:
        with safe_open(path, framework="pt") as file:
            header = parse_json((file.metadata() or {}).get(KEY, "null"), "header")
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
        if tensor.dtype not in DTYPES:
            raise InvalidInput(
                f"{path}: tensor {name}: expected half, single or double precision, got "
                f"{tensor.dtype}"
            )
        if not bool(torch.isfinite(tensor).all()):
            raise InvalidInput(f"{path}: tensor {name}: expected finite numbers, got others")
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
    shapes = {name: tuple(value.shape) for name, value in tensors.items()}
    if wanted != shapes:
        odd = sorted(name for name in wanted | shapes if wanted.get(name) != shapes.get(name))[0]
        raise InvalidInput(
            f"{path}: tensor {odd}: expected shape {wanted.get(odd)}, got {shapes.get(odd)}"
        )
    if any(value.is_meta for value in network.state_dict().values()):
        network.to_empty(device="cpu")
    network.load_state_dict(tensors)
