"""Distances along a plan's path against finite differences, and a beam over the path that plans go
under.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stancekit import Motion
from stancekit.planners.problem.course_file import read_course, spec_from
from stancekit.planners.problem.course_layout import build_course
from stancekit.planners.projection.whole_body import WholeBodyLimits
from stancekit.planners.search.friction_margin import plan_with_reserve
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_plan

pytest.importorskip("pinocchio")
pytest.importorskip("coal")
from stancekit.planners.motion import joints
from stancekit.planners.projection import centre
from stancekit.planners.projection.centre import Nearness, PathClearance
from stancekit.planners.projection.whole_body import whole_body, with_joints
from stancekit.planners.robot import bodies
from stancekit.planners.robot.inverse_kinematics import descend
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import Leg
from stancekit.planners.search.witness import with_whole_body
from tests.refusals import assert_names

BEAM = {
    "name": "beam",
    "frames": 6,
    "gait": "tripod",
    "start_m": [0.0, 0.0, 0.2],
    "goal_m": [0.25, 0.0, 0.2],
    "stance": {"outward_m": 0.13, "down_m": 0.2},
    "body": {"com_radius_m": 0.09, "first_radius_m": 0.02},
    "steps": {"com_m": 0.14, "toe_m": 0.35, "rotation_rad": 0.15},
    "candidates": {"count": 1, "window_m": 0.26, "margin_m": 0.02},
    "terrain": {
        "kind": "polygons",
        "friction": 0.7,
        "polygons": [
            {"vertices_m": [[-1, -1, 0], [2, -1, 0], [2, 1, 0], [-1, 1, 0]]},
            {
                "vertices_m": [
                    [0.24, -0.5, 0.215],
                    [0.24, 0.5, 0.215],
                    [0.3, 0.5, 0.215],
                    [0.3, -0.5, 0.215],
                ],
                "footing": False,
            },
        ],
    },
}
"""A beam 6 cm wide across the path, whose under side is where the robot's back is."""


@pytest.fixture(scope="module")
def beam() -> Motion:
    outcome = plan_with_reserve(TwoStage(), build_course(spec_from(BEAM)))
    assert outcome.solution is not None
    return outcome.solution


class Weightless(Kinematics):
    """Of a robot whose legs weigh nothing: its centre of mass stays where it is in the body."""

    def com_offset(self, angles: np.ndarray) -> np.ndarray:
        return self.robot.origin_m


def test_slopes_are_those_of_finite_differences(
    walk: Callable[..., Motion], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the path alone, whose joints follow body and toes. What the centre of mass moves by with
    the legs, and what feet roll, is left out of the slopes, and out of this.
    """
    plan = with_joints(walk(3))
    monkeypatch.setattr(centre, "_with_keys", lambda path, moments, postures: (moments, postures))
    monkeypatch.setattr(centre, "_nearest", lambda near, clearance_m: near)
    monkeypatch.setattr(
        joints, "_rolled", lambda kinematics, moments, rotations, angles, normals: 0.0 * normals
    )
    looks = PathClearance(plan, Weightless(plan.problem.robot))
    start, rng, step = looks.nearness(plan, 0.02, 0.023), np.random.default_rng(0), 1e-5
    assert len(start.distance_m) > 100

    def moved(names: tuple[str, ...]) -> tuple[np.ndarray, Nearness]:
        parts = {
            name: np.zeros_like(getattr(plan, name))
            for name in ("com_m", "rotation_rad", "joints_rad", "toes_m")
        }
        for name in names:
            parts[name] = step * rng.standard_normal(parts[name].shape)
        parts["toes_m"][:, 2] = 0.0  # toes stay on the ground
        other = replace(plan, **{name: getattr(plan, name) + part for name, part in parts.items()})
        return np.concatenate([part.ravel() for part in parts.values()]), looks.nearness(
            other, 0.02, 0.023
        )

    for names in (
        ("com_m",),
        ("rotation_rad",),
        ("joints_rad",),
        ("toes_m",),
        ("com_m", "rotation_rad", "toes_m"),
    ):
        change, other = moved(names)
        assert len(other.distance_m) == len(start.distance_m)
        found, expected = start.slopes @ change, other.distance_m - start.distance_m
        largest = np.abs(expected).max()
        assert largest > 1e-3 * step
        assert np.abs(found - expected).max() < 0.02 * largest + 1e-9  # coal's tolerance


def test_slopes_of_feet_that_stay_from_their_path_are_those_of_finite_differences(
    walk: Callable[..., Motion], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a body so high that legs are too short, and feet stay on a ball about their hip; with the
    same left out.
    """

    def stretched(
        leg: Leg, feet: np.ndarray, start: np.ndarray, up: np.ndarray, **settings: float
    ) -> tuple[np.ndarray, np.ndarray]:
        away = feet - leg.hip_m
        near = leg.hip_m + away * np.minimum(
            1.0, 0.33 / np.linalg.norm(away, axis=1, keepdims=True)
        )
        angles, missed = descend(leg, near, start, up, **settings)
        assert missed.max() < 1e-6
        return angles, np.linalg.norm(feet - near, axis=1)

    plan = with_joints(walk(3))
    plan = replace(plan, com_m=plan.com_m + np.array([0.0, 0.0, 0.2]))
    monkeypatch.setattr("stancekit.planners.robot.inverse_kinematics.descend", stretched)
    monkeypatch.setattr(
        joints, "_rolled", lambda kinematics, moments, rotations, angles, normals: 0.0 * normals
    )
    looks = PathClearance(plan, Weightless(plan.problem.robot))

    def astray(one: Motion) -> tuple[np.ndarray, np.ndarray]:
        found = looks.nearness(one, 0.02, 0.023)
        feet = found.distance_m < -1e-3  # nothing else is so near to anything
        return found.distance_m[feet], found.slopes.toarray()[feet]

    start, slopes = astray(plan)
    assert len(start) >= 6
    rng, step = np.random.default_rng(0), 1e-4
    names = "com_m", "rotation_rad", "joints_rad", "toes_m"
    for moved in (("com_m",), ("rotation_rad",), ("toes_m",), ("com_m", "rotation_rad", "toes_m")):
        parts = {name: np.zeros_like(getattr(plan, name)) for name in names}
        for name in moved:
            parts[name] = step * rng.standard_normal(parts[name].shape)
        parts["toes_m"][:, 2] = 0.0
        other, _ = astray(
            replace(plan, **{name: getattr(plan, name) + part for name, part in parts.items()})
        )
        expected = slopes @ np.concatenate([part.ravel() for part in parts.values()])
        assert len(other) == len(start)
        assert np.abs(expected).max() > 0.1 * step
        assert np.abs(other - start - expected).max() < 0.03 * np.abs(expected).max()


def test_a_beam_over_the_path_is_gone_under_all_along_it(beam: Motion) -> None:
    before = check_plan(with_joints(beam), joints=True)
    assert before.contacts
    assert before.group("motion").verdict == "violated"
    assert before.group("motion").figures["worst"]["other"] == "patch 1"
    found = whole_body(beam, WholeBodyLimits(clearance_m=0.004))
    report = check_plan(found.plan, joints=True)
    assert report.accepted, report.failures
    assert report.checked == ("contacts", "joints", "torque", "bodies", "motion")
    assert found.before.depth_m > 0.005
    assert found.depth_m <= 0.001
    assert found.share <= max(found.before.share, 1.0)
    looks = PathClearance(found.plan, Kinematics(beam.problem.robot))
    apart = looks.nearness(found.plan, 0.004).distance_m
    assert apart.min() >= 0.002  # half of what is wanted is enough
    assert whole_body(beam, WholeBodyLimits(clearance_m=0.004, deepest_m=0.005)).steps == 0


def test_a_goal_inside_a_block_is_undecided_with_link_and_depth(beam: Motion) -> None:
    """A closed box in the end of the path, higher than the robot, which no step comes out of."""
    low, high = np.array([0.2, -0.05, 0.0]), np.array([0.4, 0.05, 0.4])
    polygons = [BEAM["terrain"]["polygons"][0]]  # type: ignore[index]
    for axis, side in ((a, s) for a in range(3) for s in (0, 1)):
        b, c = [(1, 2), (2, 0), (0, 1)][axis]
        corners = np.array([[low, high][side]] * 4)
        corners[:, b] = [low[b], high[b], high[b], low[b]]
        corners[:, c] = [low[c], low[c], high[c], high[c]]
        polygons.append({"vertices_m": corners[:: 1 if side else -1].tolist(), "footing": False})
    terrain = {**BEAM["terrain"], "polygons": polygons}  # type: ignore[dict-item]
    course = build_course(spec_from({**BEAM, "frames": 5, "terrain": terrain}))
    outcome = with_whole_body(plan_with_reserve(TwoStage(), course), WholeBodyLimits(steps=2))
    assert outcome.status.value == "undecided"
    assert outcome.certificate is None
    assert_names(outcome.message, "body", "patches 1 to 6")


def looks(plan: Motion) -> list[Mapping[str, Any]]:
    """What the verifier says of bodies, at key frames and on the way."""
    report = check_plan(plan, joints=True)
    return [report.group(name).figures for name in ("bodies", "motion")]


def test_links_that_come_too_near_to_each_other_are_bent_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Between walls thighs come to 30 mm of the body: what is too near is what is as near as the
    nearest, and .5 mm more. Hips, always 25 mm from it, are left out.
    """
    outcome = TwoStage().solve(read_course("walls"))
    assert outcome.solution is not None
    plan = with_joints(outcome.solution)
    solver = Kinematics(plan.problem.robot)
    hips = tuple(("body", f"{limb}_hip") for limb in plan.problem.robot.limb_names)
    monkeypatch.setattr(bodies, "_DRAWN_SO", {solver.model: bodies.Bodies(solver).drawn_so + hips})
    assert all(looked[name] == 0.0 for looked in looks(plan) for name in ("depth_m", "short_m"))
    with monkeypatch.context() as known:
        known.setattr(bodies, "TOUCH_M", 0.02)  # shanks are 10 mm from the ground by their feet
        assert all(0.009 < looked["short_m"] < 0.02 for looked in looks(plan))
    monkeypatch.setattr(bodies, "ROOM_M", 0.05)
    found = looks(plan)
    least = 0.05 - max(looked["short_m"] for looked in found)  # distance of the nearest two
    assert 0.0 < least < 0.05
    monkeypatch.setattr(bodies, "ROOM_M", least + 0.0005)
    found = whole_body(plan, WholeBodyLimits(clearance_m=least + 0.003))
    assert found.before.too_near_m == pytest.approx(0.0005, abs=1e-6)
    assert found.too_near_m == 0.0
    assert check_plan(found.plan, joints=True).accepted
