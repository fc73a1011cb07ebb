"""When feet stand and swing: gaits by name, and the schedule that a task gets of one (Pan et al.
§III-A).

A robot on fewer than three feet falls over them as an inverted pendulum does: what it is off grows
by e^(t/√(h/g)). A lower one has to take shorter steps, or no tracker holds it: cycles go with √h
(dynamic similarity, R. McN. Alexander and A. S. Jayes, J. Zool. 201, 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput
from ..files.arrays import Array, checked_choice, read_only


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
            0.5 * SHORTEST, np.rint(0.5 * self.cycle_s * np.sqrt(height_m / HEIGHT_M) / step_s)
        )
        return replace(self, cycle_s=min(self.cycle_s, 2.0 * float(halves) * step_s))


HEIGHT_M = 0.42
"""Height of ``anymal``'s centre of mass, whose cycles these are [m]."""
SHORTEST = 4.0
"""Steps of the grid in the shortest cycle: in two of them a foot swings."""

GAITS = {
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
"""Gaits by name. Left and right pairs of the pace, front and hind ones of the bound push in turn,
and in the gallop one foot after the other; they are slow ones, whose pairs hand over the weight in
.2 s, without a flight."""
SHORTEST_STAND_S = 0.2
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


def gait_named(name: str) -> Gait:
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
    if gait.cycle_s < SHORTEST * step_s - 1e-9:
        raise InvalidInput(
            f"cycle_s: expected {SHORTEST * step_s:g} s or more, got {gait.cycle_s:g} s"
        )
    lifts = [offset * gait.cycle_s for offset in gait.offsets]
    tail = (
        max(lifts) + gait.swing_s - gait.cycle_s
    )  # how far the last swing reaches over its cycle's end
    cycles = int(np.floor((duration_s - 2.0 * SHORTEST_STAND_S - tail) / gait.cycle_s + 1e-9))
    if cycles < 1:
        needed = gait.cycle_s + tail + 2.0 * SHORTEST_STAND_S
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
