"""A map of where a robot can stand, made within a time: poses proved from coarse to fine, and the
rest, where that is wanted, called likely at an error that was measured on this very map.

The rest is calibrated on poses that are drawn from it by chance and proved: the others are then
exchangeable with them, and stay so, since those that are proved later are drawn by chance, too.
Limits of the score are looked at from the strictest one on, and the last
counts up to which the share of wrong answers, by the upper end of its interval, is within the error
(Learn then Test, fixed sequence: Angelopoulos et al., 2021).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.batch import PointBatch, ScaledBatch
from stancekit.planners.equilibrium.slacks import LIMITS as ROOMS
from stancekit.planners.equilibrium.slacks import slacks
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem.standing_map import (
    FEASIBLE,
    INFEASIBLE,
    LIKELY,
    LIMITS,
    UNKNOWN,
    UNLIKELY,
    StandingMap,
)
from stancekit.planners.search.batch import decide_all
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.verify.hindrance import hindrances

from .poses import Index, Poses

if TYPE_CHECKING:
    from ..surrogates.surrogate import Surrogate

BLOCK = 512
"""Poses that are proved together."""
NODES = 200
"""Nodes of the search for one pose; one that wants more stays unknown."""
SAVED_S = 20.0
"""A map that is being made is written so often [s]."""
CALIBRATION = 3000
"""Poses to calibrate likely answers on, at most."""
LEARNED = 20_000
"""Proved poses to learn from, at most."""
SHARE_OF_FIT = 0.5
"""Share of the time in which poses are proved before anything is learned."""
CONFIDENCE = 0.95
SAME_M = 1e-4
"""Bodies of one question are as high in both maps [m]."""
Progress = Callable[[int, int, str], object]


@dataclass(frozen=True, kw_only=True)
class MapSettings:
    """Settings of making a map.

    Arguments:
        time_limit_s: for all of it [s].
        fit: learn what is likely of poses that were not reached.
        error: of likely answers.
        seed: of the poses to calibrate on.
        epochs: of learning.
    """

    time_limit_s: float = 60.0
    fit: bool = False
    error: float = 0.005
    seed: int = 0
    epochs: int = 12


class Maker:
    """A map that is being made: arrays by the number of the pose."""

    def __init__(self, poses: Poses) -> None:
        self.poses = poses
        self.verdict = np.full(len(poses), UNKNOWN, dtype=np.uint8)
        self.limit = np.zeros(len(poses), dtype=np.uint8)
        self.margin = np.full(len(poses), np.nan, dtype=np.float32)
        self._tried = np.zeros(len(poses), dtype=bool)
        self._exact = ExactPlanner(max_nodes=NODES, time_limit_s=math.inf)
        none = np.zeros((0, 3)), np.zeros(0)
        self._half_spaces = [
            none
            if contact.reach_rows is None
            else (
                contact.reach_rows.normals,
                contact.reach_rows.bounds_m / poses.like.length_scale_m,
            )
            for contact in poses.like.contacts
        ]
        off = poses.off
        self._set(np.flatnonzero(off), INFEASIBLE, "foothold", -1.0)

    def _set(self, which: Index, verdict: int, limit: str, margin: float | Array) -> None:
        self.verdict[which] = verdict
        self.limit[which] = LIMITS.index(limit)
        self.margin[which] = margin
        self._tried[which] = True

    def take(self, earlier: StandingMap) -> None:
        """Go on from a map of the same question: what it proves, but for footholds, which are known
        here.
        """
        verdict = earlier.verdict.ravel()
        proved = (verdict == FEASIBLE) | (verdict == INFEASIBLE)
        proved &= ~self.poses.off & (earlier.limit.ravel() != LIMITS.index("foothold"))
        self.verdict[proved] = verdict[proved]
        self.limit[proved] = earlier.limit.ravel()[proved]
        self.margin[proved] = earlier.margin.ravel()[proved]
        self._tried |= proved

    @property
    def open(self) -> Index:
        """Numbers of the poses that nobody has tried to prove."""
        return np.flatnonzero(~self._tried)

    def coarse_to_fine(self) -> Index:
        """Numbers of the open poses, those of the coarsest grid first."""
        left = self.open
        i, j, k = np.unravel_index(left, self.poses.shape)
        level = np.min([_level(i), _level(j), _level(k)], axis=0)
        return np.asarray(left[np.argsort(-level, kind="stable")])

    def prove(self, which: Index) -> None:
        """Decide poses exactly; one that meets a limit of the search stays unknown."""
        batch = self.poses.batch(which)
        answers = decide_all(self._exact, batch).outcomes
        self._tried[which] = True
        feasible = [k for k, each in enumerate(answers) if each.status is Status.FEASIBLE]
        refuted = [k for k, each in enumerate(answers) if each.status is Status.INFEASIBLE]
        if feasible:
            room = self._rooms(ScaledBatch.of(batch.select(np.array(feasible))), answers, feasible)
            nearest = room.argmin(axis=1)
            for number, name in enumerate(ROOMS):
                mine = nearest == number
                self._set(which[np.array(feasible)[mine]], FEASIBLE, name, room.min(axis=1)[mine])
        proofs = [answers[k].certificate for k in refuted]
        names = hindrances([proof for proof in proofs if proof is not None])
        for k, name in zip(refuted, names, strict=True):
            bound = answers[k].bound
            margin = -1.0 if not math.isfinite(bound) else -min(bound, 1.0)
            self._set(which[k : k + 1], INFEASIBLE, name, margin)

    def _rooms(self, scaled: ScaledBatch, answers: list[Answer[Plan]], found: list[int]) -> Array:
        """Room that each witness has, shape (K, len(ROOMS))."""
        plans = [plan for k in found if (plan := answers[k].solution) is not None]
        one = scaled.like
        pairs = scaled.pairs(plans)
        com = np.array([plan.com_m[0] for plan in plans]) / one.length_m
        points = PointBatch(
            com=com,
            rotation=np.array([plan.rotation_rad[0] for plan in plans]),
            toes=pairs[..., :3] + com[:, None],
            forces=pairs[..., 3:],
        )
        return slacks(scaled, points, self._half_spaces)

    def map(self, seconds: dict[str, float], **more: Any) -> StandingMap:
        """The map as it is now."""
        poses, shape = self.poses, self.poses.shape
        return StandingMap(
            terrain=poses.terrain,
            robot=poses.robot.name,
            identity=poses.robot.identity,
            friction=poses.friction,
            corner_m=poses.corner_m,
            spacing_m=poses.spacing_m,
            headings_rad=poses.headings_rad,
            verdict=self.verdict.reshape(shape).copy(),
            limit=self.limit.reshape(shape).copy(),
            margin=self.margin.reshape(shape).copy(),
            z_m=poses.z_m.reshape(shape).astype(np.float32),
            aside_m=poses.most_aside_m,
            options=poses.options,
            seconds=seconds,
            **more,
        )


def make_map(
    poses: Poses,
    settings: MapSettings,
    progress: Progress | None = None,
    *,
    began_s: float | None = None,
    checkpoint: Path | None = None,
    surrogate: Surrogate | None = None,
) -> StandingMap:
    """Make the map of these poses within the time.

    Arguments:
        progress: called with poses that are settled, all, and what is being done.
        began_s: of ``time.monotonic``, from when on the time counts; now where None.
        checkpoint: file .npz from which a map of the same question goes on, and to which it is
            written now and then.
        surrogate: of the robot's class, in the place of one that is learned here; it is calibrated
            on this map all the same.

    Raises:
        InvalidInput: for a checkpoint of another map, and a surrogate of other problems.
    """
    if surrogate is not None:
        surrogate.check_fits(poses.like)
    likely = settings.fit or surrogate is not None
    began = time.monotonic() if began_s is None else began_s
    end, maker = began + settings.time_limit_s, Maker(poses)
    seconds = {"poses": time.monotonic() - began}
    if checkpoint is not None and checkpoint.exists():
        earlier = StandingMap.read(checkpoint)
        mine = maker.map({})
        other = [name for name, value in mine.question.items() if earlier.question[name] != value]
        if not other and not np.allclose(
            earlier.z_m, mine.z_m, rtol=0.0, atol=SAME_M, equal_nan=True
        ):
            other = ["height of the body"]
        if other:
            raise InvalidInput(
                f"{checkpoint}: expected a map of the same question to go on from, got one of "
                "another "
                f"{', '.join(other)}"
            )
        maker.take(earlier)

    def go(which: Index, until: float, stage: str) -> int:
        """Prove poses in this order until a time; how many."""
        saved = time.monotonic()
        done = 0
        while done < len(which) and time.monotonic() < until:
            maker.prove(np.sort(which[done : done + BLOCK]))
            done += len(which[done : done + BLOCK])
            if progress is not None:
                progress(int((maker.verdict != UNKNOWN).sum()), len(poses), stage)
            if checkpoint is not None and time.monotonic() - saved > SAVED_S:
                saved = time.monotonic()
                maker.map(seconds).save(checkpoint)
        if checkpoint is not None:
            maker.map(seconds).save(checkpoint)
        return done

    started = time.monotonic()
    until = end if not likely else started + SHARE_OF_FIT * max(end - started, 0.0)
    go(maker.coarse_to_fine(), until, "proving")
    seconds["proving"] = time.monotonic() - started
    if not likely or not len(maker.open):
        return maker.map(seconds)
    rng, began = np.random.default_rng(settings.seed), time.monotonic()
    if surrogate is None:
        surrogate = _learned(maker, settings, rng)
        if surrogate is None:
            go(maker.coarse_to_fine(), end, "proving")
            seconds["proving"] += time.monotonic() - began
            return maker.map(seconds)
        seconds["fit"] = time.monotonic() - began
    return _with_likely(maker, settings, surrogate, rng, go, seconds, end)


def _learned(maker: Maker, settings: MapSettings, rng: np.random.Generator) -> Surrogate | None:
    """Surrogate learned from proved poses; None where all of them have one answer."""
    from ..surrogates.rows import FARTHEST, LabelledBatch
    from ..surrogates.training import SurrogateSettings, fit_rows

    proved = np.flatnonzero(
        (maker.verdict == FEASIBLE)
        | ((maker.verdict == INFEASIBLE) & (maker.limit != LIMITS.index("foothold")))
    )
    learned = np.sort(rng.permutation(proved)[:LEARNED])
    kinds = np.where(maker.verdict[learned] == FEASIBLE, "feasible", "infeasible")
    if len(set(kinds.tolist())) < 2:
        return None
    rows = LabelledBatch(
        batch=maker.poses.batch(learned),
        kinds=kinds,
        margins=np.clip(maker.margin[learned].astype(float), -FARTHEST, FARTHEST),
    )
    return fit_rows(
        rows,
        SurrogateSettings(
            width=48, layers=1, epochs=settings.epochs, calibration=0.02, seed=settings.seed
        ),
        problem_class=maker.poses.terrain,
        origin={"map": maker.poses.terrain},
    )


def _with_likely(
    maker: Maker,
    settings: MapSettings,
    surrogate: Surrogate,
    rng: np.random.Generator,
    go: Callable[[Index, float, str], int],
    seconds: dict[str, float],
    end: float,
) -> StandingMap:
    """Calibrate a surrogate on a draw of the rest, and call what is left likely."""
    from ..surrogates.surrogate import CLIPPED

    began = time.monotonic()
    sample = rng.permutation(maker.open)[:CALIBRATION]
    go(sample, math.inf, "calibrating")  # all of them, or they are no draw by chance
    seconds["calibration"] = time.monotonic() - began
    began = time.monotonic()
    known = sample[maker.verdict[sample] != UNKNOWN]
    lost = len(sample) - len(known)
    limits = _limits(
        surrogate.scores(maker.poses.batch(known))[0],
        maker.verdict[known] == FEASIBLE,
        settings.error,
        lost,
    )
    go(rng.permutation(maker.open), end, "proving")  # by chance: what is left stays like the draw
    seconds["proving"] += time.monotonic() - began
    began = time.monotonic()
    left = maker.open
    scores, margins = surrogate.scores(maker.poses.batch(left)) if len(left) else (np.zeros(0),) * 2
    for verdict, those in ((LIKELY, scores > limits[1]), (UNLIKELY, scores < limits[0])):
        maker.verdict[left[those]] = verdict
        maker.margin[left[those]] = np.clip(margins[those], -CLIPPED, CLIPPED)
    seconds["calling"] = time.monotonic() - began
    card = {
        "surrogate": surrogate.digest,
        "learned_from": surrogate.provenance.get("learned_from", {}),
        "calibrated_on": {
            "feasible": int((maker.verdict[known] == FEASIBLE).sum()),
            "infeasible": int((maker.verdict[known] == INFEASIBLE).sum()),
            "undecided": lost,
        },
        "limits": [_or_none(value) for value in limits],
    }
    return maker.map(seconds, error=settings.error, confidence=CONFIDENCE, card=card)


def _limits(
    scores: Array, feasible: NDArray[np.bool_], error: float, lost: int
) -> tuple[float, float]:
    """(low, high) of the score: of poses below low at most ``error`` are feasible, of poses above
    high at most ``error`` infeasible, each at half of the doubt.

    Arguments:
        lost: poses of the draw that nobody could decide, which count as wrong.
    """
    high = _least(scores, ~feasible, error, lost)
    low = -_least(-scores, feasible, error, lost)
    return low, high


def _least(scores: Array, wrong: NDArray[np.bool_], error: float, lost: int) -> float:
    """The least limit of the score above which wrong answers are rare enough; inf for none."""
    doubt = 0.5 * (1.0 - CONFIDENCE)
    order = np.argsort(-scores, kind="stable")
    sorted_scores, mistakes = scores[order], np.cumsum(wrong[order]) + lost
    count = first = max(math.ceil(math.log(doubt) / math.log1p(-error)), 1)
    best = math.inf
    step = max(first // 8, 1)
    while count <= len(scores):
        k, n = int(mistakes[count - 1]), count + lost
        upper = 1.0 if k >= n else float(betaincinv(k + 1, n - k, 1.0 - doubt))
        if upper > error:
            break
        best = float(sorted_scores[count - 1])
        count += step
    return best if math.isinf(best) else float(np.nextafter(best, -np.inf))


def _level(index: Index) -> NDArray[np.int_]:
    """Number of times that a number can be halved, up to 6 times: the coarser the grid that it is of."""
    level = np.zeros(len(index), dtype=int)
    for power in range(1, 7):
        level[index % (1 << power) == 0] = power
    return level


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
