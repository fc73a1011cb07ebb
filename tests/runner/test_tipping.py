"""The verifier accepts a plan that is about to tip; ``run`` refuses it, and says how to run it all
the same.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from stancekit.cli.main import run
from stancekit.cli.run import RunMotion
from stancekit.cli.simulate import Simulate
from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.report import MARGIN
from stancekit.planners.formats.plan_file import write_plan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.search.witness import with_whole_body
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.geometry import LEAST_PUSH, tipping
from stancekit.runner.acceptance import Accepted
from stancekit.runner.prepared import Prepared
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import make_world
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import refuses


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan for a quadruped of a file, which bears some push, and not .9 of its weight."""
    folder = tmp_path_factory.mktemp("tipping")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.yaml").write_text(
        "name: flat\nrobot: dog.urdf\nframes: 2\ngait: wave\nstart_m: [0.0, 0.0]\n"
        "goal_m: [0.05, 0.0, 0.45]\nterrain: {kind: flat, friction: 0.7}\n"
    )
    outcome = with_whole_body(
        plan_with_reserve(TwoStagePlanner(), read_course(folder / "flat.yaml"))
    )
    assert outcome.solution is not None
    assert outcome.report is not None
    assert outcome.report.accepted
    write_plan(folder / "dog.json", outcome.solution, outcome.report)
    return folder / "dog.json"


@pytest.fixture(scope="module")
def accepted(file: Path) -> Accepted:
    return Accepted.from_file(file)


def prepare(accepted: Accepted, **settings: object) -> Prepared:
    course = accepted.plan.problem
    with make_world("mujoco", course.robot, gravity_m_s2=course.gravity_m_s2) as world:
        return Runner(world, settings=RunSettings(**settings)).prepare(accepted)  # type: ignore[arg-type]


def test_run_has_the_limit_of_plan() -> None:
    assert RunSettings().least_push == LEAST_PUSH


def test_a_plan_that_bears_less_is_refused_in_one_line(accepted: Accepted, file: Path) -> None:
    with refuses(file):
        prepare(accepted, least_push=0.9)


@pytest.mark.parametrize("settings", [{}, {"least_push": 0.0}], ids=["enough", "asked for"])
def test_a_plan_that_bears_enough_or_is_asked_for_is_not(
    accepted: Accepted, settings: dict[str, float]
) -> None:
    assert prepare(accepted, **settings).pace > 0.0


def test_a_simulation_that_breaks_limits_has_none(accepted: Accepted) -> None:
    assert prepare(accepted, least_push=0.9, check_limits=False).pace > 0.0


def test_the_verifier_accepts_it(accepted: Accepted) -> None:
    report = check_plan(accepted.plan, margins=True)
    assert report.accepted
    push_n = report.group(MARGIN).figures["push_n"]
    assert tipping(accepted.plan, 1.01 * push_n / accepted.plan.problem.weight_n)
    assert not tipping(accepted.plan, 0.99 * push_n / accepted.plan.problem.weight_n)


def test_robots_without_legs_of_a_file_are_not_limited() -> None:
    plan = TwoStagePlanner().solve(read_course("walls", frames=2)).solution
    assert isinstance(plan, Plan)
    assert tipping(plan, 1.0) == ""


def test_the_command_says_its_own_option(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = run(RunMotion(plan=file, least_push=0.9))
    said = capsys.readouterr()
    assert (code, said.out) == (2, "")
    assert said.err.count("\n") == 1
    assert "; --least-push 0 runs it all the same" in said.err


def test_a_share_out_of_range_is_named(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(RunMotion(plan=file, least_push=2.0)) == 2
    assert "--least-push: expected a number in [0, 1], got 2" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"contact_stiffness_n_m": -1.0},
            "--contact-stiffness-n-m: expected a number in (0, 1e+07], got -1",
        ),
        (
            {"contact_damping_ns_m": 5.0},
            "--contact-damping-ns-m: expected contact_stiffness_n_m with it, got none",
        ),
    ],
)
def test_ground_that_makes_no_sense_is_named_by_its_option(
    file: Path, capsys: pytest.CaptureFixture[str], options: dict[str, float], said: str
) -> None:
    for verb in (RunMotion(plan=file, **options), Simulate(plan=file, **options)):
        assert run(verb) == 2
        err = capsys.readouterr().err
        assert said in err
        assert err.count("\n") == 1


def test_soft_ground_is_for_simulations(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(RunMotion(plan=file, contact_stiffness_n_m=2e4, world="ros")) == 2
    said = "--contact-stiffness-n-m: expected a simulated world with it, got ros"
    assert said in capsys.readouterr().err
