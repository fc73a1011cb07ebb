"""Programs over a box: the same as their formulation in cvxpy, and the corners that they give are P1's."""

import numpy as np
import pytest

from stancekit.envs.distributions.postures import DISTRIBUTIONS
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.boxed import Boxed
from stancekit.planners.relaxation.domain import domain_of
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick
from stancekit.planners.relaxation.within import WithinBox


@pytest.fixture(scope="module")
def some():
    """Problems with boxes about their own domain, of several widths."""
    rng, found = np.random.default_rng(8), []
    for k in range(12):
        scaled = Scaled.of(DISTRIBUTIONS["wall-3"].sample(rng))
        whole = domain_of(scaled)
        middle, half = 0.5 * (whole.low + whole.high), 0.5 * (whole.high - whole.low)
        share = (1.0, 0.8, 0.5)[k % 3]
        box = Envelope(low=middle - share * half, high=middle + share * half)
        found.append((scaled, box, rng.standard_normal(box.low.shape)))
    return found


@pytest.mark.parametrize("products", [False, True])
def test_the_same_in_cvxpy_says_the_same(some, products):
    one, two, solved = Programs(), Programs(engine="cvxpy"), 0
    for scaled, box, slope in some[:6]:
        rows = [which.get(WithinBox, scaled.layout, products).rows for which in (one, two)]
        given = Boxed(scaled, boxes=(box,), slope=slope)
        ours, theirs = (each.solve(given) for each in rows)
        assert ours.status is theirs.status
        if ours.solved:
            assert ours.objective == pytest.approx(theirs.objective, abs=1e-5)
            solved += 1
    assert solved


def test_p1_has_a_corner_where_its_margin_says_so_and_then_p_bar_has_one_too(some, programs):
    seen = set()
    for scaled, box, slope in some:
        margin = programs.get(McCormick, scaled.layout).solve(scaled, box).margin
        point, known = programs.get(WithinBox, scaled.layout, True).solve(scaled, box, slope)
        free, free_known = programs.get(WithinBox, scaled.layout, False).solve(scaled, box, slope)
        assert known
        assert free_known
        if abs(margin) > 1e-5:
            assert (point is not None) == (margin < 0.0)
            seen.add(margin < 0.0)
        if point is None:
            continue
        assert free is not None
        at, least = (np.hstack([each.toes - each.com, each.forces]) for each in (point, free))
        assert (at >= box.low - 1e-5).all()
        assert (at <= box.high + 1e-5).all()
        assert np.sum(slope * least) <= np.sum(slope * at) + 1e-5
    assert seen == {False, True}
