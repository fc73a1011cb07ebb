"""Published scenes as courses: every one is laid out as its phases say, and what contradicts itself
is refused.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.published.kinematic import KinematicPlanner
from benchmarks.published.scene import FOLDER, SCENES, read_scene
from stancekit.planners.answer.answer import Status
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Problem
from stancekit.planners.search.answer import Clock
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_certificate, check_plan

STEPS = {  # steps, as published
    "anymal-complex": 5,
    "anymal-flat-ground": 9,
    "anymal-inclined-surfaces": 17,
    "anymal-palet": 44,
    "anymal-plinth": 44,
    "anymal-race-slopes": 12,
    "anymal-stairs": 24,
    "anymal-stairs-free-gait": 6,
    "anymal-trot": 40,
    "talos-ramp": 22,
    "talos-rubble-stairs": 19,
}


def keys_of(name: str) -> dict:
    return yaml.safe_load((FOLDER / "scenes" / f"{name}.yaml").read_text())


def test_the_eleven_scenes_have_source_and_licence():
    assert tuple(STEPS) == SCENES
    for name in STEPS:
        source = keys_of(name)["source"]
        assert source["repository"] == "loco-3d/sl1m"
        assert len(source["commit"]) == 40
        assert source["licence"].startswith("BSD 2-Clause")


@pytest.mark.parametrize("name", STEPS)
def test_a_scene_is_laid_out_as_its_phases_say(name):
    keys, course = keys_of(name), read_scene(name)
    moved = [put for put in course.footholds if put.frame > 0]
    assert len(moved) == STEPS[name] == sum(len(lifted) for lifted in course.lifts)
    assert keys["steps"] * keys.get("rounds", 1) == STEPS[name]
    assert len(course.terrain) == len(keys["surfaces"])
    assert all(not lifted for lifted in course.lifts[::2])  # the body moves alone between two steps
    for patch, corners in zip(course.terrain, keys["surfaces"], strict=True):
        assert np.abs(patch.vertices_m - corners).max() < 1e-3
        assert patch.normal[2] > 0.8
    if keys["gait"] is not None:
        for put in moved:
            phase = keys["phases"][(put.frame - 1) // 2]
            allowed = phase["allowed"][phase["moving"].index(put.limb)]
            offered = {tuple(patch.vertices_m.ravel()) for patch in put.candidates}
            assert offered == {
                tuple(course.terrain[number].vertices_m.ravel()) for number in allowed
            }
    assert Problem.from_json(course.to_json()).to_json() == course.to_json()


@pytest.mark.parametrize("name", ["anymal-stairs", "anymal-trot"])
def test_a_scene_is_planned_within_its_own_polytopes(name, programs):
    course = read_scene(name)
    plan = TwoStagePlanner(programs=programs).solve(course).solution
    assert check_plan(plan).accepted
    feet = {
        put.limb: toe
        for put, toe in zip(course.footholds, plan.toes_m, strict=True)
        if put.frame == 0
    }
    for put, toe in zip(course.footholds, plan.toes_m, strict=True):
        feet[put.limb] = toe
        for pair in course.robot.relative_reach:
            if (
                put.frame > 0
                and pair.limb == put.limb
                and pair.other not in course.lifts[put.frame]
            ):
                apart = pair.rows.normals @ (feet[pair.other] - toe) - pair.rows.bounds_m
                assert apart.max() < 1e-6


def test_a_scene_whose_first_stance_is_out_of_reach_is_refuted(programs):
    """Four feet on a square of 0.3 m: a proof of the first frame, checked."""
    course = read_scene("anymal-complex")
    outcome = TwoStagePlanner(programs=programs).solve(course)
    assert outcome.status is Status.INFEASIBLE
    assert check_certificate(outcome.certificate.of(course)).accepted


def test_two_soles_have_no_room_on_the_bridge_of_the_ramp(tmp_path, programs):
    """Feet are 0.192 m apart sideways at least, soles 0.12 m wide, the bridge 0.30 m: a proof,
    whatever the yaws.

    So one foot at most is on it, and the two platforms are 3 m apart.
    """
    phases = [{"moving": [limb], "allowed": [[2]]} for limb in ("LF", "RF")]
    path = written(
        tmp_path, "talos-ramp", initial_contacts=None, phases=phases, ours={"start": "free"}
    )
    course = read_scene(path)
    assert {len(put.candidates) for put in course.footholds} == {4}  # yaws
    outcome = TwoStagePlanner(programs=programs).solve(course)
    assert outcome.status is Status.INFEASIBLE
    assert check_certificate(outcome.certificate.of(course)).accepted
    narrow = [[x, 0.8 * y] for x, y in keys_of("talos-ramp")["ours"]["sole_m"]]
    path = written(
        tmp_path,
        "talos-ramp",
        initial_contacts=None,
        phases=phases,
        ours={"start": "free", "sole_m": narrow},
    )
    found = KinematicPlanner("mip").place(read_scene(path), Clock.start())[0]
    assert found is not None


def written(tmp_path: Path, name: str, **changed: object) -> Path:
    keys = keys_of(name)
    ours = {**keys["ours"], **changed.pop("ours", {})}
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump({**keys, **changed, "ours": ours}))
    return path


@pytest.mark.parametrize(
    ("name", "changed", "message"),
    [
        (
            "anymal-palet",
            {"ours": {"start": "published"}},
            r"initial_contacts\.LHleg: .* got one 37\.9 mm off",
        ),
        (
            "anymal-race-slopes",
            {"ours": {"start": "published"}},
            r"initial_contacts\.RHleg: .* mm off the nearest",
        ),
        (
            "anymal-trot",
            {"surfaces": [[[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]]]},
            r"surfaces\[0\]: .* plane",
        ),
        (
            "anymal-trot",
            {"phases": [{"moving": ["LFleg"], "allowed": [[1]]}]},
            r"phases\[0\]\.allowed: .* 1 surfaces",
        ),
        (
            "anymal-trot",
            {"phases": [{"moving": ["tail"], "allowed": [[0]]}]},
            r"phases\[0\]: expected limbs",
        ),
        ("anymal-flat-ground", {"ours": {"order": []}}, r"phases\[0\]: expected ours\.order"),
        ("anymal-flat-ground", {"ours": {"order": ["tail"]}}, r"ours\.order: expected limbs among"),
        ("anymal-flat-ground", {"initial_contacts": None}, r"ours\.start: expected free"),
        (
            "anymal-trot",
            {"reach": {"folder": "nowhere"}},
            r"expected a folder of reach polytopes, found none",
        ),
        ("anymal-trot", {"wrong": 1}, r"wrong"),
        (
            "talos-ramp",
            {"ours": {"sole_m": [[0.6, 0.4], [0.6, -0.4], [-0.6, -0.4]]}},
            r"room for its sole",
        ),
    ],
)
def test_what_makes_no_scene_is_refused_in_one_line(tmp_path, name, changed, message):
    path = written(tmp_path, name, **changed)
    with pytest.raises(InvalidInput, match=message) as caught:
        read_scene(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_robot_and_a_folder_of_reach_at_once_are_refused():
    message = r"^anymal-trot: expected a robot or a folder of reach polytopes, got both"
    with pytest.raises(InvalidInput, match=message):
        read_scene("anymal-trot", robot="hexapod", reach="anywhere")


def test_boxes_of_reach_take_the_place_of_the_published_polytopes():
    course = read_scene("anymal-trot", robot="anymal")
    assert course.robot.limb_names == ("LF", "RF", "LH", "RH")
    assert {put.limb for put in course.footholds} == set(course.robot.limb_names)
    with pytest.raises(
        InvalidInput, match=r"robot: expected legs whose names begin as LF, RF, got"
    ):
        read_scene("talos-ramp", robot="anymal")
