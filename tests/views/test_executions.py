"""Pictures of executions: the limbs are where the joints are, and what moved has moved in the
picture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stancekit
from stancekit import Motion
from stancekit.planners.motion.gait_motion import WALK_SETTLE_S, gait_motion
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.leap_classes import leap_from_keys
from stancekit.runner.log import Message, Recorded
from stancekit.runner.motion.time_parametrization import streamed
from stancekit.runner.report import Execution
from stancekit.runner.settings import RunSettings
from stancekit.views.gaits import GaitView
from stancekit.views.plans import FPS, SPEED, PlanView, draw_execution
from stancekit.views.plots import draw_tracking, tracked
from stancekit.views.sheet import to_rgb
from stancekit.views.strips import parted, run_strips
from tests.refusals import refuses
from tests.same_motion import compared


@pytest.fixture(scope="module")
def run(course_plan: Callable[[str, int], Motion]) -> tuple[Motion, Execution]:
    plan = course_plan("walls", 2)
    settings = RunSettings(timing=Timing().at_pace(2.0), check_limits=False)
    execution = stancekit.simulate(plan, settings=settings).execution
    assert execution is not None
    return plan, execution


def test_limbs_end_where_the_world_had_the_feet(run: tuple[Motion, Execution]) -> None:
    view, trace = PlanView(run[0], execution=run[1]), run[1].trace
    for row in (0, len(trace.time_s) - 1):
        bodies = {body.name: body for body in view.at(view.measured(run[1], row)).bodies}
        feet = [bodies[f"{limb} joint 3"].position_m for limb in view.shape.limbs]
        np.testing.assert_allclose(feet, trace.feet_m[row], atol=1e-4)
        np.testing.assert_array_equal(bodies["trunk 0"].position_m, trace.origin_m[row])
        np.testing.assert_allclose(bodies["trunk 0"].rotation, trace.rotation[row], atol=1e-9)


def test_a_picture_shows_the_time_that_was_asked_for(run: tuple[Motion, Execution]) -> None:
    pictures = [
        to_rgb(draw_execution(*run, time_s=time, size_px=(480, 360))) for time in (0.2, 0.2, 1.4)
    ]
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])


def test_a_picture_says_where_and_when_an_execution_parts_from_its_plan(
    run: tuple[Motion, Execution],
) -> None:
    trace = run[1].trace
    away = 0.04 * (np.arange(len(trace.com_m)) >= 300)
    drifted = trace.planned_com_m + away[:, None] * [0.0, 1.0, 0.0]
    execution = replace(run[1], trace=replace(trace, com_m=drifted))
    assert parted(execution) == (300, f"parts from the plan at {trace.time_s[300]:.1f} s")
    assert run_strips(execution)[0].values == pytest.approx(1e3 * away)
    near, words = parted(run[1])[1], [strip.words for strip in run_strips(run[1])]
    assert near.startswith(f"farthest from the plan, {1e3 * run[1].com_worst_m:.1f} mm,")
    drawn = {text.get_text() for axes in draw_execution(*run).axes for text in axes.texts}
    assert {near, *words} <= drawn


def test_a_film_has_as_many_frames_as_its_pace_asks_for(run: tuple[Motion, Execution]) -> None:
    motion = PlanView(run[0], execution=run[1]).film()
    assert len(motion.moments) == pytest.approx(run[1].seconds / SPEED * FPS, abs=1.0)
    assert len(motion.notes) == len(motion.moments)
    assert motion.step_s == pytest.approx(1.0 / FPS)


@pytest.mark.usefixtures("gl")
def test_frames_have_the_size_asked_for(run: tuple[Motion, Execution]) -> None:
    view = PlanView(run[0], execution=run[1])
    first = list(islice(view.frames(view.film(), (400, 300)), 2))
    assert [frame.shape for frame in first] == [(300, 400, 3)] * 2
    assert first[0].dtype == np.uint8
    assert first[0].std() > 10.0


def test_the_execution_of_another_motion_is_refused_in_one_line(
    run: tuple[Motion, Execution],
) -> None:
    leap = stancekit.load("tests/data/leap-hop-anymal.json", Motion)
    for show in (
        lambda: stancekit.draw(leap, executed=run[1]),
        lambda: stancekit.film(leap, "leap.html", run[1]),
    ):
        with refuses("executed"):
            show()
    posture = stancekit.solve(stancekit.sample("ground-3", rng=3)[0]).solution
    with refuses("draw"):
        stancekit.draw(posture, executed=run[1])


JOINTS = ["a1", "a2", "a3", "b1", "b2"]


def recorded(**plan: Any) -> Recorded:
    """A log of three commands to limbs of three and two joints, joint k off by k mrad."""
    off = 1e-3 * np.arange(5.0)
    contents = [("plan", {"joints": JOINTS, "course": "two limbs", **plan})]
    for k in range(4):
        state = {
            "time_s": 0.1 * k,
            "angles_rad": off.tolist(),
            "position_m": [0.0] * 3,
            "torques_nm": [1.0, -5.0, 2.0, 0.5, -0.25],
            "forces_n": [[0.0, 0.0, 9.0], [0.0, 3.0, 4.0]],
        }
        contents.append(("measurement", state))
    contents += [("command", {"planned_rad": [0.0] * 5, "sent_rad": [0.0] * 5})] * 3
    return Recorded(
        messages=tuple(Message(time_ns=0, topic=t, content=c) for t, c in contents), whole=True
    )


def test_each_limb_is_one_line_of_the_worst_of_its_joints() -> None:
    figure = draw_tracking(recorded(limbs={"A": JOINTS[:3], "B": JOINTS[3:]}))
    away, torque, force, _ = figure.axes
    assert [line.get_label() for line in away.lines] == ["A", "B"]
    for axes, values in ((away, (2.0, 4.0)), (torque, (5.0, 0.5)), (force, (9.0, 5.0))):
        for line, value in zip(axes.lines, values, strict=True):
            np.testing.assert_allclose(line.get_ydata(), value)


def test_what_was_planned_slid_and_planned_anew_is_drawn_where_the_log_says_it() -> None:
    log = recorded(limbs={"A": JOINTS[:3], "B": JOINTS[3:]}, torque_nm=[6.0, 6.0, 6.0, 4.0, 4.0])
    aim = {
        "origin_m": [0.1, 0.0, 0.0],
        "forces_n": [[0.0, 0.0, 8.0], [0.0, 0.0, 5.0]],
        "foothold": [0, 1],
    }
    feet = [[[0.001 * k, 0.0, 0.0], [0.0, 0.002 * k, 0.0]] for k in range(4)]
    states = [
        replace(each, content=each.content | {"feet_m": feet[k], "forces_n": [[0.0, 0.0, 1.0]] * 2})
        for k, each in enumerate(m for m in log.messages if m.topic == "measurement")
    ]
    rest = [each for each in log.messages if each.topic != "measurement"]
    said: list[tuple[str, dict[str, Any]]] = [
        ("target", aim | {"time_s": 0.1 * k, "rolled_m": [[0.0005 * k, 0.0, 0.0], [0.0] * 3]})
        for k in range(1, 4)
    ]
    said.append(("decision", {"what": "plan anew", "why": "feet slid", "time_s": 0.2}))
    said.append(("decision", {"what": "armed", "why": "asked", "time_s": 0.3}))
    more = [Message(time_ns=0, topic=topic, content=content) for topic, content in said]
    figure = draw_tracking(Recorded(messages=(*rest[:1], *states, *rest[1:], *more), whole=True))
    away, torque, force, slid, body = figure.axes
    assert [line.get_xdata() for line in away.lines[2:]] == [[0.2, 0.2]]
    assert list(torque.lines[2].get_ydata()) == [6.0, 6.0]
    for line, value in zip(force.lines[2:4], (8.0, 5.0), strict=True):
        np.testing.assert_allclose(line.get_ydata(), value)
    for line, rate in zip(slid.lines[:2], (0.5, 2.0), strict=True):  # what a foot rolls is no slip
        np.testing.assert_allclose(line.get_ydata(), [0.0, rate, 2.0 * rate])
    np.testing.assert_allclose(body.lines[0].get_ydata(), 100.0)


def test_a_limb_without_a_foot_that_was_felt_is_refused() -> None:
    with refuses("log", "forces_n"):
        tracked(recorded(limbs={"A": JOINTS}))


@pytest.mark.parametrize(
    "said",
    [
        {},
        {"limbs": {}},
        {"limbs": {"A": JOINTS[:2], "B": JOINTS[3:]}},
        {"limbs": {"A": [], "B": JOINTS}},
    ],
)
def test_limbs_that_are_not_those_of_the_joints_are_refused(said: dict[str, Any]) -> None:
    with refuses("log", "limbs"):
        tracked(recorded(**said))


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
def planned(course: str | Path) -> Motion:
    plan = stancekit.plan(course, frames=3 if course == "walls" else None).solution
    assert plan.keyed
    return plan


@cache
def level_walk(robot: str) -> Motion:
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
    subject: Motion
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
    assert view.motion.at(0.0).angles_rad is None
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
    assert shown.motion.at(0.0).angles_rad is None
    assert light.motion.at(0.0).angles_rad is not None
    runs = shown.motion.lasting(light.motion.seconds)
    middles = [np.cumsum(each.seconds) - 0.5 * each.seconds for each in (runs, shown.motion)]
    one, other = light.motion.at(middles[0]), shown.motion.at(middles[1])
    assert len(other.frame) > 10
    for field in ("com_m", "rotation_rad", "feet_m", "foothold", "frame"):
        np.testing.assert_allclose(getattr(other, field), getattr(one, field), atol=1e-12)


def test_a_leap_is_a_motion_whose_feet_land_where_it_says() -> None:
    leap = leap_from_keys({"distribution": "leap-given", "seed": 0}, "drawn")
    plan = stancekit.plan(leap).solution
    assert plan.has("timing")
    motion = streamed(plan)
    times = np.linspace(0.0, motion.duration_s, 200)
    rows = motion.at(times)
    assert not rows.stands.all(axis=1).all()
    assert np.isfinite(rows.toes_m).all()
    np.testing.assert_allclose(
        rows.toes_m[rows.stands], plan.toes_m[rows.foothold[rows.stands]], atol=1e-9
    )
    np.testing.assert_allclose(motion.at(plan.ends_s).com_m, plan.com_m, atol=1e-9)
    assert np.abs(np.diff(rows.toes_m, axis=0)).max() < 6.0 * motion.duration_s / 200
    rates = np.gradient(rows.rotation_rad, times, axis=0)[1:-1]
    np.testing.assert_allclose(rates, rows.rotation_rate_rad_s[1:-1], atol=0.2)


def test_samples_at_many_times_are_those_at_each_of_them() -> None:
    for motion in (
        streamed(planned("walls")),
        PlanView(planned("walls")).keys,
        gait_motion(level_walk("anymal")),
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
