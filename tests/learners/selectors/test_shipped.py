"""What ships is what its card says: the file, its class, and about the figures."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from stancekit.configs import config_path
from stancekit.envs.distributions.postures import distribution
from stancekit.envs.scenes import SampledScenes
from stancekit.learners.evaluation.bench import Experiment
from stancekit.learners.evaluation.evaluate import evaluate
from stancekit.learners.selectors.selector import card, load_selector
from stancekit.learners.zoo import shipped
from tests.refusals import refuses

NAMES = list(shipped("selectors"))
SCENES = 30
CARDS = Path(__file__).parents[3] / "docs" / "cards.md"


def test_the_zoo_is_that_of_its_experiment_and_small() -> None:
    experiment = Experiment.from_yaml(config_path("zoo.yaml"))
    wanted = {
        f"{method}-{problem}" for method in experiment.methods for problem in experiment.problems
    }
    assert {"neural-wall-3", "neural-wall-5", "neural-ground-3"} <= wanted == set(NAMES)
    assert sum(path.stat().st_size for path in shipped("selectors").values()) < 5_000_000


@pytest.mark.parametrize("name", NAMES)
def test_a_selector_is_the_one_of_its_card(name: str) -> None:
    known, learned = card(name), load_selector(name)
    assert hashlib.sha256(shipped("selectors")[name].read_bytes()).hexdigest() == known.sha256
    assert name == f"{known.method}-{known.problem_class}"
    assert learned.problem_class == known.problem_class
    assert (
        tuple(known.legs) == tuple(distribution(known.problem_class).legs) == learned.selector.legs
    )  # type: ignore[attr-defined]
    assert len({known.train.seed, known.calibration.seed, known.test.seed}) == 3
    for figures in (known.figures, known.lift):
        assert list(figures) == ["p1_feasible", "p1_infeasible", "project_fix_p"]
        assert all(
            0.0 <= each.low <= each.share <= each.high + 1e-9 <= 1.0 + 1e-9
            for each in figures.values()
        )


@pytest.mark.parametrize("name", NAMES)
def test_fresh_scenes_fare_as_the_card_says(name: str) -> None:
    """Of 30 scenes; what is 4 standard errors below the lower end of the card's interval would be
    another selector.
    """
    known, source, rng = (
        card(name),
        SampledScenes(distribution(card(name).problem_class)),
        np.random.default_rng(77),
    )
    scenes = [source.draw(rng) for _ in range(SCENES)]
    score = evaluate(
        name, load_selector(name), scenes, problem_class=known.problem_class, projections=("fix-p",)
    )
    found = {
        "p1_feasible": score.p1_feasible,
        "p1_infeasible": score.p1_infeasible,
        "project_fix_p": score.projected["fix-p"],
    }
    for key, share in found.items():
        least = known.figures[key].low
        assert share.of > 5
        assert share.value >= least - 4.0 * np.sqrt(least * (1.0 - least) / share.of), key


def test_the_page_of_cards_has_their_figures() -> None:
    """As `python benchmarks/zoo.py --cards selectors` prints them."""
    rows = [
        line
        for line in CARDS.read_text(encoding="utf-8").splitlines()
        if line.startswith("| `neural-")
    ]
    assert [row.split("`")[1] for row in rows] == NAMES
    for name, row in zip(NAMES, rows, strict=True):
        said = re.findall(r"\| ([\d.]+) ± [\d.]+ \(lift ([\d.]+)\)", row)
        known = card(name)
        pairs = zip(known.figures.values(), known.lift.values(), strict=True)
        assert said == [
            (f"{100 * mine.share:.1f}", f"{100 * lift.share:.1f}") for mine, lift in pairs
        ]


def test_a_name_that_is_neither_a_file_nor_ships_is_refused() -> None:
    with refuses("neural-moon-3"):
        load_selector("neural-moon-3")
