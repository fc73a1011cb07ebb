"""The closed loop: what it makes of measurements, and that it finds its way with less friction than
was planned for.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from stancekit import Answer, Motion, Status
from stancekit.envs.distributions.postures import FIVE_LEGS
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import Array
from stancekit.planners.motion.plan_motion import Timing
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.boxes import boxes_of
from stancekit.planners.relaxation.envelope import EnvelopeSet, expert_envelopes
from stancekit.planners.robot import hexapod
from stancekit.planners.search.answer import Planner, PlanSettings
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.search.pieces import Standing, with_pause
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.terrain import Patch
from stancekit.planners.terrain.polygon import Surface
from stancekit.planners.verify import check_plan
from stancekit.runner.acceptance import Accepted
from stancekit.runner.control.closed_loop import ClosedLoop, LoopReport
from stancekit.runner.control.envelope_choice import (
    EnvelopeOrLift,
    Observation,
    Replanner,
    SelectorPolicy,
    about,
    chosen,
    triangular,
)
from stancekit.runner.control.estimation import (
    MISSING_M,
    EmptyStep,
    found_offsets,
    nearest_on,
    without,
)
from stancekit.runner.control.foot_placement import ContactFeedback
from stancekit.runner.control.tracker import FARTHEST, LoopStiffness
from stancekit.runner.run import Runner
from stancekit.runner.settings import LoopSettings, RunSettings
from stancekit.runner.worlds.world import Drives, Imperfections, Push, State, make_world
from tests.emulators.memory_world import PATIENT, MemoryWorld
from tests.emulators.slipping import SlippingWorld
from tests.refusals import refuses

FAST = RunSettings(timing=Timing().at_pace(2.0), limits=PATIENT)
PLANNER = TwoStage()


def looped(
    share: float, settings: LoopSettings, frames: int = 3
) -> tuple[LoopReport, list[Observation]]:
    seen: list[Observation] = []

    def policy(observation: Observation) -> Planner:
        seen.append(observation)
        return PLANNER

    course = read_course("walls", frames=frames)
    runner = Runner(make_world("mujoco", course.robot), settings=FAST)
    return ClosedLoop(course, runner, policy, settings).run(slippery(course, share).terrain), seen


def test_windows_are_walked_one_after_the_other_from_where_the_robot_stands() -> None:
    report, seen = looped(1.0, LoopSettings(horizon=1))
    assert report.succeeded, report.message
    assert (report.plans, report.replans, report.frames, report.friction.share) == (2, 0, 2, 1.0)
    assert [observation.frame for observation in seen] == [0, 1]
    assert seen[0].standing is None
    standing, state = seen[1].standing, seen[1].state
    away = np.linalg.norm(state.feet_m - standing.toes_m, axis=1)
    np.testing.assert_allclose(
        away, 0.012, atol=1e-3
    )  # a foot's radius from the surface on which it stands
    assert report.deviation_m < 0.01


def test_the_ending_of_a_loop_that_is_stopped_waits_for_no_planner() -> None:
    course, world, over = read_course("walls", frames=3), MemoryWorld(), threading.Event()
    windows = list[int]()

    def policy(observation: Observation) -> Planner:
        windows.append(observation.frame)
        if observation.frame:
            world.latch.trip("button")
            over.wait(300.0)  # a planner that thinks
        return PLANNER

    runner = Runner(world, settings=replace(FAST, ending="torque-off"), dry=False)
    report = ClosedLoop(course, runner, policy, LoopSettings(horizon=1)).run()
    over.set()
    assert windows == [0, 1]
    assert (report.message, report.ended.left, world.torque_on) == ("button", "torque off", False)
    assert report.ended.seconds < 5.0


def test_less_friction_than_planned_is_felt_by_feet_that_slide_and_planned_with() -> None:
    report, seen = looped(0.7, LoopSettings(replan_m=0.008), frames=3)
    assert report.succeeded, report.message
    assert report.replans >= 1
    assert report.friction.share == pytest.approx(0.7, abs=0.03)
    assert seen[-1].window.terrain[0].friction == pytest.approx(
        report.friction.share * seen[0].window.terrain[0].friction
    )


def test_where_bodies_can_do_one_key_frame_at_a_time_that_is_what_is_planned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    decided, prepared = list[str](), list[int]()
    prepare, decide = Runner.prepare, Runner.decide

    def refuse(self: Runner, accepted: Any, resumption: Any = None) -> Any:
        if resumption is not None and accepted.plan.problem.frames > 2:
            raise InvalidInput("expected a motion in which no bodies collide")
        prepared.append(accepted.plan.problem.frames)
        return prepare(self, accepted, resumption)

    def note(self: Runner, what: str, why: str) -> None:
        decided.append(what)
        decide(self, what, why)

    monkeypatch.setattr(Runner, "prepare", refuse)
    monkeypatch.setattr(Runner, "decide", note)
    report, _ = looped(0.7, LoopSettings(replan_m=0.008), frames=3)
    assert report.succeeded, report.message
    tries = [
        "bend the plan",
        "the next key frames alone",
        "bend the next key frames",
        "the next key frame alone",
    ]
    assert [what for what in decided if what in tries][:4] == tries
    assert prepared[0] == 3
    assert len(prepared) > 2
    assert set(prepared[1:]) == {2}


def test_without_planning_anew_it_keeps_its_first_plan() -> None:
    report, seen = looped(0.75, LoopSettings(replan_m=np.inf), frames=3)
    assert (report.plans, report.replans, len(seen)) == (1, 0, 1)
    assert report.friction.share == 1.0


def test_a_course_that_cannot_be_planned_fails_before_anything_moves() -> None:
    course = slippery(read_course("walls", frames=2), 0.05)
    runner = Runner(make_world("mujoco", course.robot), settings=FAST)
    with refuses("frame 0", kind=PlanningFailed):
        ClosedLoop(course, runner).run()
    assert runner.state is None


def dropping(settings: LoopSettings) -> LoopReport:
    """All surfaces lose friction while limbs swing."""
    course = read_course("walls", frames=3)
    world = SlippingWorld(course.robot, share=0.68)
    world.inject(
        "friction differs", 0.75
    )  # simulated time; at this pace limbs swing from 0.6 to 0.9 s
    return ClosedLoop(
        course, Runner(world, settings=FAST), lambda observation: PLANNER, settings
    ).run()


def test_feet_that_slide_while_others_swing_are_caught_and_the_rest_is_planned_anew() -> None:
    report = dropping(LoopSettings())
    assert report.succeeded, report.message
    assert report.replans >= 1
    assert report.deviation_m < 0.02
    assert report.friction.share == pytest.approx(0.68, abs=0.03)
    alone = dropping(LoopSettings(replan_m=np.inf))
    assert not alone.succeeded
    assert alone.deviation_m > 0.05


def test_the_nearest_point_of_a_patch_is_that_of_a_dense_search() -> None:
    rng = np.random.default_rng(0)
    corners = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.5, 0.3, 0.0], [0.1, 0.2, 0.0]])
    patch = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.5)
    dense = rng.dirichlet(0.4 * np.ones(4), 60000) @ corners
    for point in rng.uniform(-0.2, 0.7, (20, 3)):
        found = nearest_on(patch, point)
        best = np.linalg.norm(dense - point, axis=1).min()
        assert np.linalg.norm(found - point) <= best + 1e-9
        assert best - np.linalg.norm(found - point) < 5e-3


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (RunSettings, "ending", "torque_off"),
        (RunSettings, "hung", "no"),
        (RunSettings, "forces", "share"),
        (RunSettings, "check_limits", None),
        (RunSettings, "stops", ("a file",)),
        (RunSettings, "limits", {}),
        (ContactFeedback, "waits", "no"),
        (PlanSettings, "prefer_margin", "no"),
        (LoopSettings, "horizon", 2.5),
        (LoopSettings, "shares", ()),
        (LoopSettings, "shares", (0.8, 2.0)),
        (LoopSettings, "shares", (np.nan,)),
    ],
)
def test_a_setting_that_is_none_is_refused_before_a_run(
    kind: Callable[..., object], name: str, value: object
) -> None:
    with refuses(name):
        kind(**{name: value})


def test_a_policy_that_brings_no_planner_is_refused_before_anything_moves() -> None:
    course = read_course("walls", frames=2)
    runner = Runner(make_world("mujoco", course.robot), settings=FAST)
    with refuses("policy", "None"):
        ClosedLoop(course, runner, lambda observation: None).run()  # type: ignore[arg-type, return-value]


def test_settings_out_of_range_are_refused() -> None:
    with refuses("loop.tries"):
        LoopSettings(tries=0)
    with refuses("loop.replan_m"):
        LoopSettings(replan_m=-1.0)
    assert replace(LoopSettings(), replan_m=np.inf).replan_m == np.inf


AT_PACE = RunSettings(timing=Timing().at_pace(2.0))
COURSE = read_course("stairs", frames=3)
OUTCOME = TwoStage().solve(COURSE)
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
    kinematics: Any = SimpleNamespace(radii_m=np.full(3, 0.012), weight_n=60.0)
    found = found_offsets(patches, state, kinematics)
    assert found.offsets_m == pytest.approx((0.011,))  # the mean; the third bears nothing
    assert "1 surface found +11 mm from the plan" in found.line
    assert found.moved(patches[1]).centre_m == pytest.approx([0.0, 0.0, 0.011])
    assert found.moved(patches[2]) is patches[2]
    ground = COURSE.terrain[0]
    moved = replace(found, planes=(ground,)).course(COURSE)
    assert moved.terrain[0].centre_m == pytest.approx(ground.centre_m + 0.011 * ground.normal)
    assert TwoStage().solve(moved).solution is not None


def test_a_pause_is_a_key_frame_in_which_the_body_alone_moves() -> None:
    paused = with_pause(COURSE, 1)
    assert (paused.frames, paused.lifts) == (4, (*COURSE.lifts[:2], (), COURSE.lifts[2]))
    assert TwoStage().solve(paused).solution is not None
    np.testing.assert_array_equal(paused.holds[1], paused.holds[2])


def climbed(terrain: tuple[Patch, ...]) -> LoopReport:
    world = make_world("mujoco", COURSE.robot)
    return ClosedLoop(COURSE, Runner(world, settings=AT_PACE)).run(
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
    report = climbed(
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
        world.connect((square(1.0),), standing, np.array([0.0, 0.0, 3.0]), np.eye(3))
        for _ in range(60):
            speeds.append(float(world.step(standing).velocity[0]))
    assert abs(speeds[8]) < 1e-3
    assert np.mean(speeds[40:]) == pytest.approx(30.0 * 0.1 / COURSE.robot.mass_kg, rel=0.1)


REPLANNER = TwoStage()
REPLANNED = read_course("walls", frames=3)


@pytest.fixture(scope="module")
def standing() -> Standing:
    plan = REPLANNER.solve(REPLANNED).solution
    patches = tuple(plan.problem.patch(int(index), plan.choice) for index in plan.problem.holds[0])
    return Standing(
        com_m=plan.com_m[0],
        rotation_rad=plan.rotation_rad[0],
        toes_m=plan.toes_at(0),
        patches=patches,
    )


class Unless:
    """Solves windows but those that a condition refuses; ``seen``: all lifts that it was asked
    for.
    """

    def __init__(self, refuses: Callable[[Problem], bool]) -> None:
        self.refuses, self.seen = refuses, list[tuple[tuple[str, ...], ...]]()

    def solve(self, course: Problem) -> Answer[Motion]:
        self.seen.append(course.lifts)
        if self.refuses(course):
            return Answer(status=Status.UNDECIDED, method="told to", message="too hard")
        return REPLANNER.solve(course)


def replanner(planner: Unless) -> tuple[Replanner, list[str]]:
    decided = list[str]()
    runner: Any = SimpleNamespace(
        settings=RunSettings(),
        state=None,
        decide=lambda what, why: decided.append(f"{what}: {why}"),
    )
    friction: Any = SimpleNamespace(interval=SimpleNamespace(share=1.0, planned_on=1.0, slides=0))
    return Replanner(
        REPLANNED, lambda observation: planner, LoopSettings(shares=(1.0,)), runner, friction
    ), decided


def lifted(plan: Motion) -> list[int]:
    return [len(names) for names in plan.problem.lifts]


def test_where_three_feet_together_cannot_be_lifted_one_after_the_other_is(
    standing: Standing,
) -> None:
    planner = Unless(lambda course: len(course.lifts[1]) > 1)
    planning, decided = replanner(planner)
    plan = planning.plan(0, standing).plan
    assert lifted(plan) == [0, 1, 1, 1, 3]  # the next key frame's alone
    assert planning.course.frames == 5
    assert decided[0].startswith("one foot at a time: no plan otherwise, now counting on 1.00")


def test_and_all_that_come_where_that_is_not_enough(standing: Standing) -> None:
    planner = Unless(lambda course: max(map(len, course.lifts)) > 1)
    planning, _ = replanner(planner)
    assert lifted(planning.plan(0, standing).plan) == [0, 1, 1, 1, 1, 1, 1]
    assert [max(map(len, lifts)) for lifts in planner.seen] == [3, 3, 1]


def test_what_comes_after_the_end_is_given_up_last(standing: Standing) -> None:
    planning, decided = replanner(Unless(lambda course: bool(course.next_lift)))
    plan = planning.plan(0, standing).plan
    assert (lifted(plan), plan.problem.next_lift) == ([0, 3, 3], ())
    assert decided[0].startswith("no step after the last")


def test_a_course_that_has_a_plan_stays_as_it_is(standing: Standing) -> None:
    planning, decided = replanner(Unless(lambda course: False))
    assert planning.plan(0, standing).plan.problem.lifts == REPLANNED.lifts
    assert planning.course is REPLANNED
    assert decided == ["planned: counting on 1.00 of the course's friction"]


def test_before_anything_moves_the_course_is_not_made_easier() -> None:
    planner = Unless(lambda course: True)
    planning, decided = replanner(planner)
    with refuses("frame 0", kind=PlanningFailed):
        planning.plan(0, None)
    assert (len(planner.seen), decided, planning.course) == (1, [], REPLANNED)


LEARNED = expert_envelopes("wall")


class Always:
    """A selector with one answer; requests: the observations that it got."""

    def __init__(self, action: NDArray[Any]) -> None:
        self.action, self.requests = action, list[Mapping[str, NDArray[Any]]]()

    def predict(
        self, observation: Mapping[str, NDArray[Any]], state: Any = None
    ) -> tuple[NDArray[Any], Any]:
        self.requests.append(observation)
        return self.action, state


WINDOW = read_course("walls", frames=3)


def seen(window: Any = WINDOW) -> Observation:
    return Observation(window=window, standing=None, state=None, friction_share=1.0, frame=0)


def vector(learned: EnvelopeSet) -> NDArray[Any]:
    return np.concatenate([box.to_vector() for box in learned.envelopes])


def test_it_is_asked_about_every_stance_of_its_legs_or_their_images_and_its_boxes_are_planned_with() -> (
    None
):
    selector = Always(vector(LEARNED))
    found = chosen(selector, LEARNED, WINDOW)
    assert found is not None
    assert len(selector.requests) == len(WINDOW.stances) > 2
    assert selector.requests[0]["friction"].shape == (3,)
    assert selector.requests[0]["vertices"].shape == (
        3 * 3 * 3,
    )  # of triangles, as selectors learn from them
    for mine, other in zip(found.boxes, boxes_of(WINDOW, LEARNED), strict=True):
        np.testing.assert_array_equal(mine.low, other.low)
        np.testing.assert_array_equal(mine.high, other.high)
    policy = SelectorPolicy(selector, LEARNED)
    planner = policy(seen())
    assert isinstance(planner, EnvelopeOrLift)
    assert policy.answers == (0, 0)
    outcome = planner.solve(WINDOW)
    assert check_plan(outcome.solution).accepted
    assert (policy.answers, outcome.solution.provenance["p1"]) == ((1, 0), LEARNED.problem_class)


def test_a_stance_on_the_other_side_is_shown_in_the_mirror_and_all_from_the_nominal_com() -> None:
    selector = Always(vector(LEARNED))
    chosen(selector, LEARNED, WINDOW)
    shoulders = (
        np.array([limb.shoulder_m for limb in WINDOW.robot.select(LEARNED.legs)])
        / WINDOW.length_scale_m
    )
    sides = np.sign(shoulders[:, 1])
    for seen in selector.requests:
        np.testing.assert_allclose(seen["shoulders"].reshape(-1, 3), shoulders, atol=1e-6)
        frames, corners = seen["frames"].reshape(-1, 3, 3), seen["vertices"].reshape(-1, 3, 3)
        np.testing.assert_array_equal(np.sign(frames[:, 1, 0]), -sides)  # walls face the robot
        np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-6)
        around = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(around, axis=1)
        np.testing.assert_allclose(np.abs(np.vecdot(around, frames[:, :, 0])), length, rtol=1e-5)
        assert np.all(
            np.abs(corners.mean(axis=1) - shoulders)[:, [0, 2]] < 0.4
        )  # beside the legs, wherever the frame


def test_of_a_large_patch_a_triangle_about_where_the_toe_will_be_is_observed() -> None:
    square = Patch(
        vertices_m=np.array(
            [[-0.5, -0.5, 0.1], [0.5, -0.5, 0.1], [0.5, 0.5, 0.1], [-0.5, 0.5, 0.1]]
        ),
        normal=[0, 0, 1],
        shear_reference=[1, 0, 0],
        friction=0.5,
    )
    corners = about(square, np.array([0.2, 0.7, 0.9]), 0.06)
    np.testing.assert_allclose(np.linalg.norm(corners - [0.2, 0.5, 0.1], axis=1), 0.06)
    np.testing.assert_allclose(corners.mean(axis=0), [0.2, 0.5, 0.1])
    small = square.with_vertices(np.array([[0.0, 0.0, 0.1], [0.06, 0.0, 0.1], [0.0, 0.06, 0.1]]))
    np.testing.assert_array_equal(about(small, np.zeros(3), 0.06), small.vertices_m)


def test_a_choice_within_which_there_is_no_plan_is_planned_without() -> None:
    tight = 1e-6 * np.tile(np.repeat([-1.0, 1.0], 9), 2)
    assert tight.size == vector(LEARNED).size // len(LEARNED.envelopes)
    policy = SelectorPolicy(Always(tight), LEARNED)
    outcome = policy(seen()).solve(WINDOW)
    assert (policy.answers, outcome.solution.provenance["p1"]) == ((0, 1), "lift")


def test_what_is_planned_where_nothing_was_chosen_counts_as_planned_without() -> None:
    policy = SelectorPolicy(Always(vector(LEARNED)), expert_envelopes("wall", legs=FIVE_LEGS))
    outcome = policy(seen()).solve(WINDOW)
    assert (policy.answers, outcome.solution.provenance["p1"]) == ((0, 1), "lift")


def test_a_selector_that_would_never_be_asked_is_refused() -> None:
    policy = SelectorPolicy(Always(vector(LEARNED)), expert_envelopes("wall", legs=FIVE_LEGS))
    with refuses("selector"):
        policy.check_fits(WINDOW)
    SelectorPolicy(Always(vector(LEARNED)), LEARNED).check_fits(WINDOW)


def test_of_a_patch_with_more_corners_its_largest_triangle_is_observed() -> None:
    corners = np.array([[0.0, 0.0, 0.1], [0.3, 0.0, 0.1], [0.3, 0.1, 0.1], [0.1, 0.2, 0.1]])
    patch = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.5)
    np.testing.assert_array_equal(triangular(patch).vertices_m, corners[[0, 1, 3]])
    assert (
        triangular(triangular(patch)).vertices_m.tolist() == triangular(patch).vertices_m.tolist()
    )


PERIOD_S = 0.005


def drives() -> Drives:
    return Drives.of(hexapod().legs)


def state(sent: Array, angles: Array, rates: Array) -> State:
    no, still = np.zeros(3), np.zeros(6)
    return State(
        time_s=0.0,
        position_m=no,
        rotation=np.eye(3),
        velocity=still,
        angles_rad=angles,
        rates_rad_s=rates,
        torques_nm=angles,
        feet_m=np.zeros((6, 3)),
        forces_n=np.zeros((6, 3)),
        bump_n=0.0,
        sent_rad=sent,
    )


def found(
    loops: LoopStiffness,
    of: Drives,
    share: float,
    *,
    seconds: float,
    felt: bool = True,
    air: int = 0,
) -> float:
    """What is found of loops of this share; joints in the air, the first so many, say the
    contrary.
    """
    rng, stand = np.random.default_rng(2), np.arange(len(of.joints)) >= air
    for _ in range(round(seconds / PERIOD_S)):
        torque, rates = rng.normal(size=(2, len(stand))) * [[3.0], [0.5]]
        angles = rng.normal(size=len(stand))
        yields = torque + of.damping_nms_rad * rates
        sent = angles + yields / (np.where(stand, share, 1.0 / share) * of.stiffness_nm_rad)
        loops.see(state(sent, angles, rates), torque * felt, stand)
    return loops.share


@pytest.mark.parametrize("share", [0.7, 1.0, 1.3])
def test_the_share_is_found_by_the_legs_that_stand(share: float) -> None:
    of = drives()
    loops = LoopStiffness(of, PERIOD_S, 5.0)
    assert loops.share == 1.0
    assert found(loops, of, share, seconds=6.0, air=8) == pytest.approx(share, abs=0.03)
    assert found(loops, of, 1.0, seconds=30.0) == pytest.approx(1.0, abs=0.01)  # the past fades


def test_forces_that_are_felt_late_say_little_at_first() -> None:
    of = drives()
    loops = LoopStiffness(of, PERIOD_S, 5.0)
    assert found(loops, of, 1.0, seconds=0.02, felt=False) > 0.85
    assert found(loops, of, 1.0, seconds=10.0, felt=False) == pytest.approx(
        1.0 / FARTHEST, abs=0.02
    )


def test_nothing_is_found_of_loops_that_are_not_asked_or_not_known() -> None:
    of = drives()
    assert found(LoopStiffness(of, PERIOD_S, 0.0), of, 0.7, seconds=1.0) == 1.0
    assert (
        found(LoopStiffness(replace(of, yields=False), PERIOD_S, 5.0), of, 0.7, seconds=1.0) == 1.0
    )
