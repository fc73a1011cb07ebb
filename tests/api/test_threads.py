"""Functions are what they look like: four threads at a time get, to the last bit, what one alone gets."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stancekit

THREADS, CALLS = 4, 50
LONG = {"plan": 2}
"""Calls of each thread to functions that take a second or more; ``test_plans…`` below is the whole of it."""


@pytest.fixture(autouse=True)
def _often() -> Iterator[None]:
    """Threads take turns after a tenth of a millisecond, not after five."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-4)
    yield
    sys.setswitchinterval(before)


@pytest.fixture(scope="module")
def rows(tmp_path_factory) -> stancekit.Dataset:
    return stancekit.label("ground-3", tmp_path_factory.mktemp("rows") / "a", feasible=12, infeasible=12)


def bits(answer: Any) -> Any:
    """What an answer says, as bytes that are equal only where every bit of it is; times are left out."""
    if isinstance(answer, stancekit.Outcome | stancekit.PlanOutcome):
        plan = answer.posture if isinstance(answer, stancekit.Outcome) else answer.plan
        parts = (answer.status.value, answer.lower_bound if isinstance(answer, stancekit.Outcome) else answer.objective)
        return (*parts, bits(plan), bits(answer.certificate))
    if isinstance(answer, stancekit.Posture | stancekit.Plan):
        return tuple(
            np.asarray(each).tobytes() for each in (answer.com_m, answer.rotation_rad, answer.toes_m, answer.forces_n)
        )
    if isinstance(answer, stancekit.Certificate):
        return pickle.dumps([np.asarray(each).tobytes() for each in answer.multipliers])
    if hasattr(answer, "p1_feasible"):
        return answer.p1_feasible, answer.p1_infeasible, tuple(answer.projected.items()), answer.gap
    if isinstance(answer, stancekit.EnvelopeSet):
        return tuple(each.to_vector().tobytes() for each in answer.envelopes)
    if isinstance(answer, stancekit.PostureProblem):
        return tuple((each.patch.vertices_m.tobytes(), each.patch.friction) for each in answer.contacts)
    if isinstance(answer, list):
        return tuple(map(bits, answer))
    return answer


def calls(rows: stancekit.Dataset, folder: Path) -> dict[str, Callable[[int], Any]]:
    """A call of each function by the number of the call."""
    problems = stancekit.sample("wall-3", 6, rng=4)
    outcomes = [stancekit.solve(problem) for problem in problems]
    proofs = [(p, o.certificate) for p, o in zip(problems, outcomes, strict=True) if o.certificate is not None]
    held = [(p, o.posture) for p, o in zip(problems, outcomes, strict=True) if o.posture is not None]
    assert proofs
    assert held
    selectors = [stancekit.fit(rows, "quantile", share=share) for share in (0.0, 0.1)]
    test = stancekit.label("ground-3", folder / "test", feasible=4, infeasible=4, seed=1)
    methods = ("exact", "lift", "two-stage")

    def saved(k: int) -> Any:
        path = folder / f"{k % 3}.json"
        stancekit.save(problems[k % 3], path)  # three files, which threads write over each other
        return stancekit.load(path)

    def labelled(k: int) -> Any:
        made = stancekit.label("ground-3", folder / f"label-{k}", feasible=1, infeasible=1, seed=k % 2)
        return list(made.problems())

    return {
        "sample": lambda k: stancekit.sample(("wall-3", "ground-3", "wall-5")[k % 3], 3, rng=k % 5),
        "solve": lambda k: stancekit.solve(problems[k % 6], methods[k % 3]),
        "verify": lambda k: stancekit.verify(*held[k % len(held)]).worst,
        "check": lambda k: stancekit.verify(*proofs[k % len(proofs)]).lower_bound,
        "explain": lambda k: stancekit.explain(*proofs[k % len(proofs)]).message,
        "evaluate": lambda k: stancekit.evaluate(selectors[k % 2], test, projections=("fix-p",)),
        "save and load": saved,
        "label": labelled,
        "fit": lambda k: stancekit.fit(rows, ("quantile", "heuristic")[k % 2]).envelopes,
    }


@pytest.mark.parametrize(
    "name", ["sample", "solve", "verify", "check", "explain", "evaluate", "save and load", "label", "fit"]
)
def test_threads_answer_as_one_alone_does(name, rows, tmp_path):
    call = calls(rows, tmp_path)[name]
    period = 30  # every call repeats after so many
    alone = [bits(call(1000 * period + k)) for k in range(period)]
    with ThreadPoolExecutor(THREADS) as pool:
        together = list(pool.map(lambda k: bits(call(k)), range(THREADS * CALLS)))
    assert len(together) == 200
    wrong = [k for k, answer in enumerate(together) if answer != alone[k % period]]
    assert not wrong


def test_plans_of_threads_are_those_of_one_alone():
    def planned(k: int) -> Any:
        return bits(stancekit.plan(("stairs", "walls")[k % 2], frames=2))

    alone = [planned(k) for k in range(2)]
    with ThreadPoolExecutor(THREADS) as pool:
        together = list(pool.map(planned, range(THREADS * LONG["plan"])))
    assert together == [alone[k % 2] for k in range(len(together))]


def test_a_file_is_run_once_however_many_threads_ask_for_it(tmp_path):
    path = tmp_path / "slow.py"
    path.write_text(
        "import time\nimport stancekit\ntime.sleep(0.05)\n\n\nclass Mine:\n"
        "    def sample(self, rng):\n        return stancekit.sample('ground-3', rng=3)[0]\n"
    )
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(lambda _: bits(stancekit.sample(f"{path}:Mine")), range(THREADS)))
    assert found == [found[0]] * THREADS
