"""``stancekit evaluate``: how well P1 answers with learned envelopes, and how often P2 gets back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.table import Table
from stancekit.planners.outcome import InvalidInput

from .console import emit, out, percent, progress

if TYPE_CHECKING:
    from stancekit.learners.evaluate import Score


@dataclass
class Evaluate:
    """Compare envelopes on a labelled data set: the shares of paper E's Table I, with 95 % intervals.

    P1 feasible / infeasible: share of the feasible / infeasible problems that the relaxation answers right. Each
    projection: share of the feasible problems for which P1 and then P2 end in a verified posture. Use a data set that
    the envelopes were not learned from.
    """

    dataset: Annotated[Path, tyro.conf.Positional]
    """Data set folder of `stancekit label`."""
    envelope: tuple[Path, ...] = ()
    """Envelope files to compare."""
    lift: bool = True
    """Compare with the lift, which needs no envelope."""
    project: tuple[Literal["fix-p", "fix-f", "fix-toes", "scp", "nlp"], ...] = ("fix-p", "fix-f", "fix-toes", "scp")
    """Projections; nlp takes some 30 ms a problem."""
    json: bool = False
    """One JSON object a row."""

    def run(self) -> int:
        """Roll every selector out and print the table."""
        from stancekit.learners.dataset import Dataset
        from stancekit.learners.evaluate import check_same_class, evaluate, evaluate_lift, scenes_of
        from stancekit.learners.selectors.selector import FixedSelector
        from stancekit.planners.files import read_envelopes

        if not self.project:
            raise InvalidInput("--project: expected one or more projections, got none")
        dataset = Dataset.open(self.dataset)
        sets = [(path, read_envelopes(path)) for path in self.envelope]
        for path, envelopes in sets:
            check_same_class(dataset, envelopes.problem_class, str(path))
        scenes = scenes_of(dataset)
        scores = []
        for path, envelopes in sets:
            with progress(f"evaluate {path.stem}") as bar:
                scores.append(
                    evaluate(
                        path.stem, FixedSelector(path.stem, envelopes), scenes, problem_class=dataset.problem_class,
                        projections=self.project, boxes=len(envelopes.envelopes), progress=bar,
                    )
                )  # fmt: skip
        if self.lift:
            with progress("evaluate lift") as bar:
                scores.append(evaluate_lift(scenes, projections=self.project, progress=bar))
        if self.json:
            for score in scores:
                emit(score.to_json())
        else:
            out.print(score_table(dataset.problem_class, scores))
        return 0


def score_table(problem_class: str, scores: list[Score]) -> Table:
    """The comparison as a table, with the paper's rows below."""
    from stancekit.learners.evaluate import TABLE_I

    ways = list(scores[0].projected) if scores else []
    table = Table(title=f"{problem_class} [%]", title_justify="left", header_style="bold")
    for name in ("selector", "P1 feasible", "P1 infeasible", *(f"→ {way}" for way in ways)):
        table.add_column(name, justify="left" if name == "selector" else "right", no_wrap=True)
    for score in scores:
        shares = (score.p1_feasible, score.p1_infeasible, *score.projected.values())
        table.add_row(score.selector, *(percent(share.value, share.interval) for share in shares))
    for index, (name, row) in enumerate(TABLE_I.get(problem_class, {}).items()):
        by_way = {"fix-p": row[2], "nlp": row[3]}
        cells = [percent(row[0]), percent(row[1]), *(percent(by_way.get(way)) for way in ways)]
        if index == 0:
            table.add_section()
        table.add_row(f"paper: {name}", *cells, style="dim")
    return table
