"""Functions are what they look like: four threads at a time get, to the last bit, what one alone
gets.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import stancekit
from tests.threads import FILE, PERIOD, Call, calls, digest

ROOT = Path(__file__).resolve().parents[2]
THREADS, CALLS = 4, 15
FEWER = {
    "plan": 3,
    "verify a plan": 3,
    "explain": 4,
    "explain a course": 6,
    "label": 4,
    "evaluate": 6,
    "fit quantile": 6,
    "fit gmm": 3,
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
