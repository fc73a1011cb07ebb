"""What `run` refuses from Python as from the command line, before anything moves."""

from __future__ import annotations

from typing import Any

import pytest

import stancekit
from stancekit.planners.motion.plan_motion import Timing
from stancekit.runner.worlds import WORLDS, WorldSettings
from tests.refusals import refuses


@pytest.fixture(scope="module")
def plan() -> stancekit.Plan:
    found = stancekit.plan("stairs", frames=2).solution
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("settings", "world", "policy", "line"),
    [
        (
            {"friction_share": 0.5},
            "ros",
            None,
            "friction_share: expected a simulated world with it, got ros",
        ),
        (
            {"blind": True},
            "ros",
            None,
            "blind: expected a plan or a gait in a simulated world with it, got ros",
        ),
        (
            {"blind": True},
            "mujoco",
            "lift",
            "blind: expected a plan or a gait in a simulated world with it, got a policy",
        ),
        ({}, "replay", "lift", "policy: expected a world that answers to what is done, got replay"),
    ],
)
def test_settings_that_have_no_use_are_refused(
    plan: stancekit.Plan, settings: dict[str, Any], world: str, policy: str | None, line: str
) -> None:
    with pytest.raises(stancekit.InvalidInput) as caught:
        stancekit.run(plan, world, settings=stancekit.RunSettings(**settings), policy=policy)
    assert str(caught.value) == line


def test_a_world_that_was_made_before_pulls_as_the_plan_is_for(plan: stancekit.Plan) -> None:
    for gravity_m_s2, verb in ((1.62, stancekit.run), (1.62, stancekit.simulate)):
        world = WORLDS.get("mujoco").make(
            WorldSettings(robot=plan.problem.robot, gravity_m_s2=gravity_m_s2)
        )
        with refuses("stairs", "1.62", "9.81"):
            verb(plan, world)


def test_a_gait_runs_as_planned() -> None:
    import numpy as np

    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    walk = stancekit.walk(
        level, (0.1, 0.0), robot="hexapod", gait="tripod", duration_s=2.5, chart="decoupled"
    )
    assert walk.solution is not None
    faster = stancekit.RunSettings(timing=Timing().at_pace(2.0))
    with refuses("timing"):
        stancekit.run(walk.solution, settings=faster)
