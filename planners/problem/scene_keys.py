"""Keys of a scene's file: those that a kinematic planner publishes, and those that this package
adds.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from ..errors import InvalidInput
from .course_terrain import Friction, Length, Point, Positive
from .terrain_spec import SolePoints

Surfaces = Annotated[list[int], Field(min_length=1, max_length=64)]


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


class ReachSpec(_Keys):
    """Reach polytopes: a folder of the package (``anymal``, ``talos``) or a path from the file; see
    ``reach_file``.
    """

    folder: str
    com_stretch: Positive = 1.0


class PhaseSpec(_Keys):
    """Limbs that move, and the numbers of the surfaces allowed to them: one list per limb, or one
    list for any one limb.
    """

    moving: list[str] | str
    allowed: list[Surfaces] | Surfaces


class OursSpec(_Keys):
    """Keys that no kinematic scene has, from which a course is made of it.

    Arguments:
        order: limbs that move, one after the other, if the scene leaves that open.
        start: ``published``, ``free`` (anywhere on the surfaces of the first phase) or ``nearest``
            (moved to the nearest point of a surface).
        path_m: the nominal path of the centre of mass; the last point is the goal.
        near: number of allowed surfaces that a toe is offered, the nearest to its nominal place;
            all if missing.
        sole_m, yaws_rad: corners and yaw angles of flat feet.
        why: reason for these keys, in words.
    """

    mass_kg: Positive
    friction: Friction
    path_m: Annotated[list[Point], Field(min_length=2)]
    order: list[str] = []
    start: str = "published"
    near: Annotated[int, Field(ge=1, le=16)] | None = None
    sole_m: SolePoints | None = None
    yaws_rad: Annotated[list[Length], Field(min_length=1, max_length=16)] = [0.0]
    why: str = ""

    @field_validator("start")
    @classmethod
    def _is_start(cls, start: str) -> str:
        if start not in ("published", "free", "nearest"):
            raise InvalidInput(f"expected published, free or nearest, got {start}")
        return start


class SceneSpec(_Keys):
    """A scene as published: surfaces by their corners [m], who moves to which of them, where it
    starts.

    Arguments:
        rounds: how often the phases after the first are gone through.
        initial_contacts: toes at the start, by limb.
    """

    name: str
    source: dict[str, Any]
    robot: str
    units: str = ""
    limbs: Annotated[list[str], Field(min_length=2)]
    reach: ReachSpec
    surfaces: Annotated[list[Annotated[list[Point], Field(min_length=3)]], Field(min_length=1)]
    surface_names: list[str]
    gait: list[list[str]] | None
    initial_contacts: dict[str, Point] | None
    initial_com: Point | None
    com_optimised: bool
    phases_count: int
    steps: int
    rounds: Annotated[int, Field(ge=1, le=50)] = 1
    phases: Annotated[list[PhaseSpec], Field(min_length=1)]
    goal: dict[str, Any] | None
    costs: dict[str, Any] | None
    solver_setting: str = ""
    remark: str = ""
    ours: OursSpec

    @model_validator(mode="after")
    def _agree(self) -> SceneSpec:
        names = set(self.limbs)
        for place, used in (
            ("initial_contacts", self.initial_contacts or {}),
            ("ours.order", self.ours.order),
        ):
            if not set(used) <= names:
                raise InvalidInput(
                    f"{place}: expected limbs among {', '.join(self.limbs)}, got {', '.join(used)}"
                )
        if self.initial_contacts is not None and set(self.initial_contacts) != names:
            raise InvalidInput(
                f"initial_contacts: expected one a limb, got {', '.join(self.initial_contacts)}"
            )
        if (self.initial_contacts is None) != (self.ours.start == "free"):
            raise InvalidInput(
                "ours.start: expected free where there are no initial_contacts, and only there"
            )
        for index, phase in enumerate(self.phases):
            self._check_phase(f"phases[{index}]", phase)
        return self

    def _check_phase(self, where: str, phase: PhaseSpec) -> None:
        lists = [each for each in phase.allowed if isinstance(each, list)]
        flat = [number for each in lists for number in each] or [
            n for n in phase.allowed if isinstance(n, int)
        ]
        if any(not 0 <= number < len(self.surfaces) for number in flat):
            raise InvalidInput(
                f"{where}.allowed: expected numbers of {len(self.surfaces)} surfaces, got {flat}"
            )
        if isinstance(phase.moving, str):
            if lists or not self.ours.order:
                raise InvalidInput(
                    f"{where}: expected ours.order and one list of surfaces where any one limb "
                    "moves, got something else"
                )
        elif not set(phase.moving) <= set(self.limbs) or len(lists) != len(phase.moving):
            raise InvalidInput(
                f"{where}: expected limbs, and a list of surfaces for each, got {phase.moving}"
            )

    def moves(self) -> list[list[tuple[str, tuple[int, ...]]]]:
        """The limbs put down, step after step, each with the surfaces that it may be put on."""
        if not isinstance(self.phases[0].moving, str):
            steps: list[Any] = [
                zip(phase.moving, phase.allowed, strict=True) for phase in self.phases
            ]
            return [[(limb, tuple(allowed)) for limb, allowed in step] for step in steps]
        each = [phase for _ in range(self.rounds) for phase in self.phases[1:]]
        order = self.ours.order
        return [[(order[k % len(order)], tuple(phase.allowed))] for k, phase in enumerate(each)]  # type: ignore[arg-type]

    def first_surfaces(self) -> tuple[int, ...]:
        """Surfaces on which a start that is free may be."""
        allowed = self.phases[0].allowed
        return tuple(
            number for each in allowed for number in (each if isinstance(each, list) else [each])
        )
