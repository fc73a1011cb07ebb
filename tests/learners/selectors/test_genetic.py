"""Paper E's genetic algorithm: its operators, its repeatability, its checkpoints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.distributions.postures import distribution
from stancekit.learners.selectors.feasibility import CachingOracle, VerdictCounts
from stancekit.learners.selectors.genetic import (
    Generation,
    GeneticResult,
    GeneticSettings,
    Trials,
    breed,
    evolve,
    finish,
    first_generation,
    fit_genetic,
    fitness,
    ranking,
)
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick
from tests.learners.selectors.test_feasibility import Plain
from tests.refusals import refuses

SMALL = GeneticSettings(population=10, generations=5, terrains=20, finalists=3, seed=3)


@pytest.fixture(scope="module")
def dataset(labelled: Callable[..., Dataset]) -> Dataset:
    return labelled(40, 40, 5)


@pytest.fixture(scope="module")
def feasible(dataset: Dataset) -> list[Scaled]:
    return [Scaled.of(problem) for problem in dataset.select(dataset.feasible).problems()]


@pytest.fixture(scope="module")
def infeasible(dataset: Dataset) -> list[Scaled]:
    return [Scaled.of(problem) for problem in dataset.select(dataset.infeasible).problems()]


@pytest.fixture(scope="module")
def whole(
    dataset: Dataset, feasible: list[Scaled], infeasible: list[Scaled], programs: Programs
) -> GeneticResult:
    """One run, without interruption."""
    return evolve(
        feasible,
        infeasible,
        dataset.points,
        SMALL,
        oracle=CachingOracle([*feasible, *infeasible], programs),
    )


def outcome_of(history: tuple[Generation, ...]) -> list[tuple[float, ...]]:
    """What must not depend on how the verdicts were found."""
    return [
        (g.number, g.mean, g.variance, g.best, g.a, g.b, g.mutation_rate, g.evaluations)
        for g in history
    ]


def test_fitness_is_what_its_formula_says() -> None:
    settings = GeneticSettings(delta=0.1, penalty=2.0)
    a, b = np.array([0.2, 0.2, 0.0, 0.2]), np.array([0.0, 0.1, 0.3, 0.05])
    np.testing.assert_allclose(fitness(a, b, settings), [0.8, 0.8, 0.6, 0.8])
    assert ranking(a, b, settings).tolist() == [0, 3, 1, 2]


def test_the_mutation_rate_falls_from_start_to_end() -> None:
    settings = GeneticSettings(generations=11, mutation_start=0.5, mutation_end=0.005)
    rates = [settings.mutation_rate(k) for k in range(11)]
    assert (rates[0], rates[5], rates[10]) == pytest.approx((0.5, 0.05, 0.005))
    assert np.all(np.diff(rates) < 0.0)


def test_children_take_pairs_of_bounds_whole_from_their_parents() -> None:
    rng = np.random.default_rng(0)
    ranked = np.sort(rng.uniform(-1.0, 1.0, (12, 2, 3, 6)), axis=1)
    settings = GeneticSettings(population=12, elites=2)
    children = breed(ranked, np.ones((3, 6)), 1e-12, settings, rng)
    np.testing.assert_array_equal(children[:2], ranked[:2])
    sources = np.array(
        [
            [
                [
                    {
                        int(k)
                        for k in np.flatnonzero((ranked[:, :, n, d] == child[:, n, d]).all(axis=1))
                    }
                    for d in range(6)
                ]
                for n in range(3)
            ]
            for child in children
        ]
    )
    assert all(len(pair) == 1 for pair in sources.ravel())
    parents = [set.union(*child.ravel()) for child in sources[2:]]
    assert max(map(len, parents)) == 2
    assert min(map(len, parents)) >= 1


def test_as_many_pairs_are_mutated_as_the_rate_says() -> None:
    rng = np.random.default_rng(1)
    same = np.tile(np.stack([np.full((5, 6), -0.3), np.full((5, 6), 0.3)]), (200, 1, 1, 1))
    settings = GeneticSettings(population=200, elites=0, mutation_scale=0.1)
    children = breed(same, np.ones((5, 6)), 0.2, settings, rng)
    moved = children != same
    np.testing.assert_array_equal(
        moved[:, 0], moved[:, 1]
    )  # a pair is moved at both ends or not at all
    assert moved[:, 0].mean() == pytest.approx(0.2, abs=4.0 * np.sqrt(0.2 * 0.8 / 6000))
    assert (children - same)[moved].std() == pytest.approx(0.1, rel=0.1)
    assert np.all(children[:, 0] <= children[:, 1])


def test_the_first_generation_holds_boxes_around_solutions(dataset: Dataset) -> None:
    points = dataset.points
    boxes = first_generation(points, 50, np.random.default_rng(2))
    held = np.array([Envelope(low=low, high=high).contains(points).sum() for low, high in boxes])
    assert held.min() >= 2
    assert held.max() > 0.5 * len(points)


def test_the_shares_are_what_solving_every_problem_says(
    feasible: list[Scaled], infeasible: list[Scaled], programs: Programs, whole: GeneticResult
) -> None:
    admitted = [
        [programs.get(McCormick, p.layout).solve(p, whole.envelope).feasible for p in problems]
        for problems in (feasible, infeasible)
    ]
    assert whole.a == pytest.approx(np.mean(admitted[1]))
    assert whole.b == pytest.approx(1.0 - np.mean(admitted[0]))
    assert whole.balanced == pytest.approx(
        0.5 * (np.mean(admitted[0]) + 1.0 - np.mean(admitted[1]))
    )


def test_terrains_are_drawn_anew_half_of_each_label(
    feasible: list[Scaled], infeasible: list[Scaled], programs: Programs
) -> None:
    trials = Trials.of(
        feasible, infeasible, replace(SMALL, terrains=21), CachingOracle(feasible, programs)
    )
    rng = np.random.default_rng(0)
    draws = [trials.draw(rng) for _ in range(2)]
    for which in draws:
        assert ((which < 40).sum(), (which >= 40).sum()) == (11, 10)
        assert len(set(which.tolist())) == 21
    assert not np.array_equal(*draws)


def test_the_cache_changes_no_result(
    dataset: Dataset,
    feasible: list[Scaled],
    infeasible: list[Scaled],
    programs: Programs,
    whole: GeneticResult,
) -> None:
    oracle = Plain([*feasible, *infeasible], programs)
    plain = evolve(feasible, infeasible, dataset.points, SMALL, oracle=oracle)
    np.testing.assert_array_equal(plain.envelope.to_vector(), whole.envelope.to_vector())
    assert outcome_of(plain.history) == outcome_of(whole.history)
    assert plain.counts.solved == plain.counts.total == whole.counts.total == 5 * 10 * 20 + 3 * 80
    assert whole.counts.cached > 0.5 * whole.counts.total
    assert sum(g.cached for g in whole.history) < whole.counts.cached


def test_a_run_improves_on_its_first_generation(
    dataset: Dataset, feasible: list[Scaled], infeasible: list[Scaled], programs: Programs
) -> None:
    settings = GeneticSettings(population=12, generations=5, terrains=40, finalists=4, seed=3)
    result = evolve(
        feasible,
        infeasible,
        dataset.points,
        settings,
        oracle=CachingOracle([*feasible, *infeasible], programs),
    )
    trials = Trials.of(
        feasible, infeasible, settings, CachingOracle([*feasible, *infeasible], programs)
    )
    a, b = trials.shares(
        first_generation(dataset.points, 12, np.random.default_rng(3)), trials.all()
    )
    first = fitness(a, b, settings)
    assert fitness(np.array([result.a]), np.array([result.b]), settings)[0] > first.max()
    assert result.history[-1].mean > result.history[0].mean + 0.3
    assert result.history[-1].variance < result.history[0].variance


def test_of_the_finalists_the_fittest_that_keeps_to_delta_wins() -> None:
    class OnProgress:
        counts = VerdictCounts()

        def is_feasible(self, which: np.ndarray, boxes: list[Envelope]) -> np.ndarray:
            rows = {
                0.1: [1] * 8 + [0] * 2 + [0] * 10,
                0.2: [1] * 9 + [0] + [1] * 3 + [0] * 7,
            }  # b, a: .2, 0 and .1, .3
            return np.array([rows[round(float(box.high[0, 0]), 1)] for box in boxes], dtype=bool)

    boxes = np.stack([[np.zeros((3, 6)), np.full((3, 6), size)] for size in (0.1, 0.2)])
    trials = Trials(10, 10, OnProgress(), 4)
    chosen = {
        delta: float(
            finish(boxes, trials, GeneticSettings(delta=delta, penalty=2.0), []).envelope.high[0, 0]
        )
        for delta in (0.05, 0.1, 0.2)
    }
    assert chosen == {0.05: 0.1, 0.1: 0.2, 0.2: 0.1}


class Interrupted(Exception):
    pass


@pytest.mark.parametrize("stop", [0, 3])
def test_a_run_that_was_interrupted_ends_as_one_that_was_not(
    stop: int,
    tmp_path: Path,
    dataset: Dataset,
    feasible: list[Scaled],
    infeasible: list[Scaled],
    programs: Programs,
    whole: GeneticResult,
) -> None:
    def interrupt(done: int, _: int) -> None:
        if done == stop + 1:
            raise Interrupted

    def go(**more: Any) -> GeneticResult:
        oracle = CachingOracle([*feasible, *infeasible], programs)
        kept = tmp_path / "ga.npz"
        return evolve(
            feasible, infeasible, dataset.points, SMALL, oracle=oracle, checkpoint=kept, **more
        )

    with pytest.raises(Interrupted):
        go(progress=interrupt)
    resumed = go()
    np.testing.assert_array_equal(resumed.envelope.to_vector(), whole.envelope.to_vector())
    assert outcome_of(resumed.history) == outcome_of(whole.history)
    again = go()  # all generations are there: only the finalists are tested
    np.testing.assert_array_equal(again.envelope.to_vector(), whole.envelope.to_vector())
    assert again.counts.total == 3 * 80
    assert [path.name for path in tmp_path.iterdir()] == ["ga.npz"]


def test_another_checkpoint_is_refused(
    tmp_path: Path,
    dataset: Dataset,
    feasible: list[Scaled],
    infeasible: list[Scaled],
    programs: Programs,
) -> None:
    path = tmp_path / "ga.npz"
    short = replace(SMALL, generations=1, terrains=4, finalists=1)
    oracle = CachingOracle([*feasible, *infeasible], programs)

    def go(
        settings: GeneticSettings = short, points: np.ndarray = dataset.points, order: int = 1
    ) -> None:
        of = (feasible, infeasible[::order], points, settings)
        evolve(*of, oracle=oracle, checkpoint=path)

    go()
    for other in ({"settings": replace(short, seed=9)}, {"points": dataset.points[:-1]}):
        with refuses(path):
            go(**other)  # type: ignore[arg-type]
    with refuses(path):
        go(order=-1)
    content = path.read_bytes()
    for damaged in (content[: len(content) // 2], b""):
        path.write_bytes(damaged)
        with refuses(path):
            go()
    np.savez(path, header=np.array('{"format": "stancekit/fit/2"}'))
    with refuses(path, "format"):
        go()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"population": 1}, "population"),
        ({"terrains": 2.5}, "terrains"),
        ({"elites": 40}, "elites"),
        ({"delta": 1.0}, "delta"),
        (
            {"mutation_end": 0.5},
            "mutation_end",
        ),
        ({"mutation_scale": float("nan")}, "mutation_scale"),
    ],
)
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, Any], message: str) -> None:
    with refuses(message):
        GeneticSettings(**wrong)


def test_problems_of_one_label_only_are_refused(feasible: list[Scaled], dataset: Dataset) -> None:
    with refuses("problems"):
        evolve(feasible, [], dataset.points, SMALL)


def test_what_cannot_be_searched_is_refused(
    feasible: list[Scaled], infeasible: list[Scaled]
) -> None:
    with refuses("points"):
        evolve(feasible, infeasible, np.zeros((0, 3, 6)), SMALL)
    five = Scaled.of(distribution("wall-5").sample(np.random.default_rng(0)))
    with refuses():
        evolve(feasible, [five], np.zeros((1, 3, 6)), SMALL)


def test_fitting_a_data_set_says_how_it_was_done(dataset: Dataset, whole: GeneticResult) -> None:
    message: list[tuple[int, int]] = []
    found = fit_genetic(dataset, SMALL, lambda done, of: message.append((done, of)))
    np.testing.assert_array_equal(found.envelopes[0].to_vector(), whole.envelope.to_vector())
    assert message == [(k, 5) for k in range(1, 6)]
    assert found.problem_class == "wall-3"
    assert found.provenance["method"] == "ga"
    assert found.provenance["settings"]["terrains"] == 20
    assert found.provenance["notes"]["a"] == whole.a
    found.check_fits(next(dataset.problems()))
    with refuses():
        fit_genetic(dataset.select(dataset.feasible), SMALL)
