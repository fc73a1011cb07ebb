"""Drawn courses: equal for equal seeds, within what was asked for, and climbable where that is
promised.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.stats import kstest

from stancekit.envs.distributions.courses import grips, icy_walls, perturbed
from stancekit.envs.distributions.cut import CutDistribution, Places
from stancekit.envs.distributions.postures import (
    DISTRIBUTIONS,
    PAPER_LEGS,
    Law,
    PostureDistribution,
    StandingRobot,
    composed,
    distribution,
    paper_stance,
)
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled, observe
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.codec import to_json
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import (
    builtin_courses,
    read_course,
    read_spec,
    spec_from,
)
from stancekit.planners.robot import Limb, Robot, hexapod
from stancekit.planners.robot.model import ReachRows
from stancekit.planners.robot.reach_sets import standing_toes
from stancekit.planners.robot.robot_file import named_robot, robot_of
from stancekit.planners.search.methods import PlannerOptions, make_planner
from stancekit.planners.terrain.reference import named_terrain
from tests.planners.robot.small_urdfs import leg, quadruped, robot
from tests.refusals import assert_names, refuses


def text(course):
    return json.dumps(course.to_json())


@pytest.mark.parametrize("name", builtin_courses())
def test_perturbed_courses_repeat_with_the_seed_and_differ_without(name):
    first, again, other = (
        perturbed(name, np.random.default_rng(seed), frames=4) for seed in (0, 0, 1)
    )
    assert text(first) == text(again)
    assert text(first) != text(other)
    assert text(first) != text(read_course(name, frames=4))


@pytest.mark.parametrize("name", builtin_courses())
def test_perturbed_courses_keep_path_gait_and_robot(name):
    usual, drawn = read_course(name), perturbed(name, np.random.default_rng(3))
    np.testing.assert_array_equal(drawn.com_nominal_m, usual.com_nominal_m)
    assert (drawn.lifts, drawn.next_lift, drawn.steps) == (
        usual.lifts,
        usual.next_lift,
        usual.steps,
    )
    assert len(drawn.footholds) == len(usual.footholds)


@pytest.mark.parametrize("name", builtin_courses())
def test_every_stance_of_perturbed_courses_holds(name):
    planner, rng = (
        make_planner("exact", PlannerOptions(time_limit_s=600.0)),
        np.random.default_rng(7),
    )
    for course in [perturbed(name, rng) for _ in range(2)]:
        choice = [
            next(i for i, patch in enumerate(p.candidates) if patch.friction > 0.0)
            for p in course.footholds
        ]
        for stance in course.stances:
            assert planner.solve(course.posture_problem(stance, choice)).status is Status.FEASIBLE


def test_no_amount_changes_nothing():
    for name in ("stairs", "walls", "tube", "ground-to-wall"):
        drawn, usual = perturbed(name, np.random.default_rng(0), amount=0.0), read_course(name)
        assert len(drawn.terrain) == len(usual.terrain)
        for one, other in zip(drawn.terrain, usual.terrain, strict=True):
            np.testing.assert_allclose(one.vertices_m, other.vertices_m, atol=1e-12)
            assert one.friction == other.friction


def test_a_users_course_can_be_perturbed_too(tmp_path):
    floor = {"vertices_m": [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], "friction": 0.5}
    described = {
        "name": "floor",
        "frames": 3,
        "start_m": [0, 0, 0.2],
        "goal_m": [0.1, 0, 0.2],
        "terrain": {"kind": "polygons", "polygons": [floor]},
    }
    path = tmp_path / "floor.yaml"
    path.write_text(yaml.safe_dump(described))
    for course in (described, path):
        given = spec_from(course) if isinstance(course, dict) else course
        drawn = perturbed(given, np.random.default_rng(0))
        assert 0.4 <= drawn.terrain[0].friction < 0.5
        assert 0.0 < np.abs(drawn.terrain[0].vertices_m - floor["vertices_m"]).max() <= 0.01


@pytest.mark.parametrize("frames", [4, 8])
@pytest.mark.parametrize("regions", [2, 4])
def test_icy_walls_have_ice_at_random_and_the_nearest_panels_as_candidates(frames, regions):
    rng = np.random.default_rng(0)
    courses = [icy_walls(rng, frames, regions) for _ in range(5)]
    panels = np.array([patch.friction for course in courses for patch in course.terrain])
    assert set(panels.tolist()) == {0.0, 1.0}
    assert abs(np.mean(panels == 0.0) - 0.5) < 4.0 * np.sqrt(0.25 / len(panels))
    assert {course.frames for course in courses} == {frames}
    assert {len(p.candidates) for course in courses for p in course.footholds} <= set(
        range(1, regions + 1)
    )
    assert max(len(p.candidates) for course in courses for p in course.footholds) == regions
    assert any(p.candidates[0].friction == 0.0 for course in courses for p in course.footholds)


def test_more_regions_give_more_courses_a_grip_everywhere():
    share = [
        np.mean([grips(icy_walls(np.random.default_rng(seed), 4, regions)) for seed in range(12)])
        for regions in (1, 2, 4)
    ]
    assert share == sorted(share)
    assert share[0] < 0.2 < share[2] < 1.0


def test_perturbed_icy_walls_offer_every_toe_a_grip():
    rng = np.random.default_rng(0)
    assert all(grips(perturbed("icy-walls", rng, frames=4)) for _ in range(5))


def test_walls_of_nothing_but_ice_are_given_up(monkeypatch):
    monkeypatch.setattr("stancekit.envs.distributions.courses.ICE", 1.0)
    monkeypatch.setattr("stancekit.envs.distributions.courses.REDRAWS", 3)
    with refuses("icy-walls"):
        perturbed("icy-walls", np.random.default_rng(0))


def test_a_chance_beyond_one_is_refused():
    with refuses("ice"):
        icy_walls(np.random.default_rng(0), ice=1.5)


def test_perturbing_does_not_touch_the_description():
    spec = read_spec("tube")
    before = spec.model_dump()
    perturbed(spec, np.random.default_rng(0))
    assert spec.model_dump() == before


SAMPLES = 300
LEGS = {
    "ground-3": ("RF", "RR", "LM"),
    "wall-3": ("RF", "RR", "LM"),
    "wall-5": ("RF", "RM", "RR", "LF", "LR"),
}
FRICTION = {"ground-3": (0.1, 0.8), "wall-3": (0.1, 1.2), "wall-5": (0.1, 1.2)}
NAMES = pytest.mark.parametrize("name", list(LEGS))
OF_CHANCE = 1e-3
"""A uniform distribution fails these tests for one seed in a thousand; the seeds are fixed."""


@pytest.fixture(scope="module")
def samples():
    """SAMPLES problems of every distribution."""
    found = {}
    for name, terrain in DISTRIBUTIONS.items():
        rng = np.random.default_rng(2024)
        found[name] = [terrain.sample(rng) for _ in range(SAMPLES)]
    return found


def contacts(problems):
    return [contact for problem in problems for contact in problem.contacts]


def nominal(name, contact):
    """Nominal normal and patch centre of a limb, from DESIGN §3."""
    shoulder = contact.shoulder_m
    if name.startswith("ground"):
        outward = shoulder / np.linalg.norm(shoulder)
        return np.array([0.0, 0.0, 1.0]), shoulder + 0.15 * outward - [0.0, 0.0, 0.20]
    side = 1.0 if contact.leg.startswith("L") else -1.0
    return np.array([0.0, -side, 0.0]), np.array([shoulder[0], 0.40 * side, shoulder[2]])


def is_uniform(values, low, high):
    values = np.asarray(values)
    assert values.min() >= low - 1e-12
    assert values.max() <= high + 1e-12
    return kstest(values, "uniform", args=(low, high - low)).pvalue > OF_CHANCE


def test_there_are_the_three_classes_of_the_paper():
    assert {name: terrain.legs for name, terrain in DISTRIBUTIONS.items()} == LEGS
    assert {name: terrain.friction for name, terrain in DISTRIBUTIONS.items()} == FRICTION
    with pytest.raises(TypeError):
        DISTRIBUTIONS["ice"] = DISTRIBUTIONS["ground-3"]


@NAMES
def test_the_limbs_are_the_robots_in_the_order_of_the_class(samples, name):
    limbs = {limb.name: limb for limb in hexapod().limbs}
    for problem in samples[name]:
        assert problem.legs == LEGS[name]
        for contact in problem.contacts:
            np.testing.assert_array_equal(contact.shoulder_m, limbs[contact.leg].shoulder_m)
            assert contact.reach_m == limbs[contact.leg].reach_m == 0.35


@NAMES
def test_the_body_is_the_robots(samples, name):
    for problem in samples[name]:
        assert (problem.mass_kg, problem.gravity_m_s2, problem.force_scale_n) == (
            10.0,
            9.81,
            10.0 * 9.81,
        )
        assert (problem.length_scale_m, problem.com_radius_m.tolist(), problem.tilt_limit_rad) == (
            0.6,
            [0.08],
            0.2618,
        )
        assert problem.com_nominal_m.tolist() == [[0.0, 0.0, 0.0]]
        for contact in problem.contacts:
            assert contact.force_min.tolist() == [0.0, -1.0, -1.0]
            assert contact.force_max.tolist() == [1.0, 1.0, 1.0]


@NAMES
def test_every_patch_is_an_equilateral_triangle_of_uniform_circumradius(samples, name):
    radii = []
    for contact in contacts(samples[name]):
        vertices = contact.patch.vertices_m
        assert vertices.shape == (3, 3)
        edges = np.linalg.norm(vertices - np.roll(vertices, 1, axis=0), axis=1)
        np.testing.assert_allclose(edges, edges[0], rtol=1e-9)
        np.testing.assert_allclose((vertices - vertices[0]) @ contact.patch.normal, 0.0, atol=1e-12)
        radii.append(edges[0] / np.sqrt(3.0))
    assert is_uniform(radii, 0.03, 0.08)


@NAMES
def test_normals_lean_by_a_uniform_angle_up_to_30_degrees_in_any_direction(samples, name):
    angles, azimuths = [], []
    for contact in contacts(samples[name]):
        axis, _ = nominal(name, contact)
        normal = contact.patch.normal
        angles.append(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(axis, normal)), axis @ normal)))
        first, second = np.roll(np.abs(axis), 1), np.roll(np.abs(axis), 2)
        azimuths.append(np.arctan2(normal @ second, normal @ first))
    assert is_uniform(angles, 0.0, 30.0)
    assert is_uniform(azimuths, -np.pi, np.pi)


@NAMES
def test_centres_are_uniform_about_their_nominal_place(samples, name):
    offsets = np.array(
        [c.patch.vertices_m.mean(axis=0) - nominal(name, c)[1] for c in contacts(samples[name])]
    )
    widths = (0.20, 0.20, 0.10) if name.startswith("ground") else (0.15, 0.06, 0.15)
    for axis, width in enumerate(widths):
        assert is_uniform(offsets[:, axis], -width, width)


@NAMES
def test_friction_is_uniform_in_the_range_of_the_class(samples, name):
    assert is_uniform([c.patch.friction for c in contacts(samples[name])], *FRICTION[name])


@NAMES
def test_limbs_of_one_problem_are_drawn_apart(samples, name):
    friction = np.array([[c.patch.friction for c in problem.contacts] for problem in samples[name]])
    assert np.all(
        np.abs(np.corrcoef(friction.T) - np.eye(friction.shape[1])) < 4.0 / np.sqrt(SAMPLES)
    )


@NAMES
def test_z_is_up_the_wall_and_forward_on_the_ground(samples, name):
    for contact in contacts(samples[name]):
        z = contact.patch.frame[:, 2]
        ahead = (
            np.array([1.0, 0.0, 0.0]) if name.startswith("ground") else np.array([0.0, 0.0, 1.0])
        )
        assert z @ ahead >= np.cos(np.deg2rad(30.0)) - 1e-12
        assert abs(np.cross(contact.patch.normal, z) @ ahead) < 1e-12


@NAMES
def test_the_same_seed_draws_the_same_problems_and_another_seed_others(name):
    def text(seed):
        rng = np.random.default_rng(seed)
        return [json.dumps(distribution(name).sample(rng).to_json()) for _ in range(3)]

    assert text(7) == text(7)
    assert len({*text(7), *text(8)}) == 6


@NAMES
def test_samples_are_good_files(samples, name):
    for problem in samples[name][:30]:
        assert (
            Problem.from_json(json.loads(json.dumps(problem.to_json()))).to_json()
            == problem.to_json()
        )


def test_another_robot_keeps_its_own_mass_and_limbs():
    crab = replace(hexapod(), name="crab", mass_kg=3.0)
    terrain = PostureDistribution(
        name="mine", terrain="wall", legs=("LM",), friction=(0.5, 0.5), robot=crab
    )
    problem = terrain.sample(np.random.default_rng(0))
    assert problem.legs == ("LM",)
    assert problem.weight_n == problem.force_scale_n == 3.0 * 9.81
    assert problem.contacts[0].patch.friction == 0.5


def test_a_limb_that_the_robot_does_not_have_is_named():
    terrain = replace(DISTRIBUTIONS["wall-3"], legs=("RF", "tail"))
    with refuses("leg"):
        terrain.sample(np.random.default_rng(0))


def test_a_name_that_is_none_is_answered_with_those_there_are():
    assert distribution("wall-5") is DISTRIBUTIONS["wall-5"]
    with refuses("distribution"):
        distribution("ice-3")


GROUNDS = ["stairs:0.3:7"]
PLANE = "v -2 -2 {0}\nv 2 -2 {1}\nv 2 2 {1}\nv -2 2 {0}\nf 1 2 3\nf 1 3 4\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dog")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.obj").write_text(PLANE.format(0.3, 0.3))
    (folder / "slope.obj").write_text(PLANE.format(-0.4, 0.4))
    (folder / "steep.obj").write_text(PLANE.format(-3.0, 3.0))
    (folder / "stone.obj").write_text("v 0 0 0\nv .2 0 0\nv .2 .2 0\nv 0 .2 0\nf 1 2 3\nf 1 3 4\n")
    np.save(folder / "slope.npy", np.repeat(0.2 * 0.05 * np.arange(60.0)[:, None], 60, axis=1))
    return folder


@pytest.fixture
def dog(folder: Path) -> str:
    return str(folder / "dog.urdf")


def drawn(name: str, count: int = 20, **files: str | Path) -> list[Problem]:
    source, rng = distribution(name, **files), np.random.default_rng(0)
    return [source.sample(rng) for _ in range(count)]


def centres(problem: Problem) -> np.ndarray:
    return np.array([contact.patch.vertices_m.mean(axis=0) for contact in problem.contacts])


# ----------------------------------------------------------------------------------------------------
# robot × law


def test_the_default_hexapod_by_its_name_has_the_papers_classes_as_they_were() -> None:
    for name, source in DISTRIBUTIONS.items():
        assert distribution(name, robot="hexapod") is source
        standing = StandingRobot.of(None)
        again = composed(
            name,
            source.terrain,
            standing,
            standing.legs(len(source.legs), name),
            source.friction,
            None,
        )
        one, other = (each.batch(np.random.default_rng(3), 50) for each in (source, again))
        assert again.name == name
        for part in ("vertices_m", "normals", "friction"):
            np.testing.assert_array_equal(getattr(one, part), getattr(other, part))
        assert one.problem(7).to_json() == other.problem(7).to_json()


def test_on_the_ground_patches_are_about_the_toes_of_the_robot_as_it_stands(dog: str) -> None:
    model, source = named_robot(dog), distribution("ground-4", robot=dog)
    assert source.name == f"ground-4-of-{model.identity}"
    size = StandingRobot.of(dog).reach_m / 0.35
    problems = drawn("ground-4", robot=dog)
    off = np.array([centres(problem) for problem in problems]) - standing_toes(model)
    assert np.all(np.abs(off) <= size * np.array([0.2, 0.2, 0.1]) + 1e-12)
    assert np.all(np.abs(off).max(axis=(0, 1)) > 0.9 * size * np.array([0.2, 0.2, 0.1]))
    assert all(
        contact.patch.normal[2] > np.cos(np.deg2rad(30.0)) - 1e-12
        for p in problems
        for contact in p.contacts
    )


def test_limbs_that_no_file_has_are_those_of_another_robot(dog: str) -> None:
    own = robot_of(dog)
    shorter = tuple(replace(limb, reach_m=0.8 * limb.reach_m) for limb in own.limbs)
    others = [
        replace(own, limbs=shorter),
        *(Robot(name="mine", mass_kg=own.mass_kg, limbs=limbs) for limbs in (shorter, own.limbs)),
    ]
    names = [distribution("ground-4", robot=each).name for each in (dog, own, *others)]
    assert names[0] == names[1]
    assert len(set(names)) == 4


def test_scenes_carry_the_robots_own_legs_mass_and_name(dog: str) -> None:
    model, own = named_robot(dog), StandingRobot.of(dog).robot
    (problem,) = drawn("wall-3", 1, robot=dog)
    assert problem.robot.identity == model.identity
    assert (problem.mass_kg, problem.tilt_limit_rad) == (model.mass_kg, 0.0)
    for contact, limb in zip(problem.contacts, own.select(problem.legs), strict=True):
        assert contact.reach_rows is not None
        assert limb.reach_rows is not None
        assert to_json(contact.reach_rows) == to_json(limb.reach_rows)
        np.testing.assert_array_equal(contact.shoulder_m, limb.shoulder_m)
    assert Problem.from_json(problem.to_json()).to_json() == problem.to_json()


def test_the_walls_are_as_far_to_either_side_and_within_the_legs_own_reach(dog: str) -> None:
    source = distribution("wall-4", robot=dog)
    stance = source.stance  # type: ignore[attr-defined]
    side = np.sign(standing_toes(named_robot(dog))[:, 1])
    away = side * stance.centre_m[:, 1]
    np.testing.assert_allclose(away, away[0])
    np.testing.assert_array_equal(stance.normal, np.outer(-side, [0.0, 1.0, 0.0]))
    for limb, centre in zip(StandingRobot.of(dog).robot.limbs, stance.centre_m, strict=True):
        thick = np.abs(stance.room_m[:, 1]).max()
        assert np.max(limb.reach_rows.normals @ centre - limb.reach_rows.bounds_m) < thick


def test_a_robot_of_any_size_and_weight_sees_the_same_scenes(dog: str) -> None:
    """What policies see and boxes are of is non-dimensional: it stays where all lengths and the
    mass are others.
    """
    small = StandingRobot.of(dog)

    def limb(one: Limb, k: float) -> Limb:
        rows = ReachRows(normals=one.reach_rows.normals, bounds_m=k * one.reach_rows.bounds_m)
        return Limb(
            name=one.name, shoulder_m=k * one.shoulder_m, reach_m=k * one.reach_m, reach_rows=rows
        )

    def sized(k: float) -> StandingRobot:
        limbs = tuple(limb(one, k) for one in small.robot.limbs)
        body = Robot(
            name="giant", mass_kg=k**3 * small.robot.mass_kg, limbs=limbs, identity="giant-0"
        )
        return StandingRobot(robot=body, toes_m=k * small.toes_m, reach_m=k * small.reach_m)

    laws: tuple[Law, ...] = ("ground", "wall")
    for law in laws:
        scenes = [
            composed("x", law, sized(k), ("LF", "RF", "RH"), (0.1, 0.8), None).sample(
                np.random.default_rng(4)
            )
            for k in (1.0, 2.5)
        ]
        one, other = (observe(Scaled.of(scene)) for scene in scenes)
        for name in one:
            np.testing.assert_allclose(one[name], other[name], atol=2e-6)
        assert scenes[1].force_scale_n == pytest.approx(
            2.5**3 * float(scenes[0].force_scale_n or 0.0)
        )


def test_so_many_legs_are_those_that_hold_the_centre_of_mass_best() -> None:
    toes = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-2.0, 0.1, 0.0], [0.1, 0.1, 0.0]])
    limbs = tuple(Limb(name=name, shoulder_m=np.zeros(3), reach_m=1.0) for name in "abcd")
    standing = StandingRobot(
        robot=Robot(name="four", mass_kg=1.0, limbs=limbs), toes_m=toes, reach_m=1.0
    )
    assert standing.legs(3, "ground-3") == ("a", "b", "c")
    assert standing.legs(4, "ground-4") == ("a", "b", "c", "d")
    default = StandingRobot.of(None)
    assert {count: default.legs(count, "") for count in PAPER_LEGS} == PAPER_LEGS
    assert len(distribution("ground-6").sample(np.random.default_rng(0)).contacts) == 6
    np.testing.assert_array_equal(default.toes_m, paper_stance(hexapod().limbs, "ground").centre_m)


# -------------------------------------------------------------------------------------------------
# cut from a file


def test_scenes_of_flat_ground_have_all_patches_at_one_height_below_the_body(
    dog: str, folder: Path
) -> None:
    toes = standing_toes(named_robot(dog))
    for problem in drawn("terrain-4", robot=dog, terrain=folder / "flat.obj"):
        heights = np.concatenate([contact.patch.vertices_m[:, 2] for contact in problem.contacts])
        np.testing.assert_allclose(heights, toes[:, 2].mean(), atol=1e-12)
        off = (centres(problem) - toes)[:, :2]
        assert np.all(np.abs(off) <= 0.2 * StandingRobot.of(dog).reach_m / 0.35 + 1e-9)


@pytest.mark.parametrize("file", ["slope.obj", "slope.npy"])
def test_scenes_of_a_slope_have_all_patches_in_it_whatever_the_heading(
    dog: str, folder: Path, file: str
) -> None:
    headings = []
    for problem in drawn("terrain-3", robot=dog, terrain=folder / file):
        corners = np.concatenate([contact.patch.vertices_m for contact in problem.contacts])
        for contact in problem.contacts:
            assert contact.patch.normal[2] == pytest.approx(1.0 / np.sqrt(1.04), abs=1e-6)
            np.testing.assert_allclose(
                (corners - corners[0]) @ contact.patch.normal, 0.0, atol=1e-6
            )
        headings.append(np.arctan2(*problem.contacts[0].patch.normal[1::-1]))
    assert np.ptp(headings) > np.pi


def test_places_to_stand_are_as_far_from_every_edge_as_they_say(folder: Path) -> None:
    places = Places.of(folder / "stone.obj", 0.03)
    x, y, _ = places.points_m.T
    np.testing.assert_allclose(places.free_m, np.min([x, y, 0.2 - x, 0.2 - y], axis=0), atol=1e-9)
    assert len(x) > 50
    assert places.free_m.min() >= 0.03
    assert places.free_m.max() == pytest.approx(0.1)


def test_a_batch_is_what_as_many_samples_are(dog: str, folder: Path) -> None:
    source = distribution("terrain-3", robot=dog, terrain=folder / "slope.obj")
    batch = source.batch(np.random.default_rng(5), 6)
    rng = np.random.default_rng(5)
    assert [problem.to_json() for problem in batch.problems] == [
        source.sample(rng).to_json() for _ in range(6)
    ]


def test_a_terrain_is_named_by_its_file_and_what_is_in_it(
    dog: str, folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "flat.obj").write_text(PLANE.format(0.3, 0.3))
    files = (tmp_path / "flat.obj", folder / "slope.obj")
    same, other = (distribution("terrain-3", robot=dog, terrain=file).name for file in files)
    assert same == distribution("terrain-3", robot=dog, terrain=folder / "flat.obj").name != other
    assert same.startswith(f"terrain-3-of-{named_robot(dog).identity}-on-flat-")


def test_a_yaml_file_names_legs_robot_and_terrain(dog: str, folder: Path) -> None:
    text = "terrain: flat.obj\nrobot: dog.urdf\nlegs: [RF, LH]\nfriction: [0.5, 0.6]\n"
    (folder / "mine.yaml").write_text(text)
    (problem,) = drawn(str(folder / "mine.yaml"), 1)
    assert problem.legs == ("RF", "LH")
    assert problem.robot.identity == named_robot(dog).identity
    assert all(0.5 <= contact.patch.friction <= 0.6 for contact in problem.contacts)


# ---------------------------------------------------------------------------------------------------
# what is refused


def refused(name: str, **files: str | Path) -> str:
    with pytest.raises(InvalidInput) as error:
        distribution(name, **files).sample(np.random.default_rng(0))
    assert "\n" not in str(error.value)
    return str(error.value)


def test_more_legs_than_the_robot_has_are_refused(dog: str) -> None:
    message = "expected a robot of 5 legs or more, got quadruped with LF, RF, LH, RH"
    assert refused("ground-5", robot=dog) == f"ground-5: {message}"
    assert_names(refused("wall-7"), "wall-7")


def test_terrains_without_footholds_are_refused(dog: str, folder: Path) -> None:
    steep = folder / "steep.obj"
    message = refused("terrain-3", robot=dog, terrain=steep)
    assert message == "steep.obj: expected footholds, got none: 28.8 m² steep"
    source = distribution("terrain-4", robot=dog, terrain=folder / "stone.obj")
    assert isinstance(source, CutDistribution)
    narrow = replace(source, stance=replace(source.stance, room_m=0.2 * source.stance.room_m))
    with pytest.raises(InvalidInput) as error:
        narrow.sample(np.random.default_rng(0))
    wants = "expected footholds for LF, RF, LH, RH about some body over the terrain"
    assert str(error.value) == f"{source.name}: {wants}, found none in 20000 tries"


def test_laws_and_files_that_do_not_go_together_are_refused(dog: str, folder: Path) -> None:
    flat = folder / "flat.obj"
    assert_names(refused("terrain-3", robot=dog), "terrain-3")
    wants = "expected terrain-k for scenes cut from a terrain's file"
    assert refused("ground-3", robot=dog, terrain=flat) == f"ground-3: {wants}, got {flat}"
    assert_names(refused("mine.py:Scenes", robot=dog), "robot")
    assert "expected a .urdf file" not in refused("ground-3", robot="cat.urdf")
    assert "cat.urdf" in refused("ground-3", robot="cat.urdf")


def test_a_leg_of_two_joints_is_refused(tmp_path: Path) -> None:
    short = leg("LF").replace('name="LF_HAA" type="revolute"', 'name="LF_HAA" type="fixed"')
    (tmp_path / "solo.urdf").write_text(robot([short, *(leg(name) for name in ("RF", "LH", "RH"))]))
    assert_names(
        refused("ground-3", robot=tmp_path / "solo.urdf"), tmp_path / "solo.urdf", "leg LF"
    )


def test_other_legs_of_the_paper_are_still_refused_by_name() -> None:
    with refuses("leg"):
        replace(DISTRIBUTIONS["wall-3"], legs=("RF", "tail")).sample(np.random.default_rng(0))


@pytest.mark.parametrize("ground", GROUNDS)
def test_scenes_are_cut_from_a_ground_by_its_name_and_are_those_of_its_surface(ground):
    """Turned back about the body, corners of patches are as far apart in height as the ground is
    there: places are its own, and the data set is named after it.
    """
    drawn = distribution("terrain-3", terrain=ground)
    assert drawn.name == f"terrain-3-on-{ground.replace(':', '-')}"
    field = named_terrain(ground)
    places = drawn.places.points_m[field.contains(drawn.places.points_m[:, :2])]
    assert np.quantile(np.abs(field.height(places[:, :2]) - places[:, 2]), 0.5) < 1e-3
    assert len(drawn.sample(np.random.default_rng(0)).contacts) == 3


def test_a_distribution_in_a_file_names_a_ground_and_no_file_that_would_be_run(tmp_path):
    (tmp_path / "d.yaml").write_text(
        "terrain: stairs:0.3:7\nlegs: [LF, RF, LR]\nfriction: [0.3, 0.8]\n"
    )
    assert distribution(str(tmp_path / "d.yaml")).name.endswith("-on-stairs-0.3-7")
    (tmp_path / "d.yaml").write_text(
        "terrain: mine.py:bump\nlegs: [LF, RF, LR]\nfriction: [0.3, 0.8]\n"
    )
    with refuses("d.yaml", "terrain"):
        distribution(str(tmp_path / "d.yaml"))
