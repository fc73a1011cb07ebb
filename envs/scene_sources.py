"""Scene source that the arguments ``problem``, ``robot``, ``terrain``, ``balanced`` and ``scenes``
of an environment ask for.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput
from stancekit.planners.problem.posture_batch import Sampler

from .distributions.postures import Distribution, distribution_of
from .sampling import SampledScenes
from .scenes import SceneKind, SceneSource

ProblemSource = str | Sampler | SceneKind
"""A distribution by name or as it is, as ``label`` takes it, or the kind of scenes that come from
elsewhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneSettings:
    """Keywords of the environments beside their problem: where scenes are from, and whether margins
    are measured; the page of ``EnvelopeSelectionEnv`` has their meaning.
    """

    robot: str | Path | None = None
    terrain: str | Path | None = None
    balanced: bool = True
    scenes: SceneSource | str | Path | None = None
    margins: bool = False

    def __post_init__(self) -> None:
        if (
            self.scenes is not None
            and not isinstance(self.scenes, str | Path)
            and not self.balanced
        ):
            raise InvalidInput(
                "balanced: expected True beside a source of scenes, which draws as it likes, got "
                "False"
            )

    def kind(self, problem: ProblemSource) -> Distribution | SceneKind:
        """The distribution, or what is known of one; by name as ``distribution`` has it.

        Raises InvalidInput.
        """
        if not isinstance(problem, SceneKind):
            return distribution_of(problem, robot=self.robot, terrain=self.terrain)
        if self.robot is not None or self.terrain is not None:
            raise InvalidInput(
                f"robot, terrain: expected none beside {problem.name}, which has its own"
            )
        return problem

    def source(self, kind: Distribution | SceneKind, programs: Programs) -> SceneSource:
        """The scenes that were given, the part "train" of a data set's folder, or some of a
        distribution.

        Raises InvalidInput where there are none, and for a folder that is no pool of such scenes.
        """
        if isinstance(self.scenes, str | Path):
            from .data.scenes import ScenePool  # Arrow takes a while to load

            return ScenePool.open(self.scenes, of=kind.name, legs=kind.legs, balanced=self.balanced)
        if self.scenes is not None:
            return self.scenes
        if isinstance(kind, SceneKind):
            raise InvalidInput(f"scenes: expected some of {kind.name}, got none")
        return SampledScenes(kind, balanced=self.balanced, programs=programs)
