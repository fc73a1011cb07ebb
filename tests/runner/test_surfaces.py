"""What feet find out about surfaces: steps onto nothing, places that are cut out, planes that are
elsewhere.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stancekit.planners.errors import PlanningFailed
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.pieces import with_pause
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.polygon import Surface
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.closed_loop import ClosedLoop, LoopReport
from stancekit.runner.control.surfaces import MISSING_M, EmptyStep, found_offsets, without
from stancekit.runner.run import Runner
from stancekit.runner.settings import RunSettings
from stancekit.runner.worlds import Imperfections, make_world
from stancekit.runner.worlds.drives import Push
from tests.refusals import refuses

FAST = RunSettings(timing=Timing().at_pace(2.0))
COURSE = read_course("stairs", frames=3)
OUTCOME = TwoStagePlanner().solve(COURSE)
assert OUTCOME.solution is not None
PLAN = OUTCOME.solution
UP = np.tile([0.0, 0.0, 1.0], (2, 1))


def square(side_m: float, height_m: float = 0.0) -> Patch:
    corners = (
        0.5
        * side_m
        * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    )
    axes = {"normal": np.array([0.0, 0.0, 1.0]), "shear_reference": np.array([1.0, 0.0, 0.0])}
    return Patch(vertices_m=corners + np.array([0.0, 0.0, height_m]), friction=0.7, **axes)


def empty(felt_n: list[float], wanted_n: float = 20.0, foothold: int = 5) -> list[bool]:
    """Whether foot 1 is found to have come down on nothing, period after period, after a while in
    the air.
    """
    watch, found = EmptyStep(200.0, 2), list[bool]()
    for k, force in enumerate([0.0] * 5 + felt_n):
        sample = SimpleNamespace(
            foothold=np.array([0, -1 if k < 5 else foothold]),
            normals=UP,
            forces_n=np.array([20.0, wanted_n])[:, None] * UP,
        )
        target: Any = SimpleNamespace(sample=sample)
        state: Any = SimpleNamespace(forces_n=np.array([20.0, force])[:, None] * UP)
        found.append(bool(watch.found(target, state)[1]))
    return found[5:]


def test_a_foot_that_should_bear_and_never_did_came_down_on_nothing() -> None:
    assert empty([0.0] * 20).index(True) == 10  # 50 ms after it should
    assert not any(empty([5.0] * 12 + [0.0] * 40))  # it bore, and was lifted since: a push, no hole
    assert not any(empty([0.0] * 40, wanted_n=2.0))  # nothing is asked of it yet
    assert not any(empty([0.0] * 40, foothold=-1))


def test_what_is_around_a_window_and_the_window_are_the_patch() -> None:
    surface = Surface(square(0.4), 0.0)
    for centre in ([0.0, 0.0, 0.0], [0.19, 0.0, 0.0], [0.2, 0.2, 0.0]):
        window, rest = surface.window(np.array(centre), 0.1), surface.around(np.array(centre), 0.1)
        pieces = [*rest, *([] if window is None else [window])]
        area = sum(
            0.5 * np.linalg.norm(np.cross(*np.diff(p.vertices_m[[0, k, k + 1]], axis=0)))
            for p in pieces
            for k in range(1, len(p.vertices_m) - 1)
        )
        assert area == pytest.approx(0.16)
    assert surface.around(np.zeros(3), 1.0) == ()


def test_a_place_where_nothing_is_is_cut_out_of_later_candidates_alone_until_none_is_left() -> None:
    later = next(f for f in COURSE.footholds if f.frame == 1)
    patch, toe = later.candidates[0], later.candidates[0].centre_m
    cut = without(COURSE, patch, toe, 1)
    for before, after in zip(COURSE.footholds, cut.footholds, strict=True):
        if before.frame == 0:
            assert after.candidates == before.candidates
        for piece in after.candidates if before.frame else ():
            flat = np.abs((piece.centre_m - toe) @ patch.frame[:, 1:]).max()
            assert flat >= MISSING_M or abs((piece.centre_m - toe) @ patch.normal) > 1e-3
    small = replace(later, candidates=(patch.with_vertices(toe + 0.2 * (patch.vertices_m - toe)),))
    narrow = replace(COURSE, footholds=tuple(small if f is later else f for f in COURSE.footholds))
    with refuses(f"limb {later.limb}", "frame 1", kind=PlanningFailed):
        without(narrow, patch, toe, 1)


def test_planes_are_moved_to_where_feet_that_bear_find_them() -> None:
    patches = (square(0.4), square(0.4), square(0.4, 0.1))
    feet = np.array([[0.0, 0.0, 0.024], [0.1, 0.0, 0.022], [0.0, 0.0, 0.3]])
    forces = np.array([20.0, 20.0, 0.0])[:, None] * np.array([0.0, 0.0, 1.0])
    state: Any = SimpleNamespace(feet_m=feet, forces_n=forces)
    kinematics: Any = SimpleNamespace(radii_m=np.full(3, 0.012))
    found = found_offsets(patches, state, kinematics)
    assert found.offsets_m == pytest.approx((0.011,))  # the mean; the third bears nothing
    assert "1 surface found +11 mm from the plan" in found.line
    assert found.moved(patches[1]).centre_m == pytest.approx([0.0, 0.0, 0.011])
    assert found.moved(patches[2]) is patches[2]
    ground = COURSE.terrain[0]
    moved = replace(found, planes=(ground,)).course(COURSE)
    assert moved.terrain[0].centre_m == pytest.approx(ground.centre_m + 0.011 * ground.normal)
    assert TwoStagePlanner().solve(moved).solution is not None


def test_a_pause_is_a_key_frame_in_which_the_body_alone_moves() -> None:
    paused = with_pause(COURSE, 1)
    assert (paused.frames, paused.lifts) == (4, (*COURSE.lifts[:2], (), COURSE.lifts[2]))
    outcome = TwoStagePlanner().solve(paused)
    assert outcome.solution is not None
    np.testing.assert_array_equal(paused.holds[1], paused.holds[2])


def looped(terrain: tuple[Patch, ...]) -> LoopReport:
    world = make_world("mujoco", COURSE.robot)
    return ClosedLoop(COURSE, Runner(world, settings=FAST)).run(
        terrain, first=Accepted.verified(PLAN, "stairs")
    )


def test_a_step_onto_nothing_is_taken_back_and_planned_without_that_place() -> None:
    index = next(k for k, f in enumerate(COURSE.footholds) if (f.frame, f.limb) == (1, "RF"))
    place, toe = COURSE.patch(index, PLAN.choice), PLAN.toes_m[index]
    tread = next(
        k
        for k, patch in enumerate(COURSE.terrain)
        if abs((patch.centre_m - place.centre_m) @ place.normal) < 1e-3
        and patch.normal @ place.normal > 0.999
    )
    broken = Surface(COURSE.terrain[tread], 0.0).around(toe, 0.16)
    report = looped(
        (*COURSE.terrain[: tread - 1], *broken, *COURSE.terrain[tread + 1 :])
    )  # nor is there a riser
    assert report.succeeded, report.message
    assert report.surfaces == "limb RF: nothing at frame 1"
    assert report.replans == 1
    assert report.deviation_m < 0.02


@pytest.mark.parametrize("name", ["mujoco", "bullet"])
def test_a_push_gives_a_robot_that_falls_the_velocity_that_its_impulse_makes(name: str) -> None:
    if name == "bullet":
        pytest.importorskip("pybullet")
    push = Push(force_n=(30.0, 0.0, 0.0), at_s=0.05, seconds=0.1)
    standing, speeds = np.tile([0.0, 0.3, 0.0, 1.2], 6), list[float]()
    with make_world(name, COURSE.robot, imperfections=Imperfections(pushes=(push,))) as world:
        world.reset((square(1.0),), standing, np.array([0.0, 0.0, 3.0]), np.eye(3))
        for _ in range(60):
            speeds.append(float(world.step(standing).velocity[0]))
    assert abs(speeds[8]) < 1e-3
    assert np.mean(speeds[40:]) == pytest.approx(30.0 * 0.1 / COURSE.robot.mass_kg, rel=0.1)


def test_a_push_that_makes_no_sense_is_refused() -> None:
    with refuses("push.seconds"):
        Push(force_n=(1.0, 0.0, 0.0), at_s=0.0, seconds=0.0)
