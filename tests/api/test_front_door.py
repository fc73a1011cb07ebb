"""What the front door says to legal but odd calls: numbers of NumPy, two forms at once, settings
without a use.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import stancekit
from stancekit import Answer, Motion, Status
from stancekit.planners.problem.standing_map import StandingMap
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.methods import make_planner
from stancekit.planners.terrain.patch import Frame
from tests.doors import DOORS, PLACES, WALKS, ask, differences, questions
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import assert_names, refuses

BLOCK = """v -1 -1 0
v 1 -1 0
v 1 1 0
v -1 1 0
f 1 2 3
f 1 3 4
"""


def problem() -> stancekit.Problem:
    """One that has a posture."""
    return stancekit.sample("ground-3", rng=3)[0]


def level() -> stancekit.HeightField:
    """A square of 4 m."""
    return stancekit.HeightField.from_array(np.zeros((81, 81)), spacing_m=0.05)


def test_integers_of_numpy_are_integers(tmp_path):
    two: Any = np.int64(2)
    assert (
        stancekit.solve(problem(), stancekit.Micp(intervals=two)).status
        is stancekit.Status.FEASIBLE
    )
    assert stancekit.plan("stairs", frames=two).solution.com_m.shape == (2, 3)
    assert len(stancekit.label("wall-3", tmp_path / "rows", rows=(two, two), seed=two)) == 4
    assert len(stancekit.label("wall-3", tmp_path / "natural", rows=two)) == 2


def test_a_grid_is_not_cut_finer_than_memory_allows():
    with refuses("intervals"):
        stancekit.Micp(intervals=2**20)


def test_settings_of_courses_are_refused_with_postures():
    for name, method in (
        ("gap", stancekit.Exact(gap=0.5)),
        ("gap", stancekit.Micp(gap=0.5)),
        ("envelope_use", stancekit.Micp(envelope_use="shrink")),
        ("projection", stancekit.Micp(projection="fix-p")),
        ("reserve", stancekit.TwoStage(reserve=False)),
    ):
        with refuses(name):
            stancekit.solve(problem(), method)


def test_a_planner_of_another_kind_of_question_is_refused():
    with refuses("method"):
        stancekit.solve(problem(), make_planner("decoupled", of="courses"))
    for name in ("nlp", "two-stage", "micp", "decoupled"):
        assert (
            stancekit.plan("stairs", make_planner(name, of="courses"), frames=2).status
            is stancekit.Status.FEASIBLE
        )


def test_a_course_is_solved_for_its_contacts_alone():
    course = stancekit.load("stairs")
    answer = stancekit.solve(stancekit.plan("stairs", frames=2).problem, "two-stage")
    assert answer.status is stancekit.Status.FEASIBLE
    assert (answer.report, answer.solution.joints_rad, len(answer.solution.com_m)) == (
        None,
        None,
        2,
    )
    with refuses("method"):
        stancekit.solve(course, "p1")


def test_one_planner_answers_postures_and_courses():
    made = make_planner("two-stage")
    assert stancekit.solve(problem(), made).status is not stancekit.Status.UNDECIDED
    found = stancekit.plan("stairs", made, frames=2)
    assert found.status is stancekit.Status.FEASIBLE
    assert made.solve(found.problem).status is stancekit.Status.FEASIBLE
    with refuses("method"):
        make_planner("decoupled").solve(problem())
    with refuses("gap"):
        make_planner("exact", gap=0.5).solve(problem())


def test_settings_of_a_plan_are_refused_where_they_are_none():
    for name, value in (
        ("body", 3),
        ("push_n", -1.0),
        ("push_n", "much"),
        ("wrench", (1.0, 2.0)),
        ("standing", 3),
        ("checkpoint", 3),
    ):
        with refuses(name):
            stancekit.PlanSettings(**{name: value})
    leap = "leap-hard:0"
    for settings in (
        {"push_n": 1.0},
        {"prefer_margin": True},
        {"standing": "map.npz"},
        {"checkpoint": "c.json"},
    ):
        with refuses(next(iter(settings))):
            stancekit.plan(leap, settings=stancekit.PlanSettings(**settings))


def test_places_are_arrays_or_numbers_that_are_sound():
    over = stancekit.terrain(level())
    found = stancekit.plan(over, start=np.array([-0.3, 0.0]), goal=np.array([0.3, 0.0]), frames=3)
    assert found.status is stancekit.Status.FEASIBLE
    for odd in ((1e300, 0.0), (0.0, 0.0, 0.0), (float("nan"), 0.0), np.array(["a", "b"])):
        with refuses("start"):
            stancekit.plan(over, start=odd, goal=(0.3, 0.0))
        with refuses("goal"):
            stancekit.walk(level(), odd)
    for count in (0, -1, 1001):
        with refuses("frames", str(count)):
            stancekit.plan(over, start=(-0.3, 0), goal=(0.3, 0), frames=count)


def test_a_terrain_says_what_it_lacks(tmp_path):
    mesh = Path(tmp_path / "block.obj")
    mesh.write_text(BLOCK, encoding="utf-8")
    with refuses("start", "goal"):
        stancekit.plan(mesh)
    over = stancekit.terrain(level(), friction=0.8)
    slick = replace(over.pieces[0], patch=over.pieces[0].patch.with_friction(0.1))
    between: dict[str, Any] = {"start": (-0.3, 0.0), "goal": (0.3, 0.0), "frames": 2}
    with refuses("friction", "0.1", "0.8"):
        stancekit.plan(replace(over, pieces=(*over.pieces, slick)), **between)
    with refuses("footholds"):
        stancekit.plan(replace(over, pieces=()), **between)
    rough = stancekit.terrain(level(), friction=20.0)
    with refuses("friction"):
        stancekit.plan(rough, **between)
    with refuses("unit_m"):
        stancekit.terrain(level(), unit_m=2.0)
    with refuses("unit_m"):
        stancekit.terrain("ripple", unit_m=2.0)
    assert (
        stancekit.terrain(level(), unit_m=1.0, kind=None).area_m2 == over.area_m2
    )  # as the command gives them


def test_a_named_ground_is_smoothed_by_nobody() -> None:
    with refuses("smooth_m", "ripple"):
        stancekit.heights("ripple", smooth_m=0.1)


def test_a_question_that_cannot_be_met_is_an_answer_and_doubts_stand_in_it(tmp_path: Path) -> None:
    steep, mended = tmp_path / "steep.obj", tmp_path / "mended.obj"
    steep.write_text(re.sub(r"v (-?1) (-?1) 0", r"v \1 \2 \1", BLOCK), encoding="utf-8")
    solid = "v 2 2 0\nv 2.2 2 0\nv 2 2.2 0\nv 2 2 .2\nf 5 6 7\nf 5 7 8\nf 5 8 6\nf 6 8 7\n"
    mended.write_text(re.sub(r"v (-?)1 (-?)1 0", r"v \g<1>3 \g<2>3 0", BLOCK) + solid)
    ends: dict[str, Any] = {"start": (-0.5, -0.5), "goal": (-0.3, -0.5)}
    answer = stancekit.plan(steep, **ends)  # undecided, or explain asked for a proof
    assert_names(stancekit.explain(answer).message, "steep.obj", "steep")
    with pytest.warns(UserWarning, match="inside out"):
        envs, answer, rows, heights, mapped = (
            [
                make(
                    "stancekit.envs:stancekit/EnvelopeSelection-v0",
                    problem="terrain-3",
                    terrain=mended,
                )
                for make in (gymnasium.make, gymnasium.make_vec)
            ],
            stancekit.plan(mended, **ends),
            stancekit.label("terrain-3", tmp_path / "rows", rows=2, terrain=mended),
            stancekit.heights(mended),
            stancekit.map(mended, spacing_m=2.0, headings=1),
        )
    (doubt,) = answer.doubts
    assert_names(doubt, "mended.obj", "1 closed parts")
    assert [rows.header.doubts, *(list(env.unwrapped.doubts) for env in envs)] == 3 * [[doubt]]
    mapped.save(tmp_path / "map.npz")
    assert StandingMap.read(tmp_path / "map.npz").doubts == (doubt,)
    walked = stancekit.walk(heights, (0.2, 0.0), duration_s=2.0, chart="decoupled")
    for found in (answer, walked):
        stancekit.save(found, tmp_path / "kept.json")
        assert (
            stancekit.load(tmp_path / "kept.json").doubts
            == stancekit.verify(tmp_path / "kept.json").report.doubts
            == found.doubts
            == (doubt,)
        )
    pillar = np.pad(np.full((5, 5), 1.5), ((48, 28), (38, 38)))
    ground = stancekit.HeightField.from_array(pillar, spacing_m=0.05)
    assert_names(stancekit.walk(ground, (0.5, 0.0)).message, "goal", "1.5 m high")


def test_a_robot_of_limbs_alone_is_no_robot_to_draw_problems_of():
    limbs = stancekit.hexapod().limbs
    four = stancekit.Robot(
        name="four", mass_kg=10.0, limbs=(limbs[0], limbs[2], limbs[3], limbs[5])
    )
    for law in ("ground-3", "wall-3"):
        with refuses("robot"):
            stancekit.sample(law, robot=four)


def test_a_log_is_named_as_one_before_anything_is_written(tmp_path, course_plan):
    stancekit.save(course_plan("stairs", 2), tmp_path / "plan.json")
    before = (tmp_path / "plan.json").read_bytes()
    with refuses("log"):
        stancekit.run(tmp_path / "plan.json", log=tmp_path / "plan.json")
    assert (tmp_path / "plan.json").read_bytes() == before


@pytest.mark.parametrize("name", ["stairs:0.1:7"])
def test_a_plan_goes_over_a_ground_by_its_name_as_over_its_footholds(name: str) -> None:
    between: dict[str, Any] = {"start": (1.2, 0.0), "goal": (1.5, 0.0)}
    found, same = (
        stancekit.plan(name, **between),
        stancekit.plan(stancekit.terrain(name), **between),
    )
    np.testing.assert_array_equal(found.solution.toes_m, same.solution.toes_m)
    assert isinstance(found.problem, stancekit.Problem)
    assert found.problem.name == name


class Says:
    """Answers every question so."""

    name = "mine"

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def solve(self, _: Any) -> Any:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.fixture(scope="module")
def held() -> Answer[Motion]:
    return stancekit.solve(stancekit.sample("ground-3", rng=3)[0])


@pytest.fixture(scope="module")
def refuted() -> Answer[Motion]:
    return stancekit.solve(stancekit.sample("wall-3", rng=8)[0])


def test_a_posture_that_does_not_hold_is_refused(held):
    floating = replace(held.solution, forces_n=0.0 * held.solution.forces_n)
    outcome = stancekit.solve(held.problem, Says(replace(held, solution=floating, method="mine")))
    assert (outcome.status, outcome.solution) == (Status.UNDECIDED, None)
    assert "force_balance" in [group.name for group in outcome.report.refused]
    assert_names(outcome.message, "force_balance")


def test_a_proof_of_another_problem_is_refused(held, refuted):
    outcome = stancekit.solve(held.problem, Says(replace(refuted, problem=held.problem)))
    assert (outcome.status, outcome.certificate) == (Status.UNDECIDED, None)


@pytest.mark.parametrize("status", [Status.FEASIBLE, Status.INFEASIBLE])
def test_a_claim_without_evidence_is_undecided(status, held):
    outcome = stancekit.solve(held.problem, Says(Answer(status=status, method="mine")))
    assert (outcome.status, outcome.claim) == (Status.UNDECIDED, status.value)
    course = stancekit.load("stairs")
    planned = stancekit.plan(course, Says(Answer(status=status, method="mine")))
    assert (planned.status, planned.solution, planned.certificate) == (Status.UNDECIDED, None, None)


def test_evidence_that_is_accepted_counts(held, refuted):
    for whole, evidence in ((held, held.solution), (refuted, refuted.certificate)):
        for answer in (whole, evidence):
            outcome = stancekit.solve(whole.problem, Says(answer))
            assert outcome.status is whole.status
            assert outcome.method == "mine"


def test_a_planner_of_the_package_is_asked_itself(held):
    planner = Exact()
    assert stancekit.solve(held.problem, planner).bound == held.bound
    assert stancekit.solve(held.problem, planner).method == held.method


def test_an_answer_is_verified_by_what_it_rests_on(held, refuted):
    for answer in (held, refuted):
        report = stancekit.verify(answer)
        assert report.accepted
        assert report.answer is (answer.solution or answer.certificate)
    forged = replace(held, solution=replace(held.solution, forces_n=0.0 * held.solution.forces_n))
    assert not stancekit.verify(forged).accepted
    with refuses("verify"):
        stancekit.verify(Answer(status=Status.UNDECIDED, method="mine"))


ONE_KIND = """
class Postures:
    answers = "postures"

    def __init__(self, options):
        pass

    def solve(self, problem):
        return None

class Courses:
    answers = "courses"

    def __init__(self, options):
        pass

    def solve(self, course):
        return None

class Both:
    def __init__(self, options):
        pass

    def solve(self, problem):
        return None
"""


def test_a_planner_of_one_kind_of_question_says_so_where_it_is_asked_another(tmp_path, held):
    path = tmp_path / "kinds.py"
    path.write_text(ONE_KIND, encoding="utf-8")
    course = stancekit.load("stairs")
    for name, kinds in (
        ("Postures", "postures"),
        ("Courses", "courses"),
        ("Both", "postures courses"),
    ):
        asked = f"{path}:{name}"
        for kind, put in (
            ("postures", lambda asked=asked: stancekit.solve(held.problem, asked)),
            ("courses", lambda asked=asked: stancekit.plan(course, asked)),
        ):
            if kind in kinds:
                assert put().status is Status.UNDECIDED
                continue
            with refuses(asked, kind):
                put()


FEW = (
    "flat-2-0.4",
    "gait-all",
    "slick-2-0.1",
    "dog-0.7",
    "wall-0",
    "ground-1",
    "step-big",
    "beam-big",
)
QUESTIONS = {question.name: question for question in questions()}


def test_there_are_forty_questions_of_every_kind() -> None:
    expected = Counter(question.expected for question in QUESTIONS.values())
    assert len(QUESTIONS) >= 40
    assert expected["feasible"] >= 8
    assert expected["infeasible"] >= 8
    assert expected["undecided"] >= 4
    assert sum("robot" in question.keys for question in QUESTIONS.values()) >= 6
    assert set(FEW) <= set(QUESTIONS)


@pytest.mark.parametrize("name", FEW)
def test_every_door_says_the_same(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    question = QUESTIONS[name]
    replies = ask(question, tmp_path)
    assert not differences(replies)
    answers = [reply for each in replies.values() for reply in each.values()]
    assert len(answers) >= len(DOORS["course"]) - 1
    if question.expected:
        assert {reply.status for reply in answers} == {question.expected}
    assert all(bool(reply.proved) == (reply.status == "infeasible") for reply in answers)


POWERS = {"xyz": 1.0, "radius": 1.0, "size": 1.0, "value": 3.0, "effort": 4.0, "velocity": -0.5}
"""Powers of its size by which the numbers of a URDF rise; those of inertias by the fifth."""


def of_size(size: float) -> str:
    """The quadruped, this many times as large: one robot, by similarity."""

    def larger(found: re.Match[str]) -> str:
        power, numbers = POWERS.get(found[1], 5.0), found[2].split()
        return f'{found[1]}="{" ".join(repr(float(each) * size**power) for each in numbers)}"'

    return re.sub(
        r'(?<!axis )(\bxyz|radius|size|value|effort|velocity|i[xyz]{2})="(.*?)"',
        larger,
        quadruped(),
    )


@pytest.mark.parametrize("robot", ["hexapod", "dog"])
def test_a_plan_that_is_moved_and_turned_with_its_world_is_that_plan(
    robot: str, tmp_path: Path
) -> None:
    (tmp_path / "dog.urdf").write_text(quadruped())
    who = stancekit.robot("hexapod" if robot == "hexapod" else tmp_path / "dog.urdf")
    path = QUESTIONS["step-small"].file(tmp_path)
    ground, plans = stancekit.terrain(path, robot=who), list[stancekit.Answer[stancekit.Motion]]()
    worlds = [
        Frame(origin_m=np.array([400_000.0, 90_000.0, 0.0])),
        Frame(origin_m=np.array([4000.0, -3.0, 1.0]), heading_rad=-2.0),
    ]
    for world in (Frame(origin_m=np.zeros(3)), *worlds):
        start, goal = (world.places(np.array([*place, 0.0]))[:2] for place in PLACES.values())
        asked = {"robot": who.turned(world), "start": start, "goal": goal}
        plans.append(stancekit.plan(ground.moved(world), settings=WALKS, **asked))
    one, *others = plans
    for world, other in zip(worlds, others, strict=True):
        assert other.objective == pytest.approx(one.objective, rel=1e-4)
        there = world.inverse.places(other.solution.com_m)
        assert there == pytest.approx(one.solution.com_m, abs=3e-4)
        stancekit.save(other, tmp_path / "there.json")
        assert stancekit.verify(tmp_path / "there.json").accepted


def test_a_plan_that_is_mirrored_with_its_world_is_that_plan_mirrored(tmp_path: Path) -> None:
    mirror, plans = np.array([1.0, -1.0, 1.0]), list[stancekit.Motion]()
    floor, block = [-1.2, 1.8, -0.9, 1.3, 0.0], [0.1, 0.5, 0.2, 0.6, 0.05]
    for left in (1.0, -1.0):
        boxes = [[a, b, *sorted((left * c, left * d)), top] for a, b, c, d, top in (floor, block)]
        path = replace(QUESTIONS["step-small"], boxes=boxes).file(tmp_path)
        found = stancekit.plan(path, start=(0.0, 0.0), goal=(0.4, left * 0.1), settings=WALKS)
        assert found.solution is not None, found.message
        plans.append(found.solution)
    one, other = plans
    assert one.com_m * mirror == pytest.approx(other.com_m, abs=1e-4)
    places = np.array([limb.shoulder_m for limb in stancekit.hexapod().limbs])
    other_side = [int(np.linalg.norm(places * mirror - each, axis=1).argmin()) for each in places]
    for frame in range(len(one.com_m)):
        toes = other.toes_at(frame)[other_side]
        assert one.toes_at(frame) * mirror == pytest.approx(toes, abs=1e-3)


def test_a_symmetric_robot_stands_symmetrically() -> None:
    demo = Path(__file__).resolve().parents[2] / "configs" / "demo"
    stands = {leg.name: leg.stance_rad for leg in stancekit.robot(demo / "ant.yaml").legs.legs}
    for name in ("F", "M", "H"):
        left, right = stands[f"L{name}"], stands[f"R{name}"]
        assert left == pytest.approx(right * np.array([-1.0, 1.0, 1.0]), abs=1e-3)


def test_a_place_that_is_refused_is_named_as_it_was_given() -> None:
    with refuses("goal", "(-20, 30)"):
        stancekit.plan("slopes:0.2:1", start=(0.0, 0.0), goal=(-20.0, 30.0))


@pytest.fixture(scope="module")
def path_of_size(tmp_path_factory: pytest.TempPathFactory) -> Callable[[float, bool], np.ndarray]:
    """``path_of_size(size, legs)``: where the centre of mass of a robot goes that is so many times
    as large, over a step that is as much larger.
    """

    @cache
    def path(size: float, legs: bool) -> np.ndarray:
        folder, robot = tmp_path_factory.mktemp("size"), stancekit.hexapod()
        limbs = [
            replace(one, shoulder_m=size * one.shoulder_m, reach_m=size * one.reach_m)
            for one in robot.limbs
        ]
        robot = stancekit.Robot(name="six", mass_kg=size**3, limbs=tuple(limbs))
        if legs:
            (folder / "dog.urdf").write_text(of_size(size))
            robot = stancekit.robot(folder / "dog.urdf")
        step = QUESTIONS["step-small"]
        boxes = (size * np.array(step.boxes)).tolist()
        ground = stancekit.terrain(replace(step, boxes=boxes).file(folder), robot=robot)
        start, goal = (size * np.array(place) for place in PLACES.values())
        found = stancekit.plan(ground, start=start, goal=goal, robot=robot, settings=WALKS)
        assert found.status.value == "feasible", found.message
        return found.solution.com_m

    return path


@pytest.mark.parametrize("size", [0.25, 4.0])
@pytest.mark.parametrize("legs", [False, True])
def test_a_plan_of_a_robot_of_any_size_is_one_plan_scaled(
    size: float, legs: bool, path_of_size: Callable[[float, bool], np.ndarray]
) -> None:
    found, one = path_of_size(size, legs), path_of_size(1.0, legs)
    np.testing.assert_allclose(found / size, one, atol=0.05 if legs else 1e-5)


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[stancekit.Dataset]:
    folder, seen = tmp_path_factory.mktemp("rows"), list[tuple[int, int]]()

    def show(done: int, total: int) -> None:
        seen.append((done, total))

    train = stancekit.label("wall-3", folder / "train", rows=(4, 4), shard_size=4, progress=show)
    test = stancekit.label("wall-3", folder / "test", rows=(3, 3), natural=True, seed=1)
    assert seen == [(0, 8), (4, 8), (8, 8)]
    assert train.header.plan.shards == 2
    assert (test.header.plan.natural, len(test)) == (True, 6)
    return [train, test]


def test_selectors_are_fitted_and_compared_with_the_lift(rows: list[stancekit.Dataset]) -> None:
    train, test = rows
    seen = list[int]()
    fitted = stancekit.fit(train, "quantile", progress=lambda done, total: seen.append(done))
    scores = [
        stancekit.evaluate(
            one, test, projections=["fix-p"], progress=lambda done, total: seen.append(done)
        )
        for one in (fitted, "lift")
    ]
    assert [score.selector for score in scores] == ["selector", "lift"]
    assert seen[-1] == scores[0].p1_feasible.of + scores[0].p1_infeasible.of
    with refuses("workers"):
        stancekit.fit(train, "quantile", workers=2)
    with refuses("selector"):
        stancekit.evaluate(fitted, train)


def test_files_and_data_sets_are_verified_by_their_names(
    rows: list[stancekit.Dataset], tmp_path: Path
) -> None:
    problem = stancekit.sample("wall-3", rng=8)[0]
    certificate = stancekit.solve(problem).certificate
    assert certificate is not None
    proof = tmp_path / "proof.json"
    stancekit.save(certificate, proof)
    check = stancekit.verify(proof)
    assert isinstance(check, stancekit.FileCheck)
    assert (check.kind, check.accepted, check.to_json()["verdict"]) == (
        "no-posture",
        True,
        "accepted",
    )
    assert stancekit.verify(rows[0].ledger.folder).accepted
    for name, asked in (
        ("tolerance", {"tolerance": 1e-3}),
        ("robot", {"robot": "hexapod"}),
        ("course", {"course": "x"}),
    ):
        for where in (proof, rows[0].ledger.folder):
            with refuses(name):
                stancekit.verify(where, **asked)
    with refuses("none"):
        stancekit.verify("none")


def test_heights_of_a_file_are_walked_over_and_flattened(tmp_path: Path) -> None:
    np.save(tmp_path / "level.npy", np.zeros((21, 21)))
    field = stancekit.heights(tmp_path / "level.npy", spacing_m=0.2)
    assert field.domain_m == ((-2.0, 2.0), (-2.0, 2.0))
    fit = stancekit.warp(field, cells=(4, 4, 2))
    fit.map.check_fits(field)
    assert fit.report.least_det > 0.0
    raw = stancekit.walk(
        field, (0.2, 0.0), robot="hexapod", duration_s=2.5, chart="decoupled", raw=True
    )
    assert raw.effort.solves == 1  # the second phase would take more
    for name, asked in (
        ("seeds", {"seeds": 0}),
        ("dynamics", {"dynamics": "none"}),
        ("raw", {"raw": 1}),
    ):
        with refuses(name):
            stancekit.walk(field, (0.2, 0.0), **asked)
    for name, asked in (("cells", {"cells": (1, 4, 2)}), ("iterations", {"iterations": 0})):
        with refuses(name):
            stancekit.warp(field, **asked)
    with refuses("unit"):
        stancekit.heights(tmp_path / "level.npy", unit=1)
