"""The grid of cells: two neighbours at most, planes around and inside cones, tangents below
squares, domains.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import cvxpy as cp
import numpy as np
import pytest

from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import domain_of
from stancekit.planners.relaxation.micp import (
    KNOTS,
    axes_of,
    cell_error,
    meet,
    of_several_frames,
    planes,
    unit_domain,
    without_squares,
)
from stancekit.planners.relaxation.papers import (
    Breaks,
    Cells,
    ContactForces,
    PlanVariables,
    neighbouring,
)


@pytest.mark.parametrize(
    ("encoding", "count"), [("log", 4), ("log", 8), ("unary", 4), ("unary", 5)]
)
def test_weight_goes_to_two_neighbours_only(encoding, count):
    weights, wanted = cp.Variable((1, count + 1), nonneg=True), cp.Parameter(count + 1)
    most = cp.Problem(
        cp.Maximize(cp.min(weights[0] - wanted)),
        [cp.sum(weights) == 1, *neighbouring(weights, encoding)],
    )
    for a, b in combinations_with_replacement(range(count + 1), 2):
        wanted.value = 0.5 * (np.eye(count + 1)[a] + np.eye(count + 1)[b])
        most.solve(solver=cp.HIGHS)
        assert (most.value > -1e-6) == (b - a <= 1)


@pytest.mark.parametrize("encoding", ["log", "unary"])
def test_over_a_cell_the_products_reach_as_far_as_the_four_planes_of_mccormick(encoding):
    domain = Envelope(
        low=[[-1.0, 0.0, 0.2, -0.5, 0.1, -1.0]], high=[[1.0, 0.8, 0.6, 0.7, 0.9, 1.0]]
    )
    cells = Cells(Breaks.of(domain, (2, 2)), encoding)
    parts = cp.Variable((1, 3)), cp.Variable((1, 3)), cp.Variable((1, 9))
    rng, terms = np.random.default_rng(0), cells.terms(*parts).values()
    for _ in range(6):
        at = domain.low[0] + rng.random(6) * (domain.high - domain.low)[0]
        j, k = rng.integers(3, size=2)
        held = [parts[0][0, j] == at[j], parts[1][0, k] == at[3 + k]]
        ends = []
        for index in (j, 3 + k):  # of the cell that it is in
            cuts = np.linspace(domain.low[0, index], domain.high[0, index], 3)
            cell = int(np.clip(np.searchsorted(cuts, at[index]) - 1, 0, 1))
            ends.append((cuts[cell], cuts[cell + 1], at[index]))
        (p_low, p_high, p), (f_low, f_high, f) = ends
        least = max(
            p_low * f + f_low * p - p_low * f_low, p_high * f + f_high * p - p_high * f_high
        )
        most = min(p_low * f + f_high * p - p_low * f_high, p_high * f + f_low * p - p_high * f_low)
        for goal, expected in ((cp.Minimize, least), (cp.Maximize, most)):
            problem = cp.Problem(goal(parts[2][0, 3 * j + k]), [*terms, *held])
            assert problem.solve(solver=cp.HIGHS) == pytest.approx(expected, abs=1e-6)
    sides = (domain.high - domain.low)[0] / 2.0
    assert cell_error(domain, (2, 2)) == pytest.approx(sides[:3].max() * sides[3:].max() / 4.0)


def test_tangent_planes_lie_around_the_cones_and_close_to_them(drawn):
    rng = np.random.default_rng(0)
    ball, direction = cp.Variable(3), cp.Parameter(3)
    reach = cp.Problem(
        cp.Maximize(direction @ ball), planes(cp.SOC(cp.Constant(2.0), ball), "outer")
    )
    scaled = Scaled.of(drawn("wall-3", 0))
    forces = ContactForces.of_candidates(PlanVariables(scaled))
    rows = [*planes(forces.in_cones()["cone"], "outer"), forces.forces[:, 0] <= 1.0]
    push = cp.Parameter(2)
    friction = cp.Problem(cp.Maximize(forces.forces[0, 1:] @ push), rows)
    for _ in range(30):
        direction.value = rng.normal(size=3)
        assert (
            1.0 - 1e-7
            <= reach.solve(solver=cp.HIGHS) / (2.0 * np.linalg.norm(direction.value))
            <= 1.041
        )
        push.value = rng.normal(size=2)
        most = scaled.friction[0] * np.linalg.norm(push.value)
        assert 1.0 - 1e-7 <= friction.solve(solver=cp.HIGHS) / most <= 1.02


@pytest.mark.parametrize("axis", [0, 1])
def test_planes_stand_around_or_inside_cones(axis):
    rng = np.random.default_rng(0)
    for size in (2, 3):
        radius, vectors = cp.Variable(40), cp.Variable((size, 40) if axis == 0 else (40, size))
        rows = {
            kind: planes(cp.SOC(radius, vectors, axis=axis), kind) for kind in ("outer", "inner")
        }
        vectors_at = rng.normal(size=vectors.shape)
        norm = np.linalg.norm(vectors_at, axis=axis)
        for kind, share, inside in (
            ("outer", 1.0, True),
            ("inner", 1.0 / np.cos(np.pi / 16) ** 2 + 1e-6, True),
            ("outer", 0.96, False),
            ("inner", 0.999, False),
        ):
            held = [radius == share * norm, vectors == vectors_at]
            problem = cp.Problem(cp.Minimize(0), [*held, *rows[kind]])
            problem.solve(solver=cp.CLARABEL)
            assert (problem.status == cp.OPTIMAL) == inside, (size, kind, share)


def test_other_constraints_stay_as_they_are():
    row, cone = cp.Variable() <= 1.0, cp.SOC(cp.Variable(), cp.Variable(3))
    assert list(planes(row, "outer")) == [row]
    assert list(planes(cone, "exact")) == [cone]


def test_tangents_are_below_squares_and_close():
    rng = np.random.default_rng(1)
    line = cp.Variable((4, 3))
    cost = 2.0 * cp.sum_squares(line) + 0.5 * cp.sum_squares(line[1:] - line[:-1])
    linear, rows = without_squares(cost)
    assert KNOTS[0] == 0.0
    for _ in range(5):
        at = rng.uniform(-0.17, 0.17, (4, 3))  # differences up to .34
        problem = cp.Problem(cp.Minimize(linear), [*rows, line == at])
        problem.solve(solver=cp.HIGHS)
        exact = 2.0 * np.sum(at**2) + 0.5 * np.sum(np.diff(at, axis=0) ** 2)
        assert exact - 0.0025 * (2.0 * 12 + 0.5 * 9) <= problem.value <= exact + 1e-9


def test_candidates_of_one_frame_are_measured_in_it_and_others_in_the_world(ragged):
    assert axes_of(Scaled.of(read_course("icy-walls", frames=2))) == "contact"
    assert axes_of(Scaled.of(ragged(0, candidates=1))) == "contact"
    scaled = Scaled.of(ragged(2, candidates=3))
    assert axes_of(scaled) == "world"
    footholds = scaled.layout.contacts[2][of_several_frames(scaled)]
    assert all(len(scaled.layout.corners[p]) > 1 for p in footholds)


def test_of_two_boxes_the_common_part_is_left_or_the_gap():
    first, second = (
        Envelope(low=np.full((1, 6), low), high=np.full((1, 6), low + 1.0)) for low in (0.0, 0.5)
    )
    np.testing.assert_array_equal(meet(first, second).low, np.full((1, 6), 0.5))
    np.testing.assert_array_equal(meet(first, second).high, np.ones((1, 6)))
    apart = Envelope(low=np.full((1, 6), 2.0), high=np.full((1, 6), 3.0))
    np.testing.assert_array_equal(meet(first, apart).high, np.full((1, 6), 2.0))


def test_the_domain_in_world_axes_holds_that_in_contact_frames(ragged, drawn):
    for scaled in (Scaled.of(drawn("wall-5", 3)), Scaled.of(ragged(1, candidates=1))):
        frames, rng = scaled.contact_frames, np.random.default_rng(0)
        contact, world = domain_of(scaled, "contact"), domain_of(scaled, "world")
        np.testing.assert_array_equal(contact.low[:, :3], world.low[:, :3])
        low, high = contact.force
        for _ in range(20):
            forces = np.einsum("bij,bj->bi", frames, low + rng.random(low.shape) * (high - low))
            assert np.all(forces >= world.force[0] - 1e-12)
            assert np.all(forces <= world.force[1] + 1e-12)
        assert unit_domain(scaled).low.shape == contact.low.shape
