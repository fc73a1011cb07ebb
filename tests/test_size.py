"""How much there is to read may only fall.

HELD are the statements and syntax nodes of each folder of the package as they are. Statements may
move between folders; the package's total may rise only by what is drawn from ALLOWANCES, which are
named after pieces of work. Whoever deletes lowers HELD in the same commit, and
``python tests/test_size.py`` writes it:

    python tests/test_size.py                 after statements went or moved
    python tests/test_size.py --draw proofs   after statements were added for the proofs

Allowances that are not used up when their work is done are set to 0.
"""

from __future__ import annotations

import argparse
import ast
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
HERE = "tests/test_size.py"
PACKAGE = ("api", "cli", "configs", "envs", "learners", "planners", "runner", "views")
Size = tuple[int, int]
"""Statements that are no docstrings, and syntax nodes below them."""

HELD: dict[str, Size] = {
    "api": (1289, 15719),
    "cli": (2919, 35503),
    "configs": (3, 30),
    "envs": (2947, 41030),
    "learners": (4616, 68379),
    "planners": (34793, 577251),
    "runner": (6416, 88526),
    "views": (3970, 64275),
}
CAPS: dict[str, int] = {"tests": 41_670, "benchmarks": 13_250}
"""Most statements of what is no package, which only fall, too."""
ALLOWANCES: dict[str, int] = {
    "proofs": 0,
    "soles": 0,
    "slopes and doors": 0,
    "MJCF": 0,
    "training": 0,
    "promises": 0,
    "worlds": 0,
    "formats": 0,
    "stepping over": 0,
    "sequences": 0,
    "pictures": 0,
    "speed": 0,
    "margins": 0,
}
"""Statements by which the package may still rise, per piece of work."""
NODES = 26
"""Syntax nodes that come with a statement of an allowance: dense array code, the package has 14.5."""


@cache
def size(source: str) -> Size:
    """Statements without docstrings, and nodes below them, of a file."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = list(ast.walk(ast.parse(source)))
    docstrings = sum(
        isinstance(node, documented) and ast.get_docstring(node, clean=False) is not None
        for node in nodes
    )
    return sum(isinstance(node, ast.stmt) for node in nodes) - docstrings, len(nodes) - docstrings


def sizes(root: Path, folders: tuple[str, ...]) -> dict[str, Size]:
    """The size of each folder's Python files: those that git would keep, or all without git."""
    return {
        folder: (sum(one for one, _ in counted), sum(two for _, two in counted))
        for folder in folders
        for counted in [[size(path.read_text("utf-8")) for path in files(root, folder)]]
    }


def files(root: Path, folder: str) -> list[Path]:
    """The Python files of a folder."""
    command = ["git", "-C", str(root), "ls-files", "-z", "-co", "--exclude-standard", "--", folder]
    if (root / ".git").exists() and shutil.which("git"):
        listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        found = {root / name for name in listed.split("\0") if name.endswith(".py")}
        return sorted(path for path in found if path.is_file())
    return sorted(path for path in (root / folder).rglob("*.py") if "__pycache__" not in path.parts)


def risen(now: dict[str, Size], held: dict[str, Size]) -> list[str]:
    """By how much the package rose above what is held, and where; empty where it did not."""
    said = []
    for which, name in enumerate(("statements", "syntax nodes")):
        most, total = (sum(each[which] for each in table.values()) for table in (held, now))
        if total > most:
            more = {f: now[f][which] - held.get(f, (0, 0))[which] for f in now}
            where = ", ".join(f"{folder} {d:+}" for folder, d in more.items() if d)
            said.append(f"{name}: expected {most} at most, got {total} ({total - most:+}): {where}")
    return said


def ceiling(source: str) -> int:
    """What a version of this file lets the package become: what it holds and what may be drawn."""
    values = {
        node.target.id: ast.literal_eval(node.value)
        for node in ast.parse(source).body
        if isinstance(node, ast.AnnAssign)
        and isinstance(node.target, ast.Name)
        and node.target.id in ("HELD", "ALLOWANCES")
        and node.value is not None
    }
    held = sum(statements for statements, _ in values["HELD"].values())
    return held + sum(values["ALLOWANCES"].values())


def parents(root: Path) -> list[str]:
    """This file as it was in the commits below the working tree: HEAD, and those before HEAD."""
    if not (root / ".git").exists() or shutil.which("git") is None:
        return []

    def git(*words: str) -> str:
        command = ["git", "-C", str(root), *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return done.stdout if done.returncode == 0 else ""

    commits = git("rev-list", "--parents", "--max-count=1", "HEAD").split()
    return [text for commit in commits if (text := git("show", f"{commit}:{HERE}"))]


def test_the_package_is_no_larger_than_what_is_held() -> None:
    now = sizes(ROOT, PACKAGE)
    assert min(statements for statements, _ in now.values()) > 0 or now["configs"] == (0, 0)
    said = risen(now, HELD)
    assert not said, f"the package rose: {'; '.join(said)}; delete as much, or draw: {HERE} --draw"


def test_what_fell_is_held() -> None:
    statements = {folder: each[0] for folder, each in sizes(ROOT, PACKAGE).items()}
    held = {folder: each[0] for folder, each in HELD.items()}
    assert statements == held, f"statements fell or moved: python {HERE} writes what they are"


def test_tests_and_benchmarks_keep_below_their_caps() -> None:
    now = {folder: each[0] for folder, each in sizes(ROOT, tuple(CAPS)).items()}
    assert {folder: count for folder, count in now.items() if count > CAPS[folder]} == {}
    assert min(now.values()) > 1000


def test_no_commit_raises_what_the_package_may_become() -> None:
    now = ceiling((ROOT / HERE).read_text("utf-8"))
    raised = [before for text in parents(ROOT) if now > (before := ceiling(text))]
    assert raised == [], f"HELD and ALLOWANCES: expected {min(raised)} together at most, got {now}"


def test_statements_that_are_added_are_seen_where_they_are() -> None:
    held = {"cli": (100, 1000), "views": (50, 500)}
    assert risen({"cli": (90, 900), "views": (60, 600)}, held) == []
    (said,) = risen({"cli": (95, 900), "views": (65, 600)}, held)
    assert "expected 150 at most, got 160 (+10): cli -5, views +15" in said
    (said,) = risen({"cli": (100, 1003), "views": (50, 500)}, held)
    assert said.startswith("syntax nodes")
    assert "(+3): cli +3" in said


@pytest.mark.parametrize(
    ("source", "statements"),
    [('"""Words."""\n', 0), ("x = 1\ny: int = 2\n", 2), ('def f():\n    """A."""\n    "b"\n', 2)],
)
def test_docstrings_are_no_statements(source: str, statements: int) -> None:
    assert size(source)[0] == statements


def write(draw: str | None) -> str | None:
    """Write HELD as the package is, drawing what it rose from an allowance; what forbids it."""
    now = sizes(ROOT, PACKAGE)
    path = ROOT / HERE
    text = path.read_text("utf-8")
    more = sum(each[0] for each in now.values()) - sum(each[0] for each in HELD.values())
    nodes = sum(each[1] for each in now.values()) - sum(each[1] for each in HELD.values())
    needed = max(more, -(-nodes // NODES), 0)
    if needed:
        left = ALLOWANCES.get(draw or "", 0)
        if draw not in ALLOWANCES or needed > left:
            return (
                f"--draw: expected an allowance of {needed} statements or more, got {draw} ({left})"
            )
        text = text.replace(f'    "{draw}": {left},', f'    "{draw}": {left - needed},')
    rows = "".join(f'    "{folder}": {each},\n' for folder, each in now.items())
    table = f"HELD: dict[str, Size] = {{\n{rows}}}"
    path.write_text(re.sub(r"(?ms)^HELD: dict\[str, Size\] = \{.*?\}$", table, text, count=1))
    return None


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draw", metavar="ALLOWANCE", help="the piece of work that needed more")
    sys.exit(write(parser.parse_args().draw))
