"""Calls of every function that threads may call, and what is compared of their answers: every bit
that is no time.
"""

from __future__ import annotations

import dataclasses
import enum
import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import stancekit
from tests.doors import questions

PERIOD = 30
"""Every call repeats after so many: call k is call k + PERIOD."""
LONG_S = 600.0
"""No plan is cut short by the clock."""
FILE = """
import stancekit


class Mine:
    def sample(self, rng):
        return stancekit.sample("ground-3", rng=int(rng.integers(9)))[0]
"""
TIMES = {"seconds", "compile_s", "solver_s", "verifier_s", "fit_seconds", "p1_ms"}
"""Names of what is no part of an answer."""
Call = Callable[[int], Any]


def digest(answer: Any) -> str:
    """One text for answers that are equal to the last bit, and another one for others."""
    sha = hashlib.sha256()
    for part in parts(answer):
        sha.update(len(part).to_bytes(4, "big") + part)
    return sha.hexdigest()


def parts(answer: Any) -> Iterator[bytes]:
    """What an answer says, as bytes."""
    if isinstance(answer, np.ndarray | np.generic):
        yield f"{answer.dtype} {answer.shape}".encode()
        yield answer.tobytes()
    elif isinstance(answer, set | frozenset):
        yield repr(sorted(answer)).encode()
    elif isinstance(answer, enum.Enum | str | int | float | type | None):
        yield repr(answer).encode()
    elif isinstance(answer, Mapping):
        yield from each(answer)
    elif isinstance(answer, list | tuple):
        yield str(len(answer)).encode()
        for one in answer:
            yield from parts(one)
    elif dataclasses.is_dataclass(answer):
        yield type(answer).__name__.encode()
        yield from each(
            {field.name: getattr(answer, field.name) for field in dataclasses.fields(answer)}
        )
    else:
        raise TypeError(f"expected something with fields, got a {type(answer).__name__}")


def each(named: Mapping[str, Any]) -> Iterator[bytes]:
    """Names and values, but for times."""
    for name, value in named.items():
        if name not in TIMES:
            yield str(name).encode()
            yield from parts(value)


def calls(folder: Path) -> dict[str, Call]:
    """A call of each function by the number of the call, with files in this folder."""
    rows = stancekit.label("ground-3", folder / "rows", rows=(12, 12))
    test = stancekit.label("ground-3", folder / "test", rows=(4, 4), seed=1)
    selectors = [stancekit.fit(rows, "quantile", share=share) for share in (0.0, 0.1)]
    problems = [*stancekit.sample("wall-3", 5, rng=4), *stancekit.sample("ground-3", 5, rng=4)]
    outcomes = [stancekit.solve(problem) for problem in problems]
    refuted = [outcome for outcome in outcomes if outcome.certificate is not None]
    refuted = refuted[:3]  # a number that divides PERIOD
    of_proof = [outcome.certificate for outcome in refuted]
    held = [outcome.solution for outcome in outcomes if outcome.solution is not None][:3]
    asked = {question.name: question for question in questions()}
    dog = replace(asked["dog-0.48"], keys=asked["dog-0.48"].keys | {"frames": 4}).file(folder)
    assert len(refuted) == len(held) == 3
    for k in range(10):
        (folder / f"mine-{k}.py").write_text(FILE, encoding="utf-8")
    files = [folder / f"{k}.json" for k in range(len(problems))]
    for problem, path in zip(problems, files, strict=True):
        stancekit.save(problem, path)
    courses = [("stairs", 4), ("walls", 4), (dog, None)]

    def planned(k: int) -> Any:
        course, frames = courses[k % 3]
        return stancekit.plan(course, frames=frames, time_limit_s=LONG_S)

    @cache  # threads ask what one has asked before
    def kept(k: int) -> Any:
        plan = stancekit.plan(("stairs", "walls")[k], frames=4, time_limit_s=LONG_S).solution
        stancekit.save(plan, folder / f"plan-{k}.json")
        return plan

    @cache
    def proof(k: int) -> Any:
        return stancekit.plan(asked[("slick-2-0.05", "slick-3-0.1", "dog-0.7")[k]].file(folder))

    def loaded(k: int) -> Any:
        if k % 3:
            return stancekit.load(files[k % 10])
        kept(0)
        return stancekit.load(folder / "plan-0.json")

    def saved(k: int) -> Any:
        path = folder / f"saved-{k % 3}.json"
        stancekit.save(problems[k % 3], path)  # three files, which threads write over each other
        return path.read_text(encoding="utf-8")

    def labelled(k: int) -> Any:
        made = stancekit.label("ground-3", folder / f"label-{k}", rows=(1, 1), seed=k % 2)
        return [list(made.labels), list(made.problems())]

    return {
        "sample": lambda k: stancekit.sample(("wall-3", "ground-3", "wall-5")[k % 3], 3, rng=k % 5),
        "solve": lambda k: stancekit.solve(problems[k % 10], ("exact", "lift", "two-stage")[k % 3]),
        "plan": planned,
        "verify": lambda k: stancekit.verify(held[k % len(held)]),
        "verify a proof": lambda k: stancekit.verify(of_proof[k % len(of_proof)]),
        "verify a plan": lambda k: stancekit.verify(kept(k % 2)),
        "explain": lambda k: stancekit.explain(refuted[k % len(refuted)]),
        "explain a course": lambda k: stancekit.explain(proof(k % 3)),
        "label": labelled,
        "evaluate": lambda k: stancekit.evaluate(selectors[k % 2], test, projections=("fix-p",)),
        "load": loaded,
        "save": saved,
        "fit quantile": lambda k: (
            stancekit.fit(rows, "quantile", share=(0.0, 0.05, 0.1)[k % 3]).envelopes
        ),
        "fit gmm": lambda k: stancekit.fit(rows, "gmm", steps=2, seed=k % 3).envelopes,
        "sample by a file": lambda k: stancekit.sample(
            f"{folder}/mine-{k % 10}.py:Mine", 2, rng=k % 3
        ),
    }
