"""Writes docs/equations.md: every numbered equation and algorithm of both papers, and the functions
that say so.

    python docs/equations.py            # write it
    python docs/equations.py --check    # is it up to date, and is anything missing?

A docstring cites an equation of Lin et al. as "E11", one of Pan et al. as "W11", several as
"E2–E4", and algorithms as "Algorithm E1". Nothing else is read: a function that implements an
equation says so where it is read.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "equations.md"
FOLDERS = ("planners", "runner", "views", "envs", "learners")
PAPERS = {
    "E": "Lin, Ahn and Hong, *Designing Multi-Stage Coupled Convex Programming with Data-Driven McCormick Envelope "
    "Relaxations for Motion Planning*, 2021",
    "W": "Pan, Chen, Fang, Bretl, Gao and Wu, *Environment Warped Gait Trajectory Optimization for Complex Terrains*, "
    "2022",
}
EQUATIONS = {
    "E1": "toe on its patch",
    "E2": "toe and centre of mass",
    "E3": "force in contact axes",
    "E4": "position in world axes",
    "E5": "force balance",
    "E6": "moment balance",
    "E7": "moment by components",
    "E8": "m = p f",
    "E9": "moment balance in m",
    "E10": "friction cone",
    "E11": "steps and reach",
    "Algorithm E1": "DataGeneration",
    "Algorithm E2": "EnvelopeFitting",
    "W1": "gait program in the world",
    "W2": "Newton and Euler",
    "W3": "feet and height field",
    "W4": "reach boxes",
    "W5": "friction cone",
    "W6": "energy of the map",
    "W7": "gait program in warped space",
    "W8": "feet at and above z̄ = 0",
    "W9": "friction cone in warped space",
    "W10": "reach boxes, pulled back",
    "W11": "position-based centroidal dynamics",
    "W12": "nearest rotation 𝒫(J)",
    "W13": "torso's rotation, pushed forward",
    "W14": "values one and two steps before",
    "Algorithm W1": "local-global map",
}
CITED = re.compile(
    r"(?<![\w.])(Algorithms? )?([EW])(\d{1,2})(?:–([EW])(\d{1,2}))?(?![\w.]\d)(?!\w)"
)


@dataclass(frozen=True, order=True)
class Tie:
    """A function, class or method whose docstring cites an equation: its file, line, and name in
    the module.
    """

    file: str
    line: int
    name: str

    @property
    def module(self) -> str:
        """What it is imported from."""
        return ".".join(["stancekit", *Path(self.file).with_suffix("").parts]).removesuffix(
            ".__init__"
        )


def cited(text: str) -> Iterator[str]:
    """All equations and algorithms that a text cites, ranges spelt out."""
    for algorithm, paper, first, _, last in CITED.findall(text):
        for number in range(int(first), int(last or first) + 1):
            yield f"{'Algorithm ' if algorithm else ''}{paper}{number}"


def ties() -> dict[str, list[Tie]]:
    """By equation, in the papers' order: what cites it. Raises ValueError for a citation of what
    there is not.
    """
    found: dict[str, list[Tie]] = {name: [] for name in EQUATIONS}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            file = path.relative_to(ROOT).as_posix()
            for tie, text in _docstrings(ast.parse(path.read_text(encoding="utf-8")), file, ()):
                for name in dict.fromkeys(cited(text)):
                    if name not in found:
                        raise ValueError(
                            f"{file}:{tie.line}: {tie.name} cites {name}, which no paper has"
                        )
                    found[name].append(tie)
    return found


def _docstrings(node: ast.AST, file: str, inside: tuple[str, ...]) -> Iterator[tuple[Tie, str]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            names = (*inside, child.name)
            yield Tie(file, child.lineno, ".".join(names)), ast.get_docstring(child) or ""
            if isinstance(child, ast.ClassDef):
                yield from _docstrings(child, file, names)


def page() -> str:
    """The text of docs/equations.md. Raises ValueError for an equation that nothing cites."""
    every = ties()
    untied = [name for name, found in every.items() if not found]
    if untied:
        raise ValueError(
            f"expected a docstring that cites each equation, got none for {', '.join(untied)}"
        )
    lines = [
        "# Equations",
        "",
        "Written by `python docs/equations.py` from docstrings; a test keeps it so.",
        "",
    ]
    for paper, title in PAPERS.items():
        lines += [f"## Paper {paper}", "", f"{title}.", "", "| | | where |", "|---|---|---|"]
        for name, found in every.items():
            if name.removeprefix("Algorithm ")[0] == paper:
                where = ", ".join(f"[{tie.file}:{tie.name}](../{tie.file})" for tie in found)
                lines.append(f"| {name} | {EQUATIONS[name]} | {where} |")
        lines.append("")
    return "\n".join(lines)


def main() -> int:
    """Write the page, or check it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true")
    asked = parser.parse_args()
    try:
        text = page()
    except ValueError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if not asked.check:
        PAGE.write_text(text, encoding="utf-8")
    elif not PAGE.exists() or PAGE.read_text(encoding="utf-8") != text:
        sys.stderr.write(
            f"{PAGE.relative_to(ROOT)}: not up to date; run python docs/equations.py\n"
        )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
