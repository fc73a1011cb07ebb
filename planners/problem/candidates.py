"""Candidate patches for toes on a terrain: the nearest surfaces to a wanted toe, within reach of
its shoulder.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import NoPlace
from ..files.arrays import Array
from ..robot.model import Limb
from ..terrain.families import Terrain
from ..terrain.patch import Patch
from ..terrain.polygon import Corners, Surface, nearest, patches_of

_COMFORT = 0.85
"""A nominal toe is at most this share of the limb's reach away from the nominal shoulder."""


_ALIKE_DIGITS = 6
"""Decimals of distances of places that are told apart [m]; of those that are alike the one farther
ahead comes first, then the one farther out."""
_TOUCH_M = 0.01
"""Terrain this close to a toe does not hide its place [m]."""


class NoFooting(NoPlace):
    """A limb has nothing to stand on within its reach wherever the body may be: there is no
    plan.
    """


class CandidatePatches:
    """The surfaces of a terrain that toes may stand on, with spheres about them to sort out the far
    ones.
    """

    def __init__(self, terrain: Terrain, margin_m: float) -> None:
        standing = [
            (name, Surface(patch, max(margin_m - terrain.inset_m, 0.0)))
            for name, patch in terrain.standing
        ]
        self.names = [name for name, surface in standing if not surface.empty]
        self.surfaces = [surface for _, surface in standing if not surface.empty]
        corners = [surface.patch.vertices_m for surface in self.surfaces]
        self._centres = np.array([points.mean(axis=0) for points in corners]).reshape(-1, 3)
        self._radii = np.array(
            [np.linalg.norm(points - points.mean(axis=0), axis=1).max() for points in corners]
        )
        self._normals = np.array([surface.patch.normal for surface in self.surfaces]).reshape(-1, 3)
        most = max([len(surface.room) for surface in self.surfaces], default=0)
        rooms = [
            surface.room[np.minimum(np.arange(most), len(surface.room) - 1)]
            for surface in self.surfaces
        ]
        self._rooms = np.array(rooms).reshape(len(rooms), most, 2)
        self._origins = np.array([surface.patch.centre_m for surface in self.surfaces]).reshape(
            -1, 3
        )
        self._axes = np.array([surface.patch.frame[:, 1:] for surface in self.surfaces]).reshape(
            -1, 3, 2
        )
        each = [Surface(patch, 0.0) for patch in terrain.patches]
        self._all = each
        self._all_normals = np.array([surface.patch.normal for surface in each]).reshape(-1, 3)
        self._all_offsets = np.array(
            [surface.patch.normal @ surface.patch.centre_m for surface in each]
        )

    def near(self, shoulder_m: Array, hip_m: Array, reach_m: float) -> NDArray[np.int_]:
        """Patches that face a hip and may come within reach of a shoulder, in order."""
        away = shoulder_m - self._centres
        heights = np.abs(np.einsum("ij,ij->i", away, self._normals))
        close = np.linalg.norm(away, axis=1) - self._radii <= reach_m
        faces = np.einsum("ij,ij->i", hip_m - self._centres, self._normals) > 0.0
        return np.flatnonzero(close & faces & (heights <= reach_m))

    def candidates(
        self, limb: Limb, shoulder_m: Array, toe_m: Array, count: int, window_m: float
    ) -> list[tuple[int, Patch]]:
        """The nearest surfaces to a wanted toe, by index, and the piece of each about the toe's
        place on it.

        Only surfaces that face the hip, with nothing between it and the toe's place.
        """
        return self.candidates_of([(limb, shoulder_m, toe_m, window_m)], count)[0]

    def candidates_of(
        self, toes: Sequence[tuple[Limb, Array, Array, float]], count: int
    ) -> list[list[tuple[int, Patch]]]:
        """The ``candidates`` of many toes at once.

        Arguments:
            toes: limb, shoulder, toe, and width of the pieces, each as of ``candidates``.
        """
        pieces = list[list[tuple[int, Corners]]]()
        for (limb, shoulder_m, toe_m, window_m), (indices, places) in zip(
            toes, self._places(toes), strict=True
        ):
            hip_m = limb.hip_at(shoulder_m)
            away = np.linalg.norm(places - toe_m, axis=1)
            ahead, aside = places[:, 0], np.abs(places[:, 1] - shoulder_m[1])
            nearest = [np.round(each, _ALIKE_DIGITS) for each in (-aside, -ahead, away)]
            order = np.lexsort((indices, *nearest))
            pieces.append([])
            for index, place in zip(indices[order].tolist(), places[order], strict=True):
                if len(pieces[-1]) == count:
                    break
                if not self._hidden(place, hip_m):
                    piece = self.surfaces[index].piece(place, window_m)
                    if piece:
                        pieces[-1].append((index, piece))
        patches = iter(
            patches_of([(self.surfaces[index], piece) for each in pieces for index, piece in each])
        )
        return [[(index, next(patches)) for index, _ in each] for each in pieces]

    def everywhere(
        self, limb: Limb, shoulder_m: Array, slack_m: float, toe_m: Array
    ) -> list[tuple[int, Patch]]:
        """All within reach of a shoulder that is somewhere within ``slack_m`` of here, the nearest
        to a toe first, clipped to squares that hold it.

        What faces away from all of these places is none; what other terrain hides is not left out.
        """
        reach_m, hip_m = limb.reach_m + slack_m, limb.hip_at(shoulder_m)
        pieces = list[tuple[float, int, Patch]]()
        for index in np.flatnonzero(
            np.linalg.norm(shoulder_m - self._centres, axis=1) - self._radii <= reach_m
        ):
            surface = self.surfaces[index]
            height = surface.height(shoulder_m)
            faces = surface.height(hip_m) > -slack_m
            if (
                not faces
                or abs(height) > reach_m
                or np.linalg.norm(surface.nearest(shoulder_m) - shoulder_m) > reach_m
            ):
                continue
            piece = surface.window(shoulder_m, 2.0 * float(np.sqrt(reach_m**2 - height**2)))
            if piece is not None:
                pieces.append(
                    (float(np.linalg.norm(surface.nearest(toe_m) - toe_m)), int(index), piece)
                )
        return [(index, piece) for _, index, piece in sorted(pieces, key=lambda each: each[:2])]

    def _places(
        self, toes: Sequence[tuple[Limb, Array, Array, float]]
    ) -> list[tuple[NDArray[np.int_], Array]]:
        """For every wanted toe the surfaces within reach, by index, and the place on each, shape
        (K, 3).

        The nearest point, drawn towards the shoulder until well in reach.
        """
        nearby = [
            self.near(shoulder, limb.hip_at(shoulder), limb.reach_m)
            for limb, shoulder, _, _ in toes
        ]
        if not any(len(each) for each in nearby):
            return [(each, np.zeros((0, 3))) for each in nearby]
        counts = [len(each) for each in nearby]
        near = np.concatenate(nearby)
        shoulder_m = np.repeat([shoulder for _, shoulder, _, _ in toes], counts, axis=0)
        toe_m = np.repeat([toe for _, _, toe, _ in toes], counts, axis=0)
        reach = np.repeat([limb.reach_m for limb, _, _, _ in toes], counts)
        feet, places = self._nearest(near, shoulder_m), self._nearest(near, toe_m)
        arm, way, comfort = feet - shoulder_m, places - feet, _COMFORT * reach
        gap = np.linalg.norm(arm, axis=1)
        a, b, c = (
            (way * way).sum(axis=1),
            (arm * way).sum(axis=1),
            (arm * arm).sum(axis=1) - comfort**2,
        )
        share = (-b + np.sqrt(np.maximum(b * b - a * c, 0.0))) / np.maximum(
            a, 1e-300
        )  # ‖arm + s·way‖ = comfort
        share = np.where(np.linalg.norm(places - shoulder_m, axis=1) <= comfort, 1.0, share)
        places = np.where((share < 1.0)[:, None], feet + share[:, None] * way, places)
        places = np.where((gap >= comfort)[:, None], feet, places)
        ends = np.cumsum(counts)[:-1]
        return [
            (indices[reached], at[reached])
            for indices, at, reached in zip(
                nearby, np.split(places, ends), np.split(gap <= reach, ends), strict=True
            )
        ]

    def _nearest(self, chosen: NDArray[np.int_], points_m: Array) -> Array:
        """The points of K surfaces, inside the margin, each nearest to a point, shapes (K, 3)
        [m].
        """
        origins, axes = self._origins[chosen], self._axes[chosen]
        flat = np.matmul((points_m - origins)[:, None], axes)[:, 0]
        on = nearest(self._rooms[chosen], flat)
        return np.asarray(origins + np.matmul(on[:, None], axes.transpose(0, 2, 1))[:, 0])

    def _hidden(self, place_m: Array, hip_m: Array) -> bool:
        """Tell whether terrain lies between a hip and a place for its toe."""
        here, there = (self._all_normals @ point - self._all_offsets for point in (hip_m, place_m))
        way = float(np.linalg.norm(place_m - hip_m))
        crossed = (here * there < 0.0) & (np.abs(there) * way > _TOUCH_M * np.abs(here - there))
        for index in np.flatnonzero(crossed):
            point = hip_m + here[index] / (here[index] - there[index]) * (place_m - hip_m)
            if self._all[index].covers(point):
                return True
        return False

    def refusal(self, frame: int, limb: Limb, shoulder_m: Array) -> str:
        """Why a limb has nowhere to stand."""
        where = f"frame {frame}, limb {limb.name}"
        if not self.surfaces:
            return f"{where}: expected a surface to stand on, got none that is left inside candidates.margin_m"
        gaps = [
            float(np.linalg.norm(surface.nearest(shoulder_m) - shoulder_m))
            for surface in self.surfaces
        ]
        best = int(np.argmin(gaps))
        surface, message = self.surfaces[best], ""
        if gaps[best] <= limb.reach_m:
            faces = surface.height(limb.hip_at(shoulder_m)) > 0.0
            message = ", which other terrain hides" if faces else ", which faces away"
        place = ", ".join(f"{value:.3g}" for value in shoulder_m)
        return (
            f"{where}: expected a surface within its reach of {limb.reach_m:g} m of its shoulder "
            f"at ({place}), the "
            f"nearest is {gaps[best]:.3g} m away ({self.names[best]}{message})"
        )
