"""What every script of benchmarks/ measures, from its docstring."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def briefs() -> dict[str, tuple[str, bool]]:
    """By script: its docstring's first sentence, and whether it is a command of its own."""
    found = {}
    for path in sorted((ROOT / "benchmarks").glob("[!_]*.py")):
        text = path.read_text(encoding="utf-8")
        brief = (ast.get_docstring(ast.parse(text)) or "").split("\n\n")[0].replace("\n", " ")
        found[path.name] = brief, "__main__" in text
    return found


def table() -> str:
    """A table of them, Markdown."""
    lines = ["| script | what it measures |", "|---|---|"]
    lines += [
        f"| `python benchmarks/{name}` | {brief.replace('|', chr(92) + '|').replace('``', '`')} |"
        for name, (brief, command) in briefs().items()
        if command
    ]
    return "\n".join(lines) + "\n"
