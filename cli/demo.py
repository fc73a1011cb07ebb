"""``stancekit demo``: the main job, end to end, in a few minutes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .console import emit, err, out, progress
from .evaluate import score_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from stancekit.learners.experiment import ClassResult


@dataclass
class Demo:
    """Sample terrains, label them exactly, learn envelopes, compare them on held-out terrains, and draw a posture.

    Prints the comparison beside the paper's Table I and writes data sets, envelopes and pictures to a folder. Started
    again, it goes on from the labels that are there.
    """

    out: Path = Path("out/demo")
    """Folder for everything that is made."""
    config: Path | None = None
    """Experiment file (YAML); the demo's own where there is none."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Processes for labelling."""
    json: bool = False
    """One JSON object a row of the comparison."""

    def run(self) -> int:
        """Run the experiment; exit code 1 if the verifier refuses the posture that is drawn."""
        from stancekit.configs import config_path
        from stancekit.learners.experiment import Experiment, run_experiment

        experiment = Experiment.from_yaml(self.config or config_path("demo.yaml"))
        self.out.mkdir(parents=True, exist_ok=True)
        results = []
        with _stages() as told:
            for result in run_experiment(experiment, self.out, workers=self.workers, progress=told):
                results.append(result)
                self._report(result)
        return self._picture(results[0])

    def _report(self, result: ClassResult) -> None:
        if self.json:
            for score in result.scores:
                emit({"problem_class": result.problem_class, **score.to_json()})
            return
        out.print(score_table(result.problem_class, list(result.scores)))
        out.print()

    def _picture(self, result: ClassResult) -> int:
        """Solve a held-out posture in two stages with the best envelope, verify it, and draw it and the comparison."""
        from stancekit.envs.picture import draw_posture, save
        from stancekit.planners.contact.twostage import TwoStagePlanner
        from stancekit.planners.outcome import Status
        from stancekit.planners.verify import check_posture

        envelopes = result.sets[result.best.selector]
        planner = TwoStagePlanner(envelopes=envelopes, projection="fix-toes")
        for row in result.test:
            planner.solve(row.problem)  # compiles
            outcome = planner.solve(row.problem)
            if outcome.status is Status.FEASIBLE and outcome.posture is not None:
                break
        else:
            err.print("no held-out posture was solved in two stages", markup=False)
            return 1
        report = check_posture(row.problem, outcome.posture)
        by = f"envelope {result.best.selector}, P1 and fix-toes in {1e3 * outcome.seconds:.1f} ms"
        caption = f"{result.problem_class}: {by}"
        chosen = envelopes.envelopes[int(outcome.details["chosen"])]
        save(draw_posture(row.problem, outcome.posture, envelope=chosen, caption=caption), self.out / "posture.png")
        save(comparison_figure(result), self.out / "comparison.png")
        message = f"verifier: {report.message}; net moment {report.residual_nm:.1e} Nm; digest {report.digest[:12]}"
        err.print(message, markup=False)
        err.print(f"pictures: {self.out / 'posture.png'}, {self.out / 'comparison.png'}", markup=False)
        return 0 if report.accepted else 1


def comparison_figure(result: ClassResult) -> Figure:
    """The comparison as a picture, the paper's figures as markers."""
    from stancekit.envs.picture import ComparisonBar, draw_comparison
    from stancekit.learners.evaluate import TABLE_I

    names = {"heuristic": "heuristic", "gmm-printed": "cluster"}
    bars = []
    for score in result.scores:
        values = {"P1 feasible": score.p1_feasible.value, "P1 infeasible": score.p1_infeasible.value}
        values |= {f"→ {way}": share.value for way, share in score.projected.items()}
        row = TABLE_I.get(result.problem_class, {}).get(names.get(score.selector, ""), None)
        paper = {} if row is None else {"P1 feasible": row[0], "P1 infeasible": row[1], "→ fix-p": row[2]}
        bars.append(ComparisonBar(selector=score.selector, values=values, paper=paper))
    return draw_comparison(bars)


@contextmanager
def _stages() -> Iterator[Callable[[str, int, int], None]]:
    """One bar a stage; where standard error is no terminal, a line when a stage begins."""
    seen: list[str] = []
    with progress("demo") as bar:

        def told(stage: str, done: int, total: int) -> None:
            if not seen or seen[-1] != stage:
                seen.append(stage)
                if not err.is_terminal:
                    err.print(stage, markup=False)
            bar(done, total)

        yield told
