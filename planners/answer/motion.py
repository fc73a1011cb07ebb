"""Evidence that an answer rests on, a motion or a proof that there is none: a question, and arrays
that answer it.

One ``Motion`` answers every question: a posture or a course (key frames), a walk (samples), a leap
(intervals) and a way of several parts. Which columns it has is for the question to say.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import cached_property
from ..errors import InvalidInput, NoColumn
from ..files.arrays import Array, checked_int
from ..files.codec import embedded
from ..files.documents import shown
from ..physics import GRAVITY_M_S2

if TYPE_CHECKING:
    from ..problem import Problem
    from ..problem.leap import Leap
    from ..robot.model import Robot
    from ..terrain.obstacles import Ground
    from ..terrain.patch import Frame, Patch
    from .certificate import Way
    from .trajectory import WalkQuestion

KINDS: Mapping[str, type] = MappingProxyType(
    {
        **dict.fromkeys(("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad"), np.float64),
        **dict.fromkeys(("toes_m", "forces_n", "points_m", "point_forces_n"), np.float64),
        **dict.fromkeys(("joints_rad", "legs_turn_rad", "gather"), np.float64),
        **dict.fromkeys(("times_s", "torso_m", "rotation", "feet_m"), np.float64),
        **dict.fromkeys(("choice", "modes"), np.int_),
        "contact": np.bool_,
    }
)
"""The arrays of motions, and what they are of."""


def held(thing: Any, kind: type, *names: str) -> None:
    """Keep read-only copies of some of its arrays, of this type.

    Raises InvalidInput for what is no array of numbers.
    """
    for name in names:
        try:
            array: NDArray[Any] = np.array(getattr(thing, name), dtype=kind)
        except (TypeError, ValueError, OverflowError):
            came = shown(getattr(thing, name))
            raise InvalidInput(f"{name}: expected an array of numbers, got {came}") from None
        array.setflags(write=False)
        object.__setattr__(thing, name, array)


def doubts_of(thing: Any) -> tuple[str, ...]:
    """Doubts of the robot of a question or an answer, and of its ground."""
    asked = getattr(thing, "problem", thing)
    its = [getattr(thing, "robot", None), asked]
    its += [getattr(asked, name, None) for name in ("terrain", "course")]
    said = (" ".join(doubt.split()) for of in its for doubt in getattr(of, "doubts", ()))
    return tuple(dict.fromkeys(said))


class Evidence:
    """Base of what answers a question by arrays; those of a copy are read-only, too."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        for value in (*state.values(), *state.get("columns", {}).values()):
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def word(self) -> str:
        """What it is called in messages."""
        return "proof"

    @property
    def question(self) -> dict[str, Any]:
        """The question as JSON-ready values, with the format by which it is read back."""
        raise NotImplementedError

    @property
    def doubts(self) -> tuple[str, ...]:
        """Numbers of the robot's file that were guessed or are hard to believe, and what the reader
        of heights mended or left out, one line each.
        """
        return doubts_of(self)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that are known, by name."""
        raise NotImplementedError

    def labels(self) -> dict[str, list[Any]]:
        """Names of rows and columns of the arrays, for whoever reads a file with NumPy alone."""
        return {}

    def has(self, *columns: str) -> bool:
        """Tell whether all of these columns are known."""
        return all(getattr(self, name, None) is not None for name in columns)

    def moment(self, when: float) -> str:
        """A time of the motion, in words, for messages of the verifier."""
        return f"at {when:.3f} s"

    def hindrance(self, unchecked: Sequence[str]) -> str:
        """The reason why no world can execute it; empty if some can, and for answers that are no
        motion.

        Arguments:
            unchecked: names of the groups that could not be checked.
        """
        return ""

    def head(self) -> dict[str, Any]:
        """All but the arrays, as JSON-ready values."""
        return {"question": self.question}

    def content(self) -> dict[str, Any]:
        """The whole content of a file: the head, and the arrays with their labels."""
        return {**self.head(), "columns": {"npz": embedded(self.arrays()), **self.labels()}}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of head and arrays, to the last bit."""
        content = hashlib.sha256(canonical(self.head()))
        for name, array in sorted(self.arrays().items()):
            content.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
            content.update(np.ascontiguousarray(array).tobytes())
        return content.hexdigest()


Q = TypeVar("Q", bound="Problem | Leap | WalkQuestion | Way", covariant=True)
"""What is asked of a motion. Every question has a name, a robot, the ``word`` for its answer, what
moments of it ``counts`` ("frame", "interval" or "s"; nothing where there is one), the ``columns`` of
an answer, and the ``hindrance`` that keeps one from being run."""
ABSENT: Any = None
"""A column that a motion does not have; its question says which ones it has."""
LATER = ("modes", "joints_rad", "legs_turn_rad", "gather")
"""The arrays that a motion may be without though its question speaks of them."""
POINTS = ("points_m", "point_forces_n")
"""Those of soles, which a plan that is held may lack or have for nothing: none such is accepted."""
PER_FRAME = ("com_m", "rotation_rad", "forces_n", "point_forces_n")
"""Arrays with a row a frame, or a stance; of a posture there is one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion(Evidence, Generic[Q]):
    """The one solution: a table of the columns that its question speaks of, in the world frame and
    SI units, with a row a key frame, a sample or an interval; arrays are read-only copies.

    Nothing but which columns there are is checked here: ``verify`` does the rest, shapes, finiteness
    and sense, so that whatever a planner returns can be held and looked at.

    M key frames over a problem of P footholds and S stances (a posture has M = S = 1), or M
    intervals of a leap; K samples of a walk on a uniform grid; a robot with N limbs or feet.

    Arguments:
        problem: the question that it answers.
        com_m: c at key frames, shape (M, 3); of a leap at the ends of its intervals, (M + 1, 3) [m].
        rotation_rad: small body rotation Θ there, shape (M, 3) or (M + 1, 3) [rad].
        toes_m: one a foothold, shape (P, 3) [m].
        choice: the candidate patch of every foothold, shape (P,).
        forces_n: forces on the robot, world frame: in every stance, zero for limbs that do not carry
            in it, shape (S, N, 3); constant in every interval of a leap, (M, N, 3); at every sample
            of a walk, (K, N, 3) [N].
        points_m, point_forces_n: where feet are soles, whose centres are the toes: where the points
            of every foot put down are, shape (P, L, 3) [m], and the forces at them, which add up to
            forces_n, (S, N, L, 3) [N]. L is that of the foot of most points; one with fewer has its
            centre, and no force, in the places left.
        joints_rad: angles at every key frame, of all joints of the robot's legs in its model's
            order, shape (M, J) [rad, or m where a joint slides]; None where not worked out.
        modes: z, the envelope that mode switching chose for each frame, shape (M,); None without
            mode switching.
        timing: of a leap, the index of the chosen timing.
        velocity_m_s, momentum_m2_s: of a leap, v and L per mass at the ends of the intervals, which
            follow from the forces as c and Θ do; shape (M + 1, 3) each.
        legs_turn_rad: turn of the body by swinging legs in every interval, in addition to that by
            L, as far as known, shape (M, 3) [rad]; None for legs without mass, as of a robot with
            limbs alone.
        gather: how legs are drawn up in flight, shape (2,): after which share of it, 0.05 to 0.49,
            and how long they are then as a share of the shorter of their lengths at both ends, 0.1
            to 1; None for (0.3, 0.8).
        times_s: of a walk, shape (K,) [s].
        torso_m: of a walk, the centre of mass p_WB, shape (K, 3) [m].
        rotation: of a walk, R_WB, shape (K, 3, 3).
        feet_m: of a walk, p_WF, shape (K, N, 3) [m].
        contact: of a walk, True for feet that stand, shape (K, N), bool.
        parts: of a way, its climbs by key frames and its leaps in order, the first of key frames.
        provenance: how it was made, names to texts or numbers.

    Raises:
        InvalidInput: for columns that are not those of the question, for values that are no arrays
            of numbers, and for parts that are no way.
    Source:
        Lin et al. §II and §IV-B, E11; Pan et al. §III, W2-W7; of leaps Newton and Euler for one
        rigid body.

    Example:
        >>> import numpy as np, stancekit
        >>> plan = stancekit.plan("walls", frames=3).solution
        >>> plan.toes_at(0).shape, plan.posture(0).forces_n.shape, plan.has("times_s")
        ((6, 3), (1, 3, 3), False)
        >>> problem = stancekit.sample("ground-3", rng=3)[0]
        >>> nothing = np.zeros((3, 3))
        >>> floating = stancekit.Motion.of_posture(problem, com_m=nothing[0], rotation_rad=nothing[0], toes_m=nothing,
        ...                                        forces_n=nothing)
        >>> stancekit.verify(floating).accepted
        False
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
        >>> walked = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled").solution
        >>> walked.samples, stancekit.verify(walked).accepted
        (401, True)
    """

    problem: Q
    com_m: Array = ABSENT
    rotation_rad: Array = ABSENT
    toes_m: Array = ABSENT
    choice: NDArray[np.int_] = ABSENT
    forces_n: Array = ABSENT
    points_m: Array | None = None
    point_forces_n: Array | None = None
    joints_rad: Array | None = None
    modes: NDArray[np.int_] | None = None
    timing: int = ABSENT
    velocity_m_s: Array = ABSENT
    momentum_m2_s: Array = ABSENT
    legs_turn_rad: Array | None = None
    gather: Array | None = None
    times_s: Array = ABSENT
    torso_m: Array = ABSENT
    rotation: Array = ABSENT
    feet_m: Array = ABSENT
    contact: NDArray[np.bool_] = ABSENT
    parts: tuple[Motion[Any], ...] = ABSENT
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not hasattr(self.problem, "columns"):
            raise InvalidInput(
                f"problem: expected what a motion answers, got {shown(self.problem)}"
            )
        came = {name for name in (*KINDS, "timing", "parts") if getattr(self, name) is not None}
        asked = set(self.problem.columns()) or {"parts"}
        odd = (came - asked) | (asked - came - set(LATER))
        if odd - (set(POINTS) if self.keyed else set()):
            raise InvalidInput(
                f"{self.word} {self.name}: expected the columns {', '.join(sorted(asked))}; missing "
                f"or of another question: {', '.join(sorted(odd))}"
            )
        for name, kind in KINDS.items():
            if getattr(self, name) is not None:
                held(self, kind, name)
        if self.has("timing"):
            last = len(cast(Any, self.problem).timings_s) - 1
            checked_int(self.timing, f"{self.word} {self.name}: timing", most=last)
        if self.has("times_s"):
            plain = {name: _plain(name, value) for name, value in self.provenance.items()}
            object.__setattr__(self, "provenance", plain)
        if self.has("parts"):
            object.__setattr__(self, "parts", tuple(self.parts))
            fit = [
                isinstance(part, Motion) and part.has("choice") and part.problem.counts
                for part in self.parts
            ]
            if not (fit and all(fit) and self.parts[0].keyed):
                words = ", ".join(getattr(part, "word", shown(part)) for part in self.parts)
                raise InvalidInput(
                    f"{self.word} {self.name}: expected parts that are climbs by key frames and leaps, a climb "
                    f"first, got {words or 'none'}"
                )

    def __repr__(self) -> str:
        rows = ", ".join(f"{name} {array.shape}" for name, array in self.arrays().items())
        parts = ", ".join(part.word for part in self.parts or ())
        return f"Motion({self.word} {self.name}: {parts or rows})"

    @property
    def name(self) -> str:
        """Name of what it answers."""
        return self.problem.name

    @property
    def word(self) -> str:
        """What it is called in messages."""
        return self.problem.word

    @property
    def keyed(self) -> bool:
        """Tell whether its rows are key frames, which whoever follows them times."""
        return self.has("choice") and not self.has("timing")

    def _column(self, name: str) -> Any:
        """One of its columns, or of its question's tables.

        Raises NoColumn where its kind of motion has none.
        """
        if (column := getattr(self, name, getattr(self.problem, name, None))) is None:
            known = ", ".join(self.problem.columns()) or "parts"
            raise NoColumn(f"{self.word} {self.name}: expected one with {name}, got one of {known}")
        return column

    @property
    def patches(self) -> list[Patch]:
        """The patch that was chosen for every foothold."""
        asked, choice = cast(Any, self.problem), self._column("choice")
        return [asked.patch(p, choice) for p in range(len(asked.footholds))]

    def moment(self, when: float) -> str:
        """A time of the motion, in words, for messages of the verifier."""
        counts = self.problem.counts
        if counts == "s":
            return super().moment(when)
        share, frame = math.modf(when)
        word = f"{counts} {frame:.0f}" if counts else ""
        return f"{word}, {share:.0%} of the way to {counts} {frame + 1:.0f}" if share else word

    def hindrance(self, unchecked: Sequence[str]) -> str:
        """The reason why no runner executes it, whatever the world; empty where one may."""
        if not self.has("parts"):
            return self.problem.hindrance(unchecked)
        if all(part.keyed for part in self.parts):
            return "it has no leap among its parts"
        parts = (part.hindrance(()) for part in self.parts if part.keyed)
        return self.problem.hindrance(unchecked) or next(filter(None, parts), "")

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that are known, by name; those of a walk's terrain under ``terrain_…``."""
        known = {name: getattr(self, name) for name in self.problem.columns()}
        arrays = {name: np.asarray(array) for name, array in known.items() if array is not None}
        if self.has("times_s"):
            asked: Any = self.problem
            ground = asked.terrain.to_arrays()
            arrays |= {f"terrain_{name}": np.asarray(array) for name, array in ground.items()}
        return arrays

    @property
    def question(self) -> dict[str, Any]:
        """The problem as JSON-ready values, and the parts of a way."""
        asked = dict(self.problem.to_json())
        return asked | {"parts": [part.content() for part in self.parts]} if self.parts else asked

    @property
    def robot(self) -> Robot:
        """The robot that moves."""
        return self.problem.robot

    @property
    def legged(self) -> Robot:
        """The robot with its limbs and joints, that of a walk as ``walking_robot`` has it.

        Raises InvalidInput where the joints of a walk are not known.
        """
        from ..robot.model import walking_robot  # slow to import

        return walking_robot(self.robot) if self.has("times_s") else self.robot

    @property
    def climbs(self) -> list[Motion[Problem]]:
        """The parts of a way that are plans of key frames, in order."""
        return [part for part in self.parts if part.keyed]

    @property
    def part_words(self) -> tuple[str, ...]:
        """What the parts of a way are called."""
        return tuple("climb" if part.keyed else part.word for part in self.parts)

    @property
    def gravity_m_s2(self) -> float:
        """Gravity that it counts on [m/s²], where its problem says nothing else."""
        return float(getattr(self.problem, "gravity_m_s2", GRAVITY_M_S2))

    def ground(self, friction_share: float = 1.0) -> tuple[Patch, ...] | Ground:
        """The terrain that it is over, or the patches that are taken where the problem has none, with
        this share of the friction that it counts on.
        """
        asked: Any = self.problem
        if self.has("times_s"):
            from ..terrain.obstacles import Ground

            return Ground(heights=asked.terrain, friction=friction_share * asked.friction)
        terrain = getattr(asked, "terrain", ())
        return dulled(terrain or (self.patches if self.has("choice") else ()), friction_share)

    def head(self) -> dict[str, Any]:
        """All but the arrays, as JSON-ready values."""
        return {**super().head(), "provenance": dict(self.provenance)}

    def labels(self) -> dict[str, list[Any]]:
        """Names of rows and columns of key frames: limbs are columns of forces; toes have limb and
        key frame of every foothold, stances key frame and limbs of every row of forces.
        """
        if not self.keyed:
            return {}
        course: Any = self.problem
        names = course.robot.limb_names
        toes = [{"limb": each.limb, "frame": each.frame} for each in course.footholds]
        stances = [
            {"frame": each.frame, "limbs": [names[i] for i in each.limbs]}
            for each in course.stances
        ]
        known = {} if self.joints_rad is None else {"joints": list(course.robot.joint_names)}
        return {"limbs": list(names), "toes": toes, "stances": stances, **known}

    def moved(self: Motion[Problem], frame: Frame, robot: Robot) -> Motion[Problem]:
        """The plan of a robot with point feet in a world that is moved with it, see
        ``Problem.moved``.
        """
        return replace(
            self,
            problem=self.problem.moved(frame, robot),
            com_m=frame.places(self.com_m),
            rotation_rad=frame.vectors(self.rotation_rad),
            toes_m=frame.places(self.toes_m),
            forces_n=frame.vectors(self.forces_n),
        )

    @staticmethod
    def of_posture(
        problem: Problem,
        *,
        com_m: ArrayLike,
        rotation_rad: ArrayLike,
        toes_m: ArrayLike,
        forces_n: ArrayLike,
        points_m: ArrayLike | None = None,
        point_forces_n: ArrayLike | None = None,
    ) -> Motion[Problem]:
        """The plan of a posture problem with N contacts, from arrays without axes of frames and
        stances.

        Arguments:
            problem: the posture problem.
            com_m, rotation_rad: shape (3,) each [m], [rad].
            toes_m, forces_n: shape (N, 3) each [m], [N].
            points_m, point_forces_n: points of soles and their forces, shape (N, K, 3) each [m],
                [N].
        """
        return Motion(
            problem=problem,
            com_m=np.asarray(com_m)[None],
            rotation_rad=np.asarray(rotation_rad)[None],
            toes_m=np.asarray(toes_m),
            choice=np.zeros(np.shape(toes_m)[:1], dtype=np.int_),
            forces_n=np.asarray(forces_n)[None],
            points_m=None if points_m is None else np.asarray(points_m),
            point_forces_n=None if point_forces_n is None else np.asarray(point_forces_n)[None],
        )

    def toes_at(self: Motion[Problem], frame: int) -> Array:
        """Places where the toes of all limbs stand at a key frame, shape (N, 3) [m]."""
        return np.asarray(self._column("toes_m")[self.problem.holds[frame]])

    def forces_at(
        self: Motion[Problem],
        frame: int,
        support: tuple[int, ...] = (),
        forces_n: Array | None = None,
    ) -> Array:
        """Forces of all limbs at a key frame, shape (N, 3) [N]: those of its stance in which these
        limbs carry, or where there is none the mean of those in all of its stances.

        Arguments:
            support: numbers of the limbs.
            forces_n: of all stances, shape (S, N, 3) or (S, N, 6), in place of its own.

        The mean satisfies the constraints, too: body pose and toes are the same in these stances,
        and then balance, friction cones and force bounds are convex in the forces. A limb in the
        air counts with zero force, which the bounds admit.
        """
        stances = self._column("stances")
        at = [s for s, stance in enumerate(stances) if stance.frame == frame]
        rows = [s for s in at if tuple(stances[s].limbs) == support] or at
        return np.asarray((self.forces_n if forces_n is None else forces_n)[rows].mean(axis=0))

    @property
    def moments_nm(self: Motion[Problem]) -> Array | None:
        """Moments of the forces on soles about their middles, shape (S, N, 3) [Nm]; None of point
        feet.
        """
        if self.points_m is None or self.point_forces_n is None:
            return None
        arms = self.points_m - self.toes_m[:, None]
        holds = np.array([self.problem.holds[of.frame] for of in self.problem.stances])
        return np.asarray(np.cross(arms[holds], self.point_forces_n).sum(axis=2))

    def posture(self: Motion[Problem], stance: int) -> Motion[Problem]:
        """The plan of the posture problem of one stance: of one frame, with its limbs only."""
        of = self._column("stances")[stance]
        limbs = list(of.limbs)
        soles = dict[str, Array]()
        if self.points_m is not None and self.point_forces_n is not None:
            feet = [self.problem.robot.limbs[i].sole_m for i in limbs]
            most = max(1 if sole is None else len(sole) for sole in feet)
            if most > 1:  # else nobody who carries has a sole
                soles["points_m"] = self.points_m[self.problem.holds[of.frame, limbs], :most]
                soles["point_forces_n"] = self.point_forces_n[stance][limbs, :most]
        return Motion.of_posture(
            self.problem.posture_problem(of, self.choice),
            com_m=self.com_m[of.frame],
            rotation_rad=self.rotation_rad[of.frame],
            toes_m=self.toes_at(of.frame)[limbs],
            forces_n=self.forces_n[stance][limbs],
            **soles,
        )

    def to_json(self) -> dict[str, Any]:
        """JSON-ready lists of a posture, as a line of answers has them: without the axes of frames
        and stances.
        """
        names = ("com_m", "rotation_rad", "toes_m", "forces_n", "points_m", "point_forces_n")
        arrays = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        alone = {name for name in PER_FRAME if name in arrays and arrays[name].shape[:1] == (1,)}
        return {
            name: (array[0] if name in alone else array).tolist() for name, array in arrays.items()
        }

    def asked(self: Motion[WalkQuestion], **changes: Any) -> Motion[WalkQuestion]:
        """The same samples as an answer to the question with these changes."""
        return replace(self, problem=replace(self.problem, **changes))

    @property
    def samples(self) -> int:
        """K, how many samples there are."""
        times_s = self._column("times_s")
        return len(times_s) if times_s.ndim else 0

    @property
    def step_s(self) -> float:
        """Mean distance of two samples [s]; 0 for fewer than two."""
        return (
            float(self.times_s[-1] - self.times_s[0]) / (self.samples - 1)
            if self.samples > 1
            else 0.0
        )

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.times_s[-1] - self.times_s[0]) if self.samples else 0.0

    @property
    def turned_rad(self) -> Array:
        """``legs_turn_rad``, 0 where it is not known, shape (M, 3) [rad]."""
        if self.legs_turn_rad is not None:
            return self.legs_turn_rad
        return np.zeros((len(self._column("forces_n")), 3))

    @property
    def ends_s(self: Motion[Leap]) -> Array:
        """Times at which the M intervals of a leap begin and end, shape (M + 1,) [s]."""
        return self.problem.times_s(self._column("timing"))


def _plain(name: str, value: Any) -> str | float:
    """A text, or a number, of a walk's provenance."""
    try:
        return value if isinstance(value, str) else float(value)
    except (TypeError, OverflowError):
        came = shown(value)
        raise InvalidInput(f"provenance.{name}: expected text or a number, got {came}") from None


def canonical(data: Any) -> bytes:
    """JSON of values as it is digested: sorted, without spaces, texts in place of what has none."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), default=str).encode()


def seal(data: Any) -> str:
    """SHA-256 of JSON-ready values, in hexadecimal."""
    return hashlib.sha256(canonical(data)).hexdigest()


def dulled(patches: Sequence[Patch], friction_share: float) -> tuple[Patch, ...]:
    """The patches with this share of their friction."""
    if friction_share == 1.0:
        return tuple(patches)
    return tuple(patch.with_friction(friction_share * patch.friction) for patch in patches)


def left_unchecked(unchecked: Sequence[str]) -> str:
    """The groups that were not checked, in words; empty where none is left."""
    if not unchecked:
        return ""
    return f"{', '.join(unchecked)} {'is' if len(unchecked) == 1 else 'are'} not checked"
