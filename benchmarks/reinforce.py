"""Reinforcement on the environments: learning curves over several seeds, against agents that do not
learn.

    python benchmarks/reinforce.py selection  [--seeds 3] [--steps 40960] [--out out/reinforce]
    python benchmarks/reinforce.py refinement [--seeds 3] [--episodes 300] [--hindsight 40]
        [--tries 12]
    python benchmarks/reinforce.py traverse   [--episodes 300]
        [--courses stairs walls ground-to-wall]

The runs are those of configs/train-<name>.yaml but for seed and steps, and for selection but for
the scenes, of which there are more. CPU-s: of learning, with the evaluations of the curve. Runs
that a kill stopped go on. The curves are drawn to <out>/<name>.png.

selection: mean reward and P1's shares on held-out scenes, against random boxes, the heuristic,
quantile and gradient box, and the neural selector (margin gradient). ± is the standard error over
the seeds.

refinement: reward, solves and share with a verdict of --episodes scenes that neither training nor
its curve saw, against branching on the largest gap, the largest gap · width, the widest dimension
and at random; seeds are averaged scene by scene. "in hindsight": of the first --hindsight scenes
the best of --tries episodes by the rule with noise, a figure that no policy has to reach, which
says how much the choice matters.

traverse: reward of --episodes perturbed courses, for every planner that can be chosen, always the
same one, and for the best of all sequences of choices, found by trying them all: no policy reaches
more.

Intervals are bootstrapped over scenes or courses, 95 %; "− best rule": of the differences, scene by
scene.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from _bench import Options, bootstrapped, launch
from gymnasium import spaces
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stancekit.envs.data.dataset import Dataset, scenes_of
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.episodes import (
    MemorylessPolicy,
    Observation,
    any_dimension,
    largest_gap,
    noisy_gap,
    widest,
)
from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import LabelledScene, ListedScenes
from stancekit.envs.traverse import TraverseEnv
from stancekit.learners.data.labelling import Quota, label
from stancekit.learners.selectors.neural import NeuralSettings, fit_neural
from stancekit.learners.selectors.selector import FixedSelector
from stancekit.learners.training.fitting import fit
from stancekit.learners.training.reinforce import (
    CurvePoint,
    TrainConfig,
    TrainingScenes,
    evaluator,
    open_scenes,
    refinement_episodes,
    train,
)
from stancekit.runner.control.envelope_choice import Predictor

CONFIGS = Path(__file__).parents[1] / "configs"
TRAIN, HELD_OUT = (
    Quota(feasible=3000, infeasible=3000, seed=0),
    Quota(feasible=300, infeasible=300, seed=1),
)
"""Scenes that all agents of selection learn from, and are compared on."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """An agent's figures over its seeds: name → values; an agent without chance has one."""

    agent: str
    figures: Mapping[str, list[float]]


class RandomBox(MemorylessPolicy):
    """Bounds drawn uniformly from the whole domain."""

    def __init__(self, space: spaces.Box, seed: int) -> None:
        self._space, self._rng = space, np.random.default_rng(seed)

    def action(self, observation: Observation) -> NDArray[np.float32]:
        """The bounds."""
        return self._rng.uniform(self._space.low, self._space.high).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which environment, and how much of it."""

    name: Annotated[Literal["selection", "refinement", "traverse"], tyro.conf.Positional]
    seeds: int = 3
    steps: int | None = None
    out: Path = Path("out/reinforce")
    episodes: int = 300
    """Of refinement and traverse, a figure."""
    hindsight: int = 40
    tries: int = 12
    courses: tuple[str, ...] = ("stairs", "walls", "ground-to-wall")


def main(arguments: Arguments) -> None:
    """Train, compare, print, draw."""
    {"selection": selection, "refinement": refinement, "traverse": traverse}[arguments.name](
        arguments
    )


def selection(arguments: Arguments) -> None:
    """PPO and others."""
    config = TrainConfig.from_yaml(CONFIGS / "train-selection.yaml")
    config = replace(config, steps=arguments.steps or config.steps, train=TRAIN, held_out=HELD_OUT)
    folder = arguments.out / arguments.name
    scenes = TrainingScenes.label(config, folder / "data")
    rows = []
    for name, (agents, seconds) in others(config, scenes, arguments.seeds).items():
        rows.append(Row(agent=name, figures=figures(config, scenes, agents) | {"CPU-s": seconds}))
        said(arguments, rows[-1])
    curves, _, seconds = learned("PPO", config, scenes, arguments, folder)
    for when, index in (("untrained", 0), ("trained", -1)):
        ends = [{"reward": curve[index].reward, **curve[index].figures} for curve in curves]
        found = {key: [end[key] for end in ends] for key in ends[0]} | (
            {"CPU-s": seconds} if index else {}
        )
        rows.append(Row(agent=f"PPO {when}", figures=found))
        said(arguments, rows[-1])
    draw(rows, {"PPO": curves}, arguments.out / f"{arguments.name}.png")


def refinement(arguments: Arguments) -> None:
    """Where to cut the box: rules, what hindsight has, and PPO."""
    config, folder = (
        TrainConfig.from_yaml(CONFIGS / "train-refinement.yaml"),
        arguments.out / arguments.name,
    )
    config = replace(config, steps=arguments.steps or config.steps)
    test = test_scenes(config, folder / "test", arguments.episodes)
    rules: dict[str, Predictor] = {
        "largest gap": MemorylessPolicy(largest_gap),
        "largest gap · width": noisy_gap(np.random.default_rng(0), spread=0.0),
        "widest dimension": MemorylessPolicy(widest),
        "random dimension": any_dimension(np.random.default_rng(0)),
    }
    played = {name: episodes(config, test, rule) for name, rule in rules.items()}
    best = max(played, key=lambda name: played[name][:, 0].mean())
    for name, found in played.items():
        compared(arguments, name, found, played[best])
    some = test[: arguments.hindsight]
    noisy = [noisy_gap(np.random.default_rng(seed), spread=0.3) for seed in range(arguments.tries)]
    tries = np.stack([episodes(config, some, rule) for rule in noisy] + [played[best][: len(some)]])
    compared(
        arguments,
        "in hindsight",
        tries[tries[:, :, 0].argmax(axis=0), np.arange(len(some))],
        tries[-1],
    )
    scenes = TrainingScenes.label(config, folder / "data")
    curves, policies, seconds = learned("PPO", config, scenes, arguments, folder)
    seeds = np.stack([episodes(config, test, policy) for policy in policies])
    for seed, found in enumerate(seeds):
        compared(
            arguments, f"PPO, seed {seed}", found, played[best], **{"CPU-s": round(seconds[seed])}
        )
    compared(arguments, f"PPO, mean of {len(seeds)}", seeds.mean(axis=0), played[best])
    draw([], {"PPO": curves}, arguments.out / f"{arguments.name}.png")


def traverse(arguments: Arguments) -> None:
    """Who plans the next window: every planner alone, and the best sequence of them."""
    env = TraverseEnv(arguments.courses)
    assert isinstance(env.action_space, spaces.Discrete)
    planners, found = range(int(env.action_space.n)), []
    for course in range(arguments.episodes):
        env.reset(seed=arguments.seed + course)
        found.append([*(always(copy(env), chosen) for chosen in planners), most(env)])
    rewards = np.array(found)
    best = int(rewards[:, :-1].mean(axis=0).argmax())
    for index, name in enumerate(
        [*(f"always planner {chosen}" for chosen in planners), "best sequence"]
    ):
        compared(arguments, name, rewards[:, index, None], rewards[:, best, None])


def always(env: TraverseEnv, chosen: int) -> float:
    """Reward of the episode from here on by one planner."""
    total, over = 0.0, False
    while not over:
        _, reward, ended, cut, _ = env.step(np.int64(chosen))
        total, over = total + reward, ended or cut
    return total


def most(env: TraverseEnv) -> float:
    """The greatest reward from here on of any sequence of choices; a planner that failed here fails
    here again.
    """
    assert isinstance(env.action_space, spaces.Discrete)
    values, vain = [], []
    for chosen in range(int(env.action_space.n)):
        twin = copy(env)
        _, reward, ended, cut, info = twin.step(np.int64(chosen))
        if ended or cut or info["feasible"]:
            values.append(reward if ended or cut else reward + most(twin))
        else:
            vain.append(chosen)
    return max(values) if values else max(always(copy(env), chosen) for chosen in vain)


def test_scenes(config: TrainConfig, folder: Path, count: int) -> list[LabelledScene]:
    """Scenes that need cuts, in the shares of the training scenes, from draws of a seed of their
    own.
    """
    share, seed = (
        config.train.feasible / config.train.infeasible,
        max(config.train.seed, config.held_out.seed) + 1,
    )
    rows = 2 * count  # of which at least half need cuts
    plan = LabelPlan(
        distribution=config.problem, feasible=round(share * rows), infeasible=rows, seed=seed
    )
    label(plan, folder)
    cut = open_scenes(scenes_of(Dataset.open(folder)))
    return [cut[index] for index in np.random.default_rng(0).permutation(len(cut))[:count]]


def episodes(
    config: TrainConfig, scenes: Sequence[LabelledScene], policy: Predictor
) -> NDArray[np.float64]:
    """Reward, solves and whether there was a verdict of every scene, shape (scenes, 3)."""
    env = EnvelopeRefinementEnv(config.kind, budget=config.budget, scenes=ListedScenes(scenes))
    return refinement_episodes(policy, env, len(scenes))


def compared(
    arguments: Arguments,
    name: str,
    found: NDArray[np.float64],
    best: NDArray[np.float64],
    **more: float,
) -> None:
    """Print a row of means, and the difference of the rewards to those of the best rule, with
    intervals.
    """
    row: dict[str, object] = {"agent": name, "reward": bootstrapped(found[:, 0])}
    if found.shape[1] > 1:
        row |= {"solves": bootstrapped(found[:, 1]), "verdicts": bootstrapped(found[:, 2])}
    arguments.say(row | {"− best rule": bootstrapped(found[:, 0] - best[:, 0])} | more)


def said(arguments: Arguments, row: Row) -> None:
    """Print a row."""
    arguments.say({"agent": row.agent, **row.figures}, lambda _: line(row))


def learned(
    name: str, config: TrainConfig, scenes: TrainingScenes, arguments: Arguments, folder: Path
) -> tuple[list[tuple[CurvePoint, ...]], list[Predictor], list[float]]:
    """Curve, policy and CPU seconds of every seed; what was stopped goes on, and its seconds are
    those since.
    """
    curves: list[tuple[CurvePoint, ...]] = []
    policies: list[Predictor] = []
    seconds: list[float] = []
    for seed in range(arguments.seeds):
        where, begin = folder / f"{name}-{seed}", time.process_time()
        resume = (where / "checkpoint.npz").exists()
        ended = train(replace(config, seed=seed), where, resume=resume, scenes=scenes)
        curves.append(ended.curve)
        policies.append(ended.policy)
        seconds.append(time.process_time() - begin)
        print(
            f"{name}, seed {seed}:",
            *(f"{p.steps}: {p.reward:.3f}" for p in curves[-1]),
            file=sys.stderr,
            flush=True,
        )
    return curves, policies, seconds


def others(
    config: TrainConfig, scenes: TrainingScenes, seeds: int
) -> dict[str, tuple[list[Predictor], list[float]]]:
    """Agents that do not learn from reward, one a seed where there is chance in them, and what they
    took [CPU-s].
    """
    space, rows = config.shape.spaces[1], scenes.rows
    assert isinstance(space, spaces.Box)
    assert rows is not None
    makers: dict[str, list[Callable[[], Predictor]]] = {
        "random boxes": [partial(RandomBox, space, seed) for seed in range(seeds)],
        **{name: [partial(box, name, rows)] for name in ("heuristic", "quantile", "gradient")},
        "margin gradient": [
            partial(fit_neural, rows, NeuralSettings(seed=seed)) for seed in range(seeds)
        ],
    }
    return {name: timed(each) for name, each in makers.items()}


def box(method: str, rows: Dataset) -> Predictor:
    """One box for all scenes."""
    return FixedSelector(method, fit(method, rows))


def timed(makers: Sequence[Callable[[], Predictor]]) -> tuple[list[Predictor], list[float]]:
    """What they make, and what each took [CPU-s]."""
    made, seconds = [], []
    for make in makers:
        begin = time.process_time()
        made.append(make())
        seconds.append(time.process_time() - begin)
    return made, seconds


def figures(
    config: TrainConfig, scenes: TrainingScenes, agents: list[Predictor]
) -> dict[str, list[float]]:
    """What an agent's seeds come to on the held-out scenes."""
    played = [evaluator(config, scenes.held_out)(agent) for agent in agents]
    ends = [{"reward": reward} | found for reward, found in played]
    return {name: [end[name] for end in ends] for name in ends[0]}


def line(row: Row) -> str:
    """A row for people."""
    cells = [
        f"{name} {np.mean(values):.3f} ± {error(values):.3f}"
        for name, values in row.figures.items()
    ]
    return f"{row.agent:18} " + "   ".join(cells)


def error(values: list[float]) -> float:
    """Standard error of the mean; 0 of one value."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def draw(rows: list[Row], curves: Mapping[str, list[tuple[CurvePoint, ...]]], path: Path) -> None:
    """Held-out reward over steps: every seed thin, their mean thick, the other agents dashed."""
    figure = Figure(figsize=(10, 6), dpi=100)
    axes = figure.add_axes((0.08, 0.11, 0.68, 0.82))
    for colour, (name, each) in zip(("#27407f", "#a3365c"), curves.items(), strict=False):
        steps = [point.steps for point in each[0]]
        rewards = np.array([[point.reward for point in curve] for curve in each])
        for line in rewards:
            axes.plot(steps, line, color=colour, lw=0.8, alpha=0.5)
        axes.plot(
            steps,
            rewards.mean(axis=0),
            color=colour,
            lw=2.4,
            label=f"{name}, mean of {len(each)} seeds",
        )
    for row, colour in zip(rows, ("#66717e", "#e08a2b", "#58a695"), strict=False):
        axes.axhline(float(np.mean(row.figures["reward"])), color=colour, ls="--", label=row.agent)
    axes.set(xlabel="environment steps", ylabel="mean reward an episode, held-out scenes")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    figure.savefig(path)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
