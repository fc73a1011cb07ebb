"""Scenes whose footholds are fixed, published ones and those in JSON: surfaces move with their
candidates.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Problem
from stancekit.planners.problem.alternatives import AS_ASKED, Alternative
from stancekit.planners.robot.reach_sets import Sets
from stancekit.planners.terrain.patch import Patch

from .scenario import SURFACE, Grip, Slider

ON_M = 1e-6
"""A candidate so near to a surface, facing as it does, is a piece of it [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedScenario:
    """A course as it is laid out; goal, surfaces, friction and mass can be others.

    Arguments:
        chosen: the surface with a grip.
    """

    laid: Problem
    friction: float | None = None
    mass_kg: float | None = None
    chosen: int | None = None

    @property
    def name(self) -> str:
        """Name of the course."""
        return self.laid.name

    @property
    def robot(self) -> str:
        """None other: its limbs are those of the footholds."""
        return ""

    def sliders(self) -> tuple[Slider, ...]:
        """Friction of all surfaces, and of the picked one; mass, unless the robot's model says
        it.
        """
        most = max(patch.friction for patch in self.laid.terrain)
        result = [
            Slider(
                key="friction",
                label="friction of all surfaces, times",
                unit="",
                low=0.0,
                high=2.0,
                step=0.01,
                value=1.0 if self.friction is None else self.friction,
                hint=f"Of what the file says: {most:.3g} at most.",
            )
        ]
        if not self.laid.robot.source.own:
            mass = self.laid.robot.mass_kg
            result.append(
                Slider(
                    key="mass_kg",
                    label="mass of the robot",
                    unit="kg",
                    low=0.1,
                    high=4.0 * mass,
                    step=0.1,
                    value=mass if self.mass_kg is None else self.mass_kg,
                )
            )
        if self.chosen is not None:
            result.append(
                Slider(
                    key=SURFACE,
                    label="friction of the picked surface",
                    unit="μ",
                    low=0.0,
                    high=1.5,
                    step=0.01,
                    value=self.laid.terrain[self.chosen].friction,
                )
            )
        return tuple(result)

    def grips(self, course: Problem) -> tuple[Grip, ...]:
        """The goal, and the surface that was picked."""
        result = [Grip(key="goal", label="goal", position_m=self.laid.goal_m)]
        if self.chosen is not None:
            at = self.laid.terrain[self.chosen].centre_m
            result.append(Grip(key=SURFACE, label=f"surface {self.chosen}", position_m=at))
        return tuple(result)

    def slid(self, key: str, value: float) -> FixedScenario:
        """Another value of a slider."""
        if key == "friction":
            return replace(self, friction=value)
        if key == "mass_kg":
            return replace(self, mass_kg=value)
        return self._with_surface(lambda patch: patch.with_friction(value))

    def dragged(self, key: str, position_m: Array) -> FixedScenario:
        """Another place of a grip."""
        if key == "goal":
            return replace(self, laid=replace(self.laid, goal_m=position_m))
        if self.chosen is None:
            return self
        by = position_m - self.laid.terrain[self.chosen].centre_m
        return self._with_surface(lambda patch: replace(patch, vertices_m=patch.vertices_m + by))

    def _with_surface(self, change: Callable[[Patch], Patch]) -> FixedScenario:
        """Scenario with the picked surface changed, and with the pieces of it that toes were
        offered.
        """
        assert self.chosen is not None
        surface = self.laid.terrain[self.chosen]
        terrain = [*self.laid.terrain]
        terrain[self.chosen] = change(surface)
        footholds = tuple(
            replace(
                foothold,
                candidates=tuple(
                    change(each) if _is_piece(each, surface) else each
                    for each in foothold.candidates
                ),
                toe_m=_moved(foothold.toe_m, foothold.candidates, surface, terrain[self.chosen]),
            )
            for foothold in self.laid.footholds
        )
        return replace(self, laid=replace(self.laid, terrain=tuple(terrain), footholds=footholds))

    def picked(self, course: Problem, patch: int) -> FixedScenario:
        """Scenario with a grip at this patch."""
        return replace(self, chosen=patch)

    def with_robot(self, robot: str) -> FixedScenario:
        """Raises InvalidInput: footholds are those of one robot."""
        raise InvalidInput(
            f"robot: expected the robot of a course whose footholds are fixed, got {robot}"
        )

    @property
    def layouts(self) -> tuple[Alternative, ...]:
        """The one that there is: its footholds are fixed."""
        return (AS_ASKED,)

    def course(self, sets: Sets = "inner", alternative: Alternative = AS_ASKED) -> Problem:
        """The course with its friction and mass.

        Raises InvalidInput for a mass that is none.
        """
        result = self.laid
        if self.friction is not None:

            def rubbed(patch: Patch, by: float = self.friction) -> Patch:
                return patch.with_friction(by * patch.friction)

            footholds = tuple(
                replace(foothold, candidates=tuple(map(rubbed, foothold.candidates)))
                for foothold in result.footholds
            )
            result = replace(
                result, terrain=tuple(map(rubbed, result.terrain)), footholds=footholds
            )
        if self.mass_kg is not None:
            result = replace(result, robot=replace(result.robot, mass_kg=self.mass_kg))
        return result

    def text(self) -> tuple[str, str]:
        """The JSON form, which has every foothold."""
        return ".json", json.dumps(self.course().to_json(), indent=1) + "\n"


def _is_piece(patch: Patch, surface: Patch) -> bool:
    """Tell whether a patch lies on a surface's plane and within its corners' bounds."""
    if patch is surface:
        return True
    if float(patch.normal @ surface.normal) < 1.0 - 1e-9:
        return False
    if np.abs((patch.vertices_m - surface.vertices_m[0]) @ surface.normal).max() > ON_M:
        return False
    low, high = surface.vertices_m.min(axis=0) - ON_M, surface.vertices_m.max(axis=0) + ON_M
    return bool(np.all((patch.vertices_m >= low) & (patch.vertices_m <= high)))


def _moved(
    toe_m: Array | None, candidates: tuple[Patch, ...], before: Patch, after: Patch
) -> Array | None:
    """Place of a toe that stands already when its surface moved."""
    if toe_m is None or not any(_is_piece(each, before) for each in candidates):
        return toe_m
    return toe_m + (after.centre_m - before.centre_m)
