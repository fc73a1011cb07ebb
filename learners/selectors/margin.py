"""P1's signed margin in torch: a batch of scenes and boxes in, a margin each out, and the exact
gradient back.

By the envelope theorem the derivative of the optimal margin in a bound of the box is that of P1's
Lagrangian, which P1's multipliers give without another solve. What trains through it learns boxes
that P1 answers right with.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.relaxation.envelope import Envelope
from stancekit.planners.relaxation.table import RELAXATIONS

from .network import as_arrays


class Margin(torch.autograd.Function):
    """Margins that ``margins`` applies."""

    @staticmethod
    def forward(
        ctx: Any,
        low: Tensor,
        high: Tensor,
        problems: Sequence[Scaled],
        programs: Programs,
        relaxation: str,
    ) -> Tensor:
        """Solve P1 once a scene."""
        lows, highs = as_arrays(low, high)
        values, slopes = np.zeros(len(problems)), np.zeros((2, *lows.shape))
        for i, problem in enumerate(problems):
            box = Envelope(low=lows[i], high=highs[i])
            answer = RELAXATIONS.get(relaxation).margin(programs, problem, box, gradient=True)
            if answer.gradient is not None:
                values[i], slopes[:, i] = answer.margin, answer.gradient
        ctx.save_for_backward(torch.as_tensor(slopes, dtype=low.dtype))
        return torch.as_tensor(values, dtype=low.dtype)

    @staticmethod
    def backward(ctx: Any, *outputs: Tensor) -> tuple[Tensor, Tensor, None, None, None]:
        """Chain rule."""
        (slopes,) = ctx.saved_tensors
        grown = outputs[0][:, None, None]
        return slopes[0] * grown, slopes[1] * grown, None, None, None


def margins(
    low: Tensor,
    high: Tensor,
    problems: Sequence[Scaled],
    programs: Programs | None = None,
    relaxation: str = "p1",
) -> Tensor:
    """The signed margin of P1 of each scene over its box: 0 or less where P1 admits the scene, and
    by how much.

    Returns shape (B,), in the precision of ``low``; where P1 has no margin, P̄ having no answer, it
    is 0 and nothing flows back. Differentiable once, on the processor.

    Arguments:
        low, high: bounds of [p, f], non-dimensional, shape (B, N, 6), low ≤ high.
        problems: B of them, with N contacts.
        programs: compiled models, which a loop keeps from call to call; new ones where None.
        relaxation: which P1, "p1" or "joint".

    Raises:
        InvalidInput: for boxes of other shapes, not finite or reversed.
    """
    wanted = (len(problems), problems[0].size[0], 6) if problems else (0,)
    if tuple(low.shape) != wanted or tuple(high.shape) != wanted:
        raise InvalidInput(
            f"low, high: expected shape {wanted}, got {tuple(low.shape)} and {tuple(high.shape)}"
        )
    margins_of_boxes: Tensor = Margin.apply(low, high, problems, programs or Programs(), relaxation)  # type: ignore[no-untyped-call]
    return margins_of_boxes
