"""Request to label, and the number of rows of each kind that came of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import astuple, dataclass, field, fields
from types import MappingProxyType
from typing import ClassVar

from pydantic import ConfigDict

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.robot_file import BUILT_IN

_MOST_ROWS, _MOST_SHARDS = 10**9, 10**5
STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)
_ORDERS = ("random", "rule", "farkas", "finder", "noise")
"""Orders in which a leap's contacts are chosen, see ``planners.leap.tries``."""
USUAL_TRIES: Mapping[str, int] = MappingProxyType({"random": 8, "finder": 4, "noise": 4})
"""Tries of a scene where nothing is said: half of them spread over all choices, the others near
those that succeed."""


@dataclass(frozen=True, kw_only=True)
class RowPlan(ABC):
    """Request to label rows of any kind.

    Arguments:
        counted: settings that say how many rows there are in how many shards.
    """

    counted: ClassVar[tuple[str, ...]]

    @property
    @abstractmethod
    def rows(self) -> int:
        """Rows of the whole set, at most."""

    @property
    @abstractmethod
    def shards(self) -> int:
        """Number of shards over which the rows are spread."""

    def _check_counts(self, least: Mapping[str, int]) -> None:
        """Raise InvalidInput for a setting below its least integer, and for more than fits a
        folder.
        """
        for name, smallest in least.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < smallest:
                raise InvalidInput(
                    f"{name}: expected an integer of at least {smallest}, got {value!r}"
                )
        if self.rows > _MOST_ROWS or self.shards > _MOST_SHARDS:
            raise InvalidInput(
                f"{', '.join(self.counted)}: expected {_MOST_ROWS:.0e} rows, {_MOST_SHARDS:.0e} "
                "shards or fewer, "
                f"got {self.rows} in {self.shards}"
            )


@dataclass(frozen=True, kw_only=True)
class LabelPlan(RowPlan):
    """Request to label postures.

    The rows follow from it to the last bit, whoever draws them (on processors of one kind).

    Raises InvalidInput.

    Arguments:
        distribution: name of the distribution of problems.
        robot, terrain: files of the robot and of the terrain, if it is not the default hexapod and
            if there is one.
        feasible, infeasible: rows of each label; the infeasible ones are never trivial, that is,
            infeasible even without the moment balance.
        natural: keep the first ``feasible + infeasible`` samples as they come instead, whatever
            their label.
        shard_size: rows per shard, give or take one: as many are drawn and written at once, and an
            interruption loses as many; every process compiles its models once.
        seed: the samples of shard k are the stream of ``SeedSequence(seed, spawn_key=(k,))``: sets
            for training and for testing need different seeds.
        tolerance, gap, max_nodes: as in ``Acceptance`` and ``Exact``; one sample in 3000
            wants more nodes than the default, at 1 ms a node.
        screen: digest of a surrogate: a draw whose predicted label needs no more rows in the shard
            is skipped without being decided.
        screen_error: share of the other label's rows that it may skip so.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    counted: ClassVar[tuple[str, ...]] = ("feasible", "infeasible", "shard_size")

    distribution: str
    feasible: int
    infeasible: int
    shard_size: int = 500
    seed: int = 0
    natural: bool = False
    tolerance: float = 1e-6
    gap: float = 1e-4
    max_nodes: int = 500
    robot: str | None = None
    terrain: str | None = None
    screen: str | None = None
    screen_error: float | None = None

    def __post_init__(self) -> None:
        if self.robot in BUILT_IN:
            object.__setattr__(self, "robot", None)  # what nothing named is
        self._check_counts(
            {"feasible": 0, "infeasible": 0, "shard_size": 1, "seed": 0, "max_nodes": 1}
        )
        for name in ("tolerance", "gap"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise InvalidInput(
                    f"{name}: expected a number between 0 and 1, got {getattr(self, name)!r}"
                )
        if (self.screen is None) != (self.screen_error is None):
            raise InvalidInput("screen, screen_error: expected both or none, got one of them")
        if self.screen_error is not None and not 0.0 < self.screen_error < 1.0:
            raise InvalidInput(
                f"screen_error: expected a number between 0 and 1, got {self.screen_error!r}"
            )
        if self.screen is not None and self.natural:
            raise InvalidInput("screen: expected none with natural rows, which are all kept")
        if not self.rows:
            raise InvalidInput("feasible, infeasible: expected one row or more, got none")

    @property
    def rows(self) -> int:
        """Rows of the whole set."""
        return self.feasible + self.infeasible

    @property
    def shards(self) -> int:
        """Number of shards over which the rows are spread."""
        return -(-self.rows // self.shard_size)

    def quota(self, shard: int) -> tuple[int, int]:
        """(feasible, infeasible) rows of one shard; with ``natural`` only their sum counts."""

        def share(count: int, k: int) -> int:
            return (k + 1) * count // self.shards - k * count // self.shards

        return share(self.feasible, shard), share(self.infeasible, self.shards - 1 - shard)


@dataclass(frozen=True, kw_only=True)
class TryPlan(RowPlan):
    """Request to label tries of leaps.

    The rows follow from it to the last bit, whoever makes them (as of ``LabelPlan``).

    Raises InvalidInput.

    Arguments:
        distribution: a class of ``configs/leaps.yaml``.
        scenes: number of leaps; number k is drawn from a generator of (seed, k), as in benchmarks.
        tries: choices of contacts per scene of each order of ``LeapFinder``; fewer where a scene
            has no more.
        shard_size: rows per shard, but never less than one scene.
        seed: seed; sets for training and for testing need different ones.
        stop: cost of a first step above which a try is given up.
        share: share of the friction that plans use.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    counted: ClassVar[tuple[str, ...]] = ("scenes", "tries", "shard_size")

    distribution: str
    scenes: int
    tries: dict[str, int] = field(default_factory=lambda: dict(USUAL_TRIES))
    shard_size: int = 500
    seed: int = 0
    stop: float = 0.05
    share: float = 0.8

    def __post_init__(self) -> None:
        wanted = f"a count for some of {', '.join(_ORDERS)}"
        for order, count in self.tries.items():
            if order not in _ORDERS:
                raise InvalidInput(f"tries: expected {wanted}, got {order!r}")
            if isinstance(count, bool) or not isinstance(count, int) or count < 0:
                raise InvalidInput(
                    f"tries: expected an integer of at least 0 for {order}, got {count!r}"
                )
        orders = {order: self.tries[order] for order in _ORDERS if self.tries.get(order)}
        if not orders:
            raise InvalidInput(f"tries: expected {wanted}, got none")
        object.__setattr__(self, "tries", orders)
        self._check_counts({"scenes": 1, "shard_size": 1, "seed": 0})
        for name in ("stop", "share"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InvalidInput(
                    f"{name}: expected a number above 0 and up to 1, got {getattr(self, name)!r}"
                )

    @property
    def rows(self) -> int:
        """Tries of all scenes, where none has too few choices."""
        return self.scenes * sum(self.tries.values())

    @property
    def shards(self) -> int:
        """Number of shards over which the rows are spread."""
        return -(-self.scenes // self.scenes_a_shard)

    @property
    def scenes_a_shard(self) -> int:
        """Scenes of every shard but the last."""
        return max(self.shard_size // sum(self.tries.values()), 1)

    def scenes_of(self, shard: int) -> range:
        """Numbers of the scenes of a shard."""
        first = shard * self.scenes_a_shard
        return range(first, min(first + self.scenes_a_shard, self.scenes))


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Numbers of rows of each kind; ``infeasible`` leaves out the trivially infeasible.

    Tries that are solved, refuted and unsolved count as feasible, infeasible and undecided.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    feasible: int = 0
    infeasible: int = 0
    trivial: int = 0
    undecided: int = 0

    @property
    def total(self) -> int:
        """Sum of the four counts."""
        return sum(astuple(self))

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            **{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)}
        )
