"""The verifier of motions that come from elsewhere: a table of joints and body, a robot, a terrain,
and nothing else.

Feet, centre of mass and momentum are those of the robot's own file at the table's joints. Contacts
are those of the table, or else of feet that are within ``_GAP_M`` of the terrain and move neither to
nor from it, nor fast along it; whether forces that carry the motion exist is a program per row: f_u
in round friction cones, least distance from Newton and Euler for the whole robot. Means over a
second have to be carried, too, by what is touched meanwhile, and to ``_STANDS``. Forces of the
table are judged, too, where it has some, and torques are worked out from joints, body and forces.
Whatever else a table has is compared with what follows from its joints and body, to the widths of
``_MotionLimits``: a column is judged, or named as not checked. So is a group of which the table,
the robot's file or the terrain does not say enough, with the reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..answer.report import Group, Report
from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, cross, grain, lengths
from ..motion.motion import MotionTable, one_sided
from ..physics import GRAVITY_M_S2
from ..robot.inverse_kinematics import WholeBody
from ..robot.kinematics import Kinematics
from ..robot.leg import FootSole, small_turns
from ..robot.model import Robot
from ..terrain.heightfield import HeightField
from ..terrain.obstacles import Ground, Obstacles
from ..terrain.patch import Patch
from .bodies import MovingBodyMeasurements, bodies_group, spaced
from .geometry import patch_distances

_GAP_M = 1e-3
"""A foot so near to the terrain touches it."""
_BESIDE_M = 1e-12
"""A point that is no farther from a polygon than from its plane, up to this, is over it [m]."""
_STILL_M_S = 0.02
"""A foot that stands moves no faster to or from the terrain."""
_SLIDES_M_S = 0.15
"""Nor along it, where the file does not say that it stands: a foot that skims over the ground
swings."""
_LIFT_S = 0.05
"""A foot that leaves the ground does so for longer."""
_WINDOW_S = 0.2
"""Balance is judged by its mean over so long: what is gone sooner moves the body by millimetres."""
_LASTS_S, _LASTING = 1.0, 4.0
"""What lasts so long counts so many times: a body topples by it."""
_STANDS = 1e-3
"""Such a part of the weight may be missing for ever: 0.06° of slope."""
_FINE, _ROUNDS = 1e-5, 30
"""Edges are added while more than this is missing, and they lessen it."""
_NARROW_M = 0.01
"""Under feet that are smaller, the nearest point of heights is looked for so far around."""
_OTHERWISE = 0.99
"""Surfaces whose normals have a greater cosine than this between them lean alike."""
_FINEST, _COARSEST, _DESCENTS = 1e-9, 1e-3, 200
"""Numbers rounded to such units [m, rad] are taken for the smoothest that round to them, which so
many steps of a descent find."""
_PLACES = ("angles_rad", "origin_m", "quaternion", "com_m")
"""Arrays of which speeds and forces are differences."""
_UNITS = {
    "joints": "rad",
    "joint_speed": "1",
    "torque": "1",
    "contact_gap": "m",
    "penetration": "m",
    "slip": "m",
    "balance": "1",
    "forces": "1",
    "cone": "1",
    "swing_force": "1",
    "bodies": "m",
    "rates": "1",
    "com": "m",
    "com_velocity": "m/s",
    "turning": "rad/s",
    "feet": "m",
    "effort": "1",
}
"""The groups in the order of a report, and the unit of what is measured."""
COLUMNS = MappingProxyType(
    {
        "rates": "rates_rad_s",
        "com": "com_m",
        "com_velocity": "velocity_m_s",
        "turning": "turning_rad_s",
        "feet": "feet_m",
        "effort": "torques_nm",
    }
)
"""Groups that compare a column with what follows from the others, where the table has it."""
_PLACED = ("origin_m", "quaternion")
NEEDS = MappingProxyType(
    {
        "contact_gap": (*_PLACED, "contact"),
        **dict.fromkeys(
            ("penetration", "slip", "balance", "bodies", "com", "turning", "feet"), _PLACED
        ),
        **dict.fromkeys(("forces", "cone", "swing_force", "effort"), (*_PLACED, "forces_n")),
    }
)
"""The columns that groups need beside times and angles."""
_WITHOUT = {
    **dict.fromkeys(_PLACED, "where the body is and how it is turned is not known"),
    "contact": "no contacts in the file: they are derived from the distance",
    "forces_n": "no forces in the file",
}
_ON_SOLES = "where on its soles a foot presses is not known"
_OF_THREE = ("balance", "forces", "rates", "com_velocity", "turning", "effort")
"""Groups that need three rows, too."""
_OF_GROUND = (
    "contact_gap",
    "penetration",
    "slip",
    "balance",
    "forces",
    "cone",
    "bodies",
    "swing_force",
)
"""Groups that ask where the ground is."""
_NO_LIMIT_RAD_S = 10.0
"""Speed in place of the limit of a joint that has none."""
_ROLLS_RAD = 1.5
"""Shins turn by no more than this while their feet stand."""


@dataclass(frozen=True, kw_only=True)
class _MotionLimits:
    """Tolerances for a motion; forces in units of the weight, moments of weight times stand height.

    Arguments:
        joints: beyond a limit [rad].
        joint_speed, torque: shares of what the robot's file gives.
        contact_gap_m, penetration_m: of a foot that stands, of any foot.
        slip_m: of a standing foot since it came down, of its point of contact, rolling left out, or
            of its centre: whichever moved less.
        balance: what no forces in the cones give, mean over ``_WINDOW_S``, and ``_LASTING`` times
            that over ``_LASTS_S``; as much where ``_STANDS`` of the weight is missing in the mean
            of that time, or its moment about points that are ``slip_m`` off.
        forces: the same of the forces of the table, which may be those of a body at rest.
        cone, swing_force: of the table's forces, outside of cones, and on feet that do not stand.
        bodies_m: of a link in another or in the terrain.
        rates: of joints, from what they turn between rows, as a share of their limit.
        com_m, feet_m: from where joints and body put them; feet are led, and roll, each large one
            beyond that by up to ``_ROLLS_RAD`` times its radius.
        com_velocity, turning: of the body, from how it moves between rows [m/s], [rad/s].
        effort: mean over ``_WINDOW_S`` of torques, from those that loads and forces make, as a
            share of the limit.
    """

    joints: float = 1e-3
    joint_speed: float = 1.0
    torque: float = 1.0
    contact_gap_m: float = 3e-3
    penetration_m: float = 3e-3
    slip_m: float = 5e-3
    balance: float = 0.08
    forces: float = 0.15
    cone: float = 2e-3
    swing_force: float = 2e-3
    bodies_m: float = 1e-4
    rates: float = 0.05
    com_m: float = 0.01
    com_velocity: float = 0.05
    turning: float = 0.1
    feet_m: float = 0.025
    effort: float = 0.15


def check_motion(
    table: MotionTable,
    robot: Robot,
    terrain: Sequence[Patch] | Ground,
    limits: _MotionLimits = _MotionLimits(),
    *,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> Report[MotionTable]:
    """Judge a motion; what cannot be known is named as not checked.

    Arguments:
        table: the motion; joints may be in another order than the robot's.
        robot: who moves.
        terrain: patches, or heights.
        limits: what is accepted.
        gravity_m_s2: that acts.

    Raises:
        InvalidInput: for joints or limbs that are not the robot's, a robot whose legs are not
            known, no pinocchio.
    """
    kinematics = Kinematics(robot, gravity_m_s2=gravity_m_s2)
    measured = _Measured(_unrounded(_ordered(table, kinematics)), kinematics, terrain, limits)
    most = {name.removesuffix("_m"): limit for name, limit in asdict(limits).items()}
    places = [array for name, array in table.arrays().items() if name in _PLACES]
    coarsest = max((grain(array) for array in places if np.ptp(array, axis=0).any()), default=0.0)
    rounded = f"the file's numbers are rounded to {coarsest:g}" if coarsest > _COARSEST else ""
    unsure = getattr(terrain, "doubt", "")
    groups = []
    for name, unit in _UNITS.items():
        if COLUMNS.get(name, "time_s") not in measured.known:
            continue
        (value, where, when, _), why = _NOWHERE, measured.missing.get(name, "")
        if not why:
            try:
                value, where, when, why = getattr(measured, name)()
            except InvalidInput as error:
                why = str(error)
        held, why = value <= most[name], why or (unsure if name in _OF_GROUND else "")
        groups.append(
            Group(
                name=name,
                value=value,
                limit=most[name],
                unit=unit,
                where=where,
                when=when,
                message=why or ("" if held else rounded),
                verdict="not checked" if why and held else "",
            )
        )
    return Report(
        groups=tuple(groups),
        answer=replace(table, doubts=robot.doubts),
        tolerance=0.0,
        limits=most,
        figures={"rounding": coarsest},  # within which the smoothest motion was judged
    )


_Worst = tuple[float, str, float | None, str]
"""The worst of a group: how much, where, when [s], and what was not looked at."""
_NOWHERE: _Worst = 0.0, "", None, ""


def _worst(values: Array, names: Sequence[str], times_s: Array, why: str = "") -> _Worst:
    """Worst of a series of shape (T, K), or (T,) of the whole robot."""
    table = values.reshape(len(values), -1)
    if not table.size or table.max() <= 0.0:  # what is no number is the worst
        return 0.0, "", None, why
    row, column = np.unravel_index(int(table.argmax()), table.shape)
    where = names[int(column)] if names else ""
    return float(table[row, column]), where, float(times_s[row]), why


def _ordered(table: MotionTable, kinematics: Kinematics) -> MotionTable:
    """The table with joints and limbs in the robot's order.

    Raises InvalidInput for others than the robot's.
    """
    limbs = kinematics.robot.limb_names
    changed, columns = dict[str, Any](), dict[str, Array]()
    for kind, names_of_robot, names, arrays in (
        ("joints", kinematics.joints, table.joints, ("angles_rad", "rates_rad_s", "torques_nm")),
        ("limbs", limbs, table.limbs, ("contact", "forces_n", "feet_m")),
    ):
        if not names and kind == "limbs":
            continue
        if not names:
            raise InvalidInput("motion: expected angles of the joints, got none")
        if set(names) != set(names_of_robot):
            odd = sorted(set(names) ^ set(names_of_robot))
            which = "it lacks" if odd[0] in names_of_robot else "the robot has no"
            raise InvalidInput(
                f"{kind}: expected those of {kinematics.robot.name}, "
                f"{', '.join(names_of_robot):.120}; {which} {odd[0]}"
            )
        order = [names.index(name) for name in names_of_robot]
        changed[kind] = tuple(names_of_robot)
        columns |= {
            name: array[:, order] for name, array in table.columns.items() if name in arrays
        }
    return replace(table.with_columns(**columns), **changed)


def _unrounded(table: MotionTable) -> MotionTable:
    """The smoothest motion of body and joints whose numbers round to those of the table: second
    differences, which are forces, of what is rounded to 0.1 mm are off by more than the weight.

    Steepest descent of their squares, within half a unit of every number.
    """
    smooth = dict[str, Any]()
    for name, given in table.arrays().items():
        unit = grain(given) if name in _PLACES else 0.0
        if not _FINEST <= unit <= _COARSEST:
            continue
        at = given = one_sided(given) if name == "quaternion" else given
        for _ in range(_DESCENTS):
            bent = np.diff(at, n=2, axis=0)
            at = at - np.diff(np.pad(bent, ((2, 2), (0, 0))), n=2, axis=0) / 16.0
            at = np.clip(at, given - 0.5 * unit, given + 0.5 * unit)
        smooth[name] = at
    return table.with_columns(**smooth) if smooth else table


class _Measured:
    """A table's measurements: T rows, J joints, N limbs."""

    def __init__(
        self,
        table: MotionTable,
        kinematics: Kinematics,
        terrain: Sequence[Patch] | Ground,
        limits: _MotionLimits,
    ) -> None:
        self.table, self.kinematics, self.terrain, self.limits = table, kinematics, terrain, limits
        self.known, self.times_s = table.arrays(), table.time_s
        self.step_s = 1.0 / table.rate_hz
        self.limbs = kinematics.robot.limb_names
        if "angles_rad" not in self.known:
            raise InvalidInput("motion: expected angles of the joints, got none")
        self.angles: Array = self.known["angles_rad"]
        self.weight_n = kinematics.weight_n
        self.height_m = kinematics.model.stand_height_m
        self.missing = dict[str, str]()
        needs = NEEDS if "com_m" in self.known else {**NEEDS, "com_velocity": _PLACED}
        for name, columns in needs.items():
            if lacks := [_WITHOUT[column] for column in columns if column not in self.known]:
                self.missing[name] = lacks[0]
        if kinematics.soles:
            self.missing |= dict.fromkeys(("forces", "effort"), _ON_SOLES)
        if len(self.times_s) < 3:
            self.missing |= dict.fromkeys(_OF_THREE, "fewer than three rows")
        if "quaternion" in self.known:
            _ = table.rotation  # what is none is refused, whatever asks for it
        if "torques_nm" not in self.known and "effort" in self.missing:
            self.missing["torque"] = "no torques in the file"

    def joints(self) -> _Worst:
        """Distance of joints beyond their limits, (T, J)."""
        why = "; ".join(self.kinematics.model.limit_doubts)
        beyond = self.kinematics.beyond(self.angles)
        return _worst(beyond, self.kinematics.joints, self.times_s, why)

    def joint_speed(self) -> _Worst:
        """Speed between rows as a share of the limit, (T − 1, J)."""
        most = self.kinematics.velocity_rad_s
        turned = np.abs(self.kinematics.turned_rad(self.angles))
        why = "" if (most > 0.0).all() else "no limit of the joints' speed in the robot's file"
        gaps_s = np.minimum(self.step_s, np.diff(self.times_s))  # the grid's, or the stamps' own
        shares = turned / gaps_s[:, None] / np.where(most > 0.0, most, np.inf)
        return _worst(shares, self.kinematics.joints, self.times_s[1:], why)

    def torque(self) -> _Worst:
        """Torques as a share of the limit, the table's and the mean of those that loads and forces
        make, (T, J).
        """
        why = "; ".join(self.kinematics.model.lines_of(self.kinematics.model.torque_doubts))
        shares = np.abs(self.known.get("torques_nm", np.zeros_like(self.angles)))
        if "effort" not in self.missing:
            shares = np.maximum(shares, np.abs(self._windowed(self._torques)))
        shares = shares / self.kinematics.torque_nm
        return _worst(shares, self.kinematics.joints, self.times_s, why)

    def rates(self) -> _Worst:
        """Distance of the joints' rates from what they turn before and after each row, (T, J)."""
        most = self.kinematics.velocity_rad_s
        between = self.kinematics.turned_rad(self.angles) / self.step_s
        off = _off(self.known["rates_rad_s"], between)
        shares = off / np.where(most > 0.0, most, _NO_LIMIT_RAD_S)
        return _worst(shares, self.kinematics.joints, self.times_s)

    def com(self) -> _Worst:
        """Distance of the table's centre of mass from that of the robot, (T,)."""
        return _worst(lengths(self.known["com_m"] - self._com), (), self.times_s)

    def feet(self) -> _Worst:
        """Distance of the table's feet from where joints and body put them, less what a large one
        rolls beyond the limit, (T, N).
        """
        away = lengths(self.known["feet_m"] - self._feet[0])
        rolls_m = np.maximum(_ROLLS_RAD * self.kinematics.radii_m - self.limits.feet_m, 0.0)
        return _worst(away - rolls_m, self.limbs, self.times_s)

    def com_velocity(self) -> _Worst:
        """Distance of its velocity from how it moves between rows, (T, 3)."""
        own = self.known.get("com_m")
        com = self._com if own is None else own
        off = _off(self.known["velocity_m_s"], np.diff(com, axis=0) / self.step_s)
        return _worst(off, ("x", "y", "z"), self.times_s)

    def turning(self) -> _Worst:
        """Distance of the body's angular velocity from how it turns between rows, (T, 3)."""
        from scipy.spatial.transform import Rotation

        turns = Rotation.from_matrix(self.table.rotation)
        turned = (turns[1:] * turns[:-1].inv()).as_rotvec() / self.step_s
        return _worst(_off(self.known["turning_rad_s"], turned), ("x", "y", "z"), self.times_s)

    def effort(self) -> _Worst:
        """Distance of the table's torques from those that loads and forces make, mean over
        ``_WINDOW_S``, (T, J).
        """
        off = np.abs(self._windowed(self.known["torques_nm"] - self._torques))
        return _worst(off / self.kinematics.torque_nm, self.kinematics.joints, self.times_s)

    @cached_property
    def _torques(self) -> Array:
        """Torques that carry the links' weight, press with the table's forces, and turn joints against
        damping and friction, shape (T, J).
        """
        kinematics, forces = self.kinematics, self.known["forces_n"]
        rows = zip(self.angles, self.table.rotation, forces, strict=True)
        held = np.array(
            [kinematics.torques_of(kinematics.loads(q, turn), f) for q, turn, f in rows]
        )
        rates = np.gradient(np.unwrap(self.angles, axis=0), self.times_s, axis=0)
        return np.asarray(held + kinematics.resistance(rates))

    def contact_gap(self) -> _Worst:
        """Distance to the terrain of feet that are said to stand, (T, N)."""
        return _worst(np.where(self.stands, self._gaps, 0.0), self.limbs, self.times_s)

    def penetration(self) -> _Worst:
        """Depth of feet in the terrain, (T, N)."""
        return _worst(-self._gaps, self.limbs, self.times_s)

    def slip(self) -> _Worst:
        """Slip of feet along the terrain since they came down, (T, N).

        A ball that rolls by a small turn ω moves by ω × r n; what its centre moves beside that is
        how far the point of contact slid. Planners that take feet for points keep the centre where
        it is. One of the two holds for all feet of a motion, the one with the smaller largest slip:
        a foot that rolls beside one that spins in place slips by either. Of a sole it is the spot
        that slid farthest.
        """
        normals = self.surface[1]
        radii = self.kinematics.radii_m[:, None, None]
        moved, turns = np.diff(self._spots, axis=0), small_turns(self._feet[1])[:, :, None]
        both = np.stack([moved - radii * cross(turns, normals[1:]), moved])  # (2, T − 1, N, K, 3)
        both = both - np.sum(both * normals[1:], axis=-1, keepdims=True) * normals[1:]
        held = self._held[..., None] & self._near
        far, total = np.zeros((2, *held.shape)), np.zeros((2, *moved.shape[1:]))
        stays = held[1:] & held[:-1]
        for k in range(both.shape[1]):
            total = np.where(stays[k][..., None], total + both[:, k], 0.0)
            far[:, k + 1] = np.linalg.norm(total, axis=-1)
        return _worst(min(far, key=np.max).max(axis=-1), self.limbs, self.times_s)

    def balance(self) -> _Worst:
        """Part of the force and moment that the motion needs and that no forces within the cones
        give, (T − 2,).
        """
        whole = min(1.0, len(self.times_s) * self.step_s / _LASTS_S)
        lasting = _LASTING * whole * self._windowed(self._lacks, _LASTS_S)
        lasting = np.maximum(lasting, self.limits.balance / _STANDS * self._lasting)
        return _worst(np.maximum(self._windowed(self._lacks), lasting), (), self.times_s[1:-1])

    def forces(self) -> _Worst:
        """Part of the force and moment that the motion needs and that the table's forces lack, (T −
        2,).
        """
        table_forces = self.known["forces_n"][1:-1]
        arms = self._points[1:-1] - self._com[1:-1, None]
        lacks = self._needed - np.concatenate([table_forces, cross(arms, table_forces)], 2).sum(1)
        lacks[:, 3:] /= self.height_m
        lacks = lengths(lacks) / self.weight_n
        return _worst(self._windowed(lacks), (), self.times_s[1:-1])

    def cone(self) -> _Worst:
        """Distance of the table's forces from their cones, the nearer one where a foot touches two
        surfaces, (T, N).
        """
        forces, outside = self.known["forces_n"][:, :, None], np.full(self._near.shape, np.inf)
        for gap, normals, friction in (self.surface, self._beside):
            along = np.sum(forces * normals, axis=-1)
            across = np.linalg.norm(forces - along[..., None] * normals, axis=-1)
            lacks = np.maximum(across - friction * along, -along) / self.weight_n
            outside = np.minimum(outside, np.where(np.isfinite(gap) & self._near, lacks, np.inf))
        outside = np.where(self.stands & self._near.any(axis=-1), outside.min(axis=-1), 0.0)
        return _worst(outside, self.limbs, self.times_s)

    def swing_force(self) -> _Worst:
        """The table's forces on feet that do not stand, (T, N)."""
        sizes = np.linalg.norm(self.known["forces_n"], axis=-1) / self.weight_n
        return _worst(np.where(self.stands, 0.0, sizes), self.limbs, self.times_s)

    def bodies(self) -> _Worst:
        """The deepest that a link is in another, or in the terrain."""
        from ..robot.bodies import Bodies

        around = self.terrain
        solid = (
            Obstacles.under(around.heights) if isinstance(around, Ground) else Obstacles.of(around)
        )
        points_m = np.concatenate([self._feet[0], self.known["origin_m"][:, None]], axis=1)
        rows = spaced(points_m, self.angles)
        made = Bodies(self.kinematics, solid)
        body = self._body.postures.at(rows)
        group = bodies_group("bodies", made, self.times_s[rows], body, between=True)
        if (worst := group.figures["worst"]) is None:
            return 0.0, "", None, "; ".join(made.missing)
        where = f"{worst['link']} in {worst['other']}"
        return group.value, where, worst["frame"], "; ".join(made.missing)

    @cached_property
    def _feet(self) -> tuple[Array, Array]:
        """Centres of the feet and how they are turned, in the world, shape (T, N, 3), (T, N, 3,
        3).
        """
        rotation, origin = self.table.rotation, self.known["origin_m"]
        legs = self.kinematics.model.legs
        angles = [self.angles[:, self.kinematics.joints_of(i)] for i in range(len(legs))]
        places = np.stack(
            [
                leg.chain.feet(angles_of_leg)
                for leg, angles_of_leg in zip(legs, angles, strict=True)
            ],
            axis=1,
        )
        turns = np.stack(
            [
                leg.chain.frames(angles_of_leg)[0][:, -1]
                for leg, angles_of_leg in zip(legs, angles, strict=True)
            ],
            axis=1,
        )
        centres = origin[:, None] + np.einsum("tij,tnj->tni", rotation, places)
        return centres, np.einsum("tij,tnjk->tnik", rotation, turns)

    @cached_property
    def _spots(self) -> Array:
        """Centres of feet that are balls, and spots all over those that are soles, shape (T, N, K,
        3).
        """
        centres, turns = self._feet
        soles = [leg.sole for leg in self.kinematics.model.legs]
        over = [np.zeros((1, 3)) if it is None else _all_over(it) for it in soles]
        most = max(map(len, over))
        arms = [np.pad(each, ((0, most - len(each)), (0, 0)), mode="edge") for each in over]
        return np.asarray(centres[:, :, None] + np.einsum("tnij,nkj->tnki", turns, arms))

    @cached_property
    def _radii(self) -> Array:
        """Radius at each spot, shape (T, N, K)."""
        return np.broadcast_to(self.kinematics.radii_m[:, None], self._spots.shape[:3])

    @cached_property
    def surface(self) -> tuple[Array, Array, Array]:
        """Gap, normal and friction of the terrain nearest to each spot of the feet, shape (T, N,
        K), (T, N, K, 3), (T, N, K).
        """
        shape = self._spots.shape
        gap, normal, friction = nearest(
            self.terrain, self._spots.reshape(-1, 3), self._radii.ravel()
        )
        return gap.reshape(shape[:3]), normal.reshape(shape), friction.reshape(shape[:3])

    @property
    def _gaps(self) -> Array:
        """Distance of each foot from the terrain, shape (T, N)."""
        return np.asarray(self.surface[0].min(axis=-1))

    @cached_property
    def _near(self) -> NDArray[np.bool_]:
        """Tell which spots touch where their foot stands, of a sole those on the ground, shape (T,
        N, K).
        """
        balls = np.array([[leg.sole is None] for leg in self.kinematics.model.legs])
        return np.asarray(balls | (self.surface[0] <= self.limits.contact_gap_m))

    @cached_property
    def _beside(self) -> tuple[Array, Array, Array]:
        """Gap, normal and friction of the nearest surface that leans otherwise and is touched, too;
        the gap is infinite without one.
        """
        gap, normal, friction = (np.array(each) for each in self.surface)
        flat, radii = self._spots.reshape(-1, 3), self._radii.ravel()
        first, second = normal.reshape(-1, 3), np.full(len(flat), np.inf)
        normals, frictions = first.copy(), friction.reshape(-1).copy()
        for patch in () if isinstance(self.terrain, Ground) else self.terrain:
            away = np.abs(_from_polygon(patch, flat)[0] - radii)
            better = (away <= _GAP_M) & (away < second) & (first @ patch.normal < _OTHERWISE)
            second = np.where(better, away, second)
            normals = np.where(better[:, None], patch.normal, normals)
            frictions = np.where(better, patch.friction, frictions)
        return (
            second.reshape(gap.shape),
            normals.reshape(normal.shape),
            frictions.reshape(gap.shape),
        )

    @cached_property
    def stands(self) -> NDArray[np.bool_]:
        """Tell which feet stand, by the file or by the distance, shape (T, N)."""
        if "contact" in self.known:
            return np.asarray(self.known["contact"])
        gap = self._gaps
        slow = np.abs(np.gradient(gap, self.step_s, axis=0)) <= _STILL_M_S
        speed, normals = np.gradient(self._feet[0], self.step_s, axis=0), self._normals
        along = speed - np.sum(speed * normals, axis=-1, keepdims=True) * normals
        return np.asarray((gap <= _GAP_M) & slow & (np.linalg.norm(along, axis=-1) <= _SLIDES_M_S))

    @cached_property
    def _held(self) -> NDArray[np.bool_]:
        """Which feet stand, or are said to be off for less than ``_LIFT_S`` and never leave the
        ground meanwhile, shape (T, N).
        """
        held, near = self.stands.copy(), self._gaps <= _GAP_M
        for foot in range(held.shape[1]):
            for first, last in pairwise(np.flatnonzero(held[:, foot]).tolist()):
                if (last - first) * self.step_s <= _LIFT_S:
                    held[first:last, foot] |= near[first:last, foot].all()
        return held

    @cached_property
    def _points(self) -> Array:
        """Points where feet touch, a radius below their centres, shape (T, N, 3)."""
        return np.asarray(self._feet[0] - self.kinematics.radii_m[:, None] * self._normals)

    @property
    def _normals(self) -> Array:
        """Normals of the terrain under the first spots of the feet, shape (T, N, 3)."""
        return self.surface[1][:, :, 0]

    @cached_property
    def _body(self) -> MovingBodyMeasurements:
        """The whole robot on the uniform grid of the table, without forces."""
        postures = WholeBody(
            rotation=self.table.rotation,
            origin_m=self.known["origin_m"],
            angles=self.angles,
            toes_m=self._points,
            normals=self._normals,
            stands=self.stands,
        )
        return MovingBodyMeasurements(
            postures,
            self.kinematics,
            times_s=np.arange(len(self.times_s)) * np.float64(self.step_s),
            com_m=self.known["origin_m"],
            normals=postures.normals,
            forces_n=np.zeros_like(self._points),
        )

    @cached_property
    def _needed(self) -> Array:
        """Force and moment about the centre of mass that the motion needs, shape (T − 2, 6)."""
        return np.asarray(self._body.momentum_rates + self.weight_n * np.eye(6)[2])

    @property
    def _com(self) -> Array:
        return self._body.centres_of_mass_m

    @cached_property
    def _touched(self) -> tuple[NDArray[np.bool_], Array, Array, Array]:
        """Tell which spots of feet touch the nearest surface, and that beside it; where, normals and
        friction there, shape (T − 2, 2 N, K), (T − 2, 2 N, K, 3) twice, (T − 2, 2 N, K).
        """
        both, radii = (self.surface, self._beside), self._radii[..., None]
        gap, normals, friction = (
            np.concatenate(each, axis=1)[1:-1] for each in zip(*both, strict=True)
        )
        points = np.concatenate([self._spots - radii * n for _, n, _ in both], axis=1)[1:-1]
        presses = np.tile(self.stands[..., None] & self._near, (1, 2, 1))[1:-1]
        return presses & np.isfinite(gap), points, normals, friction

    @cached_property
    def _lacks(self) -> Array:
        """Remainder of each row by itself, (T − 2,)."""
        alone = np.ones(1)
        return np.array([self._lack(k, alone, self.height_m) for k in range(len(self._needed))])

    @cached_property
    def _lasting(self) -> Array:
        """Remainder of means over a second about rows, (T − 2,); 0 where no row lacks much, or
        between.

        Weights that begin and end smoothly leave little of the noise of second differences.
        """
        weights = np.hanning(max(3, round(_LASTS_S / self.step_s)))[1:-1]
        weights, count, lacks = weights / weights.sum(), len(weights), np.zeros_like(self._lacks)
        for first in range(0, len(lacks) - count + 1, max(1, count // 4)):
            if weights @ self._lacks[first : first + count] > _STANDS:
                lever_m = self.limits.slip_m / _STANDS
                lacks[first + count // 2] = self._lack(first, weights, lever_m)
        return lacks

    def _lack(self, first: int, weights: Array, lever_m: float) -> float:
        """Least part of a mean needed wrench that is missing where feet press on all that they
        touch meanwhile: stances may change, since their wrenches are about one point.

        Arguments:
            first, weights: inner row with the first of the weights, which make 1.
            lever_m: moments are measured in this times the weight.
        """
        rows = slice(first, first + len(weights))
        com, force = self._com[1:-1][rows], self._needed[rows, :3]
        middle = weights @ com
        moment = (self._needed[rows, 3:] + cross(com - middle, force)) / lever_m
        needed = weights @ np.concatenate([force, moment], axis=1) / self.weight_n
        touches, points, normals, friction = self._touched
        at = touches[rows]
        arms = (points[rows][at] - middle) / lever_m
        return _missing(needed, arms, normals[rows][at], friction[rows][at])

    def _windowed(self, series: Array, over_s: float = _WINDOW_S) -> Array:
        """The mean over so long about each row, shape (T, …) as the series."""
        if series.ndim > 1:
            return np.stack([self._windowed(column, over_s) for column in series.T], axis=-1)
        count = max(1, min(len(series), round(over_s / self.step_s)))
        sums = np.convolve(series, np.ones(count), mode="valid") / count
        left = (len(series) - len(sums)) // 2
        return np.pad(sums, (left, len(series) - len(sums) - left), mode="edge")


def _missing(needed: Array, arms: Array, normals: Array, friction: Array) -> float:
    """Distance of a wrench from those of forces in round friction cones: of forces along edges, to
    which the one of each cone that lessens it most is added until none does.

    Arguments:
        needed, arms: force and moment, and where contacts are, without units, shape (6,), (K, 3).
        normals, friction: of the contacts, shape (K, 3), (K,).
    """
    from scipy.optimize import nnls

    missing, columns = needed, np.zeros((0, 6))
    for _ in range(_ROUNDS):
        lack = float(lengths(missing))
        pull = missing[:3] + cross(missing[3:], arms)
        across = pull - np.sum(pull * normals, axis=1, keepdims=True) * normals
        across /= np.maximum(lengths(across), np.finfo(float).tiny)[:, None]
        edges = normals + friction[:, None] * across
        lessens = np.sum(pull * edges, axis=1) > _FINE * lack
        if lack <= _FINE or not lessens.any():
            break
        added = np.concatenate([edges, cross(arms, edges)], axis=1)[lessens]
        columns = np.concatenate([columns, added])
        shares = nnls(columns.T, needed)[0]
        missing, columns = needed - shares @ columns, columns[shares > 0.0]
    return lack


def _all_over(sole: FootSole) -> Array:
    """Its corners, the middles of its edges, spots half as far from its middle, and that, from there
    in the last joint's axes, shape (K, 3).
    """
    border = np.concatenate([sole.points_m, 0.5 * (sole.points_m + np.roll(sole.points_m, 1, 0))])
    return np.concatenate([border, 0.5 * border, np.zeros((1, 2))]) @ sole.rotation[:, :2].T


def _off(values: Array, between: Array) -> Array:
    """Distance of values at T rows from the interval of what is between them before and after,
    carried on straight at the ends; 0 of fewer than three rows.

    Arguments:
        values, between: shape (T, K), (T − 1, K).
    """
    if len(between) < 2:
        return np.zeros_like(values)
    first, last = 2.0 * between[:1] - between[1:2], 2.0 * between[-1:] - between[-2:-1]
    before, after = np.concatenate([first, between]), np.concatenate([between, last])
    low, high = np.minimum(before, after), np.maximum(before, after)
    return np.asarray(np.maximum(np.maximum(low - values, values - high), 0.0))


def nearest(
    terrain: Sequence[Patch] | Ground, centres_m: Array, radii_m: Array
) -> tuple[Array, Array, Array]:
    """Gap between balls and the terrain, negative inside, its normal there, and its friction.

    Arguments:
        terrain: patches, or heights.
        centres_m, radii_m: of the balls, shape (K, 3), (K,).
    """
    if isinstance(terrain, Ground):
        place, normal = _nearest_on(terrain.heights, centres_m, radii_m)
        below = centres_m[:, 2] < terrain.heights.height(centres_m[:, :2])
        low, high = np.transpose(terrain.heights.domain_m)
        place[:, :2] = place[:, :2].clip(low, high)  # beyond its border there is no ground
        far = lengths(centres_m - place)
        below &= terrain.heights.contains(centres_m[:, :2])
        gap = np.where(below, -far, far) - radii_m
        return gap, normal, np.full(len(centres_m), terrain.friction)
    best, side = np.full(len(centres_m), np.inf), np.zeros(len(centres_m))
    normals, friction = np.tile([0.0, 0.0, 1.0], (len(centres_m), 1)), np.ones(len(centres_m))
    for patch in terrain:
        distance, height = _from_polygon(patch, centres_m)
        better = distance < best - 1e-9
        best = np.where(better, distance, best)
        side = np.where(better, np.sign(height), side)
        normals = np.where(better[:, None], patch.normal, normals)
        friction = np.where(better, patch.friction, friction)
    return np.where(side < 0.0, -best, best) - radii_m, normals, friction


def _nearest_on(heights: HeightField, centres: Array, radii: Array) -> tuple[Array, Array]:
    """The points of a height field that are nearest to balls, and the normals there, shape (K, 3)
    each.

    The best of a grid as wide as the ball, and descent from there: beside a step a ball touches
    elsewhere than below its centre.
    """
    steps = np.linspace(-1.0, 1.0, 9)
    around = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    flat = centres[:, :2]
    grid = flat[:, None] + np.maximum(radii, _NARROW_M)[:, None, None] * around
    rise = heights.height(grid.reshape(-1, 2)).reshape(grid.shape[:2]) - centres[:, None, 2]
    chosen = (np.sum((grid - flat[:, None]) ** 2, axis=-1) + rise**2).argmin(axis=1)
    at = grid[np.arange(len(grid)), chosen]

    def apart(places: Array) -> tuple[Array, Array, Array]:
        height, slope = heights.height_and_gradient(places)
        rise = centres[:, 2] - height
        return np.sum((flat - places) ** 2, axis=1) + rise**2, rise, slope

    best, rise, slope = apart(at)
    share = np.ones((len(at), 1))
    for _ in range(12):
        steepness = 1.0 + np.sum(slope**2, axis=1, keepdims=True)
        tried = at + share * (flat - at + rise[:, None] * slope) / steepness
        away, its_rise, its_slope = apart(tried)
        better = away < best
        share = np.where(better[:, None], share, 0.5 * share)
        at, best = np.where(better[:, None], tried, at), np.where(better, away, best)
        rise, slope = np.where(better, its_rise, rise), np.where(better[:, None], its_slope, slope)
    normal = np.concatenate([-slope, np.ones((len(at), 1))], axis=1)
    place = np.concatenate([at, (centres[:, 2] - rise)[:, None]], axis=1)
    return place, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _from_polygon(patch: Patch, points: Array) -> tuple[Array, Array]:
    """Distance of points from a patch, and their height above it, 0 or more beside it, shape (K,)
    each.
    """
    height = (points - patch.vertices_m[0]) @ patch.normal
    distance = patch_distances([patch.vertices_m] * len(points), points)
    inside = distance <= np.abs(height) + _BESIDE_M
    return distance, np.where(inside, height, np.abs(height))
