"""The directive ``tied``: below an equation, every function whose docstring cites it, with its
code.

    ```{tied} E5
    ```

What is found is what docs/equations.py finds, so that a page cannot say that a function implements
an equation of which the function does not know.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from html import escape

import equations
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

MOST_LINES = 70
"""Of a function or class that are shown; what is longer ends in a line that says where to read
on."""


@cache
def ties() -> dict[str, list[equations.Tie]]:
    """By equation: what cites it."""
    return equations.ties()


@cache
def _functions(file: str) -> dict[int, tuple[ast.AST, str]]:
    text = (equations.ROOT / file).read_text(encoding="utf-8")
    lines = text.splitlines()
    return {
        node.lineno: (
            node,
            "\n".join(
                lines[
                    min([node.lineno, *(d.lineno for d in node.decorator_list)])
                    - 1 : node.end_lineno
                ]
            ),
        )
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
    }


def code_of(tie: equations.Tie) -> tuple[str, str]:
    """The first sentence of its docstring, and its text, without the indentation and cut where it
    is long.
    """
    node, text = _functions(tie.file)[tie.line]
    brief = (ast.get_docstring(node) or "").split("\n\n")[0].replace("\n", " ")  # type: ignore[arg-type]
    lines = text.splitlines()
    indent = len(lines[0]) - len(lines[0].lstrip())
    lines = [line[indent:] if line[:indent].isspace() or not line else line for line in lines]
    if len(lines) > MOST_LINES:
        lines = [*lines[:MOST_LINES], f"# … {tie.file} goes on"]
    return brief, "\n".join(lines)


class Tied(SphinxDirective):
    """Functions of an equation, each folded away under its name and what it says of itself."""

    required_arguments = 1
    optional_arguments = 10

    def run(self) -> list[nodes.Node]:
        """The nodes; an equation that nothing cites is an error."""
        found: dict[equations.Tie, None] = {}
        for name in " ".join(self.arguments).split(","):
            if name.strip() not in ties():
                raise self.error(f"expected an equation of docs/equations.py, got {name.strip()}")
            found |= dict.fromkeys(ties()[name.strip()])
        return list(self._nodes(list(found)))

    def _nodes(self, found: list[equations.Tie]) -> Iterator[nodes.Node]:
        for tie in found:
            self.env.note_dependency(str(equations.ROOT / tie.file))
            brief, code = code_of(tie)
            title = f"<code>{escape(tie.module.removeprefix('stancekit.'))}.{escape(tie.name)}</code> {escape(brief)}"
            block = nodes.literal_block(code, code, language="python")
            yield nodes.raw("", f'<details class="tied"><summary>{title}</summary>', format="html")
            yield block
            yield nodes.raw("", "</details>", format="html")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("tied", Tied)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
