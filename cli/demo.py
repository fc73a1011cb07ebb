"""``stancekit demo``: two postures with their evidence, then the main job, end to end, in half a minute."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .bench_envelopes import comparison_figure, report
from .console import err, make_folder, out, stages
from .options import OptionalPath

if TYPE_CHECKING:
    from stancekit.learners.evaluation.bench import ClassResult


SHOWN: dict[str, tuple[int, ...]] = {"wall-3": (0, 8)}
"""Postures that the demo begins with: seeds by class, one that can be held and one that cannot."""


def decide(shown: dict[str, tuple[int, ...]], folder: Path) -> None:
    """Decide postures, print each one's verdict with its evidence, and draw them."""
    import numpy as np

    from stancekit.envs.distributions.postures import DISTRIBUTIONS
    from stancekit.planners.search.exact import ExactPlanner
    from stancekit.planners.verify import check_certificate, check_posture, explain
    from stancekit.views.postures import draw_posture
    from stancekit.views.sheet import save

    planner = ExactPlanner()
    for name, seeds in shown.items():
        for seed in seeds:
            problem = DISTRIBUTIONS[name].sample(np.random.default_rng(seed))
            outcome = planner.solve(problem)
            picture = folder / f"{name}-{seed}-{outcome.status.value}.png"
            out.print(f"three toes on two leaning walls ({name}, seed {seed}): {outcome.status.value}")
            if outcome.posture is not None:
                out.print(f"  posture {check_posture(problem, outcome.posture).message}")
            why = ""
            if outcome.certificate is not None:
                why = explain(problem, outcome.certificate).message
                proof = check_certificate(problem, outcome.certificate)
                verdict = "accepted" if proof.accepted else "refused"
                out.print(f"  certificate {verdict}, without a solver: no posture, however forces and toes are chosen")
                out.print(f"  {why}")
            save(draw_posture(problem, outcome.posture, why=why), picture)
            out.print(f"  picture {picture}")
    out.print()


@dataclass
class Demo:
    """Decide two postures and say why one cannot be held; then label terrains, learn envelopes, compare and draw.

    Prints the comparison beside the paper's Table I and writes data sets, envelopes and pictures to a folder. Started
    again, it goes on from what is there.
    """

    out: Path = Path("out/demo")
    """Folder for everything that is made."""
    config: OptionalPath = None
    """Experiment file (YAML); the demo's own where there is none."""
    workers: int = max(os.cpu_count() or 1, 1)
    """Processes for labelling and rollouts."""
    json: bool = False
    """One JSON object a row of the comparison."""

    def run(self) -> int:
        """Run the experiment; exit code 1 if the verifier refuses the posture that is drawn."""
        from stancekit.configs import config_path
        from stancekit.learners.data.executor import processes
        from stancekit.learners.evaluation import bench
        from stancekit.learners.evaluation.experiment import Experiment

        experiment = Experiment.from_yaml(self.config or config_path("demo.yaml"))
        executor = processes(self.workers)
        make_folder(self.out)
        if not self.json:
            decide(SHOWN, self.out)
        results = []
        with stages("demo") as on_progress:
            for result in bench.run(experiment, self.out, executor=executor, progress=on_progress):
                results.append(result)
                report(result, as_json=self.json)
        return self._picture(results[0])

    def _picture(self, result: ClassResult) -> int:
        """Solve a held-out posture in two stages with the best envelope, verify it, and draw it and the comparison."""
        from stancekit.planners.answer.outcome import Status
        from stancekit.planners.search.posture import TwoStagePlanner
        from stancekit.planners.verify import check_posture
        from stancekit.views.postures import draw_posture
        from stancekit.views.sheet import save

        name, envelopes = result.best_envelopes
        planner = TwoStagePlanner(envelopes=envelopes, projection="fix-toes")
        for row in result.test.rows():
            planner.solve(row.problem)  # compiles
            outcome = planner.solve(row.problem)
            if outcome.status is Status.FEASIBLE and outcome.posture is not None:
                break
        else:
            err.print("no held-out posture was solved in two stages")
            return 1
        report = check_posture(row.problem, outcome.posture)
        by = f"envelope {name}, P1 and fix-toes in {1e3 * outcome.seconds:.1f} ms"
        caption = f"{result.problem_class}: {by}"
        chosen = envelopes.envelopes[int(outcome.details["chosen"])]
        save(draw_posture(row.problem, outcome.posture, envelope=chosen, caption=caption), self.out / "posture.png")
        save(comparison_figure(result), self.out / "comparison.png")
        message = f"verifier: {report.message}; net moment {report.residual_nm:.1e} Nm; digest {report.digest[:12]}"
        err.print(message)
        err.print(f"pictures: {self.out / 'posture.png'}, {self.out / 'comparison.png'}")
        return 0 if report.accepted else 1
