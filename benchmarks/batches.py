"""P1 of many problems together: Moreau on a CUDA device, or on the processor, against Clarabel one
after the other.

    python benchmarks/batches.py [--device cuda] [--problem wall-3] [--sizes 256 1024 4096 16384]
    [--rounds 3] [--json]

A problem has a box about its own patches, of random width, so that P1 is feasible for about half of
them. A row a size: solves a second of the clock, everything counted from scaled problems to
multipliers (numbers loaded, copied to the device, solved, copied back), and of Clarabel on one
thread in turn with them; their ratio; of how many problems the two say something else; the largest
difference of two margins; and of those that P1 admits, for how many fix-p from the two points ends
differently: where P1 leaves freedom its points differ. Without the device one line says so.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from _bench import Options, launch

from stancekit.envs.distributions.postures import distribution
from stancekit.planners.equilibrium.moreau_solver import Device
from stancekit.planners.equilibrium.programs import Engine, Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.projection.project import project
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.relaxation.relaxed import RelaxationAnswer

BACKENDS: dict[Device, Engine] = {"cuda": "moreau", "cpu": "moreau-cpu"}
WIDTHS = (0.1, 0.9)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Where, which problems, and how many at once."""

    device: Device = "cuda"
    problem: str = "wall-3"
    sizes: tuple[int, ...] = (256, 1024, 4096, 16384)
    rounds: int = 3


def main(arguments: Arguments) -> None:
    """Measure and print."""
    try:
        programs = Programs(engine=BACKENDS[arguments.device])
    except InvalidInput as error:
        raise SystemExit(str(error)) from None
    rng, sampler = np.random.default_rng(arguments.seed), distribution(arguments.problem)
    scaled = [Scaled.of(sampler.sample(rng)) for _ in range(max(arguments.sizes))]
    boxes = [(around(one, rng),) for one in scaled]
    for size in arguments.sizes:
        here = scaled[:size], boxes[:size]
        for made in (programs, alone := Programs()):
            made.get(McCormick, scaled[0].layout).solve_any_of_each(*here)  # compiled, warm
        taken = np.array(
            [[timed(made, *here)[0] for made in (programs, alone)] for _ in range(arguments.rounds)]
        )
        together, one_by_one = (timed(made, *here)[1] for made in (programs, alone))
        seconds = taken.min(axis=0)
        arguments.say(
            {"batch": size, **compared(scaled, together, one_by_one), **speeds(size, seconds)}
        )


def around(scaled: Scaled, rng: np.random.Generator) -> Envelope:
    """A box about the middle of the patches and forces that carry the weight, its width drawn."""
    middle = np.concatenate(
        [scaled.patches.mean(axis=1), np.tile([0.5, 0.0, 0.2], (scaled.size[0], 1))], axis=1
    )
    half = rng.uniform(*WIDTHS)
    return Envelope(low=np.clip(middle - half, -1.0, 1.0), high=np.clip(middle + half, -1.0, 1.0))


def timed(
    programs: Programs, scaled: Sequence[Scaled], boxes: Sequence[Sequence[Envelope]]
) -> tuple[float, list[RelaxationAnswer]]:
    """Seconds of the clock, and the answers."""
    program, begin = programs.get(McCormick, scaled[0].layout), time.perf_counter()
    answers = program.solve_any_of_each(scaled, boxes)
    return time.perf_counter() - begin, answers


def speeds(size: int, seconds: np.ndarray) -> dict[str, float]:
    """Solves a second of both, and their ratio."""
    batch, single = (size / seconds).tolist()
    return {
        "moreau, a second": round(batch),
        "clarabel, a second": round(single),
        "ratio": round(batch / single, 2),
    }


def compared(
    scaled: Sequence[Scaled], mine: Sequence[RelaxationAnswer], theirs: Sequence[RelaxationAnswer]
) -> dict[str, float | str]:
    """Verdicts, margins and projections."""
    pairs = list(zip(mine, theirs, strict=True))
    margins = np.array([(one.margin, other.margin) for one, other in pairs])
    finite = np.isfinite(margins).all(axis=1)
    programs, other_ends, admitted = Programs(), 0, 0
    for posture, (one, other) in zip(scaled, pairs, strict=False):
        if one.feasible and other.feasible and one.point is not None and other.point is not None:
            ends = [
                project(programs, "fix-p", posture, point).residual
                for point in (one.point, other.point)
            ]
            admitted, other_ends = (
                admitted + 1,
                other_ends + (np.isfinite(ends[0]) != np.isfinite(ends[1])),
            )
    return {
        "feasible": sum(other.feasible for other in theirs),
        "said otherwise": sum(one.feasible != other.feasible for one, other in pairs),
        "margins off": f"{np.abs(np.diff(margins[finite], axis=1)).max(initial=0.0):.1e}",
        "fix-p otherwise": f"{other_ends} of {admitted}",
    }


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
