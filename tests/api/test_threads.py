"""Functions are what they look like: four threads at a time get, to the last bit, what one alone
gets.
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit import walks
from stancekit.planners.errors import interruptible
from tests.refusals import assert_names, refuses
from tests.threads import FILE, PERIOD, Call, calls, digest

ROOT = Path(__file__).resolve().parents[2]
THREADS, CALLS = 4, 8
FEWER = {
    "plan": 2,
    "verify a plan": 2,
    "explain": 2,
    "explain a course": 3,
    "label": 2,
    "evaluate": 3,
    "fit quantile": 3,
    "fit gmm": 2,
}
"""Calls of each thread to functions that take long; ``benchmarks/threads.py`` has all of them."""
REPEATS = {"label": 2, "evaluate": 2, "verify a plan": 2} | dict.fromkeys(
    ("plan", "explain", "explain a course", "fit quantile", "fit gmm"), 3
)
"""Calls after which a function that takes long is asked the same again; ``PERIOD`` for others."""
NAMES = (
    "sample",
    "solve",
    "plan",
    "verify",
    "verify a proof",
    "verify a plan",
    "explain",
    "explain a course",
    "label",
    "evaluate",
    "load",
    "save",
    "fit quantile",
    "fit gmm",
    "sample by a file",
)


@pytest.fixture(autouse=True)
def _often() -> Iterator[None]:
    """Threads take turns after a tenth of a millisecond, not after five."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-4)
    yield
    sys.setswitchinterval(before)


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Call]:
    return calls(tmp_path_factory.mktemp("calls"))


def test_all_functions_are_asked(asked):
    assert set(asked) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_threads_answer_as_one_alone_does(name, asked):
    call, count, period = asked[name], THREADS * FEWER.get(name, CALLS), REPEATS.get(name, PERIOD)
    alone = [digest(call(1000 * PERIOD + k)) for k in range(min(period, count))]
    with ThreadPoolExecutor(THREADS) as pool:
        together = list(pool.map(lambda k: digest(call(k)), range(count)))
    assert len(together) == count
    assert [k for k, answer in enumerate(together) if answer != alone[k % period]] == []


def test_children_that_are_forked_off_while_threads_work_answer_as_one_alone_does():
    command = [
        sys.executable,
        "benchmarks/threads.py",
        "--calls",
        "3",
        "--only",
        "solve",
        "fit quantile",
        "--json",
    ]
    done = subprocess.run(
        command, cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(done.stdout.splitlines()) == 2


def test_a_file_is_run_once_however_many_threads_ask_for_it(tmp_path):
    path = tmp_path / "slow.py"
    path.write_text(f"import time\ntime.sleep(0.05)\n{FILE}")
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(
            pool.map(lambda _: digest(stancekit.sample(f"{path}:Mine", rng=1)), range(THREADS))
        )
    assert found == [found[0]] * THREADS


def test_a_walk_that_is_interrupted_ends_at_the_next_iteration(monkeypatch):
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    before, plan_walk, iterations = signal.getsignal(signal.SIGINT), walks.plan_walk, []

    def struck(task, *, progress, **options):
        def at(*where):
            if not iterations:
                signal.raise_signal(signal.SIGINT)
            iterations.append(where)
            return progress(*where)

        return plan_walk(task, progress=at, **options)

    monkeypatch.setattr(walks, "plan_walk", struck)
    with pytest.raises(KeyboardInterrupt):
        stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled")
    assert len(iterations) < 5
    assert signal.getsignal(signal.SIGINT) is before


def test_the_first_signal_is_noted_and_the_second_one_raises():
    with interruptible(signal.SIGINT) as interrupted:
        assert not interrupted()
        signal.raise_signal(signal.SIGINT)
        assert interrupted()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_outside_the_main_thread_nothing_is_noted_and_nothing_raised():
    found = []

    def inside() -> None:
        with interruptible(signal.SIGINT) as interrupted:
            found.append(interrupted())

    thread = threading.Thread(target=inside)
    thread.start()
    thread.join()
    assert found == [False]


@pytest.fixture
def level():
    return stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)


def test_plans_walks_and_labels_say_how_far_they_are(caplog, level, tmp_path):
    caplog.set_level(logging.INFO, logger="stancekit")
    stancekit.plan("walls", frames=2)
    stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled")
    stancekit.label("wall-3", tmp_path / "rows", rows=4)
    said = [record.getMessage() for record in caplog.records]
    beginnings = (
        "plan: contacts with 80 % of the friction: feasible",
        "plan: accepted",
        "walk: decoupled, feasible: ",
    )
    for beginning in (*beginnings, "label: 1 of 1 shards, 4 rows of "):
        assert any(line.startswith(beginning) for line in said), said


def test_a_walk_of_so_many_iterations_is_the_same_again(level):
    asked = {"duration_s": 2.0, "chart": "decoupled", "time_limit_s": 1e6}
    walks = [
        stancekit.walk(level, (0.4, 0.0), total_iterations=most, **asked) for most in (2, 2, 60)
    ]
    counts = [walk.details["iterations"] for walk in walks]
    assert counts[0] == counts[1] < counts[2] <= 60 + 1
    again = stancekit.walk(level, (0.4, 0.0), total_iterations=60, **asked)
    assert again.solution.digest == walks[2].solution.digest
    with refuses("total_iterations"):
        stancekit.walk(level, (0.4, 0.0), total_iterations=0)


def test_limits_of_solves_are_settings_of_methods():
    problem = stancekit.sample("wall-3", rng=8)[0]
    assert (
        stancekit.solve(problem, stancekit.Exact(max_solves=50)).status
        is stancekit.Status.INFEASIBLE
    )
    outcome = stancekit.plan(
        "tube", stancekit.Exact(gap=1e-6, max_solves=2), frames=4, time_limit_s=1e6
    )
    assert_names(outcome.message, "limit", "2 solves")
    assert stancekit.plan("walls", stancekit.TwoStage(max_solves=40), frames=3).report.accepted
    with refuses("max_solves"):
        stancekit.Exact(max_solves=-1)
    with refuses("max_solves"):
        stancekit.solve(problem, stancekit.TwoStage(max_solves=4))
