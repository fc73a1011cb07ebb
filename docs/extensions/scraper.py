"""Pictures and films that an example wrote, put below the block that wrote them."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst

FILMS = Path(__file__).resolve().parents[1] / "_build" / "films"
"""Copied with the theme's own files."""
FILM = """
.. raw:: html

    <video controls loop muted width="100%" src="../_static/{name}"></video>

"""


class _Written:
    """Collects what examples write into the folder that they run in: every picture and film once,
    in their order.
    """

    def __init__(self) -> None:
        self._seen: set[tuple[str, int]] = set()

    def __repr__(self) -> str:
        return "Written"

    def __call__(
        self, block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any], **_: Any
    ) -> str:
        """Copy new pictures to the names that the gallery has for them; reStructuredText that shows
        all that is new.
        """
        folder = Path(block_vars["src_file"]).parent
        kept, films = [], ""
        for path in sorted(
            [*folder.glob("*.png"), *folder.glob("*.mp4")], key=lambda path: path.stat().st_mtime_ns
        ):
            sign = (path.name, path.stat().st_mtime_ns)
            if sign in self._seen:
                continue
            self._seen.add(sign)
            if path.suffix == ".mp4":
                shutil.copy(path, FILMS / path.name)
                films += FILM.format(name=path.name)
            else:
                kept.append(str(shutil.copy(path, next(block_vars["image_path_iterator"]))))
        return (figure_rst(kept, gallery_conf["src_dir"]) if kept else "") + films


written = _Written()
"""What the gallery's settings name."""
