"""Test of whether toes find their footholds on a ground that is known from noisy heights.

Grounds are drawn from the certainty of the patches that toes stand on: each surface's plane by its
covariance, one draw for all of its toes, the ground off it at each toe by its roughness, and its
edge at each toe by its deviation. A foot comes down until it feels, as far beyond its place as
``motion.touch_down`` says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..answer.plan import Plan
from ..answer.report import Group
from ..files.arrays import Array
from ..motion.touch_down import touch_downs_m
from ..terrain.certainty import Certainty
from ..terrain.patch import Patch
from ..terrain.polygon import half_planes
from .ground import certainty_under

DRAWS = 200
SHARE = 0.95
"""Share of the grounds drawn, those on which every toe has to find its foothold."""
SEED = 46
"""The same grounds are drawn each time, so that a file is judged as its plan was."""


def ground_group(plan: Plan) -> Group | None:
    """The share of grounds on which some toe misses its foothold; None where no patch says how sure
    it is.
    """
    course = plan.problem
    patches = [course.patch(p, plan.choice) for p in range(len(course.footholds))]
    sure = [
        (p, *known)
        for p, patch in enumerate(patches)
        if (known := _known(course.terrain, patch, plan.toes_m[p])) is not None
    ]
    if not sure:
        return None
    depths_m = touch_downs_m(plan)
    draws = np.random.default_rng(SEED)
    planes = dict[tuple[bytes, bytes], Array]()
    missed, deviations = np.zeros((len(sure), DRAWS), dtype=bool), np.zeros(len(sure))
    for row, (p, certainty, from_edge) in enumerate(sure):
        key = certainty.covariance.tobytes(), certainty.about_m.tobytes()
        if key not in planes:
            planes[key] = draws.standard_normal((DRAWS, 3)) @ _root(certainty).T
        place, upward = plan.toes_m[p, :2], patches[p].normal[2]
        local = certainty.rough_m * draws.standard_normal(DRAWS)
        off = upward * np.abs(planes[key] @ certainty.levers(place) + local)
        deviations[row] = upward * float(certainty.height_sd_m(place))
        beyond = certainty.edge_sd_m * draws.standard_normal(DRAWS) > from_edge
        missed[row] = (off > depths_m[p]) | beyond
    share, worst = float(missed.any(axis=0).mean()), int(missed.sum(axis=1).argmax())
    foothold = course.footholds[sure[worst][0]]
    text = f"{foothold.limb} at frame {foothold.frame}: every toe finds its foothold on {1.0 - share:.1%} of the grounds drawn"
    return Group(
        "ground",
        value=share,
        limit=1.0 - SHARE,
        unit="1",
        where=foothold.limb,
        limb=foothold.limb,
        when=float(foothold.frame),
        message=f"{text}, expected {SHARE:.0%}" if share > 1.0 - SHARE else "",
        figures={
            "found_share": 1.0 - share,
            "grounds": DRAWS,
            "height_sd_m": float(deviations.max()),
            "touch_down_m": float(depths_m.max()),
        },
    )


def _known(terrain: Sequence[Patch], patch: Patch, toe_m: Array) -> tuple[Certainty, float] | None:
    """The certainty of the ground under a toe, as terrain and patch say it, and the distance of the
    toe from where its edge most likely is [m]; None where it is exact.

    What the terrain says goes before what a plan says that may be of another hand.
    """
    sure, under = patch.certainty, certainty_under(terrain, patch, toe_m)
    if under is None:
        return None if sure is None else (sure, sure.inset_m + _from_border(patch, toe_m))
    rough_m = max(under[0].rough_m, 0.0 if sure is None else sure.rough_m)
    return replace(under[0], rough_m=rough_m), under[1]


def _from_border(patch: Patch, toe_m: Array) -> float:
    """Distance of a toe inside the border of its patch, 0 outside [m]."""
    axes = patch.frame[:, 1:]
    normals, offsets = half_planes((patch.vertices_m - patch.centre_m) @ axes)
    return max(float((offsets - normals @ ((toe_m - patch.centre_m) @ axes)).min()), 0.0)


def _root(certainty: Certainty) -> Array:
    """A matrix whose square is the covariance, shape (3, 3)."""
    values, vectors = np.linalg.eigh(certainty.covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
