"""Room for learning: how much the best unlearned control leaves of what any method finds, at a
stated budget; and the finders of leaps, scene by scene.

Room is oracle − control, in points. The oracle is the union of all methods at a larger budget; a
second run of the methods that draw, with another seed, says how much of it is luck. All scenes are
in every denominator.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import gymnasium as gym
import numpy as np

from stancekit.envs.episodes import (
    MemorylessPolicy,
    any_dimension,
    largest_gap,
    noisy_gap,
    widest,
)
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import checked_choice, checked_int
from stancekit.planners.files.writing import make_folder
from stancekit.planners.gait.charts import CHARTS
from stancekit.planners.leap.finder import LeapFinder, LeapSearch
from stancekit.planners.leap.scp import Rule, plan_of
from stancekit.planners.problem.leap import Leap
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.search.exact import Exact
from stancekit.planners.verify.leaps import check_leap

from ..leaps.kinds import SCORER
from ..zoo import shipped
from .evaluate import Share as Counted

Share = tuple[float, float, float]
_DRAWS = 10_000
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
    ``run`` with ``most`` solves per scene.
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
    return _room_of(
        environment=f"LeapChoice-v0 ({distribution})",
        budget=_budget(tries, solves, cpu_s),
        oracle_budget=f"all methods, {most} solves",
        within=within,
        anywhere=anywhere,
        fair=[method for method in within if method in FINDERS or method in TUNED],
        learned=[method for method in within if method not in UNLEARNED],
        again={first: second for first, (second, _) in AGAIN.items()},
    )


def _room_of(
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
    resamples = np.random.default_rng(seed).integers(len(apart), size=(_DRAWS, len(apart)))
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


_Player = Callable[[Any, Any, np.random.Generator], Any]
"""Gives an action for an environment, its observation and a generator."""
_EXACT = "exact"
_RANDOM = ("random", "random-again")
"""Names of policies that draw; the second has another seed."""


@dataclass(frozen=True, kw_only=True)
class _Plays:
    """An environment and what is played in it.

    Arguments:
        options: keywords of ``gymnasium.make``.
        budget: of an episode, in words.
        players: makes the policies, by name.
        learned: names of those that learned.
        solves: convex problems of an episode, within which the exact planner answers the scene
            beside the environment; None where the scene is no posture.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    budget: str
    players: Callable[[], Mapping[str, _Player]]
    learned: tuple[str, ...] = ()
    solves: int | None = None


def environment_room(
    name: str,
    folder: Path,
    *,
    scenes: int,
    seed: int,
    on_progress: Callable[[str, int, int], None] | None = None,
) -> Room:
    """Play what the folder does not have, and return the room of an environment at the budget of
    its episodes.

    Arguments:
        name: among ``ENVIRONMENTS``.
        folder: for the rows; a run that is stopped goes on.
        scenes: episodes per policy; the same scenes for all.
        seed: of the scenes.
        on_progress: called with a line, scenes done, and all.

    Raises:
        InvalidInput: for another name, and a folder with rows of other settings.
    """
    plays = ENVIRONMENTS[checked_choice(name, "environment", ENVIRONMENTS)]
    checked_int(scenes, "scenes", least=1)
    checked_int(seed, "seed", least=0)
    players, env = plays.players(), gym.make(f"stancekit/{name}", **plays.options)
    with kept_rows(folder / ROWS, {"environment": name, "seed": seed}) as (rows, add):
        for index in range(scenes):
            if on_progress is not None:
                on_progress(f"{name} {index}", index, scenes)
            if all(
                (index, method) in rows
                for method in (*players, *([_EXACT] if plays.solves else []))
            ):
                continue
            for row in _scene(env, plays, players, seed, index):
                add(row)
    answers: dict[str, list[bool]] = {}
    anywhere: dict[str, list[bool]] = {}
    for (index, method), row in sorted(rows.items()):
        if index < scenes:
            answers.setdefault(method, []).append(bool(row["found"]))
            anywhere.setdefault(method, []).append(bool(row["anywhere"]))
    return _room_of(
        environment=f"{name} ({', '.join(map(str, plays.options.values())) or 'as it is'})",
        budget=plays.budget,
        oracle_budget="all policies" + (", exact search without a limit" if plays.solves else ""),
        within={method: np.array(each) for method, each in answers.items()},
        anywhere={method: np.array(each) for method, each in anywhere.items()},
        fair=[method for method in answers if method not in (*_RANDOM, *plays.learned)],
        learned=list(plays.learned),
        again={"random": "random-again"},
    )


def _scene(
    env: gym.Env[Any, Any], plays: _Plays, players: Mapping[str, _Player], seed: int, index: int
) -> Iterator[dict[str, Any]]:
    """A row per policy on one scene, and one of the exact planner."""
    episode = int(np.random.default_rng([seed, index]).integers(2**31))
    for number, (method, player) in enumerate(players.items()):
        rng, begin = np.random.default_rng([seed, index, number]), time.process_time()
        observation, info = env.reset(seed=episode)
        over = False
        while not over:
            observation, _, ended, cut_off, info = env.step(player(env, observation, rng))
            over = ended or cut_off
        won = bool(info["is_success"])
        yield {
            "scene": index,
            "method": method,
            "found": won,
            "anywhere": won,
            "cpu_s": time.process_time() - begin,
        }
    if plays.solves is not None:
        env.reset(seed=episode)
        begin = time.process_time()
        outcome = Exact().solve(env.unwrapped.scene.problem)  # type: ignore[attr-defined]
        decided = outcome.status is not Status.UNDECIDED
        yield {
            "scene": index,
            "method": _EXACT,
            "found": decided and outcome.effort.solves <= plays.solves,
            "anywhere": decided,
            "cpu_s": time.process_time() - begin,
        }


def _drawn(env: Any, observation: Any, rng: np.random.Generator) -> Any:
    """Any action, each as likely."""
    space = env.action_space
    if isinstance(space, gym.spaces.Discrete):
        return np.int64(rng.integers(space.n))
    if isinstance(space, gym.spaces.MultiDiscrete):
        return rng.integers(space.nvec)
    return rng.uniform(space.low, space.high).astype(space.dtype)


def _by(policy: Any) -> _Player:
    return lambda env, observation, rng: policy.predict(observation, deterministic=True)[0]


def _selectors() -> Mapping[str, _Player]:
    from stancekit.envs.data.dataset import Dataset
    from stancekit.envs.data.ledger import folder_of

    from ..selectors.selector import FixedSelector, load_selector
    from ..training.fitting import fit

    rows = Dataset.open(folder_of("pool-wall-3"))
    boxes = {name: _by(FixedSelector(name, fit(name, rows))) for name in ("heuristic", "quantile")}
    return {
        **dict.fromkeys(_RANDOM, _drawn),
        **boxes,
        "neural-wall-3": _by(load_selector("neural-wall-3").selector),
    }


def _rules() -> Mapping[str, _Player]:
    chance = any_dimension(np.random.default_rng(0))
    chance_again = any_dimension(np.random.default_rng(1))
    gap = noisy_gap(np.random.default_rng(0), spread=0.0)
    rules = {
        "largest gap": MemorylessPolicy(largest_gap),
        "largest gap · width": gap,
        "widest": MemorylessPolicy(widest),
    }
    chances = dict(zip(_RANDOM, (chance, chance_again), strict=True))
    return {name: _by(rule) for name, rule in {**chances, **rules}.items()}


def _planners() -> Mapping[str, _Player]:
    return {**dict.fromkeys(_RANDOM, _drawn), **{f"always {k}": _always(k) for k in range(3)}}


def _always(chosen: int) -> _Player:
    return lambda env, observation, rng: np.int64(chosen)


def _charts() -> Mapping[str, _Player]:
    """Every chart, on the terrain as it is, from the guess that follows it."""
    always = {f"always {chart}": _at_once(k) for k, chart in enumerate(CHARTS.names())}
    return {**dict.fromkeys(_RANDOM, _drawn), **always}


def _at_once(chart: int) -> _Player:
    return lambda env, observation, rng: np.array([chart, 0, 0])


ENVIRONMENTS: Mapping[str, _Plays] = MappingProxyType(
    {
        "EnvelopeSelection-v0": _Plays(
            options={"problem": "wall-3"},
            budget="one box: 2 convex problems",
            players=_selectors,
            learned=("neural-wall-3",),
            solves=2,
        ),
        "EnvelopeRefinement-v0": _Plays(
            options={"problem": "ground-3", "budget": 50},
            budget="50 convex problems",
            players=_rules,
            solves=50,
        ),
        "Traverse-v0": _Plays(budget="an episode", players=_planners),
        "WarpedGait-v0": _Plays(budget="one attempt", players=_charts),
    }
)
"""Environments whose episodes policies play, by name without the package's; those of WarpedGait-v0
take seconds of the processor each."""


MANY = 1_000_000
FINDERS = MappingProxyType(
    {
        "random": LeapFinder(order="random", solves=MANY),
        "noise": LeapFinder(order="noise", solves=MANY),
        "rule-tuned": LeapFinder(order="rule", solves=MANY),
        "farkas": LeapFinder(order="farkas", solves=MANY),
        "finder": LeapFinder(order="finder", solves=MANY),
    }
)
AGAIN = MappingProxyType({"noise": ("noise-again", LeapFinder(order="noise", solves=MANY, seed=1))})
"""Methods that draw, by another name with another seed."""
TUNED = MappingProxyType(
    {
        "finder-tuned": LeapFinder(
            rule=Rule(grip=3.0, grip_cap=0.3, room=14.0, room_cap=-0.09), solves=MANY
        )
    }
)
"""The finder with the rule's constants chosen on the 900 scenes from which learned scores are
learned, too."""
UNLEARNED = (*FINDERS, *TUNED, *(name for name, _ in AGAIN.values()))
"""Names of all methods but learned scores."""
ROWS = "rows.jsonl"


@dataclass(frozen=True, kw_only=True)
class LeapBenchSettings:
    """Settings of the measurement.

    Arguments:
        distribution: a class of ``configs/leaps.yaml``.
        scenes: how many, from number 0 on.
        seed: of all of them.
        methods: of ``UNLEARNED``, and files of learned scores, or names of such that ship.
        solves: convex problems at most per method and scene, which does not depend on how busy the
            computer is.
    """

    distribution: str = "leap-hard"
    scenes: int = 1000
    seed: int = 4400
    methods: tuple[str, ...] = tuple(FINDERS)
    solves: int = 50

    def __post_init__(self) -> None:
        leap_class(self.distribution)
        checked_int(self.scenes, "scenes", least=1)
        checked_int(self.seed, "seed", least=0)
        checked_int(self.solves, "solves", least=1)
        for method in self.methods:
            if not is_scorer(method):
                checked_choice(method, "method", UNLEARNED)
        if len({_name_of(method) for method in self.methods}) < len(self.methods):
            raise InvalidInput(
                f"methods: expected different names, got {', '.join(map(_name_of, self.methods))}"
            )

    def scene(self, index: int) -> Leap:
        """The scene of a number, which has a generator of its own."""
        rng = np.random.default_rng([self.seed, index])
        return leap_class(self.distribution).draw(rng, f"{self.distribution}-{self.seed}-{index}")

    @property
    def shared(self) -> dict[str, Any]:
        """Settings that all rows share: those measured with other values are not gone on with."""
        return {name: getattr(self, name) for name in ("distribution", "seed", "solves")}


def run(
    settings: LeapBenchSettings,
    folder: Path,
    on_progress: Callable[[str, int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Measure what the folder does not have; return the row of every method on every scene.

    Raises InvalidInput where the folder holds rows of other settings, or lines that are none.
    """
    programs = Programs()
    with kept_rows(folder / ROWS, settings.shared) as (rows, add):
        finders = {_name_of(method): _finder(method, settings.seed) for method in settings.methods}
        for index in range(settings.scenes):
            if on_progress is not None:
                on_progress(f"{settings.distribution} {index}", index, settings.scenes)
            missing = [method for method in finders if (index, method) not in rows]
            leap = settings.scene(index) if missing else None
            for method in missing:
                assert leap is not None
                found = by_finder(leap, finders[method], settings.solves, programs)
                add({"scene": index, "method": method, **found})
    if on_progress is not None:
        on_progress("done", settings.scenes, settings.scenes)
    return [
        row
        for (index, method), row in sorted(rows.items())
        if index < settings.scenes and method in finders
    ]


_Rows = dict[tuple[int, str], dict[str, Any]]


@contextmanager
def kept_rows(
    path: Path, head: Mapping[str, Any]
) -> Iterator[tuple[_Rows, Callable[[dict[str, Any]], None]]]:
    """The rows of methods on scenes that a file has, and a function that adds one to both: a run
    that is stopped goes on.

    Arguments:
        head: what all rows share; a file with another one is refused.

    Raises InvalidInput, also where no folder can be made for the file.
    """
    make_folder(path.parent)
    rows = _kept(path, head)
    with path.open("a", encoding="utf-8") as file:
        if not path.stat().st_size:
            file.write(json.dumps(head) + "\n")

        def add(row: dict[str, Any]) -> None:
            rows[row["scene"], row["method"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()

        yield rows, add


def _kept(path: Path, head: Mapping[str, Any]) -> _Rows:
    """The rows that a file has.

    A last line that a stopped run left unfinished is taken off.
    """
    if not path.exists():
        return {}
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        path.write_text(whole, encoding="utf-8")
    rows: _Rows = {}
    for number, line in enumerate(whole.splitlines()):
        try:
            row = json.loads(line)
            if number:
                rows[int(row["scene"]), str(row["method"])] = row
        except (ValueError, TypeError, KeyError):
            raise InvalidInput(
                f"{path}: line {number + 1}: expected a row of bench room, of a method on a scene, "
                f"got {line[:60]!r}"
            ) from None
        if number == 0 and row != head:
            raise InvalidInput(f"{path}: expected rows of {head}, got those of {str(row)[:80]}")
    return rows


def by_finder(leap: Leap, method: LeapFinder, solves: int, programs: Programs) -> dict[str, Any]:
    """Search until a plan that the verifier accepts, or so many solves are spent."""
    begin = time.process_time()
    search, refused = LeapSearch(leap, method, programs), 0
    solved = False
    for attempt in search.attempts():
        if attempt.solved:
            solved = check_leap(plan_of(search.last.numbers, attempt, method.order)).accepted
            refused += not solved
        if solved or search.solves >= solves:
            break
    seconds = time.process_time() - begin
    return {
        "found": solved and search.solves <= solves,
        "tries": search.tries,
        "solves": search.solves,
        "cpu_s": seconds,
        "refused": refused,
    }


def _name_of(method: str) -> str:
    """The name of a method in rows and tables: its own, or that of its file."""
    return Path(method).stem if method.endswith(SCORER) else method


def is_scorer(method: str) -> bool:
    """Tell whether it is a file of learned scores, or the name of one that ships."""
    return method.endswith(SCORER) or method in shipped("scorers")


def _finder(method: str, seed: int) -> LeapFinder:
    if is_scorer(method):
        from ..leaps.policy import LeapScorer  # torch takes a while to load

        scorer = LeapScorer.read(method)
        if scorer.origin.get("seed") == seed:
            raise InvalidInput(
                f"seed: expected another one than that of the scenes which {method} learned from, "
                f"{seed}"
            )
        return LeapFinder(order="finder", rule=scorer, solves=MANY)
    return {**FINDERS, **TUNED, **dict(AGAIN.values())}[method]


def share(count: int, of: int) -> tuple[float, float, float] | None:
    """A share and the ends of its 95 % interval (Wilson); None of nothing."""
    if not of:
        return None
    counted = Counted(hits=count, of=of)
    low, high = counted.interval
    return counted.value, max(low, 0.0), min(high, 1.0)
