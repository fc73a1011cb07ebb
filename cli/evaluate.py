"""``stancekit evaluate``: how well P1 answers with learned envelopes, and how often P2 gets
back.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text

from stancekit.planners.errors import InvalidInput

from .console import emit, out, progress
from .options import PROJECTION, ROBOT, TERRAIN, OptionalPath, OptionalText, check_drawn, named

if TYPE_CHECKING:
    from stancekit import EnvelopeSet, Learned
    from stancekit.learners.evaluation.evaluate import Score, Share

_LONGEST_NAME = 16
"""Letters of a selector's name before a table breaks it."""
_PROJECTED = ("fix-p", "lift-fix-p", "fix-toes", "scp")


@dataclass
class Evaluate:
    """Compare selectors on a labelled data set: the shares of Lin et al.'s Table I, with 95 %
    intervals.

    P1 feasible / infeasible: share of the feasible / infeasible problems that the relaxation
    answers right. Each projection: share of the feasible problems for which P1 and then P2 end in a
    verified posture. Rows that a selector was trained or calibrated on are refused.
    """

    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """Data set folder of `stancekit label`."""
    part: Literal["all", "train", "test", "calibration"] = "all"
    """Part of the rows: all, or a part of the split by hash that `fit --part` knows, too."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot that the data set must be of; one of another is refused."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Terrain's file that the data set must be of."""
    envelopes: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE ...")] = ()
    """Envelope files to compare."""
    selector: Annotated[
        tuple[str, ...],
        named("stancekit.learners.selectors.selector:SELECTORS", "FILE|NAME|FILE.py:NAME"),
    ] = ()
    """Selectors to compare: files of envelopes, neural selectors, policies; names of
    those that ship, as neural-wall-3; or your own."""
    lift: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = True
    """Leave out the lift, which needs no envelope and is compared with the others unless told
    so."""
    projection: Annotated[tuple[str, ...], PROJECTION] = _PROJECTED
    """Projections; nlp takes some 30 ms a problem."""
    workers: int = 1
    """Processes. Times of P1 are honest with as many as there are idle cores."""
    executor: Literal["processes", "ray"] = "processes"
    """Where to work: on this machine, or on a Ray cluster."""
    address: OptionalText = None
    """Ray cluster: host:port of its head, auto, or local."""
    json: bool = False
    """One JSON object a row."""
    markdown: bool = False
    """The table in Markdown, with intervals and the paper's rows."""
    picture: Annotated[OptionalPath, tyro.conf.arg(metavar="FILE")] = None
    """Picture to write, .png, .pdf or .svg: the shares with their 95 % intervals."""

    def run(self) -> int:
        """Roll every selector out and print the table."""
        from stancekit.planners.projection.project import PROJECTIONS
        from stancekit.postures import read_envelopes
        from stancekit.selectors import (
            LIFT,
            Comparison,
            evaluate,
            executor,
            rows_of,
            selector_for,
        )

        check_drawn(self.picture)
        if not self.projection:
            raise InvalidInput("--projection: expected one or more projections, got none")
        for name in self.projection:
            PROJECTIONS.get(name)
        if not (self.envelopes or self.selector or self.lift):
            raise InvalidInput(
                "--envelopes, --selector: expected one or more files to compare, or the lift, got "
                "none"
            )
        rows = rows_of(self.dataset, self.part, self.robot, self.terrain)
        selectors: list[tuple[str, EnvelopeSet | str]] = [
            (str(path), read_envelopes(path)) for path in self.envelopes
        ]
        selectors += [(name, name) for name in self.selector]
        compared: list[tuple[str, Learned | str]] = [
            (
                Path(where).stem if ".py:" not in where else where.rpartition(":")[2],
                selector_for(rows, selector, where),
            )
            for where, selector in selectors
        ]
        compared += [(LIFT, LIFT)] if self.lift else []
        workers, scores = executor(self.executor, workers=self.workers, address=self.address), []
        for name, learned in compared:
            with progress(f"evaluate {name}") as bar:
                scores.append(
                    evaluate(
                        learned,
                        rows,
                        projections=self.projection,
                        name=name,
                        workers=workers,
                        progress=bar,
                    )
                )
        comparison = Comparison(problem_class=rows.problem_class, scores=tuple(scores))
        if self.picture is not None:
            from stancekit.views.sheet import save

            save(comparison.picture(), self.picture)
        if self.markdown:
            out.print(comparison.markdown(), soft_wrap=True, markup=False)
        elif self.json:
            for score in scores:
                emit(score.to_json())
        else:
            out.print(score_table(rows.problem_class, scores))
        return 0


def score_table(problem_class: str, scores: list[Score]) -> Table:
    """The comparison as a table that fits into 80 columns, with the paper's rows below."""
    from stancekit.learners.evaluation.evaluate import TABLE_I, title_of

    ways = list(scores[0].projected) if scores else []
    counts = (
        f"{scores[0].p1_feasible.of} feasible and {scores[0].p1_infeasible.of} infeasible"
        if scores
        else "no"
    )
    title = f"{title_of(problem_class)}: % of {counts} postures\n± half the 95 % interval"
    table = Table(
        title=title,
        title_justify="left",
        header_style="bold",
        box=None,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    table.add_column("selector", overflow="fold", max_width=_LONGEST_NAME)
    for name in ("P1\nfeasible", "P1\ninfeas.", *(f"P2\n{way}" for way in ways)):
        table.add_column(name, no_wrap=True)
    for score in scores:
        shares = (score.p1_feasible, score.p1_infeasible, *score.projected.values())
        table.add_row(Text(score.selector), *(_percent(share) for share in shares))
    for name, row in TABLE_I.get(problem_class, {}).items():
        by_way = {"fix-p": row[2], "nlp": row[3]}
        figures = (row[0], row[1], *(by_way.get(way) for way in ways))
        table.add_row(
            f"paper: {name}",
            *("    –" if x is None else f"{100.0 * x:5.1f}" for x in figures),
            style="dim",
        )
    table.width = (
        Console(width=1000).measure(table).maximum
    )  # a narrow terminal may break lines, but nothing is lost
    return table


def _percent(share: Share) -> str:
    if not share.of:
        return "    –"
    low, high = share.interval
    return f"{100.0 * share.value:5.1f}±{50.0 * (high - low):.0f}"
