"""Scores that ship are those of their cards: the file, its class, about the figures; they go by
name everywhere.
"""

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from stancekit.envs.leap_choice import LeapChoiceEnv
from stancekit.learners.evaluation.leap_bench import LeapBenchSettings, run
from stancekit.learners.leaps.policy import LeapScorer
from stancekit.learners.zoo import card_of, shipped
from tests.refusals import refuses

NAMES = list(shipped("scorers"))
CARDS = Path(__file__).parents[3] / "docs" / "cards.md"


def test_some_ship_and_are_small():
    assert NAMES == ["set-leap-hard"]
    assert sum(path.stat().st_size for path in shipped("scorers").values()) < 500_000


@pytest.mark.parametrize("name", NAMES)
def test_a_scorer_is_the_one_of_its_card(name):
    card, scorer = card_of(shipped("scorers")[name]), LeapScorer.read(name)
    assert hashlib.sha256(shipped("scorers")[name].read_bytes()).hexdigest() == card["sha256"]
    assert name == f"{card['method']}-{card['problem_class']}"
    origin = scorer.origin
    assert (origin["method"], origin["class"], origin["seed"]) == (
        "set",
        card["problem_class"],
        card["train"]["seed"],
    )
    assert (origin["settings"]["seed"], origin["rows"]) == (card["seed"], card["train"]["tries"])
    assert card["train"]["seed"] != card["test"]["seed"]
    for figure in card["figures"]:
        for middle, low, high in (figure["learned"], figure["control"], figure["gain"]):
            assert low <= middle <= high


@pytest.mark.parametrize("name", NAMES)
def test_first_tries_on_fresh_scenes_fare_as_the_card_says(name):
    """Of 20 scenes; what is 4 standard errors below the lower end of the card's interval would be
    another scorer.
    """
    env, scorer, solved = (
        LeapChoiceEnv(problem=card_of(shipped("scorers")[name])["problem_class"], tries=1),
        LeapScorer.read(name),
        0,
    )
    env.reset(seed=77)
    for _ in range(20):
        observation, _ = env.reset()
        solved += env.step(scorer.predict(observation)[0])[4]["is_success"]
    least = card_of(shipped("scorers")[name])["figures"][0]["learned"][1]
    assert solved / 20 >= least - 4.0 * np.sqrt(least * (1.0 - least) / 20)


@pytest.mark.parametrize("name", NAMES)
def test_the_page_of_cards_has_its_figures(name):
    rows = [
        line
        for line in CARDS.read_text(encoding="utf-8").splitlines()
        if line.startswith(f"| `{name}`")
    ]
    figures = card_of(shipped("scorers")[name])["figures"]
    assert len(rows) == len(figures)
    for row, figure in zip(rows, figures, strict=True):
        wanted = [
            *(100.0 * np.array(figure["learned"])),
            *(100.0 * np.array(figure["control"])),
            *figure["gain"],
        ]
        shown = [float(each.replace("−", "-")) for each in re.findall(r"[−+]?\d+\.\d", row)]
        assert figure["budget"] in row
        np.testing.assert_allclose(shown, wanted, atol=0.051)


@pytest.mark.parametrize("name", NAMES)
def test_scenes_that_it_learned_from_are_refused_as_a_test(name, tmp_path):
    settings = LeapBenchSettings(
        scenes=1,
        seed=card_of(shipped("scorers")[name])["train"]["seed"],
        methods=(name,),
        solves=1,
    )
    with refuses("seed"):
        run(settings, tmp_path)
    with refuses("set-moon"):
        LeapScorer.read("set-moon")
