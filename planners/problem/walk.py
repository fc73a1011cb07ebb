"""A walk: what a robot with a torso and feet is asked to do over a terrain (Pan et al. §V)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_choice, collect_errors, read_only
from ..robot.model import Robot
from ..robot.walker import walker_from
from ..terrain.families import Terrain
from ..terrain.heightfield import HeightField
from ..terrain.reference import named_terrain


@dataclass(frozen=True, kw_only=True)
class Gait:
    """A periodic gait.

    Arguments:
        cycle_s: duration of a cycle for a robot whose centre of mass is at HEIGHT_M [s].
        duty: share of the cycle in which a foot stands.
        offsets: when in the cycle each foot lifts off.
    """

    name: str
    cycle_s: float
    duty: float
    offsets: tuple[float, ...]

    @property
    def swing_s(self) -> float:
        """Time that a foot is in the air [s]."""
        return (1.0 - self.duty) * self.cycle_s

    @property
    def balances(self) -> bool:
        """Tell whether there are moments at which fewer than three feet stand."""
        since = np.subtract.outer(self.offsets, self.offsets) % 1.0
        swinging = (since < 1.0 - self.duty - 1e-9).sum(axis=1)
        return bool(len(self.offsets) - swinging.max() < 3)

    def at(self, height_m: float, step_s: float) -> Gait:
        """Gait of a robot whose centre of mass stands this high: a cycle of that robot's, halves of
        it on the grid of step_s, no longer than this one. Gaits on three feet stay as they are.
        """
        if not self.balances:
            return self
        halves = max(
            0.5 * _SHORTEST, np.rint(0.5 * self.cycle_s * np.sqrt(height_m / _HEIGHT_M) / step_s)
        )
        return replace(self, cycle_s=min(self.cycle_s, 2.0 * float(halves) * step_s))


_HEIGHT_M = 0.42
"""Height of ``anymal``'s centre of mass, whose cycles these are [m]."""
_SHORTEST = 4.0
"""Steps of the grid in the shortest cycle: in two of them a foot swings."""

GAITS = MappingProxyType(
    {
        gait.name: gait
        for gait in (
            # feet LF, RF, LH, RH
            Gait(name="walk", cycle_s=1.6, duty=0.75, offsets=(0.25, 0.75, 0.0, 0.5)),
            Gait(name="trot", cycle_s=1.0, duty=0.6, offsets=(0.0, 0.5, 0.5, 0.0)),
            Gait(name="pace", cycle_s=0.8, duty=0.75, offsets=(0.0, 0.5, 0.0, 0.5)),
            Gait(name="bound", cycle_s=0.8, duty=0.75, offsets=(0.0, 0.0, 0.5, 0.5)),
            Gait(name="gallop", cycle_s=0.8, duty=0.75, offsets=(0.0, 0.1667, 0.5, 0.6667)),
            # feet LF, LM, LR, RF, RM, RR
            Gait(name="tripod", cycle_s=1.0, duty=0.6, offsets=(0.0, 0.5, 0.0, 0.5, 0.0, 0.5)),
        )
    }
)
"""Gaits by name. Left and right pairs of the pace, front and hind ones of the bound push in turn,
and in the gallop one foot after the other; they are slow ones, whose pairs hand over the weight in
.2 s, without a flight."""
_SHORTEST_STAND_S = 0.2
"""At the beginning and at the end all feet stand for this long at least [s]."""


@dataclass(frozen=True, eq=False)
class FootPhases:
    """The phases of one foot: it stands, swings, stands, …, stands.

    Arguments:
        switches_s: lift-off and touchdown of each swing in turn, increasing, shape (2 S,) [s].
    """

    switches_s: Array
    duration_s: float

    def __post_init__(self) -> None:
        switches = read_only(self.switches_s, (None,), "switches_s")
        object.__setattr__(self, "switches_s", switches)
        edges = np.concatenate([[0.0], switches, [self.duration_s]])
        if len(switches) % 2 or not np.all(np.diff(edges) > 0.0):
            raise InvalidInput(
                f"switches_s: expected pairs of increasing times within 0 … {self.duration_s:g} s, got something else"
            )

    @property
    def swings(self) -> int:
        """Number of times that the foot swings; it stands once more."""
        return len(self.switches_s) // 2

    @property
    def edges_s(self) -> Array:
        """Times at which the phases begin and end, shape (2 S + 2,) [s]; phases of even index are
        stances.
        """
        return np.concatenate([[0.0], self.switches_s, [self.duration_s]])

    def stance(self, index: int) -> tuple[float, float]:
        """Beginning and end of a stance [s]."""
        return float(self.edges_s[2 * index]), float(self.edges_s[2 * index + 1])

    def swing(self, index: int) -> tuple[float, float]:
        """Lift-off and touchdown of a swing [s]."""
        return float(self.edges_s[2 * index + 1]), float(self.edges_s[2 * index + 2])

    def phase_at(self, times_s: Array) -> Array:
        """Number of the phase at each time, even for stances; a foot stands at lift-off and at
        touchdown.
        """
        edges = self.edges_s
        phase = np.clip(
            np.searchsorted(edges, np.asarray(times_s) + 1e-9, side="right") - 1, 0, len(edges) - 2
        )
        begins = np.abs(np.asarray(times_s) - edges[phase]) <= 1e-9
        return np.asarray(np.where((phase % 2 == 1) & begins, phase - 1, phase))

    def stands(self, times_s: Array) -> NDArray[np.bool_]:
        """Tell whether the foot stands at each time, shape of ``times_s``, bool."""
        return np.asarray(self.phase_at(times_s) % 2 == 0, dtype=np.bool_)


def _gait_named(name: str) -> Gait:
    """The gait of this name.

    Raises InvalidInput.
    """
    checked_choice(name, "gait", GAITS)
    return GAITS[name]


def schedule(
    gait: Gait, feet: Sequence[str], duration_s: float, step_s: float
) -> tuple[FootPhases, ...]:
    """Phases of all feet: as many whole cycles as fit between two stands of all feet, switches on
    the grid of step_s.

    Raises InvalidInput where the gait is for another number of feet, its cycle is too short for the
    grid, or none fits into the duration.
    """
    if len(gait.offsets) != len(feet):
        raise InvalidInput(
            f"gait: expected one for {len(feet)} feet, got {gait.name}, which is for "
            f"{len(gait.offsets)}"
        )
    if gait.cycle_s < _SHORTEST * step_s - 1e-9:
        raise InvalidInput(
            f"cycle_s: expected {_SHORTEST * step_s:g} s or more, got {gait.cycle_s:g} s"
        )
    lifts = [offset * gait.cycle_s for offset in gait.offsets]
    tail = (
        max(lifts) + gait.swing_s - gait.cycle_s
    )  # how far the last swing reaches over its cycle's end
    cycles = int(np.floor((duration_s - 2.0 * _SHORTEST_STAND_S - tail) / gait.cycle_s + 1e-9))
    if cycles < 1:
        needed = gait.cycle_s + tail + 2.0 * _SHORTEST_STAND_S
        raise InvalidInput(
            f"duration_s: expected {needed:g} s or more for one cycle of the {gait.name}, got "
            f"{duration_s:g} s"
        )
    lead = 0.5 * (duration_s - cycles * gait.cycle_s - tail)
    lead = step_s * np.floor(lead / step_s + 1e-9)
    swing = max(2, round(gait.swing_s / step_s)) * step_s
    phases = []
    for lift in lifts:
        begins = lead + lift + gait.cycle_s * np.arange(cycles)
        begins = step_s * np.round(begins / step_s)
        phases.append(FootPhases(np.stack([begins, begins + swing], axis=1).ravel(), duration_s))
    return tuple(phases)


_Timings = Literal["fixed", "optimised"]
_SUCTION = 2.0
"""Pull of an adhesive foot where a task does not say, in units of m·g; walks out of steep pits take
1.5."""
_SAME_RAD = 1e-9
"""Headings closer than this are one, so that whole turns added to one of them change nothing."""
_STEEPEST = 1.0
"""Gradient of the terrain beyond which a foot without suction cannot hold: no start and no goal
there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Walk:
    """One walk over a terrain (Pan et al. §V).

    Arguments:
        robot: a robot with ``feet``; ``Walk.over`` measures those of others.
        terrain: a height field.
        start, goal: places of the torso's centre of mass at the start and at the end,
            shape (2,) [m].
        start_yaw_rad: heading at the start, kept within half a turn of x [rad].
        end_yaw_rad: heading at the end; None for that of the start. The robot turns the shorter way
            round, and it is kept within half a turn of the start [rad].
        duration_s: T [s], up to 120.
        friction: ν of W5; less makes walks slower to find, and gentler.
        adhesive: truth values, True for feet that stick, one per foot; empty for none.
        suction_n: largest pull of an adhesive foot, s in ‖f_t‖ ≤ ν (f_n + s) [N]; SUCTION times the
            weight if missing.
        gait: a name of ``problem.gaits.GAITS``, for as many feet as the robot has.
        cycle_s: duration of a gait cycle [s]; the gait's own if missing, shorter for a low robot
            that balances on fewer than three feet.
        timings: ``fixed``, phases of the gait's schedule; ``optimised``, switching times are
            variables.

    Raises:
        InvalidInput: for a place off the terrain or where the robot cannot stand.
    Source:
        Pan et al. §III and §V.

    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
        >>> asked = stancekit.Walk.over(level, (0.2, 0.0), robot="anymal", duration_s=2.0)
        >>> stancekit.walk(asked, chart="decoupled").problem is asked
        True
    """

    robot: Robot
    terrain: HeightField
    start: Array
    goal: Array
    start_yaw_rad: float = 0.0
    end_yaw_rad: float | None = None
    duration_s: float = 10.0
    friction: float = 0.75
    adhesive: tuple[bool, ...] = ()
    suction_n: float | None = None
    gait: str = "trot"
    cycle_s: float | None = None
    timings: _Timings = "fixed"

    def __post_init__(self) -> None:
        feet = len(self.robot.feet)
        if not feet:
            raise InvalidInput(
                f"robot: expected one with feet, which Walk.over measures, got {self.robot.name} "
                "without"
            )
        object.__setattr__(
            self, "adhesive", tuple(bool(sticks) for sticks in self.adhesive) or (False,) * feet
        )
        if len(self.adhesive) != feet:
            raise InvalidInput(f"adhesive: expected {feet} truth values, got {len(self.adhesive)}")
        checked_choice(self.timings, "timings", get_args(_Timings))
        _gait_named(self.gait)
        if self.cycle_s is not None:
            checked(self.cycle_s, "cycle_s", above=0.0)
        sucks = _SUCTION * self.robot.weight_n if self.suction_n is None else self.suction_n
        collect_errors(
            lambda: self._set("start", read_only(self.start, (2,), "start")),
            lambda: self._set("goal", read_only(self.goal, (2,), "goal")),
            lambda: self._set("start_yaw_rad", checked(self.start_yaw_rad, "start_yaw_rad")),
            lambda: self._set(
                "end_yaw_rad",
                None if self.end_yaw_rad is None else checked(self.end_yaw_rad, "end_yaw_rad"),
            ),
            lambda: self._set(
                "duration_s", checked(self.duration_s, "duration_s", above=0.0, most=120.0)
            ),
            lambda: self._set("friction", checked(self.friction, "friction", above=0.0, most=10.0)),
            lambda: self._set("suction_n", checked(sucks, "suction_n", least=0.0)),
        )
        self._set("start_yaw_rad", math.remainder(self.start_yaw_rad, math.tau))
        if self.end_yaw_rad is not None:
            turn = math.remainder(self.end_yaw_rad - self.start_yaw_rad, math.tau)
            self._set("end_yaw_rad", self.start_yaw_rad + (turn if abs(turn) > _SAME_RAD else 0.0))
        collect_errors(lambda: self._check_place("start"), lambda: self._check_place("goal"))

    @classmethod
    def over(
        cls,
        terrain: Terrain | HeightField | str | Path,
        goal: Array | Sequence[float],
        *,
        robot: Robot | str | Path = "anymal",
        start: Array | Sequence[float] = (0.0, 0.0),
        gait: str | None = None,
        adhesive: Sequence[str] = (),
        **further: Any,
    ) -> Walk:
        """A walk by names and files: of its robot, its terrain and the feet that stick.

        Arguments:
            terrain: a height field, a terrain, a name, or a file of either.
            goal, start: shape (2,) [m].
            robot: a name, a file, or a robot with legs of its own.
            gait: trot on four feet and tripod on six where None.
            adhesive: names of feet that stick.
            further: other fields.

        Raises:
            InvalidInput: for what cannot be read, and as ``Walk`` does.
        """
        body = walker_from(robot)
        if isinstance(adhesive, str) or not isinstance(adhesive, Sequence):
            raise InvalidInput(f"adhesive: expected a sequence (text each), got {adhesive!r}")
        if strange := [name for name in adhesive if name not in body.limb_names]:
            wanted = f"some of {', '.join(body.limb_names)}"
            raise InvalidInput(f"adhesive: expected {wanted}, got {', '.join(map(str, strange))}")
        return cls(
            robot=body,
            terrain=_heights(terrain),
            start=read_only(start, (2,), "start"),
            goal=read_only(goal, (2,), "goal"),
            adhesive=tuple(name in adhesive for name in body.limb_names),
            gait=gait or ("trot" if len(body.feet) == 4 else "tripod"),
            **further,
        )

    def phases(self, step_s: float) -> tuple[FootPhases, ...]:
        """When every foot stands and swings, on the grid of step_s.

        Raises InvalidInput where no cycle fits.
        """
        gait = _gait_named(self.gait)
        scaled_gait = gait.at(self.robot.stand_height_m, step_s)
        timed = scaled_gait if self.cycle_s is None else replace(gait, cycle_s=self.cycle_s)
        return schedule(timed, self.robot.limb_names, self.duration_s, step_s)

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def yaws(self) -> tuple[float, float]:
        """Headings at the start and at the end [rad]."""
        return (
            self.start_yaw_rad,
            self.start_yaw_rad if self.end_yaw_rad is None else self.end_yaw_rad,
        )

    def stance_m(self, xy_m: Array, yaw_rad: float | None = None) -> Array:
        """Places of the feet of the nominal stance on the terrain, with the torso over ``xy_m``,
        shape (E, 3) [m].

        Arguments:
            yaw_rad: its heading, that of the start where it is None.
        """
        turn = _turn(self.start_yaw_rad if yaw_rad is None else yaw_rad)
        xy = xy_m + np.array([foot.nominal_m[:2] for foot in self.robot.feet]) @ turn.T
        return np.column_stack([xy, self.terrain.height(xy)])

    def _check_place(self, which: str) -> None:
        """Raise InvalidInput for a place off the terrain, inside a wall, or where the feet cannot
        reach the ground.
        """
        xy, yaw = getattr(self, f"{which}"), self.yaws()[which == "goal"]
        feet = self.stance_m(xy, yaw)
        if not np.all(self.terrain.contains(np.vstack([feet[:, :2], xy]))):
            (x0, x1), (y0, y1) = self.terrain.domain_m
            raise InvalidInput(
                f"{which}: expected torso and feet over the terrain, [{x0:g}, {x1:g}] × "
                f"[{y0:g}, {y1:g}] m, "
                f"got ({xy[0]:g}, {xy[1]:g})"
            )
        slope = float(np.linalg.norm(self.terrain.gradient(xy)))
        if slope > max(_STEEPEST, self.friction):
            raise InvalidInput(
                f"{which}: expected ground to stand on, got a wall of "
                f"{np.rad2deg(np.arctan(slope)):.0f}° "
                f"at ({xy[0]:g}, {xy[1]:g})"
            )
        self._check_reach(which, feet, yaw)

    def _stands(self, xy_m: Array, yaw_rad: float, slope: Array) -> bool:
        """Tell whether a torso over ``xy_m`` with this heading, inclined by ``slope``, has a height
        at which every box holds some ground.

        Boxes stay upright here: on a slope of 45° that is off by a fifth of their sides, and no
        proof is needed.
        """
        lowest, highest = -np.inf, np.inf
        for foot in self.robot.feet:
            lines = (np.linspace(foot.reach_min_m[k], foot.reach_max_m[k], 9) for k in range(2))
            away = (
                np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
                @ _turn(yaw_rad).T
            )
            ground = self.terrain.height(xy_m + away) - away @ slope
            lowest = max(lowest, float(ground.min() - foot.reach_max_m[2]))
            highest = min(highest, float(ground.max() - foot.reach_min_m[2]))
        return lowest <= highest

    def _check_reach(self, which: str, feet: Array, yaw_rad: float) -> None:
        """Some height of the torso, level or along the ground, must bring all feet to ground within
        their boxes.
        """
        xy = getattr(self, f"{which}")
        away = feet[:, :2] - xy
        plane, *_ = np.linalg.lstsq(
            np.column_stack([away, np.ones(len(feet))]), feet[:, 2], rcond=None
        )
        slope = plane[:2] * min(
            1.0, max(_STEEPEST, self.friction) / max(float(np.linalg.norm(plane[:2])), 1e-12)
        )
        if not any(self._stands(xy, yaw_rad, share * slope) for share in (0.0, 0.5, 1.0)):
            raise InvalidInput(
                f"{which}: expected ground that all feet reach, got heights from "
                f"{feet[:, 2].min():.2f} to "
                f"{feet[:, 2].max():.2f} m under the feet at ({xy[0]:g}, {xy[1]:g})"
            )


def _heights(terrain: Terrain | HeightField | str | Path) -> HeightField:
    """The heights to walk over.

    Raises InvalidInput.
    """
    if isinstance(terrain, str | Path):
        return named_terrain(str(terrain))
    if isinstance(terrain, HeightField):
        return terrain
    if terrain.heights is None:
        raise InvalidInput("terrain: expected ground to walk on, got surfaces that are all upright")
    return terrain.heights


def _turn(yaw_rad: float) -> Array:
    """The rotation by a heading in the plane, shape (2, 2)."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cosine, -sine], [sine, cosine]])
