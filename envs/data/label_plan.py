"""What labelling is asked for, and how many rows of each kind came of it."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields
from typing import ClassVar

from pydantic import ConfigDict

from stancekit.planners.errors import InvalidInput
from stancekit.planners.robot.robot_file import BUILT_IN

MOST_ROWS, MOST_SHARDS = 10**9, 10**5
STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)


@dataclass(frozen=True, kw_only=True)
class LabelPlan:
    """What to label. The rows follow from it to the last bit, whoever draws them (on processors of one kind).

    distribution: name of the distribution of problems; robot, terrain: files that it is of, where not the default
    hexapod and no terrain's. feasible, infeasible: rows of each label; the infeasible ones are never trivial, that is,
    infeasible even without the moment balance. natural: keep the first ``feasible + infeasible`` samples as they come
    instead, whatever their label. shard_size: rows a shard, give or take one: what is drawn and written at once, and so
    what an interruption loses; every process compiles its models once.
    seed: the samples of shard k are the stream of ``SeedSequence(seed, spawn_key=(k,))``: sets for training and for
    testing need different seeds. tolerance, gap, max_nodes: as in ``Acceptance`` and ``ExactPlanner``; one sample in
    3000 wants more nodes than the default, at 1 ms a node. proposers: digest of what is asked for postures and proofs
    before any solver, on which certificates and bounds depend, and no label. Raises InvalidInput.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

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
    proposers: str | None = None

    def __post_init__(self) -> None:
        if self.robot in BUILT_IN:
            object.__setattr__(self, "robot", None)  # as it was before there were others
        for name, least in (("feasible", 0), ("infeasible", 0), ("shard_size", 1), ("seed", 0), ("max_nodes", 1)):
            value = getattr(self, name)
            if not isinstance(value, int) or value < least:
                raise InvalidInput(f"{name}: expected an integer of at least {least}, got {value!r}")
        if self.rows > MOST_ROWS or self.shards > MOST_SHARDS:
            raise InvalidInput(
                f"feasible, infeasible, shard_size: expected {MOST_ROWS:.0e} rows, {MOST_SHARDS:.0e} shards or fewer, "
                f"got {self.rows} in {self.shards}"
            )
        for name in ("tolerance", "gap"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise InvalidInput(f"{name}: expected a number between 0 and 1, got {getattr(self, name)!r}")
        if not self.rows:
            raise InvalidInput("feasible, infeasible: expected one row or more, got none")

    @property
    def rows(self) -> int:
        """Rows of the whole set."""
        return self.feasible + self.infeasible

    @property
    def shards(self) -> int:
        """How many shards the rows are spread over."""
        return -(-self.rows // self.shard_size)

    def quota(self, shard: int) -> tuple[int, int]:
        """(feasible, infeasible) rows of one shard; with ``natural`` only their sum counts."""

        def share(count: int, k: int) -> int:
            return (k + 1) * count // self.shards - k * count // self.shards

        return share(self.feasible, shard), share(self.infeasible, self.shards - 1 - shard)


@dataclass(frozen=True, kw_only=True)
class Counts:
    """How many of each kind; ``infeasible`` leaves out the trivially infeasible."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT

    feasible: int = 0
    infeasible: int = 0
    trivial: int = 0
    undecided: int = 0

    @property
    def total(self) -> int:
        """All of them."""
        return sum(astuple(self))

    def __add__(self, other: Counts) -> Counts:
        return Counts(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})
