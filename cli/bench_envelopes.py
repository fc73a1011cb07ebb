"""``stancekit bench envelopes``: the comparison of all selectors, from labels to the table."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from .console import emit, make_folder, out, stages
from .evaluate import score_table
from .names import ROBOT, TERRAIN
from .options import OptionalPath, OptionalText

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stancekit.learners.evaluation.bench import ClassResult


@dataclass
class BenchEnvelopes:
    """Compare every method on held-out terrains, as in Lin et al.'s Table I, with 95 % intervals
    and the paper's own rows.

    Labels training, calibration and test terrains, learns a selector by every method of the
    configuration, and rolls all of them out on the same test terrains. Data sets, selectors, rows
    and pictures are kept in a folder. A run that was stopped goes on where it was, and files that
    were made with the same settings are used again.
    """

    config: OptionalPath = None
    """Experiment file (YAML); configs/bench-envelopes.yaml where there is none."""
    quick: bool = False
    """Use the file's section quick: small data, short training."""
    problem: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ()
    """Classes of problems, instead of the file's."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot whose legs stand, instead of the file's: a .urdf file, or a .yaml file that names
    one."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Mesh or grid that scenes are cut from, instead of the file's."""
    out: OptionalPath = None
    """Folder for everything that is made; out/bench, or out/bench-quick, where there is none."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Processes for labelling and rollouts."""
    executor: Literal["processes", "ray"] = "processes"
    """Where labelling and rollouts run: on this machine, or on a Ray cluster."""
    address: OptionalText = None
    """Ray cluster: host:port of its head, auto, or local."""
    json: bool = False
    """One JSON object a row."""

    def run(self) -> int:
        """Run the bench, and write the table, as numbers and as a page, and a picture a class."""
        from stancekit.configs import config_path
        from stancekit.learners.data.executors import executor
        from stancekit.learners.evaluation import bench, leaderboard
        from stancekit.learners.evaluation.experiment import Experiment
        from stancekit.planners.files.writing import write_text
        from stancekit.views.sheet import save

        arguments = {
            "problems": list(self.problem) or None,
            "robot": self.robot,
            "terrain": None if self.terrain is None else str(self.terrain),
        }
        experiment = Experiment.from_yaml(
            self.config or config_path("bench-envelopes.yaml"),
            quick=self.quick,
            overrides={name: value for name, value in arguments.items() if value is not None},
        )
        where = executor(self.executor, workers=self.workers, address=self.address)
        folder = self.out or Path("out/bench-quick" if self.quick else "out/bench")
        make_folder(folder)
        table: list[dict[str, Any]] = []
        with stages("bench") as on_progress:
            for result in bench.run(experiment, folder, executor=where, progress=on_progress):
                records = rows(result)
                table += records
                write_text(folder / "table.json", json.dumps(table, indent=1) + "\n")
                write_text(folder / "table.md", leaderboard.page(table, experiment))
                save(_comparison_figure(result), folder / f"{result.problem_class}.png")
                report(result, as_json=self.json)
        if not self.json:
            out.print(f"table and pictures: {folder}")
        return 0


def rows(result: ClassResult) -> list[dict[str, Any]]:
    """The comparison as JSON-ready rows, the paper's figures with those it has."""
    from stancekit.learners.evaluation.evaluate import paper_row

    records = []
    for score in result.scores:
        paper = paper_row(result.problem_class, score.selector)
        record = {
            "problem_class": result.problem_class,
            **score.to_json(),
            "balanced": score.balanced,
        }
        records.append(record if paper is None else {**record, "paper": paper})
    return records


def report(result: ClassResult, *, as_json: bool) -> None:
    """Print one class, as JSON lines or as a table."""
    if as_json:
        for record in rows(result):
            emit(record)
        return
    out.print(score_table(result.problem_class, list(result.scores)))
    out.print()


def _comparison_figure(result: ClassResult) -> Figure:
    """The comparison as a picture, the paper's figures as markers."""
    from stancekit.learners.evaluation.evaluate import paper_row
    from stancekit.views.comparison import ComparisonBar, draw_comparison

    names = {
        "p1_feasible": "P1 feasible",
        "p1_infeasible": "P1 infeasible",
        "project_fix_p": "→ fix-p",
    }
    names |= {"project_nlp": "→ nlp"}
    bars = []
    for score in result.scores:
        shares = {"P1 feasible": score.p1_feasible, "P1 infeasible": score.p1_infeasible}
        shares |= {f"→ {way}": share for way, share in score.projected.items()}
        values = {name: share.value for name, share in shares.items() if share.of}
        paper = paper_row(result.problem_class, score.selector) or {}
        shown = {names[key]: value for key, value in paper.items() if names.get(key) in values}
        bars.append(ComparisonBar(selector=score.selector, values=values, paper=shown))
    return draw_comparison(
        bars,
        caption=f"{result.problem_class}: {bars and result.scores[0].p1_feasible.of} feasible "
        f"and {result.scores[0].p1_infeasible.of} infeasible held-out terrains",
    )
