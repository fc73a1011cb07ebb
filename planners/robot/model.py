"""Robots as planners see them: mass, where limbs begin and how far they reach, and where their legs
come from.

A limb's workspace may be half-spaces, beside the ball about its shoulder: the polytopes of kinematic
planners. Rows a·R(Θ)ᵀ(p − c) ≤ b, p the toe, c the centre of mass, R(Θ) = I + [Θ]× as in E11, so
that they are (a + Θ × a)·d ≤ b with d = p − c, bilinear in Θ and d. Convex sets stand in for them,
exact where the tilt limit is 0 (s the shoulder, ρ the ball's radius, z any point, and t(x) the largest ‖Θ
× x‖ within the tilt limit):

* inner, for plans:              a·d + Θ·(a × z) + t(a) ‖a × (d − z)‖ ≤ b;
* outer, for bounds and proofs:  a·d + Θ·(a × s) ≤ b + t(a) (ρ + t(s)).

The inner one leaves out Θ·(a × (d − z)), at most t(a) ‖a × (d − z)‖: z is in the middle of the
half-spaces. The outer one leaves out Θ·(a × (d − s)), and ‖d − s‖ ≤ ρ + t(s) by the ball. That is
more than it takes: the outer one holds a·R(Θ)ᵀd ≤ b of the rotation R(Θ) = exp([Θ]×) as well, by about
half of t(a) t(s), wherever the ball ‖d − (I + [Θ]×) s‖ ≤ ρ holds, which is then to be made larger
(``outer_sets``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import (
    Array,
    checked,
    checked_choice,
    checked_members,
    checked_name,
    collect_errors,
    read_only,
)
from ..files.codec import LATER, UNWRITTEN, to_json
from ..files.documents import shown
from ..physics import GRAVITY_M_S2
from ..terrain.patch import Frame
from ..terrain.polygon import checked_sole
from .leg import FOOT_RADIUS_M, JOINTS, USUAL_REACH_M, Servo

if TYPE_CHECKING:
    from .reach_sets import Sets
    from .robot_model import RobotModel


BUILT_IN = ("hexapod",)
"""Names of the robots that need no file."""
MOST_ROWS = 256
ROOM_M = 1e-9
"""A place so far inside of all half-spaces shows that they leave room, without a linear program
[m]."""
_WIDEST_M = 0.5
"""Largest radius of a ball that shows it, as half-spaces may be without an end."""
_CORNERS = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [1.0, -1.0, -1.0]])
"""Corners of the box |Θ_i| ≤ 1, one of each opposite pair."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReachRows:
    """Half-spaces normals · (p − c) ≤ bounds_m in the body frame, where the body is not turned.

    Arguments:
        normals: outward normals, shape (K, 3), of any length but 0; they are made unit, and
            bounds_m with them. The set may be unbounded, since the ball about the shoulder holds,
            too, and need not hold the origin.
        bounds_m: shape (K,) [m].

    Raises:
        InvalidInput: for a normal of no length, and for rows that leave no room.
    """

    normals: Array
    bounds_m: Array

    def __post_init__(self) -> None:
        normals = read_only(self.normals, (None, 3), "normals")
        bounds = read_only(self.bounds_m, (len(normals),), "bounds_m")
        if not 1 <= len(normals) <= MOST_ROWS:
            raise InvalidInput(
                f"normals: expected 1 to {MOST_ROWS} half-spaces, got {len(normals)}"
            )
        length = np.linalg.norm(normals, axis=1)
        if length.min() < 1e-9:
            raise InvalidInput(
                f"normals[{int(length.argmin())}]: expected a non-zero vector, got none"
            )
        scaled = (
            np.abs(length - 1.0) > 1e-12
        )  # rows that are unit stay as they are, to the last bit
        normals = np.where(scaled[:, None], normals / length[:, None], normals)
        bounds = np.where(scaled, bounds / length, bounds)
        object.__setattr__(self, "normals", read_only(normals, (None, 3), "normals"))
        object.__setattr__(self, "bounds_m", read_only(bounds, (len(normals),), "bounds_m"))
        middle = np.linalg.lstsq(normals, bounds, rcond=None)[0]
        if (bounds - normals @ middle).min() < ROOM_M:
            _ = self.centre_m  # is there any place?

    def turned(self, frame: Frame) -> ReachRows:
        """The half-spaces of a body that is turned like this."""
        return ReachRows(normals=frame.vectors(self.normals), bounds_m=self.bounds_m)

    @cached_property
    def centre_m(self) -> Array:
        """Centre of a largest ball inside, up to 1 m wide, shape (3,) [m].

        Raises InvalidInput where there is none.
        """
        return np.array(_centre(self.normals.tobytes(), self.bounds_m.tobytes()))


@dataclass(frozen=True, kw_only=True, eq=False)
class RelativeReach:
    """Set of places of one foot relative to another: normals · (p_other − p_limb) ≤ bounds_m, the
    toes in the world's axes.

    It holds where ``limb`` has just been put down, for the other where it then stands; of a stance
    that is given it says nothing. Raises InvalidInput for one limb twice. Source: Tonneau et al.,
    "SL1M: Sparse L1-norm Minimization for contact planning on uneven terrain" (2020), §IV.
    """

    limb: str
    other: str
    rows: ReachRows

    def __post_init__(self) -> None:
        if self.limb == self.other:
            raise InvalidInput(f"relative_reach: expected two limbs, got {self.limb} twice")


@lru_cache(maxsize=256)
def _centre(normals: bytes, bounds: bytes) -> tuple[float, ...]:
    """``ReachRows.centre_m``, remembered: the rows of a data set's problems are those of one robot
    again and again.
    """
    from .hulls import inscribed_ball  # reads meshes, which is slow to import

    rows, right = np.frombuffer(normals).reshape(-1, 3), np.frombuffer(bounds)
    ball = inscribed_ball(rows, right, (-np.inf, _WIDEST_M))
    if ball is None:
        raise InvalidInput(
            "bounds_m: expected half-spaces that leave room for a toe, got an empty set"
        )
    return tuple(ball[:3].tolist())


def turned_most(vectors: Array, tilt_rad: float) -> Array:
    """Largest ‖Θ × x‖ of vectors of shape (..., 3) over |Θ_i| ≤ tilt; convex, so at a corner.

    Shape (...).
    """
    return np.asarray(
        tilt_rad * np.linalg.norm(np.cross(_CORNERS, vectors[..., None, :]), axis=-1).max(axis=-1)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class LegLimits:
    """Limits of a leg that moves fast, for leaps.

    Arguments:
        hip_m: p_BH, where the leg begins in the body frame, shape (3,) [m].
        speed_m_s: largest rate at which hip and toe move apart or together [m/s].
        power_w: largest power at the toe, either way [W].
        fold_m: least distance of hip and toe [m].

    Raises:
        InvalidInput: for numbers out of range.
    """

    hip_m: Array
    speed_m_s: float = field(default=math.inf, metadata=LATER)
    power_w: float = field(default=math.inf, metadata=LATER)
    fold_m: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "hip_m", read_only(self.hip_m, (3,), "leg: hip_m"))
        for name in ("speed_m_s", "power_w"):
            value = getattr(self, name)
            if value != math.inf:
                object.__setattr__(self, name, checked(value, f"leg: {name}", above=0.0))
        object.__setattr__(self, "fold_m", checked(self.fold_m, "leg: fold_m", least=0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Limb:
    """One limb: its shoulder in the body frame (Lin et al.'s v, E11) and the radius of its
    spherical workspace.

    Arguments:
        name: name of the limb.
        shoulder_m: p_BS, position of the shoulder in the body frame, shape (3,) [m].
        reach_m: Δ_FK of E11, radius of the workspace about the shoulder [m].
        reach_rows: half-spaces that hold the toe, in addition to the ball; to have them alone, set
            reach_m to the radius of a ball that contains them.
        sole_m: points (forward, left) of a rigid flat foot about its centre, shape (K, 2) [m]; None
            for a point foot. Reach and steps refer to the centre.
        hip_m: place where the leg begins in the body frame, shape (3,) [m]; a surface must face it
            to be a foothold. None for the shoulder, which for a leg from a file is the centre of a
            ball and may be below the ground.
        leg: limits of its speed, power and length, which leaps need; None if they are not known.

    Raises:
        InvalidInput: for another name, a wrong shape, a reach that is not positive.
    Source:
        Lin et al. §II, E11.

    Example:
        >>> from stancekit import Limb
        >>> Limb(name="LF", shoulder_m=[0.2, 0.1, 0.0], reach_m=0.4).shoulder_m.shape
        (3,)
    """

    name: str
    shoulder_m: Array
    reach_m: float
    reach_rows: ReachRows | None = field(default=None, metadata=LATER)
    sole_m: Array | None = field(default=None, metadata=LATER)
    leg: LegLimits | None = field(default=None, metadata=LATER)
    hip_m: Array | None = field(default=None, metadata=UNWRITTEN)

    def __post_init__(self) -> None:
        checked_name(self.name, "limb name")
        object.__setattr__(
            self, "shoulder_m", read_only(self.shoulder_m, (3,), f"limb {self.name}: shoulder_m")
        )
        object.__setattr__(
            self, "reach_m", checked(self.reach_m, f"limb {self.name}: reach_m", above=0.0)
        )
        if self.sole_m is not None:
            object.__setattr__(
                self, "sole_m", checked_sole(self.sole_m, f"limb {self.name}: sole_m")
            )
        if self.hip_m is not None:
            object.__setattr__(
                self, "hip_m", read_only(self.hip_m, (3,), f"limb {self.name}: hip_m")
            )

    def hip_at(self, shoulder_m: Array) -> Array:
        """Place where the leg begins when its shoulder is here, shape (3,) [m]."""
        return (
            shoulder_m
            if self.hip_m is None
            else np.asarray(shoulder_m + self.hip_m - self.shoulder_m)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Foot:
    """One foot: where it stands by default and the box R_i that it can reach (W4).

    All in the torso's frame, whose origin is the centre of mass, shape (3,) [m]: nominal_m inside
    the box from reach_min_m to reach_max_m.

    Arguments:
        hip_m: place where its leg begins.
    """

    name: str
    nominal_m: Array
    reach_min_m: Array
    reach_max_m: Array
    hip_m: Array

    def __post_init__(self) -> None:
        checked_name(self.name, "name")
        for name in ("nominal_m", "reach_min_m", "reach_max_m", "hip_m"):
            object.__setattr__(
                self, name, read_only(getattr(self, name), (3,), f"foot {self.name}: {name}")
            )
        if not np.all((self.reach_min_m < self.nominal_m) & (self.nominal_m < self.reach_max_m)):
            raise InvalidInput(
                f"foot {self.name}: expected reach_min_m < nominal_m < reach_max_m, got "
                f"{self.reach_min_m.tolist()}, "
                f"{self.nominal_m.tolist()}, {self.reach_max_m.tolist()}"
            )

    @property
    def limb(self) -> Limb:
        """The foot as a limb: its box as half-spaces, and the ball about the box."""
        normals = np.concatenate([np.eye(3), -np.eye(3)])
        bounds = np.concatenate([self.reach_max_m, -self.reach_min_m])
        return Limb(
            name=self.name,
            shoulder_m=0.5 * (self.reach_max_m + self.reach_min_m),
            reach_m=float(np.linalg.norm(0.5 * (self.reach_max_m - self.reach_min_m))),
            reach_rows=ReachRows(normals=normals, bounds_m=bounds),
            leg=LegLimits(hip_m=self.hip_m),
        )


_LARGEST_HALF_M = 5.0
"""Half a side of the largest trunk: its face is sampled, and what is longer is a mistake in units
[m]."""


def half_sides(value: Any, where: str) -> Array:
    """Half sides of a box, above 0 and up to what a robot may have, shape (3,) [m]."""
    sides = read_only(value, (3,), where)
    if not np.all((sides > 0.0) & (sides <= _LARGEST_HALF_M)):
        wanted = f"sides above 0 and up to {_LARGEST_HALF_M:g} m"
        raise InvalidInput(f"{where}: expected {wanted}, got {sides.tolist()}")
    return sides


_NO_LEGS = "no legs are known, only its reach: name its URDF, or, in a course, ask for drawn-up legs (legs: {})"
"""Why nothing is known of a robot's joints, torques and bodies."""


def no_legs(name: str) -> InvalidInput:
    """The error for a robot of this name whose legs are unknown."""
    return InvalidInput(f"robot {name}: {_NO_LEGS}")


_HEXAPOD = "hexapod"
_USUAL_SERVO = Servo()
"""The drives of legs that are drawn up where nothing else is said."""
_SAME = 1e-9
"""A mass and that of the model may differ by so much of it, and lengths of the hexapod's limbs by
so much [m]."""
_NO_TRUNK: Array = cast(Any, (0.0, 0.0, 0.0))
"""Half sides of the trunk of a robot that does not walk; a class attribute, which an array cannot be."""
_SAME_AS_MODEL = 1e-6
"""A walking robot's numbers may differ by so much of them from those of its model: rounding."""
_NEAR = 0.05
"""Share of a robot's height by which its feet may be elsewhere, on the mean."""
DEEPEST = 0.5
"""Deepest crouch of a robot, as a share of its height."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _RobotNumbers:
    """The keys of a robot: its limbs, and what makes its legs.

    Arguments:
        name: name of the robot.
        mass_kg: the whole mass [kg].
        limbs: one or more.
        identity: name and digest of the model that the robot comes from.
        model: the model from the robot's own file.
        relative_reach: regions in which feet may be, relative to a foot that is put down.
        inertia_kgm2: inertia about the centre of mass, for a robot that leaps, shape (3, 3) [kg
            m²].
        legs: the servo of legs that are drawn up.
        absent: legs that the robot has and whose position is not known.
    """

    name: str
    mass_kg: float
    limbs: tuple[Limb, ...]
    identity: str = field(default="", metadata=LATER)
    model: Mapping[str, Any] | None = field(default=None, metadata=LATER)
    relative_reach: tuple[RelativeReach, ...] = field(default=(), metadata=LATER)
    inertia_kgm2: Array | None = field(default=None, metadata=LATER)
    legs: Servo | None = field(default=None, metadata=LATER)
    absent: tuple[str, ...] = field(default=(), metadata=LATER)

    def value(self) -> Robot:
        """The robot.

        Raises InvalidInput.
        """
        from .robot_file import model_from_json  # reads URDFs, which is slow to import

        try:
            model = model_from_json(self.model, self.name)
        except InvalidInput as error:
            raise InvalidInput(f"robot {self.name}: {error}") from None
        return Robot(
            name=self.name,
            mass_kg=self.mass_kg,
            limbs=self.limbs,
            model=model,
            identity=self.identity,
            relative_reach=self.relative_reach,
            inertia_kgm2=self.inertia_kgm2,
            drawn=self.legs,
            absent=self.absent,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """A body with point-contact limbs; its centre of mass stays at the body's origin.

    Arguments:
        name: name of the robot.
        mass_kg: the whole mass [kg].
        limbs: one or more, of different names; with feet always those of their boxes.
        model: the robot's own legs, joint by joint, from its file; None if only its limbs are
            known.
        drawn: servo of legs that are drawn up for the limbs, for a robot without a file that asks
            for such legs. The limbs of the default hexapod always have them.
        identity: name and digest of the model that the robot comes from; empty without one, as for
            the default hexapod.
        relative_reach: regions in which feet may be, relative to a foot that is put down, in order
            of limb, then of the other foot.
        inertia_kgm2: inertia about the centre of mass in the body frame, shape (3, 3) [kg m²],
            which leaps need; None for that of the model, if there is one.
        absent: legs that the robot has beside its limbs and whose position is not known: their
            bodies are not judged.
        feet: feet of a robot that walks (Pan et al. §III-A), whose limbs are their boxes; three or
            more, none for a robot that only climbs.
        stand_height_m: height of the centre of mass over level ground as a robot that walks stands
            [m]; 0 without feet.
        trunk_half_m: half sides of the trunk's box, which has to stay clear of the ground on a
            walk, shape (3,) [m]; 0 without feet.

    Raises:
        InvalidInput: for a mass that is not positive, no limbs, two of one name, a model of another
            mass or of other legs, or drawn legs beside a model.
    Source:
        Lin et al. §II.

    Example:
        >>> from stancekit import Limb, Robot
        >>> limbs = [Limb(name=f"L{k}", shoulder_m=[0.1 * k, 0.1, 0.0], reach_m=0.4) for k in range(3)]
        >>> Robot(name="tripod", mass_kg=4.0, limbs=tuple(limbs)).limb_names
        ('L0', 'L1', 'L2')
    """

    KEYS: ClassVar = _RobotNumbers

    name: str
    mass_kg: float
    limbs: tuple[Limb, ...] = ()
    model: RobotModel | None = field(default=None, repr=False)
    identity: str = ""
    relative_reach: tuple[RelativeReach, ...] = ()
    inertia_kgm2: Array | None = None
    drawn: Servo | None = field(default=None, repr=False)
    absent: tuple[str, ...] = ()
    feet: tuple[Foot, ...] = ()
    stand_height_m: float = 0.0
    trunk_half_m: Array = _NO_TRUNK

    def __post_init__(self) -> None:
        checked_name(self.name, "robot name")
        object.__setattr__(
            self, "mass_kg", checked(self.mass_kg, f"robot {self.name}: mass_kg", above=0.0)
        )
        where = f"robot {self.name}: "
        object.__setattr__(self, "feet", checked_members(self.feet, Foot, f"{where}feet"))
        limbs = tuple(foot.limb for foot in self.feet) or self.limbs
        object.__setattr__(self, "limbs", checked_members(limbs, Limb, f"{where}limbs"))
        reach = checked_members(self.relative_reach, RelativeReach, f"{where}relative_reach")
        object.__setattr__(self, "relative_reach", reach)
        names = [limb.name for limb in self.limbs]
        if len(set(names)) != len(names) or not names:
            raise InvalidInput(
                f"robot {self.name}: expected one or more limbs of different names, got {names}"
            )
        pairs = [(each.limb, each.other) for each in self.relative_reach]
        self.select([name for pair in pairs for name in pair])
        if pairs != sorted(
            set(pairs), key=lambda pair: (names.index(pair[0]), names.index(pair[1]))
        ):
            raise InvalidInput(
                f"robot {self.name}: relative_reach: expected each pair once, in order of the limbs"
            )
        if self.inertia_kgm2 is not None:
            object.__setattr__(
                self, "inertia_kgm2", _checked_inertia(self.inertia_kgm2, f"{where}inertia_kgm2")
            )
        object.__setattr__(self, "absent", checked_members(self.absent, str, f"{where}absent"))
        if not isinstance(self.identity, str):
            raise InvalidInput(f"{where}identity: expected text, got {shown(self.identity)}")
        if self.drawn is not None:
            checked_members((self.drawn,), Servo, f"{where}drawn")
        if self.model is not None:
            from .robot_model import RobotModel  # which reads files, and is slow to import

            checked_members((self.model,), RobotModel, f"{where}model")
            self._check(self.model)
            object.__setattr__(self, "identity", self.model.identity)
        elif self.drawn is None and self._is_hexapod():
            object.__setattr__(self, "drawn", _USUAL_SERVO)
        if self.feet:
            _check_feet(self)

    def _is_hexapod(self) -> bool:
        """Tell whether name and limbs are those of the default hexapod, whatever it carries."""
        if self.name != _HEXAPOD or len(self.limbs) != len(limbs := _hexapod_limbs()):
            return False
        return all(_same_limb(limb, other) for limb, other in zip(self.limbs, limbs, strict=True))

    def _check(self, model: RobotModel) -> None:
        """Raise InvalidInput unless the model is that of a robot of this mass and these limbs."""
        if self.limb_names != model.leg_names:
            kind = "feet" if self.feet else "limbs"
            raise InvalidInput(
                f"robot {self.name}: expected {kind} as its model has legs, "
                f"{', '.join(model.leg_names)}, got "
                f"{', '.join(self.limb_names)}"
            )
        if self.drawn is not None:
            raise InvalidInput(
                f"robot {self.name}: drawn: expected no drawn legs beside those of its model, got "
                "both"
            )
        if not self.feet and abs(self.mass_kg - model.mass_kg) > _SAME * self.mass_kg:
            raise InvalidInput(
                f"robot {self.name}: expected the mass of its model, {model.mass_kg:.9g} kg, "
                "got "
                f"{self.mass_kg:.9g}"
            )
        for limb, leg in zip(self.limbs, model.legs, strict=True):
            mine, its = limb.sole_m, leg.sole
            held = its is None if mine is None else its is not None and its.holds(mine)
            if not held:
                raise InvalidInput(
                    f"robot {self.name}: limb {limb.name}: sole_m: expected points of the soles that "
                    "its model has there, got other values"
                )

    def check_limbs(self) -> None:
        """Raise InvalidInput for a robot whose limbs are the boxes of a walker's feet."""
        if self.feet:
            raise InvalidInput(
                f"robot: expected one with limbs that reach, got {self.name}, which has the feet "
                "of a walker: "
                "give its URDF"
            )

    def to_json(self) -> dict[str, Any]:
        """JSON-ready values of its limbs, or its feet, and of what makes its legs."""
        if self.feet:
            walks = ("name", "mass_kg", "inertia_kgm2", "feet", "stand_height_m", "trunk_half_m")
            return {name: to_json(getattr(self, name)) for name in walks} | self.legs_to_json()
        reach = {"relative_reach": to_json(self.relative_reach)} if self.relative_reach else {}
        record = {"name": self.name, "mass_kg": self.mass_kg, "limbs": to_json(self.limbs)}
        absent = {"absent": list(self.absent)} if self.absent else {}
        return record | reach | self.legs_to_json() | absent

    @property
    def own(self) -> bool:
        """Tell whether legs and reach are those of a file, so that plans keep to inner sets of the
        legs and have joints, and proofs are over outer sets.
        """
        return self.model is not None

    @property
    def legs(self) -> RobotModel:
        """The robot joint by joint: its own model, or the legs that are drawn up for its limbs.

        Loads pinocchio. Raises InvalidInput where neither is known, and without pinocchio.
        """
        return self.legs_with(self.drawn)

    def legs_with(self, servo: Servo | None) -> RobotModel:
        """The robot joint by joint, with a drive of drawn-up legs in place of its own; None for its
        own.

        Raises InvalidInput as ``legs`` does.
        """
        if self.model is not None:
            return self.model
        if self.drawn is None:
            raise no_legs(self.name)
        from .robot_file import drawn_model  # slow to import

        return drawn_model(self, servo or self.drawn)

    def own_model(self) -> RobotModel:
        """The model of the robot's own file.

        Raises InvalidInput for a robot without one.
        """
        if self.model is None:
            raise InvalidInput(
                f"robot: expected one whose legs are known, got {self.name}, of which only "
                "the limbs are known"
            )
        return self.model

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of all joints, limb by limb, from the base outward, yaw, hip, roll and knee of
        those drawn up (``LF_yaw``); none where no legs are known.
        """
        if self.model is not None:
            return self.model.joint_names
        limbs = () if self.drawn is None else self.limb_names
        return tuple(f"{limb}_{joint}" for limb in limbs for joint in JOINTS)

    @property
    def foot_radii_m(self) -> Array:
        """Radii of the feet, shape (N,) [m]: as the file has them, or by the reach of limbs."""
        if self.model is not None:
            return np.array([leg.radius_m for leg in self.model.legs])
        if self.drawn is not None:
            return np.array([limb.reach_m / USUAL_REACH_M * FOOT_RADIUS_M for limb in self.limbs])
        return np.full(len(self.limbs), 0.0 if self.feet else FOOT_RADIUS_M)

    @property
    def known_radius_m(self) -> float:
        """Largest radius of a foot that the robot's file has, 0 where none says one [m]."""
        return float(self.foot_radii_m.max()) if self.own else 0.0

    @property
    def digest(self) -> str:
        """SHA-256 of a file's legs; empty without a file."""
        return "" if self.model is None else self.model.digest

    @property
    def unrunnable(self) -> tuple[str, ...]:
        """Reasons why a simulation refuses the legs as their file is, a line each."""
        return () if self.model is None else self.model.unrunnable

    @property
    def doubts(self) -> tuple[str, ...]:
        """Numbers of the robot's file that are hard to believe, one line each."""
        return () if self.model is None else self.model.doubts

    @property
    def hindrance(self) -> str:
        """The reason why nothing executes plans of such legs; empty where something does: what the
        joints of a file cannot do, ``unrunnable`` names.
        """
        if self.drawn is None:
            return "" if self.own else str(no_legs(self.name))
        from .robot_file import drawn_urdf  # asked for by few

        try:
            drawn_urdf(self)
        except InvalidInput as error:
            return str(error)
        return ""

    def legs_to_json(self) -> dict[str, Any]:
        """The keys of a robot in files that say its legs, or whose reach it has; a servo where the
        limbs do not say it, as those of the default hexapod do.
        """
        if self.model is not None:
            from .robot_file import model_to_json  # reads URDFs, which is slow to import

            return {"model": model_to_json(self.model)}
        if self.drawn is None:
            return {"identity": self.identity} if self.identity and not self.feet else {}
        legs = {} if self.usual else {"legs": to_json(self.drawn)}
        return {**({"identity": self.identity} if self.identity else {}), **legs}

    @property
    def usual(self) -> bool:
        """Tell whether it is the hexapod with its usual drives."""
        return self.drawn == _USUAL_SERVO and self._is_hexapod()

    def turned(self, frame: Frame) -> Robot:
        """The robot on its limbs as it faces in a world that is turned with it."""
        limbs = (
            replace(
                limb,
                shoulder_m=frame.vectors(limb.shoulder_m),
                hip_m=None if limb.hip_m is None else frame.vectors(limb.hip_m),
                leg=limb.leg and replace(limb.leg, hip_m=frame.vectors(limb.leg.hip_m)),
                reach_rows=limb.reach_rows and limb.reach_rows.turned(frame),
            )
            for limb in self.limbs
        )
        reach = (replace(each, rows=each.rows.turned(frame)) for each in self.relative_reach)
        model = self.model
        if model is not None and frame.heading_rad:
            from .robot_file import turned_model  # reads URDFs, which is slow to import

            model = turned_model(model, frame.heading_rad)
        return replace(self, limbs=tuple(limbs), relative_reach=tuple(reach), model=model)

    def sets(self, which: Sets, tilt_rad: float = 0.0) -> Robot:
        """Robot over the inner sets of its legs, which they surely reach, or over the outer ones,
        which hold all that they might reach within this limit of the body's tilt.

        Raises InvalidInput for a robot without legs of its own, and for a leg without a workspace
        that has an inside.
        """
        from .reach_sets import limbs_over  # measures legs, which is slow to import

        limbs = limbs_over(self.own_model(), which, tilt_rad=tilt_rad)
        rows = self.relative_reach if which == "inner" else ()
        return replace(self, feet=(), limbs=limbs, relative_reach=rows)

    @property
    def size(self) -> float:
        """Size of the robot, 1 for the default hexapod and for a dog with legs of 0.48 m: lengths
        that are not given scale with it.
        """
        if self.own:
            return self.own_model().size
        return max((limb.reach_m for limb in self.limbs), default=USUAL_REACH_M) / USUAL_REACH_M

    @property
    def weight_n(self) -> float:
        """Weight m·g, the unit of forces of the gait optimiser [N]."""
        return self.mass_kg * GRAVITY_M_S2

    @property
    def servo(self) -> Servo:
        """The drives of legs that are drawn up."""
        return self.drawn or _USUAL_SERVO

    @property
    def inertia(self) -> Array | None:
        """Inertia about the centre of mass, its own or its model's, shape (3, 3) [kg m²]; None if
        unknown.
        """
        if self.inertia_kgm2 is not None:
            return self.inertia_kgm2
        return None if self.model is None else self.model.inertia_kgm2

    @property
    def origin_m(self) -> Array:
        """p_BO, the origin of the limbs' coordinates in the base of the robot's legs, shape (3,)
        [m].

        For a robot with a model, the centre of mass of its standing posture, Lin et al.'s body
        origin; else 0.
        """
        return np.zeros(3) if self.model is None else self.model.com_m

    @property
    def limb_names(self) -> tuple[str, ...]:
        """Names of the limbs, in the robot's order."""
        return tuple(limb.name for limb in self.limbs)

    def select(self, names: Sequence[str]) -> tuple[Limb, ...]:
        """Return the limbs of these names, in this order.

        Raises InvalidInput for a name the robot does not have.
        """
        by_name = {limb.name: limb for limb in self.limbs}
        for name in names:
            checked_choice(name, "leg", by_name)
        return tuple(by_name[name] for name in names)


def _checked_inertia(value: Any, where: str) -> Array:
    """A symmetric positive definite matrix whose principal moments a body can have, shape (3, 3)
    [kg m²].
    """
    matrix = read_only(value, (3, 3), where)
    if not np.allclose(matrix, matrix.T, atol=1e-9 + 1e-6 * float(np.abs(matrix).max())):
        raise InvalidInput(f"{where}: expected a symmetric matrix, got {matrix.tolist()}")
    moments = np.linalg.eigvalsh(matrix)
    if moments[0] <= 0.0 or moments[0] + moments[1] < (1.0 - 1e-6) * moments[2]:
        raise InvalidInput(
            f"{where}: expected moments that a body can have, got {moments.round(6).tolist()}"
        )
    return matrix


def hexapod() -> Robot:
    """The default robot: six four-joint limbs on a hexagon of 0.18 m, 10 kg, 0.35 m of reach.

    Returns:
        A ``Robot`` with the limbs LF, LM, LR, RF, RM, RR.
    Source:
        Lin et al. §IV-B.

    Example:
        >>> from stancekit import hexapod
        >>> hexapod().mass_kg, len(hexapod().limbs)
        (10.0, 6)
    """
    return Robot(name=_HEXAPOD, mass_kg=10.0, limbs=_hexapod_limbs())


@lru_cache(maxsize=1)
def _hexapod_limbs() -> tuple[Limb, ...]:
    radius_m, reach_m = 0.18, USUAL_REACH_M
    azimuth_deg = {"LF": 30.0, "LM": 90.0, "LR": 150.0, "RF": -30.0, "RM": -90.0, "RR": -150.0}
    return tuple(
        Limb(
            name=name,
            shoulder_m=radius_m * np.array([np.cos(np.deg2rad(deg)), np.sin(np.deg2rad(deg)), 0.0]),
            reach_m=reach_m,
        )
        for name, deg in azimuth_deg.items()
    )


def _same_limb(one: Limb, other: Limb) -> bool:
    """Tell whether both have one name, shoulder and ball of reach, and nothing else."""
    plain = one.reach_rows is None and one.sole_m is None
    near = (
        abs(one.reach_m - other.reach_m) <= _SAME
        and float(np.abs(one.shoulder_m - other.shoulder_m).max()) <= _SAME
    )
    return plain and near and one.name == other.name


def _check_feet(robot: Robot) -> None:
    """Raise InvalidInput for a robot whose feet, height and trunk are not those of one that walks."""
    where = f"robot {robot.name}"
    set_field = object.__setattr__
    if robot.inertia_kgm2 is None:
        raise InvalidInput(f"{where}: inertia_kgm2: expected that of a robot that walks, got none")
    inertia = robot.inertia_kgm2
    collect_errors(
        lambda: set_field(
            robot,
            "stand_height_m",
            checked(robot.stand_height_m, f"{where}: stand_height_m", above=0.0),
        ),
        lambda: set_field(
            robot, "trunk_half_m", half_sides(robot.trunk_half_m, f"{where}: trunk_half_m")
        ),
    )
    names = [foot.name for foot in robot.feet]
    if len(names) < 3 or len(set(names)) != len(names):
        raise InvalidInput(f"{where}: expected three or more feet of different names, got {names}")
    if robot.own:
        _check_model(robot, inertia, robot.own_model(), where)
    _check_numbers(robot, inertia, where)


def _check_model(robot: Robot, inertia: Array, model: RobotModel, where: str) -> None:
    """Raise InvalidInput for numbers that are not its model's.

    It may stand lower, crouched, and not higher.
    """
    mass_kg, expected = model.mass_kg, model.inertia_kgm2
    if abs(robot.mass_kg - mass_kg) > _SAME_AS_MODEL * mass_kg:
        raise InvalidInput(
            f"{where}: expected the mass of its model, {mass_kg:.8g} kg, got {robot.mass_kg:.8g}"
        )
    if not float(np.abs(inertia - expected).max()) <= _SAME_AS_MODEL * float(
        np.abs(expected).max()
    ):
        raise InvalidInput(
            f"{where}: expected the inertia of its model as it stands, got another one"
        )
    low_m, high_m = (1.0 - DEEPEST) * model.stand_height_m, model.stand_height_m
    if (
        not (1.0 - _SAME_AS_MODEL) * low_m
        <= robot.stand_height_m
        <= (1.0 + _SAME_AS_MODEL) * high_m
    ):
        raise InvalidInput(
            f"{where}: expected to stand as high as its model, {high_m:.6g} m, or crouched down to "
            f"{low_m:.6g} m, "
            f"got {robot.stand_height_m:.6g}"
        )


def _check_numbers(robot: Robot, inertia: Array, where: str) -> None:
    """Raise InvalidInput for a height at which its feet do not stand, and for an inertia that
    no mass within it has: tolerances of the verifier are in units of both.
    """
    stands_m = -float(np.mean([foot.nominal_m[2] for foot in robot.feet]))
    if not abs(robot.stand_height_m - stands_m) <= _NEAR * abs(stands_m):
        raise InvalidInput(
            f"{where}: stand_height_m: expected {stands_m:.6g} m, which its feet are below its "
            "centre of mass, got "
            f"{robot.stand_height_m:.6g}"
        )
    corners = [
        np.maximum(np.abs(foot.reach_min_m), np.abs(foot.reach_max_m)) for foot in robot.feet
    ]
    most = robot.mass_kg * max(float(corner @ corner) for corner in (robot.trunk_half_m, *corners))
    if (moment := float(np.linalg.eigvalsh(inertia)[-1])) > most:
        raise InvalidInput(
            f"{where}: inertia_kgm2: expected moments up to {most:.3g} kg m², as far as its trunk "
            "and its feet go, "
            f"got {moment:.3g}"
        )


def robot_of(model: RobotModel) -> Robot:
    """A robot of this model's legs, each reaching as far as it is long, from the centre of mass as
    it stands.
    """
    limbs = tuple(
        Limb(
            name=leg.name,
            shoulder_m=leg.hip_m - model.com_m,
            reach_m=leg.chain.length_m + leg.radius_m,
            sole_m=None if leg.sole is None else leg.sole.points_m,
        )
        for leg in model.legs
    )
    return Robot(name=model.name, mass_kg=model.mass_kg, limbs=limbs, model=model)


def walking_robot(robot: Robot) -> Robot:
    """The robot with limbs and joints of a walk's robot.

    Raises InvalidInput where its joints are not known.

    The robot of a walk is a body with boxes of reach, which may have the model of its legs; of the
    robots that come with the package the hexapod has joints, too.
    """
    if robot.own:
        return robot_of(robot.own_model())
    known = hexapod()
    shoulders = {limb.name: limb.shoulder_m for limb in known.limbs}
    same = robot.limb_names == known.limb_names and np.isclose(robot.mass_kg, known.mass_kg)
    if not same or not all(np.allclose(foot.hip_m, shoulders[foot.name]) for foot in robot.feet):
        raise no_legs(robot.name)
    return known
