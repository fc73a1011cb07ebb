"""Table of an outcome of ``stancekit plan``: one row, one reason."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from stancekit.planners.answer.answer import Answer
    from stancekit.planners.answer.plan import Plan
    from stancekit.planners.problem import Problem


def table_of(course: Problem, outcome: Answer[Plan]) -> Table:
    """One row: what was planned, how, and what came of it."""
    table = Table(box=None, header_style="bold")
    for name in ("course", "planner", "frames", "status", "objective", "bound", "compile", "solve"):
        left = name in ("course", "planner", "status")
        table.add_column(
            name, justify="left" if left else "right", overflow="fold", no_wrap=name != "course"
        )
    colour = {"feasible": "green", "infeasible": "red", "undecided": "yellow"}[outcome.status.value]
    table.add_row(
        course.name,
        outcome.method,
        str(course.frames),
        Text(outcome.status.value, style=colour),
        number(outcome.objective),
        number(outcome.bound),
        f"{outcome.effort.compile_s:.2f} s",
        f"{outcome.effort.seconds:.3f} s",
    )
    return table


def message_of(outcome: Answer[Plan]) -> str:
    """The planner's message; of a course that is refuted, the reason that the proof gives, and the
    sets it is over.
    """
    if outcome.certificate is None or outcome.problem is None:
        return outcome.message
    from stancekit.planners.verify import explain

    message = explain(outcome.certificate).message
    return (
        message
        if outcome.sets is None
        else f"{message}; proved over the {outcome.sets} sets of its legs"
    )


def row(numbers: Sequence[int]) -> str:
    """Whole numbers with spaces between them."""
    return " ".join(str(number) for number in numbers)


def number(value: float) -> str:
    """Four digits, or a dash."""
    return f"{value:.4g}" if math.isfinite(value) else "–"
