"""Every term's derivatives by finite differences, over every chart, form of the dynamics and kind
of timing.
"""

import copy
import itertools
import multiprocessing
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as cs
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.gait.gait_program import GaitProgram, GaitSolution
from stancekit.planners.gait.method.subprocess import solve_in_subprocess
from stancekit.planners.gait.transcription.taylor import Jets, SnappedMap, TaylorMap
from stancekit.planners.gait.variables import sampled
from stancekit.planners.physics import GRAVITY_M_S2
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory
from stancekit.planners.warp.quadrature import QuadratureGrid
from stancekit.planners.warp.spline_map import SplineMap
from tests.refusals import refuses

Build = Callable[..., GaitProgram]
CASES = [
    ("ambient", "centred", "fixed"),
    ("shear", "printed", "fixed"),
    ("decoupled", "newton-euler", "fixed"),
    ("decoupled", "centred", "optimised"),
    ("warped", "centred", "fixed"),
]


def away(program: GaitProgram) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # type: ignore[type-arg]
    """A point near the guess with no node at a switch, a direction, and parameters."""
    rng = np.random.default_rng(1)
    x = program.perturbed(rng, 0.01)
    for foot in program.structure.layout.feet:
        x[foot.switches] += rng.uniform(0.01, 0.02, len(foot.switches))
    return x, rng.standard_normal(program.size), np.r_[0.9 * x, [0.3, 0.2, 0.1, 0.9]]


@pytest.mark.parametrize(("chart", "dynamics", "timings"), CASES)
def test_jacobian_and_hessian_agree_with_finite_differences(
    small: Build, monkeypatch: pytest.MonkeyPatch, chart: str, dynamics: str, timings: str
) -> None:
    monkeypatch.setattr("stancekit.planners.gait.constraints.dynamics.NEAR_M", 0.28)
    built = small(
        chart=chart, dynamics=dynamics, timings=timings, trunk_clearance_m=0.02, footing=0.6
    )
    assert {"trunk", "footing"} <= {term.name for term in built.nlp.constraints}
    program, (x, way, p), step = built.nlp, away(built), 1e-6
    slopes = np.asarray(program.jacobian(x, p)[1] @ way).ravel()
    ahead, behind = (
        np.asarray(program.constraint(x + sign * step * way, p)).ravel() for sign in (1.0, -1.0)
    )
    first = 0
    for term in program.constraints:
        rows = slice(first, first + term.rows)
        first += term.rows
        found = (ahead - behind)[rows] / (2.0 * step)
        assert slopes[rows] == pytest.approx(found, abs=2e-5 * (1.0 + np.abs(found).max())), (
            term.name
        )
    assert first == program.rows

    multipliers = np.random.default_rng(2).standard_normal(program.rows)

    def gradient(at: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        jacobian, slope = program.jacobian(at, p)[1], program.gradient(True)(at, p)[1]
        return np.asarray(jacobian.T @ multipliers + slope).ravel()

    upper = cs.DM(program.hessian(True)(x, p, 1.0, multipliers))
    hessian = upper + upper.T - cs.diag(cs.diag(upper))
    found = (gradient(x + step * way) - gradient(x - step * way)) / (2.0 * step)
    assert np.asarray(hessian @ way).ravel() == pytest.approx(
        found, abs=1e-5 * (1.0 + np.abs(found).max())
    )


@pytest.mark.parametrize("chart", ["warped", "decoupled"])
def test_newton_and_euler_over_a_chart_are_those_of_the_motion_in_the_world(
    small: Build, chart: str
) -> None:
    built = small(chart=chart, dynamics="newton-euler")
    x = built.perturbed(np.random.default_rng(3), 0.005)
    values = np.asarray(built.nlp.constraint(x, np.r_[x, 0.0, 0.0, 0.0, 1.0])).ravel()
    node, step = 17, 1e-4
    at = sampled(built.structure, x, built.structure.times_s[node] + step * np.arange(-1.0, 2.0))
    robot = built.task.robot
    acceleration = np.diff(at.torso_m, 2, axis=0)[0] / step**2
    turn = Rotation.from_matrix(at.rotation)
    spins = [(turn[k + 1] * turn[k].inv()).as_rotvec() / step for k in (0, 1)]
    half = [(Rotation.from_rotvec(0.5 * step * spins[k]) * turn[k]).as_matrix() for k in (0, 1)]
    momentum = [r @ robot.inertia_kgm2 @ r.T @ spin for r, spin in zip(half, spins, strict=True)]
    force = at.forces_n[1].sum(axis=0) - robot.mass_kg * (
        acceleration + np.array([0.0, 0.0, GRAVITY_M_S2])
    )
    moment = (
        np.cross(at.feet_m[1] - at.torso_m[1], at.forces_n[1]).sum(axis=0)
        - np.subtract(*momentum[::-1]) / step
    )
    wanted = np.r_[force / robot.weight_n, moment / (robot.weight_n * robot.stand_height_m)]
    assert values[6 * node : 6 * node + 6] == pytest.approx(wanted, abs=1e-4)


def test_the_gradient_is_dense_and_right(small: Build) -> None:
    built = small(chart="ambient")
    x, way, p = away(built)
    for costs in (False, True):
        value, gradient = built.nlp.objective(costs), built.nlp.gradient(costs)
        assert gradient.nnz_out(1) == built.size
        found = (float(value(x + 1e-6 * way, p)) - float(value(x - 1e-6 * way, p))) / 2e-6
        assert float(cs.dot(gradient(x, p)[1], way)) == pytest.approx(found, rel=1e-5)


DOMAIN = ((-2.0, 2.0), (-1.5, 1.5))


@pytest.fixture(scope="module")
def rough() -> HeightField:
    heights = 0.2 * np.random.default_rng(0).standard_normal((33, 25))
    return HeightField(np.linspace(*DOMAIN[0], 33), np.linspace(*DOMAIN[1], 25), heights).smoothed(
        0.15
    )


@pytest.fixture(scope="module", params=[False, True])
def warp(request: pytest.FixtureRequest, rough: HeightField) -> SplineMap:
    grid = QuadratureGrid.of_band(DOMAIN, 1.2, (8, 6, 3), 2)
    control = grid.identity + 0.05 * np.random.default_rng(1).standard_normal(grid.identity.shape)
    snap = HeightField(rough.x_m, rough.y_m, 0.1 * rough.heights_m) if request.param else None
    return SplineMap(domain_m=DOMAIN, height_m=1.2, control_m=control, snap=snap, fade_m=0.6)


ALIVE: list[Jets] = []
"""CasADi's functions do not keep the callbacks that they call."""


def expanded(chart_map: TaylorMap, order: int) -> cs.Function:
    """Value, Jacobian and the Jacobian of the Jacobian of the Taylor polynomial about a point,
    there.
    """
    point, base = cs.SX.sym("x", chart_map.inputs), cs.SX.sym("b", chart_map.inputs)
    jet = cs.SX.sym("j", chart_map.size(order))
    value, jacobian = chart_map.polynomial(order)(point, base, jet)
    second = cs.jacobian(cs.vec(jacobian), point)
    kernel = cs.Function("kernel", [point, base, jet], [value, jacobian, second])
    at = cs.MX.sym("x", chart_map.inputs)
    ALIVE.append(Jets(chart_map, order, 1, []))
    return cs.Function("at", [at], kernel(at, at, ALIVE[-1](at)))


def test_a_terrains_expansion_is_its_height_and_gradient_also_far_outside(
    rough: HeightField,
) -> None:
    rng, step = np.random.default_rng(2), 1e-5
    at = np.concatenate([rng.uniform(-1.4, 1.4, (40, 2)), rng.uniform(-60.0, 60.0, (20, 2))])
    surface = expanded(TaylorMap.of_heights(rough), 3)
    for place in at:
        height, slope, bend = (np.array(part) for part in surface(place))
        assert height.item() == pytest.approx(float(rough.height(place)), rel=1e-12, abs=1e-12)
        np.testing.assert_allclose(slope.ravel(), rough.gradient(place), atol=1e-10)
        for axis in range(2):
            shift = step * np.eye(2)[axis]
            difference = (rough.gradient(place + shift) - rough.gradient(place - shift)) / (
                2 * step
            )
            np.testing.assert_allclose(bend[:, axis], difference, atol=2e-3)


def test_a_maps_expansion_is_its_points_and_jacobians_and_bends_as_they_do(warp: SplineMap) -> None:
    rng, step = np.random.default_rng(3), 1e-5
    phi = expanded(SnappedMap(warp), 2)
    for place in rng.uniform([-1.9, -1.4, 0.05], [1.9, 1.4, 1.1], (30, 3)):
        point, jacobian, second = (np.array(part) for part in phi(place))
        np.testing.assert_allclose(point.ravel(), warp.points(place), atol=1e-12)
        np.testing.assert_allclose(jacobian, warp.jacobians(place), atol=1e-11)
        bend = second.reshape(3, 3, 3, order="F")
        for axis in range(3):
            shift = step * np.eye(3)[axis]
            difference = (warp.jacobians(place + shift) - warp.jacobians(place - shift)) / (
                2 * step
            )
            np.testing.assert_allclose(bend[:, :, axis], difference, atol=2e-4)


def test_third_derivatives_on_a_knot_are_those_beside_it(rough: HeightField) -> None:
    """CasADi's splines of degree 0 gave 0 there, and wrote out of their bounds."""
    surface = TaylorMap.of_heights(rough)
    knot = np.array([rough.x_m[9], rough.y_m[7]])
    jets = Jets(surface, 3, 2, [])
    on, beside = np.asarray(jets(np.column_stack([knot, knot + 1e-9]))).T
    assert np.abs(on[6:]).min() > 1e-3
    np.testing.assert_allclose(on, beside, rtol=1e-6, atol=1e-6)


Walked = Callable[..., tuple[GaitProgram, GaitSolution]]

ITERATES = """
import hashlib, numpy as np
from stancekit.planners.gait.gait_program import formulate
from stancekit.planners.robot.walker import anymal
from stancekit.planners.problem.walk import Walk
from stancekit.planners.terrain.heightfield import HeightField
field = HeightField.from_function(lambda x, y: 0.08 * np.sin(2.5 * x + 0.3) * np.cos(2.0 * y), 2.0, 0.1)
task = Walk(robot=anymal(), terrain=field, start=np.zeros(2), goal=np.array([0.2, 0.1]), duration_s=2.0)
found = formulate(task).solve()
print(found.iterations, [pair for pair in found.history], hashlib.sha256(found.x.tobytes()).hexdigest())
"""


@pytest.fixture(scope="module")
def walked(small: Build) -> Walked:
    """``walked(chart="shear")``: a program and its solution, once for all tests that look at it."""

    @cache
    def get(**settings: object) -> tuple[GaitProgram, GaitSolution]:
        program = small(**settings)
        return program, program.solve()

    return get


def test_walks_that_are_alike_share_kernels_and_have_the_answers_of_their_own(
    small: Build, walked: Walked, field: HeightField
) -> None:
    kept = Programs()
    other, shared = small(terrain=field.scaled(0.5), programs=kept), small(programs=kept)
    other.solve(max_iterations=1)
    assert np.array_equal(shared.solve().x, walked()[1].x)
    assert other.structure.kind == shared.structure.kind


@pytest.mark.parametrize("chart", ["decoupled", "ambient", "shear"])
def test_a_short_walk_is_found_and_the_verifier_accepts_it(small: Build, chart: str) -> None:
    program = small(chart=chart)
    seen: list[tuple[int, float, float]] = []
    found = program.solve(callback=lambda *at: seen.append(at))
    assert found.success
    assert found.iterations == len(found.history) - 1 == seen[-1][0] <= 15
    assert found.violation < program.settings.tolerance < found.history[-2][0]
    assert (
        max(program.violations(found.x).values())
        == found.violation
        == pytest.approx(found.history[-1][0])
    )
    report = check_trajectory(found.trajectory())
    assert report.accepted, report.message


def test_forces_stay_in_the_true_cone_between_the_nodes(walked: Walked) -> None:
    program, found = walked(chart="decoupled")
    at = found.samples(np.linspace(0.0, 2.0, 801))
    normal = program.task.terrain.normal(at.feet_m[..., :2])
    pressing = np.sum(at.forces_n * normal, axis=-1)
    sliding = np.linalg.norm(at.forces_n - pressing[..., None] * normal, axis=-1)
    weight_n = program.task.robot.weight_n
    assert np.all(sliding <= program.task.friction * pressing + 1e-12 * weight_n)
    assert np.all(at.forces_n[~at.contact] == 0.0)
    assert pressing.max() > 0.3 * weight_n


def test_equal_solves_give_equal_trajectories_on_any_grid(small: Build, walked: Walked) -> None:
    first, second = walked()[1], small().solve()
    assert first.trajectory().digest == second.trajectory().digest
    assert first.trajectory(0.5).times_s.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert len(first.trajectory(2.0).times_s) == 4
    with refuses("dt_s"):
        first.trajectory(0.0)


def test_swinging_feet_of_a_flat_chart_never_dip_between_the_nodes(walked: Walked) -> None:
    program, found = walked(chart="decoupled")
    at = found.samples(np.linspace(0.0, 2.0, 2001))
    above = at.feet_m[..., 2] - program.task.terrain.height(at.feet_m[..., :2])
    assert above.min() > -1e-4
    assert above.max() > 0.02


def test_optimised_phases_stay_in_order_and_move(small: Build) -> None:
    program = small(timings="optimised")
    found = program.solve()
    assert found.success
    for foot in program.structure.layout.feet:
        lasting = np.diff([0.0, *found.x[foot.switches], program.task.duration_s])
        assert lasting.min() > 0.05
    moved = np.concatenate(
        [found.x[foot.switches] - foot.phases.switches_s for foot in program.structure.layout.feet]
    )
    assert 1e-6 < np.abs(moved).max() <= program.settings.switch_slack_s + 1e-4


def test_lbfgs_finds_a_walk_by_other_iterates_than_the_exact_hessian(
    small: Build, walked: Walked
) -> None:
    exact, quasi = walked()[1], small(hessian="lbfgs").solve()
    assert exact.success
    assert quasi.success
    assert quasi.iterations >= exact.iterations
    assert quasi.history[-1] != pytest.approx(exact.history[-1])


def test_a_second_phase_lowers_the_cost_it_is_given(walked: Walked) -> None:
    program, first = walked()
    weights = (0.1, 1.0, 0.1)
    second = program.solve(
        first.x, costs=weights, reference=first.x, stop_when_feasible=False, max_iterations=8
    )
    assert second.history[-1][1] < 0.8 * second.history[0][1]


def test_a_terrain_of_no_height_is_level_ground(small: Build) -> None:
    flattened = small(chart="ambient").solve(height_factor=0.0)
    assert flattened.success
    at = flattened.samples(np.linspace(0.0, 2.0, 41))
    assert np.abs(at.feet_m[..., 2][at.contact]).max() < 1e-4
    assert np.ptp(flattened.trajectory().problem.terrain.heights_m) == 0.0


def test_two_processes_take_identical_iterates_whatever_memory_held_before() -> None:
    said = [
        subprocess.run(
            [sys.executable, "-c", ITERATES],
            env={**os.environ, "MALLOC_PERTURB_": perturb, "OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for perturb in ("85", "170")
    ]
    assert said[0] == said[1]
    assert said[0].startswith(tuple("123456789"))


def test_a_child_process_finds_the_same_and_an_alarm_ends_one_that_hangs(walked: Walked) -> None:
    seen, turn = list[tuple[int, float, float]](), multiprocessing.get_context("fork").Semaphore(0)

    def pause(*at: object) -> None:
        turn.acquire()

    program, here = walked()
    apart = solve_in_subprocess(program)
    assert apart.x.tobytes() == here.x.tobytes()
    assert apart.history == here.history

    second = lambda *at: bool(seen.append(at) or turn.release()) or len(seen) == 2  # noqa: E731
    halted = solve_in_subprocess(program, on_iterate=second, callback=pause)
    assert [(violation, cost) for _, violation, cost in seen] == list(halted.history)
    assert len(halted.history) in (2, 3)  # it may be one iterate ahead when it is told to stop
    assert not halted.success

    def hang(*at: object) -> None:
        time.sleep(600.0)

    with refuses("0.5 s", kind=PlanningFailed):
        solve_in_subprocess(program, time_limit_s=0.5, callback=hang)


@pytest.mark.parametrize("error", [KeyboardInterrupt, TimeoutError])
def test_whatever_is_raised_inside_a_solve_is_raised_by_it_and_the_next_is_as_ever(
    small: Build, monkeypatch: pytest.MonkeyPatch, error: type[BaseException]
) -> None:
    program = small(chart="decoupled")
    expected, at = program.solve().x, TaylorMap.at

    def interrupted(last: int) -> Callable[..., Any]:
        calls = itertools.count()

        def jets(chart_map: TaylorMap, *arguments: Any) -> Any:
            if next(calls) == last:
                raise error("now")
            return at(chart_map, *arguments)

        return jets

    for last in (0, 5, 9, 12, 20):
        monkeypatch.setattr(TaylorMap, "at", interrupted(last))
        with refuses("now", kind=error):
            program.solve()
    monkeypatch.undo()
    np.testing.assert_array_equal(program.solve().x, expected)


def test_a_chart_is_copied_whatever_was_solved_in_it(walked: Walked) -> None:
    program, found = walked(chart="decoupled")
    chart = pickle.loads(pickle.dumps(program.structure.chart))
    again = copy.deepcopy(program.structure.chart)
    assert (
        chart.foot_map.size(2) == again.foot_map.size(2) == program.structure.chart.foot_map.size(2)
    )
    assert found.success
