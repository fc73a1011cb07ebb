"""Settings of a walk's program: what is written down, and how it is solved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from ..errors import InvalidInput
from ..files.arrays import check_numbers, checked_choice, checked_int
from .charts import CHARTS

_Dynamics = Literal["centred", "printed", "newton-euler"]


@dataclass(frozen=True, kw_only=True)
class GaitSettings:
    """How a walk is written down and solved.

    Arguments:
        chart: how variables become world quantities, a name of ``charts.CHARTS`` or
            ``FILE.py:NAME``.
        dynamics: ``centred``, PCDM with the force balanced by y₊ − 2y + y₋; ``printed``, W11 as
            printed; ``newton-euler``, W2.
        hessian: ``exact``, or ``lbfgs`` for the paper's comparison.
        max_iterations: iterations of one solve.
        tolerance: success is a largest violation below it [m, m·g, m·g·stand height].
        step_s: Δt [s], a share of the task's duration; smaller means more rows, and less to find
            between them.
        torso_knot_s, force_knot_s: spacing of the splines' knots [s].
        reach_margin_m: kept in hand inside the reach boxes [m].
        clearance_m: of swinging feet in the middle of a swing [m]; swing_height_m: the same in the
            initial guess.
        trunk_clearance_m: of the trunk's lower face over the terrain [m], None for no such term.
        footing: the steepest ground about where a foot stands, as a share of the slope on which
            friction holds; 0 for no such term, None for 0.6 where the ground on the way has such
            places, see ``gait_program.sure``.
        swing_nodes: checks of a swing between its ends where the chart does not flatten the
            terrain.
        smoothing_m: deviation of the Gaussian under which the decoupled chart has the torso's
            terrain [m].
        switch_slack_s: how far optimised switching times may move [s].
        still_end: end at rest.
        poised: begin and end as the robot stands, level and with every foot where it is then, so
            that another walk can go on from there.
        mean_forces: balance a node's motion by the mean of the forces about it, as p₊ − 2 p + p₋ is
            one, instead of by those at the node; what balances add up to over time is right then,
            but some walks are harder to find. Centred dynamics and fixed timings alone.

    Raises:
        InvalidInput: for an unknown chart or word, and for numbers out of range.
    """

    chart: str = "decoupled"
    dynamics: _Dynamics = "centred"
    hessian: Literal["exact", "lbfgs"] = "exact"
    max_iterations: int = 200
    tolerance: float = 1e-4
    step_s: float = 0.05
    torso_knot_s: float = 0.1
    force_knot_s: float = 0.05
    reach_margin_m: float = 0.005
    clearance_m: float = 0.02
    swing_height_m: float = 0.08
    trunk_clearance_m: float | None = 0.01
    footing: float | None = None
    swing_nodes: int = 5
    smoothing_m: float = 0.3
    switch_slack_s: float = 0.1
    still_end: bool = True
    poised: bool = False
    mean_forces: bool = False

    def __post_init__(self) -> None:
        CHARTS.get(self.chart)
        checked_choice(self.dynamics, "dynamics", get_args(_Dynamics))
        checked_choice(self.hessian, "hessian", ("exact", "lbfgs"))
        check_numbers(
            self,
            above=("tolerance", "step_s", "torso_knot_s", "force_knot_s", "smoothing_m"),
            least=(
                "reach_margin_m",
                "clearance_m",
                "trunk_clearance_m",
                "swing_height_m",
                "switch_slack_s",
                "footing",
            ),
        )
        if self.mean_forces and self.dynamics != "centred":
            raise InvalidInput(
                f"mean_forces: expected centred dynamics with it, got {self.dynamics}"
            )
        for name in ("max_iterations", "swing_nodes"):
            checked_int(getattr(self, name), name, least=1)
