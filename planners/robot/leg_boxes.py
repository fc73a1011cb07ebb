"""What the gait optimiser needs of a robot, measured from its URDF: mass, inertia, and a box that each foot can reach.

The box R_i of paper W eq. 4 is "the largest rectangular reachable set": the leg's workspace is sampled on a grid of its
joint angles and laid on voxels, and the largest box of voxels that holds the nominal foot and is reached throughout
is searched for exhaustively.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Any
from xml.parsers.expat import ExpatError, ParserCreate

import numpy as np
from scipy.ndimage import binary_closing

from ..errors import InvalidInput
from ..files.arrays import Array
from ..files.documents import read_text
from ..files.refusals import shown
from .single_body import Foot, GaitRobot

FULL_TURN = np.pi
DEEPEST_XML = 30
MOST_SAMPLES, MOST_VOXELS = 2_000_000, 20_000_000
"""Of a leg's workspace."""


def measured(
    path: str | Path,
    feet: Sequence[str],
    posture: Sequence[float],
    *,
    ranges_rad: Sequence[tuple[float, float]] | None = None,
    trunk_half_m: Sequence[float],
    ceiling_m: float = 0.0,
    inner_m: float = 0.0,
    voxel_m: float = 0.02,
    steps: int = 70,
    name: str = "",
) -> GaitRobot:
    """Measure a robot whose legs are chains of three joints or more, on a free-flying base.

    feet: frame names. posture: angles of all joints in pinocchio's order in which the robot stands [rad].
    ranges_rad: for each joint of a leg, how far below and above the posture it may go, signed for the first foot's
    joints and mirrored for joints that the posture mirrors; the URDF's limits hold too.
    ceiling_m: how high above the centre of mass a foot may be; inner_m: how near to the mid-plane y = 0.
    steps: samples a joint. Raises InvalidInput for a file that is no URDF, has no inertia, or lacks a frame.
    """
    pin = _pinocchio()
    path = Path(path)
    if not path.exists():
        raise InvalidInput(f"{path}: expected a URDF file, found nothing there")
    text = read_text(path)
    _check_xml(text, path)
    if len(set(feet)) < len(feet):
        raise InvalidInput(f"feet: expected different frames, got {shown(list(feet))}")
    try:
        with _quiet():
            model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    except Exception as error:  # what pinocchio meets
        raise InvalidInput(f"{path}: expected a URDF: {' '.join(str(error).split())[:120]}") from None
    data = model.createData()
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
    measure = _Leg(pin, model, data, q, centre, ranges_rad, steps, voxel_m, ceiling_m, inner_m)
    built = tuple(measure.foot(foot) for foot in feet)
    return GaitRobot(
        name=name or model.name,
        mass_kg=mass,
        inertia_kgm2=0.5 * (inertia + inertia.T),
        feet=built,
        stand_height_m=-float(np.mean([foot.nominal_m[2] for foot in built])),
        trunk_half_m=np.asarray(trunk_half_m, dtype=np.float64),
    )


class _Leg:
    """Reach boxes of legs of one model, relative to the centre of mass in the standing posture."""

    def __init__(
        self, pin: Any, model: Any, data: Any, q: Array, centre: Array,
        ranges_rad: Sequence[tuple[float, float]] | None, steps: int, voxel_m: float, ceiling_m: float, inner_m: float,
    ) -> None:  # fmt: skip
        self._pin, self._model, self._data, self._q, self._centre = pin, model, data, q, centre
        self._ranges, self._steps, self._voxel = ranges_rad, steps, voxel_m
        self._ceiling, self._inner = ceiling_m, inner_m
        self._first: Array | None = None

    def foot(self, name: str) -> Foot:
        frame = self._model.getFrameId(name)
        joints = [j for j in self._model.supports[self._model.frames[frame].parentJoint] if j > 1]
        if len(joints) < 3 or any(self._model.joints[j].nq != 1 for j in joints):
            raise InvalidInput(f"feet: expected three or more joints of one angle before {name!r}, got {len(joints)}")
        samples = self._steps ** len(joints)
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
        return np.array(self._data.oMf[frame].translation) - self._centre

    def _with(self, columns: list[int], angles: tuple[float, ...]) -> Array:
        q = self._q.copy()
        q[columns] = angles
        return q

    def _grid(self, columns: list[int]) -> Any:
        stand = self._q[columns]
        if self._first is None:
            self._first = stand
        below, above = np.array(self._ranges or [(FULL_TURN, FULL_TURN)] * len(columns), dtype=np.float64).T
        if len(below) != len(columns):
            raise InvalidInput(f"ranges_rad: expected {len(columns)}, one a joint of a leg, got {len(below)}")
        mirrored = np.sign(stand) * np.sign(self._first) < 0
        down, up = np.where(mirrored, above, below), np.where(mirrored, below, above)
        low = np.maximum(stand - down, self._model.lowerPositionLimit[columns])
        high = np.minimum(stand + up, self._model.upperPositionLimit[columns])
        return product(*(np.linspace(a, b, self._steps) for a, b in zip(low, high, strict=True)))

    def _box(self, points: Array, nominal: Array) -> tuple[Array, Array]:
        """The largest box of reached voxels that holds the nominal foot: its lower and upper corner, shape (3,) [m]."""
        corner = points.min(axis=0) - self._voxel
        cells = np.floor((points - corner) / self._voxel).astype(int)
        if np.prod(cells.max(axis=0) + 2.0) > MOST_VOXELS:
            raise InvalidInput(f"voxel_m: expected {MOST_VOXELS} voxels a leg or fewer, got more at {self._voxel:g} m")
        reached = np.zeros(tuple(cells.max(axis=0) + 2), dtype=np.bool_)
        reached[tuple(cells.T)] = True
        reached = binary_closing(reached, np.ones((2, 2, 2), dtype=np.bool_))
        middle = [corner[k] + self._voxel * (np.arange(reached.shape[k]) + 0.5) for k in range(3)]
        side = np.sign(nominal[1])
        reached &= (side * middle[1] - 0.5 * self._voxel >= self._inner)[None, :, None]
        reached &= (middle[2] + 0.5 * self._voxel <= self._ceiling)[None, None, :]
        home = np.floor((nominal - corner) / self._voxel).astype(int)
        low, high = largest_box(reached, home)
        return corner + self._voxel * low, corner + self._voxel * high


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


@contextmanager
def _quiet() -> Iterator[None]:
    """Nothing on standard error, where urdfdom writes several lines by itself before it refuses."""
    with open(os.devnull, "wb") as nowhere:
        kept = os.dup(2)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _check_xml(text: str, path: Path) -> None:
    """Raise InvalidInput unless a text is XML of a robot, without entities of its own and of a depth that is usual."""
    parser, depth = ParserCreate(), [0, 0]

    def begun(name: str, _: dict[str, str]) -> None:
        if depth[1] == 0 and name != "robot":
            raise InvalidInput(f"expected a robot, got {shown(name)}")
        depth[:] = depth[0] + 1, depth[1] + 1
        if depth[0] > DEEPEST_XML:
            raise InvalidInput(f"expected {DEEPEST_XML} levels of elements or fewer, got more")

    def ended(_: str) -> None:
        depth[0] -= 1

    def declared(*_: Any) -> None:
        raise InvalidInput("expected XML without a document type and entities")

    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = begun, ended, declared
    try:
        parser.Parse(text.encode(), True)
    except (ExpatError, InvalidInput) as error:
        raise InvalidInput(f"{path}: expected a URDF: {error}") from None


def _pinocchio() -> Any:
    try:
        import pinocchio
    except ImportError:
        raise InvalidInput(
            "a URDF is read by pinocchio: expected the extra kin, pip install 'stancekit[kin]'"
        ) from None
    return pinocchio
