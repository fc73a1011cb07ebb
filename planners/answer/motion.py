"""Evidence that an answer rests on, a motion or a proof that there is none: a question, and arrays
that answer it.

What files, digests and reports need of it stands here once, whatever the question is.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..arguments import cached_property
from ..errors import InvalidInput
from ..files.codec import embedded
from ..files.documents import shown
from ..physics import GRAVITY_M_S2

if TYPE_CHECKING:
    from ..robot.model import Robot
    from ..terrain.obstacles import Ground
    from ..terrain.patch import Patch


KINDS: Mapping[str, type] = {
    **dict.fromkeys(("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad"), np.float64),
    **dict.fromkeys(("toes_m", "forces_n", "points_m", "point_forces_n"), np.float64),
    **dict.fromkeys(("joints_rad", "legs_turn_rad", "gather"), np.float64),
    **dict.fromkeys(("times_s", "torso_m", "rotation", "feet_m"), np.float64),
    **dict.fromkeys(("choice", "modes"), np.int_),
    "contact": np.bool_,
}
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


class Evidence:
    """Base of what answers a question by arrays."""

    BODY: ClassVar[tuple[str, ...]] = ()
    """The verifier's groups of the whole body, beside those of contacts."""
    MOMENT: ClassVar[str] = ""
    """What its moments count: "frame" or "interval"; seconds where empty."""

    @property
    def question(self) -> dict[str, Any]:
        """The question as JSON-ready values, with the format by which it is read back."""
        raise NotImplementedError

    @property
    def doubts(self) -> tuple[str, ...]:
        """Numbers of the robot's file that were guessed or are hard to believe, one line each."""
        robot: Robot | None = getattr(self, "robot", None)
        return () if robot is None else robot.doubts

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that are known, by name."""
        raise NotImplementedError

    def labels(self) -> dict[str, list[Any]]:
        """Names of rows and columns of the arrays, for whoever reads a file with NumPy alone."""
        return {}

    def moment(self, when: float) -> str:
        """A time of the motion, in words, for messages of the verifier."""
        if not self.MOMENT:
            return f"at {when:.3f} s"
        share, frame = math.modf(when)
        word = f"{self.MOMENT} {frame:.0f}"
        return f"{word}, {share:.0%} of the way to {self.MOMENT} {frame + 1:.0f}" if share else word

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


class Motion(Evidence):
    """Base of the solutions, plans of key frames, walks, leaps and crossings: a problem, and arrays
    that answer it, with a row a key frame, a sample or an interval.

    Arguments:
        problem: what it answers.
        provenance: origin, names to texts or numbers.
    """

    WORD: ClassVar[str]
    """What the motion is called in messages."""
    LATER: ClassVar[tuple[str, ...]] = ()
    """The arrays that it may be without."""
    provenance: Mapping[str, Any]
    if TYPE_CHECKING:

        @property
        def problem(self) -> Any:
            """What it answers."""

        @property
        def name(self) -> str:
            """Name of what it answers."""

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if name in KINDS and value is not None:
                held(self, KINDS[name], name)

    @classmethod
    def shapes(cls, problem: Any, rows: int = 0) -> Mapping[str, tuple[int, ...]]:
        """The shape that each array of an answer to a problem has, by name; none where all arrays
        are those of its parts.

        Arguments:
            rows: how many samples there are, where the problem leaves that open.
        """
        return {}

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that are known, by name."""
        known = {name: getattr(self, name) for name in self.shapes(self.problem)}
        return {name: np.asarray(array) for name, array in known.items() if array is not None}

    @property
    def question(self) -> dict[str, Any]:
        """The problem as JSON-ready values."""
        return dict(self.problem.to_json())

    @property
    def robot(self) -> Robot:
        """The robot that moves."""
        return self.problem.robot  # type: ignore[no-any-return]

    @property
    def gravity_m_s2(self) -> float:
        """Gravity that it counts on [m/s²], where its problem says nothing else."""
        return float(getattr(self.problem, "gravity_m_s2", GRAVITY_M_S2))

    def ground(self, friction_share: float = 1.0) -> tuple[Patch, ...] | Ground:
        """The terrain that it is over, with this share of the friction that it counts on."""
        raise NotImplementedError

    def head(self) -> dict[str, Any]:
        """All but the arrays, as JSON-ready values."""
        return {**super().head(), "provenance": dict(self.provenance)}


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
