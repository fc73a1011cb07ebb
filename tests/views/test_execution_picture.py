"""Pictures of executions: the limbs are where the joints are, and what moved has moved in the picture."""

from itertools import islice

import numpy as np
import pytest

from stancekit.planners.answer.plan import Plan
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.two_stage import TwoStageCoursePlanner
from stancekit.runner.execution import Execution
from stancekit.runner.motion.timeline import Timing
from stancekit.runner.run import simulate
from stancekit.runner.settings import RunSettings
from stancekit.views.execution_picture import FPS, SPEED, ExecutionStage, draw_execution, execution_frames
from stancekit.views.plot import to_rgb

pytest.importorskip("pinocchio")
pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def run() -> tuple[Plan, Execution]:
    outcome = TwoStageCoursePlanner().solve(read_course("walls", frames=2))
    assert outcome.plan is not None
    settings = RunSettings(timing=Timing().at_pace(2.0), check_limits=False)
    execution = simulate(outcome.plan, settings=settings).execution
    assert execution is not None
    return outcome.plan, execution


def test_limbs_end_where_the_world_had_the_feet(run: tuple[Plan, Execution]) -> None:
    stage, trace = ExecutionStage(*run), run[1].trace
    for row in (0, len(trace.time_s) - 1):
        legs = stage.scene(stage.moment(row)).legs()
        np.testing.assert_allclose([leg[-1] for leg in legs], trace.feet_m[row], atol=1e-4)


def test_a_picture_shows_the_time_that_was_asked_for(run: tuple[Plan, Execution]) -> None:
    pictures = [to_rgb(draw_execution(*run, time_s=time, size_px=(480, 360))) for time in (0.2, 0.2, 1.4)]
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])


def test_a_video_has_as_many_pictures_as_its_pace_asks_for(
    run: tuple[Plan, Execution], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = list(islice(execution_frames(*run, size_px=(400, 300)), 2))
    assert [frame.shape for frame in first] == [(300, 400, 3)] * 2
    assert first[0].dtype == np.uint8
    drawn = np.zeros((2, 2, 3), dtype=np.uint8)
    monkeypatch.setattr("stancekit.views.execution_picture._pixels", lambda *_: drawn)
    seconds = run[1].seconds / SPEED
    assert sum(1 for _ in execution_frames(*run)) == pytest.approx(seconds * FPS, abs=1.0)
