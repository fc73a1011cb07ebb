"""Friction estimated from what feet feel: those that slid say how much there is, those that held
say how much at least.

A foot that slides feels |f_t| = s μ f_n, where μ is the course's friction and s the share of it
that there is; one that holds feels |f_t| ≤ s μ f_n. With ratios r = |f_t| / (μ f_n), σ of a slide
and σ_h of a stance that held,

    log L(s) = − Σ_slides (s − r)² / 2σ² + Σ_held log Φ((s − r) / σ_h),    0 < s ≤ 1,

and the interval is that of 90 % of L, a flat prior below the course's friction. Without a slide it
is one-sided. It is as good as the noise that is counted on: in simulated climbs s was .01 to .03
too high, which the noise does not cover (docs/concepts/following.md).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from stancekit.planners.files.arrays import Array

from ..log import TOUCH_N, Record
from ..worlds.world import State
from .tracker import Target

_BEARS, _OF_WEIGHT = 8.0, 0.2
"""A foot that should press with so many times what a touch is, or with this share of a light
robot's weight,"""
SILENT_S = 0.3
"""for this time, in one stance or several, and felt nothing meanwhile, is silent."""


class SilentFeet:
    """Counts, for every foot, the time in which it should have pressed and felt nothing.

    Arguments:
        weight_n: of the robot.
        names: of its limbs.
    """

    def __init__(self, rate_hz: float, weight_n: float, names: Sequence[str]) -> None:
        self._periods, self._names = SILENT_S * rate_hz, names
        self._presses_n = min(_BEARS * TOUCH_N, _OF_WEIGHT * weight_n)
        self._silent = np.zeros(len(names))

    def found(
        self, target: Target, state: State, seeks: NDArray[np.bool_] | Literal[False] = False
    ) -> str:
        """Message about a silent foot, and since when it is known, in one line; empty where none
        is. One more period.

        Arguments:
            seeks: feet that are still being lowered to uncertain ground, shape (N,): their time
                does not count.
        """
        sample = target.sample
        wanted_n, felt_n = sample.along_n, np.vecdot(state.forces_n, sample.normals)
        presses = sample.stands & (wanted_n >= self._presses_n) & np.logical_not(seeks)
        self._silent = np.where(felt_n >= TOUCH_N, 0.0, self._silent + presses)
        limb = int(self._silent.argmax())
        if self._silent[limb] < self._periods:
            return ""
        return (
            f"foot of {self._names[limb]}: expected {wanted_n[limb]:.0f} N where it stands, felt "
            "none for "
            f"{SILENT_S:g} s: nothing is under it, or its sensor is dead"
        )


_BLOCK_S = 0.05
"""What a foot feels is looked at in blocks of this length."""
_STOOD_S = 0.1
"""A foot that was put down less than this ago may still find its place."""
_SLIDES_M_S, _HELD_M_S = 0.01, 0.002
"""A foot that should stand and moves faster than this slides, one that is slower than that
holds."""
_LOADED_N = 3.0
_CARRIED = 0.5
"""Share of what feet together should carry; where they carry less the body falls, and what they
feel is no friction."""
_SHARED_NOISE, _SLIDE_NOISE, _HELD_NOISE = 0.015, 0.015, 0.03
"""Standard deviations σ_0 of what all feet err by together; σ of one slide, besides the spread
within it and between slides; σ_h of the largest ratio that held."""
_CHANGED = 3.0
"""Evidence so many standard deviations above a slide that comes after it was of other ground."""
_NEWEST = 4
"""So many slides count, the newest: the same foot that slides again tells nothing new."""
_SHARES = np.linspace(0.005, 1.0, 200)
_TAIL = 0.05


@dataclass(frozen=True, kw_only=True)
class FrictionInterval:
    """Shares of the course's friction: the most likely, and the ends of 90 % of the likelihood.

    Arguments:
        slides, held: how many stances slid, and how many held, that it is estimated from.
    """

    share: float = 1.0
    low: float = 0.0
    high: float = 1.0
    slides: int = 0
    held: int = 0

    @property
    def planned_on(self) -> float:
        """Share of friction to plan with: the lower end as soon as a foot slid, before that the
        course's own friction.
        """
        return self.low if self.slides else 1.0

    @property
    def line(self) -> str:
        """For people."""
        feet = f"{self.slides} stance{'s' * (self.slides != 1)} that slid, {self.held} that held"
        if self.slides:
            return f"{self.share:.2f} of the course's, {self.low:.2f} to {self.high:.2f} (90 %), by {feet}"
        return f"at least {self.low:.2f} of the course's (95 %), by {feet}"

    def to_json(self) -> dict[str, Any]:
        """JSON-ready."""
        return dict(self.__dict__)


_Felt = tuple[bool, float, float]
"""Evidence of one stance: whether it slid, its ratio, that of the slide or the largest that held,
and its noise."""


class FrictionEstimator:
    """Sums up what feet feel over a run; ``interval`` is what it says just now.

    Arguments:
        period_s: of control.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._felt = list[_Felt]()

    def add(self, record: Record, unit: float = 1.0) -> None:
        """Add the next measurements.

        Arguments:
            unit: the share of the course's friction that its targets count on.
        """
        if len(record.pairs) < 2:
            return
        for felt in _stances(record, self._period_s, unit):
            if felt[0]:
                self._felt = [old for old in self._felt if not _contradicted(old, felt)]
            self._felt.append(felt)

    @property
    def interval(self) -> FrictionInterval:
        """By all that was added, but for what a later slide contradicts: friction may have
        changed.
        """
        slides = np.array([felt[1:] for felt in self._felt if felt[0]][-_NEWEST:])
        held = [ratio for slid, ratio, _ in self._felt if not slid]
        likelihood = np.zeros(len(_SHARES))
        if len(slides):
            ratios, noises = slides.T
            between = float(np.var(ratios, ddof=1)) if len(slides) > 1 else 0.0
            each = float(np.mean(noises**2)) + between
            likelihood -= (_SHARES - ratios.mean()) ** 2 / (
                2.0 * (_SHARED_NOISE**2 + each / len(slides))
            )
        if held:
            likelihood += log_ndtr((_SHARES - max(held)) / _HELD_NOISE)
        best = len(_SHARES) - 1 - int(np.argmax(likelihood[::-1]))
        mass = np.cumsum(np.exp(likelihood - likelihood[best]))
        low, high = (
            float(_SHARES[np.searchsorted(mass, part * mass[-1])]) for part in (_TAIL, 1.0 - _TAIL)
        )
        share = float(_SHARES[best])
        return FrictionInterval(
            share=share,
            low=min(low, share),
            high=max(high, share) if len(slides) else 1.0,
            slides=len(slides),
            held=len(held),
        )


def estimated(record: Record, period_s: float) -> FrictionInterval:
    """Friction that one record alone shows."""
    estimator = FrictionEstimator(period_s)
    estimator.add(record)
    return estimator.interval


def _contradicted(old: _Felt, slide: _Felt) -> bool:
    """Tell whether there was more friction then than this slide, which came later, leaves room
    for.
    """
    (_, before, one), (_, now, other) = old, slide
    return before - now > _CHANGED * float(np.hypot(one, other))


def _stances(record: Record, period_s: float, unit: float) -> Iterator[_Felt]:
    """Evidence of every stance of a record, in the order of their ends."""
    targets, states = zip(*record.pairs, strict=True)
    feet = np.array([state.feet_m - target.rolled_m for target, state in record.pairs])
    normals = np.array([target.sample.normals for target in targets])
    forces = np.array([state.forces_n for state in states])
    friction = np.array([target.sample.friction for target in targets]) / unit
    foothold = np.array([target.sample.foothold for target in targets])
    normal = np.einsum("tij,tij->ti", forces, normals)
    across = np.linalg.norm(forces - normal[:, :, None] * normals, axis=2)
    wanted = np.array([target.sample.forces_n[:, 2].sum() for target in targets])
    carried = forces[:, :, 2].sum(axis=1) >= _CARRIED * wanted
    counts = (foothold >= 0) & (normal >= _LOADED_N) & (friction > 0.0) & carried[:, None]
    ratio = across / np.where(counts, normal * friction, np.inf)
    moved = np.diff(feet, axis=0, prepend=feet[:1])
    moved -= np.einsum("tij,tij->ti", moved, normals)[:, :, None] * normals
    result = list[tuple[int, _Felt]]()
    for limb in range(foothold.shape[1]):
        for begin, end in _runs(foothold[:, limb], round(_STOOD_S / period_s)):
            rows = slice(begin, end)
            columns = ratio[rows, limb], moved[rows, limb], counts[rows, limb]
            felt = _stance(*columns, period_s)
            result += [] if felt is None else [(end, felt)]
    return (felt for _, felt in sorted(result, key=lambda pair: pair[0]))


def _runs(foothold: NDArray[np.int_], stood: int) -> Iterator[tuple[int, int]]:
    """First and last + 1 row of every stance; one that begins within the record has time to find
    its place.
    """
    borders = [0, *(np.flatnonzero(np.diff(foothold)) + 1).tolist(), len(foothold)]
    for begin, end in pairwise(borders):
        first = begin + (stood if begin else 0)
        if foothold[begin] >= 0 and end > first:
            yield first, end


def _stance(ratio: Array, moved: Array, counts: NDArray[np.bool_], period_s: float) -> _Felt | None:
    """Evidence of a stance, in blocks counted from its end; None where it bore nothing all the
    time.
    """
    block, held, slid = max(2, round(_BLOCK_S / period_s)), 0.0, list[float]()
    for end in range(len(ratio), block - 1, -block):
        rows = slice(end - block, end)
        if not counts[rows].all():
            continue
        speed = float(np.linalg.norm(moved[rows].sum(axis=0))) / (block * period_s)
        if speed >= _SLIDES_M_S:
            slides = np.linalg.norm(moved[rows], axis=1) >= _SLIDES_M_S * period_s
            slid += ratio[rows][slides].tolist()
        elif speed < _HELD_M_S:
            held = max(held, float(np.median(ratio[rows])))
    if slid:
        return True, float(np.median(slid)), float(np.hypot(_SLIDE_NOISE, _spread(slid)))
    return (False, held, _HELD_NOISE) if held > 0.0 else None


def _spread(values: Sequence[float]) -> float:
    """Standard deviation by the median of what is off the median."""
    some = np.asarray(values)
    return 1.4826 * float(np.median(np.abs(some - np.median(some))))
