"""The ends of a walk's file: swings that they cut off, headings, and robots that are called as the
package's own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit.planners.answer.trajectory import robot_from_json
from stancekit.planners.motion.gait_motion import gait_motion
from stancekit.planners.robot.leg import continued
from stancekit.planners.robot.walker import anymal, hexapod_walker
from stancekit.planners.verify.trajectories import check_trajectory, worst_window
from tests.planners.verify.test_trajectories import standing
from tests.refusals import refuses


@pytest.mark.parametrize("rate", [0.0, 0.3, 2.0, 50.0])
@pytest.mark.parametrize("drift", [0.0, 0.5])
def test_the_worst_window_is_that_of_all_windows(rate, drift):
    rng, step_s, worst = np.random.default_rng(7), 0.01, list[float]()
    for count in (3, 40, 150):
        values = rng.normal(size=(count, 3)) + drift
        found, _ = worst_window(values, step_s, rate)
        sums = np.concatenate([np.zeros((1, 3)), np.cumsum(values, axis=0)]) * step_s
        apart = np.linalg.norm(sums[:, None] - sums[None], axis=-1)
        lasting = np.abs(np.subtract.outer(np.arange(count + 1), np.arange(count + 1))) * step_s
        assert found == pytest.approx((apart - rate * lasting).max(), abs=1e-12)
        worst.append(found)
    assert max(worst) > 0.0 or rate == 50.0


SWUNG = {"lift", "clearance", "drag"}


@pytest.mark.parametrize("where", [np.s_[:40], np.s_[60:], np.s_[:]])
def test_a_foot_that_is_said_to_swing_at_an_end_is_in_the_air(where: slice) -> None:
    contact = np.array(standing().contact)
    contact[where, 0] = False
    found = {group.name for group in check_trajectory(replace(standing(), contact=contact)).refused}
    assert {"lift", "clearance"} <= found


@pytest.mark.parametrize("where", [np.s_[:40], np.s_[60:]])
def test_a_foot_that_comes_down_from_before_the_file_or_leaves_it_in_the_air_is_no_fault(
    where: slice,
) -> None:
    walk = standing()
    contact, feet = np.array(walk.contact), np.array(walk.feet_m)
    contact[where, 0] = False
    rise = np.linspace(0.0, 1.0, len(feet[where]) + 2)[1:-1]
    feet[where, 0, 2] += 0.1 * (rise[::-1] if where.start is None else rise)
    found = {
        group.name
        for group in check_trajectory(replace(walk, contact=contact, feet_m=feet)).refused
    }
    assert not found & SWUNG


@pytest.mark.parametrize(("start", "turn", "wholly"), [(0.0, 0.4, 0), (3.0, 0.4, -1)])
def test_a_walk_ends_with_the_heading_asked_for_and_turns_the_shorter_way(
    start: float, turn: float, wholly: int
) -> None:
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    end, full = start + turn, 2.0 * np.pi * wholly
    found = stancekit.walk(
        level,
        (0.0, 0.0),
        start_yaw_rad=start - full,
        end_yaw_rad=end + full,
        duration_s=2.0,
        chart="decoupled",
    )
    assert found.status.value == "feasible", found.message
    walk = found.solution
    assert walk is not None
    assert found.report is not None
    assert found.report.figures["turn_rad"] == pytest.approx(turn, abs=0.01)
    asked = walk.question
    assert (asked["heading_rad"], asked["heading_end_rad"]) == pytest.approx((start, end))
    otherwise = check_trajectory(walk.asked(heading_end_rad=end - 0.1), body=False)
    assert [group.name for group in otherwise.refused] == ["heading"]
    assert check_trajectory(walk.asked(heading_end_rad=end + full), body=False).accepted
    turned = gait_motion(walk, walk.robot.foot_radii_m).at(np.linspace(0.0, 3.0, 50))
    ahead = continued(turned.rotation_rad)
    assert ahead[:, 2] - ahead[0, 2] == pytest.approx(
        np.unwrap(turned.rotation_rad[:, 2]) - ahead[0, 2], abs=1e-6
    )


def test_a_robot_that_stands_higher_than_its_feet_are_is_none() -> None:
    with refuses("stand_height_m"):
        replace(hexapod_walker(), stand_height_m=200.0)
    with refuses("inertia_kgm2"):
        replace(anymal(), inertia_kgm2=1e3 * anymal().inertia_kgm2)


@pytest.mark.parametrize("name", ["stand_height_m", "inertia_kgm2", "trunk_half_m"])
def test_a_walk_of_a_built_in_robot_is_held_to_its_numbers(name: str) -> None:
    data = hexapod_walker().to_json()
    assert robot_from_json(data).name == "hexapod"
    data[name] = (
        1.01 * data[name] if name == "stand_height_m" else (0.99 * np.array(data[name])).tolist()
    )
    with refuses("hexapod", name):
        robot_from_json(data)
