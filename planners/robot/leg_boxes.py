"""Feet and the boxes that they can reach, measured from a robot's URDF, with its mass and inertia (W4).

The box R_i of W4 is "the largest rectangular reachable set": the leg's workspace is sampled on a grid of its
joint angles and laid on voxels, and the largest box of voxels that holds the nominal foot and is reached throughout
is searched for exhaustively.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import binary_closing

from ..errors import InvalidInput
from ..files.arrays import Array, checked_name, frozen
from ..files.documents import read_text
from ..files.refusals import shown
from .urdf_reader import built, parsed, pinocchio

FULL_TURN = np.pi
MOST_SAMPLES, MOST_VOXELS = 2_000_000, 20_000_000
"""Of a leg's workspace."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Foot:
    """One foot: where it stands by default and the box R_i that it can reach (W4).

    All in the torso's frame, whose origin is the centre of mass, shape (3,) [m]: nominal_m inside the box from
    reach_min_m to reach_max_m; hip_m: where its leg begins.
    """

    name: str
    nominal_m: Array
    reach_min_m: Array
    reach_max_m: Array
    hip_m: Array

    def __post_init__(self) -> None:
        checked_name(self.name, "name")
        for name in ("nominal_m", "reach_min_m", "reach_max_m", "hip_m"):
            object.__setattr__(self, name, frozen(getattr(self, name), (3,), f"foot {self.name}: {name}"))
        if not np.all((self.reach_min_m < self.nominal_m) & (self.nominal_m < self.reach_max_m)):
            raise InvalidInput(
                f"foot {self.name}: expected reach_min_m < nominal_m < reach_max_m, got {self.reach_min_m.tolist()}, "
                f"{self.nominal_m.tolist()}, {self.reach_max_m.tolist()}"
            )


@dataclass(frozen=True, kw_only=True)
class Workspace:
    """How a leg's workspace is sampled, and what of it counts.

    ranges_rad: for each joint of a leg, how far below and above the posture it may go, signed for the first foot's
    joints and mirrored for joints that the posture mirrors; the URDF's limits hold too. ceiling_m: how high above the
    centre of mass a foot may be; inner_m: how near to the mid-plane y = 0 [m]. voxel_m: side of a voxel [m]; steps:
    samples a joint; both finer ones make the box larger, and take longer.
    """

    ranges_rad: Sequence[tuple[float, float]] | None = None
    ceiling_m: float = 0.0
    inner_m: float = 0.0
    voxel_m: float = 0.02
    steps: int = 70


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredLegs:
    """What a URDF says in its standing posture: name, mass [kg], inertia about the centre of mass, shape (3, 3)
    [kg m²], and the feet."""

    name: str
    mass_kg: float
    inertia_kgm2: Array
    feet: tuple[Foot, ...]


def measure_legs(path: str | Path, feet: Sequence[str], posture: Sequence[float], workspace: Workspace) -> MeasuredLegs:
    """Measure a robot whose legs are chains of three joints or more, on a free-flying base (W4).

    feet: frame names. posture: angles of all joints in pinocchio's order in which the robot stands [rad].
    Raises InvalidInput for a file that is no URDF, has no inertia, or lacks a frame.
    """
    pin = pinocchio()
    model, data = _model(Path(path), feet)
    if len(posture) != model.nq - 7:
        raise InvalidInput(f"posture: expected {model.nq - 7} joint angles, got {len(posture)}")
    for foot in feet:
        if not model.existFrame(foot):
            raise InvalidInput(f"{path}: expected a frame {foot!r}, found none of that name")
    q = np.concatenate([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], np.asarray(posture, dtype=np.float64)])
    pin.ccrba(model, data, q, np.zeros(model.nv))
    mass, inertia, centre = float(data.Ig.mass), np.array(data.Ig.inertia), np.array(data.com[0])
    sound = bool(np.isfinite([mass, *centre, *inertia.ravel()]).all())
    if not sound or not mass > 0.0 or not np.linalg.eigvalsh(inertia)[0] > 0.0:
        raise InvalidInput(f"{path}: expected links with mass and inertia, got {mass:g} kg in all")
    legs = _Legs(pin, model, data, q, workspace)
    return MeasuredLegs(
        name=str(model.name),
        mass_kg=mass,
        inertia_kgm2=0.5 * (inertia + inertia.T),
        feet=tuple(legs.foot(foot) for foot in feet),
    )


def _model(path: Path, feet: Sequence[str]) -> tuple[Any, Any]:
    """The model of a URDF on a free-flying base, and its data."""
    if not path.exists():
        raise InvalidInput(f"{path}: expected a URDF file, found nothing there")
    text = read_text(path)
    parsed(text, str(path))
    if len(set(feet)) < len(feet):
        raise InvalidInput(f"feet: expected different frames, got {shown(list(feet))}")
    model = built(text, str(path))
    return model, model.createData()


class _Legs:
    """Reach boxes of legs of one model, relative to the centre of mass in the standing posture."""

    def __init__(self, pin: Any, model: Any, data: Any, q: Array, workspace: Workspace) -> None:
        self._pin, self._model, self._data, self._q, self._workspace = pin, model, data, q, workspace
        self._centre: Array = np.array(data.com[0])
        self._first: Array | None = None

    def foot(self, name: str) -> Foot:
        frame = self._model.getFrameId(name)
        joints = [j for j in self._model.supports[self._model.frames[frame].parentJoint] if j > 1]
        if len(joints) < 3 or any(self._model.joints[j].nq != 1 for j in joints):
            raise InvalidInput(f"feet: expected three or more joints of one angle before {name!r}, got {len(joints)}")
        samples = self._workspace.steps ** len(joints)
        if samples > MOST_SAMPLES:
            raise InvalidInput(f"steps: expected {MOST_SAMPLES} samples a leg or fewer, got {samples}")
        columns = [self._model.joints[j].idx_q for j in joints]
        nominal = self._placed(self._q, frame)
        hip = np.array(self._data.oMi[joints[1]].translation) - self._centre
        points = np.array([self._placed(self._with(columns, angles), frame) for angles in self._grid(columns)])
        low, high = self._box(points, nominal)
        return Foot(name=name.split("_")[0], nominal_m=nominal, reach_min_m=low, reach_max_m=high, hip_m=hip)

    def _placed(self, q: Array, frame: int) -> Array:
        self._pin.forwardKinematics(self._model, self._data, q)
        self._pin.updateFramePlacement(self._model, self._data, frame)
        return np.asarray(self._data.oMf[frame].translation - self._centre)

    def _with(self, columns: list[int], angles: tuple[float, ...]) -> Array:
        q = self._q.copy()
        q[columns] = angles
        return q

    def _grid(self, columns: list[int]) -> Any:
        stand = self._q[columns]
        if self._first is None:
            self._first = stand
        ranges = self._workspace.ranges_rad or [(FULL_TURN, FULL_TURN)] * len(columns)
        below, above = np.array(ranges, dtype=np.float64).T
        if len(below) != len(columns):
            raise InvalidInput(f"ranges_rad: expected {len(columns)}, one a joint of a leg, got {len(below)}")
        mirrored = np.sign(stand) * np.sign(self._first) < 0
        down, up = np.where(mirrored, above, below), np.where(mirrored, below, above)
        low = np.maximum(stand - down, self._model.lowerPositionLimit[columns])
        high = np.minimum(stand + up, self._model.upperPositionLimit[columns])
        return product(*(np.linspace(a, b, self._workspace.steps) for a, b in zip(low, high, strict=True)))

    def _box(self, points: Array, nominal: Array) -> tuple[Array, Array]:
        """The largest box of reached voxels that holds the nominal foot: its lower and upper corner, shape (3,) [m]."""
        voxel_m = self._workspace.voxel_m
        corner = points.min(axis=0) - voxel_m
        cells = np.floor((points - corner) / voxel_m).astype(int)
        if np.prod(cells.max(axis=0) + 2.0) > MOST_VOXELS:
            raise InvalidInput(f"voxel_m: expected {MOST_VOXELS} voxels a leg or fewer, got more at {voxel_m:g} m")
        reached = np.zeros(tuple(cells.max(axis=0) + 2), dtype=np.bool_)
        reached[tuple(cells.T)] = True
        reached = binary_closing(reached, np.ones((2, 2, 2), dtype=np.bool_))
        middle = [corner[k] + voxel_m * (np.arange(reached.shape[k]) + 0.5) for k in range(3)]
        side = np.sign(nominal[1])
        reached &= (side * middle[1] - 0.5 * voxel_m >= self._workspace.inner_m)[None, :, None]
        reached &= (middle[2] + 0.5 * voxel_m <= self._workspace.ceiling_m)[None, None, :]
        home = np.floor((nominal - corner) / voxel_m).astype(int)
        low, high = largest_box(reached, home)
        return corner + voxel_m * low, corner + voxel_m * high


def largest_box(full: Any, home: Array) -> tuple[Array, Array]:
    """Corners (low, high), high exclusive, of the largest all-true box that holds the cell ``home``, each shape (3,).

    Exhaustive over the extents in x and z, the extent in y then follows. Raises InvalidInput where ``home`` is false.
    """
    if not full[tuple(home)]:
        raise InvalidInput(f"reach: expected the standing foot within its leg's workspace, cell {home} is not")
    x0, y0, z0 = (int(k) for k in home)
    best, found = 0, (np.asarray(home), np.asarray(home) + 1)
    for low_x in range(x0, -1, -1):
        if not full[low_x, y0, z0]:
            break
        for high_x in range(x0 + 1, full.shape[0] + 1):
            if not full[high_x - 1, y0, z0]:
                break
            flat = full[low_x:high_x].all(axis=0)
            for low_z in range(z0, -1, -1):
                if not flat[y0, low_z]:
                    break
                for high_z in range(z0 + 1, full.shape[2] + 1):
                    line = flat[:, low_z:high_z].all(axis=1)
                    if not line[y0]:
                        break
                    stops = np.flatnonzero(~line)
                    low_y = int(stops[stops < y0].max(initial=-1)) + 1
                    high_y = int(stops[stops > y0].min(initial=len(line)))
                    volume = (high_x - low_x) * (high_y - low_y) * (high_z - low_z)
                    if volume > best:
                        best = volume
                        found = np.array([low_x, low_y, low_z]), np.array([high_x, high_y, high_z])
    return found
