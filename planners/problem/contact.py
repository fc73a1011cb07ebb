"""Contacts of limbs with patches, which a problem of one frame is made from, and the candidate
patches of a toe on a terrain: the nearest surfaces within reach of its shoulder.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import cached_property
from ..errors import InvalidInput, NoPlace
from ..files.arrays import (
    Array,
    checked,
    checked_members,
    checked_name,
    collect_errors,
    cross,
    read_only,
)
from ..files.codec import INLINE, LATER, Within, check_limits, fields_to_json
from ..files.documents import shown
from ..robot.model import Limb, ReachRows
from ..terrain.families import Terrain
from ..terrain.patch import Patch
from ..terrain.polygon import (
    Corners,
    Surface,
    checked_sole,
    nearest,
    patches_of,
    sole_offsets,
    sole_region,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Foothold:
    """One toe put down: by ``limb``, at key frame ``frame``, on one of the candidates.

    Arguments:
        toe_m: position of a toe that stands already, shape (3,) [m]; None if the planner chooses.
        candidates: patches to choose from, at least one; a toe that already stands has exactly one,
            the surface under it.
        yaws_rad: yaw angle of a sole on each candidate [rad]; () for 0. The same patch with several
            yaws is several candidates. toe_m of a sole is its centre.
        force_min, force_max: bounds on (f_n, f_y, f_z) there, of a sole at each of its points, in
            units of the problem's force scale, shape (3,); None for those of the problem.
    """

    limb: str
    frame: int
    toe_m: Array | None = None
    candidates: tuple[Patch, ...]
    yaws_rad: tuple[float, ...] = field(default=(), metadata=LATER)
    force_min: Array | None = field(default=None, metadata=LATER)
    force_max: Array | None = field(default=None, metadata=LATER)

    def __post_init__(self) -> None:
        where = f"frame {self.frame}, limb {self.limb}"
        if len(self.yaws_rad):
            yaws = read_only(self.yaws_rad, (None,), f"{where}: yaws_rad")
            if len(yaws) != len(self.candidates):
                raise InvalidInput(
                    f"{where}: yaws_rad: expected {len(self.candidates)}, one a candidate, got "
                    f"{len(yaws)}"
                )
            object.__setattr__(self, "yaws_rad", tuple(yaws.tolist()))
        if not self.candidates:
            raise InvalidInput(
                f"{where}: expected one or more candidate patches, got none within reach"
            )
        object.__setattr__(self, "candidates", tuple(self.candidates))
        if self.toe_m is not None:
            object.__setattr__(self, "toe_m", read_only(self.toe_m, (3,), f"{where}: toe_m"))
            if len(self.candidates) != 1:
                raise InvalidInput(
                    f"{where}: expected one patch under a toe that stands, got "
                    f"{len(self.candidates)}"
                )
        if self.force_min is None and self.force_max is None:
            return
        if self.force_min is None or self.force_max is None:
            raise InvalidInput(
                f"{where}: force_min, force_max: expected both or none, got one of them"
            )
        low, high = (
            read_only(getattr(self, each), (3,), f"{where}: {each}")
            for each in ("force_min", "force_max")
        )
        if np.any(low > high):
            raise InvalidInput(
                f"{where}: force_min: expected at most force_max {high.tolist()}, got "
                f"{low.tolist()}"
            )
        object.__setattr__(self, "force_min", low)
        object.__setattr__(self, "force_max", high)


@dataclass(frozen=True)
class Stance:
    """Limbs that carry the robot alone at a key frame, by index, in the robot's order."""

    frame: int
    limbs: tuple[int, ...]


_ROUNDED = 1e-9
"""Share of δ by which a half-space is widened: corners of parts are rounded."""
_SMALLEST = 0.02
"""A side whose corners are nearer to each other is not parted again: h is within a few parts in ten
thousand of 1."""
OPEN = (0.0, 0.0, 0.0, -1.0)
"""The row n·Δ ≥ b of a step whose side is open: it holds always."""


def parts(side: Array | None) -> list[Array]:
    """The sides, shape (3, 3) each, that cover a side: of all directions, where None, the octants.

    Arguments:
        side: shape (3, 3), its corners.
    """
    if side is None:
        return [np.diag(signs) for signs in itertools.product((1.0, -1.0), repeat=3)]
    a, b, c = side
    ab, bc, ca = (_unit(first + second) for first, second in ((a, b), (b, c), (c, a)))
    return [np.array(corners) for corners in ((ab, bc, ca), (a, ab, ca), (b, bc, ab), (c, ca, bc))]


def too_small(side: Array | None) -> bool:
    """Tell whether a side is not parted again."""
    return side is not None and bool(np.linalg.norm(side[0] - side[1]) < _SMALLEST)


def half_space(side: Array, least: float) -> Array:
    """The row (n, b) with n·Δ ≥ b for all Δ of this side that are as long as ``least``, shape
    (4,).
    """
    a, b, c = side
    normal = np.cross(b - a, c - a)
    normal = _unit(normal if normal @ a > 0.0 else -normal)
    return np.append(normal, (float((side @ normal).min()) - _ROUNDED) * least)


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


_MOST_WEIGHTS = 100.0
"""No posture bears a force of so many times the weight, nor such a moment at an arm of the length
scale."""


def checked_wrench(
    value: ArrayLike, shape: tuple[int, ...], *, weight_n: float, length_m: float
) -> Array:
    """A read-only copy of wrenches, the last axis of ``shape`` being 6: force [N] and moment [Nm].

    Arguments:
        value: the wrenches.
        shape: expected shape.
        weight_n: weight of the robot [N].
        length_m: length scale.

    Raises:
        InvalidInput: for what is no such array, and for magnitudes beyond any posture.
    """
    wrench = read_only(value, shape, "wrench")
    for part, what, unit, most in (
        (wrench[..., :3], "force", "N", _MOST_WEIGHTS * weight_n),
        (wrench[..., 3:], "moment", "Nm", _MOST_WEIGHTS * weight_n * length_m),
    ):
        largest = float(np.linalg.norm(part, axis=-1).max())
        if largest > most:
            raise InvalidInput(
                f"wrench: expected a {what} of at most {most:.4g} {unit}, {_MOST_WEIGHTS:g} times "
                "the weight and beyond "
                f"any posture, got {largest:.4g} {unit}"
            )
    return wrench


def wrench_of(value: ArrayLike) -> Array:
    """One wrench of three numbers, a force, or of six, a force and a moment; shape (6,).

    Raises InvalidInput.
    """
    size = (
        np.shape(value)
        if isinstance(value, np.ndarray)
        else (len(value),)
        if isinstance(value, Sequence)
        else ()
    )
    if size not in ((3,), (6,)) or isinstance(value, str):
        raise InvalidInput(
            "wrench: expected 3 numbers, a force [N], or 6, a force and a moment about the centre "
            "of mass [Nm], "
            f"got {shown(value)}"
        )
    part = read_only(value, size, "wrench")
    return np.concatenate([part, np.zeros(6 - len(part))])


def at_point(force_n: ArrayLike, moment_nm: ArrayLike, at_m: ArrayLike) -> Array:
    """The wrench about the centre of mass of a force at a point of the body and a moment, shape
    (6,).

    Arguments:
        force_n: the force, shape (3,) [N].
        moment_nm: the moment, shape (3,) [Nm].
        at_m: vector from the centre of mass to the point where the force acts, shape (3,) [m].
    """
    force = np.asarray(force_n, dtype=np.float64)
    moment = np.asarray(moment_nm, dtype=np.float64) + cross(
        np.asarray(at_m, dtype=np.float64), force
    )
    return np.concatenate([force, moment])


LINEAR: Mapping[str, tuple[str, str, tuple[tuple[float, ...], ...]]] = MappingProxyType(
    {
        "yaw_rad": (
            "yaw_step",
            "rad",
            ((0.0, 0.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0, 0.0, -1.0)),
        )
    }
)
"""Further limits of a step of the body, by the field of ``StepLimits`` that has the limit, None
where there is none: a name for reports, the unit, and slopes a of (c′ − c, Θ′ − Θ), each of six
numbers, with a·step ≤ limit. Planners, their reference, the verifier, proofs and explanations read
them here."""


_NotNegative = Annotated[float, Within(least=0.0)]


@dataclass(frozen=True, kw_only=True)
class StepLimits:
    """Largest and least steps between neighbouring key frames (E11), and the least progress.

    Arguments:
        com_m, toe_m, rotation_rad: Δp_max of the COM and of a toe, ΔΘ_max.
        progress_m: the paper's least step is not convex; in its place the COM moves at least this
            far along the straight line of its nominal path, where that moves.
        yaw_rad: largest turn about the vertical, |Θ_z' − Θ_z|; None for no such limit.
        least_toe_m: Δp_min of a toe that is put down anew; 0 for none. A toe that stays takes no
            step. Not convex: planners branch over directions (``problem.sides``).
        least_rotation_rad: ΔΘ_min, likewise.
    """

    com_m: Annotated[float, Within(above=0.0)] = 0.15
    toe_m: Annotated[float, Within(above=0.0)] = 0.30
    rotation_rad: _NotNegative = 0.15
    progress_m: _NotNegative = 0.0
    yaw_rad: _NotNegative | None = field(default=None, metadata=LATER)
    least_toe_m: _NotNegative = field(default=0.0, metadata=LATER)
    least_rotation_rad: _NotNegative = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        check_limits(self)
        for least, most in (
            ("progress_m", "com_m"),
            ("least_toe_m", "toe_m"),
            ("least_rotation_rad", "rotation_rad"),
        ):
            came, limit = getattr(self, least), getattr(self, most)
            if came > limit:
                raise InvalidInput(
                    f"{least}: expected at most steps.{most} = {limit:g}, the largest step, got "
                    f"{came:g}"
                )

    @property
    def linear(self) -> dict[str, float]:
        """The limits of ``LINEAR`` that there are, by field."""
        return {name: getattr(self, name) for name in LINEAR if getattr(self, name) is not None}

    def linear_rows(self, length_m: float) -> Array:
        """The rows (a, limit) of these limits, lengths in units of ``length_m``, shape (R, 7)."""
        rows = list[Array]()
        for name, limit in self.linear.items():
            _, unit, slopes = LINEAR[name]
            one = length_m if unit == "m" else 1.0
            scales = np.array([length_m] * 3 + [1.0] * 3) / one
            rows += [np.append(np.array(slope) * scales, limit / one) for slope in slopes]
        return np.array(rows).reshape(-1, 7)


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of the objective: squared distance of the last COM from the goal, of every COM from
    the nominal path, squared steps, squared tilt, squared distance of every toe from where it is as
    the robot stands; lengths in m.

    The paper: "minimizes the distance of the planned final configuration to the goal and penalizes
    the step size".
    """

    goal: _NotNegative = 1.0
    com_path: _NotNegative = field(default=0.0, metadata=LATER)
    com_step: _NotNegative = 0.2
    toe_step: _NotNegative = 0.05
    tilt: _NotNegative = 0.05
    stance: _NotNegative = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        check_limits(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class Contact:
    """One limb on one patch.

    Arguments:
        leg: name of the limb.
        shoulder_m: v, the shoulder in the body frame, shape (3,) [m].
        reach_m: Δ_FK, radius of the workspace about the shoulder [m].
        patch: the terrain under the toe.
        force_min, force_max: bounds on (f_n, f_y, f_z), in units of the problem's force scale,
            shape (3,); of a sole at each of its points.
        reach_rows: half-spaces that the toe is in, too.
        sole_m: points (forward, left) of a rigid flat foot, shape (K, 2) [m], on the patch with the
            yaw ``yaw_rad`` [rad], whose centre is the toe (``terrain.sole``); None for a point
            foot.

    Raises:
        InvalidInput: for wrong shapes, a reach that is not positive, bounds in the wrong order; all
            that is wrong.
    Source:
        Lin et al. §II, E2, E3 and E11.

    Example:
        >>> import numpy as np
        >>> from stancekit import Contact, Patch, hexapod
        >>> corners = np.array([[0.3, -0.3, -0.2], [0.4, -0.2, -0.2], [0.3, -0.1, -0.2]])
        >>> patch = Patch(vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=0.6)
        >>> (limb,) = hexapod().select(["RF"])
        >>> contact = Contact(leg="RF", shoulder_m=limb.shoulder_m, reach_m=limb.reach_m, patch=patch,
        ...                   force_min=[0, -1, -1], force_max=[1, 1, 1])
        >>> contact.patch.friction
        0.6
    """

    leg: str
    shoulder_m: Array
    reach_m: float
    patch: Patch = field(metadata=INLINE)
    force_min: Array
    force_max: Array
    reach_rows: ReachRows | None = field(default=None, metadata=LATER)
    sole_m: Array | None = field(default=None, metadata=LATER)
    yaw_rad: float = field(default=0.0, metadata=LATER)

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        collect_errors(
            lambda: checked_name(self.leg, "leg"),
            lambda: checked_members((self.patch,), Patch, "patch"),
            lambda: set_field(self, "shoulder_m", read_only(self.shoulder_m, (3,), "shoulder_m")),
            lambda: set_field(self, "reach_m", checked(self.reach_m, "reach_m", above=0.0)),
            lambda: set_field(self, "force_min", read_only(self.force_min, (3,), "force_min")),
            lambda: set_field(self, "force_max", read_only(self.force_max, (3,), "force_max")),
        )
        if np.any(self.force_min > self.force_max):
            raise InvalidInput(
                f"force_min: expected at most force_max {self.force_max.tolist()}, got "
                f"{self.force_min.tolist()}"
            )
        set_field(self, "yaw_rad", checked(self.yaw_rad, "yaw_rad"))
        if self.sole_m is not None:
            set_field(self, "sole_m", checked_sole(self.sole_m, "sole_m"))

    def to_json(self) -> dict[str, Any]:
        """JSON-ready values; the yaw is a sole's alone."""
        record = fields_to_json(self, ("yaw_rad",))
        return record if self.sole_m is None else record | {"yaw_rad": self.yaw_rad}

    @cached_property
    def offsets_m(self) -> Array:
        """From the toe to the points that bear forces: its own place, or a sole's points, shape (K,
        3) [m].
        """
        return (
            np.zeros((1, 3))
            if self.sole_m is None
            else sole_offsets(self.sole_m, self.patch, self.yaw_rad)
        )

    @property
    def region(self) -> Patch:
        """Region in which the toe may be: the patch, or the part of it from which a sole stays on
        it. Raises InvalidInput.
        """
        return self.patch if self.sole_m is None else self._region

    @cached_property
    def _region(self) -> Patch:  # of soles alone: batches give copies of point feet other patches
        return sole_region(self.patch, self.offsets_m)


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
        on = nearest(self._rooms[chosen], np.matmul((points_m - origins)[:, None], axes)[:, 0])
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
