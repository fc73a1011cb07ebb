"""Arrays inside a JSON file: a NumPy archive (.npz) as base64, so that one file has all and is
replaced at once.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput


def embedded(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Arrays by name as the text of a compressed archive; equal arrays give equal texts."""
    content = io.BytesIO()
    np.savez_compressed(content, **dict[str, Any](arrays))
    return base64.b64encode(content.getvalue()).decode("ascii")


def extracted(text: str, where: str) -> bytes:
    """The archive that ``embedded`` made a text of.

    Raises InvalidInput for a text that is no base64.
    """
    try:
        return base64.b64decode(text, validate=True)
    except ValueError as error:
        raise InvalidInput(f"{where}: expected base64 text: {error}") from None
