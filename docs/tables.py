"""Tables of the pages that a command prints, and the commands that others have their figures from.

    python docs/tables.py [PAGE.md …]     # writes the tables anew that a command prints

``<!-- table: COMMAND -->`` stands above a table that is what the command prints, line for line;
``<!-- figures: COMMAND -->`` above one whose figures are the command's and whose layout is not:
beside figures of a paper, of several runs, or of runs that take hours.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
MARK = re.compile(r"^<!-- (table|figures): (.+) -->\n((?:\|.*\n)*)", re.MULTILINE)
"""A mark, its kind, its command, and the table under it."""


def printed(command: str) -> str:
    """The table that a command prints."""
    words = shlex.split(command)
    start = (
        [sys.executable] if words[0] == "python" else [sys.executable, "-m", "stancekit.cli.main"]
    )
    done = subprocess.run(
        [*start, *words[1:]],
        cwd=DOCS.parent,
        env=os.environ | {"COLUMNS": "1000"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return "".join(line for line in done.stdout.splitlines(True) if line.startswith("|"))


def written(page: Path) -> str:
    """A page with its printed tables made anew."""

    def anew(mark: re.Match[str]) -> str:
        kind, command, _ = mark.groups()
        if kind == "figures":
            return mark[0]
        return f"<!-- table: {command} -->\n{printed(command)}"

    return MARK.sub(anew, page.read_text(encoding="utf-8"))


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:] or sorted(DOCS.rglob("*.md"))):
        if "<!-- table: " in path.read_text(encoding="utf-8"):
            path.write_text(written(path), encoding="utf-8")
            print(path)
