"""``stancekit proposers``: train networks that propose postures and proofs."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from stancekit.planners.errors import InvalidInput, not_installed

from .console import emit, out, progress
from .names import DISTRIBUTION, ROBOT, TERRAIN
from .options import OptionalPath, OptionalText


@dataclass
class TrainProposers:
    """Train networks that propose postures and proofs to the verifier, without labels.

    One says a posture of a scene, the other why there is none. Neither is believed: `stancekit
    label --proposers` asks them before any solver, keeps what the verifier accepts, and solves the
    rest.
    """

    problem: Annotated[str, tyro.conf.Positional, DISTRIBUTION]
    """Distribution of scenes on triangles: ground-k or wall-k with k legs, as wall-3; or another
    one's name or file."""
    out: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """Safetensors file to write."""
    robot: Annotated[OptionalText, ROBOT] = None
    """Robot whose legs stand: a .urdf file, or a .yaml file that names one (extra kin); else the
    default hexapod."""
    terrain: Annotated[OptionalPath, TERRAIN] = None
    """Mesh or grid that the scenes of terrain-k are cut from."""
    seed: int = 0
    """Seed of draws and weights."""
    config: OptionalPath = None
    """YAML file with other settings: the keys of `ProposerSettings` in
    learners/proposers/training.py."""
    json: bool = False
    """Print the result as one JSON object."""

    def run(self) -> int:
        """Train, write, and say what share of scenes each settles."""
        from stancekit.planners.files.arrays import checked_int

        try:
            from stancekit.learners.proposers.training import (
                ProposerSettings,
                curve,
                train_proposers,
            )
        except ModuleNotFoundError as error:
            raise not_installed("proposers", error.name, "networks", "rl") from None
        from stancekit.envs.distributions.postures import distribution
        from stancekit.planners.files.documents import read_yaml
        from stancekit.planners.files.validation import validated

        checked_int(self.seed, "--seed", least=0)
        extra: dict[str, Any] = {} if self.config is None else read_yaml(self.config)
        if "seed" in extra:
            raise InvalidInput(f"{self.config}: seed: expected as an option, --seed")
        settings = validated(
            ProposerSettings, {**extra, "seed": self.seed}, str(self.config or "--seed")
        )
        source, begin = (
            distribution(self.problem, robot=self.robot, terrain=self.terrain),
            time.process_time(),
        )
        with progress(f"proposers {self.problem}") as bar:
            proposers = train_proposers(source, settings, bar)
        seconds = time.process_time() - begin
        proposers.save(self.out)
        shares = curve(proposers)
        if self.json:
            emit(
                {
                    "out": str(self.out),
                    "problem_class": proposers.problem_class,
                    "cpu_s": seconds,
                    **shares,
                }
            )
        else:
            summary = ", ".join(f"{name} settle {share:.1%}" for name, share in shares.items())
            out.print(
                f"{self.out}: proposers for {proposers.problem_class}; of held scenes {summary}; "
                f"{seconds:.0f} CPU-s"
            )
        return 0
