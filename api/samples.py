"""Posture problems, drawn from distributions of terrains."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stancekit import InvalidInput, Problem, Robot
from stancekit.planners.arguments import checked
from stancekit.planners.files.arrays import checked_int
from stancekit.planners.problem.posture_batch import Sampler

if TYPE_CHECKING:
    from stancekit.envs.distributions.postures import Distribution

_MOST_PROBLEMS = 1_000_000
"""Problems drawn into memory at once."""


@checked
def sample(
    problems: str | Sampler,
    count: int = 1,
    *,
    robot: Robot | str | Path | None = None,
    terrain: str | Path | None = None,
    rng: np.random.Generator | int = 0,
) -> list[Problem]:
    """Draw posture problems from a distribution of terrains.

    Arguments:
        problems: something with ``sample(rng)``, or the name of a distribution: "ground-k" and
            "wall-k" (k limbs on the ground or on two facing walls; Lin et al. have "ground-3",
            "wall-3", "wall-5"), "terrain-k" (cut from ``terrain``), one that a package registered
            under the entry point ``stancekit.distributions``, "FILE.py:NAME", or a YAML file.
        count: number of problems, 1 or more.
        robot: the robot whose limbs they are: a ``Robot``, a name, a .urdf file, or a .yaml file
            that names one; with a name of a distribution only.
        terrain: a mesh or a grid, or a ground by its name as "stairs:0.5:7"; with "terrain-k".
        rng: a generator, or a seed; equal seeds give equal problems.

    Returns:
        ``count`` independent problems.

    Raises:
        InvalidInput: for a name that there is not, or a count below 1 or above a million.
    Source:
        Lin et al. §IV-A, G(θ).

    Example:
        >>> import stancekit
        >>> first, second = stancekit.sample("wall-3", 2, rng=7)
        >>> first.legs
        ('RF', 'RR', 'LM')
    """
    checked_int(count, "count", least=1, most=_MOST_PROBLEMS)
    return list(drawn(distribution(problems, robot=robot, terrain=terrain), count, rng))


def distribution(
    problems: str | Sampler,
    *,
    robot: Robot | str | Path | None = None,
    terrain: str | Path | None = None,
) -> Distribution:
    """Distribution that ``sample`` draws from.

    Raises InvalidInput.
    """
    from stancekit.envs.distributions.postures import distribution_of  # loads Gymnasium

    return distribution_of(problems, robot=robot, terrain=terrain)


def drawn(source: Distribution, count: int, rng: np.random.Generator | int) -> Iterator[Problem]:
    """Problems of ``sample``, one after the other, however many.

    Raises InvalidInput for a seed below 0.
    """
    if not isinstance(rng, np.random.Generator) and rng < 0:
        raise InvalidInput(f"rng: expected a generator or a seed of 0 or more, got {rng}")
    stream = np.random.default_rng(rng)
    return (source.sample(stream) for _ in range(count))
