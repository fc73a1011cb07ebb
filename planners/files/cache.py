"""Cache folder for measurements."""

from __future__ import annotations

import os
from pathlib import Path

FOLDER = "STANCEKIT_CACHE"


def cache_folder() -> Path:
    """Folder of measured workspaces and thinned meshes: $STANCEKIT_CACHE, or the user's folder for
    caches.
    """
    folder, users = os.environ.get(FOLDER), os.environ.get("XDG_CACHE_HOME")
    return (
        Path(folder) if folder else (Path(users) if users else Path.home() / ".cache") / "stancekit"
    )
