"""What ships is what its card says: the file, its class, and about the figures."""

from __future__ import annotations

import copy
import hashlib
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit.configs import config_path
from stancekit.envs.data.dataset import scenes_of
from stancekit.envs.distributions.postures import distribution
from stancekit.envs.scenes import SampledScenes
from stancekit.learners.data.executors import processes
from stancekit.learners.evaluation.evaluate import Experiment, evaluate
from stancekit.learners.selectors.selector import card, load_selector
from stancekit.learners.zoo import shipped
from stancekit.planners.errors import StancekitError
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


BOARD = '''
import numpy as np


class FrictionBox:
    """Forces bounded by what friction allows: a scene's own friction times the normal force."""

    def __init__(self, high=1.0):
        self.high = high

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        low, high = [], []
        for mu in np.atleast_1d(observation["friction"]):
            low += [-1, -1, -1, 0.0, -mu, -mu]
            high += [1, 1, 1, self.high, mu, mu]
        return np.array(low + high, np.float32), state


def friction_box(request):
    return FrictionBox(high=0.75)
'''


SHORT = {
    "gmm": {"steps": 2},
    "gmm-printed": {"time_limit_s": 5.0},
    "ga": {"genetic": {"population": 4, "generations": 1, "terrains": 4}},
    "gradient": {"steps": 2},
    "neural": {"neural": {"epochs": 1, "margin_epochs": 1}},
    "joint": {"neural": {"epochs": 1, "margin_epochs": 1}},
}
"""Settings with which a method is quick, and learns next to nothing."""
ALL = ["quantile", "heuristic", *SHORT, "own", "own by name", "shipped"]


@pytest.fixture(scope="module")
def rows(tmp_path_factory) -> stancekit.Dataset:
    return stancekit.label("ground-3", tmp_path_factory.mktemp("data") / "rows", rows=(6, 6))


@pytest.fixture
def board(tmp_path) -> Path:
    path = tmp_path / "board.py"
    path.write_text(BOARD)
    return path


def learned(name: str, rows: stancekit.Dataset, board: Path):
    if name == "own":
        return stancekit.fit(rows, f"{board}:friction_box")
    if name == "own by name":
        return load_selector(f"{board}:FrictionBox")
    if name == "shipped":
        return load_selector("neural-ground-3")
    return stancekit.fit(rows, name, **SHORT.get(name, {}))


@pytest.mark.parametrize("name", ALL)
def test_a_copy_answers_as_the_original_does(name, rows, board):
    one = learned(name, rows, board)
    seen = scenes_of(rows)[0].observation
    for other in (copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert np.array_equal(other.selector.predict(seen)[0], one.selector.predict(seen)[0])
        assert (other.problem_class, other.boxes, other.provenance) == (
            one.problem_class,
            one.boxes,
            one.provenance,
        )


READS = """
import pickle
import sys

import numpy as np

seen = dict(np.load("seen.npz"))
for name in sys.argv[1:]:
    with open(name + ".pickle", "rb") as file:
        print(pickle.load(file).selector.predict(seen)[0].tolist())
"""


def test_another_process_reads_the_pickles(rows, board, tmp_path):
    seen, predicted = scenes_of(rows)[0].observation, list[str]()
    for name in ALL:
        one = learned(name, rows, board)
        (tmp_path / f"{name}.pickle").write_bytes(pickle.dumps(one))
        predicted.append(str(one.selector.predict(seen)[0].tolist()))
    np.savez(tmp_path / "seen.npz", **seen)
    done = subprocess.run(
        [sys.executable, "-c", READS, *ALL],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert done.stdout.splitlines() == predicted


@pytest.mark.parametrize("name", ["own", "quantile", "neural"])
def test_a_selector_is_judged_in_workers_as_here(name, rows, board):
    one = learned(name, rows, board)
    scenes = scenes_of(rows) * 20  # more than one chunk
    given = {"problem_class": rows.problem_class, "projections": ("fix-p",)}
    here = evaluate("own", one, scenes, **given)
    there = evaluate("own", one, scenes, **given, run=processes(2))
    assert (here.p1_feasible, here.p1_infeasible) == (there.p1_feasible, there.p1_infeasible)
    assert here.projected == there.projected


class Unreadable:
    """A task that no other process can read."""

    def __reduce__(self):
        return int, ("no number",)

    def __call__(self) -> int:
        return 1


def test_a_task_that_a_worker_cannot_read_is_one_line():
    with refuses(kind=StancekitError):
        list(processes(2)([Unreadable(), Unreadable()]))
