"""Plans of one step, and a short gait, made once."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.formats.motion_file import write_motion
from stancekit.planners.gait.method.attempt import Attempt, Attempted, Workbench
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.walker import hexapod_walker
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify import check_plan
from stancekit.runner.acceptance import Accepted
from tests.emulators.memory_world import MemoryWorld


@pytest.fixture(scope="session")
def step(course_plan: Callable[[str, int], Motion]) -> Callable[[str], Motion]:
    """``step(course)``: a plan of two key frames."""
    return partial(course_plan, frames=2)


@pytest.fixture
def plan_path(tmp_path: Path, step: Callable[[str], Motion]) -> Path:
    """Its file, for walls."""
    path = tmp_path / "plan.json"
    write_motion(path, step("walls"), check_plan(step("walls")))
    return path


@pytest.fixture(scope="session")
def short_desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Plan file of the course of docs/running-on-a-robot.md, shortened: two key frames, and less of
    a way.
    """
    page = (Path(__file__).parents[2] / "docs" / "running-on-a-robot.md").read_text(
        encoding="utf-8"
    )
    (text,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    folder = tmp_path_factory.mktemp("desk")
    for whole, part in (("frames: 6", "frames: 2"), ("goal_m: [0.10,", "goal_m: [0.02,")):
        assert whole in text
        text = text.replace(whole, part)
    (folder / "desk.yaml").write_text(text)
    plan = TwoStage().solve(read_course(folder / "desk.yaml")).solution
    assert plan is not None
    write_motion(folder / "desk.json", plan, check_plan(plan))
    return folder / "desk.json"


@pytest.fixture(scope="session")
def gait() -> Attempted:
    """The hexapod's tripod gait over waves 6 cm high, two cycles."""
    waves = HeightField.from_function(
        lambda x, y: 0.03 * np.sin(4 * x + 0.3) * np.cos(3 * y), 1.0, 0.1, name="waves"
    )
    task = Walk(
        robot=hexapod_walker(),
        terrain=waves,
        start=np.zeros(2),
        goal=np.array([0.1, 0.05]),
        duration_s=2.0,
        gait="tripod",
    )
    found = Workbench(task, GaitSettings()).run(Attempt(chart="decoupled"))
    assert found.report.accepted, found.report.message
    return found


@pytest.fixture(scope="session")
def accepted(step: Callable[[str], Motion]) -> Accepted:
    """One step up the walls, verified."""
    return Accepted.verified(step("walls"), "walls")


@pytest.fixture
def world() -> MemoryWorld:
    """Servos in memory."""
    return MemoryWorld()


@pytest.fixture(autouse=True)
def _timed_once(each_plan_is_timed_once: None) -> None:
    """Also here."""


@pytest.fixture(autouse=True)
def _hangs_up() -> Iterator[None]:
    """A hang-up is not ignored, as it is under ``nohup``."""
    before = signal.getsignal(signal.SIGHUP)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)
