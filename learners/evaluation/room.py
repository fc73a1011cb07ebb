"""Room for learning: how much the best unlearned control leaves of what any method finds, at a
stated budget.

Room is oracle − control, in points. The oracle is the union of all methods at a larger budget; a
second run of the methods that draw, with another seed, says how much of it is luck. All scenes are
in every denominator.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .leap_bench import AGAIN, FINDERS, TUNED, UNLEARNED, share

Share = tuple[float, float, float]
DRAWS = 10_000
"""Resamples of a paired interval."""


@dataclass(frozen=True, kw_only=True)
class Room:
    """One environment at one budget; shares of all scenes, with the ends of their 95 % intervals.

    Arguments:
        control: the best unlearned method within the budget, whose name is ``controlled_by``.
        random: choices at random.
        learned: the mean of the learned methods, as of one with several training seeds, None
            without any.
        gain: learned − control in points, paired over the scenes.
        oracle: the union of all methods at ``oracle_budget``.
        again: the same with other seeds.
        room: oracle − control, in points.
    """

    environment: str
    budget: str
    oracle_budget: str
    scenes: int
    random: Share | None
    control: Share
    controlled_by: str
    learned: Share | None
    learned_by: str
    gain: Share | None
    oracle: Share
    again: Share | None
    room: float

    def to_json(self) -> dict[str, Any]:
        """JSON-ready values."""
        return vars(self)


def leap_room(
    rows: Sequence[Mapping[str, Any]],
    distribution: str,
    most: int,
    *,
    tries: int | None = None,
    solves: int | None = None,
    cpu_s: float | None = None,
) -> Room:
    """The room of LeapChoice-v0 at a budget of tries, of solves or of CPU time, from rows of
    ``leap_bench`` with ``most`` solves per scene.
    """
    by_method: dict[str, dict[int, Mapping[str, Any]]] = {}
    for row in rows:
        by_method.setdefault(row["method"], {})[row["scene"]] = row
    scenes = sorted(
        set.intersection(*(set(rows_of_method) for rows_of_method in by_method.values()))
    )
    within = {
        method: np.array([_within(rows_of_method[k], tries, solves, cpu_s) for k in scenes])
        for method, rows_of_method in by_method.items()
    }
    anywhere = {
        method: np.array([bool(rows_of_method[k]["found"]) for k in scenes])
        for method, rows_of_method in by_method.items()
    }
    return room_of(
        environment=f"LeapChoice-v0 ({distribution})",
        budget=_budget(tries, solves, cpu_s),
        oracle_budget=f"all methods, {most} solves",
        within=within,
        anywhere=anywhere,
        fair=[method for method in within if method in FINDERS or method in TUNED],
        learned=[method for method in within if method not in UNLEARNED],
        again={first: second for first, (second, _) in AGAIN.items()},
    )


def room_of(
    *,
    environment: str,
    budget: str,
    oracle_budget: str,
    within: Mapping[str, Any],
    anywhere: Mapping[str, Any],
    fair: Sequence[str],
    learned: Sequence[str],
    again: Mapping[str, str],
) -> Room:
    """The room of an environment at a budget.

    Arguments:
        within, anywhere: by method, which scenes it solves within the budget and within the
            oracle's, shape (scenes,).
        fair: methods that may be the control.
        again: of methods that draw, the name of the same with another seed.
    """
    control = max(fair, key=lambda method: int(within[method].sum()))
    mean = np.mean([within[method] for method in learned], axis=0) if learned else None
    redraws = set(again.values())
    oracle = np.any(
        [answer for method, answer in anywhere.items() if method not in redraws], axis=0
    )
    other = None
    if redraws & set(anywhere):
        other = np.any(
            [answer for method, answer in anywhere.items() if method not in again], axis=0
        )
    return Room(
        environment=environment,
        budget=budget,
        oracle_budget=oracle_budget,
        scenes=len(oracle),
        random=_share(within["random"]) if "random" in within else None,
        control=_share(within[control]),
        controlled_by=control,
        learned=None if mean is None else _mean(mean),
        learned_by=", ".join(learned),
        gain=None if mean is None else paired(mean, within[control]),
        oracle=_share(oracle),
        again=None if other is None else _share(other),
        room=100.0 * float(oracle.mean() - within[control].mean()),
    )


def paired(one: Any, other: Any, seed: int = 0) -> Share:
    """The difference of two shares over the same scenes in points, with the ends of its 95 %
    interval (bootstrap).
    """
    apart = 100.0 * (np.asarray(one, dtype=float) - np.asarray(other, dtype=float))
    resamples = np.random.default_rng(seed).integers(len(apart), size=(DRAWS, len(apart)))
    low, high = np.percentile(apart[resamples].mean(axis=1), [2.5, 97.5])
    return float(apart.mean()), float(low), float(high)


def _within(
    row: Mapping[str, Any], tries: int | None, solves: int | None, cpu_s: float | None
) -> bool:
    limits = {"tries": tries, "solves": solves, "cpu_s": cpu_s}
    return bool(row["found"]) and all(
        limit is None or row[name] <= limit for name, limit in limits.items()
    )


def _budget(tries: int | None, solves: int | None, cpu_s: float | None) -> str:
    if tries is not None:
        return "1 try" if tries == 1 else f"{tries} tries"
    return f"{solves} solves" if solves is not None else f"{cpu_s:g} CPU-s"


def _mean(found: Any) -> Share:
    """The mean over methods and scenes, with the ends of its interval.

    Arguments:
        found: shares of the methods, by scene.
    """
    if set(np.unique(found)) <= {0.0, 1.0}:
        return _share(found)
    middle, low, high = paired(found, np.zeros(len(found)))
    return 0.01 * middle, 0.01 * low, 0.01 * high


def _share(found: Any) -> Share:
    one = share(int(np.sum(found)), len(found))
    assert one is not None
    return one
