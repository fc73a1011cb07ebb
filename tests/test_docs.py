"""What the documents show is true: their Python runs, their problem is solved, their commands exist."""

import json
import re
from pathlib import Path

import pytest

from stancekit.cli.main import main
from stancekit.planners.answer.outcome import Status
from stancekit.planners.problem import PostureProblem
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.verify import check_posture

ROOT = Path(__file__).parent.parent
BLOCK = re.compile(r"```(\w+)\n(.*?)```", re.DOTALL)
README = BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))
FORMATS = BLOCK.findall((ROOT / "docs" / "formats.md").read_text(encoding="utf-8"))


@pytest.mark.parametrize("code", [text for language, text in README if language == "python"])
def test_python_in_the_readme_runs_and_prints(
    code: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out.strip()


def test_the_training_loop_of_the_learning_page_runs_and_is_short(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")
    (code,) = (text for language, text in BLOCK.findall(page) if language == "python")
    loop = code.partition("def learned")[2].partition("# try it")[0]
    assert len([line for line in loop.splitlines() if line.strip()]) <= 20
    exec(compile(code, "learning.md", "exec"), {})
    assert capsys.readouterr().out.endswith("weights\n")


def test_the_readme_shows_python_and_commands() -> None:
    languages = [language for language, _ in README]
    assert languages.count("python") >= 2
    assert languages.count("sh") >= 2


def test_the_problem_in_the_formats_page_is_one_that_the_planner_reads_and_answers() -> None:
    examples = [json.loads(text) for language, text in FORMATS if language == "json"]
    assert examples
    for example in examples:
        problem = PostureProblem.from_json(example)
        outcome = ExactPlanner().solve(problem)
        assert outcome.status is not Status.UNDECIDED
        assert outcome.posture is None or check_posture(problem, outcome.posture).accepted


def test_every_verb_in_the_readme_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    lines = [line for language, text in README if language == "sh" for line in text.splitlines()]
    verbs = {line.split()[1] for line in lines if line.startswith("stancekit ")}
    assert len(verbs) >= 7
    for verb in sorted(verbs):
        with pytest.raises(SystemExit) as stop:
            main([verb, "--help"])
        assert stop.value.code == 0
        assert "usage: stancekit" in capsys.readouterr().out
