"""Reinforcement on both environments: learning curves over several seeds, against agents that do not learn.

    python benchmarks/reinforce.py selection  [--seeds 3] [--steps 40960] [--out out/reinforce] [--json]
    python benchmarks/reinforce.py refinement [--seeds 3] [--steps 16384] [--out out/reinforce] [--json]

The runs are those of configs/train-<name>.yaml but for seed and PPO's steps; for selection those of
configs/train-paired.yaml, too, from whose scenes all agents learn there. All are evaluated on the same held-out scenes
by the same function. selection: mean reward and P1's shares, against random boxes, the heuristic, quantile and gradient
box, and the neural selector (margin gradient). refinement: solves to the end of an episode and the share that ends with
a verdict, against branching on the largest gap, on the widest dimension and at random. CPU-s: of learning, with the
evaluations of the curve. ± is the standard error over the seeds. Runs that a kill stopped go on. The curves are drawn
to <out>/<name>.png.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from _bench import Options, launch
from gymnasium import spaces
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stancekit.envs.branching import LargestGap, RandomDimension, WidestDimension
from stancekit.envs.data.dataset import Dataset
from stancekit.envs.memoryless import MemorylessPolicy, Observation
from stancekit.learners.selectors.neural import fit_neural
from stancekit.learners.selectors.neural_training import NeuralSettings
from stancekit.learners.selectors.selector import FixedSelector, Selector
from stancekit.learners.training.envelope_methods import fit
from stancekit.learners.training.held_out import CurvePoint, TrainingScenes, evaluator
from stancekit.learners.training.reinforce import train
from stancekit.learners.training.train_config import TrainConfig

CONFIGS = Path(__file__).parents[1] / "configs"


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

    name: Annotated[Literal["selection", "refinement"], tyro.conf.Positional]
    seeds: int = 3
    steps: int | None = None
    out: Path = Path("out/reinforce")


def main(arguments: Arguments) -> None:
    """Train, compare, print, draw."""
    config = TrainConfig.from_yaml(CONFIGS / f"train-{arguments.name}.yaml")
    runs = {"PPO": replace(config, steps=arguments.steps or config.steps)}
    if arguments.name == "selection":
        paired = TrainConfig.from_yaml(CONFIGS / "train-paired.yaml")
        runs = {"paired": paired, "PPO": replace(runs["PPO"], train=paired.train, held_out=paired.held_out)}
    config, folder = runs["PPO"], arguments.out / arguments.name
    scenes = TrainingScenes.label(config, folder / "data")
    rows = []
    for name, (agents, seconds) in others(config, scenes, arguments.seeds).items():
        rows.append(Row(agent=name, figures=figures(config, scenes, agents) | {"CPU-s": seconds}))
        said(arguments, rows[-1])
    curves = {}
    for name, its in runs.items():
        curves[name], seconds = learned(name, its, scenes, arguments, folder)
        for when, index in (("untrained", 0), ("trained", -1)):
            ends = [point_figures(curve[index]) for curve in curves[name]]
            row = Row(agent=f"{name} {when}", figures={key: [end[key] for end in ends] for key in ends[0]})
            rows.append(replace(row, figures=row.figures | {"CPU-s": seconds}) if index else row)
            said(arguments, rows[-1])
    draw(rows, curves, arguments.out / f"{arguments.name}.png")


def said(arguments: Arguments, row: Row) -> None:
    """Print a row."""
    arguments.say({"agent": row.agent, **row.figures}, lambda _: line(row))


def learned(
    name: str, config: TrainConfig, scenes: TrainingScenes, arguments: Arguments, folder: Path
) -> tuple[list[tuple[CurvePoint, ...]], list[float]]:
    """The curve and the CPU seconds of every seed; what was stopped goes on, and its seconds are those since."""
    curves, seconds = [], []
    for seed in range(arguments.seeds):
        where, begin = folder / f"{name}-{seed}", time.process_time()
        resume = (where / "checkpoint.safetensors").exists()
        curves.append(train(replace(config, seed=seed), where, resume=resume, scenes=scenes).curve)
        seconds.append(time.process_time() - begin)
        said_points = ", ".join(f"{point.steps}: {point.reward:.3f}" for point in curves[-1])
        print(f"{name}, seed {seed}: {said_points}", file=sys.stderr, flush=True)
    return curves, seconds


def others(config: TrainConfig, scenes: TrainingScenes, seeds: int) -> dict[str, tuple[list[Selector], list[float]]]:
    """Agents that do not learn from reward, one a seed where there is chance in them, and what they took [CPU-s]."""
    if not config.shape.selects:
        return {
            "random dimension": ([RandomDimension(np.random.default_rng(seed)) for seed in range(seeds)], [0.0]),
            "widest dimension": ([WidestDimension()], [0.0]),
            "largest gap": ([LargestGap()], [0.0]),
        }
    space, rows = config.shape.spaces[1], scenes.rows
    assert isinstance(space, spaces.Box)
    assert rows is not None
    makers: dict[str, list[Callable[[], Selector]]] = {
        "random boxes": [partial(RandomBox, space, seed) for seed in range(seeds)],
        **{name: [partial(box, name, rows)] for name in ("heuristic", "quantile", "gradient")},
        "margin gradient": [partial(fit_neural, rows, NeuralSettings(seed=seed)) for seed in range(seeds)],
    }
    return {name: timed(each) for name, each in makers.items()}


def box(method: str, rows: Dataset) -> Selector:
    """One box for all scenes."""
    return FixedSelector(method, fit(method, rows))


def timed(makers: Sequence[Callable[[], Selector]]) -> tuple[list[Selector], list[float]]:
    """What they make, and what each took [CPU-s]."""
    made, seconds = [], []
    for make in makers:
        begin = time.process_time()
        made.append(make())
        seconds.append(time.process_time() - begin)
    return made, seconds


def figures(config: TrainConfig, scenes: TrainingScenes, agents: list[Selector]) -> dict[str, list[float]]:
    """What an agent's seeds come to on the held-out scenes."""
    ends = []
    for agent in agents:
        reward, found = evaluator(config, scenes.held_out)(agent)
        ends.append({"reward": reward} | found)
    return {name: [end[name] for end in ends] for name in ends[0]}


def point_figures(point: CurvePoint) -> dict[str, float]:
    """A point of a curve as figures."""
    return {"reward": point.reward, **point.figures}


def line(row: Row) -> str:
    """A row for people."""
    cells = [f"{name} {np.mean(values):.3f} ± {error(values):.3f}" for name, values in row.figures.items()]
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
        axes.plot(steps, rewards.mean(axis=0), color=colour, lw=2.4, label=f"{name}, mean of {len(each)} seeds")
    for row, colour in zip(rows, ("#66717e", "#e08a2b", "#58a695"), strict=False):
        axes.axhline(float(np.mean(row.figures["reward"])), color=colour, ls="--", label=row.agent)
    axes.set(xlabel="environment steps", ylabel="mean reward an episode, held-out scenes")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    figure.savefig(path)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
