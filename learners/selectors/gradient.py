"""Descend the signed margin's exact gradient: the boxes that P1 answers best with, found by P1's
own duals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveInt
from sklearn.mixture import GaussianMixture

from stancekit.envs.data.dataset import Dataset
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked_int
from stancekit.planners.files.validation import check_fields
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import McCormick

from .quantile import quantile_box


@dataclass(frozen=True, kw_only=True)
class BoxDescent:
    """Settings of moving boxes down the margin loss.

    Arguments:
        steps: batches.
        batch: problems of each label a batch.
        rate: Adam's step on the bounds, falling to a tenth over the run.
        softness: margin at which a problem counts half as much as a wrong one far away
            (non-dimensional).
    """

    steps: PositiveInt = 80
    batch: PositiveInt = 100
    rate: float = 0.005
    softness: float = 0.002

    def __post_init__(self) -> None:
        check_fields(self)


def descend(
    start: Envelope,
    feasible: Sequence[Scaled],
    infeasible: Sequence[Scaled],
    programs: Programs,
    rng: np.random.Generator,
    settings: BoxDescent = BoxDescent(),
    progress: Callable[[int, float], None] | None = None,
) -> Envelope:
    """``descend_together`` for one box."""
    return descend_together((start,), feasible, infeasible, programs, rng, settings, progress)[0]


def descend_together(
    starts: Sequence[Envelope],
    feasible: Sequence[Scaled],
    infeasible: Sequence[Scaled],
    programs: Programs,
    rng: np.random.Generator,
    settings: BoxDescent = BoxDescent(),
    progress: Callable[[int, float], None] | None = None,
) -> tuple[Envelope, ...]:
    """Return the boxes after Adam on  mean σ(t/τ) over feasible + mean σ(−t/τ) over infeasible
    problems.

    t is P1's signed margin over the set, the least over its boxes (a binary each), and σ the
    logistic function, so the loss is a smooth count of P1's mistakes, both kinds weighing the same:
    see ``smooth_mistakes``. ``progress`` is told the step and the batch's loss.
    """
    bounds = np.stack([start.to_vector() for start in starts])
    first, second = np.zeros_like(bounds), np.zeros_like(bounds)
    for step in range(settings.steps):
        loss, slope = 0.0, np.zeros_like(bounds)
        envelopes = [Envelope.from_vector(row) for row in bounds]
        for problems, sign in ((feasible, 1.0), (infeasible, -1.0)):
            chosen = rng.choice(
                len(problems), size=min(settings.batch, len(problems)), replace=False
            )
            value, gradient = smooth_mistakes(
                envelopes, [problems[i] for i in chosen], sign, programs, softness=settings.softness
            )
            loss, slope = loss + value, slope + gradient
        first, second = 0.9 * first + 0.1 * slope, 0.99 * second + 0.01 * slope**2
        rate = settings.rate * 0.1 ** (step / settings.steps)
        root = np.sqrt(second / (1.0 - 0.99 ** (step + 1)))
        bounds = bounds - rate * (first / (1.0 - 0.9 ** (step + 1))) / (root + 1e-8)
        bounds = np.stack([_in_domain(row) for row in bounds])
        if progress is not None:
            progress(step, loss)
    return tuple(Envelope.from_vector(row) for row in bounds)


def smooth_mistakes(
    envelopes: Sequence[Envelope],
    problems: Sequence[Scaled],
    sign: float,
    programs: Programs,
    *,
    softness: float,
) -> tuple[float, Array]:
    """Mean σ(sign · t / τ) over the problems and its gradient in the bounds, shape (K, 12N).

    t is the soft least of the boxes' margins t_k, −τ log mean exp(−t_k/τ): with one box its margin,
    with several each box learns from the problems that are its own. Boxes without a margin are left
    out; so are problems without any.

    Arguments:
        sign: 1 where the problems are feasible, −1 where not.
    """
    total, slope = 0.0, np.zeros((len(envelopes), 2 * envelopes[0].low.size))
    for problem in problems:
        answers = [
            (k, programs.get(McCormick, problem.layout).solve(problem, box, gradient=True))
            for k, box in enumerate(envelopes)
        ]
        there = [(k, a.margin, a.gradient) for k, a in answers if a.gradient is not None]
        if not there:
            continue
        margin, shares = soft_least(np.array([t for _, t, _ in there]), softness)
        chance = _logistic(sign * margin / softness)
        total += chance
        for share, (k, _, gradient) in zip(shares, there, strict=True):
            by_bounds = np.concatenate([part.ravel() for part in gradient])
            slope[k] += sign * chance * (1.0 - chance) / softness * share * by_bounds
    return total / len(problems), slope / len(problems)


def soft_least(values: Array, softness: float) -> tuple[float, Array]:
    """−τ log mean exp(−v/τ) and its gradient, which adds up to 1.

    Arguments:
        values: shape (K,).
    """
    least = float(values.min())
    weights = np.exp(-(values - least) / softness)
    return least - softness * float(np.log(weights.mean())), weights / weights.sum()


def margins(problems: Sequence[Scaled], envelope: Envelope, programs: Programs) -> Array:
    """P1's signed margin for every problem, shape (len(problems),)."""
    return np.array(
        [
            programs.get(McCormick, problem.layout).solve(problem, envelope).margin
            for problem in problems
        ]
    )


def fit_gradient(
    dataset: Dataset,
    *,
    boxes: int = 1,
    steps: int = 80,
    batch: int = 100,
    share: float = 0.05,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> EnvelopeSet:
    """Learn a set of boxes together, from the quantile boxes of as many Gaussian clusters of S.

    Arguments:
        share: of a cluster's solutions that its first box leaves out on each side. ``progress`` is
            told steps done and steps in all.

    Raises:
        InvalidInput: where the data set has too few rows of a label.
    """
    settings = BoxDescent(steps=steps, batch=batch)
    checked_int(boxes, "boxes", least=1)
    if len(dataset.feasible) < max(2, boxes) or not len(dataset.infeasible):
        raise InvalidInput(
            f"data set: expected {max(2, boxes)} or more feasible rows and an infeasible one, got "
            f"{len(dataset.feasible)} and {len(dataset.infeasible)}"
        )
    feasible = [Scaled.of(problem) for problem in dataset.select(dataset.feasible).problems()]
    infeasible = [Scaled.of(problem) for problem in dataset.select(dataset.infeasible).problems()]
    losses: list[float] = []

    def on_progress(step: int, loss: float) -> None:
        losses.append(loss)
        if progress is not None:
            progress(step + 1, steps)

    envelopes = descend_together(
        clustered_boxes(dataset.points, boxes, share=share, seed=seed),
        feasible,
        infeasible,
        Programs(),
        np.random.default_rng(seed),
        settings,
        on_progress,
    )
    provenance = {
        "method": "gradient",
        "settings": asdict(settings) | {"boxes": boxes, "share": share, "seed": seed},
        "rows": len(dataset),
        **dataset.origin,
        "notes": {"losses": losses},
    }
    return EnvelopeSet.for_problems(
        dataset.problem_class, list(dataset.problems()), envelopes, provenance
    )


def clustered_boxes(points: Array, boxes: int, *, share: float, seed: int) -> tuple[Envelope, ...]:
    """The quantile boxes of Gaussian clusters of S, the largest first; an empty cluster starts as
    all of S.

    Arguments:
        points: shape (K, N, 6).
    """
    if boxes == 1:
        return (quantile_box(points, share=share),)
    flat = points.reshape(len(points), -1)
    mixture = GaussianMixture(boxes, covariance_type="full", reg_covar=1e-5, random_state=seed).fit(
        flat
    )
    labels = mixture.predict(flat)
    members = sorted((np.flatnonzero(labels == k) for k in range(boxes)), key=len, reverse=True)
    return tuple(
        quantile_box(points[rows] if len(rows) else points, share=share) for rows in members
    )


def _in_domain(bounds: NDArray[np.float64]) -> Array:
    """Keep the bounds in [−1, 1] and a box at least 0.001 wide."""
    low, high = np.clip(bounds.reshape(2, -1), -1.0, 1.0)
    middle = 0.5 * (low + high)
    return np.concatenate([np.minimum(low, middle - 5e-4), np.maximum(high, middle + 5e-4)])


def _logistic(x: float) -> float:
    return float(1.0 / (1.0 + np.exp(-np.clip(x, -50.0, 50.0))))
