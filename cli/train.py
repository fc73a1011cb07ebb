"""``stancekit train``: learn by reinforcement."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from stancekit.planners.errors import not_installed

from .console import emit, grid, out, stages
from .options import ROBOT, TERRAIN, OptionalInt, OptionalPath, OptionalText

if TYPE_CHECKING:
    from rich.table import Table

    from stancekit.learners.training.reinforce import Trained


@dataclass
class Train:
    """Train an agent on EnvelopeSelection-v0 or EnvelopeRefinement-v0 by PPO, as a file says.

    The folder gets policy.safetensors (loaded without pickle), checkpoint.npz, curve.jsonl
    (held-out figures after every segment) and the labelled scenes. A run that is stopped, however
    hard, goes on with --resume and ends with the policy that it would have ended with.

      stancekit train configs/train-selection.yaml --out out/ppo
      stancekit train configs/train-selection.yaml --out out/ppo --resume --steps 200000
    """

    config: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """YAML file: environment, problem, steps, seed, train and held_out scenes, ppo;
    configs/train-selection.yaml is one, and "Training" in the reference of keys has all."""
    problem: Annotated[OptionalText, tyro.conf.arg(metavar="NAME")] = None
    """Distribution, instead of the file's."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot whose legs stand, instead of the file's: a .urdf file, or a .yaml file that names
    one."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Mesh or grid that scenes are cut from, instead of the file's."""
    out: Path = Path("out/train")
    """Folder of the run."""
    steps: OptionalInt = None
    """Steps in all, instead of the file's."""
    seed: OptionalInt = None
    """Seed, instead of the file's."""
    resume: bool = False
    """Go on from the folder's checkpoint, or from the labels that it has so far."""
    json: bool = False
    """One JSON object a point of the learning curve."""

    def run(self) -> int:
        """Train and print the learning curve."""
        try:
            from stancekit.learners.training.reinforce import TrainConfig, train
        except ModuleNotFoundError as error:
            raise not_installed("train", error.name, "networks", "rl") from None
        options = {
            "steps": self.steps,
            "seed": self.seed,
            "problem": self.problem,
            "robot": self.robot,
            "terrain": None if self.terrain is None else str(self.terrain),
        }
        config = TrainConfig.from_yaml(
            self.config, {name: value for name, value in options.items() if value is not None}
        )
        with stages(f"train {config.problem}") as bar:
            learned = partial(bar, f"learn: {config.steps} steps")
            trained = train(config, self.out, resume=self.resume, progress=learned, labelling=bar)
        if self.json:
            for point in trained.curve:
                emit(asdict(point))
        else:
            out.print(_curve_table(trained))
            out.print(f"{self.out / 'policy.safetensors'}: {trained.curve[-1].steps} steps")
        return 0


def _curve_table(trained: Trained) -> Table:
    """The learning curve: mean reward an episode on held-out scenes, and further figures."""
    names = list(trained.curve[0].figures)
    columns = {name: {"justify": "right"} for name in ("steps", "reward", *names)}
    rows = (
        (
            str(point.steps),
            f"{point.reward:.3f}",
            *(f"{point.figures[name]:.3f}" for name in names),
        )
        for point in trained.curve
    )
    return grid(columns, rows, title="held-out scenes", title_justify="left", header_style="bold")
