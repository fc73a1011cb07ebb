"""Files: what is saved is what is loaded, by what it says that it is; anything else is one line."""

import ast
import dataclasses
import doctest
import inspect
import json
import subprocess
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit.configs import config_path
from stancekit.learners.selectors.selector import Learned
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.relaxation.boxes import Modes
from stancekit.planners.robot.model import Robot
from tests.refusals import refuses


@pytest.fixture(scope="module")
def problems() -> list[stancekit.Problem]:
    return stancekit.sample("wall-3", 9, rng=8)


@pytest.fixture(scope="module")
def envelopes(problems) -> stancekit.EnvelopeSet:
    box = stancekit.Envelope(low=np.full((3, 6), -0.5), high=np.full((3, 6), 0.5))
    return stancekit.EnvelopeSet.for_problems("wall-3", problems, [box, box.widened(0.1)])


@pytest.fixture(scope="module")
def plan(course_plan) -> stancekit.Motion:
    return course_plan("walls", 2)


def test_problems_come_back_one_or_several(problems, tmp_path):
    stancekit.save(problems[0], tmp_path / "p.json")
    assert stancekit.load(tmp_path / "p.json").to_json() == problems[0].to_json()
    stancekit.save(problems, tmp_path / "p.jsonl")
    assert [p.to_json() for p in stancekit.load(tmp_path / "p.jsonl", list)] == [
        p.to_json() for p in problems
    ]
    stancekit.save(problems[0], tmp_path / "one.jsonl")
    assert [p.to_json() for p in stancekit.load(tmp_path / "one.jsonl")] == [problems[0].to_json()]
    planned = stancekit.plan(tmp_path / "one.jsonl")  # a file of one posture, whatever it ends in
    assert planned.problem.frames == 1
    (tmp_path / "array.json").write_text(json.dumps([p.to_json() for p in problems]))
    assert len(stancekit.load(tmp_path / "array.json")) == 9


def test_envelopes_and_modes_come_back(envelopes, tmp_path):
    stancekit.save(envelopes, tmp_path / "e.json")
    assert stancekit.load(tmp_path / "e.json").to_json() == envelopes.to_json()
    stancekit.save(Learned.fixed("both", envelopes), tmp_path / "learned.json")
    assert (tmp_path / "learned.json").read_bytes() == (tmp_path / "e.json").read_bytes()
    modes = Modes(names=("ground", "wall"), boxes=envelopes)
    stancekit.save(modes, tmp_path / "m.json")
    assert stancekit.load(tmp_path / "m.json", Modes).to_json() == modes.to_json()


def test_plans_and_courses_come_back_and_a_plan_is_verified_as_it_is_written(plan, tmp_path):
    stancekit.save(plan, tmp_path / "plan.json")
    again = stancekit.load(tmp_path / "plan.json", stancekit.Motion)
    np.testing.assert_array_equal(again.forces_n, plan.forces_n)
    assert json.loads((tmp_path / "plan.json").read_text())["verified"]
    stancekit.save(plan.problem, tmp_path / "course.json")
    course = stancekit.load(tmp_path / "course.json", stancekit.Problem)
    assert (course.name, course.frames, course.stances) == (
        plan.problem.name,
        2,
        plan.problem.stances,
    )


def test_a_proof_comes_back_with_its_problem(problems, tmp_path):
    certificate = stancekit.solve(problems[0]).certificate
    stancekit.save(certificate, tmp_path / "proof.json")
    proof = stancekit.load(tmp_path / "proof.json", stancekit.Certificate)
    assert proof.refuted.to_json() == problems[0].to_json()
    assert stancekit.verify(proof).accepted
    np.testing.assert_array_equal(proof.multipliers, certificate.multipliers)


def test_a_walk_comes_back(tmp_path):
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    walk = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled").solution
    stancekit.save(walk, tmp_path / "walk.json")
    assert stancekit.load(tmp_path / "walk.json", stancekit.Motion).digest == walk.digest


def test_yaml_is_a_course_or_a_robot_and_a_folder_a_data_set(tmp_path):
    assert stancekit.load(config_path("courses/stairs.yaml"), stancekit.Problem).name == "stairs"
    assert stancekit.load(config_path("robots/anymal.yaml"), Robot).name == "anymal"
    stancekit.label("wall-3", tmp_path / "set", rows=(2, 2))
    rows = stancekit.load(tmp_path / "set", stancekit.Dataset)
    assert len(rows) == 4
    assert stancekit.verify(rows).accepted


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("x.json", '{"format": "stancekit/luck/1"}', "expected a format of stancekit/posture, "),
        ("x.json", "3", "expected a format of stancekit/posture, "),
        ("x.json", "{", "broken at line 1 column 2"),
        ("x.jsonl", '{"format": 3}\n{"format": 4}\n', "format: "),
        ("x.safetensors", "nothing", "expected a whole safetensors file, got something else"),
        ("x.yaml", "terrain: 3\n", "terrain: "),
    ],
)
def test_what_is_none_of_ours_is_one_line(name, content, words, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(stancekit.InvalidInput) as error:
        stancekit.load(tmp_path / name)
    assert words in str(error.value)
    assert str(tmp_path / name) in str(error.value)
    assert "\n" not in str(error.value)


def test_another_kind_than_was_asked_for_is_refused(plan, tmp_path):
    stancekit.save(plan, tmp_path / "plan.json")
    with refuses("plan.json"):
        stancekit.load(tmp_path / "plan.json", stancekit.Problem)
    with refuses("thing"):
        stancekit.save(3, tmp_path / "x.json")


def test_an_answer_is_written_with_its_own_report_or_its_certificate(problems, tmp_path):
    answer = stancekit.plan("stairs", frames=2)
    stancekit.save(answer, tmp_path / "plan.json")
    assert json.loads((tmp_path / "plan.json").read_text())["verdict"] == answer.report.to_json()
    assert stancekit.verify(tmp_path / "plan.json").accepted
    refuted = next(each for each in map(stancekit.solve, problems) if each.certificate is not None)
    stancekit.save(refuted, tmp_path / "proof.json")
    assert stancekit.verify(stancekit.load(tmp_path / "proof.json")).accepted
    nothing = dataclasses.replace(answer, status=stancekit.Status.UNDECIDED, solution=None)
    with refuses("x.json"):
        stancekit.save(nothing, tmp_path / "x.json")


def test_what_is_no_answer_and_answers_of_another_question_are_refused(problems, plan):
    with refuses("subject", "Problem"):
        stancekit.verify(problems[0])
    with refuses("plan"):
        stancekit.draw(plan, stancekit.solve(stancekit.sample("ground-3", rng=3)[0]).solution)


def test_a_posture_has_a_file_and_is_not_run(tmp_path):
    posture = stancekit.solve(stancekit.sample("ground-3", rng=3)[0]).solution
    stancekit.save(posture, tmp_path / "a.json")
    assert stancekit.load(tmp_path / "a.json", stancekit.Motion).digest == posture.digest
    assert stancekit.verify(tmp_path / "a.json").accepted
    for name, call in (
        (
            "film",
            lambda: stancekit.film(posture, tmp_path / "a.mp4"),
        ),
        (
            "posture",
            lambda: stancekit.simulate(posture),
        ),
        (
            "draw",
            lambda: stancekit.draw(posture, posture),
        ),
    ):
        with refuses(name):
            call()


def test_a_doubt_in_a_file_is_one_line_whatever_is_in_it(plan, tmp_path):
    asked = dataclasses.replace(plan.problem, doubts=("mended\naccepted",))
    doubted = dataclasses.replace(plan, problem=asked)
    stancekit.save(doubted, tmp_path / "a.json")
    quick = stancekit.RunSettings(timing=Timing().at_pace(4.0), check_limits=False)
    for said in (
        stancekit.verify(tmp_path / "a.json").report,
        stancekit.simulate(doubted, settings=quick),
        stancekit.run(doubted, policy="lift", settings=quick),
        stancekit.export(doubted, tmp_path / "a.csv"),
    ):
        assert said.doubts == ("mended accepted",)


def test_a_certificate_knows_what_it_is_a_proof_of(problems):
    answer = stancekit.solve(problems[0])
    certificate = answer.certificate
    assert certificate.problem is answer.problem is problems[0]
    assert stancekit.explain(certificate) == stancekit.explain(answer)
    assert stancekit.verify(certificate).digest == stancekit.verify(answer).digest
    read = stancekit.Certificate.from_json(certificate.to_json())
    with refuses("certificate"):
        stancekit.verify(read)
    assert stancekit.verify(read.of(problems[0])).accepted
    assert not stancekit.verify(certificate.of(stancekit.sample("ground-3", rng=3)[0])).accepted


LARGE = ("casadi", "pyarrow", "cvxpy", "matplotlib", "torch")
SOLVE = """
problem = stancekit.sample("wall-3", rng=8)[0]
outcome = stancekit.solve(problem)
assert outcome.status.value == "infeasible"
"""
EXPLAIN = """
assert stancekit.verify(outcome.certificate).accepted
assert stancekit.explain(outcome.certificate).relaxations
"""
CLIMB = """
assert stancekit.plan("stairs", frames=2).solution is not None
"""
ENVIRONMENT = """
import gymnasium
env = gymnasium.make("stancekit.envs:stancekit/EnvelopeSelection-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


def loaded_by(code: str) -> list[str]:
    """Those of the large packages that a fresh interpreter has loaded after it ran the code."""
    code = (
        f"import sys, stancekit\n{code}\nprint(*(name for name in {LARGE} if name in sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.split()


def test_neither_the_import_nor_a_first_answer_loads_a_large_package() -> None:
    assert loaded_by(SOLVE + EXPLAIN + CLIMB + ENVIRONMENT) == []


def test_a_package_is_loaded_by_what_needs_it() -> None:
    assert loaded_by(SOLVE + "stancekit.draw(problem)") == ["matplotlib"]


NAMES = sorted(name for name in dir(stancekit) if not name.startswith("_"))
FUNCTIONS = (
    "draw",
    "evaluate",
    "explain",
    "export",
    "film",
    "fit",
    "label",
    "load",
    "plan",
    "robot",
    "run",
    "sample",
    "save",
    "simulate",
    "solve",
    "terrain",
    "verify",
    "walk",
)

IMPORTED = """
import json, sys
before = set(sys.modules)
import stancekit
loaded = sorted(set(sys.modules) - before)
names = dir(stancekit)
print(json.dumps([loaded, len(set(sys.modules) - before), len(names)]))
"""


def test_the_import_loads_nothing_that_takes_time():
    done = subprocess.run(
        [sys.executable, "-c", IMPORTED], capture_output=True, text=True, check=True
    )
    loaded, after_names, names = json.loads(done.stdout)
    others = {name.partition(".")[0] for name in loaded} - set(sys.stdlib_module_names)
    assert (others, names > 20) == ({"stancekit"}, True)
    assert len(loaded) == after_names < 40  # a solver has hundreds


def test_type_checkers_are_told_the_same_names_from_the_same_homes():
    tree = ast.parse(Path(inspect.getfile(stancekit)).read_text("utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    message = {
        alias.asname: node.module
        for node in guarded.body
        if isinstance(node, ast.ImportFrom) and node.level == 1
        for alias in node.names
        if alias.asname == alias.name
    }
    assert message == stancekit._HOME
    assert len(message) > 20


def test_the_verbs_are_there_and_a_wrong_name_is_an_attribute_error():
    assert set(FUNCTIONS) <= set(NAMES)
    assert stancekit.__version__.count(".") == 2
    with refuses("stancekit", "slove", kind=AttributeError):
        _ = stancekit.slove


@pytest.mark.parametrize("name", NAMES)
def test_a_docstring_names_every_argument_and_its_source(name):
    thing = getattr(stancekit, name)
    text = inspect.getdoc(thing) or ""
    assert "Source:\n" in text
    if inspect.isfunction(thing):
        wanted = [*inspect.signature(thing).parameters]
        assert "Returns:\n" in text or name == "save"
        assert "Raises:\n" in text or not wanted
    else:
        named = [field.name for field in fields(thing)] if is_dataclass(thing) else []
        wanted = [argument for argument in named if not argument.startswith("_")]
    assert [argument for argument in wanted if argument not in text] == []
    assert "Arguments:\n" in text or not wanted


@pytest.mark.parametrize("name", [*NAMES, "stancekit"])
def test_the_example_in_a_docstring_does_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    thing = stancekit if name == "stancekit" else getattr(stancekit, name)
    (test,) = doctest.DocTestFinder(recurse=False).find(thing, name, module=False, globs={})
    assert test.examples
    report: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(test, out=report.append, clear_globs=False)
    assert runner.failures == 0, "".join(report)
