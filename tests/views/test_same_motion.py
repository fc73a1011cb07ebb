"""What is seen is what runs: a film and the stream of a run are equal, sample by sample."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit.planners.answer.plan import LeapPlan, Plan
from stancekit.planners.answer.trajectory import Trajectory
from stancekit.planners.motion.gait_motion import WALK_SETTLE_S, GaitMotion
from stancekit.planners.motion.plan_motion import PlanMotion
from stancekit.planners.problem.leap_classes import leap_from_keys
from stancekit.runner.motion.time_parametrization import TimedMotion, streamed
from stancekit.views.gaits import GaitView
from stancekit.views.plans import PlanView
from tests.same_motion import compared

ANT = Path(stancekit.__file__).parent / "configs" / "demo" / "ant.yaml"
STAIRS = """\
name: small-stairs
robot: {ant}
frames: 2
start_m: [0.0, 0.0]
goal_m: [0.06, 0.0, 0.19]
terrain: {{kind: stairs, friction: 0.7, first_m: 0.3, run_m: 0.4, rises_m: [0.04]}}
"""


@cache
def planned(course: str | Path) -> Plan:
    plan = stancekit.plan(course, frames=3 if course == "walls" else None).solution
    assert isinstance(plan, Plan)
    return plan


@cache
def level_walk(robot: str) -> Trajectory:
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    walk = stancekit.walk(
        level, (0.1, 0.0), duration_s=2.0, chart="decoupled", robot=robot
    ).solution
    assert walk is not None
    return walk


@pytest.mark.parametrize(
    "name", ["hexapod on walls", "legs of a file on stairs", "walk of legs of a file"]
)
def test_a_film_and_a_stream_are_equal_sample_by_sample(name: str, tmp_path: Path) -> None:
    subject: Plan | Trajectory
    if name == "hexapod on walls":
        subject = planned("walls")
    elif name == "legs of a file on stairs":
        (tmp_path / "stairs.yaml").write_text(STAIRS.format(ant=ANT))
        subject = planned(tmp_path / "stairs.yaml")
    else:
        subject = level_walk(str(ANT))
    found = compared(subject)
    assert found.looked > 40
    assert found.differs == dict.fromkeys(found.differs, 0.0)


def test_at_the_rate_of_a_run_it_is_nearly_the_same() -> None:
    found = compared(planned("walls"), rate_hz=200.0)
    for name in ("com_m", "rotation_rad", "feet_m", "foothold", "frame"):
        assert found.differs[name] < 1e-9, name
    assert found.differs["angles_rad"] < 0.02
    assert found.differs["pictures"] < 1e-3


def test_a_walk_of_a_robot_without_joints_is_shown_on_the_same_path_at_the_same_pace() -> None:
    walk = level_walk("anymal-boxes")
    view = GaitView(walk)
    assert isinstance(view.motion, GaitMotion)
    film = view.film(step_s=0.1)
    for k, moment in enumerate(film.moments):
        now = view.motion.at(WALK_SETTLE_S + 0.1 * k)
        bodies = {body.name: body for body in moment.bodies}
        np.testing.assert_array_equal(bodies["trunk 0"].position_m, now.com_m)
        row = int(np.argmin(np.abs(walk.times_s - 0.1 * k)))
        np.testing.assert_allclose(now.toes_m, walk.feet_m[row], atol=1e-9)
        np.testing.assert_allclose(now.forces_n, walk.forces_n[row], atol=1e-6)


def test_a_plan_that_the_runner_refuses_is_shown_on_the_path_that_it_stands_for() -> None:
    plan = planned("walls")
    robot = replace(plan.problem.robot, mass_kg=20.0 * plan.problem.robot.mass_kg)
    heavy = replace(plan, problem=replace(plan.problem, robot=robot), forces_n=20.0 * plan.forces_n)
    light, shown = PlanView(plan), PlanView(heavy)
    assert isinstance(light.motion, TimedMotion)
    assert isinstance(shown.motion, PlanMotion)
    runs = light.motion.motion
    assert isinstance(runs, PlanMotion)
    middles = [
        np.cumsum([p.seconds for p in each.phases]) - [0.5 * p.seconds for p in each.phases]
        for each in (runs, shown.motion)
    ]
    one, other = runs.at(middles[0]), shown.motion.at(middles[1])
    assert len(other.frame) > 10
    for field in ("com_m", "rotation_rad", "feet_m", "foothold", "frame"):
        np.testing.assert_allclose(getattr(other, field), getattr(one, field), atol=1e-12)


def test_a_leap_is_a_motion_whose_feet_land_where_it_says() -> None:
    leap = leap_from_keys({"distribution": "leap-given", "seed": 0}, "drawn")
    plan = stancekit.plan(leap).solution
    assert isinstance(plan, LeapPlan)
    motion = streamed(plan)
    times = np.linspace(0.0, motion.duration_s, 200)
    rows = motion.at(times)
    assert not rows.stands.all(axis=1).all()
    assert np.isfinite(rows.toes_m).all()
    np.testing.assert_allclose(
        rows.toes_m[rows.stands], plan.toes_m[rows.foothold[rows.stands]], atol=1e-9
    )
    np.testing.assert_allclose(motion.at(plan.times_s).com_m, plan.com_m, atol=1e-9)
    steps = np.abs(np.diff(rows.toes_m, axis=0)).max()
    assert steps < 6.0 * motion.duration_s / 200
    rates = np.gradient(rows.rotation_rad, times, axis=0)[1:-1]
    np.testing.assert_allclose(rates, rows.rotation_rate_rad_s[1:-1], atol=0.2)


def test_samples_at_many_times_are_those_at_each_of_them() -> None:
    for motion in (
        streamed(planned("walls")),
        PlanView(planned("walls")).keys,
        GaitMotion(level_walk("anymal")),
    ):
        times = np.linspace(-0.1, motion.duration_s + 0.1, 60)
        rows = motion.at(times)
        for k, time_s in enumerate(times):
            one = motion.at(float(time_s))
            for name in (
                "com_m",
                "rotation_rad",
                "velocity_m_s",
                "feet_m",
                "forces_n",
                "foothold",
                "frame",
                "normals",
            ):
                np.testing.assert_array_equal(getattr(rows, name)[k], getattr(one, name))
        rates = np.gradient(rows.com_m, times, axis=0)
        assert np.abs(rates - rows.velocity_m_s).max() < 0.1 * np.abs(rates).max() + 0.02
