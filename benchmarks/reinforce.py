"""Reinforcement on both environments: learning curves over several seeds, against agents that do not learn.

    python benchmarks/reinforce.py selection  [--seeds 3] [--steps 40960] [--out out/reinforce] [--json]
    python benchmarks/reinforce.py refinement [--seeds 3] [--steps 16384] [--out out/reinforce] [--json]

The runs are those of configs/train-<name>.yaml but for seed and steps. All agents are evaluated on the same held-out
scenes by the same function. selection: mean reward and P1's shares, against the heuristic and the quantile envelope
and random boxes. refinement: solves to the end of an episode and the share that ends with a verdict, against branching
on the largest gap, on the widest dimension and at random. ± is the standard error over the seeds. Runs that a kill
stopped go on. The curves are drawn to <out>/<name>.png.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
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
from stancekit.learners.selectors.selector import FixedSelector, Selector
from stancekit.learners.training.envelope_methods import fit
from stancekit.learners.training.reinforce import CurvePoint, TrainingScenes, evaluator, train
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
    config = replace(config, steps=arguments.steps or config.steps)
    folder = arguments.out / arguments.name
    scenes = TrainingScenes.label(config, folder / "data")
    rows = [Row(agent=name, figures=figures(config, scenes, agents)) for name, agents in others(config, folder).items()]
    for row in rows:
        arguments.say({"agent": row.agent, **row.figures}, lambda _, row=row: line(row))
    curves = []
    for seed in range(arguments.seeds):
        where = folder / f"seed-{seed}"
        seeded = replace(config, seed=seed)
        resume = (where / "checkpoint.safetensors").exists()
        curves.append(train(seeded, where, resume=resume, scenes=scenes).curve)
        print(f"seed {seed}: " + ", ".join(f"{point.steps}: {point.reward:.3f}" for point in curves[-1]), flush=True)
    for when, index in (("untrained", 0), ("trained", -1)):
        ends = [point_figures(curve[index]) for curve in curves]
        row = Row(agent=f"PPO {when}", figures={name: [end[name] for end in ends] for name in ends[0]})
        rows.append(row)
        arguments.say({"agent": row.agent, **row.figures}, lambda _, row=row: line(row))
    draw(rows, curves, arguments.out / f"{arguments.name}.png")


def others(config: TrainConfig, folder: Path) -> dict[str, list[Selector]]:
    """Agents that do not learn from reward, one a seed where there is chance in them."""
    if not config.shape.selects:
        return {
            "random dimension": [RandomDimension(np.random.default_rng(seed)) for seed in range(3)],
            "widest dimension": [WidestDimension()],
            "largest gap": [LargestGap()],
        }
    dataset = Dataset.open(folder / "data" / "train")
    space = config.shape.spaces[1]
    assert isinstance(space, spaces.Box)
    return {
        "random boxes": [RandomBox(space, seed) for seed in range(3)],
        "heuristic": [FixedSelector("heuristic", fit("heuristic", dataset))],
        "quantile": [FixedSelector("quantile", fit("quantile", dataset))],
    }


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


def draw(rows: list[Row], curves: list[tuple[CurvePoint, ...]], path: Path) -> None:
    """Held-out reward over steps: every seed thin, their mean thick, the other agents dashed."""
    figure = Figure(figsize=(10, 6), dpi=100)
    axes = figure.add_axes((0.08, 0.11, 0.68, 0.82))
    steps = [point.steps for point in curves[0]]
    rewards = np.array([[point.reward for point in curve] for curve in curves])
    for line in rewards:
        axes.plot(steps, line, color="#27407f", lw=0.8, alpha=0.5)
    axes.plot(steps, rewards.mean(axis=0), color="#27407f", lw=2.4, label=f"PPO, mean of {len(curves)} seeds")
    for row, colour in zip(rows, ("#66717e", "#e08a2b", "#58a695"), strict=False):
        axes.axhline(float(np.mean(row.figures["reward"])), color=colour, ls="--", label=row.agent)
    axes.set(xlabel="environment steps", ylabel="mean reward an episode, held-out scenes")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)
    figure.savefig(path)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
