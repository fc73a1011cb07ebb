"""``stancekit/WarpedGait-v0``: choose how to solve a walk over a height field; the verifier judges
what comes of it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from stancekit.planners.arguments import check_argument, settings_from
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.files.arrays import Array, archive_of, read_archive
from stancekit.planners.files.documents import typed
from stancekit.planners.files.writing import first_difference, write_bytes
from stancekit.planners.gait.charts import CHARTS
from stancekit.planners.gait.method.attempt import Attempt, Attempted, Workbench
from stancekit.planners.gait.settings import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.model import Robot
from stancekit.planners.robot.walker import anymal, walker_from

from .distributions.courses import SampledTasks, Tasks
from .episodes import Finite, Step, TaskEnv, boxes, checked_action, flat, weighted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stancekit.planners.answer.report import Report
    from stancekit.planners.answer.trajectory import Trajectory

HEIGHTS = ((1.0,), (0.5, 1.0), (0.25, 0.5, 0.75, 1.0))
"""Homotopies to choose from: factors on the terrain's heights."""
NOISES = (0.0, 0.01, 0.02)
"""Initial guesses to choose from: what is added to the terrain-following one [m, rad, m·g]."""
FORMAT = "stancekit/walk-pool/1"
_LARGEST = 1e6
_MOST_WALKS = 100_000
_Action = tuple[int, ...]
"""Indices of a chart, a homotopy and a noise."""


_FIGURES = (
    "force_rms",
    "moment_rms",
    "peak_acceleration_g",
    "outside_cone",
    "footing_friction",
)


class _Outcome(NamedTuple):
    """Outcome of an attempt, all numbers finite: the verifier's word and figures, and the
    solver's.
    """

    verified: float = 0.0
    feasible: float = 0.0
    iterations: float = 0.0
    violation: float = 0.0
    refused: float = 0.0
    force_rms: float = 0.0
    moment_rms: float = 0.0
    peak_acceleration_g: float = 0.0
    outside_cone: float = 0.0
    footing_friction: float = 0.0
    seconds: float = 0.0

    @classmethod
    def of(cls, found: Attempted | None, limit: int) -> Self:
        """The numbers of an attempt; of None, where a terrain has no map, the limit of iterations
        was taken.
        """
        if found is None:
            return cls(iterations=limit, violation=_LARGEST)
        return cls(
            verified=float(found.verified),
            feasible=float(found.solution.success),
            iterations=float(found.iterations),
            violation=_number(found.solution.violation),
            refused=float(len(found.report.refused)),
            seconds=found.seconds,
            **{name: _number(found.report.figures.get(name, 0.0)) for name in _FIGURES},
        )


class _Solver:
    """Solves walks as actions say; what is written down for one serves it again, and the kernels of
    all walks that are alike are kept.
    """

    def __init__(self, charts: tuple[str, ...], settings: GaitSettings) -> None:
        self._charts, self._settings, self._programs = charts, settings, Programs()
        self._bench: Workbench | None = None

    def bench(self, walk: Walk) -> Workbench:
        """Workbench of a walk, that of the last one where it is the same."""
        if self._bench is None or self._bench.task is not walk:
            self._bench = Workbench(walk, self._settings, kept=self._programs)
        return self._bench

    def solve(self, walk: Walk, action: _Action, seed: int) -> tuple[Attempted | None, _Outcome]:
        """Result of an attempt, None where the terrain has no map, and its outcome."""
        chart, heights, noise = action
        attempt = Attempt(
            chart=self._charts[chart], heights=HEIGHTS[heights], noise=NOISES[noise], seed=seed
        )
        try:
            found = self.bench(walk).run(attempt)
        except PlanningFailed:
            found = None
        return found, _Outcome.of(found, self._settings.max_iterations * len(attempt.heights))


class _WalkPool:
    """Pool of walks, and the outcomes of attempts at them.

    Arguments:
        tasks: function that draws a walk from a generator.
        size: number of walks.
        charts: coordinates to choose from.
        settings: settings of the optimiser.
        seed: seed of the walks, and of the guesses with noise.

    Raises:
        InvalidInput: for no walk, or too many.
    """

    def __init__(
        self,
        tasks: Tasks,
        size: int,
        charts: tuple[str, ...],
        settings: GaitSettings,
        seed: int = 0,
    ) -> None:
        if not 1 <= size <= _MOST_WALKS:
            raise InvalidInput(f"pool: expected 1 to {_MOST_WALKS} walks, got {size}")
        self.tasks, self.size, self.seed = tasks, size, seed
        self.charts, self.settings = charts, settings
        self._walks: dict[int, Walk] = {}
        self._table = np.full(
            (size, len(charts), len(HEIGHTS), len(NOISES), len(_Outcome._fields)), np.nan
        )
        self._solver = _Solver(charts, settings)

    def __len__(self) -> int:
        return self.size

    @property
    def solved(self) -> int:
        """Number of attempts that have an outcome."""
        return int(np.isfinite(self._table[..., 0]).sum())

    def walk(self, index: int) -> Walk:
        """A walk by its number; it is drawn once."""
        if index not in self._walks:
            self._walks[index] = self.tasks(np.random.default_rng([self.seed, index]))
        return self._walks[index]

    def outcome(self, index: int, action: _Action) -> _Outcome:
        """Outcome of an attempt at a walk; solved, unless it was before."""
        row = self._table[(index, *action)]
        if np.isnan(row[0]):
            row[:] = self._solver.solve(self.walk(index), action, index)[1]
        return _Outcome(*row.tolist())

    def solve(self, progress: Callable[[int, int], None] = lambda done, total: None) -> None:
        """Solve every attempt that has no outcome.

        Arguments:
            progress: called with how many have one, and all.
        """
        total = int(np.prod(self._table.shape[:-1]))
        for index in range(self.size):
            for action in product(*map(range, self._table.shape[1:4])):
                self.outcome(index, action)
                progress(self.solved, total)

    def write(self, path: str | Path) -> None:
        """Write the outcomes, and what the walks are drawn from, to an .npz file."""
        header = json.dumps(self._header())
        write_bytes(path, archive_of({"header": header, "outcomes": self._table}))

    @classmethod
    def read(
        cls, path: str | Path, tasks: Tasks, charts: tuple[str, ...], settings: GaitSettings
    ) -> Self:
        """A pool of these tasks, charts and settings from the file that ``write`` made.

        Raises InvalidInput for another file, and for a pool of other walks, charts or settings.
        """
        arrays = read_archive(path)
        try:
            header = json.loads(str(arrays["header"]))
            table, size, seed = arrays["outcomes"], int(header["size"]), int(header["seed"])
        except (KeyError, ValueError, TypeError):
            raise InvalidInput(f"{path}: expected a pool of walks, got another file") from None
        pool = cls(tasks, size, charts, settings, seed)
        if other := first_difference(header, pool._header()):
            raise InvalidInput(
                f"{path}: expected a pool of the environment's walks, charts and settings: {other}"
            )
        if table.shape != pool._table.shape:
            raise InvalidInput(
                f"{path}: expected outcomes of shape {pool._table.shape}, got {table.shape}"
            )
        pool._table = np.array(table, dtype=np.float64)
        return pool

    def _header(self) -> dict[str, Any]:
        """Origin of the outcomes, JSON-ready."""
        tasks = self.tasks
        if isinstance(tasks, SampledTasks):
            task = {
                name: getattr(tasks, name)
                for name in ("terrain", "difficulty", "distance_m", "duration_s")
            } | {
                "robot": hashlib.sha256(
                    json.dumps(tasks.robot.to_json(), sort_keys=True).encode()
                ).hexdigest()
            }
        else:
            task = {
                "drawn_by": f"{tasks.__module__}:{getattr(tasks, '__qualname__', type(tasks).__qualname__)}"
            }
        first = self.walk(0)
        ends = np.concatenate([first.start, first.goal, first.terrain.height(_PLACES).ravel()])
        content = {
            "format": FORMAT,
            "size": self.size,
            "seed": self.seed,
            "charts": ", ".join(self.charts),
            "heights": HEIGHTS,
            "noises": NOISES,
            "settings": asdict(self.settings),
            "tasks": task,
            "first": ends.round(9).tolist(),
        }
        known: dict[str, Any] = json.loads(json.dumps(content))
        return known


_PLACES: NDArray[np.float64] = np.stack(
    np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"), axis=-1
)


def _number(value: float | Array) -> float:
    """A finite number."""
    return float(np.clip(np.nan_to_num(value, nan=_LARGEST), 0.0, _LARGEST))


PATCH, PATCH_M = 24, 4.0
"""Heights along a side of the observed square, and its side [m]."""
_ROOM = 4.0  # bound on lengths in an observation [m]

_OPTIMISER = GaitSettings(max_iterations=50)
"""Settings of the optimiser where none are given."""


@dataclass(frozen=True, kw_only=True)
class GaitRewardWeights(Finite):
    """Weights of the reward of a step: verified · [the verifier accepts] + feasible · [the solve
    succeeds] − iterations · [share of the limit that was taken] − seconds · [CPU seconds], the last
    only with ``timing``.
    """

    verified: float = 1.0
    feasible: float = 0.25
    iterations: float = 0.25
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class GaitEnvSettings:
    """Keywords of ``WarpedGaitEnv`` beside its terrain; its page has their meaning.

    Raises InvalidInput for what does not go together.
    """

    robot: Robot | str | Path | None = None
    tasks: Tasks | None = None
    charts: Sequence[str] | None = None
    settings: GaitSettings | Mapping[str, Any] = _OPTIMISER
    weights: GaitRewardWeights | Mapping[str, float] = GaitRewardWeights()
    timing: bool = False
    pool: int | str | Path | None = None

    def __post_init__(self) -> None:
        if self.charts is not None and not self.charts:
            raise InvalidInput(
                f"charts: expected some of {', '.join(CHARTS.names())}, got {list(self.charts)}"
            )
        for chart in self.charts or ():
            CHARTS.get(chart)
        if self.robot is not None and self.tasks is not None:
            raise InvalidInput("robot: expected none where tasks are given, which have their own")
        seconds = weighted(self.weights, GaitRewardWeights)[0].seconds
        if seconds and not self.timing:
            raise InvalidInput(
                f"weights: expected timing with seconds, whose weight is {seconds:g}"
            )

    @property
    def optimiser(self) -> GaitSettings:
        """The optimiser's settings, likewise; keys that a mapping lacks are as in the environment's
        own.
        """
        settings = self.settings
        if isinstance(settings, GaitSettings):
            return settings
        return typed(
            GaitSettings, {"max_iterations": _OPTIMISER.max_iterations, **settings}, "settings"
        )


class WarpedGaitEnv(TaskEnv[Walk]):
    """Choose how to optimise a walk over a height field; the verifier judges the result.

    ## Description

    One walk per episode (Pan et al.): a height field with a start and a goal. The agent chooses the
    coordinates to optimise in, a homotopy and an initial guess; the optimiser solves the program,
    and the verifier checks the walk, also between the knots.

    ## Observation Space

    A ``Dict`` of flat float32 ``Box``es, in a frame whose origin is half-way from start to goal on
    the terrain and whose x points to the goal; E feet:

    | name | shape | meaning |
    |---|---|---|
    | heights | (24 * 24,) | the terrain over a square of 4 m, row by row along x [m] |
    | start | (2,) | place (x, y) [m] |
    | goal | (2,) | place (x, y) [m] |
    | facing | (2,) | cosine and sine of the robot's heading |
    | friction | (1,) | ν |
    | adhesive | (E,) | 1 for feet that stick |

    ## Action Space

    ``MultiDiscrete``: indices into ``charts``, ``HEIGHTS`` (homotopies) and ``NOISES`` (guesses). A
    chart that comes with a map has no homotopy in height and ignores that choice.

    ## Reward

    verified · [the verifier accepts] + feasible · [the solve succeeds] − iterations · (share of the
    limit that was taken) − seconds · (CPU seconds, with ``timing`` only), with the weights of
    ``GaitRewardWeights``.

    ## Starting State

    A walk of ``tasks``, or ``SampledTasks(terrain)``; all have the same number of feet.

    A solve takes a second or more. With ``pool=16`` an episode is one of 16 walks; each attempt at
    a walk is solved when it is first chosen, and looked up after that. The same action on the same
    walk always has the same outcome. ``env.unwrapped.pool.solve()`` solves all attempts,
    ``.write("walks.npz")`` keeps them, and ``pool="walks.npz"`` with the same other arguments goes
    on from that file: a step then takes less than a tenth of a millisecond.

    ## Episode End

    Terminated after one step; never truncated.

    ## Info

    After a reset (all 0) and a step (numeric, fixed shapes): ``verified``, ``is_success`` (the
    same), ``feasible``, ``iterations``, ``violation``, the verifier's figures ``force_rms``,
    ``moment_rms``, ``peak_acceleration_g``, ``outside_cone``, ``footing_friction``, ``refused``
    (how many of its groups), ``reward_<term>``, and ``seconds``, which stays 0 unless ``timing``.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | terrain | 'mixed' | a family, "any" of them, "mixed" smooth ones, a name of `TERRAINS`, or "FILE.py:NAME" |
    | robot | None | a built-in name, a URDF, a YAML file, or a ``Robot``; `anymal-boxes` where None |
    | tasks | None | a function that draws a walk from a generator, in place of ``terrain`` and ``robot`` |
    | charts | None | coordinates to choose from, all of `planners.gait.charts.CHARTS` if None, or "FILE.py:NAME" |
    | settings | GaitSettings(max_iterations=50) | settings of the optimiser, with the limit of every stage; or a mapping |
    | weights | GaitRewardWeights() | weights of the reward; or a mapping with some of its keys, and terms of your own |
    | timing | False | put CPU seconds into ``info`` and the reward |
    | pool | None | number of walks to draw from, each attempt solved once; or the file of such a pool |
    | render_mode | None | "rgb_array" |

    ## Version History

    - v0: the first version
    """

    def __init__(
        self,
        terrain: str = "mixed",
        *,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        super().__init__(render_mode)
        check_argument("terrain", terrain, str)
        settings = settings_from(GaitEnvSettings, options, beside=("terrain", "render_mode"))
        charts = CHARTS.names() if settings.charts is None else tuple(settings.charts)
        robot = settings.robot or anymal()
        walker = walker_from(robot)
        self._tasks: Tasks = settings.tasks or SampledTasks(terrain=terrain, robot=walker)
        self._settings = settings.optimiser
        self._solver = _Solver(charts, self._settings)
        self._weights, self._terms = weighted(settings.weights, GaitRewardWeights)
        self._timing = bool(settings.timing)
        tasks = self._tasks
        like = tasks if isinstance(tasks, SampledTasks) else tasks(np.random.default_rng(0))
        self.observation_space = _task_space(len(like.robot.feet))
        self.action_space = spaces.MultiDiscrete([len(charts), len(HEIGHTS), len(NOISES)])
        self._found: tuple[Trajectory, Report[Trajectory]] | None = None
        self.pool = _pool_of(settings.pool, self._tasks, charts, self._settings)
        self._walk = 0
        self._seen: dict[int, dict[str, NDArray[np.float32]]] = {}
        if self._terms.by_key:
            walk = self._tasks(np.random.default_rng(0)) if self.pool is None else self.pool.walk(0)
            self._try_terms(walk, self._nothing(), terminated=True)

    def _begin(self) -> tuple[Walk, dict[str, Any]]:
        self._found = None
        if self.pool is None:
            walk = self._tasks(self.np_random)
            self._solver.bench(walk)
        else:
            self._walk = int(self.np_random.integers(len(self.pool)))
            walk = self.pool.walk(self._walk)
        return walk, self._nothing()

    def _act(self, episode: Walk, action: NDArray[np.int64]) -> Step:
        """Solve as chosen and verify; the episode ends."""
        chosen = tuple(checked_action(action, self.action_space).tolist())
        if self.pool is None:
            seed = int(self.np_random.integers(2**31))
            found, came_to = self._solver.solve(episode, chosen, seed)
            self._found = None if found is None else (found.trajectory, found.report)
        else:
            came_to = self.pool.outcome(self._walk, chosen)
        info = self._info(came_to)
        return Step(
            reward=sum(value for name, value in info.items() if name.startswith("reward_")),
            terminated=True,
            info=info,
            question=episode,
            answer=None if self._found is None else self._found[0],
            action=action,
        )

    def _drawn(self, episode: Walk) -> Figure:
        """The terrain with the terrain-following guess, and after a step the motion that was
        found.
        """
        from stancekit.views.gaits import draw_motion

        if self._found is not None:
            return draw_motion(*self._found)
        program = self._solver.bench(episode).program("decoupled")
        guess = program.solve(max_iterations=0).trajectory()
        return draw_motion(guess, caption="before the step: the guess")

    def _observe(self, episode: Walk) -> dict[str, NDArray[np.float32]]:
        """The observation of a walk; of one of a pool it is worked out once."""
        if self.pool is None:
            return observe(episode)
        if self._walk not in self._seen:
            self._seen[self._walk] = observe(episode)
        return {name: values.copy() for name, values in self._seen[self._walk].items()}

    def _nothing(self) -> dict[str, Any]:
        """``info`` before anything was tried: zeros of the same kinds."""
        return {name: type(value)() for name, value in self._info(_Outcome()).items()}

    def _info(self, found: _Outcome) -> dict[str, Any]:
        """Info of an attempt."""
        weights, seconds = self._weights, found.seconds if self._timing else 0.0
        verified, feasible = bool(found.verified), bool(found.feasible)
        return {
            "verified": int(verified),
            "is_success": int(verified),
            "feasible": int(feasible),
            "iterations": int(found.iterations),
            "violation": found.violation,
            "refused": int(found.refused),
            **{name: getattr(found, name) for name in _FIGURES},
            "reward_verified": weights.verified * verified,
            "reward_feasible": weights.feasible * feasible,
            "reward_iterations": -weights.iterations
            * min(found.iterations / self._settings.max_iterations, 1.0),
            "reward_seconds": -weights.seconds * seconds,
            "seconds": seconds,
        }


def _pool_of(
    pool: int | str | Path | None, tasks: Tasks, charts: tuple[str, ...], settings: GaitSettings
) -> _WalkPool | None:
    """The pool that is asked for by a number of walks or a file.

    Raises InvalidInput.
    """
    if pool is None:
        return None
    if isinstance(pool, int):
        return _WalkPool(tasks, pool, charts, settings)
    return _WalkPool.read(pool, tasks, charts, settings)


def observe(task: Walk) -> dict[str, NDArray[np.float32]]:
    """The observation of a walk, see ``WarpedGaitEnv``."""
    middle, way = 0.5 * (task.start + task.goal), task.goal - task.start
    turn = (
        float(np.arctan2(way[1], way[0])) if float(np.abs(way).max()) > 0.0 else task.start_yaw_rad
    )
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    line = np.linspace(-0.5 * PATCH_M, 0.5 * PATCH_M, PATCH)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)
    heights = task.terrain.height(middle + grid @ axes) - float(task.terrain.height(middle))
    heading = task.start_yaw_rad - turn

    return {
        "heights": flat(heights, _ROOM),
        "start": flat(axes @ (task.start - middle), _ROOM),
        "goal": flat(axes @ (task.goal - middle), _ROOM),
        "facing": flat([np.cos(heading), np.sin(heading)], 1.0),
        "friction": flat(task.friction, _ROOM),
        "adhesive": flat(task.adhesive, 1.0),
    }


def _task_space(feet: int) -> spaces.Dict:
    """The space of ``observe`` for a robot of this many feet."""
    return boxes(
        {
            "heights": (-_ROOM, _ROOM, PATCH * PATCH),
            "start": (-_ROOM, _ROOM, 2),
            "goal": (-_ROOM, _ROOM, 2),
            "facing": (-1.0, 1.0, 2),
            "friction": (0.0, _ROOM, 1),
            "adhesive": (0.0, 1.0, feet),
        }
    )
