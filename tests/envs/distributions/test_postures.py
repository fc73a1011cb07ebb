"""Terrain distributions: what DESIGN §3 says of them, over many samples."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from stancekit.envs.distributions.postures import DISTRIBUTIONS, PostureDistribution, distribution
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem import Problem
from stancekit.planners.robot import hexapod
from tests.refusals import assert_names

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
    with pytest.raises(InvalidInput) as error:
        terrain.sample(np.random.default_rng(0))
    assert_names(str(error.value), "leg")


def test_a_name_that_is_none_is_answered_with_those_there_are():
    assert distribution("wall-5") is DISTRIBUTIONS["wall-5"]
    with pytest.raises(InvalidInput) as error:
        distribution("ice-3")
    assert_names(str(error.value), "distribution")
