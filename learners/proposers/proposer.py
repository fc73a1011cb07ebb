"""Proposers of postures and proofs for one class of problems: two networks in one file, whom nobody
has to believe.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from torch import Tensor, nn

from stancekit.envs.distributions.postures import Distribution
from stancekit.planners.cached import cached_property
from stancekit.planners.equilibrium.batch import PointBatch, ScaledBatch
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.codec import ALL_KEYS
from stancekit.planners.files.validation import validated
from stancekit.planners.problem import Problem
from stancekit.planners.relaxation.learned import check_learned
from stancekit.planners.search.canonical import Index

from ..selectors.network import CORNERS, Architecture, as_arrays
from ..selectors.tensors import load_weights, read_tensors, write_tensors
from . import proof, witness
from .network import ProposerNetwork
from .scenes import Scenes

FORMAT = "stancekit/proposers/1"
MET = -1e-9
"""A posture is proposed where the network's own sums say that its worst violation is below this."""
PROVED = 1e-5
"""A proof is proposed where they say that it proves this, its multipliers of unit length."""


def networks(architecture: Architecture) -> nn.ModuleDict:
    """Both, untrained, by name."""
    halves = {"postures": witness, "proofs": proof}
    return nn.ModuleDict(
        {
            name: ProposerNetwork(architecture, contact=half.OF_CONTACT, body=half.OF_BODY)
            for name, half in halves.items()
        }
    )


class Proposers:
    """Trained networks that propose for one class of problems; a ``Proposer`` of ``ExactPlanner``.

    Arguments:
        problem_class, legs, robot, force_scale_n, length_scale_m: of the problems that they learned
            from.
        provenance: how.
    """

    def __init__(
        self,
        network: nn.ModuleDict,
        *,
        problem_class: str,
        legs: Sequence[str],
        robot: str,
        force_scale_n: float,
        length_scale_m: float,
        provenance: Mapping[str, Any] | None = None,
    ) -> None:
        self.network = network.eval()
        self.problem_class = problem_class
        self.legs = tuple(legs)
        self.robot = robot
        self.force_scale_n = force_scale_n
        self.length_scale_m = length_scale_m
        self.provenance = dict(provenance or {})

    @cached_property
    def digest(self) -> str:
        """SHA-256 of class and weights: what its proposals follow from."""
        hash_so_far = hashlib.sha256(
            f"{FORMAT} {self.problem_class} {self.legs} {self.robot}".encode()
        )
        for name, tensor in sorted(self.network.state_dict().items()):
            hash_so_far.update(name.encode() + tensor.numpy().tobytes())
        return hash_so_far.hexdigest()

    def check_fits(self, problem: Problem) -> None:
        """Raise InvalidInput unless the problem is of these legs of this robot, on triangles."""
        learned = f"proposers learned for {self.problem_class}"
        check_learned(self, problem, learned)
        for index, contact in enumerate(problem.contacts):
            corners = len(contact.patch.vertices_m)
            if corners != CORNERS:
                raise InvalidInput(
                    f"contacts[{index}].vertices_m: expected {CORNERS} for {learned}, got {corners}"
                )

    def check_drawn(self, source: Distribution) -> None:
        """Raise InvalidInput unless they learned from this distribution, or one of its name and
        robot.
        """
        if source.name != self.problem_class:
            raise InvalidInput(
                f"proposers: expected some for {source.name}, got some for {self.problem_class}"
            )
        self.check_fits(source.sample(np.random.default_rng(0)))

    def postures(self, scaled: ScaledBatch) -> tuple[Index, PointBatch]:
        """Points of the problems for which the network's own sums say that they meet everything."""
        with torch.no_grad():
            scenes = Scenes.of(scaled, torch.float64)
            claims = witness.claims(scenes, *self._said("postures", scenes))
        parts = as_arrays(claims.com, claims.rotation, claims.toes, claims.forces)
        index = np.flatnonzero(claims.violation.amax(dim=1).numpy() < MET)
        return index, PointBatch(
            **dict(zip(("com", "rotation", "toes", "forces"), parts, strict=True))
        ).select(index)

    def proofs(self, scaled: ScaledBatch) -> Array:
        """A proof without moments and one with them, zeros where the network's own sums say that
        they prove nothing.
        """
        with torch.no_grad():
            scenes = Scenes.of(scaled, torch.float64)
            rows = proof.multipliers(*self._said("proofs", scenes)).flip(1)
            rows = rows * (proof.least_values(scenes, rows) > PROVED)[..., None]
        return as_arrays(rows)[0]

    def _said(self, which: str, scenes: Scenes) -> tuple[Tensor, Tensor]:
        """A network's numbers, in double precision from here on."""
        of_contact, of_body = self.network[which](scenes.observed())
        return of_contact.double(), of_body.double()

    def save(self, path: str | Path) -> None:
        """Write both networks as one safetensors file."""
        header = {
            name: getattr(self, name)
            for name in ("problem_class", "robot", "force_scale_n", "length_scale_m", "provenance")
        }
        architecture = asdict(cast(ProposerNetwork, self.network["postures"]).architecture)
        header |= {"legs": list(self.legs), "architecture": architecture}
        write_tensors(path, FORMAT, header, self.network.state_dict())

    @classmethod
    def load(cls, path: str | Path, *, problem_class: str | None = None) -> Proposers:
        """Read proposers.

        Raises InvalidInput for a file that is damaged or foreign, or made for another class.
        """
        header, tensors = read_tensors(path, FORMAT)
        raw = validated(_Header, header, str(path))
        if problem_class not in (None, raw.problem_class):
            raise InvalidInput(
                f"{path}: expected proposers for {problem_class}, got some for {raw.problem_class}"
            )
        with torch.device("meta"):
            network = networks(raw.architecture)
        load_weights(network, tensors, path)
        return cls(
            network,
            problem_class=raw.problem_class,
            legs=raw.legs,
            robot=raw.robot,
            provenance=raw.provenance,
            force_scale_n=raw.force_scale_n,
            length_scale_m=raw.length_scale_m,
        )


class _Header(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)
    problem_class: str
    legs: list[str] = Field(min_length=1)
    robot: str
    force_scale_n: float = Field(gt=0.0)
    length_scale_m: float = Field(gt=0.0)
    architecture: Annotated[Architecture, ALL_KEYS]
    provenance: dict[str, Any]
