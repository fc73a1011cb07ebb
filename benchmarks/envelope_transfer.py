"""A flat-ground envelope on curved ground: through the warp map, or as it is.

    python benchmarks/envelope_transfer.py [--count 200] [--samples 500] [--terrains ripple cone]
    [--json]

Envelope: learned once from solved ground-3 postures. Posture problems of the same distribution are
drawn in warped space, at random places, and pushed forward to the terrain. `chart` pushes the
envelope with them, `direct` takes its box in the world's axes as it was learned. P1 and P2 are
shares as in Lin et al.'s Table I: P1 answers as the exact planner does; P1 → P2 ends on the
bilinear surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from _bench import Options, launch

from stancekit.envs.distributions.postures import distribution
from stancekit.learners.selectors.modes import solved_postures
from stancekit.learners.selectors.quantile import quantile_box
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.terrain.reference import reference_terrain
from stancekit.planners.warp.conformal import flatten
from stancekit.planners.warp.contact_plans import WarpedPose
from stancekit.planners.warp.spline_map import SplineMap

ON_SURFACE = 1e-4
"""Non-dimensional moment that P2 may leave."""
HEIGHT_M = 0.2
"""Of the bodies over the ground, as in ground-3."""


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which terrains, and how many problems."""

    count: int = 200
    samples: int = 500
    terrains: tuple[str, ...] = ("ripple", "cone")


def main(arguments: Arguments) -> None:
    """Measure and print."""
    rng, planner = np.random.default_rng(arguments.seed), ExactPlanner()
    envelope = quantile_box(solved_postures("ground-3", arguments.samples, planner, rng)[1])
    for name in arguments.terrains:
        for row in transfer(
            name, flatten(reference_terrain(name)), envelope, planner, arguments.count, rng
        ):
            arguments.say(row)


def transfer(
    name: str,
    warp: SplineMap,
    envelope: Envelope,
    planner: ExactPlanner,
    count: int,
    rng: np.random.Generator,
) -> list[dict[str, Any]]:
    """P1 and P2 of the envelope, pushed and as it is, on problems that the exact planner has
    decided.
    """
    source, programs = distribution("ground-3"), Programs()
    hits: dict[str, list[tuple[bool, bool, bool]]] = {"chart": [], "direct": []}
    for _ in range(count):
        place = np.array([*rng.uniform(-2.0, 2.0, 2), HEIGHT_M])
        pose = WarpedPose(warp=warp, com_bar_m=place)
        problem = pose.problem(source.sample(rng))
        status = planner.solve(problem).status
        if status is Status.UNDECIDED:
            continue
        scaled = Scaled.of(problem)
        boxes = {"chart": pose.envelope(envelope, problem.length_scale_m), "direct": envelope}
        for way, box in boxes.items():
            admitted, projected = _both(programs, scaled, box)
            hits[way].append((status is Status.FEASIBLE, admitted, projected))
    return [{"terrain": name, "envelope": way, **_shares(found)} for way, found in hits.items()]


def _both(programs: Programs, scaled: Scaled, box: Envelope) -> tuple[bool, bool]:
    answer = programs.get(McCormick, scaled.layout).solve(scaled, box)
    if not answer.feasible or answer.point is None:
        return False, False
    return True, bool(project(programs, "scp", scaled, answer.point).residual <= ON_SURFACE)


def _shares(found: list[tuple[bool, bool, bool]]) -> dict[str, Any]:
    table = np.array(found)
    good = table[table[:, 0]]
    bad = table[~table[:, 0]]
    return {
        "feasible": len(good),
        "P1 correct feasible": _percent(good[:, 1]),
        "infeasible": len(bad),
        "P1 correct infeasible": _percent(~bad[:, 1]),
        "P1 → P2 of feasible": _percent(good[:, 2]),
    }


def _percent(flags: np.ndarray[Any, np.dtype[np.bool_]]) -> str:
    return f"{100.0 * flags.mean():.1f} %" if len(flags) else "none"


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
