"""Data sets that ship with the package, by name: small pools to draw scenes from without labelling
any.
"""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path

from stancekit.planners.errors import InvalidInput


def pools() -> dict[str, Path]:
    """The folder of each data set that ships, by its name, pool-CLASS."""
    folder = Path(str(resources.files("stancekit.envs.pools")))
    return {path.parent.name: path.parent for path in sorted(folder.glob("pool-*/header.json"))}


def folder_of(path: str | Path) -> Path:
    """This folder; that of a data set that ships where there is none of this name."""
    folder = Path(path)
    return folder if os.path.exists(folder) else pools().get(str(path), folder)


def check_there(path: str | Path) -> None:
    """Raise InvalidInput where there is neither a file nor a data set of this name."""
    if not os.path.exists(folder_of(path)):
        raise InvalidInput(f"{path}: expected a plan, proof, gait or data set, found nothing there")
