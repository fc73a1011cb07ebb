"""Who decides hard postures, how fast, and do they agree? The exact planner against its peers, one
thread each.

python benchmarks/oracles.py --problem wall-3 --count 60 --seed 0 --json

Half of the postures have a witness and half a certificate, both from the exact planner and both
verified; those whose convex part alone is infeasible are left out. The solvers take turns on every
posture, in an order that rotates. Times are CPU times of the process, which what else runs on the
machine disturbs least; a short call would profit from a wall clock on busy cores.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import bilinear
import numpy as np
from _bench import Options, launch
from rich.console import Console
from rich.progress import track
from rich.table import Table

from stancekit.envs.distributions.postures import distribution
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Problem
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.micp import MicpGrid
from stancekit.planners.search.answer import Planner, plan_of
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.micp import MicpPlanner
from stancekit.planners.search.nlp import NlpPlanner
from stancekit.planners.verify import check_plan


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which postures, and for how long."""

    problem: str = "wall-3"
    """Distribution of the postures."""
    count: int = 60
    """How many postures, half of them feasible."""
    time_limit_s: float = 10.0
    """Of every solver, a posture."""
    solvers: tuple[str, ...] = (
        "exact",
        "gurobi",
        "gurobi-paper",
        "scip",
        "scip-paper",
        "highs-micp",
        "ipopt",
    )
    intervals: int = 4
    """Pieces of each p_j and f_k in the mixed-integer grid."""


@dataclass(frozen=True, kw_only=True)
class Said:
    """What one solver said of one posture.

    label: feasible, infeasible, unknown or size limit. verified: its point, projected, passed the
    verifier. residual_nm: net moment at the point itself, before projection; worst: its worst
    non-dimensional violation of any constraint, where it is known. solver_ms: without building the
    model.
    """

    label: str
    verified: bool = False
    residual_nm: float = float("nan")
    worst: float = float("nan")
    ms: float
    solver_ms: float


@dataclass(kw_only=True)
class Score:
    """One solver's answers, beside the exact planner's, by posture."""

    said: list[Said] = field(default_factory=list)
    ours: list[Status] = field(default_factory=list)

    def add(self, said: Said, ours: Status) -> None:
        """Note one answer."""
        self.said.append(said)
        self.ours.append(ours)

    def summary(self, base_ms: float) -> dict[str, Any]:
        """The row of the table. base_ms: median of the exact planner, whole call."""
        whole, alone = (
            np.array([getattr(said, name) for said in self.said]) for name in ("ms", "solver_ms")
        )
        alone = np.where(np.isnan(alone), whole, alone)
        pairs = list(zip(self.said, self.ours, strict=True))
        labels = Counter(said.label for said in self.said)
        false_yes = [
            s
            for s, ours in pairs
            if ours is Status.INFEASIBLE and s.label == "feasible" and not s.verified
        ]
        residuals = [s.residual_nm for s in false_yes if np.isfinite(s.residual_nm)]
        worst = [s.worst for s in false_yes if np.isfinite(s.worst)]
        return {
            "median_ms": float(np.median(whole)),
            "p90_ms": float(np.quantile(whole, 0.9)),
            "max_ms": float(np.max(whole)),
            "solver_median_ms": float(np.median(alone)),
            "solver_p90_ms": float(np.quantile(alone, 0.9)),
            "feasible_ms": _median([s.solver_ms for s, ours in pairs if ours is Status.FEASIBLE]),
            "infeasible_ms": _median(
                [s.solver_ms for s, ours in pairs if ours is Status.INFEASIBLE]
            ),
            "ratio": float(np.median(alone)) / base_ms,
            "feasible": labels["feasible"],
            "infeasible": labels["infeasible"],
            "unknown": labels["unknown"] + labels["size limit"],
            "size_limit": labels["size limit"],
            "contradictions": sum(
                (ours is Status.FEASIBLE and s.label == "infeasible")
                or (ours is Status.INFEASIBLE and s.verified)
                for s, ours in pairs
            ),
            "claims_against_certificate": len(false_yes),
            "their_residual_nm": [float(f(residuals)) for f in (np.min, np.median, np.max)]
            if residuals
            else None,
            "their_violation": max(worst) if worst else None,
        }


Ask = Callable[[Problem], Said]


def solver(name: str, options: Arguments) -> Ask:
    """The solver of this name. Raises InvalidInput where there is none or it is not installed."""
    limit = options.time_limit_s
    if name == "exact":
        return partial(ask_planner, ExactPlanner(time_limit_s=limit))
    if name == "ipopt":
        return partial(ask_planner, NlpPlanner(time_limit_s=limit))
    if name.endswith("-micp"):
        grid = MicpGrid(intervals=options.intervals)
        micp = MicpPlanner(solver=name.removesuffix("-micp"), grid=grid, time_limit_s=limit)
        return partial(ask_planner, micp)
    module, form = name.removesuffix("-paper"), "paper" if name.endswith("-paper") else "eliminated"
    if module not in bilinear.MODULES:
        raise InvalidInput(
            "solvers: expected some of exact, ipopt, highs-micp, scip-micp, gurobi, scip, gurobi-paper and scip-paper, "
            f"got {name!r}"
        )
    if not bilinear.installed(module):
        raise InvalidInput(f"{module} is not installed: pip install stancekit[exact]")
    return partial(ask_bilinear, module, form, Programs(), limit)


def ask_planner(planner: Planner, problem: Problem) -> Said:
    """Ask a planner, whose call includes projection and verification."""
    begin = time.process_time()
    outcome = planner.solve(problem)
    ms = 1e3 * (time.process_time() - begin)
    label = outcome.claim if planner.name == "micp" else str(outcome.status)
    return Said(
        label="unknown" if label == Status.UNDECIDED else label,
        verified=outcome.status is Status.FEASIBLE,
        residual_nm=outcome.details.get("claimed_residual_nm", outcome.residual_nm),
        ms=ms,
        solver_ms=ms
        * outcome.details.get("solver_s", outcome.effort.seconds)
        / outcome.effort.seconds,
    )


def ask_bilinear(
    name: str, form: bilinear.Form, programs: Programs, limit_s: float, problem: Problem
) -> Said:
    """Ask a spatial branch and bound; its point is projected and verified outside the clock."""
    begin = time.process_time()
    scaled = Scaled.of(problem)
    answer = bilinear.solve(name, scaled, form=form, time_limit_s=limit_s)
    ms, solver_ms = 1e3 * (time.process_time() - begin), 1e3 * answer.seconds
    if answer.point is None:
        return Said(label=answer.label, ms=ms, solver_ms=solver_ms)
    points = (answer.point, project(programs, "scp", scaled, answer.point))
    reports = [check_plan(plan_of(problem, scaled, scaled.numbers, point)) for point in points]
    return Said(
        label=answer.label,
        verified=reports[1].accepted,
        residual_nm=reports[0].figures["residual_nm"],
        worst=reports[0].worst,
        ms=ms,
        solver_ms=solver_ms,
    )


def hard_postures(options: Arguments) -> tuple[list[tuple[Problem, Status]], Counter[str]]:
    """Draw until both halves are full; also what was drawn and left out."""
    planner, rng = (
        ExactPlanner(time_limit_s=options.time_limit_s),
        np.random.default_rng(options.seed),
    )
    drawn, out = distribution(options.problem), Counter[str]()
    room = {
        Status.FEASIBLE: options.count - options.count // 2,
        Status.INFEASIBLE: options.count // 2,
    }
    postures: list[tuple[Problem, Status]] = []
    while any(room.values()):
        problem = drawn.sample(rng)
        outcome = planner.solve(problem)
        if outcome.details["trivial"]:
            out["trivially infeasible"] += 1
        elif outcome.status is Status.UNDECIDED:
            out["undecided"] += 1
        elif not room[outcome.status]:
            out["more than half"] += 1
        else:
            room[outcome.status] -= 1
            postures.append((problem, outcome.status))
    return postures, out


def run(
    options: Arguments, solvers: dict[str, Ask]
) -> tuple[dict[str, dict[str, Any]], Counter[str]]:
    """Every solver's row. The solvers take turns on each posture, and who begins rotates."""
    postures, out = hard_postures(options)
    names = list(solvers)
    scores = {name: Score() for name in names}
    for ask in solvers.values():
        ask(postures[0][0])  # compiled models and loaded libraries are not what is compared
    for index, (problem, status) in enumerate(
        track(postures, console=Console(stderr=True), transient=True)
    ):
        turn = index % len(names)
        for name in names[turn:] + names[:turn]:
            scores[name].add(solvers[name](problem), status)
    base_ms = float(np.median([said.ms for said in scores[names[0]].said]))
    return {name: score.summary(base_ms) for name, score in scores.items()}, out


def table(options: Arguments, rows: dict[str, dict[str, Any]]) -> Table:
    """The rows for people. CPU times in ms; a peer's ratio is that of its solver alone to our whole
    call.
    """
    shown = Table(
        title=f"{options.problem}, {options.count} hard postures, seed {options.seed}, one thread, CPU ms"
    )
    titles = "solver|call median|p90|max|solver alone|on feas.|on infeas.|ratio|feas./infeas./unknown|contra-|refuted"
    for title in titles.split("|"):
        shown.add_column(title, justify="left" if title == "solver" else "right")
    for name, row in rows.items():
        keys = ("median_ms", "p90_ms", "max_ms", "solver_median_ms", "feasible_ms", "infeasible_ms")
        labels = f"{row['feasible']}/{row['infeasible']}/{row['unknown']}"
        labels += " (size limit)" if row["size_limit"] else ""
        residuals = row["their_residual_nm"]
        spread = f" ({residuals[0]:.2g}-{residuals[2]:.2g} Nm)" if residuals else ""
        spread += f", off {row['their_violation']:.1g}" if row["their_violation"] else ""
        shown.add_row(
            name,
            *(f"{row[key]:.3g}" for key in keys),
            f"{row['ratio']:.2g}",
            labels,
            str(row["contradictions"]),
            f"{row['claims_against_certificate']}{spread}",
        )
    return shown


def main(options: Arguments) -> None:
    """Run and print."""
    solvers: dict[str, Ask] = {}
    errors = Console(stderr=True)
    for name in dict.fromkeys(("exact", *options.solvers)):
        try:
            solvers[name] = solver(name, options)
        except InvalidInput as error:
            errors.print(f"left out: {error}")
    rows, out = run(options, solvers)
    if options.json:
        for name, row in rows.items():
            head = {
                "problem": options.problem,
                "count": options.count,
                "seed": options.seed,
                "solver": name,
            }
            options.say(head | row)
        return
    console = Console(width=max(Console().width, 150))
    console.print(table(options, rows))
    console.print(
        "contra-: says infeasible where we have a verified witness, or has a point that verifies against a certificate."
        "\nrefuted: says feasible where we have a certificate, and its point does not verify (net moment there; off:"
        "\nthe worst violation of any constraint, non-dimensional, before projection)."
        f"\ndrawn and left out: {', '.join(f'{count} {what}' for what, count in out.items()) or 'none'}."
    )


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else float("nan")


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
