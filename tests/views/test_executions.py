"""Pictures of executions: the limbs are where the joints are, and what moved has moved in the
picture.
"""

from itertools import islice

import numpy as np
import pytest

import stancekit
from stancekit.planners.answer.plan import LeapPlan, Plan
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.runner.execution import Execution
from stancekit.runner.run import simulate
from stancekit.runner.settings import RunSettings
from stancekit.views.plans import FPS, SPEED, PlanView, draw_execution
from stancekit.views.sheet import to_rgb
from tests.refusals import refuses


@pytest.fixture(scope="module")
def run() -> tuple[Plan, Execution]:
    outcome = TwoStagePlanner().solve(read_course("walls", frames=2))
    assert outcome.solution is not None
    settings = RunSettings(timing=Timing().at_pace(2.0), check_limits=False)
    execution = simulate(outcome.solution, settings=settings).execution
    assert execution is not None
    return outcome.solution, execution


def test_limbs_end_where_the_world_had_the_feet(run: tuple[Plan, Execution]) -> None:
    view, trace = PlanView(run[0], execution=run[1]), run[1].trace
    for row in (0, len(trace.time_s) - 1):
        bodies = {body.name: body for body in view.at(view.measured(run[1], row)).bodies}
        feet = [bodies[f"{limb} joint 3"].position_m for limb in view.shape.limbs]
        np.testing.assert_allclose(feet, trace.feet_m[row], atol=1e-4)
        np.testing.assert_array_equal(bodies["trunk 0"].position_m, trace.origin_m[row])
        np.testing.assert_allclose(bodies["trunk 0"].rotation, trace.rotation[row], atol=1e-9)


def test_a_picture_shows_the_time_that_was_asked_for(run: tuple[Plan, Execution]) -> None:
    pictures = [
        to_rgb(draw_execution(*run, time_s=time, size_px=(480, 360))) for time in (0.2, 0.2, 1.4)
    ]
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])


def test_a_film_has_as_many_frames_as_its_pace_asks_for(run: tuple[Plan, Execution]) -> None:
    motion = PlanView(run[0], execution=run[1]).film()
    assert len(motion.moments) == pytest.approx(run[1].seconds / SPEED * FPS, abs=1.0)
    assert len(motion.notes) == len(motion.moments)
    assert motion.step_s == pytest.approx(1.0 / FPS)


@pytest.mark.usefixtures("gl")
def test_frames_have_the_size_asked_for(run: tuple[Plan, Execution]) -> None:
    view = PlanView(run[0], execution=run[1])
    first = list(islice(view.frames(view.film(), (400, 300)), 2))
    assert [frame.shape for frame in first] == [(300, 400, 3)] * 2
    assert first[0].dtype == np.uint8
    assert first[0].std() > 10.0


def test_the_execution_of_another_motion_is_refused_in_one_line(
    run: tuple[Plan, Execution],
) -> None:
    leap = stancekit.load("tests/data/leap-hop-anymal.json", LeapPlan)
    for show in (
        lambda: stancekit.draw(leap, executed=run[1]),
        lambda: stancekit.film(leap, "leap.html", run[1]),
    ):
        with refuses("executed"):
            show()
    posture = stancekit.solve(stancekit.sample("ground-3", rng=3)[0]).solution
    with refuses("draw"):
        stancekit.draw(posture, executed=run[1])
