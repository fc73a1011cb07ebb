"""What friction forbids is said at once, and nothing that can be walked is forbidden."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from stancekit.planners.gait.forbidden import GradientBoxes, forbidden
from stancekit.planners.gait.method.portfolio import plan_gait
from stancekit.planners.gait.walk_table import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import anymal, hexapod_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import reference_terrain
from tests.refusals import assert_names, refuses

TURNS = (0.0, 0.9, 2.3, 4.0, 5.5)


def ramp(slope: float, turn: float) -> HeightField:
    return HeightField.from_function(
        lambda x, y: slope * (np.cos(turn) * x + np.sin(turn) * y), 3.0, 0.1, name=f"ramp {slope:g}"
    )


def task(terrain: HeightField, friction: float, goal=(0.5, 0.2), **options) -> Walk:
    return Walk(
        robot=options.pop("robot", None) or anymal(),
        terrain=terrain,
        start_xy_m=np.zeros(2),
        goal_xy_m=np.array(goal),
        friction=friction,
        **options,
    )


@pytest.mark.parametrize(("share", "turn"), product((1.1, 1.3, 2.0), TURNS))
def test_nobody_stands_on_a_ramp_steeper_than_friction_holds(share: float, turn: float) -> None:
    """The angle of friction is the angle of repose: tan of it is ν (0.02 of it are the
    verifier's).
    """
    friction = 0.4
    said = forbidden(task(ramp(share * friction + 0.02, turn), friction), GaitSettings())
    assert said.startswith(
        "at rest at the start (0, 0) no stance carries the weight: all ground within 0."
    )


@pytest.mark.parametrize(("share", "turn"), product((0.9, 0.95, 0.99, 1.0), TURNS))
def test_a_ramp_that_friction_holds_is_never_forbidden(share: float, turn: float) -> None:
    assert forbidden(task(ramp(share * 0.4, turn), 0.4), GaitSettings()) == ""


@pytest.mark.parametrize("duration_s", [1.6, 2.0, 3.0, 4.0, 6.0])
def test_ice_is_forbidden_where_pushing_and_braking_do_not_bring_the_body_there(
    duration_s: float,
) -> None:
    """On level ground ν g T²/4 is the farthest from rest to rest, pushed half the time and braked
    the other half.
    """
    level, friction, foot = ramp(0.0, 0.0), 0.001, anymal().feet
    reach = max(
        np.linalg.norm(np.maximum(np.abs(each.reach_min_m), np.abs(each.reach_max_m)))
        for each in foot
    )
    half, whole = (
        0.25 * 9.81 * duration_s**2 + 4.0 * reach,
        0.5 * 9.81 * duration_s**2 + 2.0 * reach,
    )
    farthest = (friction + 0.02) * min(half, whole)  # the body may rise as far as its feet reach
    for share in (0.95, 0.99, 1.01, 1.5):
        if share * farthest <= 2.0:
            said = forbidden(
                task(level, friction, (share * farthest, 0.0), duration_s=duration_s),
                GaitSettings(),
            )
            assert ("from rest to rest" in said) == (share > 1.0), said
    goal = (min(1.05 * farthest, 2.0), 0.0)
    leaps = task(
        level, friction, goal, duration_s=duration_s, timings="optimised"
    )  # all feet may be in the air
    assert bool(forbidden(leaps, GaitSettings())) == (goal[0] > (friction + 0.02) * whole)
    possible = friction * 0.25 * 9.81 * duration_s**2
    assert (
        forbidden(
            task(level, friction, (0.99 * possible, 0.0), duration_s=duration_s), GaitSettings()
        )
        == ""
    )


def test_suction_that_does_not_hold_the_weight_is_no_way_up() -> None:
    """On a ramp of angle α a foot's pull s adds no more than s to what the angle of friction
    lacks.
    """
    friction, sticks = 0.3, (True, True, False, False)
    steep, weight = ramp(0.9, 0.0), anymal().weight_n
    said = [
        forbidden(task(steep, friction, adhesive=sticks, suction_n=share * weight), GaitSettings())
        for share in (0.0, 0.05, 0.5)
    ]
    assert said[0]
    assert "and suction of 30 N holds" in said[1]
    assert said[2] == ""


def test_the_benchmarks_are_not_forbidden_and_neither_is_what_sticks() -> None:
    for name, start, goal in (("ripple", (0, 0), (1.8, 0.5)), ("cone", (-2.2, 0), (0.5, 0.2))):
        asked = Walk(
            robot=anymal(),
            terrain=reference_terrain(name),
            start_xy_m=np.array(start),
            goal_xy_m=np.array(goal),
        )
        assert forbidden(asked, GaitSettings()) == ""
    stuck = task(ramp(0.9, 0.0), 0.3, adhesive=(True, True, False, False))
    assert forbidden(stuck, GaitSettings()) == ""
    walker = task(ramp(0.9, 0.0), 0.3, robot=hexapod_walker(), gait="tripod", goal=(0.2, 0.0))
    assert forbidden(walker, GaitSettings())


def test_the_boxes_hold_every_gradient() -> None:
    """The spline's own gradient at random points is within the corners of its cell."""
    terrain, rng = reference_terrain("ripple"), np.random.default_rng(0)
    boxes = GradientBoxes(terrain)
    for xy in rng.uniform(-3.0, 3.0, (50, 2)):
        corners = boxes.normals(xy, 1e-6)
        slopes = -corners[:, :2] / corners[:, 2:]
        gradient = terrain.gradient(xy)
        assert np.all(gradient >= slopes.min(axis=0) - 1e-9)
        assert np.all(gradient <= slopes.max(axis=0) + 1e-9)


def test_a_plan_of_a_forbidden_walk_is_its_reason_and_no_solve() -> None:
    plan = plan_gait(task(ramp(0.6, 0.0), 0.3))
    assert_names(plan.message, "start (0, 0)", "weight")
    assert plan.solves == ()
    with refuses("friction"):
        task(ramp(0.6, 0.0), 0.0)
