"""What the arguments ``problem``, ``robot``, ``terrain``, ``balanced`` and ``scenes`` of an environment come to."""

from __future__ import annotations

from pathlib import Path

from stancekit.planners.equilibrium.programs import Programs
from stancekit.planners.errors import InvalidInput

from .distributions.postures import Distribution, distribution
from .sampling import SampledScenes
from .scenes import SceneKind, SceneSource


def kind_of(
    problem: str | Distribution | SceneKind, robot: str | Path | None, terrain: str | Path | None
) -> Distribution | SceneKind:
    """A distribution, or what is known of one; by name as ``distribution`` has it. Raises InvalidInput."""
    if not isinstance(problem, SceneKind | Distribution):
        return distribution(problem, robot=robot, terrain=terrain)
    if robot is not None or terrain is not None:
        raise InvalidInput(f"robot, terrain: expected none beside {problem.name}, which has its own")
    return problem


def scenes_of_kind(
    kind: Distribution | SceneKind, scenes: SceneSource | str | Path | None, *, balanced: bool, programs: Programs
) -> SceneSource:
    """The scenes that were given, the part "train" of a data set's folder, or some of a distribution.

    Raises InvalidInput where there are none, and for a folder that is no pool of such scenes.
    """
    if isinstance(scenes, str | Path):
        from .data.scenes import ScenePool  # Arrow takes a while to load

        return ScenePool.open(scenes, of=kind.name, legs=kind.legs, balanced=balanced)
    if scenes is not None:
        return scenes
    if isinstance(kind, SceneKind):
        raise InvalidInput(f"scenes: expected some of {kind.name}, got none")
    return SampledScenes(kind, balanced=balanced, programs=programs)
