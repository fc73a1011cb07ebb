"""A leap: phases of stance and flight, from one state of the body to another, over candidate
patches per toe.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, checked, checked_int, checked_members, checked_name, read_only
from ..files.codec import LATER
from ..files.documents import YAML, read_json, read_yaml
from ..physics import GRAVITY_M_S2
from ..robot.model import LegLimits, Limb, Robot
from ..terrain.patch import Patch
from .contact import Foothold

FORMAT = "stancekit/leap/1"


def is_leap_class(name: str) -> bool:
    """Tell whether a name, or a file's, speaks of a class of leaps, be there one or not."""
    return Path(name).name.startswith("leap-")


def is_drawn(path: str | Path) -> bool:
    """Tell whether a name, and no file, is CLASS or CLASS:SEED of a class of leaps."""
    name = str(path).partition(":")[0]
    if not is_leap_class(name) or Path(path).exists():
        return False
    from .leap_classes import leap_classes  # draws robots and terrain, which is slow to import

    return name in leap_classes()


def is_leap(data: Any) -> bool:
    """Tell whether parsed contents say that they are a leap."""
    if not isinstance(data, Mapping):
        return False
    is_draw = "distribution" in data and set(data) <= {"distribution", "seed"}
    return data.get("format") == FORMAT or "phases" in data or is_draw


def is_leap_file(path: str | Path) -> bool:
    """Tell whether a JSON or YAML file that is there holds a leap, or a name is that of a drawn
    one.
    """
    if is_drawn(path):
        return True
    path = Path(path)
    if path.suffix not in (*YAML, ".json") or not path.is_file():
        return False
    try:
        return is_leap(read_yaml(path) if path.suffix in YAML else read_json(path))
    except InvalidInput:
        return False


MOST_INTERVALS = 64
_SUM_S = 1e-6
"""A timing whose durations add up to the total within this adds up [s]."""
_STILL = 1e-9
"""Speeds and momenta below this are rest."""


@dataclass(frozen=True, kw_only=True)
class Phase:
    """A span of time in which the same limbs stand.

    Arguments:
        limbs: names of those that stand; () in flight.
        intervals: equal parts in each of which forces are constant; a flight needs only one.
    """

    limbs: tuple[str, ...]
    intervals: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "limbs", tuple(checked_name(name, "limbs") for name in self.limbs))
        checked_int(self.intervals, "intervals", least=1, most=MOST_INTERVALS)


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyState:
    """State of a body: where it is and how it moves.

    Arguments:
        com_m: centre of mass c, shape (3,) [m].
        velocity_m_s: v, shape (3,) [m/s].
        momentum_m2_s: L, angular momentum about the centre of mass per mass, shape (3,) [m²/s].
        rotation_rad: small rotation Θ, shape (3,) [rad].
    """

    com_m: Array
    velocity_m_s: Array = field(default_factory=lambda: np.zeros(3))
    momentum_m2_s: Array = field(default_factory=lambda: np.zeros(3))
    rotation_rad: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for name in ("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad"):
            object.__setattr__(self, name, read_only(getattr(self, name), (3,), name))

    @property
    def rests(self) -> bool:
        """Tell whether nothing moves."""
        return bool(np.abs([self.velocity_m_s, self.momentum_m2_s]).max() <= _STILL)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeapLimits:
    """Limits of a leap's body and forces.

    Arguments:
        momentum_m2_s: largest value of each component of L per mass, at the ends of intervals
            [m²/s].
        tilt_rad, goal_tilt_rad: largest value of each component of Θ, throughout and at the end
            [rad].
        height_m: least height of the centre of mass over every toe that stands [m].
        force_share: largest normal force of a toe in units of the weight.
        ramp: share of that in the interval after a toe lands and in the one before it lifts.
        lift: share of it in the one before a toe lifts, where that is another one; None for
            ``ramp``.
    """

    momentum_m2_s: float = 0.02
    tilt_rad: float = 0.25
    goal_tilt_rad: float = 0.1
    height_m: float = 0.12
    force_share: float = 1.2
    ramp: float = 0.5
    lift: float | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        for name in ("momentum_m2_s", "tilt_rad", "force_share"):
            object.__setattr__(self, name, checked(getattr(self, name), name, above=0.0))
        for name in ("goal_tilt_rad", "height_m"):
            object.__setattr__(self, name, checked(getattr(self, name), name, least=0.0))
        object.__setattr__(self, "ramp", checked(self.ramp, "ramp", above=0.0, most=1.0))
        if self.lift is not None:
            object.__setattr__(self, "lift", checked(self.lift, "lift", above=0.0, most=1.0))
        if self.tilt_rad > 0.5:
            raise InvalidInput(
                f"tilt_rad: expected at most 0.5, where rotations are small, got {self.tilt_rad:g}"
            )

    def most(self, lands: bool | NDArray[np.bool_], lifts: bool | NDArray[np.bool_]) -> Array:
        """Largest normal forces of toes in units of the weight, in intervals after they land, before
        they lift, or neither.
        """
        lift = self.ramp if self.lift is None else self.lift
        share = np.minimum(np.where(lands, self.ramp, 1.0), np.where(lifts, lift, 1.0))
        return np.asarray(self.force_share * share)


@dataclass(frozen=True, kw_only=True, eq=False)
class Leap:
    """A leap over chosen patches: is there a motion of the body, with forces at the toes, from
    start to goal?

    Arguments:
        name: name of the leap.
        robot: a robot with an inertia; every limb may have ``LegLimits``.
        phases: phases of stance and flight, in order; the first, in which the body rests, and the
            last have contacts.
        timings_s: lists of durations of the phases, of which one is to be chosen [s].
        footholds: one for every time that a limb begins to stand, with its candidates, or with the
            toe that stands already; ``frame`` is the phase in which it begins.
        start, goal: states of the body; the goal's c is the centre of a ball.
        goal_radius_m: radius of that ball [m].
        limits: limits of body and forces.
        duration_s: sum of the durations in every timing; None if unknown [s].

    Raises:
        InvalidInput: for a robot without inertia, a first or last phase without contacts, timings
            that do not fit the phases, and footholds that are missing, unused or without
            candidates.
    Source:
        Newton and Euler for one rigid body: v' = Σ f / m + g, L' = Σ (p − c) × f, I Θ' = L.

    Example:
        >>> from stancekit.planners.problem.leap_classes import leap_from_keys
        >>> leap = leap_from_keys({"distribution": "leap-hard", "seed": 0}, "drawn")
        >>> [phase.limbs for phase in leap.phases]
        [('LF', 'RF', 'LH', 'RH'), (), ('LF', 'RF', 'LH', 'RH')]
    """

    word: ClassVar[str] = "leap"
    counts: ClassVar[str] = "interval"
    name: str
    robot: Robot
    phases: tuple[Phase, ...]
    timings_s: tuple[tuple[float, ...], ...]
    footholds: tuple[Foothold, ...]
    start: BodyState
    goal: BodyState
    goal_radius_m: float = 0.06
    limits: LeapLimits = field(default_factory=LeapLimits)
    duration_s: float | None = None

    def __post_init__(self) -> None:
        checked_name(self.name, "name")
        where = f"leap {self.name}: "
        if self.robot.inertia is None:
            raise InvalidInput(
                f"{where}robot.inertia_kgm2: expected the inertia of {self.robot.name}, got none"
            )
        if any(limb.sole_m is not None for limb in self.robot.limbs):
            raise InvalidInput(f"{where}robot: expected point feet, got soles")
        set_field = object.__setattr__
        set_field(self, "phases", checked_members(self.phases, Phase, f"{where}phases"))
        set_field(self, "footholds", checked_members(self.footholds, Foothold, f"{where}footholds"))
        set_field(
            self, "goal_radius_m", checked(self.goal_radius_m, f"{where}goal_radius_m", above=0.0)
        )
        self._check_phases(where)
        set_field(
            self, "timings_s", tuple(tuple(float(s) for s in timing) for timing in self.timings_s)
        )
        self._check_timings(where)
        self._check_footholds(where)

    @property
    def weight_n(self) -> float:
        """m g, the unit of forces [N]."""
        return self.robot.mass_kg * GRAVITY_M_S2

    def to_json(self) -> dict[str, Any]:
        """The leap as JSON-ready values."""
        from .leap_classes import leap_to_json  # draws robots and terrain, which is slow to import

        return leap_to_json(self)

    @property
    def intervals(self) -> int:
        """M, how many intervals all phases have."""
        return sum(phase.intervals for phase in self.phases)

    @cached_property
    def interval_phases(self) -> NDArray[np.int_]:
        """The phase of every interval, shape (M,)."""
        return np.repeat(np.arange(len(self.phases)), [phase.intervals for phase in self.phases])

    @cached_property
    def holds(self) -> NDArray[np.int_]:
        """The foothold under every limb in every phase, −1 where it is lifted, shape (phases,
        N).
        """
        table = np.full((len(self.phases), len(self.robot.limbs)), -1)
        number = {(foothold.limb, foothold.frame): j for j, foothold in enumerate(self.footholds)}
        for i, name in enumerate(self.robot.limb_names):
            for q, phase in enumerate(self.phases):
                if name in phase.limbs:
                    stood = q > 0 and name in self.phases[q - 1].limbs
                    table[q, i] = table[q - 1, i] if stood else number[name, q]
        return table

    @property
    def still(self) -> tuple[bool, bool]:
        """Tell whether the first and the last interval are in equilibrium: where the body rests
        there.
        """
        return self.start.rests, self.goal.rests

    @property
    def goal_m(self) -> Array:
        """Place where the centre of mass is to end, shape (3,) [m]."""
        return self.goal.com_m

    @property
    def choices(self) -> int:
        """Number of choices of candidates."""
        return int(np.prod([len(foothold.candidates) for foothold in self.footholds], dtype=object))

    def leg(self, limb: Limb) -> LegLimits:
        """Limits of a limb's leg; where unknown, its shoulder is the hip and nothing is
        limited.
        """
        return limb.leg or LegLimits(hip_m=limb.shoulder_m)

    def times_s(self, timing: int) -> Array:
        """Ends of the intervals for one of the timings, from 0, shape (M + 1,) [s]."""
        lasts = np.repeat(
            [
                s / phase.intervals
                for s, phase in zip(self.timings_s[timing], self.phases, strict=True)
            ],
            [phase.intervals for phase in self.phases],
        )
        return np.concatenate([[0.0], np.cumsum(lasts)])

    def patch(self, foothold: int, choice: Sequence[int] | NDArray[np.int_]) -> Patch:
        """The patch under a foothold for a choice of candidates, shape (P,)."""
        return self.footholds[foothold].candidates[int(choice[foothold])]

    def columns(self, rows: int = 0) -> dict[str, tuple[int, ...]]:
        """The shape of each array of an answer, by name; the timing is one number."""
        count, placed = self.intervals, len(self.footholds)
        return {
            "timing": (),
            "choice": (placed,),
            "com_m": (count + 1, 3),
            "velocity_m_s": (count + 1, 3),
            "momentum_m2_s": (count + 1, 3),
            "rotation_rad": (count + 1, 3),
            "toes_m": (placed, 3),
            "forces_n": (count, len(self.robot.limbs), 3),
            "legs_turn_rad": (count, 3),
            "gather": (2,),
        }

    def hindrance(self, unchecked: Sequence[str]) -> str:
        """The reason why no runner executes an answer: it has to begin and end at rest, and to be
        judged with its legs.
        """
        if not all(self.still):
            return "it begins or ends in motion"
        return "its legs are not known: plan it with --robot FILE" if unchecked else ""

    def _check_phases(self, where: str) -> None:
        ends = [self.phases[0], self.phases[-1]] if self.phases else []
        if not self.start.rests:
            ends = ends[1:]  # which may begin in the air
        if not self.phases or not all(phase.limbs for phase in ends):
            raise InvalidInput(
                f"{where}phases: expected contacts in the first and in the last phase, got a flight"
            )
        if self.intervals > MOST_INTERVALS:
            raise InvalidInput(
                f"{where}phases: expected at most {MOST_INTERVALS} intervals, got {self.intervals}"
            )
        for q, phase in enumerate(self.phases):
            if len(set(phase.limbs)) < len(phase.limbs) or not set(phase.limbs) <= set(
                self.robot.limb_names
            ):
                known = ", ".join(self.robot.limb_names)
                raise InvalidInput(
                    f"{where}phases[{q}].limbs: expected some of {known}, each once, got "
                    f"{', '.join(phase.limbs)}"
                )

    def _check_timings(self, where: str) -> None:
        if not self.timings_s:
            raise InvalidInput(f"{where}timings_s: expected one or more timings, got none")
        for k, timing in enumerate(self.timings_s):
            if len(timing) != len(self.phases):
                raise InvalidInput(
                    f"{where}timings_s[{k}]: expected {len(self.phases)} durations, one per phase, "
                    f"got {len(timing)}"
                )
            if not all(0.0 < s < 60.0 for s in timing):
                raise InvalidInput(
                    f"{where}timings_s[{k}]: expected durations above 0 and below 60 s, got "
                    f"{list(timing)}"
                )
            if self.duration_s is not None and abs(sum(timing) - self.duration_s) > _SUM_S:
                raise InvalidInput(
                    f"{where}timings_s[{k}]: expected durations that add up to duration_s, "
                    f"{self.duration_s:g} s, got "
                    f"{sum(timing):g} s"
                )

    def _check_footholds(self, where: str) -> None:
        wanted = {
            (name, q)
            for q, phase in enumerate(self.phases)
            for name in phase.limbs
            if q == 0 or name not in self.phases[q - 1].limbs
        }
        pairs = [(foothold.limb, foothold.frame) for foothold in self.footholds]
        for name, q in sorted(wanted - set(pairs), key=lambda one: (one[1], one[0])):
            raise InvalidInput(
                f"{where}footholds: expected one of {name} in phase {q}, where it begins to stand"
            )
        for j, one in enumerate(pairs):
            if one not in wanted or pairs.index(one) != j:
                raise InvalidInput(
                    f"{where}footholds[{j}]: expected one per limb and phase in which it begins to "
                    "stand, got another "
                    f"of {one[0]} in phase {one[1]}"
                )
        for j, foothold in enumerate(self.footholds):
            for name in ("force_min", "force_max"):
                if getattr(foothold, name) is not None:
                    raise InvalidInput(
                        f"{where}footholds[{j}].{name}: expected None in a leap, whose forces "
                        "limits.force_share bounds, got bounds of its own"
                    )
