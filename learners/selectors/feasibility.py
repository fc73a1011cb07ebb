"""Verdicts of P1 on many problems over many boxes: by solving each, or with what earlier solves
have proved of many boxes at once.

P1 over a box is settled without a solve by
- a *witness*: a point of the problem that lies in the other box and under the other envelope, with room to spare;
- a *certificate*: multipliers of an earlier solve. Their Lagrangian is affine in the products of the box's bounds and
  linear in its bounds, so its minimum over the problem and the other box is a dot product and 6N
  products; where it is positive P1 has no answer;
- a *range*: the box misses where a limb's p or f can be at all;
- or for good, where already P̄ has no answer.
A verdict nearer to the border than BAND is never taken from these, so it is the one that a solve
would have given.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.equilibrium.programs import Programs, programs_of_this_thread
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.relaxation.envelope import FEASIBLE_MARGIN, DualBound, Envelope
from stancekit.planners.relaxation.mccormick import McCormick, domain_of, moment_axes

from ..data.executors import Executor, gather

BAND = 1e-6
"""A witness must have this margin to spare, a certificate must exclude this margin: ten times what
P1 forgives."""
_ROUNDS = 8
"""Number of times that the moments of a witness are tried again with the largest held at their
bounds."""
Bools = NDArray[np.bool_]
Index = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class DualBounds:
    """P boxes.

    Arguments:
        low, high: shape (P, N, 6).
        products: p_j f_k of the ends, in the order of the envelope rows and with their signs in the
            Lagrangian, shape (36 N, P).
    """

    low: Array
    high: Array
    products: Array

    @classmethod
    def of(cls, boxes: Sequence[Envelope]) -> DualBounds:
        """Stack some boxes."""
        low, high = np.stack([box.low for box in boxes]), np.stack([box.high for box in boxes])
        p_low, p_high = low[..., :3, None], high[..., :3, None]
        f_low, f_high = low[..., None, 3:], high[..., None, 3:]
        signed = np.stack([-p_low * f_low, -p_high * f_high, p_low * f_high, p_high * f_low])
        products = np.moveaxis(signed, 1, -1).reshape(-1, len(low))
        return cls(low=low, high=high, products=np.ascontiguousarray(products))

    def take(self, which: Index) -> DualBounds:
        """Some of the boxes."""
        return DualBounds(
            low=self.low[which], high=self.high[which], products=self.products[:, which]
        )


def witnessed(point: Array, excess: Array, axes: Array, bounds: DualBounds, open_: Bools) -> Bools:
    """Tell whether points settle P1 over boxes with BAND to spare, shape (K, W, P), False where not
    open, shape (K, P).

    A point [p, f] in the box is one of P1 if some moments m = p f + e balance there under the
    envelope rows, which read −(p − p_low)(f − f_low) ≤ e, −(p_high − p)(f_high − f) ≤ e, e ≤ (p −
    p_low)(f_high − f) and e ≤ (p_high − p)(f − f_low).

    Arguments:
        point, excess: of K × W witnesses (``DualBound``).
        axes: E9 is axes · m = 0, shape (K, 3, 9N).
    """
    at = point[:, :, None]
    inside = np.all((at >= bounds.low + BAND) & (at <= bounds.high - BAND), axis=(3, 4))
    hits: Bools = np.asarray(inside & open_[:, None])
    k, w, b = np.nonzero(hits)
    if not len(k):
        return hits
    above, below = point[k, w] - bounds.low[b], bounds.high[b] - point[k, w]
    (p_above, f_above), (p_below, f_below) = (
        (side[..., :3, None], side[..., None, 3:]) for side in (above, below)
    )
    bottom = BAND - np.minimum(p_above * f_above, p_below * f_below).reshape(len(k), -1)
    top = np.minimum(p_above * f_below, p_below * f_above).reshape(len(k), -1) - BAND
    hits[k, w, b] = balanced(axes[k], excess[k, w].reshape(len(k), -1), bottom, top)
    return hits


def balanced(axes: Array, excess: Array, bottom: Array, top: Array) -> Bools:
    """Tell whether some e in [bottom, top] has the same axes · e as ``excess``; a False may be
    wrong. Shapes (T, 9N).

    Scaled to |s| ≤ 1 about the middle, the smallest s is tried, then what is too large in it is
    held at ±1 and the rest solved again, ROUNDS times.
    """
    middle, half = 0.5 * (top + bottom), 0.5 * (top - bottom)
    flags = np.zeros(len(axes), dtype=bool)
    rows = np.flatnonzero(np.all(half > 0.0, axis=1))
    scaled = axes[rows] * half[rows][:, None]
    target = np.einsum("trc,tc->tr", axes[rows], excess[rows] - middle[rows])
    held = np.zeros((len(rows), axes.shape[2]))
    for _ in range(_ROUNDS):
        free = scaled * (held == 0.0)[:, None]
        gram = free @ scaled.swapaxes(1, 2) + 1e-14 * np.eye(3)
        rest = target - np.einsum("trc,tc->tr", scaled, held)
        s = held + np.einsum("trc,tr->tc", free, np.linalg.solve(gram, rest[..., None])[..., 0])
        off = np.abs(target - np.einsum("trc,tc->tr", scaled, s)).max(axis=1)
        done = np.all(np.abs(s) <= 1.0, axis=1) & (off < 1e-10)
        flags[rows[done]] = True
        held = np.where(np.abs(s) > 1.0, np.sign(s), held)
        rows, scaled, target, held = rows[~done], scaled[~done], target[~done], held[~done]
        if not len(rows):
            break
    return flags


def least(
    rows: Array, slope: Array, constant: Array, bounds: DualBounds, low: Array, high: Array
) -> Array:
    """Least value of the Lagrangian over [p, f] in the overlap at a margin of BAND, shape (K, C,
    P).

    Where it is positive, P1's margin is larger than BAND.

    Arguments:
        rows, slope, constant: of K × C certificates (``DualBound``).
        low, high: the overlap, shape (K, P, N, 6).
    """
    k, c = rows.shape[:2]
    value = (rows.reshape(k * c, -1) @ bounds.products).reshape(k, c, -1)
    value += (constant - BAND * rows.sum(axis=(2, 3, 4, 5)))[..., None]
    (p_low, f_low), (p_high, f_high) = (
        (np.moveaxis(side[..., :3], 0, -1), np.moveaxis(side[..., 3:], 0, -1))
        for side in (bounds.low, bounds.high)
    )  # each of shape (N, 3, P)
    u = np.moveaxis(rows, 2, 0)
    by_p = (
        (u[0] - u[3]) @ f_low + (u[1] - u[2]) @ f_high + slope[..., :3, None]
    )  # shape (K, C, N, 3, P)
    turned = u.swapaxes(-1, -2)
    by_f = (turned[0] - turned[2]) @ p_low + (turned[1] - turned[3]) @ p_high + slope[..., 3:, None]
    middle, half = (
        np.moveaxis(side, 1, -1)[:, None] for side in (0.5 * (high + low), 0.5 * (high - low))
    )
    for by, part in ((by_p, slice(0, 3)), (by_f, slice(3, 6))):
        value = value + np.sum(
            by * middle[..., part, :] - np.abs(by) * half[..., part, :], axis=(2, 3)
        )
    return np.asarray(value)


def ranges(problem: Scaled) -> tuple[Array, Array]:
    """Bounds of [p, f] in any answer, each of shape (N, 6).

    That is, the patches as seen from the ball of the centre of mass, and the forces in their boxes
    and cones.
    """
    whole = domain_of(problem, reach=False)
    room = 1e-7  # what the solver forgives
    return whole.low - room, whole.high + room


_WITNESS, _CERTIFICATE = 0, 1
CHUNK = 64
"""Problems that are checked at once: bounds the memory."""


@dataclass(frozen=True, kw_only=True)
class VerdictCounts:
    """Counts of the ways in which verdicts came about.

    Arguments:
        unknown: of the solves, those that came to no end (and count as not admitted).
    """

    solved: int = 0
    witness: int = 0
    certificate: int = 0
    range: int = 0
    trivial: int = 0
    unknown: int = 0

    @property
    def total(self) -> int:
        """All verdicts."""
        return self.solved + self.cached

    @property
    def cached(self) -> int:
        """Verdicts without a solve."""
        return self.witness + self.certificate + self.range + self.trivial

    def __sub__(self, other: VerdictCounts) -> VerdictCounts:
        return VerdictCounts(
            **{f.name: getattr(self, f.name) - getattr(other, f.name) for f in fields(self)}
        )


class FeasibilityOracle(Protocol):
    """Says which problems P1 admits over which boxes."""

    @property
    def counts(self) -> VerdictCounts:
        """Counts of the ways in which all verdicts so far came about."""

    def is_feasible(self, which: Index, boxes: Sequence[Envelope]) -> Bools:
        """Decide for every box whether P1 over it is feasible for each of the problems with the
        indices ``which``.

        Returns truth values, shape (len(boxes), len(which)).
        """


class CachingOracle:
    """Solves P1 only where no witness and no certificate kept of earlier solves settles it.

    Arguments:
        witnesses, certificates: how many are kept a problem; the one that has not served for
            longest gives way.
    """

    def __init__(
        self,
        problems: Sequence[Scaled],
        programs: Programs,
        *,
        witnesses: int = 4,
        certificates: int = 8,
    ) -> None:
        self._problems, self._programs = _of_one_size(problems), programs
        size, n = len(problems), problems[0].size[0]
        whole = [ranges(problem) for problem in problems]
        self._range = np.stack([low for low, _ in whole]), np.stack([high for _, high in whole])
        self._axes = np.stack([moment_axes(problem) for problem in problems])
        self._trivial = np.zeros(size, dtype=bool)
        self._point = np.full((size, witnesses, n, 6), np.inf)  # in no box
        self._excess = np.zeros((size, witnesses, n, 3, 3))
        self._rows = np.zeros((size, certificates, 4, n, 3, 3))
        self._slope = np.zeros((size, certificates, n, 6))
        self._constant = np.full((size, certificates), -np.inf)  # proves nothing
        self._used = (
            np.zeros((size, witnesses), dtype=np.int64),
            np.zeros((size, certificates), dtype=np.int64),
        )
        self._clock = 0
        self._tally = dict.fromkeys((f.name for f in fields(VerdictCounts)), 0)

    @property
    def counts(self) -> VerdictCounts:
        """Counts of the ways in which all verdicts so far came about."""
        return VerdictCounts(**self._tally)

    def __len__(self) -> int:
        return len(self._problems)

    def part(self, which: Index) -> CachingOracle:
        """Oracle for these problems alone, numbered anew, with all that is known of them and no
        counts yet.
        """
        part = copy.copy(self)
        part._problems = [self._problems[int(k)] for k in which]
        for name in _KNOWN:
            setattr(part, name, _taken(getattr(self, name), which))
        part._tally = dict.fromkeys(self._tally, 0)
        return part

    def learn(self, which: Index, part: CachingOracle) -> None:
        """Keep what a part has learned of these problems since, and count it."""
        for name in _KNOWN:
            _put_back(getattr(self, name), which, getattr(part, name))
        self._clock = max(self._clock, part._clock)
        self._tally = {name: count + part._tally[name] for name, count in self._tally.items()}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_programs"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _programs=programs_of_this_thread())

    def is_feasible(self, which: Index, boxes: Sequence[Envelope]) -> Bools:
        """Decide whether P1 admits the problems of these numbers, shape (len(boxes),
        len(which)).
        """
        verdicts = np.zeros((len(which), len(boxes)), dtype=bool)
        bounds = DualBounds.of(boxes)
        for begin in range(0, len(which), CHUNK):
            part = which[begin : begin + CHUNK]
            verdicts[begin : begin + CHUNK] = self._decide(part, boxes, bounds)
        return verdicts.T

    def _decide(self, which: Index, boxes: Sequence[Envelope], bounds: DualBounds) -> Bools:
        """Shape (K, P), for K problems and P boxes."""
        self._clock += 1
        admits = np.zeros((len(which), len(boxes)), dtype=bool)
        open_ = np.repeat(~self._trivial[which][:, None], len(boxes), axis=1)
        self._tally["trivial"] += int((~open_).sum())
        low, high = self._overlap(which, bounds)
        missed = open_ & np.any(low > high, axis=(2, 3))
        self._settle("range", missed, open_)
        served = witnessed(
            self._point[which], self._excess[which], self._axes[which], bounds, open_
        )
        admits |= self._credit(_WITNESS, which, served)
        self._settle("witness", admits, open_)
        stored = self._rows[which], self._slope[which], self._constant[which]
        refuted = open_ & self._credit(
            _CERTIFICATE, which, (least(*stored, bounds, low, high) > 0.0) & open_[:, None]
        )
        self._settle("certificate", refuted, open_)
        for row in np.flatnonzero(open_.any(axis=1)):
            self._work(
                int(which[row]), _Case(boxes, bounds, low[row], high[row]), open_[row], admits[row]
            )
        return admits

    def _work(self, k: int, case: _Case, open_: Bools, admits: Bools) -> None:
        """Solve one problem over what is open of its boxes, shape (P,); every solve may settle some
        of the others.
        """
        while open_.any():
            b = int(np.flatnonzero(open_)[0])
            bound = self._solve(k, case.boxes[b])
            open_[b] = False
            admits[b] = bound.margin <= FEASIBLE_MARGIN
            self._tally["solved"] += 1
            self._tally["unknown"] += bool(np.isnan(bound.margin))
            if np.isposinf(
                bound.margin
            ):  # the multipliers of the envelope rows add up to 0: any box will do
                self._trivial[k] = True
                self._settle("trivial", open_.copy(), open_)
            elif not np.isnan(bound.margin):
                kind, slot = self._keep(k, bound)
                rest = np.flatnonzero(open_)
                now = np.zeros_like(open_)
                now[rest] = self._apply(k, kind, slot, case, rest)
                admits |= now & (kind == _WITNESS)
                self._settle("witness" if kind == _WITNESS else "certificate", now, open_)

    def _apply(self, k: int, kind: int, slot: int, case: _Case, rest: Index) -> Bools:
        """Boxes among these that one kept proof settles, shape (len(rest),)."""
        bounds, one = case.bounds.take(rest), (slice(k, k + 1), slice(slot, slot + 1))
        if kind == _WITNESS:
            open_ = np.ones((1, len(rest)), dtype=bool)
            hits = witnessed(
                self._point[one], self._excess[one], self._axes[k : k + 1], bounds, open_
            )
        else:
            low, high = case.low[rest][None], case.high[rest][None]
            hits = (
                least(self._rows[one], self._slope[one], self._constant[one], bounds, low, high)
                > 0.0
            )
        return np.asarray(hits[0, 0])

    def _solve(self, k: int, box: Envelope) -> DualBound:
        problem = self._problems[k]
        program = self._programs.get(McCormick, problem.layout)
        bounds = (program.dual_bound(problem, near) for near in _tries(box))
        return next(
            (bound for bound in bounds if not np.isnan(bound.margin)),
            DualBound(margin=float("nan")),
        )

    def _keep(self, k: int, bound: DualBound) -> tuple[int, int]:
        """Put what a solve proves in the place of what has not served for longest; returns its kind
        and place.
        """
        kind = _WITNESS if bound.margin <= FEASIBLE_MARGIN else _CERTIFICATE
        slot = int(np.argmin(self._used[kind][k]))
        self._used[kind][k, slot] = self._clock
        if kind == _WITNESS:
            self._point[k, slot], self._excess[k, slot] = bound.point, bound.excess
        else:
            self._rows[k, slot], self._slope[k, slot] = bound.rows, bound.slope
            self._constant[k, slot] = bound.constant
        return kind, slot

    def _credit(self, kind: int, which: Index, hits: Bools) -> Bools:
        """Note which of the kept proofs, shape (K, C, P), served; return where any did, shape (K,
        P).
        """
        used = self._used[kind][which]
        used[hits.any(axis=2)] = self._clock
        self._used[kind][which] = used
        return np.asarray(hits.any(axis=1))

    def _settle(self, how: str, now: Bools, open_: Bools) -> None:
        self._tally[how] += int(now.sum())
        open_ &= ~now

    def _overlap(self, which: Index, bounds: DualBounds) -> tuple[Array, Array]:
        """Bounds of [p, f] if the margin is at most BAND, shape (K, P, N, 6)."""
        low, high = (side[which][:, None] for side in self._range)
        return np.maximum(low, bounds.low - BAND), np.minimum(high, bounds.high + BAND)


class SpreadOracle:
    """A ``CachingOracle`` whose problems are shared out to an executor's workers: the same verdicts
    and counts.

    What is known of a problem travels with it, so neither depends on who is asked about which
    problem.
    """

    def __init__(self, problems: Sequence[Scaled], run: Executor) -> None:
        self._whole, self._run = CachingOracle(problems, Programs()), run

    @property
    def counts(self) -> VerdictCounts:
        """Counts of the ways in which all verdicts so far came about."""
        return self._whole.counts

    def is_feasible(self, which: Index, boxes: Sequence[Envelope]) -> Bools:
        """Decide whether P1 admits the problems of these numbers, each of them once, shape
        (len(boxes), len(which)).
        """
        parts = np.array_split(which, max(min(self._run.workers, len(which)), 1))
        tasks = [partial(_asked, self._whole.part(part), boxes) for part in parts]
        verdicts = []
        for part, (admitted, known) in zip(parts, gather(self._run, tasks), strict=True):
            self._whole.learn(part, known)
            verdicts.append(admitted)
        return np.concatenate(verdicts, axis=1)


def _asked(oracle: CachingOracle, boxes: Sequence[Envelope]) -> tuple[Bools, CachingOracle]:
    """Verdicts of an oracle on all of its problems, and the oracle with what it knows then."""
    return oracle.is_feasible(np.arange(len(oracle)), boxes), oracle


_KNOWN = (
    "_range",
    "_axes",
    "_trivial",
    "_point",
    "_excess",
    "_rows",
    "_slope",
    "_constant",
    "_used",
)
"""Arrays of a ``CachingOracle`` by problem, or pairs of such."""


def _taken(known: Any, which: Index) -> Any:
    return tuple(each[which] for each in known) if isinstance(known, tuple) else known[which]


def _put_back(known: Any, which: Index, learned: Any) -> None:
    for each, new in (
        zip(known, learned, strict=True) if isinstance(known, tuple) else ((known, learned),)
    ):
        each[which] = new


def _of_one_size(problems: Sequence[Scaled]) -> Sequence[Scaled]:
    """The problems.

    Raises InvalidInput unless there are any, all with as many contacts and vertices a patch, and
    none with a wrench on its body, of which witnesses and certificates that are kept know nothing.
    """
    if any(problem.layout.wrench for problem in problems):
        raise InvalidInput("problems: expected bodies that bear their weight alone, got a wrench")
    sizes = sorted({problem.size for problem in problems})
    if len(sizes) != 1:
        raise InvalidInput(
            f"problems: expected some, all of one size (contacts, vertices), got sizes {sizes}"
        )
    return problems


class _Case(NamedTuple):
    """The boxes of one question, and where [p, f] of one problem can be in them, shape (P, N,
    6).
    """

    boxes: Sequence[Envelope]
    bounds: DualBounds
    low: Array
    high: Array


def _tries(box: Envelope) -> Iterator[Envelope]:
    """The box, and the same to within BAND: a solver that gives up on one in a few thousand takes
    the next.
    """
    yield box
    yield from (box.widened(share * BAND) for share in (0.01, 0.02, 0.04))
