"""Compare selectors: one rollout for all, Table I's shares with confidence intervals, and the
paper's figures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from stancekit.envs.data.dataset import Dataset
from stancekit.envs.scenes import LabelledScene, ListedScenes, SceneKind
from stancekit.envs.selection import ADMITTED, EnvelopeSelectionEnv
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.equilibrium.scaled import Scaled
from stancekit.planners.errors import InvalidInput
from stancekit.planners.projection.project import Projection, project
from stancekit.planners.relaxation.lift import solve_lift
from stancekit.planners.search.answer import Acceptance, Claim, Clock, plan_of
from stancekit.runner.control.envelope_choice import Predictor

from ..data.executors import Executor, gather, processes
from ..selectors.selector import ANY, Learned

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
        return (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)


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
        return record | {"gap": _number(self.gap), "p1_ms": _number(self.p1_ms), **self.notes}


def rollout(
    selector: Predictor, env: EnvelopeSelectionEnv, episodes: int, progress: Progress | None = None
) -> list[dict[str, Any]]:
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
        if progress is not None:
            progress(episode + 1, episodes)
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
        if self._made is None:
            self._made = self._environment(scenes)
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
                    claim = Claim(plan=plan_of(scene.problem, scaled, scaled.numbers, point))
                    outcome = acceptance.answer(
                        scene.problem, claim, method=way, clock=Clock.start()
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


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
