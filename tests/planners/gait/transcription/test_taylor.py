"""Taylor maps: the terrain's and the warp map's values and derivatives, against the numeric ones
and differences.
"""

import casadi as cs
import numpy as np
import pytest

from stancekit.planners.gait.transcription.taylor import Jets, SnappedMap, TaylorMap
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.warp.quadrature import QuadratureGrid
from stancekit.planners.warp.spline_map import SplineMap

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
