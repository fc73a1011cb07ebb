"""``stancekit about``: what it prints for a person, and as one object."""

import json
import re
from pathlib import Path

import pytest

from stancekit.cli.about import DOCUMENTED_S, About
from stancekit.cli.main import run
from stancekit.planners.equilibrium import yardstick
from stancekit.planners.errors import install_command
from stancekit.runner import acceptance

ROOT = Path(__file__).parents[2]


def test_it_says_what_is_missing_and_the_command_for_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(yardstick, "yardstick", lambda: 2.0 * DOCUMENTED_S)
    monkeypatch.setattr(acceptance, "extras", lambda: ["viz"])
    monkeypatch.setattr(
        acceptance, "versions", lambda extra: {"numpy": "2.0"} if extra is None else {"mcap": None}
    )
    assert run(About()) == 0
    said = capsys.readouterr().out
    assert f"viz        {install_command('viz')}  (without mcap)" in said
    assert "CPU-s, 2.00 times the" in said


def test_with_json_it_is_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(About(measure=False, json=True)) == 0
    (line,) = capsys.readouterr().out.splitlines()
    found = json.loads(line)
    assert found["solves_s"] is None
    assert found["cores"] >= 1
    assert found["documented_s"] == DOCUMENTED_S


def test_the_documentation_has_the_figure_that_computers_are_compared_with() -> None:
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    (seconds,) = re.findall(r"1,000 cold solves take ([\d.]+) CPU-s", page)
    assert float(seconds) == DOCUMENTED_S


def test_the_issue_template_asks_for_it() -> None:
    assert "stancekit about" in (ROOT / ".github" / "ISSUE_TEMPLATE" / "bug.yaml").read_text(
        encoding="utf-8"
    )
