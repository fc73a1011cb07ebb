"""The trajectory of a legged robot over a terrain: what every chart's solution becomes, in the
world frame and dense.

It says nothing of how it was made, so ``judge`` can check it and ``record`` can write it without
knowing an optimiser.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput, located
from ..files.arrays import Array
from ..files.documents import shown
from ..files.writing import first_difference
from .motion import Motion, held, left_unchecked

if TYPE_CHECKING:
    from ..robot.model import Robot
    from ..terrain.heightfield import HeightField
    from ..terrain.obstacles import Ground

OFF_M = 0.015
"""Distance from its place at which a foot may come down, and should hold all the same [m]."""
STEP_S = 0.005
"""Spacing of the samples that charts give: ten times finer than the optimiser's default grid."""
WALK_BODY = ("joints", "joint_speed", "torque", "legs_moment", "bodies")
"""The groups of a walk that ask for a model of the robot's legs."""
SAMPLES = ("times_s", "torso_m", "rotation", "feet_m", "forces_n", "contact")
"""The arrays that have a row a sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WalkQuestion:
    """What is asked of a walk, whatever planner it is for.

    Arguments:
        robot, terrain: what walks, and where.
        friction: ν of W5.
        adhesive: feet without a friction cone, shape (E,), bool.
        start, goal: where the torso has to begin and to end, shape (2,) [m].
        heading_rad: required heading at the start, from x towards y [rad]; None where nothing is
            asked.
        heading_end_rad: the same at the end.
        still: whether it has to be at rest at the start, and at the end.
        suction_n: what an adhesive foot may pull with [N]: its cone begins at that pull; None for
            no bound.

    Raises:
        InvalidInput: for values that are no arrays of numbers.
    Source:
        Pan et al. §III, W2-W7.

    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
        >>> walk = stancekit.Walk.over(level, (0.2, 0.0))
        >>> asked = stancekit.WalkQuestion(robot=walk.robot, terrain=level, friction=0.7, adhesive=walk.adhesive,
        ...                                start=walk.start, goal=walk.goal)
        >>> asked.goal.tolist(), asked.still
        ([0.2, 0.0], (False, False))
    """

    FORMAT: ClassVar[str] = "stancekit/walk/1"
    robot: Robot
    terrain: HeightField
    friction: float
    adhesive: NDArray[np.bool_]
    start: Array
    goal: Array
    heading_rad: float | None = None
    heading_end_rad: float | None = None
    still: tuple[bool, bool] = (False, False)
    suction_n: float | None = None

    def __post_init__(self) -> None:
        held(self, np.float64, "start", "goal")
        held(self, np.bool_, "adhesive")
        for name in ("friction", "heading_rad", "heading_end_rad", "suction_n"):
            value = getattr(self, name)
            object.__setattr__(self, name, None if value is None else float(value))
        start, end = self.still
        object.__setattr__(self, "still", (bool(start), bool(end)))

    @property
    def name(self) -> str:
        """Name of the terrain."""
        return self.terrain.name or "gait"

    def to_json(self) -> dict[str, Any]:
        """The walk as JSON-ready values; the heights of its terrain are among the arrays."""
        return {
            "format": self.FORMAT,
            "robot": self.robot.to_json(),
            "terrain": self.terrain.name,
            "friction": self.friction,
            "adhesive": self.adhesive.tolist(),
            "start": self.start.tolist(),
            "goal": self.goal.tolist(),
            "heading_rad": self.heading_rad,
            "heading_end_rad": self.heading_end_rad,
            "still": list(self.still),
            "suction_n": self.suction_n,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory(Motion):
    """Torso, feet and contact forces over time: K samples on a uniform grid, E feet; arrays are
    read-only copies.

    Shapes, finiteness and sense are the verifier's to judge (``verify``), so that whatever an
    optimiser returns can be held and looked at.

    Arguments:
        problem: what is asked of it.
        times_s: shape (K,) [s].
        torso_m: centre of mass p_WB, shape (K, 3) [m].
        rotation: R_WB, shape (K, 3, 3).
        feet_m: p_WF, shape (K, E, 3) [m].
        forces_n: contact forces on the robot f_W, shape (K, E, 3) [N].
        contact: True for feet that stand, shape (K, E), bool.
        provenance: origin, names to texts or numbers.

    Raises:
        InvalidInput: for values that are no arrays of numbers.
    Source:
        Pan et al. §III, W2-W7.

    Example:
        >>> import numpy as np, stancekit
        >>> level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
        >>> walked = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled").solution
        >>> walked.samples, stancekit.verify(walked).accepted
        (401, True)
    """

    WORD: ClassVar[str] = "gait"
    problem: WalkQuestion
    times_s: Array
    torso_m: Array
    rotation: Array
    feet_m: Array
    forces_n: Array
    contact: NDArray[np.bool_]
    provenance: Mapping[str, str | float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        plain = dict[str, str | float]()
        for name, value in self.provenance.items():
            try:
                plain[name] = value if isinstance(value, str) else float(value)
            except (TypeError, OverflowError):
                came = shown(value)
                raise InvalidInput(
                    f"provenance.{name}: expected text or a number, got {came}"
                ) from None
        object.__setattr__(self, "provenance", plain)

    def __repr__(self) -> str:
        over = f" over {self.problem.terrain.name}" if self.problem.terrain.name else ""
        return f"Trajectory({self.robot.name}{over}: {self.duration_s:.3g} s in {self.samples} samples)"

    def asked(self, **changes: Any) -> Trajectory:
        """The same samples as an answer to the question with these changes."""
        return replace(self, problem=replace(self.problem, **changes))

    @property
    def samples(self) -> int:
        """K, how many samples there are."""
        return int(self.times_s.shape[0]) if self.times_s.ndim else 0

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
    def name(self) -> str:
        """Name of the terrain."""
        return self.problem.name

    def ground(self, friction_share: float = 1.0) -> Ground:
        """The terrain as what is solid below its heights, with this share of the friction."""
        from ..terrain.obstacles import Ground

        return Ground(heights=self.problem.terrain, friction=friction_share * self.problem.friction)

    def hindrance(self, unchecked: Sequence[str]) -> str:
        """The reason why no world can execute it; empty if some can.

        For a robot without a model the groups of ``WALK_BODY`` do not matter: the runner takes the
        servos of the world.
        """
        from ..robot.model import walking_robot  # slow to import

        left = [name for name in unchecked if self.robot.own or name not in WALK_BODY]
        if left:
            return left_unchecked(left)
        if self.problem.adhesive.any():
            names = np.array(self.robot.limb_names)[self.problem.adhesive]
            return f"no world has feet that stick, as {', '.join(names)} do"
        try:
            walking_robot(self.robot)
        except InvalidInput as error:
            return str(error)
        return ""

    @classmethod
    def shapes(cls, problem: WalkQuestion, rows: int = 0) -> Mapping[str, tuple[int, ...]]:
        """As of ``Motion``."""
        feet = len(problem.robot.feet)
        return {
            "times_s": (rows,),
            "torso_m": (rows, 3),
            "rotation": (rows, 3, 3),
            "feet_m": (rows, feet, 3),
            "forces_n": (rows, feet, 3),
            "contact": (rows, feet),
        }

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The samples by name, and the terrain's arrays under ``terrain_…``."""
        terrain = self.problem.terrain.to_arrays().items()
        return super().arrays() | {f"terrain_{name}": np.asarray(array) for name, array in terrain}


def robot_from_json(data: Any) -> Robot:
    """Read the robot of a walk.

    Raises InvalidInput, also for one that is called as a built-in one and is another.
    """
    from ..robot.walker import walker_from_json

    with located("robot"):
        robot = walker_from_json(data)
        _check_built_in(robot)
    return robot


def _check_built_in(robot: Robot) -> None:
    """Raise InvalidInput for a robot that has the name of a built-in robot but other numbers."""
    from ..robot.walker import BUILT_IN

    if not robot.own and robot.name in BUILT_IN:
        expected = replace(BUILT_IN[robot.name](), model=None).to_json()
        if other := first_difference(robot.to_json(), expected):
            raise InvalidInput(
                f"expected the numbers of the built-in {robot.name}, got other values: {other}"
            )
