"""Where toes may stand on a terrain: the nearest surfaces to a wanted toe, within reach of its shoulder."""

from __future__ import annotations

import numpy as np

from ..files.arrays import Array
from ..robot.model import Limb
from ..terrain.patch import Patch
from ..terrain.polygon import Surface
from .course_terrain import Terrain

COMFORT = 0.85
"""A nominal toe is at most this share of the limb's reach away from the nominal shoulder."""


TOUCH_M = 0.01
"""Terrain this close to a toe does not hide its place [m]."""


class Footing:
    """The surfaces of a terrain that toes may stand on, with spheres about them to sort out the far ones."""

    def __init__(self, terrain: Terrain, margin_m: float) -> None:
        each = [Surface(patch, margin_m) for patch in terrain.patches]
        self.numbers = [i for i, surface in enumerate(each) if terrain.footing[i] and not surface.empty]
        self.surfaces = [each[i] for i in self.numbers]
        corners = [surface.patch.vertices_m for surface in self.surfaces]
        self._centres = np.array([points.mean(axis=0) for points in corners]).reshape(-1, 3)
        self._radii = np.array([np.linalg.norm(points - points.mean(axis=0), axis=1).max() for points in corners])
        self._normals = np.array([surface.patch.normal for surface in self.surfaces]).reshape(-1, 3)
        self._all = each
        self._all_normals = np.array([surface.patch.normal for surface in each]).reshape(-1, 3)
        self._all_offsets = np.array([surface.patch.normal @ surface.patch.centre_m for surface in each])

    def near(self, point_m: Array, reach_m: float) -> list[int]:
        """Those that face a point and may come within reach of it, in order."""
        away = point_m - self._centres
        heights = np.einsum("ij,ij->i", away, self._normals)
        close = np.linalg.norm(away, axis=1) - self._radii <= reach_m
        return np.flatnonzero(close & (heights > 0.0) & (heights <= reach_m)).tolist()

    def candidates(
        self, limb: Limb, shoulder_m: Array, toe_m: Array, count: int, window_m: float
    ) -> list[tuple[int, Patch]]:
        """The nearest surfaces to a wanted toe, by index, and the piece of each about the toe's place on it.

        Only surfaces that face the shoulder, with nothing between it and the toe's place.
        """
        found = []
        for index in self.near(shoulder_m, limb.reach_m):
            place = _place(self.surfaces[index], limb, shoulder_m, toe_m)
            if place is not None:
                found.append((float(np.linalg.norm(place - toe_m)), index, place))
        found.sort(key=lambda item: item[:2])
        pieces = list[tuple[int, Patch]]()
        for _, index, place in found:
            if len(pieces) == count:
                break
            piece = None if self._hidden(place, shoulder_m) else self.surfaces[index].window(place, window_m)
            if piece is not None:
                pieces.append((index, piece))
        return pieces

    def _hidden(self, place_m: Array, shoulder_m: Array) -> bool:
        """Whether terrain lies between a shoulder and a place for its toe."""
        here, there = (self._all_normals @ point - self._all_offsets for point in (shoulder_m, place_m))
        way = float(np.linalg.norm(place_m - shoulder_m))
        crossed = (here * there < 0.0) & (np.abs(there) * way > TOUCH_M * np.abs(here - there))
        for index in np.flatnonzero(crossed):
            point = shoulder_m + here[index] / (here[index] - there[index]) * (place_m - shoulder_m)
            if self._all[index].covers(point):
                return True
        return False

    def refusal(self, frame: int, limb: Limb, shoulder_m: Array) -> str:
        """Why a limb has nowhere to stand."""
        where = f"frame {frame}, limb {limb.name}"
        if not self.surfaces:
            return f"{where}: expected a surface to stand on, got none that is left inside candidates.margin_m"
        gaps = [float(np.linalg.norm(surface.nearest(shoulder_m) - shoulder_m)) for surface in self.surfaces]
        best = int(np.argmin(gaps))
        surface, told = self.surfaces[best], ""
        if gaps[best] <= limb.reach_m:
            told = ", which faces away" if surface.height(shoulder_m) <= 0.0 else ", which other terrain hides"
        place = ", ".join(f"{value:.3g}" for value in shoulder_m)
        return (
            f"{where}: expected a surface within its reach of {limb.reach_m:g} m of its shoulder at ({place}), the "
            f"nearest is {gaps[best]:.3g} m away (terrain patch {self.numbers[best]}{told})"
        )


def _place(surface: Surface, limb: Limb, shoulder_m: Array, toe_m: Array) -> Array | None:
    """The place on a surface for a wanted toe: the nearest point, drawn towards the shoulder until well in reach.

    None where the surface is out of the shoulder's reach.
    """
    foot, place = surface.nearest(shoulder_m), surface.nearest(toe_m)
    gap, comfort = float(np.linalg.norm(foot - shoulder_m)), COMFORT * limb.reach_m
    if gap > limb.reach_m:
        return None
    if gap >= comfort:
        return foot
    if np.linalg.norm(place - shoulder_m) <= comfort:
        return place
    way, arm = place - foot, foot - shoulder_m  # ‖arm + s·way‖ = comfort, 0 < s < 1
    a, b, c = way @ way, arm @ way, arm @ arm - comfort**2
    return np.asarray(foot + (-b + np.sqrt(b * b - a * c)) / a * way)
