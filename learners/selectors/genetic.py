"""Lin et al.'s evolutionary approach (§III-2): envelopes bred for what P1 answers over them.

A chromosome is the pairs (low, high) of one envelope's bounds. Its fitness comes from a, the share
of infeasible problems that P1 admits, and b, the share of feasible ones that it rejects, both over
K problems that are drawn anew every generation and are the same for all individuals: a is to be
small while b stays below δ. The paper does not say how both become one number; here it is 1 − a − ρ
max(0, b − δ), to be maximised. (Tried on wall-3, three seeds: letting b ≤ δ beat everything else,
as Deb's feasibility rule has it, costs 2 points of right answers, since whole generations fail it
by the luck of the draw.) The result keeps to b ≤ δ over all problems where a finalist does.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeInt, PositiveInt

from stancekit.envs.data.dataset import Dataset
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked_int
from stancekit.planners.files.documents import check_fields
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import McCormick

from ..data.executors import Executor, processes
from ..training.loop import (
    Checkpoint,
    Fit,
    Record,
    State,
    StepsDone,
    draw_on,
    drawn_from,
    run as run_fit,
)
from .feasibility import CachingOracle, FeasibilityOracle, Index, SpreadOracle, VerdictCounts
from .mixture import mixture_of
from .selector import quantile_box


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


class BoxFit(Fit):
    """Boxes moved by Adam down  mean σ(t/τ) over feasible + mean σ(−t/τ) over infeasible problems.

    t is P1's signed margin over the set, the least over its boxes (a binary each), and σ the
    logistic function, so the loss is a smooth count of P1's mistakes, both kinds weighing the same:
    see ``smooth_mistakes``.
    """

    def __init__(
        self,
        starts: Sequence[Envelope],
        feasible: Sequence[Scaled],
        infeasible: Sequence[Scaled],
        programs: Programs,
        rng: np.random.Generator,
        settings: BoxDescent,
    ) -> None:
        self._problems, self._programs = ((feasible, 1.0), (infeasible, -1.0)), programs
        self._rng, self._settings, self.total = rng, settings, settings.steps
        self._bounds = np.stack([start.to_vector() for start in starts])
        self._first, self._second = np.zeros_like(self._bounds), np.zeros_like(self._bounds)

    @property
    def envelopes(self) -> tuple[Envelope, ...]:
        """The boxes as they are now."""
        return tuple(Envelope.from_vector(row) for row in self._bounds)

    def step(self, number: int) -> Record:
        """One batch of each label."""
        settings, loss, slope = self._settings, 0.0, np.zeros_like(self._bounds)
        for problems, sign in self._problems:
            size = min(settings.batch, len(problems))
            chosen = self._rng.choice(len(problems), size=size, replace=False)
            value, gradient = smooth_mistakes(
                self.envelopes,
                [problems[i] for i in chosen],
                sign,
                self._programs,
                softness=settings.softness,
            )
            loss, slope = loss + value, slope + gradient
        self._first = 0.9 * self._first + 0.1 * slope
        self._second = 0.99 * self._second + 0.01 * slope**2
        rate = settings.rate * 0.1 ** (number / settings.steps)
        root = np.sqrt(self._second / (1.0 - 0.99 ** (number + 1)))
        bounds = self._bounds - rate * (self._first / (1.0 - 0.9 ** (number + 1))) / (root + 1e-8)
        self._bounds = np.stack([_in_domain(row) for row in bounds])
        return {"loss": loss}

    def state(self) -> State:
        """Bounds, Adam's moments, and the generator."""
        moments = {"bounds": self._bounds, "first": self._first, "second": self._second}
        return {**moments, "chance": drawn_from(self._rng)}

    def restore(self, state: State, history: list[Record]) -> None:
        """Put them back."""
        self._bounds, self._first, self._second = (
            state[name].reshape(self._bounds.shape) for name in ("bounds", "first", "second")
        )
        draw_on(self._rng, state["chance"])


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
        chance = float(1.0 / (1.0 + np.exp(-np.clip(sign * margin / softness, -50.0, 50.0))))
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
    progress: StepsDone | None = None,
    checkpoint: Path | None = None,
) -> EnvelopeSet:
    """Learn a set of boxes together, from the quantile boxes of as many Gaussian clusters of S.

    Arguments:
        share: of a cluster's solutions that its first box leaves out on each side. ``progress`` is
            called with steps done and steps in all.
        checkpoint: file to go on from when learning was stopped.

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
    boxes_to_fit = BoxFit(
        clustered_boxes(dataset.points, boxes, share=share, seed=seed),
        *scaled_by_label(dataset),
        Programs(),
        np.random.default_rng(seed),
        settings,
    )
    knobs = asdict(settings) | {"boxes": boxes, "share": share, "seed": seed}
    about = {"method": "gradient", "settings": knobs, "rows": len(dataset), **dataset.origin}
    records = run_fit(boxes_to_fit, progress, Checkpoint.of(checkpoint, about))
    losses = [record["loss"] for record in records]
    return EnvelopeSet.for_problems(
        dataset.problem_class,
        list(dataset.problems()),
        boxes_to_fit.envelopes,
        {**about, "notes": {"losses": losses}},
    )


def scaled_by_label(dataset: Dataset) -> tuple[list[Scaled], list[Scaled]]:
    """The feasible problems of a data set, and the infeasible ones."""
    feasible, infeasible = (
        [Scaled.of(problem) for problem in dataset.select(rows).problems()]
        for rows in (dataset.feasible, dataset.infeasible)
    )
    return feasible, infeasible


def clustered_boxes(points: Array, boxes: int, *, share: float, seed: int) -> tuple[Envelope, ...]:
    """The quantile boxes of Gaussian clusters of S, the largest first; an empty cluster starts as
    all of S.

    Arguments:
        points: shape (K, N, 6).
    """
    if boxes == 1:
        return (quantile_box(points, share=share),)
    flat = points.reshape(len(points), -1)
    labels = mixture_of(flat, boxes, seed).predict(flat)
    members = sorted((np.flatnonzero(labels == k) for k in range(boxes)), key=len, reverse=True)
    return tuple(
        quantile_box(points[rows] if len(rows) else points, share=share) for rows in members
    )


def _in_domain(bounds: NDArray[np.float64]) -> Array:
    """Keep the bounds in [−1, 1] and a box at least 0.001 wide."""
    low, high = np.clip(bounds.reshape(2, -1), -1.0, 1.0)
    middle = 0.5 * (low + high)
    return np.concatenate([np.minimum(low, middle - 5e-4), np.maximum(high, middle + 5e-4)])


@dataclass(frozen=True, kw_only=True)
class Generation:
    """One tested generation.

    Arguments:
        mean, variance, best: of the fitness, to be maximised.
        a, b: of the best individual, over the problems drawn.
        mutation_rate: with which the next one is bred.
        evaluations: verdicts of P1 asked for.
        cached: of them, without a solve.
        counts: how.
    """

    number: int
    mean: float
    variance: float
    best: float
    a: float
    b: float
    mutation_rate: float
    evaluations: int
    cached: int
    counts: VerdictCounts

    @classmethod
    def of(cls, record: Record) -> Generation:
        """From what a checkpoint has of it."""
        return cls(**{**record, "counts": VerdictCounts(**record["counts"])})


_DOMAIN = 1.0
"""p and f lie in [−1, 1] by the choice of scales (Lin et al. §II)."""
_Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


@dataclass(frozen=True, kw_only=True)
class GeneticSettings:
    """Knobs of the genetic algorithm.

    Raises InvalidInput.

    Arguments:
        population: number of individuals.
        generations: number of generations.
        terrains: K, half of them feasible and half infeasible; more make the fitness less noisy.
        delta: δ, the share of feasible problems that may be lost: smaller makes boxes wider.
        penalty: ρ, the cost of losing more: larger keeps to δ more strictly, and fits noise more.
        mutation_start, mutation_end: chance that a pair of bounds mutates in the first and in the
            last generation; it falls geometrically.
        mutation_scale: its standard deviation, in units of the solutions' own in that dimension.
        elites: best individuals that are kept unchanged.
        tournament: rivals for a place as a parent; more select harder.
        finalists: individuals of the last generation that are tested on all problems; the best of
            them is the result.
    """

    population: Annotated[int, Field(ge=2)] = 40
    generations: PositiveInt = 60
    terrains: Annotated[int, Field(ge=2)] = 100
    delta: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.1
    penalty: _Positive = 8.0
    mutation_start: float = 0.2
    mutation_end: float = 0.02
    mutation_scale: _Positive = 0.3
    elites: NonNegativeInt = 2
    tournament: PositiveInt = 3
    finalists: PositiveInt = 12
    seed: NonNegativeInt = 0

    def __post_init__(self) -> None:
        check_fields(self)
        if self.elites >= self.population:
            raise InvalidInput(
                f"elites: expected fewer than the population of {self.population}, got "
                f"{self.elites}"
            )
        if not 0.0 < self.mutation_end <= self.mutation_start <= 1.0:
            raise InvalidInput(
                "mutation_start, mutation_end: expected 1 >= start >= end > 0, got "
                f"{self.mutation_start!r} and "
                f"{self.mutation_end!r}"
            )

    def mutation_rate(self, generation: int) -> float:
        """Chance that a pair of bounds is mutated when this generation has been tested, from 0."""
        fraction = generation / max(self.generations - 1, 1)
        return float(self.mutation_start * (self.mutation_end / self.mutation_start) ** fraction)


@dataclass(frozen=True, kw_only=True, eq=False)
class GeneticResult:
    """Result of a run.

    Arguments:
        a, b: of the envelope over all problems.
        counts: how all verdicts were found.
    """

    envelope: Envelope
    a: float
    b: float
    history: tuple[Generation, ...]
    counts: VerdictCounts = field(default_factory=VerdictCounts)

    @property
    def balanced(self) -> float:
        """Mean share of right answers over both kinds of problems."""
        return 1.0 - 0.5 * (self.a + self.b)


def fitness(a: Array, b: Array, settings: GeneticSettings) -> Array:
    """The number to maximise: 1 − a − ρ max(0, b − δ)."""
    return np.asarray(1.0 - a - settings.penalty * np.maximum(b - settings.delta, 0.0))


class Trials:
    """The fitness of individuals: a and b over problems drawn anew, or over all.

    The feasible problems come first.
    """

    def __init__(
        self, feasible: int, infeasible: int, oracle: FeasibilityOracle, terrains: int
    ) -> None:
        self.sizes, self._oracle, self._terrains = (feasible, infeasible), oracle, terrains

    @classmethod
    def of(
        cls,
        feasible: Sequence[Scaled],
        infeasible: Sequence[Scaled],
        settings: GeneticSettings,
        oracle: FeasibilityOracle | None = None,
    ) -> Trials:
        """Trials on these problems, with a ``CachingOracle`` where none is given.

        Raises InvalidInput.
        """
        if not feasible or not infeasible:
            raise InvalidInput(
                f"problems: expected one or more of each label, got {len(feasible)} feasible and "
                f"{len(infeasible)} infeasible"
            )
        oracle = oracle or CachingOracle([*feasible, *infeasible], Programs())
        return cls(len(feasible), len(infeasible), oracle, settings.terrains)

    def draw(self, rng: np.random.Generator) -> Index:
        """Numbers of K problems, half of each label, none twice (as far as there are so many)."""
        half = (self._terrains - self._terrains // 2, self._terrains // 2)
        subsets = [
            rng.choice(n, size=min(k, n), replace=False)
            for n, k in zip(self.sizes, half, strict=True)
        ]
        return np.concatenate([np.sort(subsets[0]), self.sizes[0] + np.sort(subsets[1])])

    def all(self) -> Index:
        """Numbers of all problems."""
        return np.arange(sum(self.sizes))

    def shares(self, population: Array, which: Index) -> tuple[Array, Array]:
        """a and b of boxes, shape (P, 2, N, 6), over these problems; each of shape (P,)."""
        admitted = self._oracle.is_feasible(
            which, [Envelope(low=low, high=high) for low, high in population]
        )
        feasible = which < self.sizes[0]
        return admitted[:, ~feasible].mean(axis=1), (~admitted[:, feasible]).mean(axis=1)

    @property
    def counts(self) -> VerdictCounts:
        """Number of verdicts so far by how each was reached."""
        return self._oracle.counts


def evolve(
    problems_feasible: Sequence[Scaled],
    problems_infeasible: Sequence[Scaled],
    points: Array,
    settings: GeneticSettings = GeneticSettings(),
    *,
    oracle: FeasibilityOracle | None = None,
    checkpoint: Path | None = None,
    progress: StepsDone | None = None,
) -> GeneticResult:
    """Run the genetic algorithm.

    Arguments:
        points: S, shape (F, N, 6), for the first generation and for the scale of the mutations.
        oracle: says what P1 admits, for the feasible problems followed by the infeasible ones; None
            for a ``CachingOracle``.
        checkpoint: file that is written after every generation; if it exists, the run resumes from
            it. The result is the same as without an interruption, except for ``counts``, which
            count only the work of this run.
        progress: gets generations done and in all.

    Raises:
        InvalidInput: also for the checkpoint of another run.
    """
    trials = Trials.of(problems_feasible, problems_infeasible, settings, oracle)
    evolution = Evolution(trials, points, settings)
    patches = np.stack([problem.patches for problem in (*problems_feasible, *problems_infeasible)])
    data = hashlib.sha256(patches.tobytes() + np.ascontiguousarray(points).tobytes())
    about = {"settings": asdict(settings), "labels": trials.sizes, "data": data.hexdigest()}
    records = run_fit(evolution, progress, Checkpoint.of(checkpoint, about))
    history = [Generation.of(record) for record in records]
    return finish(evolution.population[: settings.finalists], trials, settings, history)


class Evolution(Fit):
    """Generations, each tested, ranked and, but for the last, bred from.

    Arguments:
        points: see ``evolve``.
    """

    def __init__(self, trials: Trials, points: Array, settings: GeneticSettings) -> None:
        self._trials, self._settings, self.total = trials, settings, settings.generations
        self._rng = np.random.default_rng(settings.seed)
        self.population = first_generation(points, settings.population, self._rng)
        self._spread = np.maximum(points.std(axis=0), 1e-3)

    def step(self, number: int) -> Record:
        """Test a generation, and breed the next."""
        settings, before = self._settings, self._trials.counts
        a, b = self._trials.shares(self.population, self._trials.draw(self._rng))
        rate = settings.mutation_rate(number)
        tested = generation(number, a, b, settings, rate, self._trials.counts - before)
        self.population = self.population[ranking(a, b, settings)]
        if number + 1 < self.total:
            self.population = breed(self.population, self._spread, rate, settings, self._rng)
        return asdict(tested)

    def state(self) -> State:
        """The population, to be tested next or in order of rank, and the generator."""
        return {"population": self.population, "chance": drawn_from(self._rng)}

    def restore(self, state: State, history: list[Record]) -> None:
        """Put them back."""
        self.population = state["population"].reshape(self.population.shape)
        draw_on(self._rng, state["chance"])


def generation(
    number: int, a: Array, b: Array, settings: GeneticSettings, rate: float, counts: VerdictCounts
) -> Generation:
    """The record of one tested generation."""
    values, best = fitness(a, b, settings), int(ranking(a, b, settings)[0])
    return Generation(
        number=number,
        mean=float(values.mean()),
        variance=float(values.var()),
        best=float(values[best]),
        a=float(a[best]),
        b=float(b[best]),
        mutation_rate=rate,
        evaluations=counts.total,
        cached=counts.cached,
        counts=counts,
    )


def finish(
    finalists: Array, trials: Trials, settings: GeneticSettings, history: Sequence[Generation]
) -> GeneticResult:
    """Test the finalists, shape (P, 2, N, 6), on all problems; return the fittest, of those with b
    ≤ δ if there are.
    """
    a, b = trials.shares(finalists, trials.all())
    order = ranking(a, b, settings)
    best = int(order[np.argmin(b[order] > settings.delta)])
    low, high = finalists[best]
    return GeneticResult(
        envelope=Envelope(low=low, high=high),
        a=float(a[best]),
        b=float(b[best]),
        history=tuple(history),
        counts=trials.counts,
    )


def ranking(a: Array, b: Array, settings: GeneticSettings) -> Index:
    """The individuals from best to worst; of equally fit ones that with the smaller b comes
    first.
    """
    return np.lexsort((b, -fitness(a, b, settings)))


def first_generation(points: Array, size: int, rng: np.random.Generator) -> Array:
    """Boxes around solutions: each the exterior of 2 to all of the points, chosen at random, shape
    (size, 2, N, 6).

    How many is drawn evenly on a logarithmic scale, so tight and wide boxes come in like numbers.
    """
    if len(points) == 0:
        raise InvalidInput("points: expected one solution or more, got none")
    counts = np.exp(rng.uniform(np.log(2.0), np.log(max(len(points), 2) + 1.0), size=size)).astype(
        int
    )
    chosen = [
        points[rng.choice(len(points), size=min(n, len(points)), replace=False)] for n in counts
    ]
    boxes = np.stack([[some.min(axis=0), some.max(axis=0)] for some in chosen])
    return np.asarray(np.clip(boxes, -_DOMAIN, _DOMAIN))


def breed(
    ranked: Array, spread: Array, rate: float, settings: GeneticSettings, rng: np.random.Generator
) -> Array:
    """The next generation from one in order of rank, shape (P, 2, N, 6).

    Parents win tournaments; a child takes every pair of bounds whole from one or the other (uniform
    crossover a pair), and each of its pairs is moved with the chance ``rate``, both ends by a
    normal step of their own.
    """
    size = len(ranked)
    children = size - settings.elites
    parents = rng.integers(size, size=(2, children, settings.tournament)).min(
        axis=2
    )  # the best rank of each
    mother, father = ranked[parents[0]], ranked[parents[1]]
    from_mother = rng.random((children, 1, *ranked.shape[2:])) < 0.5
    child = np.where(from_mother, mother, father)
    mutated = rng.random((children, 1, *ranked.shape[2:])) < rate
    child = child + mutated * (settings.mutation_scale * spread * rng.standard_normal(child.shape))
    child = np.sort(np.clip(child, -_DOMAIN, _DOMAIN), axis=1)  # low before high
    return np.concatenate([ranked[: settings.elites], child])


def fit_genetic(
    dataset: Dataset,
    settings: GeneticSettings = GeneticSettings(),
    progress: StepsDone | None = None,
    *,
    checkpoint: Path | None = None,
    run: Executor | None = None,
) -> EnvelopeSet:
    """Learn one envelope from the data set's problems and S.

    ``progress`` gets generations done and in all.

    Arguments:
        run: the executor of every generation's solves; this process where None. The envelope and
            its provenance do not depend on it.
    """
    feasible, infeasible = scaled_by_label(dataset)
    if min(len(feasible), len(infeasible)) < 2:
        raise InvalidInput(
            f"data set: expected two or more rows of each label, got {len(feasible)} feasible and "
            f"{len(infeasible)} infeasible"
        )

    oracle = SpreadOracle([*feasible, *infeasible], run or processes(1))
    result = evolve(
        feasible,
        infeasible,
        dataset.points,
        settings,
        oracle=oracle,
        checkpoint=checkpoint,
        progress=progress,
    )
    provenance = {
        "method": "ga",
        "settings": asdict(settings),
        "rows": len(dataset),
        **dataset.origin,
        "notes": {
            "a": result.a,
            "b": result.b,
            "evaluations": result.counts.total,
            "cached": result.counts.cached,
            "best": [done.best for done in result.history],
            "mean": [done.mean for done in result.history],
            "variance": [done.variance for done in result.history],
        },
    }
    return EnvelopeSet.for_problems(
        dataset.problem_class, list(dataset.problems()), [result.envelope], provenance
    )
