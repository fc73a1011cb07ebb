"""``stancekit fit`` and ``evaluate``: selectors learned from a data set, how well P1 answers with
their envelopes, and how often P2 gets back.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text

from stancekit.planners.errors import InvalidInput

from .console import as_options, draw_to_file, emit, out, progress, tell
from .options import (
    PROJECTION,
    ROBOT,
    TERRAIN,
    OptionalPath,
    OptionalText,
    check_drawn,
    check_out,
    check_unused,
    named,
)

if TYPE_CHECKING:
    from stancekit import EnvelopeSet, Learned
    from stancekit.learners.data.executors import Executor
    from stancekit.learners.evaluation.evaluate import Score, Share


_LEAP_SCORES = ("additive", "set")
"""Methods that learn from tries of leaps."""
_SURROGATE = "surrogate"
"""The method that learns feasibility itself."""
_SETTINGS = ("share", "clusters", "threshold", "boxes", "steps", "time_limit_s", "seed")
"""Settings of methods that are options here."""


@dataclass
class Fit:
    """Learn a selector of envelopes from a labelled data set and write it to a file.

    METHOD is one of

      heuristic      the expert's bounds of Lin et al.
      quantile       the box that leaves a share of the solutions out on each side
      gmm-printed    Lin et al.'s Algorithm 2 line by line
      gmm            Algorithm 2 with its boundary fitted by P1's own margins
      ga             Lin et al.'s genetic algorithm
      gradient       boxes that descend P1's margins together
      neural         a network from terrain to box
      joint          one to box and point, for P1 joined with the lift
      modes          a box per terrain, between which `stancekit plan --envelopes` switches
      surrogate      feasibility itself, for `stancekit map`, `label --screen` and `screen`
      additive, set  scores of candidates for `stancekit plan --policy`, of leaps' labelled tries
    """

    dataset: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER [FOLDER …]")
    ]
    """Data set folder of `stancekit label`; for modes one per terrain, in the order in which z counts
    them; for surrogate one or more of one class."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """File to write: JSON for envelopes, safetensors for what has a network."""
    part: Literal["all", "train", "test", "calibration"] = "all"
    """Part of the rows: all, or a part of the split by hash; what is fitted to "train" can be
    evaluated on "test"."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot that the data set must be of; one of another is refused."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Terrain's file that the data set must be of."""
    method: Annotated[str, named("stancekit.learners.training.fitting:METHODS")] = "gmm"
    """How to learn."""
    share: float = 0.05
    """Share of the solutions outside a quantile box, on each side of each dimension."""
    clusters: int = 1
    """Envelopes to learn (n of Algorithm 2)."""
    boxes: int = 1
    """Envelopes of gradient."""
    threshold: float = 0.05
    """Least membership probability of a kept solution (p_th of Algorithm 2)."""
    steps: int = 80
    """Steps of the margin descent: more is better and slower."""
    time_limit_s: float = 12.0
    """Limit of the printed boundary program, per cluster [s]."""
    seed: int = 0
    """Seed of mixture and descent."""
    config: OptionalPath = None
    """YAML file with the settings of ga and neural, each under its name (ga: genetic), or with
    those of surrogate, additive and set."""
    calibration: OptionalPath = None
    """Data set folder to calibrate neural and joint on; without it a part of the data set is kept
    for that. Of surrogate: further rows to calibrate on."""
    checkpoint: OptionalPath = None
    """File by which a method that takes long goes on where it was stopped: all but heuristic,
    quantile, modes and both of gmm."""
    workers: int = 1
    """Processes of ga, which tests a generation on all of them; the result does not depend on
    them."""
    executor: Literal["processes", "ray"] = "processes"
    """Where ga tests a generation: on this machine, or on a Ray cluster."""
    address: OptionalText = None
    """Ray cluster: host:port of its head, auto, or local."""
    json: bool = False
    """Print the result as one JSON object."""

    def run(self) -> int:
        """Fit and write."""
        from stancekit import Modes
        from stancekit.selectors import FURTHER, executor, fit, rows_of, settings_of

        check_out(self.out)
        if not self.dataset:
            raise InvalidInput("FOLDER: expected a data set folder, got none")
        scores = self.method in _LEAP_SCORES
        if scores and len(self.dataset) > 1:
            raise InvalidInput(
                f"FOLDER: expected one folder of tries with {self.method}, got {len(self.dataset)}"
            )
        spread = self.method in FURTHER["workers"]
        unused = (() if spread else ("executor", "address")) + (
            ("robot", "terrain") if scores else ()
        )
        check_unused(self, unused, f"--method {self.method}")
        workers: Executor | int = self.workers
        if spread:
            with as_options():
                workers = executor(self.executor, workers=self.workers, address=self.address)
        with as_options(*_SETTINGS):
            given = {name: getattr(self, name) for name in _SETTINGS}
            settings = settings_of(self.method, given, self.config)
        rows: Any = self.dataset[0]
        if scores:
            settings = {"part": self.part, **settings}
        else:
            rows = [rows_of(each, self.part, self.robot, self.terrain) for each in self.dataset]
        with as_options(*FURTHER), progress(f"fit {self.method}") as bar:
            learned: Any = fit(
                rows,
                self.method,
                calibration=self.calibration,
                checkpoint=self.checkpoint,
                workers=workers,
                progress=bar,
                **settings,
            )
        if scores:
            return self._scores(learned)
        if self.method == _SURROGATE:
            return self._surrogate(learned)
        if isinstance(learned, Modes):
            from stancekit import save

            save(learned, self.out)
            return self._said(learned.boxes.problem_class, "modes", learned.boxes)
        learned.write(self.out)
        try:
            fixed = learned.envelopes
        except InvalidInput:  # a network chooses them by the scene
            fixed = None
        return self._said(learned.problem_class, "envelopes", fixed)

    def _scores(self, scorer: Any) -> int:
        """Write the scores of leaps' candidates."""
        scorer.write(self.out)
        origin = scorer.origin
        tell(
            self.json,
            {"out": str(self.out), "method": self.method, "origin": origin},
            f"{self.out}: scores for {origin['class']} from {origin['rows']} tries",
        )
        return 0

    def _surrogate(self, surrogate: Any) -> int:
        """Write a surrogate of feasibility."""
        surrogate.save(self.out)
        problems, error, card = (
            surrogate.problem_class,
            surrogate.least_error,
            surrogate.provenance,
        )
        learned, calibrated = (
            ", ".join(f"{count} {kind}" for kind, count in card[name].items() if count)
            for name in ("learned_from", "calibrated_on")
        )
        record = {"out": str(self.out), "method": self.method, "problem_class": problems}
        tell(
            self.json,
            record | {"least_error": error, "card": card},
            f"{self.out}: a surrogate for {problems}, from {learned} rows",
            f"  calibrated on {calibrated} others: errors of {100 * error:.2g} % and more can be "
            "stated of one answer at least",
        )
        return 0

    def _said(self, problem_class: str, what: str, fitted: EnvelopeSet | None) -> int:
        """Say what was written: boxes, or a network."""
        record: dict[str, Any] = {
            "out": str(self.out),
            "method": self.method,
            "problem_class": problem_class,
        }
        line = f"{self.out}: a network for {problem_class}"
        if fitted is not None:
            widths = [float((envelope.high - envelope.low).mean()) for envelope in fitted.envelopes]
            record |= {
                what: len(widths),
                "mean_width": widths,
                "provenance": dict(fitted.provenance),
            }
            shown = ", ".join(f"{width:.3f}" for width in widths)
            line = (
                f"{self.out}: {len(widths)} {what[:-1]}(s) for {problem_class}, mean width {shown}"
            )
        tell(self.json, record, line)
        return 0


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
    """Selectors to compare: files of envelopes and neural selectors; names of those that ship, as
    neural-wall-3; or your own."""
    lift: Annotated[bool, tyro.conf.arg(help_behavior_hint="")] = True
    """Leave out the lift, which needs no envelope and is compared with the others unless told
    so."""
    projection: Annotated[tuple[str, ...], PROJECTION] = _PROJECTED
    """Projections; nlp takes some 30 ms per problem."""
    workers: int = 1
    """Processes. Times of P1 are honest with as many as there are idle cores."""
    executor: Literal["processes", "ray"] = "processes"
    """Where to work: on this machine, or on a Ray cluster."""
    address: OptionalText = None
    """Ray cluster: host:port of its head, auto, or local."""
    json: bool = False
    """One JSON object per row."""
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
        if self.markdown:
            check_unused(self, ("json",), "--markdown")
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
            draw_to_file(comparison.picture(), self.picture)
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
