"""From a course's description to the course: nominal path, schedule, and the candidate patches of
every foothold.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidInput, NoPlace
from ..files.arrays import Array, way_to
from ..robot.model import Limb, Robot
from ..terrain.patch import Patch
from ..terrain.polygon import STEEP, Surface, sole_offsets, sole_region
from .contact import CandidatePatches, NoFooting, at_point
from .course_keys import AS_ASKED, Alternative, CourseSpec, StanceSpec, toe_offset
from .problem import Foothold, Problem, Weights

if TYPE_CHECKING:
    from ..robot.reach_sets import Sets

_TOE_M = 0.02
"""Two toes do not fit on a patch that is nowhere wider than this [m]."""


def build_course(
    spec: CourseSpec,
    folder: Path = Path(),
    sets: Sets = "inner",
    reach: str | Path | None = None,
    alternative: Alternative = AS_ASKED,
) -> Problem:
    """The course that a description means.

    Raises InvalidInput.

    Arguments:
        folder: folder from which relative paths start.
        sets: sets of the legs, see ``contact_robot``.
        reach: a folder of polytopes in place of the robot's reach.
        alternative: another way to lay it out.
    """
    robot = spec.make_robot(folder, sets)
    spec = spec.model_copy(update={"terrain": spec.terrain.for_robot(robot)})
    if reach is not None:
        from ..robot.reach_sets import read_reach

        robot = read_reach(reach, robot.limb_names).applied(robot)
    placed_by = robot  # a proof is over the candidates that a plan is offered, but for all that a limb may reach
    if robot.own and sets == "outer" and not spec.candidates.everywhere:
        placed_by = spec.make_robot(folder)
    spec = alternative.of(spec.standing(placed_by, sets), placed_by)
    spec = _started(spec, placed_by, folder)
    corners, way = _corners(spec)
    com_m, passed = _walk(corners, way, spec.frames)
    radius = np.full(spec.frames, spec.body.com_radius_m)
    radius[-1] = (
        spec.body.com_radius_m if spec.body.last_radius_m is None else spec.body.last_radius_m
    )
    radius[0] = spec.body.first_radius_m
    _check_way(com_m, radius, spec)
    turns = gait_sets(spec.gait, robot)
    lifts = ((), *(turns[(k - 1) % len(turns)] for k in range(1, spec.frames)))
    terrain = spec.terrain.along(corners, folder)
    footholds, placed = _footholds(
        spec,
        placed_by,
        lifts,
        com_m,
        radius,
        passed,
        CandidatePatches(terrain, spec.candidates.margin_m),
    )
    return Problem(
        name=spec.name,
        robot=robot,
        terrain=terrain.patches,
        footholds=footholds,
        lifts=lifts,
        next_lift=turns[(spec.frames - 1) % len(turns)],
        com_nominal_m=com_m,
        com_radius_m=radius,
        goal_m=com_m[-1],
        steps=spec.steps,
        weights=Weights(**spec.weights.model_dump()),
        tilt_limit_rad=spec.body.tilt_limit_rad,
        modes=_modes(placed, spec.frames),
        push_n=spec.push_n,
        standing_m=_standing(spec, placed_by, passed) if spec.weights.stance > 0.0 else None,
        wrench=_wrench(spec),
        doubts=terrain.doubts,
    )


def _wrench(spec: CourseSpec) -> Array | None:
    """Wrench on the body beside its weight at each frame, shape (M, 6); None for nothing.

    Raises InvalidInput.
    """
    total = np.zeros((spec.frames, 6))
    for index, each in enumerate(spec.wrench):
        frames = range(spec.frames) if each.frames is None else each.frames
        if max(frames) >= spec.frames:
            raise InvalidInput(
                f"wrench[{index}].frames: expected key frames from 0 to {spec.frames - 1}, got "
                f"{max(frames)}"
            )
        total[list(set(frames))] += at_point(each.force_n, each.moment_nm, each.at_m)
    return total if total.any() else None


def _standing(spec: CourseSpec, robot: Robot, passed: NDArray[np.int_]) -> Array:
    """From the centre of mass to each toe as the robot stands at each frame, shape (M, N, 3)
    [m].
    """
    return np.array(
        [
            [limb.shoulder_m + toe_offset(limb, _stance(spec, int(corner))) for limb in robot.limbs]
            for corner in passed
        ]
    )


def _started(spec: CourseSpec, robot: Robot, folder: Path) -> CourseSpec:
    """Specification with a start whose height the terrain gives: the toes, as the robot stands, are
    on it in the mean.

    Raises InvalidInput where there is no ground under a toe.
    """
    if len(spec.start_m) == 3:
        return spec
    start = np.array([*spec.start_m, 0.0])
    toes = [start + limb.shoulder_m + toe_offset(limb, spec.stance) for limb in robot.limbs]
    terrain = spec.terrain.along(np.array([(*spec.start_m, spec.goal_m[2]), spec.goal_m]), folder)
    grounds = [Surface(patch, 0.0) for _, patch in terrain.standing if patch.normal[2] >= STEEP]
    heights = []
    for limb, toe in zip(robot.limbs, toes, strict=True):
        under = [
            height for height in (ground.under(toe[:2]) for ground in grounds) if height is not None
        ]
        if not under:
            raise InvalidInput(
                "start_m: expected ground under every toe, or a height beside x and y; there is "
                "none under limb "
                f"{limb.name} at ({toe[0]:.3g}, {toe[1]:.3g})"
            )
        heights.append(max(under) - toe[2])
    return spec.model_copy(update={"start_m": (*spec.start_m, float(np.mean(heights)))})


def _footholds(
    spec: CourseSpec,
    robot: Robot,
    lifts: Sequence[Sequence[str]],
    com_m: Array,
    radius_m: Array,
    passed: NDArray[np.int_],
    footing: CandidatePatches,
) -> tuple[tuple[Foothold, ...], list[tuple[int, Patch]]]:
    """Every foothold with its candidates, and by foothold its frame and the surface nearest to
    where it likes to be.

    A toe's nominal place is meant for the middle of the frames that it stands through.
    """
    footholds, placed = list[Foothold](), list[tuple[int, Patch]]()
    alone = dict[str, int]()  # limbs that have one surface only, and its index
    schedule, toes = list(_schedule(robot, lifts)), list[tuple[Limb, Array, Array, float]]()
    for frame, limb, until in schedule:
        shoulder = com_m[frame:until].mean(axis=0) + limb.shoulder_m
        toe = shoulder + toe_offset(limb, _stance(spec, int(passed[frame])))
        sole = 0.0 if limb.sole_m is None else float(np.linalg.norm(limb.sole_m, axis=1).max())
        toes.append((limb, shoulder, toe, spec.candidates.window_m + 2.0 * sole))
    near = (
        None if spec.candidates.everywhere else footing.candidates_of(toes, spec.candidates.count)
    )
    tilted = np.sqrt(3.0) * spec.body.tilt_limit_rad  # ‖Θ × s‖ ≤ √3 max|Θ_i| ‖s‖
    for k, (frame, limb, _) in enumerate(schedule):
        _, shoulder, toe, _ = toes[k]
        if near is None:
            about, slack = (
                com_m[frame] + limb.shoulder_m,
                float(radius_m[frame] + tilted * np.linalg.norm(limb.shoulder_m)),
            )
            everywhere = footing.everywhere(limb, about, slack, toe)
            if not everywhere:
                message = footing.refusal(frame, limb, about)
                raise NoFooting(f"{message}, and the shoulder moves by {slack:.3g} m at most")
        else:
            everywhere = near[k]
        if not everywhere:
            raise NoPlace(footing.refusal(frame, limb, shoulder))
        alone.pop(limb.name, None)
        for other, index in alone.items():
            if (
                len(everywhere) == 1
                and index == everywhere[0][0]
                and footing.surfaces[index].width_m < _TOE_M
            ):
                raise InvalidInput(
                    f"frame {frame}, limbs {other} and {limb.name}: expected room for two toes, "
                    "got nothing but "
                    f"{footing.names[index]}, {1e3 * footing.surfaces[index].width_m:.3g} mm wide"
                )
        if len(everywhere) == 1:
            alone[limb.name] = everywhere[0][0]
        placed.append((frame, footing.surfaces[everywhere[0][0]].patch))
        patches = tuple(patch for _, patch in everywhere)
        footholds.append(
            Foothold(limb=limb.name, frame=frame, candidates=patches)
            if limb.sole_m is None
            else _with_yaws(limb, limb.sole_m, frame, patches, spec.candidates.yaws_rad)
        )
    return tuple(footholds), placed


def _with_yaws(
    limb: Limb, sole_m: Array, frame: int, patches: Sequence[Patch], yaws: Sequence[float]
) -> Foothold:
    """A sole put down on every patch with every yaw that it has room for.

    Raises InvalidInput where there is none.
    """
    result = []
    for patch, yaw in ((patch, yaw) for patch in patches for yaw in yaws):
        try:
            sole_region(patch, sole_offsets(sole_m, patch, yaw))
        except InvalidInput:
            continue
        result.append((patch, yaw))
    if not result:
        raise InvalidInput(
            f"frame {frame}, limb {limb.name}: expected room for its sole at one of {len(yaws)} "
            "yaws on the surfaces "
            f"within reach, got none on {len(patches)}"
        )
    return Foothold(
        limb=limb.name,
        frame=frame,
        candidates=tuple(patch for patch, _ in result),
        yaws_rad=tuple(yaw for _, yaw in result),
    )


def _corners(spec: CourseSpec) -> tuple[Array, Array]:
    """The straight lines that the COM is to follow, by their ends, shape (L, 3) [m], and the way to
    each [m].
    """
    via = [np.array(point if isinstance(point, tuple) else point.at_m) for point in spec.via_m]
    corners = np.array([spec.start_m, *via, spec.goal_m])
    way = way_to(corners)
    if spec.stride_m is None:
        return corners, way
    end, last = spec.stride_m * (spec.frames - 1), way[-1] - way[-2]
    if last < 1e-9:
        raise InvalidInput(
            "goal_m: expected another point than the one before it, to know where stride_m goes"
        )
    leg = min(int(np.searchsorted(way, end, side="right")), len(way) - 1)
    direction = (corners[leg] - corners[leg - 1]) / max(way[leg] - way[leg - 1], 1e-12)
    corners = np.vstack([corners[:leg], corners[leg - 1] + (end - way[leg - 1]) * direction])
    return corners, np.append(way[:leg], end)


def _walk(corners: Array, way: Array, frames: int) -> tuple[Array, NDArray[np.int_]]:
    """The nominal COM at every frame, shape (M, 3), and how many via points it has come to, shape
    (M,).
    """
    at = np.linspace(0.0, way[-1], frames)
    com_m = np.stack([np.interp(at, way, axis) for axis in corners.T], axis=1)
    return com_m, np.searchsorted(way[1:-1], at + 1e-9, side="right")


def _check_way(com_m: Array, radius: Array, spec: CourseSpec) -> None:
    """Raise InvalidInput where the step limits and the radii about the nominal path can never get
    to the goal.
    """
    gaps = np.linalg.norm(np.diff(com_m, axis=0), axis=1)
    far = (
        float(np.linalg.norm(np.array(spec.goal_m) - spec.start_m))
        if spec.stride_m is None
        else 0.0
    )
    far = max(far, float(np.linalg.norm(com_m[-1] - com_m[0])))
    most = (
        spec.steps.com_m * (spec.frames - 1) + radius[0] + (radius[-1] if spec.frames > 1 else 0.0)
    )
    if far > most + 1e-9:
        if spec.frames == 1:
            raise InvalidInput(f"frames: expected 2 or more for a goal {far:.3g} m away, got 1")
        raise InvalidInput(
            f"goal_m: expected a goal within {most:.3g} m ({spec.frames - 1} steps of up to "
            f"{spec.steps.com_m:g} m "
            f"and the radii about start and goal), got one {far:.3g} m away: {far - most:.3g} m "
            "too far"
        )
    for k, gap in enumerate(gaps, 1):
        room = radius[k - 1] + radius[k]
        if gap > spec.steps.com_m + room + 1e-9:
            raise InvalidInput(
                f"frame {k}: expected a nominal step of at most steps.com_m = {spec.steps.com_m:g} "
                f"m plus {room:.3g} m "
                f"of radius, got {gap:.3g} m: {gap - spec.steps.com_m - room:.3g} m too far"
            )
        if gap > 1e-9 and spec.steps.progress_m > gap + room + 1e-9:
            raise InvalidInput(
                f"steps.progress_m: expected at most {gap + room:.3g} m, the nominal step to frame "
                f"{k} plus the radii, "
                f"got {spec.steps.progress_m:g}"
            )


def gait_sets(
    gait: str | Sequence[Sequence[str]], robot: Robot, *, mirrored: bool = False
) -> tuple[tuple[str, ...], ...]:
    """The sets of limbs that move in turn, with the limbs in the robot's order.

    Raises InvalidInput for an unknown limb, a limb twice in a set, or a tripod gait of a number of
    limbs that it is not for.
    """
    names = robot.limb_names
    if not isinstance(gait, str):
        for index, moving in enumerate(gait):
            if len(set(moving)) != len(moving) or not set(moving) <= set(names):
                raise InvalidInput(
                    f"gait[{index}]: expected limbs among {', '.join(names)}, each once, got "
                    f"{moving}"
                )
        return tuple(tuple(name for name in names if name in moving) for moving in gait)
    if gait == "all":
        return (names,)
    left = np.array([1.0, -1.0 if mirrored else 1.0, 1.0])
    places = {limb.name: (left * limb.shoulder_m).round(9) + 0.0 for limb in robot.limbs}
    if gait == "wave":  # from the back to the front, left side first
        order = sorted(names, key=lambda name: (places[name][1] < 0.0, places[name][0]))
        return _with_shifts([(name,) for name in order], places)
    if len(names) < 4 or len(names) % 2:
        raise InvalidInput(
            "gait: expected an even number of limbs, four or more, for a tripod gait, got "
            f"{len(names)}"
        )
    around = sorted(names, key=lambda name: np.arctan2(places[name][1], places[name][0]))
    return tuple(tuple(name for name in names if name in around[first::2]) for first in (0, 1))


def _with_shifts(
    sets: Sequence[tuple[str, ...]], places: Mapping[str, Array]
) -> tuple[tuple[str, ...], ...]:
    """A cycle with a frame in which no limb moves wherever the supports before and after it share a
    line, a point or nothing: on all of its feet the body comes from the one to the other. Of four
    feet these are those of diagonal neighbours, of three and two all. A cycle that would end so
    begins so, since a robot that stands is in the middle of its feet.

    Arguments:
        places: positions of the shoulders, which say on which side of a line a limb is.
    """
    cycle = list[tuple[str, ...]]()
    for moved, moving in zip(sets, [*sets[1:], *sets[:1]], strict=True):
        cycle.append(moved)
        shared = [name for name in places if name not in moved and name not in moving]
        if len(shared) < 2:
            cycle.append(())
        elif len(shared) == 2:
            first, along = places[shared[0]][:2], (places[shared[1]] - places[shared[0]])[:2]
            sides = [
                np.sign(along[0] * off[1] - along[1] * off[0])
                for off in (places[name][:2] - first for name in (*moved, *moving))
            ]
            if len(set(sides)) > 1:
                cycle.append(())
    return tuple(cycle[-1:] + cycle[:-1] if not cycle[-1] else cycle)


def _schedule(robot: Robot, lifts: Sequence[Sequence[str]]) -> list[tuple[int, Limb, int]]:
    """Every foothold in order: its frame, its limb, and the frame of the limb's next one (M after
    the last).
    """
    frames = {
        name: [0] + [k for k, lifted in enumerate(lifts) if name in lifted]
        for name in robot.limb_names
    }
    until = {
        (k, name): end
        for name, at in frames.items()
        for k, end in zip(at, [*at[1:], len(lifts)], strict=True)
    }
    each = [(k, limb) for k in range(len(lifts)) for limb in robot.limbs]
    return [(k, limb, until[k, limb.name]) for k, limb in each if (k, limb.name) in until]


def _stance(spec: CourseSpec, passed: int) -> StanceSpec:
    """Stance after this many via points."""
    stance = spec.stance
    for point in spec.via_m[:passed]:
        if not isinstance(point, tuple) and point.stance is not None:
            stance = point.stance
    return stance


def _modes(placed: Sequence[tuple[int, Patch]], frames: int) -> tuple[int, ...]:
    """By frame 1 where most of the toes put down there, or last put down before, stand on walls, 0
    on ground.
    """
    modes = list[int]()
    for frame in range(frames):
        walls = [abs(patch.normal[2]) < STEEP for at, patch in placed if at == frame]
        modes.append(modes[-1] if not walls and modes else int(2 * sum(walls) > len(walls)))
    return tuple(modes)
