"""A problem: what a robot is asked, at one key frame or over several (E1-E11), with the candidate
patches of every toe.

A *foothold* is one toe put down, by a limb, at a key frame, on one of its candidate patches; it
stays until the limb's next foothold. A *stance* is a set of limbs that must carry the robot alone
at a key frame. Between two key frames the limbs of the schedule lift; the others must hold the
robot both before and after the body has moved. Since their toes stay and the balances are linear in
(c, f) once toes are held, two such stances hold everywhere between them.

A *posture problem* is a problem of one frame and one stance without an objective: can the robot
hold still on these patches, and how? A *course* has an objective, and usually several frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.arrays import (
    Array,
    checked,
    checked_choice,
    checked_int,
    checked_members,
    collect_errors,
    locked,
    read_only,
)
from ..files.codec import LATER, UNWRITTEN, fields_to_json, from_json, to_json
from ..files.documents import shown
from ..physics import GRAVITY_M_S2
from ..robot.model import Limb, Robot, hexapod
from ..terrain.patch import Frame, Patch
from ..terrain.polygon import sole_offsets, sole_region
from .contact import (
    OPEN,
    Contact,
    Foothold as Foothold,
    Stance as Stance,
    StepLimits as StepLimits,
    Weights as Weights,
    checked_wrench,
)
from .posture import BODY, TILT_LIMIT_RAD, PostureKeys, checked_body

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets

Value = TypeVar("Value")
MOST_FRAMES = 1000
NOBODY_CARRIES = "no limb carries between frames"
_MOST_TILT_RAD = 0.5
"""Largest limit of the tilt in a course [rad]."""
_ROUND_M = 10.0
"""Problems far away are computed about an origin that is this round [m]."""
_FAR = 30.0
"""A length scale that is larger or smaller than a robot by more is no unit to compute in."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """M key frames of one robot over one terrain, M ≥ 1.

    Usually laid out from YAML: ``load("my-course.yaml")``; or of one frame,
    ``Problem.posture(contacts, ...)``.

    Arguments:
        name: name of the problem, used in messages and files.
        robot: the robot whose limbs are placed.
        terrain: every surface there is; footholds have to be pieces of it, or no plan on them is
            accepted.
        footholds: places where toes are put down, in order of frame, then limb; every limb has one
            at frame 0.
        lifts: limbs that move between frames k − 1 and k, one tuple per frame, the first empty.
        next_lift: the limbs that would move after the last frame; what they leave behind must hold
            there, too.
        com_nominal_m: nominal positions of the centre of mass, shape (M, 3) [m].
        com_radius_m: largest distance of the centre of mass from there, shape (M,) [m].
        goal_m: goal of the last centre of mass, shape (3,) [m].
        steps: largest steps between neighbouring frames.
        weights: weights of the objective; None if any feasible plan will do.
        tilt_limit_rad: largest component of Θ, within which the rotation is linearised [rad].
        gravity_m_s2: g [m/s²].
        length_scale_m: unit of non-dimensional lengths (E4) [m].
        force_scale_n: unit of non-dimensional forces (E3) [N]; the weight where None.
        force_min, force_max: bounds on (f_n, f_y, f_z) of every contact in units of the force
            scale, shape (3,), unless a foothold has its own.
        modes: mode of the terrain under each frame (0, 1, …), if known, shape (M,); used in reports
            only.
        push_n: horizontal push at the centre of mass, in any direction, that every stance has to
            bear [N].
        standing_m: vectors from the centre of mass to each toe of the standing robot at each frame,
            to which ``weights.stance`` draws toes, shape (M, N, 3) [m].
        wrench: force [N] and moment about the centre of mass [Nm] that act on the body in addition
            to its weight at each frame, such as those of a payload, wind or a rope, in world axes,
            shape (M, 6) (``problem.wrench``); None for none.
        doubts: what the reader of the ground's file mended or left out, one line each.
        sides: half-spaces n·Δ ≥ b, rows (n, b), one for each of ``least_steps``, in the place of
            ‖Δ‖ ≥ δ, as a planner that branches over directions asks for them, shape (E, 4); None
            where the least steps are asked for. No file has them.

    Raises:
        InvalidInput: for a schedule and footholds that do not fit each other, wrong shapes, numbers
            out of range.
    Source:
        Lin et al. §II and §IV-B, E1-E11.

    Example:
        >>> import stancekit
        >>> course = stancekit.plan("walls", frames=4).solution.problem
        >>> course.frames, len(course.stances), course.robot.name
        (4, 7, 'hexapod')
        >>> problem = stancekit.sample("wall-3", rng=0)[0]
        >>> problem.frames, problem.legs, round(problem.weight_n, 1)
        (1, ('RF', 'RR', 'LM'), 98.1)
        >>> stancekit.Problem.from_json(problem.to_json()).to_json() == problem.to_json()
        True
    """

    FORMAT: ClassVar = "stancekit/course/1"
    word: ClassVar[str] = "plan"

    name: str
    robot: Robot
    terrain: tuple[Patch, ...]
    footholds: tuple[Foothold, ...] = field(metadata={"key": "placements"})
    lifts: tuple[tuple[str, ...], ...]
    next_lift: tuple[str, ...] = ()
    com_nominal_m: Array
    com_radius_m: Array
    goal_m: Array
    force_min: Array = field(default_factory=lambda: np.array([0.0, -1.0, -1.0]))
    force_max: Array = field(default_factory=lambda: np.ones(3))
    tilt_limit_rad: float = TILT_LIMIT_RAD
    gravity_m_s2: float = GRAVITY_M_S2
    length_scale_m: float = 0.6
    force_scale_n: float | None = field(default=None, metadata=LATER)
    steps: StepLimits = field(default_factory=StepLimits)
    weights: Weights | None = field(default_factory=Weights)
    standing_m: Array | None = field(default=None, metadata=LATER)
    push_n: float = field(default=0.0, metadata=LATER)
    wrench: Array | None = field(default=None, metadata=LATER)
    modes: tuple[int, ...] | None = None
    doubts: tuple[str, ...] = field(default=(), metadata=LATER)
    sides: Array | None = field(default=None, metadata=UNWRITTEN)

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        collect_errors(
            lambda: set_field(self, "name", _text(self.name, "name")),
            lambda: checked_members((self.robot,), Robot, "robot"),
            lambda: set_field(self, "terrain", checked_members(self.terrain, Patch, "terrain")),
            lambda: set_field(
                self, "footholds", checked_members(self.footholds, Foothold, "placements")
            ),
            lambda: set_field(self, "lifts", _limb_sets(self.lifts)),
            lambda: set_field(self, "next_lift", checked_members(self.next_lift, str, "next_lift")),
            lambda: set_field(self, "doubts", checked_members(self.doubts, str, "doubts")),
            lambda: checked_members((self.steps,), StepLimits, "steps"),
            lambda: self.weights is None or checked_members((self.weights,), Weights, "weights"),
            lambda: self.modes is None or set_field(self, "modes", _modes(self.modes)),
        )
        frames = len(self.lifts)
        tilted = 0.5 * np.pi if self.weights is None else _MOST_TILT_RAD
        if not 1 <= frames <= MOST_FRAMES:
            raise InvalidInput(f"frames: expected 1 to {MOST_FRAMES} key frames, got {frames}")
        collect_errors(
            lambda: set_field(
                self, "com_nominal_m", read_only(self.com_nominal_m, (frames, 3), "com_nominal_m")
            ),
            lambda: set_field(
                self, "com_radius_m", read_only(self.com_radius_m, (frames,), "com_radius_m")
            ),
            lambda: set_field(self, "goal_m", read_only(self.goal_m, (3,), "goal_m")),
            lambda: set_field(
                self,
                "tilt_limit_rad",
                checked(self.tilt_limit_rad, "tilt_limit_rad", least=0.0, most=tilted),
            ),
            lambda: set_field(
                self, "gravity_m_s2", checked(self.gravity_m_s2, "gravity_m_s2", above=0.0)
            ),
            lambda: set_field(
                self, "length_scale_m", checked(self.length_scale_m, "length_scale_m", above=0.0)
            ),
            lambda: set_field(self, "push_n", checked(self.push_n, "push_n", least=0.0)),
            lambda: set_field(self, "force_min", read_only(self.force_min, (3,), "force_min")),
            lambda: set_field(self, "force_max", read_only(self.force_max, (3,), "force_max")),
            self._check_schedule,
        )
        if self.standing_m is not None:
            shape = (frames, len(self.robot.limbs), 3)
            set_field(self, "standing_m", read_only(self.standing_m, shape, "standing_m"))
        elif self.weights is not None and self.weights.stance > 0.0:
            raise InvalidInput(
                "standing_m: expected the places of the toes as the robot stands, which "
                "weights.stance "
                "needs, got none"
            )
        self.robot.check_limbs()
        if self.force_scale_n is None:
            set_field(self, "force_scale_n", self.weight_n)
        set_field(self, "force_scale_n", checked(self.force_scale_n, "force_scale_n", above=0.0))
        if np.any(self.com_radius_m < 0.0):
            raise InvalidInput(
                f"com_radius_m: expected no negative radius, got {self.com_radius_m.min():g}"
            )
        if self.wrench is not None:
            scales = {"weight_n": self.weight_n, "length_m": self.length_scale_m}
            set_field(self, "wrench", checked_wrench(self.wrench, (frames, 6), **scales))
        _check_bounds(self.force_min, self.force_max, "")
        for index, put_down in (
            enumerate(self.footholds) if frames > 1 else ()
        ):  # of one frame, nobody is in the air
            if put_down.force_min is not None and put_down.force_max is not None:
                _check_bounds(put_down.force_min, put_down.force_max, f"placements[{index}]: ")
        if self.weights is None:
            self._check_posture()
        _ = self.holds  # every limb stands on something from the first frame on
        _ = self.regions
        if self.sides is not None:
            set_field(self, "sides", read_only(self.sides, (len(self.least_steps), 4), "sides"))

    def moved(self, frame: Frame, robot: Robot) -> Problem:
        """The course of point feet in a world that is moved with it.

        The limit of the tilt there is that of the box about the turned one.

        Arguments:
            robot: the robot whose limbs are turned likewise.
        """
        footholds = (
            replace(
                foothold,
                toe_m=None if foothold.toe_m is None else frame.places(foothold.toe_m),
                candidates=tuple(patch.moved(frame) for patch in foothold.candidates),
            )
            for foothold in self.footholds
        )
        stands, wrench = self.standing_m, self.wrench
        tilt_rad = self.tilt_limit_rad * float(np.abs(frame.rotation[0]).sum())
        return replace(
            self,
            robot=robot,
            terrain=tuple(patch.moved(frame) for patch in self.terrain),
            footholds=tuple(footholds),
            com_nominal_m=frame.places(self.com_nominal_m),
            goal_m=frame.places(self.goal_m),
            tilt_limit_rad=min(tilt_rad, _MOST_TILT_RAD),
            standing_m=None if stands is None else frame.vectors(stands),
            wrench=None if wrench is None else frame.vectors(wrench.reshape(-1, 3)).reshape(-1, 6),
        )

    def check_whole(self) -> None:
        """Raise InvalidInput for sides: they say less than the least steps that they stand for, and
        are for planners that go through all of them.
        """
        if self.sides is not None:
            raise InvalidInput("sides: expected none, planners part least steps by themselves")

    @classmethod
    def posture(
        cls,
        contacts: Sequence[Contact],
        *,
        mass_kg: float,
        com_nominal_m: Array | Sequence[float],
        com_radius_m: float,
        gravity_m_s2: float = GRAVITY_M_S2,
        force_scale_n: float | None = None,
        length_scale_m: float = 0.6,
        tilt_limit_rad: float = TILT_LIMIT_RAD,
        robot: str = "",
        push_n: float = 0.0,
        wrench: Array | Sequence[float] | None = None,
    ) -> Problem:
        """Can the robot hold still with these limbs on these patches, and how?

        One frame, without an objective.

        Unknown are the centre of mass c, a small body rotation Θ, a toe on every patch and a force
        at every toe.

        Arguments:
            contacts: one or more, each of another limb.
            mass_kg: mass of the robot [kg].
            com_nominal_m: nominal position of the centre of mass, shape (3,) [m].
            com_radius_m: largest distance from there [m].
            gravity_m_s2, force_scale_n, length_scale_m, tilt_limit_rad: as in ``Problem``.
            robot: identity of the model that the limbs belong to, see ``Robot``; empty without one.
            push_n: horizontal push that the posture has to bear where it is, as in ``Problem`` [N].
            wrench: force [N] and moment about the centre of mass [Nm] on the body in addition to
                its weight, shape (6,).

        Raises:
            InvalidInput: for no contacts, a limb twice, numbers out of range.
        """
        contacts = checked_members(contacts, Contact, "contacts")
        if not contacts:
            raise InvalidInput("contacts: expected one or more, got none")
        legs = [contact.leg for contact in contacts]
        if len(set(legs)) != len(legs):
            raise InvalidInput(f"contacts: expected every leg once, got {legs}")
        for index, contact in enumerate(contacts):
            if contact.sole_m is not None:
                try:
                    _ = contact.region
                except InvalidInput as error:
                    raise InvalidInput(f"contacts[{index}].sole_m: {error}") from None
        body = checked_body(
            mass_kg=mass_kg,
            gravity_m_s2=gravity_m_s2,
            force_scale_n=force_scale_n,
            length_scale_m=length_scale_m,
            com_nominal_m=com_nominal_m,
            com_radius_m=com_radius_m,
            tilt_limit_rad=tilt_limit_rad,
            push_n=push_n,
            wrench=wrench,
        )
        return _posture(contacts, robot, **body)

    @property
    def counts(self) -> str:
        """What moments of an answer count; a posture has one alone."""
        return "" if self.is_posture else "frame"

    def columns(self, rows: int = 0) -> dict[str, tuple[int, ...]]:
        """The shape of each array of a plan, by name; joints of a posture are not computed."""
        limbs, placed = len(self.robot.limbs), len(self.footholds)
        shapes: dict[str, tuple[int, ...]] = {
            "com_m": (self.frames, 3),
            "rotation_rad": (self.frames, 3),
            "toes_m": (placed, 3),
            "choice": (placed,),
            "forces_n": (len(self.stances), limbs, 3),
        }
        if self.has_soles:
            soles = (limb.sole_m for limb in self.robot.limbs)
            points = max(1 if sole is None else len(sole) for sole in soles)
            shapes["points_m"] = (placed, points, 3)
            shapes["point_forces_n"] = (len(self.stances), limbs, points, 3)
        if (self.robot.own and not self.is_posture) or not self.has_soles:
            joints = 0 if self.is_posture else len(self.robot.joint_names)
            shapes["joints_rad"] = (self.frames, joints)
        return {**shapes, "modes": (self.frames,)}

    def hindrance(self, unchecked: Sequence[str]) -> str:
        """The reason why no runner executes a plan, whatever the world; empty where one may."""
        if self.is_posture:
            return ""
        if self.uncarried:
            return NOBODY_CARRIES
        if self.has_soles and not self.robot.own:
            return "its feet are soles of unknown legs"
        return self.robot.hindrance

    def posture_with(self, **changes: Any) -> Problem:
        """The posture problem with other arguments of ``Problem.posture``.

        Raises InvalidInput likewise.
        """
        same: dict[str, Any] = {name: getattr(self, name) for name in BODY}
        same |= {
            "com_nominal_m": self.com_nominal_m[0],
            "com_radius_m": float(self.com_radius_m[0]),
        }
        same["wrench"] = None if self.wrench is None else self.wrench[0]
        return Problem.posture(
            **{"contacts": self.contacts, "robot": self.robot.identity, **same, **changes}
        )

    def course(self, name: str = "posture", robot: Robot | None = None) -> Problem:
        """A posture problem as a course of one frame, any plan of which is as good as another.

        It is in units of the weight, as files of courses are.

        Arguments:
            name: name of the course.
            robot: the robot whose limbs stand, in its own order; joints and bodies of its plans are
                then known for these limbs (``robot.some_legs``). None to judge the reach of the
                limbs alone.

        Raises:
            InvalidInput: for a robot that has not these limbs, or whose legs are not known.
        """
        if robot is not None:
            return self._on(robot, name)
        scale = self.force_n / self.weight_n
        low, high = (scale * bounds for bounds in self.force_bounds)
        footholds = self.footholds
        if max(np.ptp(low, axis=0).max(), np.ptp(high, axis=0).max()) > 0.0:
            footholds = tuple(
                replace(foothold, force_min=least, force_max=most)
                for foothold, least, most in zip(footholds, low, high, strict=True)
            )
            low, high = low * 0.0 + [0.0, -1.0, -1.0], high * 0.0 + 1.0
        else:
            footholds = tuple(
                replace(foothold, force_min=None, force_max=None) for foothold in footholds
            )
        nothing = Weights(goal=0.0, com_step=0.0, toe_step=0.0, tilt=0.0)
        return replace(
            self,
            name=name,
            footholds=footholds,
            force_scale_n=None,
            force_min=low[0],
            force_max=high[0],
            weights=nothing,
        )

    def _on(self, robot: Robot, name: str) -> Problem:
        """``course`` of this robot."""
        from ..robot.walker import on_limbs  # loads pinocchio

        identity = self.robot.identity
        if identity != robot.identity:
            wanted, came = identity or "the default hexapod", robot.identity or robot.name
            raise InvalidInput(
                f"robot: expected {wanted}, whose limbs the posture is of, got {came}"
            )
        robot.select(self.legs)
        contacts = sorted(self.contacts, key=lambda contact: robot.limb_names.index(contact.leg))
        course = self.posture_with(contacts=contacts).course(name)
        return replace(course, robot=on_limbs(robot, course.robot.limbs, self.mass_kg))

    def to_json(self) -> dict[str, Any]:
        """Return the problem in its JSON form, ``stancekit/posture/1`` or ``stancekit/course/1``.

        ``from_json`` gives it back to the last bit.
        """
        if not self.is_posture:
            self.check_whole()
            return fields_to_json(self, ("force_scale_n",) if self.force_n == self.weight_n else ())
        keys = PostureKeys(
            com_nominal_m=self.com_nominal_m[0],
            com_radius_m=float(self.com_radius_m[0]),
            robot=self.robot.identity,
            wrench=None if self.wrench is None else self.wrench[0],
            contacts=self.contacts,
            **{name: getattr(self, name) for name in BODY if not name.startswith("com_")},
        )
        return fields_to_json(keys)

    @classmethod
    def from_json(cls, data: Mapping[str, Any], *, robot: Robot | None = None) -> Problem:
        """Read the JSON form of a problem.

        Arguments:
            robot: robot of a posture problem, whose limbs must be the legs of the file; None for
                the robot that the file names, or the hexapod.

        Raises:
            InvalidInput: whose message lists every key that is wrong, separated by "; ".
        """
        if not isinstance(data, Mapping):
            forms = f"{PostureKeys.FORMAT!r} or {cls.FORMAT!r}"
            raise InvalidInput(
                f"expected a JSON object with format {forms}, got {type(data).__name__}"
            )
        if str(data.get("format")).startswith("stancekit/motion/"):
            raise InvalidInput("expected a posture or a course, got the file of a motion")
        if str(data.get("format")).startswith("stancekit/course/"):
            course = from_json(cls, data)
            if course.weights is None:
                raise InvalidInput("weights: expected the weights of an objective, got none")
            return course
        keys = from_json(PostureKeys, data)
        known = robot or (None if keys.robot else hexapod())
        if known is not None:
            legs = [
                (contact.leg, f"contacts[{index}].leg")
                for index, contact in enumerate(keys.contacts)
            ]
            collect_errors(
                *(partial(checked_choice, leg, where, known.limb_names) for leg, where in legs)
            )
        return cls.posture(**vars(keys))

    @property
    def is_posture(self) -> bool:
        """Tell whether it is a posture problem: one frame, one stance, and no objective.

        Its solution is a ``Posture``, a certificate of it has to leave room, and planners decide it
        in place of looking for the best plan.
        """
        return self.weights is None

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """The limbs of a posture problem, each on its patch.

        Raises InvalidInput for other problems.
        """
        if not self.is_posture:
            raise InvalidInput(
                f"contacts: expected a posture problem, got a course of {self.frames} frames"
            )
        return self._contacts(self.stances[0], [0] * len(self.footholds))

    @property
    def legs(self) -> tuple[str, ...]:
        """Names of the limbs, in the robot's order."""
        return self.robot.limb_names

    @property
    def mass_kg(self) -> float:
        """Mass of the robot [kg]."""
        return self.robot.mass_kg

    @property
    def moment_scale_nm(self) -> float:
        """Unit of the non-dimensional moment: force scale times ``unit_m`` [Nm]."""
        return self.force_n * self.unit_m

    @property
    def aim(self) -> Weights:
        """The weights of the objective.

        Raises InvalidInput where there is none.
        """
        if self.weights is None:
            raise InvalidInput(
                "weights: expected a course with an objective, got a posture problem"
            )
        return self.weights

    @cached_property
    def unit_m(self) -> float:
        """Unit of lengths for computing: the length scale, or the robot's size where the two differ
        so much that precision would be lost [m].
        """
        limbs, unit_m = self.robot.limbs, self.length_scale_m
        size_m = max(float(np.abs(each.shoulder_m).max()) + each.reach_m for each in limbs)
        return unit_m if size_m <= _FAR * unit_m and unit_m <= _FAR * size_m else size_m

    @property
    def sets(self) -> Sets | None:
        """The sets of its model's legs that the robot's limbs have; None where it has no model, or they
        have others.
        """
        from ..robot.walker import sets_of  # measures legs, which is slow to import

        return sets_of(self.robot, self.tilt_limit_rad)

    @cached_property
    def origin_m(self) -> Array:
        """Place about which it is computed: the world's origin, or a round place where the first
        centre of mass is far from that, so that no digits of moments are lost, shape (3,) [m].
        """
        return local_origin(self.com_nominal_m[0])

    @property
    def force_n(self) -> float:
        """Unit of the non-dimensional force: the force scale, the weight unless another is given
        [N].
        """
        assert self.force_scale_n is not None
        return self.force_scale_n

    @cached_property
    def common_bounds(self) -> tuple[Array, Array]:
        """The forces (f_n, f_y, f_z) that every foothold admits, least and largest, in units of the
        weight, (3,).
        """
        low, high = self.force_bounds
        share = self.force_n / self.weight_n
        return share * low.max(axis=0), share * high.min(axis=0)

    @cached_property
    def force_bounds(self) -> tuple[Array, Array]:
        """Least and largest (f_n, f_y, f_z) on every foothold, in units of the force scale, shape
        (P, 3) each.
        """
        low = [
            self.force_min if foothold.force_min is None else foothold.force_min
            for foothold in self.footholds
        ]
        high = [
            self.force_max if foothold.force_max is None else foothold.force_max
            for foothold in self.footholds
        ]
        return np.array(low), np.array(high)

    @property
    def frames(self) -> int:
        """M."""
        return len(self.lifts)

    @property
    def weight_n(self) -> float:
        """m·g [N]."""
        return self.robot.mass_kg * self.gravity_m_s2

    @cached_property
    def holds(self) -> NDArray[np.int_]:
        """The foothold that each limb stands on at each frame, shape (M, N)."""
        names = self.robot.limb_names
        table = np.full((self.frames, len(names)), -1)
        for index, foothold in enumerate(self.footholds):
            table[foothold.frame :, names.index(foothold.limb)] = index
        if np.any(table < 0):
            limb = names[int(np.argwhere(table < 0)[0, 1])]
            raise InvalidInput(
                f"placements: expected one at frame 0 for every limb, got none for {limb}"
            )
        table.setflags(write=False)
        return table

    @cached_property
    def offsets_m(self) -> tuple[tuple[Array, ...], ...]:
        """From the toe of each foothold to the points that bear forces, on each candidate, shape
        (K, 3) [m].
        """
        soles = {limb.name: limb.sole_m for limb in self.robot.limbs}
        point = np.zeros((1, 3))
        return tuple(
            tuple(
                point if (sole := soles[foothold.limb]) is None else sole_offsets(sole, patch, yaw)
                for patch, yaw in zip(
                    foothold.candidates,
                    foothold.yaws_rad or (0.0,) * len(foothold.candidates),
                    strict=True,
                )
            )
            for foothold in self.footholds
        )

    @cached_property
    def regions(self) -> tuple[tuple[Patch, ...], ...]:
        """Regions in which the toe of each foothold may be on each candidate: the patch, or what a
        sole leaves of it.

        Raises InvalidInput where a sole has no room.
        """
        if not self.has_soles:
            return tuple(foothold.candidates for foothold in self.footholds)
        result = []
        for index, (foothold, offsets) in enumerate(
            zip(self.footholds, self.offsets_m, strict=True)
        ):
            regions = foothold.candidates
            if len(offsets[0]) > 1:
                try:
                    regions = tuple(
                        sole_region(*pair)
                        for pair in zip(foothold.candidates, offsets, strict=True)
                    )
                except InvalidInput as error:
                    raise InvalidInput(
                        f"placements[{index}]: frame {foothold.frame}, limb {foothold.limb}: "
                        f"{error}"
                    ) from None
            result.append(regions)
        return tuple(result)

    @property
    def has_soles(self) -> bool:
        """Tell whether any foot is a sole."""
        return any(limb.sole_m is not None for limb in self.robot.limbs)

    @cached_property
    def stances(self) -> tuple[Stance, ...]:
        """Every set of limbs that must carry the robot alone, by frame: after the move to the
        frame, before the next.

        Where all limbs move at once no limb is left to carry, and all of them must at the
        frame itself.
        """
        names = self.robot.limb_names
        everybody = tuple(range(len(names)))
        result = []
        for k in range(self.frames):
            moved, moving = (
                self.lifts[k],
                self.lifts[k + 1] if k + 1 < self.frames else self.next_lift,
            )
            sets = [
                tuple(i for i in everybody if names[i] not in lifted)
                for lifted in (moved, moving)
                if lifted
            ]
            groups = [limbs for limbs in dict.fromkeys(sets) if limbs]
            result += [Stance(k, limbs) for limbs in groups or [everybody]]
        return tuple(result)

    @cached_property
    def uncarried(self) -> tuple[int, ...]:
        """The frames before which all limbs lift at once, so that no limb carries the robot there:
        such a course asks for the frames alone, and no plan of it can be executed.
        """
        return tuple(
            k for k, lifted in enumerate(self.lifts) if len(lifted) == len(self.robot.limbs)
        )

    def direction(self, frame: int) -> Array:
        """Unit vector of the nominal step to ``frame`` from the one before, shape (3,); zero where
        it does not move.
        """
        step = self.com_nominal_m[frame] - self.com_nominal_m[frame - 1]
        length = float(np.linalg.norm(step))
        return step / length if length > 1e-9 else np.zeros(3)

    def patch(self, foothold: int, choice: Sequence[int] | NDArray[np.int_]) -> Patch:
        """The patch that was chosen for a foothold.

        Arguments:
            choice: candidate's index a foothold, shape (P,).
        """
        return self.footholds[foothold].candidates[int(choice[foothold])]

    def posture_problem(self, stance: Stance, choice: Sequence[int] | NDArray[np.int_]) -> Problem:
        """The posture problem of one stance on the chosen patches."""
        return Problem.posture(
            self._contacts(stance, choice),
            mass_kg=self.robot.mass_kg,
            com_nominal_m=self.com_nominal_m[stance.frame],
            com_radius_m=float(self.com_radius_m[stance.frame]),
            gravity_m_s2=self.gravity_m_s2,
            force_scale_n=self.force_scale_n,
            length_scale_m=self.length_scale_m,
            tilt_limit_rad=self.tilt_limit_rad,
            robot=self.robot.identity,
            push_n=self.push_n,
            wrench=None if self.wrench is None else self.wrench[stance.frame],
        )

    def _contacts(
        self, stance: Stance, choice: Sequence[int] | NDArray[np.int_]
    ) -> tuple[Contact, ...]:
        """The limbs of a stance on the chosen patches."""
        contacts, (low, high) = [], self.force_bounds
        for limb in stance.limbs:
            owner = self.robot.limbs[limb]
            foothold = int(self.holds[stance.frame, limb])
            yaws = self.footholds[foothold].yaws_rad
            contacts.append(
                Contact(
                    leg=owner.name,
                    shoulder_m=owner.shoulder_m,
                    reach_m=owner.reach_m,
                    patch=self.patch(foothold, choice),
                    force_min=low[foothold],
                    force_max=high[foothold],
                    reach_rows=owner.reach_rows,
                    sole_m=owner.sole_m,
                    yaw_rad=yaws[int(choice[foothold])] if yaws else 0.0,
                )
            )
        return tuple(contacts)

    @property
    def moves(self) -> NDArray[np.int_]:
        """(foothold before, foothold after) of every toe that moves, by frame, then limb, shape
        (K, 2).
        """
        changed = self.holds[1:] != self.holds[:-1]
        return np.stack([self.holds[:-1][changed], self.holds[1:][changed]], axis=1)

    @property
    def least_steps(self) -> Array:
        """δ of every step that has a least length, those of toes in the order of ``moves`` [m], then
        those of the rotation [rad], shape (E,).
        """
        toes, turns = self._least_counts
        return np.repeat([self.steps.least_toe_m, self.steps.least_rotation_rad], [toes, turns])

    @property
    def side_rows(self) -> tuple[Array, Array]:
        """Rows (n, b) of n·Δ ≥ b of the least steps of toes [m] and of the rotation [rad], which
        hold always where a side is open; shapes (·, 4).
        """
        count = sum(self._least_counts)
        rows = np.full((count, 4), OPEN) if self.sides is None else self.sides
        toes = self._least_counts[0]
        return rows[:toes], rows[toes:]

    @property
    def _least_counts(self) -> tuple[int, int]:
        """Numbers of toes' steps, and of the rotation's, that have a least length."""
        toes = len(self.moves) if self.steps.least_toe_m > 0.0 else 0
        return toes, self.frames - 1 if self.steps.least_rotation_rad > 0.0 else 0

    def wrench_at(self, frame: float) -> Array | None:
        """The wrench at a key frame or between two, where it goes over from one to the other, shape
        (6,); None for none.
        """
        if self.wrench is None:
            return None
        before = min(int(frame), self.frames - 1)
        after, share = min(before + 1, self.frames - 1), frame - before
        return np.asarray((1.0 - share) * self.wrench[before] + share * self.wrench[after])

    def loaded(self, wrench: Array | None) -> Problem:
        """The problem with a wrench on every frame, beside those that it has.

        Arguments:
            wrench: shape (6,), or None for the problem as it is.
        """
        if wrench is None or not wrench.any():
            return self
        before = np.zeros((self.frames, 6)) if self.wrench is None else self.wrench
        return replace(self, wrench=before + wrench)

    def _check_posture(self) -> None:
        """Raise InvalidInput unless it can be asked without an objective, as a posture problem."""
        plain = all(
            len(foothold.candidates) == 1 and foothold.toe_m is None for foothold in self.footholds
        )
        if len(self.lifts) > 1 or self.next_lift or not plain:
            raise InvalidInput(
                "weights: expected the weights of an objective, got none: a posture problem has "
                "one frame, after which "
                "no limb moves, and one candidate for every toe"
            )
        usual: dict[str, Any] = {
            "name": "posture",
            "terrain": [foothold.candidates[0] for foothold in self.footholds],
            "goal_m": self.com_nominal_m[0],
            "steps": _STEPS,
            "modes": None,
            "standing_m": None,
            "sides": None,
        }
        if all(foothold.force_min is not None for foothold in self.footholds):
            usual |= {"force_min": _LOW, "force_max": _HIGH}
        for name, value in usual.items():
            if to_json(getattr(self, name)) != to_json(value):
                raise InvalidInput(
                    f"{name}: expected that of a posture problem, which says nothing beside its "
                    "contacts and body, got another: posture_with changes one as a whole"
                )
        if self.robot.relative_reach:
            raise InvalidInput(
                "robot: expected one without relative_reach in a posture problem, got one with it"
            )

    def _check_schedule(self) -> None:
        """Raise InvalidInput unless the schedule and the footholds say the same."""
        names = self.robot.limb_names
        if self.lifts[0]:
            raise InvalidInput(
                "lifts[0]: expected no limb to move before the first frame, got "
                f"{list(self.lifts[0])}"
            )
        placed = {(foothold.frame, foothold.limb) for foothold in self.footholds}
        if len(placed) != len(self.footholds):
            raise InvalidInput(
                "placements: expected each limb at most once a frame, got something else"
            )
        wanted = {(0, name) for name in names} | {
            (k, name) for k, lifted in enumerate(self.lifts) for name in lifted
        }
        self.robot.select(
            [name for _, name in sorted(wanted | {(0, name) for name in self.next_lift})]
        )
        if placed != wanted:
            frame, limb = sorted(placed ^ wanted)[0]
            message = (
                "a foothold, since it moves there"
                if (frame, limb) in wanted
                else "no foothold: it stays there"
            )
            raise InvalidInput(f"placements: frame {frame}, limb {limb}: expected {message}")
        order = [(foothold.frame, names.index(foothold.limb)) for foothold in self.footholds]
        if order != sorted(order):
            raise InvalidInput("placements: expected them in order of frame, then limb")
        if self.modes is not None and len(self.modes) != self.frames:
            raise InvalidInput(f"modes: expected {self.frames}, one a frame, got {len(self.modes)}")


def local_origin(place_m: Array) -> Array:
    """The round place, shape (3,) [m], about which to compute near a place: the world's origin near
    that.
    """
    return np.asarray(_ROUND_M * np.round(place_m / _ROUND_M))


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise InvalidInput(f"{where}: expected text, got {shown(value)}")
    return value


def _limb_sets(value: Any) -> tuple[tuple[str, ...], ...]:
    """Names of limbs for every frame, as tuples."""
    if not isinstance(value, list | tuple):
        raise InvalidInput(
            f"lifts: expected a list of lists of limbs, one a frame, got {shown(value)}"
        )
    return tuple(checked_members(names, str, f"lifts[{k}]") for k, names in enumerate(value))


def _modes(value: Any) -> tuple[int, ...]:
    """Whole numbers, one a frame."""
    if not isinstance(value, list | tuple):
        raise InvalidInput(f"modes: expected a list of whole numbers, got {shown(value)}")
    return tuple(checked_int(mode, f"modes[{k}]") for k, mode in enumerate(value))


def _check_bounds(low: Array, high: Array, where: str) -> None:
    """Raise InvalidInput for bounds that a limb in the air breaks, or one that presses along its
    normal alone.
    """
    if np.any(low[1:] > 0.0) or np.any(high < np.maximum(low, 0.0)):
        raise InvalidInput(
            f"{where}force_min, force_max: expected bounds that admit forces along the normals "
            "alone, got something else"
        )


def _posture(contacts: tuple[Contact, ...], robot: str, **body: Any) -> Problem:
    """The problem of one frame of contacts and numbers that have been checked."""
    limbs, footholds = [], []
    for contact in contacts:
        limbs.append(
            made(
                Limb,
                name=contact.leg,
                shoulder_m=contact.shoulder_m,
                reach_m=contact.reach_m,
                reach_rows=contact.reach_rows,
                sole_m=contact.sole_m,
                leg=None,
                hip_m=None,
            )
        )
        footholds.append(
            made(
                Foothold,
                limb=contact.leg,
                frame=0,
                candidates=(contact.patch,),
                toe_m=None,
                yaws_rad=() if contact.sole_m is None else (contact.yaw_rad,),
                force_min=contact.force_min,
                force_max=contact.force_max,
            )
        )
    com, radius = body.pop("com_nominal_m"), np.array([body.pop("com_radius_m")])
    radius.setflags(write=False)
    holds, stances = _all_standing(len(contacts))
    return made(
        Problem,
        name="posture",
        terrain=tuple(contact.patch for contact in contacts),
        footholds=tuple(footholds),
        robot=made(
            Robot,
            name="posture",
            mass_kg=body.pop("mass_kg"),
            limbs=tuple(limbs),
            model=None,
            identity=robot,
            relative_reach=(),
            inertia_kgm2=None,
            drawn=None,
            absent=(),
        ),
        lifts=((),),
        next_lift=(),
        com_nominal_m=com[None],
        com_radius_m=radius,
        goal_m=com,
        steps=_STEPS,
        weights=None,
        force_min=_LOW,
        force_max=_HIGH,
        modes=None,
        standing_m=None,
        contacts=contacts,
        holds=holds,
        stances=stances,
        **body,
    )


@lru_cache(maxsize=16)
def _all_standing(count: int) -> tuple[NDArray[np.int_], tuple[Stance, ...]]:
    """``holds`` and ``stances`` where each of so many limbs has a foothold, and all of them
    carry.
    """
    return locked(np.arange(count)[None]), (Stance(0, tuple(range(count))),)


def made(kind: type[Value], **values: Any) -> Value:
    """A value of a class whose fields, or cached properties, have been checked."""
    value = object.__new__(kind)
    vars(value).update(values)
    return value


_STEPS = StepLimits()
_LOW, _HIGH = (
    read_only((0.0, -1.0, -1.0), (3,), "force_min"),
    read_only((1.0, 1.0, 1.0), (3,), "force_max"),
)
