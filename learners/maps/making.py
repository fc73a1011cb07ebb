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
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.special import betaincinv

from stancekit.envs.distributions.cut import SMALLER, Places
from stancekit.envs.distributions.postures import (
    FORWARD,
    NominalStance,
    StandingRobot,
    plain_problem,
    triangle,
)
from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.answer.plan import Plan
from stancekit.planners.equilibrium.batch import LIMITS as ROOMS, PointBatch, ScaledBatch, slacks
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array, checked, checked_int
from stancekit.planners.problem import PostureBatch, Problem
from stancekit.planners.problem.standing_map import (
    FEASIBLE,
    INFEASIBLE,
    LIKELY,
    LIMITS,
    MOST_POSES,
    UNKNOWN,
    UNLIKELY,
    StandingMap,
)
from stancekit.planners.robot import Robot
from stancekit.planners.search.batch import decide_all
from stancekit.planners.search.exact import Exact
from stancekit.planners.terrain.footholds import Footholds
from stancekit.planners.verify.explanation import hindrances
from stancekit.planners.verify.margins import stance_margins

from ..surrogates.features import half_spaces

if TYPE_CHECKING:
    from ..surrogates.surrogate import Surrogate


_Index = NDArray[np.intp]
_BORNE = ("support_m", "push_n")
"""Margins of a feasible pose's witness."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Poses:
    """All poses of a grid.

    Arguments:
        places: of the terrain.
        stance: the robot's.
        like: a problem of the robot.
        corner_m, spacing_m, counts, headings_rad: the grid.
        chosen: per pose and limb the number of its place, shape (P, N).
        aside_m: how far each is from where its toe likes to be, from above, (P, N) [m].
        z_m: of the centre of mass, (P,) [m].
        most_aside_m: how far one may be.
        options: of the terrain's file and of footholds, other than the usual.
    """

    terrain: str
    robot: Robot
    places: Places
    stance: NominalStance
    like: Problem
    friction: float
    corner_m: Array
    spacing_m: float
    counts: tuple[int, int]
    headings_rad: Array
    chosen: NDArray[np.int32]
    aside_m: Array
    z_m: Array
    most_aside_m: float
    options: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        footholds: Footholds,
        robot: Robot | str | None,
        *,
        terrain: str,
        spacing_m: float,
        headings: int,
        friction: float,
        options: dict[str, Any] | None = None,
    ) -> Poses:
        """The poses over a terrain.

        Arguments:
            footholds: where its toes may stand.
            terrain: the terrain's name.

        Raises InvalidInput for a grid without cells or with too many, a terrain without places to
        stand, and numbers out of range.
        """
        checked(spacing_m, "spacing_m", above=0.0)
        checked_int(headings, "headings", least=1, most=3600)
        checked(friction, "friction", least=0.0)
        standing = StandingRobot.of(robot)
        legs = standing.robot.limb_names
        stance = standing.stance("ground", legs)
        places = Places.of_footholds(footholds, SMALLER * stance.circumradius_m[0])
        low, high = places.points_m[:, :2].min(axis=0), places.points_m[:, :2].max(axis=0)
        counts = np.floor((high - low) / spacing_m + 1e-9)
        if not (counts >= 1.0).all():
            raise InvalidInput(
                f"spacing_m: expected a grid of one cell or more over {high[0] - low[0]:.3g} × "
                f"{high[1] - low[1]:.3g} m "
                f"of footholds, got none with {spacing_m:g} m"
            )
        if float(np.prod(counts)) * headings > MOST_POSES:
            raise InvalidInput(
                f"spacing_m, headings: expected {MOST_POSES} poses or fewer, got "
                f"{float(np.prod(counts)) * headings:.3g}"
            )
        number = int(counts[0]), int(counts[1])
        corner = low + 0.5 * (high - low - spacing_m * (counts - 1.0))
        turns = 2.0 * np.pi * np.arange(headings) / headings
        chosen, aside, z = _snapped(places, stance, corner, spacing_m, number, turns)
        return cls(
            terrain=terrain,
            robot=standing.robot,
            places=places,
            stance=stance,
            like=plain_problem(standing.robot, legs, stance, shear=FORWARD),
            friction=float(friction),
            corner_m=corner,
            spacing_m=float(spacing_m),
            counts=number,
            headings_rad=turns,
            chosen=chosen,
            aside_m=aside,
            z_m=z,
            most_aside_m=float(np.abs(stance.room_m[:, :2]).min()),
            options=dict(options or {}),
        )

    def __len__(self) -> int:
        return len(self.z_m)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Places along x and y, and headings."""
        return *self.counts, len(self.headings_rad)

    @property
    def off(self) -> NDArray[np.bool_]:
        """Poses that lack a foothold, shape (P,)."""
        return np.asarray((self.aside_m > self.most_aside_m).any(axis=1))

    def batch(self, which: _Index) -> PostureBatch:
        """Problems of some poses, by number, in the body's axes."""
        i, j, k = np.unravel_index(which, self.shape)
        body = np.column_stack(
            [self.corner_m + self.spacing_m * np.column_stack([i, j]), self.z_m[which]]
        )
        axes = _axes(self.headings_rad[k])
        chosen = self.chosen[which]
        normals = self.places.normals[chosen] @ axes
        centres = (self.places.points_m[chosen] - body[:, None]) @ axes
        normals /= np.linalg.norm(normals, axis=-1)[..., None]
        radius = np.minimum(self.stance.circumradius_m[1], self.places.free_m[chosen])
        corners = centres[:, :, None] + triangle(normals, radius, np.zeros_like(radius))
        return PostureBatch(
            like=self.like,
            vertices_m=corners,
            normals=normals,
            friction=np.full(chosen.shape, self.friction),
            convex=True,
        )


def _axes(turns: Array) -> Array:
    """Axes of a body that faces so, its columns in the world, shape (K, 3, 3)."""
    c, s, zero, one = np.cos(turns), np.sin(turns), np.zeros_like(turns), np.ones_like(turns)
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, one]]
    return np.moveaxis(np.array(rows), -1, 0)


def _snapped(
    places: Places,
    stance: NominalStance,
    corner: Array,
    spacing: float,
    counts: tuple[int, int],
    turns: Array,
) -> tuple[NDArray[np.int32], Array, Array]:
    """Place of every toe, how far aside it is, and the height of the centre of mass."""
    tree = KDTree(places.points_m[:, :2])
    toes = stance.centre_m @ _axes(turns).swapaxes(1, 2)  # (H, N, 3)
    chosen, aside, z = [], [], []
    lines = spacing * np.arange(counts[1])
    for i in range(counts[0]):
        body = corner + np.column_stack([np.full(counts[1], spacing * i), lines])
        at = body[:, None, None] + toes[None, :, :, :2]
        gap, number = map(np.asarray, tree.query(at.reshape(-1, 2)))
        shape = (-1, len(stance.centre_m))
        chosen.append(number.reshape(shape).astype(np.int32))
        aside.append(gap.reshape(shape))
        z.append(places.points_m[number, 2].reshape(shape).mean(axis=1))
    down = float(stance.centre_m[:, 2].mean())
    return np.concatenate(chosen), np.concatenate(aside), np.concatenate(z) - down


BLOCK = 512
"""Poses that are proved together."""
NODES = 200
"""Nodes of the search for one pose; one that wants more stays unknown."""
_SAVED_S = 20.0
"""A map that is being made is written so often [s]."""
CALIBRATION = 3000
"""Poses to calibrate likely answers on, at most."""
_LEARNED = 20_000
"""Proved poses to learn from, at most."""
SHARE_OF_FIT = 0.5
"""Share of the time in which poses are proved before anything is learned."""
_CONFIDENCE = 0.95
_SAME_M = 1e-4
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
        names = ("margin", *_BORNE)
        self.margins = {name: np.full(len(poses), np.nan, dtype=np.float32) for name in names}
        self._tried = np.zeros(len(poses), dtype=bool)
        self._exact = Exact(max_nodes=NODES, time_limit_s=math.inf)
        self._half_spaces = half_spaces(poses.like)
        off = poses.off
        self._set(np.flatnonzero(off), INFEASIBLE, "foothold", -1.0)

    def _set(self, which: _Index, verdict: int, limit: str, margin: float | Array) -> None:
        self.verdict[which] = verdict
        self.limit[which] = LIMITS.index(limit)
        self.margins["margin"][which] = margin
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
        for name, values in self.margins.items():
            values[proved] = getattr(earlier, name).ravel()[proved]
        self._tried |= proved

    @property
    def open(self) -> _Index:
        """Numbers of the poses not tried yet."""
        return np.flatnonzero(~self._tried)

    def coarse_to_fine(self) -> _Index:
        """Numbers of the open poses, those of the coarsest grid first."""
        left = self.open
        i, j, k = np.unravel_index(left, self.poses.shape)
        level = np.min([_level(i), _level(j), _level(k)], axis=0)
        return np.asarray(left[np.argsort(-level, kind="stable")])

    def prove(self, which: _Index) -> None:
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
            plans = [plan for k in feasible if (plan := answers[k].solution) is not None]
            for name, values in stance_margins(plans, _BORNE, unknown=np.nan).items():
                self.margins[name][which[np.array(feasible)]] = values
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
        margins: dict[str, Any] = {
            name: values.reshape(shape).copy() for name, values in self.margins.items()
        }
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
            **margins,
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
            earlier.z_m, mine.z_m, rtol=0.0, atol=_SAME_M, equal_nan=True
        ):
            other = ["height of the body"]
        if other:
            raise InvalidInput(
                f"{checkpoint}: expected a map of the same question to go on from, got one of "
                "another "
                f"{', '.join(other)}"
            )
        maker.take(earlier)

    def go(which: _Index, until: float, stage: str) -> int:
        """Prove poses in this order until a time; how many."""
        saved = time.monotonic()
        done = 0
        while done < len(which) and time.monotonic() < until:
            maker.prove(np.sort(which[done : done + BLOCK]))
            done += len(which[done : done + BLOCK])
            if progress is not None:
                progress(int((maker.verdict != UNKNOWN).sum()), len(poses), stage)
            if checkpoint is not None and time.monotonic() - saved > _SAVED_S:
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
    from ..surrogates.surrogate import FARTHEST, LabelledBatch, SurrogateSettings, fit_rows

    proved = np.flatnonzero(
        (maker.verdict == FEASIBLE)
        | ((maker.verdict == INFEASIBLE) & (maker.limit != LIMITS.index("foothold")))
    )
    learned = np.sort(rng.permutation(proved)[:_LEARNED])
    kinds = np.where(maker.verdict[learned] == FEASIBLE, "feasible", "infeasible")
    if len(set(kinds.tolist())) < 2:
        return None
    rows = LabelledBatch(
        batch=maker.poses.batch(learned),
        kinds=kinds,
        margins=np.clip(maker.margins["margin"][learned].astype(float), -FARTHEST, FARTHEST),
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
    go: Callable[[_Index, float, str], int],
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
        maker.margins["margin"][left[those]] = np.clip(margins[those], -CLIPPED, CLIPPED)
    seconds["calling"] = time.monotonic() - began
    card = {
        "surrogate": surrogate.digest,
        "learned_from": surrogate.provenance.get("learned_from", {}),
        "calibrated_on": {
            "feasible": int((maker.verdict[known] == FEASIBLE).sum()),
            "infeasible": int((maker.verdict[known] == INFEASIBLE).sum()),
            "undecided": lost,
        },
        "limits": [value if math.isfinite(value) else None for value in limits],
    }
    return maker.map(seconds, error=settings.error, confidence=_CONFIDENCE, card=card)


def _limits(
    scores: Array, feasible: NDArray[np.bool_], error: float, lost: int
) -> tuple[float, float]:
    """(low, high) of the score: of poses below low at most ``error`` are feasible, of poses above
    high at most ``error`` infeasible, each at half of the doubt.

    Arguments:
        lost: poses of the draw left undecided, which count as wrong.
    """
    high = _least(scores, ~feasible, error, lost)
    low = -_least(-scores, feasible, error, lost)
    return low, high


def _least(scores: Array, wrong: NDArray[np.bool_], error: float, lost: int) -> float:
    """The least limit of the score above which wrong answers are rare enough; inf for none."""
    doubt = 0.5 * (1.0 - _CONFIDENCE)
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


def _level(index: _Index) -> NDArray[np.int_]:
    """Number of times that a number can be halved, up to 6 times: the coarser the grid that it is of."""
    level = np.zeros(len(index), dtype=int)
    for power in range(1, 7):
        level[index % (1 << power) == 0] = power
    return level
