"""P1 with friction cones times the box: it admits what is true, cuts off more, and moves with its
box as it says.
"""

import numpy as np
import pytest

import stancekit
from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.coned import Coned
from stancekit.planners.relaxation.envelope import Envelope, EnvelopeSet
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.relaxation.table import RELAXATIONS
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.methods import TwoStage
from tests.planners.oracle import OraclePrograms


@pytest.fixture(scope="module")
def held(programs):
    """Feasible problems, each with [p, f] of its witness, non-dimensional."""
    found, rng = [], np.random.default_rng(4)
    while len(found) < 6:
        problem = DISTRIBUTIONS["wall-3"].sample(rng)
        posture = ExactPlanner(programs=programs).solve(problem).solution
        if posture is not None:
            scaled = Scaled.of(problem)
            frames = [contact.patch.frame for contact in problem.contacts]
            force = (
                np.array([f @ each for f, each in zip(posture.forces_n[0], frames, strict=True)])
                / scaled.force_n
            )
            found.append(
                (
                    problem,
                    scaled,
                    np.hstack([(posture.toes_m - posture.com_m) / scaled.length_m, force]),
                )
            )
    return found


def around(at, width, rng):
    """A box that holds a point, not in its middle."""
    away = rng.uniform(-0.5, 0.5, at.shape) * width
    return Envelope(low=at - width + away, high=at + width + away)


def test_it_is_in_the_table_and_says_what_it_is():
    assert RELAXATIONS.get("coned") is Coned
    assert (Coned.over_boxes, Coned.about_points) == (True, False)


def test_what_is_true_is_admitted_and_boxes_are_never_looser_than_mccormicks(held, programs):
    rng, tighter = np.random.default_rng(0), 0
    for _, scaled, at in held:
        for width in (0.02, 0.1, 0.3):
            box = around(at, width, rng)
            coned, plain = (
                kind.margin(programs, scaled, box).margin for kind in (Coned, McCormick)
            )
            assert coned <= 1e-6
            assert coned >= plain - 1e-6
            tighter += coned > plain + 1e-4
    assert tighter > 5


def test_the_same_in_cvxpy_says_the_same(held, programs):
    other, rng = OraclePrograms(), np.random.default_rng(1)
    for _, scaled, at in held[:3]:
        box = around(at + 0.05, 0.15, rng)
        one, two = (Coned.margin(which, scaled, box, gradient=True) for which in (programs, other))
        assert one.margin == pytest.approx(two.margin, abs=1e-6)
        np.testing.assert_allclose(one.gradient, two.gradient, atol=1e-3)


def test_its_margin_moves_with_the_box_as_its_gradient_says(held, programs):
    rng, steps = np.random.default_rng(2), 0
    for _, scaled, at in held:
        box = around(at + 0.08, 0.1, rng)
        gradient = Coned.margin(programs, scaled, box, gradient=True).gradient
        for side, name in enumerate(("low", "high")):
            turn = rng.normal(size=at.shape)
            sides = {"low": box.low, "high": box.high}
            moved = [
                Coned.margin(
                    programs, scaled, Envelope(**{**sides, name: sides[name] + step * turn})
                ).margin
                for step in (1e-4, -1e-4)
            ]
            assert (moved[0] - moved[1]) / 2e-4 == pytest.approx(
                np.sum(gradient[side] * turn), abs=5e-3
            )
            steps += 1
    assert steps == 12


def test_solve_plan_and_the_environment_reach_it():
    problem = stancekit.sample("wall-3", rng=3)[0]
    box = Envelope(low=-np.ones((3, 6)), high=np.ones((3, 6)))
    learned = EnvelopeSet.for_problems("wall-3", [problem], [box])
    outcome = stancekit.solve(problem, TwoStage(relaxation="coned", envelopes=learned))
    assert outcome.status is not stancekit.Status.INFEASIBLE
    assert "margin" in outcome.details
    import gymnasium as gym

    env = gym.make("stancekit.envs:stancekit/EnvelopeSelection-v0", relaxation="coned")
    env.reset(seed=0)
    wide = np.repeat(np.float32([-1.0, 1.0]), 18)
    plain = gym.make("stancekit.envs:stancekit/EnvelopeSelection-v0")
    plain.reset(seed=0)
    coned, loose = (one.step(wide)[4]["margin"] for one in (env, plain))
    assert coned >= loose - 1e-6
