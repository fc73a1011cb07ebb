"""The bench: every row from held-out terrains, nothing done twice, nothing reused that does not
belong together.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from stancekit.configs import config_path
from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.learners.data.executors import processes
from stancekit.learners.evaluation import evaluate as bench
from stancekit.learners.evaluation.evaluate import ClassResult, Experiment, evaluate
from stancekit.learners.selectors.selector import load_selector
from stancekit.learners.training.fitting import METHODS
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import validated
from stancekit.planners.formats.question_file import read_envelopes
from tests.refusals import refuses

PLAN: dict[str, Any] = {
    "problems": ["wall-3"],
    "train": {"feasible": 12, "infeasible": 12, "seed": 0},
    "test": {"feasible": 8, "infeasible": 8, "seed": 1},
    "methods": ["heuristic", "quantile", "ga"],
    "projections": ["fix-p", "scp"],
    "fit": {"genetic": {"population": 4, "generations": 2, "terrains": 4}},
}


def run(plan: dict[str, Any], folder: Path) -> ClassResult:
    (result,) = bench.run(validated(Experiment, plan, "plan"), folder, executor=processes(1))
    return result


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ClassResult]:
    folder = tmp_path_factory.mktemp("bench")
    return folder, run(PLAN, folder)


def test_there_is_a_row_a_method_and_one_of_the_lift(made: tuple[Path, ClassResult]) -> None:
    _, result = made
    assert [score.selector for score in result.scores] == ["heuristic", "quantile", "ga", "lift"]
    assert result.fresh == ("heuristic", "quantile", "ga", "lift")
    assert all((s.p1_feasible.of, s.p1_infeasible.of) == (8, 8) for s in result.scores)
    assert [*result.scores[0].projected] == ["fix-p", "scp"]


def test_rows_are_those_of_an_evaluation_of_the_kept_files_on_the_kept_test_set(
    made: tuple[Path, ClassResult],
) -> None:
    folder, result = made
    scenes = scenes_of(Dataset.open(folder / "wall-3" / "test"))
    for score in result.scores[:3]:
        learned = load_selector(folder / "wall-3" / f"{score.selector}.json")
        again = evaluate(
            score.selector, learned, scenes, problem_class="wall-3", projections=("fix-p", "scp")
        )
        assert (again.p1_feasible, again.p1_infeasible, again.projected) == (
            score.p1_feasible,
            score.p1_infeasible,
            score.projected,
        )


def test_more_rows_methods_and_classes_are_expected_to_take_longer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bench, "yardstick", lambda solves: 2e-3 * solves)
    plans = [
        validated(Experiment, PLAN | more, "plan")
        for more in (
            {},
            {"train": PLAN["train"] | {"feasible": 9000}},
            {"problems": ["wall-3", "wall-5"]},
        )
    ]
    first, *others = (bench.expected_s(plan) for plan in plans)
    assert 0.0 < 1.5 * first < min(others)
    assert bench.expected_s(plans[1], workers=4) < 0.5 * others[0]


def test_nothing_is_learned_from_the_test_set(made: tuple[Path, ClassResult]) -> None:
    folder, _ = made
    train, test = (Dataset.open(folder / "wall-3" / part) for part in ("train", "test"))
    assert train.header.digest != test.header.digest
    for name in ("quantile", "ga"):
        assert (
            read_envelopes(folder / "wall-3" / f"{name}.json").provenance["dataset"]
            == train.header.digest
        )
    drawn = {json.dumps(problem.to_json()) for problem in train.problems()}
    assert not drawn & {json.dumps(problem.to_json()) for problem in test.problems()}


def test_a_second_run_reuses_everything_and_says_the_same(made: tuple[Path, ClassResult]) -> None:
    folder, first = made
    before = {
        path: path.stat().st_mtime_ns for path in (folder / "wall-3").rglob("*") if path.is_file()
    }
    second = run(PLAN, folder)
    assert second.fresh == ()
    assert [replace(s, gap=0.0) for s in second.scores] == [
        replace(s, gap=0.0) for s in first.scores
    ]
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_what_changed_is_done_again_and_nothing_else(made: tuple[Path, ClassResult]) -> None:
    folder, _ = made
    other = PLAN | {"fit": {"share": 0.1, **PLAN["fit"]}}
    assert run(other, folder).fresh == ("quantile",)
    (folder / "wall-3" / "ga.json").write_text("{}")  # not what was learned
    assert run(other, folder).fresh == ("ga",)
    assert read_envelopes(folder / "wall-3" / "ga.json").provenance["method"] == "ga"
    (folder / "wall-3" / "heuristic.row.json").write_text("{")
    assert run(other, folder).fresh == ("heuristic",)
    assert run(other | {"projections": ["scp"]}, folder).fresh == (
        "heuristic",
        "quantile",
        "ga",
        "lift",
    )


def test_a_folder_with_other_data_is_refused(made: tuple[Path, ClassResult]) -> None:
    folder, _ = made
    with refuses("train/header.json", "feasible"):
        run(PLAN | {"train": {"feasible": 13, "infeasible": 12, "seed": 0}}, folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"method": ["ga"]}, "plan: method: unknown key"),
        ({"methods": ["luck"]}, "plan: methods[0]: "),
        ({"methods": []}, "plan: methods: expected one or more, got none"),
        (
            {"test": {"feasible": 1, "infeasible": 1, "seed": 0}},
            "plan: test.seed: expected another seed than train",
        ),
        (
            {"calibration": {"feasible": 1, "infeasible": 1, "seed": 1}},
            "plan: calibration.seed: expected another seed",
        ),
        (
            {"problems": ["moon"]},
            "plan: distribution: expected one of ground-3, wall-3, wall-5, "
            "another ground-k, wall-k or terrain-k, a YAML file, or FILE.py:NAME, got",
        ),
        ({"fit": {"shar": 0.1}}, "plan: fit.shar: unknown key"),
        ({"fit": {"share": 0.9}}, "plan: fit.share: expected less than 0.5, got 0.9"),
        (
            {"fit": {"genetic": {"delta": 3.0}}},
            "plan: genetic.delta: expected less than 1, got 3.0",
        ),
        ({"train": {"feasible": "many", "infeasible": 1, "seed": 0}}, "plan: train.feasible: "),
    ],
)
def test_plans_that_make_no_sense_are_told_by_key(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput) as error:
        validated(Experiment, PLAN | changes, "plan")
    assert str(error.value).startswith(message)


@pytest.mark.parametrize("quick", [False, True])
def test_the_configuration_that_comes_with_the_package_has_every_method_and_class(
    quick: bool,
) -> None:
    experiment = Experiment.from_yaml(config_path("bench-envelopes.yaml"), quick=quick)
    assert set(experiment.methods) == set(METHODS.names()) - {"modes"}
    assert set(experiment.problems) == {"ground-3", "wall-3", "wall-5"}
    assert quick or min(experiment.test.feasible, experiment.test.infeasible) >= 500
    assert set(Experiment.from_yaml(config_path("bench-joint.yaml")).problems) == set(
        experiment.problems
    )


def test_a_file_without_a_quick_section_has_no_quick_run(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(yaml.safe_dump(PLAN))
    assert Experiment.from_yaml(path).methods == ("heuristic", "quantile", "ga")
    with refuses("plan.yaml", "quick"):
        Experiment.from_yaml(path, quick=True)
    path.write_text("- 1")
    with refuses("plan.yaml"):
        Experiment.from_yaml(path)
