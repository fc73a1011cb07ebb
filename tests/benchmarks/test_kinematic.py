"""Planners without forces: what they place is within the published sets, and what they choose is
allowed.
"""

from __future__ import annotations

import importlib
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.published.kinematic import KinematicPlanner, Placed
from benchmarks.published.scene import FOLDER, SCENES, read_scene
from stancekit.planners.answer.answer import Status
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import read_motion
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import course_difference, read_course
from stancekit.planners.search.answer import Clock
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan

NEAR_M = 1e-5


def part(name: str, frames: int) -> Problem:
    """The beginning of a scene."""
    whole = read_scene(name)
    return replace(
        whole,
        footholds=tuple(put for put in whole.footholds if put.frame < frames),
        lifts=whole.lifts[:frames],
        com_nominal_m=whole.com_nominal_m[:frames],
        com_radius_m=whole.com_radius_m[:frames],
        goal_m=np.add(whole.footholds[0].toe_m, (0.5, 0.2, 0.47)),
    )


def misses(course: Problem, placed: Placed) -> dict[str, float]:
    """The worst of every kind of constraint, one after the other [m]."""
    names, found = (
        course.robot.limb_names,
        {"surface": 0.0, "reach": 0.0, "feet": 0.0, "sideways": 0.0},
    )
    for put, toe, chosen in zip(course.footholds, placed.toes_m, placed.choice, strict=True):
        patch = put.candidates[int(chosen)]
        found["surface"] = max(found["surface"], abs(float((toe - patch.centre_m) @ patch.normal)))
        low, high = patch.vertices_m.min(axis=0), patch.vertices_m.max(axis=0)
        found["surface"] = max(
            found["surface"], float(np.max(low - toe)), float(np.max(toe - high))
        )
    for stance in course.stances:
        for limb in stance.limbs:
            rows, toe = (
                course.robot.limbs[limb].reach_rows,
                placed.toes_m[course.holds[stance.frame, limb]],
            )
            out = rows.normals @ (toe - placed.com_m[stance.frame]) - rows.bounds_m
            found["reach"] = max(found["reach"], float(out.max()))
    for frame, lifted in enumerate(course.lifts):
        for pair in course.robot.relative_reach:
            if pair.limb in lifted:
                here, there = (
                    placed.toes_m[course.holds[frame, names.index(n)]]
                    for n in (pair.limb, pair.other)
                )
                found["feet"] = max(
                    found["feet"],
                    float((pair.rows.normals @ (there - here) - pair.rows.bounds_m).max()),
                )
        if lifted and frame + 1 < course.frames:
            step = placed.com_m[frame + 1, :2] - placed.com_m[frame, :2]
            found["sideways"] = max(found["sideways"], float(np.abs(step).max()))
    return found


@pytest.mark.parametrize("choice", ["l1", "mip"])
def test_feet_and_body_are_where_the_published_sets_have_them(choice):
    course = part("anymal-trot", 9)
    placed, message = KinematicPlanner(choice).place(course, Clock.start())
    assert not message
    assert max(misses(course, placed).values()) < NEAR_M


@pytest.mark.parametrize("solver", ["highs", "scip"])
def test_the_mixed_integer_program_chooses_surfaces_that_slacks_of_least_sum_leave_open(solver):
    """Published of the inclined surfaces: SL1M does not converge, the mixed-integer program
    does.
    """
    pytest.importorskip({"highs": "highspy", "scip": "pyscipopt"}[solver])
    course = part("anymal-inclined-surfaces", 26)
    placed, message = KinematicPlanner("mip", solver=solver).place(course, Clock.start())
    assert not message
    assert max(misses(course, placed).values()) < NEAR_M
    assert (
        len(
            {
                tuple(put.candidates[int(c)].normal)
                for put, c in zip(course.footholds, placed.choice, strict=True)
            }
        )
        > 1
    )


def test_what_has_no_forces_is_refused_as_planned_and_accepted_where_forces_are_found():
    course = part("anymal-trot", 9)
    outcome = KinematicPlanner("mip").solve(course)
    assert outcome.claim == "feasible"
    assert outcome.details["as_planned"] == 0.0
    assert "moment_balance" in outcome.message
    assert (outcome.status is Status.FEASIBLE) == bool(outcome.details["freed"])
    assert outcome.solution is not None
    assert check_plan(outcome.solution).accepted


def test_a_course_without_positions_is_claimed_not_proved():
    course = read_scene("anymal-complex")
    for choice in ("l1", "mip"):
        outcome = KinematicPlanner(choice).solve(course)
        assert outcome.status is Status.UNDECIDED
        assert outcome.message.startswith("kinematics: ")
        assert outcome.claim == ("infeasible" if choice == "mip" else "unknown")


def test_feet_alone_have_no_body():
    course = part("anymal-trot", 9)
    planner = KinematicPlanner("mip", body=False)
    placed, _ = planner.place(course, Clock.start())
    assert placed.com_m is None
    assert planner.solve(course).message == "there is no body in the plan"


def test_other_names_and_other_reach_are_refused():
    with pytest.raises(InvalidInput, match=r"^choice: expected one of l1, mip, got 'l2'$"):
        KinematicPlanner("l2")
    with pytest.raises(
        InvalidInput, match=r"^solver: expected one of highs, scip that is installed, got 'mosek'$"
    ):
        KinematicPlanner("mip", solver="mosek")
    with pytest.raises(InvalidInput, match=r"expected reach as half-spaces, got a ball$"):
        KinematicPlanner("mip").solve(read_course("stairs", frames=3))


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
    plan = TwoStage(programs=programs).solve(course).solution
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
    outcome = TwoStage(programs=programs).solve(course)
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
    outcome = TwoStage(programs=programs).solve(course)
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
    assert KinematicPlanner("mip").place(read_scene(path), Clock.start())[0] is not None


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


@pytest.fixture(scope="module")
def scenes():
    sys.path.insert(0, str(FOLDER.parent))
    yield importlib.import_module("scenes")
    sys.path.remove(str(FOLDER.parent))


def test_a_row_says_what_came_of_every_planner_and_is_not_measured_again(
    scenes, tmp_path, monkeypatch
):
    methods = ("mip-highs", "two-stage", "decoupled")
    asked = scenes.Arguments(scene=("anymal-complex",), method=methods, out=tmp_path)
    rows = {row["method"]: row for row in scenes.run(asked)}
    assert rows["two-stage"]["status"] == "infeasible"
    assert "reach" in rows["two-stage"]["message"]
    assert rows["mip-highs"]["status"] == "undecided"
    assert rows["mip-highs"]["claim"] == "infeasible"
    assert not any(row["success"] for row in rows.values())
    monkeypatch.setattr(scenes, "measure", lambda *_: pytest.fail("measured again"))
    assert {row["method"]: row for row in scenes.run(asked)} == rows


def test_a_scene_with_a_plan_has_its_files_and_a_line_on_the_page(scenes, tmp_path):
    keys = yaml.safe_load((FOLDER / "scenes" / "anymal-trot.yaml").read_text())
    scene = tmp_path / "pace.yaml"
    ours = {**keys["ours"], "path_m": [[-2.0, 0.0, 0.47], [-1.7, 0.0, 0.47]]}
    scene.write_text(yaml.safe_dump({**keys, "phases": keys["phases"][:3], "ours": ours}))
    asked = scenes.Arguments(scene=(str(scene),), method=("two-stage", "l1"), out=tmp_path)
    rows = list(scenes.run(asked))
    assert [row["verified"] for row in rows] == [True, True]
    assert rows[0]["steps"] == 6
    assert rows[1]["as_planned"] is False
    plan, _ = read_motion(tmp_path / "pace-two-stage.plan.json")
    assert check_plan(plan).accepted
    assert course_difference(read_course(tmp_path / "pace.course.json"), plan.problem) == ""
    page = scenes.page(rows, asked)
    assert "| pace | 6 | two-stage | yes |" in page
    assert "| pace | 6 | l1 | yes | no | yes | feasible |" in page
    assert "| l1 | 1 | 1 | 0 | 1 | 0 |" in page
    json.dumps(rows, allow_nan=False)


def test_scenes_and_methods_that_there_are_not_are_refused(scenes, tmp_path):
    with pytest.raises(InvalidInput, match=r"^method: expected one of l1, .*, got 'mip'$"):
        next(scenes.run(scenes.Arguments(method=("mip",), out=tmp_path)))
    with pytest.raises(InvalidInput, match=r"^scene: expected one of anymal-complex, .*"):
        next(scenes.run(scenes.Arguments(scene=("nowhere",), out=tmp_path)))
