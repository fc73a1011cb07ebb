"""Checks that all environments make alike when they are made and reset, before any work is done."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.files.validation import shown

IGNORED = ("minari_autoseed",)
"""Options of ``reset`` that are for a collector around an environment, which hands them on."""


def checked_render_mode(mode: Any, metadata: Mapping[str, Any]) -> str | None:
    """Return a render mode that the metadata of an environment has, or None.

    Raises InvalidInput.
    """
    modes = metadata["render_modes"]
    if mode is not None and mode not in modes:
        raise InvalidInput(f"render_mode: expected one of {modes}, got {shown(mode)}")
    return None if mode is None else str(mode)


def checked_seed(seed: Any) -> int | None:
    """Return the seed of ``reset`` as an int of 0 or more, or None.

    Raises InvalidInput.
    """
    return None if seed is None else checked_int(seed, "seed")


def check_options(options: Any, known: Collection[str] = ()) -> None:
    """Raise InvalidInput for options of ``reset`` that an environment does not have."""
    if options is not None and not isinstance(options, Mapping):
        raise InvalidInput(f"options: expected a mapping or None, got {shown(options)}")
    strange = [name for name in options or () if name not in known and name not in IGNORED]
    if strange:
        wanted = f"one of {', '.join(known)}" if known else "none"
        raise InvalidInput(f"options: expected {wanted}, got {', '.join(map(str, strange))}")


def checked_mask(mask: Any, count: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return a ``reset_mask`` of Gymnasium: which of ``count`` sub-environments are reset, one at
    least.

    Raises InvalidInput for anything but truth values, shape (count,), of which one is true.
    """
    array = np.asarray(mask)
    if array.shape != (count,) or array.dtype != np.bool_ or not array.any():
        wanted = f"an array of truth values, shape ({count},), one or more of them true"
        raise InvalidInput(f"options: reset_mask: expected {wanted}, got {shown(mask)}")
    return array
