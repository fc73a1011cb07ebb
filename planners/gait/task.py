"""What the gait optimiser is asked for, and how it is to be asked: a task and the settings of a solve."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from ..errors import InvalidInput
from ..files.arrays import Array, check_numbers, checked, checked_choice, checked_int, collect_errors, read_only
from ..robot.single_body import GaitRobot
from ..terrain.heightfield import HeightField
from .charts import CHARTS
from .variables.phases import FootPhases, gait_named, schedule

Dynamics = Literal["centred", "printed", "newton-euler"]
Timings = Literal["fixed", "optimised"]
SUCTION = 2.0
"""What an adhesive foot may pull with where a task does not say, in units of m·g; walks out of steep pits take 1.5."""
STEEPEST = 1.0
"""Gradient of the terrain beyond which a foot without suction cannot hold: no start and no goal there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitTask:
    """One walk over a terrain (paper W §V).

    Arguments:
        robot: a torso with feet (``robot.single_body``).
        terrain: a height field.
        start_xy_m, goal_xy_m: of the torso's centre of mass, shape (2,) [m].
        start_yaw_rad: heading at the start [rad].
        end_yaw_rad: heading at the end, that of the start where it is None; from one to the other the robot turns by
            their difference as it is, by more than a half turn where that is more [rad].
        duration_s: T [s], up to 120.
        friction: ν of W5; less makes walks slower to find, and gentler.
        adhesive: feet that stick, one truth value for each foot or none at all.
        suction_n: what such a foot may pull with [N], s in ‖f_t‖ ≤ ν (f_n + s); SUCTION times the weight if missing.
        gait: a name of ``variables.phases.GAITS``, for as many feet as the robot has.
        cycle_s: of the gait [s]; the gait's own if missing, shorter for a low robot that balances on fewer than three
            feet.
        timings: ``fixed``, phases of the gait's schedule; ``optimised``, switching times are variables.
    Raises:
        InvalidInput: for a place off the terrain or where the robot cannot stand.
    """

    robot: GaitRobot
    terrain: HeightField
    start_xy_m: Array
    goal_xy_m: Array
    start_yaw_rad: float = 0.0
    end_yaw_rad: float | None = None
    duration_s: float = 10.0
    friction: float = 0.75
    adhesive: tuple[bool, ...] = ()
    suction_n: float | None = None
    gait: str = "trot"
    cycle_s: float | None = None
    timings: Timings = "fixed"

    def __post_init__(self) -> None:
        feet = len(self.robot.feet)
        object.__setattr__(self, "adhesive", tuple(bool(sticks) for sticks in self.adhesive) or (False,) * feet)
        if len(self.adhesive) != feet:
            raise InvalidInput(f"adhesive: expected {feet} truth values, got {len(self.adhesive)}")
        checked_choice(self.timings, "timings", get_args(Timings))
        gait_named(self.gait)
        if self.cycle_s is not None:
            checked(self.cycle_s, "cycle_s", above=0.0)
        sucks = SUCTION * self.robot.weight_n if self.suction_n is None else self.suction_n
        collect_errors(
            lambda: self._set("start_xy_m", read_only(self.start_xy_m, (2,), "start_xy_m")),
            lambda: self._set("goal_xy_m", read_only(self.goal_xy_m, (2,), "goal_xy_m")),
            lambda: self._set("start_yaw_rad", checked(self.start_yaw_rad, "start_yaw_rad")),
            lambda: self._set(
                "end_yaw_rad", None if self.end_yaw_rad is None else checked(self.end_yaw_rad, "end_yaw_rad")
            ),
            lambda: self._set("duration_s", checked(self.duration_s, "duration_s", above=0.0, most=120.0)),
            lambda: self._set("friction", checked(self.friction, "friction", above=0.0, most=10.0)),
            lambda: self._set("suction_n", checked(sucks, "suction_n", least=0.0)),
        )
        collect_errors(lambda: self._check_place("start"), lambda: self._check_place("goal"))

    def phases(self, step_s: float) -> tuple[FootPhases, ...]:
        """When every foot stands and swings, on the grid of step_s. Raises InvalidInput where no cycle fits."""
        gait = gait_named(self.gait)
        own = gait.at(self.robot.stand_height_m, step_s)
        timed = own if self.cycle_s is None else replace(gait, cycle_s=self.cycle_s)
        return schedule(timed, self.robot.foot_names, self.duration_s, step_s)

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def yaws(self) -> tuple[float, float]:
        """Headings at the start and at the end [rad]."""
        return self.start_yaw_rad, self.start_yaw_rad if self.end_yaw_rad is None else self.end_yaw_rad

    def stance_m(self, xy_m: Array, yaw_rad: float | None = None) -> Array:
        """Where the feet of the nominal stance are on the terrain, with the torso over ``xy_m``, shape (E, 3) [m].

        yaw_rad: its heading, that of the start where it is None.
        """
        turn = _turn(self.start_yaw_rad if yaw_rad is None else yaw_rad)
        xy = xy_m + np.array([foot.nominal_m[:2] for foot in self.robot.feet]) @ turn.T
        return np.column_stack([xy, self.terrain.height(xy)])

    def _check_place(self, which: str) -> None:
        """Raise InvalidInput for a place off the terrain, inside a wall, or where the feet cannot reach the ground."""
        xy, yaw = getattr(self, f"{which}_xy_m"), self.yaws()[which == "goal"]
        feet = self.stance_m(xy, yaw)
        if not np.all(self.terrain.contains(np.vstack([feet[:, :2], xy]))):
            (x0, x1), (y0, y1) = self.terrain.domain_m
            raise InvalidInput(
                f"{which}_xy_m: expected torso and feet over the terrain, [{x0:g}, {x1:g}] × [{y0:g}, {y1:g}] m, "
                f"got ({xy[0]:g}, {xy[1]:g})"
            )
        slope = float(np.linalg.norm(self.terrain.gradient(xy)))
        if slope > max(STEEPEST, self.friction):
            raise InvalidInput(
                f"{which}_xy_m: expected ground to stand on, got a wall of {np.rad2deg(np.arctan(slope)):.0f}° "
                f"at ({xy[0]:g}, {xy[1]:g})"
            )
        self._check_reach(which, feet, yaw)

    def _stands(self, xy_m: Array, yaw_rad: float, slope: Array) -> bool:
        """Whether a torso over ``xy_m`` with this heading, inclined by ``slope``, has a height at which every box holds
        some ground.

        Boxes stay upright here: on a slope of 45° that is off by a fifth of their sides, and no proof is needed.
        """
        lowest, highest = -np.inf, np.inf
        for foot in self.robot.feet:
            lines = (np.linspace(foot.reach_min_m[k], foot.reach_max_m[k], 9) for k in range(2))
            away = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2) @ _turn(yaw_rad).T
            ground = self.terrain.height(xy_m + away) - away @ slope
            lowest = max(lowest, float(ground.min() - foot.reach_max_m[2]))
            highest = min(highest, float(ground.max() - foot.reach_min_m[2]))
        return lowest <= highest

    def _check_reach(self, which: str, feet: Array, yaw_rad: float) -> None:
        """Some height of the torso, level or along the ground, must bring all feet to ground within their boxes."""
        xy = getattr(self, f"{which}_xy_m")
        away = feet[:, :2] - xy
        plane, *_ = np.linalg.lstsq(np.column_stack([away, np.ones(len(feet))]), feet[:, 2], rcond=None)
        slope = plane[:2] * min(1.0, max(STEEPEST, self.friction) / max(float(np.linalg.norm(plane[:2])), 1e-12))
        if not any(self._stands(xy, yaw_rad, share * slope) for share in (0.0, 0.5, 1.0)):
            raise InvalidInput(
                f"{which}_xy_m: expected ground that all feet reach, got heights from {feet[:, 2].min():.2f} to "
                f"{feet[:, 2].max():.2f} m under the feet at ({xy[0]:g}, {xy[1]:g})"
            )


def _turn(yaw_rad: float) -> Array:
    """The rotation by a heading in the plane, shape (2, 2)."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cosine, -sine], [sine, cosine]])


@dataclass(frozen=True, kw_only=True)
class GaitSettings:
    """How a task is written down and solved.

    Arguments:
        chart: how variables become world quantities, a name of ``charts.CHARTS`` or ``FILE.py:NAME``.
        dynamics: ``centred``, PCDM with the force balanced by y₊ − 2y + y₋; ``printed``, W11 as printed;
            ``newton-euler``, W2.
        hessian: ``exact``, or ``lbfgs`` for the paper's comparison.
        max_iterations: of one solve.
        tolerance: success is a largest violation below it [m, m·g, m·g·stand height].
        step_s: Δt [s], a share of the task's duration; smaller means more rows, and less to find between them.
        torso_knot_s, force_knot_s: spacing of the splines' knots [s].
        reach_margin_m: kept in hand inside the reach boxes [m].
        clearance_m: of swinging feet in the middle of a swing [m]; swing_height_m: the same in the initial guess.
        trunk_clearance_m: of the trunk's lower face over the terrain [m], None for no such term.
        swing_nodes: checks of a swing between its ends where the chart does not flatten the terrain.
        smoothing_m: deviation of the Gaussian under which the decoupled chart has the torso's terrain [m].
        switch_slack_s: how far optimised switching times may move [s].
        still_end: end at rest.
        mean_forces: balance a node's motion by the mean of the forces about it, as p₊ − 2 p + p₋ is one, instead of by
            those at the node; what balances add up to over time is right then, but some walks are harder to find.
            Centred dynamics and fixed timings alone.
    Raises:
        InvalidInput: for an unknown chart or word, and for numbers out of range.
    """

    chart: str = "decoupled"
    dynamics: Dynamics = "centred"
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
    swing_nodes: int = 5
    smoothing_m: float = 0.3
    switch_slack_s: float = 0.1
    still_end: bool = True
    mean_forces: bool = False

    def __post_init__(self) -> None:
        CHARTS.get(self.chart)
        checked_choice(self.dynamics, "dynamics", get_args(Dynamics))
        checked_choice(self.hessian, "hessian", ("exact", "lbfgs"))
        above = ("tolerance", "step_s", "torso_knot_s", "force_knot_s", "smoothing_m")
        check_numbers(self, above=above, least=("reach_margin_m", "clearance_m", "swing_height_m", "switch_slack_s"))
        if self.mean_forces and self.dynamics != "centred":
            raise InvalidInput(f"mean_forces: expected centred dynamics with it, got {self.dynamics}")
        for name in ("max_iterations", "swing_nodes"):
            checked_int(getattr(self, name), f"{name}", least=1)
