"""Mutants of planners and runner: an operator or a number changed in a copy of the tree, and the
tests that notice.

``python benchmarks/mutants.py --count 60 --seed 0 --out out/mutants`` draws places by seed over all
functions, changes one at a time and runs the test files that name the module, and those of its
folder, until one fails. What survives is listed: either nothing depends on it, or a test is
missing. A mutant on which the tests run too long counts as killed.
"""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _bench import ROOT, Options, Row, kept, launch, tally

SWAPS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Lt: ("<", ">="),
    ast.LtE: ("<=", ">"),
    ast.Gt: (">", "<="),
    ast.GtE: (">=", "<"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
}
"""Operators, and what each becomes."""


@dataclass(frozen=True, kw_only=True)
class Asked(Options):
    """Which mutants, and where what became of each is kept."""

    count: int = 60
    rooms: tuple[str, ...] = ("planners", "runner")
    out: Path = Path("out/mutants")
    longest_s: float = 400.0


@dataclass(frozen=True, kw_only=True)
class Mutant:
    """A file, and the part of its text that becomes another."""

    path: Path
    start: int
    end: int
    new: str

    def of(self, text: str) -> str:
        """The text with the change."""
        return text[: self.start] + self.new + text[self.end :]

    def shown(self, text: str) -> str:
        """Where it is, and the line with the change."""
        number = text.count("\n", 0, self.start)
        return f"{self.path}:{number + 1}: {self.of(text).splitlines()[number].strip()}"


def mutants(tree: Path, path: Path) -> Iterator[Mutant]:
    """Every operator and number in the functions of a file below a tree."""
    text = (tree / path).read_text()
    lines = [0, *(at.end() for at in re.finditer("\n", text))]

    def place(line: int, column: int) -> int:
        return lines[line - 1] + len(text[lines[line - 1] :].encode()[:column].decode())

    def between(left: ast.expr, op: ast.AST, right: ast.expr) -> Iterator[Mutant]:
        start, end = (
            place(left.end_lineno or 0, left.end_col_offset or 0),
            place(right.lineno, right.col_offset),
        )
        old, new = SWAPS.get(type(op), ("", ""))
        found = re.search(re.escape(old), text[start:end]) if old else None
        if found:
            yield Mutant(path=path, start=start + found.start(), end=start + found.end(), new=new)

    for function in ast.walk(ast.parse(text)):
        if not isinstance(function, ast.FunctionDef):
            continue
        for node in (inner for line in function.body for inner in ast.walk(line)):
            if isinstance(node, ast.Compare):
                yield from between(node.left, node.ops[0], node.comparators[0])
            elif isinstance(node, ast.BinOp):
                yield from between(node.left, node.op, node.right)
            elif isinstance(node, ast.BoolOp):
                yield from between(node.values[0], node.op, node.values[1])
            elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
                start, end = (
                    place(node.lineno, node.col_offset),
                    place(node.end_lineno or 0, node.end_col_offset or 0),
                )
                yield Mutant(path=path, start=start, end=end, new=str(2 * node.value + 1))


def tests_of(path: Path) -> list[str]:
    """The test files of a module, the likeliest to notice first: of its name, that name it, of its
    folder.
    """
    dotted = ".".join(("stancekit", *path.with_suffix("").parts)).removesuffix(".__init__")
    near = ROOT / "tests" / path.parent
    ranks = {}
    for test in sorted((ROOT / "tests").rglob("test_*.py")):
        if test.stem == f"test_{path.stem}" and test.parent == near:
            ranks[test] = 0
        elif re.search(rf"{re.escape(dotted)}\b", test.read_text()):
            ranks[test] = 1
        elif near in test.parents:
            ranks[test] = 2
    return [str(test.relative_to(ROOT)) for test in sorted(ranks, key=lambda test: ranks[test])]


def copied(out: Path) -> Path:
    """The tree, where it may be changed."""
    copy = out / "tree"
    shutil.rmtree(copy, ignore_errors=True)
    listed = ["git", "-C", str(ROOT), "ls-files", "-z", "-co", "--exclude-standard"]
    for name in filter(
        None, subprocess.run(listed, capture_output=True, text=True, check=True).stdout.split("\0")
    ):
        if (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name)
    subprocess.run([sys.executable, "setup.py", "--quiet", "links"], cwd=copy, check=True)
    return copy


def fate(mutant: Mutant, copy: Path, longest_s: float) -> Row:
    """What the tests make of it."""
    whole, tests = (copy / mutant.path).read_text(), tests_of(mutant.path)
    command = [
        "env",
        f"PYTHONPATH={copy / '.editable'}",
        sys.executable,
        "-m",
        "pytest",
        "-x",
        "-q",
        "-p",
        "no:xdist",
    ]
    (copy / mutant.path).write_text(mutant.of(whole))
    try:
        done = subprocess.run(
            [*command, *tests], cwd=copy, capture_output=True, text=True, timeout=longest_s
        )
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
        end = "killed" if done.returncode else "survived"
        by = failed[1] if failed else done.stdout[-200:] if done.returncode else ""
    except subprocess.TimeoutExpired:
        end, by = "too long", ""
    finally:
        (copy / mutant.path).write_text(whole)
    return {"end": end, "mutant": mutant.shown(whole), "by": by, "tests": len(tests)}


def main(asked: Asked) -> None:
    """Draw, change, test, list."""
    rng, rows, copy = (
        np.random.default_rng(asked.seed),
        [],
        copied(asked.out.resolve()),
    )  # ROOT may change meanwhile
    files = sorted(path for room in asked.rooms for path in (copy / room).rglob("*.py"))
    every = list(
        dict.fromkeys(mutant for path in files for mutant in mutants(copy, path.relative_to(copy)))
    )
    for index in rng.choice(len(every), asked.count, replace=False):
        mutant = every[index]
        cell = asked.out / f"{asked.seed}-{index}.json"
        rows.append(kept(cell, lambda mutant=mutant: fate(mutant, copy, asked.longest_s)))  # type: ignore[misc]
        asked.say(rows[-1], lambda row: f"{row['end']:9} {row['mutant']}  {row['by']}")
    asked.say({"places": len(every), "mutants": tally(row["end"] for row in rows)})


if __name__ == "__main__":
    launch(main, Asked, __doc__)
