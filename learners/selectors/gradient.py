"""Descend the signed margin's exact gradient: the box that P1 answers best with, found by P1's own duals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from stancekit.planners.arrays import Array
from stancekit.planners.contact.envelope import Envelope
from stancekit.planners.contact.relax import McCormick
from stancekit.planners.contact.scaled import ScaledProblem


@dataclass(frozen=True, kw_only=True)
class Descent:
    """How a box is moved down the margin loss.

    steps: batches; batch: problems of each label a batch; rate: Adam's step on the bounds, falling to a tenth over the
    run; softness: margin at which a problem counts half as much as a wrong one far away (non-dimensional).
    """

    steps: int = 80
    batch: int = 100
    rate: float = 0.005
    softness: float = 0.002


def descend(
    start: Envelope,
    feasible: Sequence[ScaledProblem],
    infeasible: Sequence[ScaledProblem],
    model: McCormick,
    rng: np.random.Generator,
    settings: Descent = Descent(),
    progress: Callable[[int, float], None] | None = None,
) -> Envelope:
    """Return the box after Adam on  mean σ(t/τ) over feasible + mean σ(−t/τ) over infeasible problems.

    t is P1's signed margin over the box and σ the logistic function, so the loss is a smooth count of P1's mistakes,
    both kinds weighing the same. ``progress`` is told the step and the batch's loss.
    """
    bounds = start.to_vector()
    first, second = np.zeros_like(bounds), np.zeros_like(bounds)
    for step in range(settings.steps):
        loss, slope = 0.0, np.zeros_like(bounds)
        envelope = Envelope.from_vector(bounds)
        for problems, sign in ((feasible, 1.0), (infeasible, -1.0)):
            chosen = rng.choice(len(problems), size=min(settings.batch, len(problems)), replace=False)
            value, gradient = _loss([problems[i] for i in chosen], sign, envelope, model, settings.softness)
            loss, slope = loss + value, slope + gradient
        first, second = 0.9 * first + 0.1 * slope, 0.99 * second + 0.01 * slope**2
        rate = settings.rate * 0.1 ** (step / settings.steps)
        root = np.sqrt(second / (1.0 - 0.99 ** (step + 1)))
        bounds = bounds - rate * (first / (1.0 - 0.9 ** (step + 1))) / (root + 1e-8)
        bounds = _in_domain(bounds)
        if progress is not None:
            progress(step, loss)
    return Envelope.from_vector(bounds)


def margins(problems: Sequence[ScaledProblem], envelope: Envelope, model: McCormick) -> Array:
    """P1's signed margin for every problem, shape (len(problems),)."""
    return np.array([model.solve(problem, envelope).margin for problem in problems])


def _loss(
    problems: Sequence[ScaledProblem], sign: float, envelope: Envelope, model: McCormick, softness: float
) -> tuple[float, Array]:
    """Mean σ(sign · t / softness) and its gradient in the bounds; problems without a margin do not count."""
    total, slope = 0.0, np.zeros(2 * envelope.low.size)
    for problem in problems:
        answer = model.solve(problem, envelope, gradient=True)
        if answer.gradient is None:
            continue
        chance = _logistic(sign * answer.margin / softness)
        total += chance
        slope += sign * chance * (1.0 - chance) / softness * np.concatenate([part.ravel() for part in answer.gradient])
    return total / len(problems), slope / len(problems)


def _in_domain(bounds: NDArray[np.float64]) -> Array:
    """Keep the bounds in [−1, 1] and a box at least 0.001 wide."""
    low, high = np.clip(bounds.reshape(2, -1), -1.0, 1.0)
    middle = 0.5 * (low + high)
    return np.concatenate([np.minimum(low, middle - 5e-4), np.maximum(high, middle + 5e-4)])


def _logistic(x: float) -> float:
    return float(1.0 / (1.0 + np.exp(-np.clip(x, -50.0, 50.0))))
