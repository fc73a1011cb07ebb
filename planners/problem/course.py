"""A course: what a plan of key frames is asked for (E11, §IV-B), with the candidate patches of every toe.

A *foothold* is one toe put down, by a limb, at a key frame, on one of its candidate patches; it stays until the limb's
next foothold. A *stance* is a set of limbs that must carry the robot alone at a key frame. Between two key frames the
limbs of the schedule lift; the others must hold the robot both before and after the body has moved. Since their toes
stay and the balances are linear in (c, f) once toes are held, two such stances hold everywhere between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..cached import cached_property
from ..errors import InvalidInput
from ..files.arrays import Array, checked, collect_errors, read_only
from ..physics import GRAVITY_M_S2
from ..robot.model import Limb, Robot
from ..terrain.patch import Patch
from ..terrain.sole import sole_offsets, sole_region
from .foothold import Foothold as Foothold
from .foothold import Stance as Stance
from .limits import StepLimits as StepLimits
from .limits import Weights as Weights
from .posture import TILT_LIMIT_RAD, Contact, PostureProblem

MOST_FRAMES = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """M key frames of one robot over one terrain. Usually laid out from YAML: ``load("my-course.yaml")``.

    Arguments:
        name: of the course.
        robot: whose limbs are placed.
        terrain: every surface there is; footholds have to be pieces of it, or no plan on them is accepted.
        footholds: toes put down, in order of frame, then limb; every limb has one at frame 0.
        lifts: the limbs that move between frame k − 1 and k, a tuple a frame, the first empty.
        next_lift: the limbs that would move after the last frame; what they leave behind must hold there, too.
        com_nominal_m: shape (M, 3) [m].
        com_radius_m: how far the COM may be from it, shape (M,) [m].
        goal_m: where the last COM should be, shape (3,) [m].
        steps: largest steps between neighbouring frames.
        weights: of the objective.
        tilt_limit_rad: largest component of Θ [rad].
        gravity_m_s2: g [m/s²].
        length_scale_m: unit of non-dimensional lengths [m].
        force_min, force_max: bounds on (f_n, f_y, f_z) of every contact in units of the weight, shape (3,).
        modes: mode of the terrain under each frame (0, 1, …), where a course says so, shape (M,): for reports only.
        push_n: horizontal push at the centre of mass, in any direction, that every stance has to bear [N].
        standing_m: from the centre of mass to each toe as the robot stands at each frame, to which ``weights.stance``
            draws toes, shape (M, N, 3) [m].
    Raises:
        InvalidInput: for a schedule and footholds that do not fit each other, wrong shapes, numbers out of range.
    Source:
        Paper E §IV-B, E11.
    Example:
        >>> import stancekit
        >>> course = stancekit.plan("walls", frames=4).solution.course
        >>> course.frames, len(course.stances), course.robot.name
        (4, 7, 'hexapod')
    """

    name: str
    robot: Robot
    terrain: tuple[Patch, ...]
    footholds: tuple[Foothold, ...]
    lifts: tuple[tuple[str, ...], ...]
    next_lift: tuple[str, ...] = ()
    com_nominal_m: Array
    com_radius_m: Array
    goal_m: Array
    steps: StepLimits = field(default_factory=StepLimits)
    weights: Weights = field(default_factory=Weights)
    tilt_limit_rad: float = TILT_LIMIT_RAD
    gravity_m_s2: float = GRAVITY_M_S2
    length_scale_m: float = 0.6
    force_min: Array = field(default_factory=lambda: np.array([0.0, -1.0, -1.0]))
    force_max: Array = field(default_factory=lambda: np.ones(3))
    modes: tuple[int, ...] | None = None
    push_n: float = 0.0
    standing_m: Array | None = None

    def __post_init__(self) -> None:
        frames, put = len(self.lifts), object.__setattr__
        if not 1 <= frames <= MOST_FRAMES:
            raise InvalidInput(f"frames: expected 1 to {MOST_FRAMES} key frames, got {frames}")
        collect_errors(
            lambda: put(self, "com_nominal_m", read_only(self.com_nominal_m, (frames, 3), "com_nominal_m")),
            lambda: put(self, "com_radius_m", read_only(self.com_radius_m, (frames,), "com_radius_m")),
            lambda: put(self, "goal_m", read_only(self.goal_m, (3,), "goal_m")),
            lambda: put(self, "tilt_limit_rad", checked(self.tilt_limit_rad, "tilt_limit_rad", least=0.0, most=0.5)),
            lambda: put(self, "gravity_m_s2", checked(self.gravity_m_s2, "gravity_m_s2", above=0.0)),
            lambda: put(self, "length_scale_m", checked(self.length_scale_m, "length_scale_m", above=0.0)),
            lambda: put(self, "push_n", checked(self.push_n, "push_n", least=0.0)),
            lambda: put(self, "force_min", read_only(self.force_min, (3,), "force_min")),
            lambda: put(self, "force_max", read_only(self.force_max, (3,), "force_max")),
            self._check_schedule,
        )
        if self.standing_m is not None:
            shape = (frames, len(self.robot.limbs), 3)
            put(self, "standing_m", read_only(self.standing_m, shape, "standing_m"))
        elif self.weights.stance > 0.0:
            raise InvalidInput("standing_m: expected where toes are as the robot stands, with weights.stance, got none")
        if np.any(self.com_radius_m < 0.0):
            raise InvalidInput(f"com_radius_m: expected no negative radius, got {self.com_radius_m.min():g}")
        across = slice(1, None)
        if np.any(self.force_min[across] > 0.0) or np.any(self.force_max < np.maximum(self.force_min, 0.0)):
            raise InvalidInput("force_min, force_max: expected bounds that admit forces along the normals alone")
        _ = self.holds  # every limb stands on something from the first frame on
        _ = self.regions

    @classmethod
    def of_posture(cls, problem: PostureProblem, name: str = "posture") -> Course:
        """A posture problem as a course of one frame: a foothold a contact, all of them one stance, and no objective.

        Raises InvalidInput where its force bounds differ between contacts, or admit no limb in the air: a course has
        one pair of bounds, in units of the weight.
        """
        scale = float(problem.force_scale_n or problem.weight_n) / problem.weight_n
        bounds = np.array([[contact.force_min, contact.force_max] for contact in problem.contacts])
        if np.ptp(bounds, axis=0).max() > 0.0:
            raise InvalidInput("contacts: expected one force_min and force_max for all in a course, got several")
        limbs = tuple(
            Limb(name=c.leg, shoulder_m=c.shoulder_m, reach_m=c.reach_m, reach_rows=c.reach_rows, sole_m=c.sole_m)
            for c in problem.contacts
        )
        patches = tuple(contact.patch for contact in problem.contacts)
        return cls(
            name=name,
            robot=Robot(name="posture", mass_kg=problem.mass_kg, limbs=limbs, identity=problem.robot),
            terrain=patches,
            footholds=tuple(
                Foothold(limb=c.leg, frame=0, candidates=(c.patch,), yaws_rad=() if c.sole_m is None else (c.yaw_rad,))
                for c in problem.contacts
            ),
            lifts=((),),
            com_nominal_m=problem.com_nominal_m[None],
            com_radius_m=np.array([problem.com_radius_m]),
            goal_m=problem.com_nominal_m,
            weights=Weights(goal=0.0, com_step=0.0, toe_step=0.0, tilt=0.0),
            tilt_limit_rad=problem.tilt_limit_rad,
            gravity_m_s2=problem.gravity_m_s2,
            length_scale_m=problem.length_scale_m,
            force_min=scale * bounds[0, 0],
            force_max=scale * bounds[0, 1],
        )

    @property
    def frames(self) -> int:
        """M."""
        return len(self.lifts)

    @property
    def weight_n(self) -> float:
        """m·g [N]: also the force scale."""
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
            raise InvalidInput(f"placements: expected one at frame 0 for every limb, got none for {limb}")
        table.setflags(write=False)
        return table

    @cached_property
    def offsets_m(self) -> tuple[tuple[Array, ...], ...]:
        """From the toe of each foothold to the points that bear forces, on each candidate, shape (K, 3) [m]."""
        soles = {limb.name: limb.sole_m for limb in self.robot.limbs}
        point = np.zeros((1, 3))
        return tuple(
            tuple(
                point if (sole := soles[put.limb]) is None else sole_offsets(sole, patch, yaw)
                for patch, yaw in zip(put.candidates, put.yaws_rad or (0.0,) * len(put.candidates), strict=True)
            )
            for put in self.footholds
        )

    @cached_property
    def regions(self) -> tuple[tuple[Patch, ...], ...]:
        """Where the toe of each foothold may be on each candidate: the patch, or what a sole leaves of it.

        Raises InvalidInput where a sole has no room.
        """
        if not self.has_soles:
            return tuple(put.candidates for put in self.footholds)
        found = []
        for index, (put, offsets) in enumerate(zip(self.footholds, self.offsets_m, strict=True)):
            regions = put.candidates
            if len(offsets[0]) > 1:
                try:
                    regions = tuple(sole_region(*pair) for pair in zip(put.candidates, offsets, strict=True))
                except InvalidInput as error:
                    raise InvalidInput(f"placements[{index}]: frame {put.frame}, limb {put.limb}: {error}") from None
            found.append(regions)
        return tuple(found)

    @property
    def has_soles(self) -> bool:
        """Whether any foot is a sole."""
        return any(limb.sole_m is not None for limb in self.robot.limbs)

    @cached_property
    def stances(self) -> tuple[Stance, ...]:
        """Every set of limbs that must carry the robot alone, by frame: after the move to the frame, before the next.

        Where all limbs move at once there is nobody left to carry, and all of them must at the frame itself.
        """
        names = self.robot.limb_names
        everybody = tuple(range(len(names)))
        found = []
        for k in range(self.frames):
            moved, moving = self.lifts[k], self.lifts[k + 1] if k + 1 < self.frames else self.next_lift
            sets = [tuple(i for i in everybody if names[i] not in lifted) for lifted in (moved, moving) if lifted]
            kept = [limbs for limbs in dict.fromkeys(sets) if limbs]
            found += [Stance(k, limbs) for limbs in kept or [everybody]]
        return tuple(found)

    @cached_property
    def uncarried(self) -> tuple[int, ...]:
        """The frames before which all limbs lift at once, so that nobody carries the robot there: such a course asks
        for the frames alone, and no plan of it can be executed."""
        return tuple(k for k, lifted in enumerate(self.lifts) if len(lifted) == len(self.robot.limbs))

    def direction(self, frame: int) -> Array:
        """Unit vector of the nominal step to ``frame`` from the one before, shape (3,); zero where it does not move."""
        step = self.com_nominal_m[frame] - self.com_nominal_m[frame - 1]
        length = float(np.linalg.norm(step))
        return step / length if length > 1e-9 else np.zeros(3)

    def patch(self, foothold: int, choice: Sequence[int] | NDArray[np.int_]) -> Patch:
        """The patch that was chosen for a foothold; choice: candidate's index a foothold, shape (P,)."""
        return self.footholds[foothold].candidates[int(choice[foothold])]

    def posture_problem(self, stance: Stance, choice: Sequence[int] | NDArray[np.int_]) -> PostureProblem:
        """The posture problem of one stance on the chosen patches."""
        contacts = []
        for limb in stance.limbs:
            owner = self.robot.limbs[limb]
            foothold = int(self.holds[stance.frame, limb])
            yaws = self.footholds[foothold].yaws_rad
            contacts.append(
                Contact(
                    leg=owner.name, shoulder_m=owner.shoulder_m, reach_m=owner.reach_m,
                    patch=self.patch(foothold, choice), force_min=self.force_min, force_max=self.force_max,
                    reach_rows=owner.reach_rows, sole_m=owner.sole_m,
                    yaw_rad=yaws[int(choice[foothold])] if yaws else 0.0,
                )
            )  # fmt: skip
        return PostureProblem(
            contacts=tuple(contacts),
            mass_kg=self.robot.mass_kg,
            com_nominal_m=self.com_nominal_m[stance.frame],
            com_radius_m=float(self.com_radius_m[stance.frame]),
            gravity_m_s2=self.gravity_m_s2,
            length_scale_m=self.length_scale_m,
            tilt_limit_rad=self.tilt_limit_rad,
            robot=self.robot.identity,
        )

    def with_choice(self, choice: Sequence[int] | NDArray[np.int_]) -> Course:
        """The course with one candidate a foothold."""
        return replace(
            self,
            footholds=tuple(
                replace(
                    foothold,
                    candidates=(foothold.candidates[int(chosen)],),
                    yaws_rad=foothold.yaws_rad[int(chosen) : int(chosen) + 1],
                )
                for foothold, chosen in zip(self.footholds, choice, strict=True)
            ),
        )

    def _check_schedule(self) -> None:
        """Raise InvalidInput unless the schedule and the footholds say the same."""
        names = self.robot.limb_names
        if self.lifts[0]:
            raise InvalidInput(f"lifts[0]: expected nobody to move before the first frame, got {list(self.lifts[0])}")
        placed = {(foothold.frame, foothold.limb) for foothold in self.footholds}
        if len(placed) != len(self.footholds):
            raise InvalidInput("placements: expected each limb at most once a frame")
        wanted = {(0, name) for name in names} | {(k, name) for k, lifted in enumerate(self.lifts) for name in lifted}
        self.robot.select([name for _, name in sorted(wanted | {(0, name) for name in self.next_lift})])
        if placed != wanted:
            frame, limb = sorted(placed ^ wanted)[0]
            message = "a foothold, since it moves there" if (frame, limb) in wanted else "no foothold: it stays there"
            raise InvalidInput(f"placements: frame {frame}, limb {limb}: expected {message}")
        order = [(foothold.frame, names.index(foothold.limb)) for foothold in self.footholds]
        if order != sorted(order):
            raise InvalidInput("placements: expected them in order of frame, then limb")
        if self.modes is not None and len(self.modes) != self.frames:
            raise InvalidInput(f"modes: expected {self.frames}, one a frame, got {len(self.modes)}")
