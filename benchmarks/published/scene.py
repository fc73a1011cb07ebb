"""Published scenes (loco-3d/sl1m) as courses: the keys of their files, their robots, and the same
surfaces, feet and phases laid out as a ``Problem``.

Between two steps the body may move with all feet down: a frame at which nobody moves. A kinematic
planner needs none, since nothing carries its robot; a biped that is to stand on one sole, then on
the other, does. Limits of steps are those of the polytopes alone: the others are too wide to
matter, and so is the ball that the body is in. Nothing is said of its path: the one in the file
only says which surfaces are near, and where a plan should end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.arrays import Array
from stancekit.planners.files.documents import read_yaml, validated
from stancekit.planners.problem.course_terrain import Friction, Length, Point, Positive, SolePoints
from stancekit.planners.problem.problem import Foothold, Problem, StepLimits, Weights
from stancekit.planners.robot.model import Limb, Robot
from stancekit.planners.robot.reach_sets import ReachSets, read_reach, same_limb
from stancekit.planners.robot.robot_file import named_robot
from stancekit.planners.robot.walker import anymal, contact_robot
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.terrain.polygon import Surface, sole_offsets, sole_region, surface_patch

FOLDER = Path(__file__).parent
SCENES = tuple(sorted(path.stem for path in (FOLDER / "scenes").glob("*.yaml")))
"""Names of the scenes that are here."""
BOXES = "anymal"
"""A robot by the boxes of reach that walks have (``configs/robots/anymal.yaml``)."""
OFF_M = 1e-3
"""A toe of a published start is at most this far off a surface [m]."""
BENT_M = 2e-3
"""A published corner is moved into the plane of its surface by this at most [m]."""
WIDE_M = 2.0
"""Steps are no longer than this; polytopes of reach allow less [m]."""
Surfaces = Annotated[list[int], Field(min_length=1, max_length=64)]


class _Keys(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


class ReachSpec(_Keys):
    """Reach polytopes: a folder of the package (``anymal``, ``talos``) or a path from the file; see
    ``reach_sets``.
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
                    f"moves, got {len(lists)} lists"
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


def read_scene(
    scene: str | Path, robot: str | None = None, reach: str | Path | None = None
) -> Problem:
    """The course of a scene.

    Arguments:
        scene: a name of ``SCENES``, or a YAML file.
        robot: in place of the published polytopes: anymal, the boxes that walks have, or what
            ``named_robot`` takes.
        reach: a folder of polytopes in their place.

    Raises:
        InvalidInput: with every key that is wrong, or with what in its data contradicts itself.
    """
    if robot is not None and reach is not None:
        raise InvalidInput(f"{scene}: expected a robot or a folder of reach polytopes, got both")
    path = FOLDER / "scenes" / f"{scene}.yaml" if str(scene) in SCENES else Path(scene)
    if not path.is_file():
        raise InvalidInput(
            f"scene: expected one of {', '.join(SCENES)} or a YAML file, got {scene}"
        )
    spec = validated(SceneSpec, cast("Mapping[str, Any]", read_yaml(path)), str(scene))
    try:
        if robot is not None:
            return build_scene(*other_robot(spec, robot))
        return build_scene(spec, published_robot(spec, path.parent, reach))
    except InvalidInput as error:
        raise InvalidInput(f"{scene}: {error}") from None


def published_robot(spec: SceneSpec, folder: Path, reach: str | Path | None = None) -> Robot:
    """The robot of a scene with its published reach, or with that of another folder.

    Raises InvalidInput.
    """
    if reach is not None:
        return _of_sets(spec, read_reach(reach, spec.limbs))
    packaged = FOLDER / "reach" / spec.reach.folder
    data_folder = packaged if packaged.is_dir() else folder / spec.reach.folder
    return _of_sets(spec, read_reach(data_folder, spec.limbs, com_stretch=spec.reach.com_stretch))


def other_robot(spec: SceneSpec, robot: str) -> tuple[SceneSpec, Robot]:
    """The scene with the names of another robot's legs, and the robot.

    Raises InvalidInput.

    Arguments:
        robot: ``anymal``, the boxes that walks have, or what ``named_robot`` takes. Legs are
            matched by how their names begin. A robot's soles are the scene's; it has no joints
            then, which are for point feet. Plans keep the body level, as the published do, since
            that costs inner sets nothing.
    """
    if robot == BOXES:
        boxes = anymal()
        limbs = tuple(replace(limb, leg=None) for limb in boxes.limbs)
        made = Robot(name=boxes.name, mass_kg=boxes.mass_kg, limbs=limbs)
    else:
        made = contact_robot(named_robot(robot))
        if spec.ours.sole_m is not None:
            sole = np.array(spec.ours.sole_m)
            limbs = tuple(replace(limb, sole_m=sole, hip_m=None) for limb in made.limbs)
            made = Robot(name=made.name, mass_kg=made.mass_kg, limbs=limbs)
    return renamed(spec, _matched(spec, made)), made


def renamed(spec: SceneSpec, names: Mapping[str, str]) -> SceneSpec:
    """The scene with other names of its limbs."""
    phases = [
        phase
        if isinstance(phase.moving, str)
        else phase.model_copy(update={"moving": [names[limb] for limb in phase.moving]})
        for phase in spec.phases
    ]
    contacts = spec.initial_contacts
    return spec.model_copy(
        update={
            "limbs": [names[limb] for limb in spec.limbs],
            "phases": phases,
            "initial_contacts": None
            if contacts is None
            else {names[limb]: toe for limb, toe in contacts.items()},
            "ours": spec.ours.model_copy(
                update={"order": [names[limb] for limb in spec.ours.order]}
            ),
        }
    )


def _matched(spec: SceneSpec, robot: Robot) -> dict[str, str]:
    """The robot's leg of every limb of the scene."""
    matches = {
        limb: [leg for leg in robot.limb_names if same_limb(limb, leg)] for limb in spec.limbs
    }
    if any(len(legs) != 1 for legs in matches.values()) or len(robot.limbs) != len(spec.limbs):
        raise InvalidInput(
            f"robot: expected legs whose names begin as {', '.join(spec.limbs)}, got "
            f"{', '.join(robot.limb_names)}"
        )
    return {limb: legs[0] for limb, legs in matches.items()}


def _of_sets(spec: SceneSpec, sets: ReachSets) -> Robot:
    sole = None if spec.ours.sole_m is None else np.array(spec.ours.sole_m)
    limbs = tuple(
        Limb(name=name, shoulder_m=np.zeros(3), reach_m=1.0, sole_m=sole) for name in spec.limbs
    )
    return sets.applied(Robot(name=spec.robot, mass_kg=spec.ours.mass_kg, limbs=limbs))


def build_scene(spec: SceneSpec, robot: Robot) -> Problem:
    """The course of a scene for a robot whose limbs have the scene's names; published polytopes
    know no tilt.

    Raises InvalidInput, e.g. for a start that is not on any surface.
    """
    patches = _patches(spec)
    moves = spec.moves()
    lifts: list[tuple[str, ...]] = [()]
    for step in moves:
        lifts += [tuple(name for name in robot.limb_names if name in dict(step)), ()]
    lifts = lifts[:-1]
    path = np.array(spec.ours.path_m)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, way[-1], len(lifts))
    com = np.stack([np.interp(at, way, axis) for axis in path.T], axis=1)
    corners = np.concatenate([patch.vertices_m for patch in patches])
    radius = (
        float(np.linalg.norm(np.ptp(corners, axis=0)))
        + 1.0
        + float(np.linalg.norm(np.ptp(path, axis=0)))
    )
    return Problem(
        name=spec.name,
        robot=robot,
        terrain=patches,
        footholds=_footholds(spec, robot, patches, lifts, moves, com),
        lifts=tuple(lifts),
        com_nominal_m=np.tile(com.mean(axis=0), (len(lifts), 1)),
        com_radius_m=np.full(len(lifts), radius),
        goal_m=path[-1],
        steps=StepLimits(com_m=WIDE_M, toe_m=WIDE_M, rotation_rad=0.0),
        weights=Weights(goal=1.0, com_step=0.2, toe_step=0.05, tilt=0.05),
        tilt_limit_rad=0.0,
    )


def _patches(spec: SceneSpec) -> tuple[Patch, ...]:
    """The surfaces, facing up.

    Raises InvalidInput for one that is bent.
    """
    patches = []
    for index, polygon in enumerate(spec.surfaces):
        corners = np.array(polygon)
        middle = corners.mean(axis=0)
        normal = np.linalg.svd(corners - middle)[2][2]
        off = (corners - middle) @ normal
        if float(np.abs(off).max()) > BENT_M:
            raise InvalidInput(
                f"surfaces[{index}]: expected a plane, got corners {1e3 * np.abs(off).max():.3g} "
                "mm off"
            )
        flat = corners - off[:, None] * normal
        try:
            patches.append(
                surface_patch(
                    flat, spec.ours.friction, towards_m=middle + np.array([0.0, 0.0, 1.0])
                )
            )
        except InvalidInput as error:
            raise InvalidInput(f"surfaces[{index}]: {error}") from None
    return tuple(patches)


def _footholds(
    spec: SceneSpec,
    robot: Robot,
    patches: Sequence[Patch],
    lifts: Sequence[Sequence[str]],
    moves: Sequence[Sequence[tuple[str, tuple[int, ...]]]],
    com_m: Array,
) -> tuple[Foothold, ...]:
    """Every foothold in order of frame, then limb, its surfaces in order of their distance from its
    nominal place.
    """
    footholds, home = [], dict[str, Array]()
    for limb in robot.limbs:
        start = (
            None if spec.initial_contacts is None else np.array(spec.initial_contacts[limb.name])
        )
        home[limb.name] = limb.shoulder_m if start is None else start - com_m[0]
        footholds.append(
            _offered(spec, limb, 0, patches, spec.first_surfaces(), com_m[0] + home[limb.name])
            if start is None
            else _standing(spec, limb, start, patches)
        )
    for k, step in enumerate(moves):
        frame, allowed = 2 * k + 1, dict(step)
        last = (
            next(
                (j for j in range(frame + 1, len(lifts)) for name in lifts[j] if name in allowed),
                len(lifts),
            )
            - 1
        )
        middle = com_m[frame : max(last, frame) + 1].mean(axis=0)
        footholds += [
            _offered(spec, limb, frame, patches, allowed[limb.name], middle + home[limb.name])
            for limb in robot.limbs
            if limb.name in allowed
        ]
    return tuple(footholds)


def _offered(
    spec: SceneSpec,
    limb: Limb,
    frame: int,
    patches: Sequence[Patch],
    allowed: Sequence[int],
    toe_m: Array,
) -> Foothold:
    """A toe that the planner puts down.

    Raises InvalidInput for a sole that has no room anywhere.
    """
    surfaces = [Surface(patches[index], 0.0) for index in allowed]
    order = sorted(
        surfaces, key=lambda surface: float(np.linalg.norm(surface.nearest(toe_m) - toe_m))
    )
    candidates, yaws = list[Patch](), list[float]()
    for surface in order[: spec.ours.near]:
        for yaw in (0.0,) if limb.sole_m is None else spec.ours.yaws_rad:
            try:
                _ = limb.sole_m is None or sole_region(
                    surface.patch, sole_offsets(limb.sole_m, surface.patch, yaw)
                )
            except InvalidInput:
                continue
            candidates.append(surface.patch)
            yaws.append(yaw)
    if not candidates:
        raise InvalidInput(
            f"frame {frame}, limb {limb.name}: expected room for its sole on a surface, got none"
        )
    return Foothold(
        limb=limb.name,
        frame=frame,
        candidates=tuple(candidates),
        yaws_rad=() if limb.sole_m is None else tuple(yaws),
    )


def _standing(spec: SceneSpec, limb: Limb, toe_m: Array, patches: Sequence[Patch]) -> Foothold:
    """A toe of the start, on the nearest surface.

    Raises InvalidInput for one that is on none.
    """
    rooms = list[tuple[float, Array, Patch]]()
    for patch in patches:
        try:
            room = (
                patch
                if limb.sole_m is None
                else sole_region(patch, sole_offsets(limb.sole_m, patch, 0.0))
            )
        except InvalidInput:
            continue
        place = Surface(room, 0.0).nearest(toe_m)
        rooms.append((float(np.linalg.norm(place - toe_m)), place, patch))
    if not rooms:
        raise InvalidInput(
            f"initial_contacts.{limb.name}: expected room for its sole on a surface, got none"
        )
    off, place, patch = min(rooms, key=lambda room: room[0])
    if off > OFF_M and spec.ours.start == "published":
        raise InvalidInput(
            f"initial_contacts.{limb.name}: expected a toe on a surface, got one {1e3 * off:.3g} "
            "mm off the nearest "
            "(ours.start: nearest moves it there)"
        )
    return Foothold(
        limb=limb.name,
        frame=0,
        candidates=(patch,),
        toe_m=place,
        yaws_rad=() if limb.sole_m is None else (0.0,),
    )
