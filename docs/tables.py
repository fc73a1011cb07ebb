"""Tables of the pages that a command prints, and the commands that others have their figures from.

    python docs/tables.py [PAGE.md …]     # writes the tables anew that a command prints

``<!-- table: COMMAND -->`` stands above a table that is what the command prints, line for line, of
cards or of the rows that a run kept (``--kept docs/results/NAME.jsonl``, which a command whose file
is missing makes anew); ``<!-- figures: COMMAND -->`` above one whose figures are the command's and
whose layout is not: of several runs, or of runs that take hours.
"""

from __future__ import annotations

import io
import re
import runpy
import shlex
import sys
from contextlib import chdir, redirect_stdout
from pathlib import Path

DOCS = Path(__file__).resolve().parent
MARK = re.compile(r"^<!-- (table|figures): (.+) -->\n((?:\|.*\n)*)", re.MULTILINE)
"""A mark, its kind, its command, and the table under it."""


def printed(command: str) -> str:
    """The table that a script of benchmarks prints with these options, in this process."""
    box, before, words = io.StringIO(), (sys.argv, sys.path), shlex.split(command)
    sys.argv, sys.path = words[1:], [str(DOCS.parent / "benchmarks"), *sys.path]
    try:
        with chdir(DOCS.parent), redirect_stdout(box):
            runpy.run_path(words[1], run_name="__main__")
    finally:
        sys.argv, sys.path = before
    return "".join(line for line in box.getvalue().splitlines(True) if line.startswith("|"))


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
