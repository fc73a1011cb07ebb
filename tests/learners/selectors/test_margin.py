"""P1's margin as a layer of torch: its gradient is that of finite differences, and a short loop
learns by it.
"""

import numpy as np
import pytest
import torch

from stancekit.envs.distributions.postures import distribution
from stancekit.learners.selectors.neural import margins
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.mccormick import McCormick, WithoutMoment
from tests.refusals import refuses


def some(name: str, count: int, *, with_margin: bool = True) -> list[Scaled]:
    """Problems of which P̄ has an answer, so that P1 has a margin; or those of which it has
    none.
    """
    rng, programs, found = np.random.default_rng(3), Programs(), list[Scaled]()
    while len(found) < count:
        problem = Scaled.of(distribution(name).sample(rng))
        answered = programs.get(WithoutMoment, problem.layout).solve(problem) is not None
        found += [problem] if answered == with_margin else []
    return found


def boxes(problems: list[Scaled], seed: int = 0) -> list[torch.Tensor]:
    """Boxes of some width about the patches' middles, in double precision."""
    rng, out = np.random.default_rng(seed), []
    for problem in problems:
        middle = np.hstack(
            [problem.patches.mean(axis=1), np.full((problem.size[0], 3), [0.4, 0.0, 0.2])]
        )
        width = rng.uniform(0.05, 0.25, (2, *middle.shape))
        out.append(np.stack([middle - width[0], middle + width[1]]))
    low, high = np.stack(out, axis=1)
    return [torch.tensor(side, requires_grad=True) for side in (low, high)]


@pytest.mark.parametrize(
    ("name", "relaxation"), [("wall-3", "p1"), ("wall-3", "joint"), ("ground-3", "p1")]
)
def test_the_gradient_is_that_of_finite_differences(name: str, relaxation: str) -> None:
    problems, programs = some(name, 2), Programs()
    sides = boxes(problems)
    at = margins(*sides, problems, programs, relaxation)
    assert bool((at.abs() > 1e-4).all())
    assert torch.autograd.gradcheck(
        lambda low, high: margins(low, high, problems, programs, relaxation),
        sides,
        eps=1e-4,
        atol=1e-4,
        rtol=1e-3,
    )


def test_a_batch_is_its_scenes_one_by_one_in_the_precision_of_the_boxes() -> None:
    problems, programs = some("wall-5", 3), Programs()
    low, high = (side.detach() for side in boxes(problems))
    found = margins(low, high, problems)
    assert found.dtype == torch.float64
    for k, problem in enumerate(problems):
        box = Envelope(low=low[k].numpy(), high=high[k].numpy())
        assert float(found[k]) == McCormick.margin(programs, problem, box).margin
    assert margins(low.float(), high.float(), problems).dtype == torch.float32


def test_where_there_is_no_margin_nothing_flows_back() -> None:
    problems = some("wall-3", 1, with_margin=False)
    low, high = boxes(problems)
    found = margins(low, high, problems)
    torch.autograd.backward(found.sum())
    assert float(found[0].detach()) == 0.0
    assert low.grad is not None
    assert not bool(low.grad.any())


def test_boxes_of_another_number_of_scenes_or_contacts_are_refused() -> None:
    problems = some("wall-3", 2)
    low, high = boxes(problems)
    with refuses("low", "high"):
        margins(low[:1], high, problems)
    with refuses("low", "high"):
        margins(high, low, problems)
