"""A small task that compiles in a second: one cycle of a trot over ripples."""

from collections.abc import Callable

import numpy as np
import pytest

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.gait.gait_program import GaitProgram, formulate
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.heightfield import HeightField


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    return np.asarray(0.08 * np.sin(2.5 * x + 0.3) * np.cos(2.0 * y))


@pytest.fixture(scope="session")
def field() -> HeightField:
    """Gentle waves."""
    return HeightField.from_function(waves, 2.0, 0.1, name="waves")


@pytest.fixture(scope="session")
def small(field: HeightField) -> Callable[..., GaitProgram]:
    """Programs of a short walk over the waves, by settings."""
    robot = anymal()

    def build(
        terrain: HeightField = field,
        timings: str = "fixed",
        programs: Programs | None = None,
        **settings: object,
    ) -> GaitProgram:
        task = Walk(
            robot=robot,
            terrain=terrain,
            start=np.zeros(2),
            goal=np.array([0.2, 0.1]),
            duration_s=2.0,
            timings=timings,  # type: ignore[arg-type]
        )
        return formulate(task, GaitSettings(**settings), programs=programs)  # type: ignore[arg-type]

    return build
