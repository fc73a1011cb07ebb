"""What the tests of the older key-frame planners share: their compiled models."""

from __future__ import annotations

from collections.abc import Callable

import cvxpy as cp
import pytest

from stancekit.planners.keyframes.twostage import CourseModels
from stancekit.planners.scene.course import Course


@pytest.fixture(scope="session")
def models() -> CourseModels:
    """The compiled models, once a process."""
    return CourseModels()


@pytest.fixture(scope="session")
def written(written_course) -> Callable[[Course], tuple[cp.Problem, list[list[cp.Variable]]]]:
    """``written_course``, by its old name."""
    return written_course
