"""P2: every projection keeps what it says it keeps, and its residual is the least there is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stancekit.planners.contact.project import SURFACE, FixToes, Linearised, Point, Projector
from stancekit.planners.contact.scaled import ScaledProblem
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.verify import check_posture

SEEDS = st.integers(0, 2**32 - 1)
CONVEX = ("fix-p", "fix-f", "fix-toes", "scp")
BOX = Envelope(
    low=np.tile([-0.6, -0.7, -0.5, 0.1, -0.5, -0.2], (3, 1)), high=np.tile([0.6, 0.7, 0.3, 0.8, 0.5, 0.7], (3, 1))
)


linearised = cache(Linearised)


@pytest.fixture(scope="module")
def starts(stages, drawn, mixed):
    """(problem, scaled, P1's point) of scenes with a margin; the point is off the bilinear surface."""
    found = []
    scenes = [drawn(name, seed) for name in ("wall-3", "ground-3") for seed in range(30)]
    for problem in [*scenes, *(mixed(seed, (3, 4, 5)) for seed in range(20))]:
        scaled = ScaledProblem.of(problem)
        answer = stages.box(scaled).solve(scaled, BOX)
        if answer.point is not None:
            found.append((problem, scaled, answer.point))
    assert len(found) >= 50
    return found


def moment(scaled, point):
    world = np.einsum("nij,nj->ni", scaled.frames, point.forces)
    return np.cross(point.toes - point.com, world).sum(axis=0)


def worst_but_moment(problem, scaled, point):
    posture = scaled.posture(com=point.com, rotation=point.rotation, toes=point.toes, forces=point.forces)
    return max(g.worst for g in check_posture(problem, posture).groups if g.group != "moment_balance")


@pytest.mark.parametrize("projection", CONVEX)
def test_what_comes_back_meets_all_other_constraints_and_its_residual_is_its_moment(stages, starts, projection):
    finite = 0
    for problem, scaled, start in starts:
        point = stages.project(projection, scaled, start)
        assert point.solves >= 1
        if np.isfinite(point.residual):
            finite += 1
            assert worst_but_moment(problem, scaled, point) < 2e-7
            assert np.max(np.abs(moment(scaled, point))) == pytest.approx(point.residual, abs=2e-7)
    assert finite >= 20


@pytest.mark.parametrize("projection", CONVEX)
def test_what_is_on_the_surface_is_verified(stages, starts, projection):
    accepted = 0
    for problem, scaled, start in starts:
        point = stages.project(projection, scaled, start)
        if point.residual <= SURFACE:
            accepted += 1
            posture = scaled.posture(com=point.com, rotation=point.rotation, toes=point.toes, forces=point.forces)
            assert check_posture(problem, posture).accepted
    assert accepted >= 5


def test_fix_p_keeps_the_toes_relative_to_the_body(stages, starts):
    for _, scaled, start in starts:
        point = stages.project("fix-p", scaled, start)
        np.testing.assert_allclose(point.toes - point.com, start.toes - start.com, atol=1e-9)
        np.testing.assert_array_equal(point.com, start.com)
        np.testing.assert_array_equal(point.rotation, start.rotation)


def test_fix_f_keeps_the_contact_forces(stages, starts):
    moved = 0
    for _, scaled, start in starts:
        point = stages.project("fix-f", scaled, start)
        np.testing.assert_array_equal(point.forces, start.forces)
        moved += np.max(np.abs(point.toes - start.toes)) > 1e-3
    assert moved >= 10


def test_fix_toes_keeps_the_toes_in_the_world(stages, starts):
    freed = 0
    for _, scaled, start in starts:
        point = stages.project("fix-toes", scaled, start)
        np.testing.assert_array_equal(point.toes, start.toes)
        freed += np.max(np.abs(point.com - start.com)) > 1e-3
    assert freed >= 10


def test_each_has_at_most_the_residual_of_what_it_starts_with(stages, starts):
    """Each frees more than nothing: the start itself is among its choices, and fix-toes frees all that fix-p does."""
    for _, scaled, start in starts:
        here = np.max(np.abs(moment(scaled, start)))
        found = {name: stages.project(name, scaled, start).residual for name in CONVEX}
        assert found["fix-p"] <= here + 1e-6
        assert found["fix-f"] <= here + 1e-6
        assert found["fix-toes"] <= found["fix-p"] + 1e-6
        assert found["scp"] <= found["fix-toes"]


def test_scp_helps_where_fix_toes_is_not_enough(stages, starts):
    ended = helped = 0
    for _, scaled, start in starts:
        fixed, stepped = (stages.project(name, scaled, start) for name in ("fix-toes", "scp"))
        assert stepped.solves <= 9
        if fixed.residual <= SURFACE:
            ended += 1
            assert stepped.solves == 1
            np.testing.assert_array_equal(stepped.forces, fixed.forces)
        else:
            helped += stepped.residual < 0.5 * fixed.residual
    assert ended >= 20
    assert helped >= 5


class Elsewhere:
    """Steps to the same toes, wherever one comes from."""

    def __init__(self, toes):
        self.toes = toes

    def solve(self, scaled, about):
        return replace(about, toes=self.toes)


def test_a_step_that_makes_things_worse_is_not_kept(stages, starts):
    worse = 0
    for _, scaled, start in starts:
        fixed = stages.project("fix-toes", scaled, start)
        if SURFACE < fixed.residual < np.inf:
            projector = Projector(*scaled.size)
            projector._step = Elsewhere(scaled.vertices[:, 0])
            corner = stages.project("fix-toes", scaled, replace(start, toes=scaled.vertices[:, 0]))
            worse += fixed.residual < corner.residual < np.inf
            assert projector.scp(scaled, start).residual == min(corner.residual, fixed.residual)
    assert worse >= 3


# ---------------------------------------------------------------------------------------------------- written again


def least(model, toes, rows):
    slack = cp.Variable()
    program = cp.Problem(cp.Minimize(slack), [*rows, cp.abs(model.moment_of(toes)) <= slack])
    return float(program.solve(solver=cp.CLARABEL))


@pytest.mark.parametrize("index", range(0, 60, 7))
def test_fix_toes_and_fix_p_are_the_programs_written_again(stages, starts, written, index):
    problem, scaled, start = starts[index % len(starts)]
    model = written(problem)
    held = [model.toes == start.toes, model.balance, *model.in_cones]
    free = least(model, start.toes, [*held, *model.body, *model.in_reach])
    assert stages.project("fix-toes", scaled, start).residual == pytest.approx(free, abs=2e-7)
    fixed = least(model, start.toes, [*held, model.com == start.com])
    assert stages.project("fix-p", scaled, start).residual == pytest.approx(fixed, abs=2e-7)


@pytest.mark.parametrize("index", range(0, 60, 7))
def test_fix_f_is_the_program_written_again(stages, starts, written, index):
    problem, scaled, start = starts[index % len(starts)]
    model, slack = written(problem), cp.Variable()
    world = np.einsum("nij,nj->ni", scaled.frames, start.forces)
    arms = sum(-np.cross(force, np.eye(3)).T @ (model.toes[i] - model.com) for i, force in enumerate(world))
    rows = [*model.body, *model.on_patches, *model.in_reach, cp.abs(arms) <= slack]
    residual = cp.Problem(cp.Minimize(slack), rows).solve(solver=cp.CLARABEL)
    assert stages.project("fix-f", scaled, start).residual == pytest.approx(residual, abs=3e-7)


@given(SEEDS)
def test_the_linear_model_of_scp_is_the_tangent_of_the_moment(starts, seed):
    """About a posture on the surface the step's residual is 0, and its linearisation is exact in each factor."""
    rng = np.random.default_rng(seed)
    _, scaled, start = starts[int(rng.integers(len(starts)))]
    step = linearised(*scaled.size).solve(scaled, start)
    if not np.isfinite(step.residual):
        return
    world, about = (np.einsum("nij,nj->ni", scaled.frames, p.forces) for p in (step, start))
    tangent = np.cross(start.toes, world) + np.cross(step.toes - start.toes, about)
    linear = tangent.sum(axis=0) - np.cross(step.com, [0.0, 0.0, scaled.weight])
    assert np.max(np.abs(linear)) == pytest.approx(step.residual, abs=1e-6)
    second = np.cross(step.toes - start.toes, world - about).sum(axis=0)  # what the tangent leaves out
    np.testing.assert_allclose(moment(scaled, step) - linear, second, atol=1e-6)


# ------------------------------------------------------------------------------------------------- where there is none


@pytest.mark.parametrize("projection", CONVEX)
def test_out_of_reach_there_is_no_answer(stages, starts, projection):
    problem, _, start = starts[0]
    short = replace(problem, contacts=tuple(replace(c, reach_m=0.01) for c in problem.contacts))
    point = stages.project(projection, ScaledProblem.of(short), start)
    if projection == "fix-p":  # keeps the body and the toes, and so their distance: it asks for forces only
        assert np.isfinite(point.residual)
    else:
        assert point.residual == np.inf
    assert point.toes.shape == point.forces.shape == (3, 3)


@pytest.mark.parametrize("projection", ["fix-p", "fix-toes", "scp"])
def test_without_friction_on_a_wall_there_is_no_answer(stages, drawn, projection):
    scaled = ScaledProblem.of(drawn("wall-3", 0))
    slippery = replace(scaled, friction=np.zeros(3), frames=np.tile([[0, 0, 1], [1, 0, 0], [0, 1, 0]], (3, 1, 1)))
    start = Point(
        com=np.zeros(3), rotation=np.zeros(3), toes=scaled.vertices.mean(axis=1), forces=np.zeros((3, 3)), residual=1.0
    )
    assert stages.project(projection, slippery, start).residual == np.inf


def test_three_feet_on_level_ground_share_the_weight_by_the_lever_rule(stages):
    """A closed form: vertical forces f_i with Σ f_i = w and Σ f_i (q_i − c) = 0 are the barycentric shares of c."""
    typical = ScaledProblem.typical(3, 3)
    toes = np.array([[0.5, 0.0, -0.3], [-0.2, 0.4, -0.3], [-0.3, -0.5, -0.3]])
    com = np.array([0.05, -0.02, 0.0])
    scaled = replace(typical, friction=np.zeros(3), com=com, com_radius=0.0, reach=np.full(3, 2.0))
    point = FixToes(3).solve(scaled, toes)
    shares = np.linalg.solve(np.vstack([toes[:, :2].T, np.ones(3)]), [*com[:2], 1.0])
    np.testing.assert_allclose(point.forces[:, 0], shares, atol=1e-6)
    assert point.residual < 1e-7
