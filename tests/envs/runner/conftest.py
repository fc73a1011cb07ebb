"""Plans of one step, made once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from stancekit.planners.keyframes.twostage import TwoStageCoursePlanner
from stancekit.planners.plan import Plan
from stancekit.planners.plan_file import write_plan
from stancekit.planners.scene.course_spec import read_course
from stancekit.planners.verify_plan import check_plan


@pytest.fixture(scope="session")
def step() -> Callable[[str], Plan]:
    """``step(course)``: a plan of two key frames."""

    @cache
    def plan(course: str) -> Plan:
        outcome = TwoStageCoursePlanner().solve(read_course(course, frames=2))
        assert outcome.plan is not None
        return outcome.plan

    return plan


@pytest.fixture
def plan_path(tmp_path: Path, step: Callable[[str], Plan]) -> Path:
    """Its file, for walls."""
    path = tmp_path / "plan.json"
    write_plan(path, step("walls"), check_plan(step("walls")))
    return path
