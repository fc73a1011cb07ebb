"""Boxes that descend P1's margins: the gradient is the loss's own, the loss is what it says, and
boxes get better.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stancekit.envs.data.dataset import Dataset
from stancekit.learners.selectors.genetic import (
    BoxDescent,
    BoxFit,
    clustered_boxes,
    fit_gradient,
    margins,
    smooth_mistakes,
    soft_least,
)
from stancekit.learners.selectors.selector import quantile_box
from stancekit.learners.training.loop import Checkpoint, run
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.envelope import Envelope
from tests.refusals import refuses


@pytest.fixture(scope="module")
def dataset(labelled: Callable[..., Dataset]) -> Dataset:
    return labelled(60, 60, 21)


@pytest.fixture(scope="module")
def problems(dataset: Dataset) -> tuple[list[Scaled], list[Scaled]]:
    """Feasible and infeasible ones."""
    rows = (dataset.feasible, dataset.infeasible)
    kinds = [
        [Scaled.of(problem) for problem in dataset.select(chosen).problems()] for chosen in rows
    ]
    return kinds[0], kinds[1]


def mistakes(
    boxes: list[Envelope], kinds: tuple[list[Scaled], list[Scaled]], programs: Programs
) -> float:
    """Mean of the shares of both kinds that P1 over the set answers wrong."""
    least = [
        np.min([margins(problems, box, programs) for box in boxes], axis=0) for problems in kinds
    ]
    return 0.5 * (float((least[0] > 1e-7).mean()) + float((least[1] <= 1e-7).mean()))


@pytest.mark.parametrize("boxes", [1, 3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_loss_is_a_logistic_count_and_its_gradient_that_of_finite_differences(
    boxes: int,
    sign: float,
    dataset: Dataset,
    problems: tuple[list[Scaled], ...],
    programs: Programs,
) -> None:
    scenes, softness, step = problems[int(sign < 0)][:8], 0.02, 2e-5
    start = np.stack(
        [box.to_vector() for box in clustered_boxes(dataset.points, boxes, share=0.1, seed=0)]
    )

    def loss(bounds: np.ndarray) -> float:
        each = np.stack([margins(scenes, Envelope.from_vector(row), programs) for row in bounds])
        least = -softness * np.log(np.mean(np.exp(-each / softness), axis=0))
        return float(np.mean(1.0 / (1.0 + np.exp(-sign * least / softness))))

    value, slope = smooth_mistakes(
        [Envelope.from_vector(row) for row in start], scenes, sign, programs, softness=softness
    )
    assert value == pytest.approx(loss(start), rel=1e-9)
    rng = np.random.default_rng(3)
    for _ in range(4):
        way = rng.normal(size=start.shape)
        by_differences = (loss(start + step * way) - loss(start - step * way)) / (2.0 * step)
        assert float(np.sum(slope * way)) == pytest.approx(by_differences, rel=0.02, abs=2e-3)
    assert np.abs(slope).max() > 0.01


def test_the_soft_least_is_the_least_of_one_and_close_to_the_least_of_several() -> None:
    values, softness, step = np.array([0.3, -0.1, 0.05]), 0.02, 1e-6
    least, shares = soft_least(values, softness)
    assert values.min() <= least <= values.min() + softness * np.log(3.0)
    by_differences = [
        (soft_least(values + step * e, softness)[0] - soft_least(values - step * e, softness)[0])
        / (2.0 * step)
        for e in np.eye(3)
    ]
    np.testing.assert_allclose(shares, by_differences, atol=1e-6)
    assert soft_least(values[:1], softness) == (0.3, 1.0)


def test_one_box_descends_the_same_every_time_and_from_its_checkpoint(
    dataset: Dataset,
    problems: tuple[list[Scaled], list[Scaled]],
    programs: Programs,
    tmp_path: Path,
) -> None:
    start, settings = quantile_box(dataset.points), BoxDescent(steps=4, batch=10)
    message: list[int] = []
    kept = Checkpoint(path=tmp_path / "kept.npz", about={"seed": 5})
    alone, again = (
        BoxFit((start,), *problems, programs, np.random.default_rng(5), settings) for _ in range(2)
    )
    losses = run(alone, lambda done, _: message.append(done), kept)
    assert (message, run(again, None, kept)) == ([1, 2, 3, 4], losses)  # nothing is left to do
    np.testing.assert_array_equal(alone.state()["bounds"], again.state()["bounds"])


def test_descent_makes_fewer_mistakes_than_where_it_started(
    dataset: Dataset, problems: tuple[list[Scaled], list[Scaled]], programs: Programs
) -> None:
    starts = list(clustered_boxes(dataset.points, 2, share=0.2, seed=0))
    found = fit_gradient(dataset, boxes=2, steps=20, batch=30, share=0.2, seed=0)
    before, after = (
        mistakes(starts, problems, programs),
        mistakes(list(found.envelopes), problems, programs),
    )
    assert after <= 0.7 * before
    losses = found.provenance["notes"]["losses"]
    assert np.mean(losses[-5:]) < np.mean(losses[:5])


def test_a_fit_repeats_to_the_last_bit_and_says_how_it_was_made(dataset: Dataset) -> None:
    message: list[tuple[int, int]] = []
    fits = [
        fit_gradient(
            dataset,
            boxes=2,
            steps=3,
            batch=8,
            seed=4,
            progress=lambda *counts: message.append(counts),
        )
        for _ in range(2)
    ]
    assert fits[0].to_json() == fits[1].to_json()
    assert fits[0].provenance["settings"]["boxes"] == len(fits[0].envelopes) == 2
    assert message == [(1, 3), (2, 3), (3, 3)] * 2
    other = fit_gradient(dataset, boxes=2, steps=3, batch=8, seed=5)
    assert other.to_json()["envelopes"] != fits[0].to_json()["envelopes"]


def test_what_cannot_be_fitted_is_refused_in_one_line(dataset: Dataset) -> None:
    with refuses("boxes"):
        fit_gradient(dataset, boxes=0)
    with refuses("steps"):
        fit_gradient(dataset, steps=0)
    with refuses("data set"):
        fit_gradient(dataset.select(dataset.feasible))
