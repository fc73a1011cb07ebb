"""Other ways to lay a course out: wider, lower or higher stances, more candidates, another order of
the limbs.

None is better everywhere. Where the legs cannot do a plan over one, another often has one that they
can: which, is known from a list of robots and grounds.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ..robot.model import Robot
from .course_keys import CourseSpec, StanceSpec, toe_offset


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """One way to lay a course out, beside the one that its description asks for.

    Arguments:
        spread: horizontal distance of the toes from the centre of mass as the robot stands, as a
            factor.
        height: height of the body over the toes as the robot stands, as a factor.
        candidates: further candidates per foothold.
        near_toes: whether toes are drawn to where they are as the robot stands, where the description
            says so.
        level: whether the tilt limit is 0: inner sets of legs, which shrink with it, are larger
            then.
        gait: "wave" moves one limb after the other, along one side and then the other, each from
            the rear to the front; None keeps the gait.
        striding: whether legs step over what is in their way, as for ``guide_path``: footholds may be
            farther from where toes like to be, and contacts are searched anew with room for legs
            beside walls.
        free: factor on how far the body may be from its nominal path, and on the longest steps.
    """

    spread: float = 1.0
    height: float = 1.0
    candidates: int = 0
    near_toes: bool = True
    level: bool = False
    gait: Literal["wave"] | None = None
    striding: bool = False
    free: float = 1.0

    def of(self, spec: CourseSpec, robot: Robot, *, mirrored: bool = False) -> CourseSpec:
        """The description with these changes.

        Arguments:
            robot: the robot whose limbs are placed.
            mirrored: whether the right side moves first, not the left.
        """
        update: dict[str, object] = {}
        if (self.spread, self.height) != (1.0, 1.0):
            scale = np.array([self.spread, self.spread, self.height])
            limbs = {
                limb.name: tuple((scale * toe - limb.shoulder_m).tolist())
                for limb in robot.limbs
                for toe in [limb.shoulder_m + toe_offset(limb, spec.stance)]
            }
            update["stance"] = StanceSpec(limbs=limbs)
        if self.candidates:
            count = min(spec.candidates.count + self.candidates, 16)
            update["candidates"] = spec.candidates.model_copy(update={"count": count})
        if not self.near_toes:
            update["weights"] = spec.weights.model_copy(update={"stance": 0.0})
        if self.level:
            update["body"] = spec.level()
        if self.gait is not None:
            left = -1.0 if mirrored else 1.0
            order = sorted(
                robot.limbs, key=lambda limb: (left * limb.shoulder_m[1] < 0.0, limb.shoulder_m[0])
            )
            update["gait"] = [[limb.name] for limb in order]
        return spec.model_copy(update=update)

    @property
    def message(self) -> str:
        """The changes in words; empty where there are none."""
        parts = [
            f"toes {self.spread:g} × as far out" if self.spread != 1.0 else "",
            f"body {self.height:g} × as high" if self.height != 1.0 else "",
            f"{self.candidates} more candidates per foothold" if self.candidates else "",
            "" if self.near_toes else "toes wherever they may be",
            "body level" if self.level else "",
            "one limb after the other, side by side" if self.gait else "",
            "legs step over what the trunk gets over" if self.striding else "",
            f"steps {self.free:g} × as long" if self.free != 1.0 else "",
        ]
        return ", ".join(filter(None, parts))


AS_ASKED = Alternative()
HIGHER = Alternative(height=1.15)
"""The layout that is tried first where a foot alone stays from its path: its leg has no room to
lift it."""
KNEES_BENT = Alternative(height=0.92)
"""The layout that is tried first after that which was asked for where feet are soles: knees that are
bent more have room for soles that lean."""

STRIDES = (
    Alternative(striding=True, free=2.0),
    Alternative(striding=True, free=2.0, height=1.15),
    Alternative(striding=True, free=2.0, spread=1.15, height=0.8),
    Alternative(striding=True),
    Alternative(striding=True, height=1.15),
)
"""The layouts that are tried last between two places: in long steps, with a body that goes ahead of
its feet or stays behind them, and in usual ones, which come first, before all others, where there
are walls and legs that go through something."""
LOW = (
    Alternative(height=0.7),
    Alternative(height=0.6),
    Alternative(spread=1.5, height=0.5),
    Alternative(spread=1.65, height=0.4),
)
"""The layouts that are tried last where the first has no way, and first where it would fit below what
bars its way if it stood lower: of knees that stick out, wide ones alone are low."""
ALTERNATIVES = (
    AS_ASKED,
    Alternative(spread=1.15, height=0.85),
    Alternative(spread=1.08),
    Alternative(near_toes=False),
    Alternative(candidates=2),
    Alternative(level=True),
    Alternative(gait="wave"),
    Alternative(spread=1.15, height=1.08, candidates=2),
    HIGHER,
)
"""The layouts that there are; the first is tried first."""
LEANING = (
    Alternative(spread=1.25, height=0.8),
    AS_ASKED,
    Alternative(spread=0.9, height=0.8),
    Alternative(spread=0.9, height=0.8, near_toes=False),
    Alternative(spread=1.15),
)
"""The layouts that are looked at first on steep ground: legs of low ones have room uphill and length
downhill, and those of wide ones stand firmly."""
TABLE = Path(__file__).with_name("layouts.json")
"""By what is missing over the first layout, the others with their successes there, in the order in
which each next one adds most: ``benchmarks/stands.py layouts``."""
Missing = Literal["contacts", "body"]
"""No plan of contacts was found, or one that the legs cannot do."""


def ordered(layouts: Iterable[Alternative], missing: Missing) -> list[Alternative]:
    """Sort layouts in the order that the table of successes gives; those that it does not have come
    last as they are.
    """
    names = [row["layout"] for row in json.loads(TABLE.read_text(encoding="utf-8"))[missing]]
    places = {name: place for place, name in enumerate(names)}
    return sorted(layouts, key=lambda each: places.get(each.message, len(places)))
