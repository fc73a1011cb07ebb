"""What the tests of the command line share: the command itself, in this process, and small things
to feed it.
"""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stancekit.cli import console
from stancekit.cli.main import main
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.learners.data.labelling import label

PLAN = LabelPlan(distribution="wall-3", feasible=8, infeasible=8, shard_size=4, seed=2)


@dataclass(frozen=True, kw_only=True)
class Ran:
    """What a run of the command came to."""

    code: int
    out: str
    err: str

    @property
    def records(self) -> list[dict[str, Any]]:
        """Standard output, all of which has to be JSON objects, one a line."""
        records = [json.loads(line) for line in self.out.splitlines()]
        assert all(isinstance(record, dict) for record in records)
        return records


Command = Callable[..., Ran]


@pytest.fixture(autouse=True)
def _once(each_plan_is_timed_once: None, each_gait_is_written_once: None) -> None:
    """Also here."""


@pytest.fixture(autouse=True)
def _no_time_passes_between_lines_of_long_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a computer that does much else, quick work would say where it is, too."""
    monkeypatch.setattr(console, "time", SimpleNamespace(monotonic=lambda: 0.0))


@pytest.fixture
def stancekit(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Command:
    """``stancekit("solve", file, "--json")`` in an empty folder and 80 columns; ``stdin`` takes
    bytes.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)

    def call(*arguments: object, stdin: bytes = b"") -> Ran:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin)))
        capsys.readouterr()
        try:
            main([str(argument) for argument in arguments])
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        said = capsys.readouterr()
        return Ran(code=code, out=said.out, err=said.err)

    return call


@pytest.fixture
def refusal(stancekit: Command) -> Callable[..., str]:
    """The one line that the command refuses its input with: exit code 2, nothing on standard output,
    and no file that was not there, but Python's own of a module that it read.
    """

    def call(*arguments: object, stdin: bytes = b"") -> str:
        before = {*os.listdir(), "__pycache__"}
        ran = stancekit(*arguments, stdin=stdin)
        assert (ran.code, ran.out, set(os.listdir()) - before) == (2, "", set()), ran
        assert ran.err.count("\n") == 1, ran.err
        assert ran.err.startswith("stancekit: error: ")
        return ran.err.removeprefix("stancekit: error: ").removesuffix("\n")

    return call


@pytest.fixture(scope="session")
def sampled() -> dict[str, list[dict[str, Any]]]:
    """Twelve problems of every distribution; of wall-3 the first is feasible, the second not, the
    sixth trivially.
    """
    found = {}
    for name, source in DISTRIBUTIONS.items():
        rng = np.random.default_rng(1)
        found[name] = [source.sample(rng).to_json() for _ in range(12)]
    return found


@pytest.fixture
def problem(sampled: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """A feasible problem that may be spoilt."""
    return dict(json.loads(json.dumps(sampled["wall-3"][0])))


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., str]:
    """Write JSON lines (or one string, or bytes) into the folder of the test; returns the name."""

    def put(name: str, *items: Any) -> str:
        text = (
            items[0]
            if isinstance(items[0], str | bytes)
            else "".join(json.dumps(item) + "\n" for item in items)
        )
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return name

    return put


@pytest.fixture(scope="session")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of four shards, never to be changed."""
    folder = tmp_path_factory.mktemp("cli") / "labelled"
    label(PLAN, folder)
    return folder


@pytest.fixture(scope="session")
def envelopes(tmp_path_factory: pytest.TempPathFactory, labelled: Path) -> Path:
    """An envelope file learned for wall-3."""
    path = tmp_path_factory.mktemp("cli") / "heuristic.json"
    with pytest.raises(SystemExit) as end:
        main(["fit", str(labelled), "--method", "heuristic", "--out", str(path)])
    assert not end.value.code
    return path
