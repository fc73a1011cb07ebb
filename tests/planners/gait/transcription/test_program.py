"""Every term's derivatives by finite differences, over every chart, form of the dynamics and kind
of timing.
"""

from collections.abc import Callable

import casadi as cs
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stancekit.planners.gait.gait_program import GaitProgram
from stancekit.planners.gait.variables import sampled
from stancekit.planners.physics import GRAVITY_M_S2

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
