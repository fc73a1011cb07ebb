"""Writes the pages that follow from the code, before the others are read: keys, environments,
commands, scripts.
"""

from __future__ import annotations

from pathlib import Path

import commands
import environments
import keys
import scripts
from sphinx.application import Sphinx


def write(app: Sphinx) -> None:
    """All of them, each only where it changes, so that an unchanged page is not built again."""
    source = Path(app.srcdir)
    for name in environments.names():
        _put(source / "environments" / f"{environments.short(name)}.md", environments.page(name))
        picture = source / "environments" / f"{environments.short(name)}.png"
        if environments.short(name) in environments.PICTURE and not picture.exists():
            environments.draw(name, picture)
    _put(source / "reference" / "keys.md", keys.page())
    _put(source / "reference" / "command.md", commands.page())
    _put(source / "reference" / "scripts.inc", scripts.table())


def _put(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def list_decisions(app: Sphinx, page: str, text: list[str]) -> None:
    """The records, which their list names in a table, for the pages' own lists."""
    if page == "decisions/README":
        text[0] += "\n```{toctree}\n:hidden:\n:glob:\n0*\n```\n"


def setup(app: Sphinx) -> dict[str, bool]:
    """Hook it in."""
    app.connect("builder-inited", write)
    app.connect("source-read", list_decisions)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
