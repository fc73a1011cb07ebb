"""Compare selectors: one rollout for all, Table I's shares with confidence intervals, and the
paper's figures; and all of it for every class of problems of an experiment, each row kept.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from gymnasium import spaces
from pydantic import BaseModel, ConfigDict, ValidationError

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.ledger import LabelPlan, software
from stancekit.envs.distributions.postures import distribution
from stancekit.envs.scenes import LabelledScene, ListedScenes, SceneKind
from stancekit.envs.selection import ADMITTED, EnvelopeSelectionEnv
from stancekit.planners.answer.answer import Status
from stancekit.planners.answer.report import or_null
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.equilibrium.yardstick import yardstick
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import Strict, read_yaml, shown, validated
from stancekit.planners.files.writing import make_folder, write_text
from stancekit.planners.plugins import code_of
from stancekit.planners.projection.project import PROJECTIONS, Projection, project
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.answer import Acceptance, Clock, plan_of
from stancekit.runner.control.envelope_choice import Predictor

from ..data.executors import Executor, gather, processes
from ..data.labelling import Quota, label
from ..selectors.selector import ANY, FixedSelector, Learned, load_selector
from ..training.fitting import METHODS, FitSettings, learn_selector

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Progress = Callable[[int, int], None]
CHUNK = 100
"""Scenes that one task of an executor plays."""

TABLE_I: Mapping[str, Mapping[str, tuple[float, float, float, float]]] = MappingProxyType(
    {
        "ground-3": {
            "cluster": (0.9816, 0.7778, 0.8354, 0.9816),
            "GA": (0.7008, 0.9124, 0.3740, 0.7008),
            "heuristic": (0.9977, 0.5000, 0.8491, 0.9977),
        },
        "wall-3": {
            "cluster": (0.9362, 0.8000, 0.6332, 0.9362),
            "GA": (0.7785, 0.9772, 0.6707, 0.7785),
            "heuristic": (0.7872, 0.5133, 0.6075, 0.7872),
        },
        "wall-5": {
            "cluster": (0.9527, 0.7931, 0.9041, 0.9349),
            "GA": (0.6821, 0.9868, 0.6270, 0.6821),
            "heuristic": (0.9290, 0.7241, 0.8810, 0.9225),
        },
    }
)
"""Lin et al.'s Table I: P1 correct feasible, P1 correct infeasible, P1 → P2 by fix-p, P1 → P2 by
NLP."""

_PAPER_NAMES = {"heuristic": "heuristic", "gmm-printed": "cluster", "gmm": "cluster", "ga": "GA"}


def paper_row(problem_class: str, selector: str) -> dict[str, float] | None:
    """The paper's figures for the method that a selector stands for, by the names of
    ``Score.to_json``; or None.
    """
    row = TABLE_I.get(problem_class, {}).get(_PAPER_NAMES.get(selector, ""))
    names = ("p1_feasible", "p1_infeasible", "project_fix_p", "project_nlp")
    return None if row is None else dict(zip(names, row, strict=True))


@dataclass(frozen=True, kw_only=True)
class Share:
    """A share of counts with its Wilson 95 % interval."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        """hits / of; NaN of nothing."""
        return self.hits / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson score interval, 95 %."""
        if not self.of:
            return float("nan"), float("nan")
        z, n, p = 1.96, self.of, self.value
        middle, half = (
            p + z * z / (2 * n),
            z * float(np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))),
        )
        return (
            max((middle - half) / (1 + z * z / n), 0.0),
            min((middle + half) / (1 + z * z / n), 1.0),
        )


@dataclass(frozen=True, kw_only=True)
class Score:
    """One row of the comparison of selectors, as ``evaluate`` makes it.

    Arguments:
        selector: its name.
        p1_feasible, p1_infeasible: shares of the problems that P1 answers as the expert does.
        projected: of the feasible problems, the share for which P1 → P2 ends in a verified posture,
            by projection.
        gap: median McCormick gap over the feasible problems that P1 admits.
        p1_ms: median time of P1 over them [ms].
        notes: further figures by name.
    Source:
        Lin et al. Table I.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> test = stancekit.label("wall-3", "test", rows=(6, 6), seed=1)
        >>> sorted(stancekit.evaluate(stancekit.fit(train, "quantile"), test).projected)
        ['fix-p', 'scp']
    """

    selector: str
    p1_feasible: Share
    p1_infeasible: Share
    projected: Mapping[Projection, Share]
    gap: float = float("nan")
    p1_ms: float = float("nan")
    notes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def balanced(self) -> float:
        """Mean of both P1 shares."""
        return 0.5 * (self.p1_feasible.value + self.p1_infeasible.value)

    def to_json(self) -> dict[str, Any]:
        """Return the row as numbers, intervals as [low, high]."""
        shares = {"p1_feasible": self.p1_feasible, "p1_infeasible": self.p1_infeasible}
        shares |= {_key(way): share for way, share in self.projected.items()}
        record: dict[str, Any] = {"selector": self.selector}
        for name, share in shares.items():
            record[name] = share.value if share.of else None
            record[f"{name}_interval"] = list(share.interval) if share.of else None
            record[f"{name}_of"] = share.of
        return record | {"gap": or_null(self.gap), "p1_ms": or_null(self.p1_ms), **self.notes}


def rollout(selector: Predictor, env: EnvelopeSelectionEnv, episodes: int) -> list[dict[str, Any]]:
    """Play one-step episodes and return the info of each, with its ``reward``: what every selector
    is judged by.

    stable-baselines3's ``evaluate_policy(selector, env)`` plays the same episodes.
    """
    infos = []
    for episode in range(episodes):
        observation, _ = env.reset(seed=0 if episode == 0 else None)
        action, _ = selector.predict(observation, deterministic=True)
        _, reward, _, _, info = env.step(action)
        infos.append(info | {"reward": reward})
    return infos


def evaluate(
    name: str,
    learned: Learned,
    scenes: Sequence[LabelledScene],
    *,
    problem_class: str,
    projections: tuple[Projection, ...],
    progress: Progress | None = None,
    run: Executor | None = None,
) -> Score:
    """Roll a selector out over the scenes, through the environment.

    Arguments:
        run: the executor; this process where None.
    """
    play = _Player(learned, problem_class, projections)
    return _score(name, _everywhere(play, scenes, progress, run), projections)


def evaluate_lift(
    scenes: Sequence[LabelledScene],
    *,
    projections: tuple[Projection, ...],
    progress: Progress | None = None,
    run: Executor | None = None,
) -> Score:
    """Score the relaxation without envelopes (the lift), which has no box to choose."""
    return _score(
        "lift",
        _everywhere(partial(_lifted, Programs(), projections), scenes, progress, run),
        projections,
    )


def _everywhere(
    play: Callable[[Sequence[LabelledScene]], list[dict[str, Any]]],
    scenes: Sequence[LabelledScene],
    progress: Progress | None,
    run: Executor | None,
) -> list[dict[str, Any]]:
    """Play the scenes CHUNK by CHUNK wherever the executor likes; the infos come in the order of
    the scenes.
    """
    chunks = [scenes[begin : begin + CHUNK] for begin in range(0, len(scenes), CHUNK)]

    def on_progress(done: int, total: int) -> None:
        if progress is not None:
            progress(min(done * CHUNK, len(scenes)), len(scenes))

    parts = gather(run or processes(1), [partial(play, chunk) for chunk in chunks], on_progress)
    return [info for part in parts for info in part]


class _Player:
    """Plays chunks of scenes with one selector, in one environment, which goes to no other process:
    a copy makes its own.
    """

    def __init__(
        self, learned: Learned, problem_class: str, projections: tuple[Projection, ...]
    ) -> None:
        self._learned, self._problem_class, self._projections = learned, problem_class, projections
        self._made: tuple[EnvelopeSelectionEnv, ListedScenes] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_made": None}

    def __call__(self, scenes: Sequence[LabelledScene]) -> list[dict[str, Any]]:
        """The info of every scene, numbers only.

        All scenes are of the same legs.
        """
        self._made = self._made or self._environment(scenes)
        env, source = self._made
        source.deal(scenes)
        infos = rollout(self._learned.selector, env, len(scenes))
        return [{k: v for k, v in info.items() if np.ndim(v) == 0} for info in infos]

    def _environment(
        self, scenes: Sequence[LabelledScene]
    ) -> tuple[EnvelopeSelectionEnv, ListedScenes]:
        source, learned = ListedScenes(scenes), self._learned
        env = EnvelopeSelectionEnv(
            SceneKind(name=self._problem_class, legs=scenes[0].problem.legs),
            boxes=learned.boxes,
            relaxation=learned.relaxation,
            projections=self._projections,
            scenes=source,
            timing=True,
        )
        if isinstance(learned.selector, FixedSelector):  # envelopes may be wider than an action
            env.action_space = spaces.Box(-np.inf, np.inf, env.action_space.shape)
        return env, source


def _lifted(
    programs: Programs, projections: tuple[Projection, ...], scenes: Sequence[LabelledScene]
) -> list[dict[str, Any]]:
    """Info that the environment would give of each scene if P1 were the lift."""
    acceptance, infos = Acceptance(tolerance=ADMITTED), []
    for scene in scenes:
        scaled = Scaled.of(scene.problem)
        begin = time.perf_counter()
        lift = solve_lift(programs, scaled, least_moment=True)
        seconds = time.perf_counter() - begin
        admits = lift.solved and lift.bound <= acceptance.gap
        info = {
            "label": int(scene.feasible),
            "p1_feasible": int(admits),
            "gap": float("nan"),
            "p1_seconds": seconds,
        }
        info["p1_right"] = int(lift.solved and admits == scene.feasible)
        for way in projections:
            reached = False
            if admits and scene.feasible:
                point = project(programs, way, scaled, lift.rounded()[1])
                if np.isfinite(point.residual):
                    outcome = acceptance.answer(
                        scene.problem,
                        plan=plan_of(scene.problem, scaled, scaled.numbers, point),
                        method=way,
                        clock=Clock.start(),
                    )
                    reached = outcome.status is Status.FEASIBLE
            info[_key(way)] = int(reached)
        infos.append(info)
    return infos


def _score(
    name: str, infos: Sequence[Mapping[str, Any]], projections: tuple[Projection, ...]
) -> Score:
    feasible = [info for info in infos if info["label"]]
    infeasible = [info for info in infos if not info["label"]]
    admitted = [info for info in feasible if info["p1_feasible"]]
    return Score(
        selector=name,
        p1_feasible=Share(hits=len(admitted), of=len(feasible)),
        p1_infeasible=Share(hits=sum(info["p1_right"] for info in infeasible), of=len(infeasible)),
        projected={
            way: Share(hits=int(sum(info[_key(way)] for info in feasible)), of=len(feasible))
            for way in projections
        },
        gap=float(np.median([info["gap"] for info in admitted])) if admitted else float("nan"),
        p1_ms=float(np.median([1e3 * info["p1_seconds"] for info in infos]))
        if infos
        else float("nan"),
    )


def _key(way: Projection) -> str:
    return f"project_{way.replace('-', '_')}"


def check_same_class(dataset: Dataset, problem_class: str, where: str) -> None:
    """Raise InvalidInput where envelopes and data set were made for different problems."""
    if problem_class not in (dataset.problem_class, ANY):
        raise InvalidInput(
            f"{where}: expected envelopes learned for {dataset.problem_class}, got some learned "
            f"for {problem_class}"
        )


@dataclass(frozen=True, kw_only=True)
class Experiment(Strict):
    """Definition of an experiment: its problems, amount of data and methods.

    The seeds of ``train``, ``calibration`` and ``test`` differ.

    Arguments:
        robot, terrain: files of the robot and the terrain; by default the hexapod, and none.
        calibration: rows to calibrate on; without it methods keep a part of ``train`` for that.
    """

    problems: tuple[str, ...]
    train: Quota
    test: Quota
    calibration: Quota | None = None
    methods: tuple[str, ...]
    projections: tuple[Projection, ...]
    fit: FitSettings = field(default_factory=FitSettings)
    robot: str | None = None
    terrain: str | None = None

    def __post_init__(self) -> None:
        if self.train.seed == self.test.seed:
            raise InvalidInput(
                f"test.seed: expected another seed than train.seed, got {self.test.seed} for both"
            )
        if self.calibration is not None and self.calibration.seed in (
            self.train.seed,
            self.test.seed,
        ):
            raise InvalidInput(
                "calibration.seed: expected another seed than train.seed and test.seed, got "
                f"{self.calibration.seed}"
            )
        for name in self.problems:
            distribution(name, robot=self.robot, terrain=self.terrain)
        for index, method in enumerate(self.methods):
            known = [name for name in METHODS.names() if name != "modes"]
            if ".py:" in method:
                METHODS.get(method)  # what is no method is said before anything is labelled
            elif method not in known:
                raise InvalidInput(
                    f"methods[{index}]: expected one of {', '.join(known)}, got {method!r}"
                )
            self.fit.check(method)
        for name in ("problems", "methods", "projections"):
            if not getattr(self, name):
                raise InvalidInput(f"{name}: expected one or more, got none")
        for name in self.projections:
            PROJECTIONS.get(name)

    @classmethod
    def from_yaml(
        cls, path: str | Path, *, quick: bool = False, overrides: Mapping[str, Any] | None = None
    ) -> Experiment:
        """Read an experiment file.

        Raises InvalidInput with every key that is wrong.

        Arguments:
            quick: with the keys of its section ``quick`` in place of the main ones.
            overrides: in place of either.
        """
        data = read_yaml(path)
        short = data.pop("quick", {})
        if quick and not (isinstance(short, dict) and short):
            raise InvalidInput(f"{path}: quick: expected keys of an experiment, got {shown(short)}")
        return validated(cls, (data | short if quick else data) | dict(overrides or {}), str(path))


_LABEL, _P1, _PROJECTION = 2.5, 0.8, 0.4
"""Cost of a row, of a scene's P1 and of one projection, in cone programs of ``yardstick``."""
_FIT: Mapping[str, Callable[[FitSettings, Quota], float]] = {
    "heuristic": lambda how, rows: 0.5 * (rows.feasible + rows.infeasible),
    "quantile": lambda how, rows: 0.5 * (rows.feasible + rows.infeasible),
    "gmm": lambda how, rows: 1.0 * how.clusters * how.steps * how.batch,
    "gradient": lambda how, rows: 0.8 * how.boxes * how.steps * how.batch,
    "ga": lambda how, rows: 0.3 * _size(how.genetic, population=40, generations=60, terrains=100),
    "neural": lambda how, rows: 3.0 * rows.feasible * _size(how.neural, margin_epochs=4),
    "joint": lambda how, rows: 5.0 * rows.feasible * _size(how.neural, margin_epochs=4),
}
"""Cost of a fit by our methods, in the same."""


def _size(keys: Mapping[str, Any], **usual: int) -> float:
    return math.prod(float(keys.get(name, value)) for name, value in usual.items())


def expected_s(experiment: Experiment, workers: int = 1) -> float:
    """Rough wall-clock time of a whole run on idle cores [s], from its settings and the speed of
    this computer, which is measured. Methods that are not ours count as nothing.
    """
    how, methods, rows = experiment.fit, experiment.methods, experiment.train
    scenes = experiment.test.feasible + experiment.test.infeasible
    play = scenes * (_P1 + _PROJECTION * len(experiment.projections)) * (1 + len(methods))
    label = _LABEL * (rows.feasible + rows.infeasible + scenes)
    fits = {name: _FIT[name](how, rows) for name in methods if name in _FIT}
    printed = how.clusters * how.time_limit_s * ("gmm-printed" in methods)
    programs = (label + play + fits.pop("ga", 0.0)) / workers + sum(fits.values())
    return len(experiment.problems) * (programs * yardstick(60) / 60 + printed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Several selectors beside each other on the same rows, as ``evaluate`` makes it.

    ``markdown`` and ``picture`` are for a paper; ``to_json`` has the numbers.

    Arguments:
        problem_class: name of the class of problems.
        scores: a row per selector.
    Source:
        Lin et al. Table I.

    Example:
        >>> import stancekit
        >>> train = stancekit.label("wall-3", "train", rows=(6, 6))
        >>> test = stancekit.label("wall-3", "test", rows=(6, 6), seed=1)
        >>> mine = {"mine": stancekit.fit(train, "quantile"), "lift": "lift"}
        >>> print(stancekit.evaluate(mine, test).markdown()[:9])
        ## wall-3
    """

    problem_class: str
    scores: tuple[Score, ...]

    def to_json(self) -> list[dict[str, Any]]:
        """A row per selector as JSON-ready numbers, with the paper's where it has some."""
        records = []
        for score in self.scores:
            record = {
                "problem_class": self.problem_class,
                **score.to_json(),
                "balanced": score.balanced,
            }
            paper = paper_row(self.problem_class, score.selector)
            records.append(record if paper is None else {**record, "paper": paper})
        return records

    def markdown(self) -> str:
        """The table in Markdown, with 95 % intervals and the paper's rows."""
        return "\n".join(markdown(self.problem_class, self.to_json()))

    def picture(self) -> Figure:
        """The shares as bars with 95 % intervals, and the paper's as markers."""
        from stancekit.views.plots import ComparisonBar, draw_comparison

        bars = []
        for score in self.scores:
            shares = {"P1 feasible": score.p1_feasible, "P1 infeasible": score.p1_infeasible}
            shares |= {f"→ {way}": share for way, share in score.projected.items()}
            values = {name: share.value for name, share in shares.items() if share.of}
            paper = paper_row(self.problem_class, score.selector) or {}
            bars.append(
                ComparisonBar(
                    selector=score.selector,
                    values=values,
                    paper={
                        _MEASURES[key]: each
                        for key, each in paper.items()
                        if _MEASURES.get(key) in values
                    },
                    intervals={name: share.interval for name, share in shares.items() if share.of},
                )
            )
        return draw_comparison(
            bars,
            caption=f"{self.problem_class}: {bars and self.scores[0].p1_feasible.of} feasible "
            f"and {self.scores[0].p1_infeasible.of} infeasible held-out terrains",
        )


_MEASURES = {
    "p1_feasible": "P1 feasible",
    "p1_infeasible": "P1 infeasible",
    "project_fix_p": "→ fix-p",
    "project_nlp": "→ nlp",
}
"""Names of the paper's figures in pictures."""
_CLAIMS = ("P1 feasible", "P1 infeasible")
_IDENTITY = re.compile(r"-(of|on)-(.+?)-([0-9a-f]{6})[0-9a-f]{6}(?=-on-|$)")


def title_of(problem_class: str) -> str:
    """A class of problems in words: "terrain-3 of go1 (c828d3) on tiles (7802fa)", the digests of
    both files cut.
    """
    return _IDENTITY.sub(r" \1 \2 (\3)", problem_class)


def page(records: Sequence[Mapping[str, Any]], experiment: Experiment) -> str:
    """Markdown of rows as ``Score.to_json`` has them, with ``problem_class`` and ``balanced``.

    Sorted by the mean of both shares of P1; shares are % with Wilson 95 % intervals. The paper's
    rows have no rank: their scenes are other draws. Below the tables stand the data and, a line a
    selector, what it was learned with.
    """
    text = "% of held-out scenes, with 95 % intervals (Wilson); the best share is bold."
    lines = ["# Leaderboard: selectors of envelopes", "", text, ""]
    for name in dict.fromkeys(record["problem_class"] for record in records):
        lines += markdown(name, [record for record in records if record["problem_class"] == name])
    return "\n".join([*lines, *_data(experiment), *_cards(records), ""])


def markdown(name: str, records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines of the table of one class of problems."""
    ways = [
        key.removesuffix("_of").removeprefix("project_")
        for key in records[0]
        if key.startswith("project_") and key.endswith("_of")
    ]
    keys = ["p1_feasible", "p1_infeasible", *(f"project_{way}" for way in ways)]
    best = {
        key: max((row[key] for row in records if row[key] is not None), default=None)
        for key in keys
    }
    ranked = sorted(records, key=lambda row: -row["balanced"])
    counts = f"{records[0]['p1_feasible_of']} feasible and {records[0]['p1_infeasible_of']} infeasible scenes"
    lines = [
        f"## {title_of(name)}",
        "",
        f"{counts}.",
        "",
        _row(["", "selector", *_CLAIMS, *(way.replace("_", "-") for way in ways), "P1 [ms]"]),
        _row(["---:", "---", *("---:" for _ in keys), "---:"]),
    ]
    for rank, row in enumerate(ranked, 1):
        shares = (_share(row, key, bold=row[key] == best[key]) for key in keys)
        lines.append(_row([str(rank), str(row["selector"]), *shares, _shown(row.get("p1_ms"))]))
    for selector, figures in TABLE_I.get(name, {}).items():
        by_way = {"project_fix_p": figures[2], "project_nlp": figures[3]}
        shown = [figures[0], figures[1], *(by_way.get(key) for key in keys[2:])]
        lines.append(
            _row(
                [
                    "",
                    f"paper: {selector}",
                    *("–" if x is None else f"{100.0 * x:.1f}" for x in shown),
                    "–",
                ]
            )
        )
    return [*lines, ""]


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _share(row: Mapping[str, Any], key: str, *, bold: bool) -> str:
    if row[key] is None:
        return "–"
    low, high = row[f"{key}_interval"]
    mark = "**" if bold else ""
    return f"{mark}{100.0 * row[key]:.1f}{mark} [{100.0 * low:.1f}, {100.0 * high:.1f}]"


def _shown(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _data(experiment: Experiment) -> list[str]:
    """Section on the rows that the methods learned from and were judged on, and on versions."""
    lines = [
        "## Data",
        "",
        _row(["part", "feasible", "infeasible", "seed"]),
        _row(["---", "---:", "---:", "---:"]),
    ]
    for part in ("train", "calibration", "test"):
        quota = getattr(experiment, part)
        if quota is not None:
            lines.append(_row([part, *map(str, (quota.feasible, quota.infeasible, quota.seed))]))
    of = [
        f"{key} `{value}`"
        for key in ("robot", "terrain")
        if (value := getattr(experiment, key)) is not None
    ]
    proved = (
        "Every label has a posture or a certificate, which `stancekit verify FOLDER` checks again. "
        "Infeasible scenes need their moment balance to be so."
    ) + (f" Of {', '.join(of)}." if of else "")
    versions = ", ".join(f"{name} {version}" for name, version in software().items())
    return [*lines, "", proved, "", f"Made with {versions}.", ""]


def _cards(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line a learned selector: its file, what fitting took, and where it must not be used."""
    learned = [row for row in records if "fit_seconds" in row]
    lines = [
        "## Cards",
        "",
        _row(["selector", "of", "file", "fitted in [s]"]),
        _row(["---", "---", "---", "---:"]),
    ]
    lines += [
        _row(
            [
                str(row["selector"]),
                row["problem_class"],
                row.get("file") or "none kept",
                _shown(row["fit_seconds"]),
            ]
        )
        for row in learned
    ]
    return [
        *lines,
        "",
        "A selector is for the class, the robot and the terrain of its row: it is refused for "
        "others. Nothing that it",
        "says has to be believed: postures and certificates are verified. Settings are those of "
        "the experiment's file,",
        "seeds those above; seconds are of the wall clock.",
    ]


StageDone = Callable[[str, int, int], None]
_OnProgress = Callable[[str], Callable[[int, int], None]]
_SHARD_SIZE = 125


@dataclass(frozen=True, kw_only=True, eq=False)
class ClassResult(Comparison):
    """Results of a run for one class of problems.

    Arguments:
        labelling: summary of the training rows.
        learned: selectors by method.
        fresh: rows that this run made.
    """

    labelling: Mapping[str, Any]
    learned: Mapping[str, Learned]
    test: Dataset
    fresh: tuple[str, ...]


class _Row(BaseModel):
    """``METHOD.row.json``: what a row was made from and what it says."""

    model_config = ConfigDict(extra="forbid", strict=True, ser_json_inf_nan="constants")
    format: Literal["stancekit/bench-row/2"] = "stancekit/bench-row/2"
    fit_key: str
    file: str
    file_sha256: str
    fit_seconds: float
    row_key: str = ""
    score: Score | None = None

    __hash__: ClassVar[None]  # type: ignore[assignment]


def run(
    experiment: Experiment, folder: Path, *, executor: Executor, progress: StageDone | None = None
) -> Iterator[ClassResult]:
    """Yield the result of every class as it comes; everything is kept in ``folder``.

    Data sets are gone on with, selectors and rows used again, wherever they follow from the same
    settings, data and software.

    Arguments:
        executor: where labelling, generations and rollouts run.

    Raises:
        InvalidInput: e.g. where a data set of another plan is in the folder.
    """
    for name in experiment.problems:
        make_folder(folder / name)

        def on_progress(stage: str, name: str = name) -> Callable[[int, int], None]:
            return lambda done, total: (
                None if progress is None else progress(f"{name}: {stage}", done, total)
            )

        yield _Class(experiment, name, folder / name, executor, on_progress).result()


class _Class:
    """The run of one class of problems."""

    def __init__(
        self,
        experiment: Experiment,
        name: str,
        folder: Path,
        executor: Executor,
        on_progress: _OnProgress,
    ) -> None:
        self._experiment, self._name, self._folder, self._run, self._told = (
            experiment,
            name,
            folder,
            executor,
            on_progress,
        )

    def result(self) -> ClassResult:
        """All rows of this class."""
        experiment = self._experiment
        train, labelling = self._label("train", experiment.train)
        calibration = (
            None
            if experiment.calibration is None
            else self._label("calibration", experiment.calibration)[0]
        )
        test, _ = self._label("test", experiment.test)
        scenes = scenes_of(test)
        scores: list[Score] = []
        learned: dict[str, Learned] = {}
        for method in experiment.methods:
            row, learned[method] = self._learned(method, train, calibration)
            scores.append(self._score(method, row, learned[method], scenes, test))
        scores.append(self._lift(scenes, test))
        fresh = tuple(each.selector for each in scores if not each.notes["kept"])
        plain = tuple(
            replace(s, notes={k: v for k, v in s.notes.items() if k != "kept"}) for s in scores
        )
        return ClassResult(
            problem_class=test.problem_class,
            labelling=labelling,
            scores=plain,
            learned=learned,
            test=test,
            fresh=fresh,
        )

    def _label(self, part: str, quota: Quota) -> tuple[Dataset, Mapping[str, Any]]:
        plan = LabelPlan(
            distribution=self._name,
            robot=self._experiment.robot,
            terrain=self._experiment.terrain,
            shard_size=_SHARD_SIZE,
            **asdict(quota),
        )
        bar = self._told(f"label {part}")
        summary = label(
            plan,
            self._folder / part,
            run=self._run,
            progress=lambda state: bar(state.rows, plan.rows),
        )
        return Dataset.open(self._folder / part), summary.to_json()

    def _learned(
        self, method: str, train: Dataset, calibration: Dataset | None
    ) -> tuple[_Row, Learned]:
        """The selector that is there, or a new one; and its row as far as it is known."""
        digests = [
            train.header.digest,
            "" if calibration is None else calibration.header.digest,
            *([code] if (code := code_of(method)) else []),
        ]
        key = _digest(["fit", method, self._experiment.fit.concerning(method), digests, software()])
        row = self._read(method)
        if row is not None and row.fit_key == key and (self._folder / row.file).is_file():
            path = self._folder / row.file
            if hashlib.sha256(path.read_bytes()).hexdigest() == row.file_sha256:
                return row, load_selector(path)
        begin, checkpoint = perf_counter(), self._folder / f"{_stem(method)}.checkpoint-{key[:12]}"
        bar = self._told(f"fit {method}")
        settings = self._experiment.fit
        learned = learn_selector(
            method,
            train,
            settings,
            bar,
            calibration=calibration,
            checkpoint=checkpoint,
            run=self._run,
        )
        if code_of(method) and not isinstance(learned.selector, FixedSelector):
            blank = _Row(fit_key=key, file="", file_sha256="", fit_seconds=perf_counter() - begin)
            return (
                blank,
                learned,
            )  # no format of ours: judged as it is, and learned again by the next run
        path = self._folder / f"{_stem(method)}{learned.suffix}"
        learned.write(path)
        row = _Row(
            fit_key=key,
            file=path.name,
            file_sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
            fit_seconds=perf_counter() - begin,
        )
        self._write(method, row)
        return row, load_selector(path)

    def _score(
        self, method: str, row: _Row, learned: Learned, scenes: list[LabelledScene], test: Dataset
    ) -> Score:
        play = partial(
            evaluate,
            method,
            learned,
            scenes,
            problem_class=test.problem_class,
            projections=self._experiment.projections,
            run=self._run,
        )
        notes = {"fit_seconds": row.fit_seconds, "file": row.file}
        return self._kept(method, row, row.file_sha256 or row.fit_key, test, play, notes)

    def _lift(self, scenes: list[LabelledScene], test: Dataset) -> Score:
        row = self._read("lift") or _Row(fit_key="", file="", file_sha256="", fit_seconds=0.0)
        play = partial(
            evaluate_lift, scenes, projections=self._experiment.projections, run=self._run
        )
        return self._kept("lift", row, "lift", test, play, {})

    def _kept(
        self,
        name: str,
        row: _Row,
        selector: str,
        test: Dataset,
        play: Callable[..., Score],
        notes: dict[str, Any],
    ) -> Score:
        """The score that a row has, or else that of another play, which is then kept."""
        key, score = self._row_key(selector, test), row.score
        kept = row.row_key == key and score is not None
        if score is None or not kept:
            score = play(progress=self._told(f"evaluate {name}"))
            self._write(name, row.model_copy(update={"row_key": key, "score": score}))
        return replace(score, notes={**notes, "kept": kept})

    def _row_key(self, selector: str, test: Dataset) -> str:
        return _digest(
            [
                "row",
                selector,
                test.header.digest,
                list(self._experiment.projections),
                software(),
                *([code] if (code := code_of(*self._experiment.projections)) else []),
            ]
        )

    def _read(self, name: str) -> _Row | None:
        """A row that an earlier run kept; None where there is none that can be used."""
        try:
            return _Row.model_validate_json((self._folder / f"{_stem(name)}.row.json").read_bytes())
        except (OSError, ValidationError):
            return None

    def _write(self, name: str, row: _Row) -> None:
        write_text(self._folder / f"{_stem(name)}.row.json", row.model_dump_json(indent=1) + "\n")


def _stem(method: str) -> str:
    """The method's name as that of a file."""
    return re.sub(r"[^\w-]+", "-", method.replace(".py:", "-"))


def _digest(parts: list[Any]) -> str:
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
