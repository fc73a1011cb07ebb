"""What ``fit`` returns and what a file defines is copied and pickled, also to processes that have
not run the file.
"""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit.envs.data.dataset import scenes_of
from stancekit.learners.data.executors import processes
from stancekit.learners.evaluation.evaluate import evaluate
from stancekit.learners.selectors.selector import load_selector
from stancekit.planners.errors import StancekitError
from tests.refusals import refuses

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
    "chooser": {"boxes": 2, "steps": 2, "chooser": {"epochs": 1}},
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


@pytest.mark.parametrize("name", ["own", "quantile", "chooser", "neural"])
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
