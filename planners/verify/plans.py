"""The verifier of plans: it knows the course and the plan, not how the plan was made.

Contact frames, rotation, balances, cones and reach are recomputed from the course's own numbers,
for all stances and points between them in one sweep, which is that of postures. What couples the
frames is judged here: who stands where, who carries, steps and progress (E11), reach of limbs that
do not carry, and the way between frames.

*Why two stances prove the way between them.* The limbs that do not move between two frames keep
their toes p. The earlier frame has a stance (c, Θ, f) of some of these limbs, the later one (c',
Θ', f'). On the straight line between both, the forces sum up to the weight everywhere, so Σ (p − c)
× f = Σ p × f + c × m g is linear in (c, f), and zero at both ends. So it is with a force F and a
moment M on the body, which go over from the one frame to the other as the forces do: F and the
moment about the origin of the world linearly (``problem.wrench``). Cones, bounds (which admit a
zero force), reach with the linearised rotation, tilt box and the interpolated ball about the
nominal COM are convex. So every point between is a posture, too. Five of them are recomputed
anyway. Half-spaces of reach are bilinear in Θ and c; their largest value on the way is worked out
(``geometry.bowed``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..answer.plan import WHOLE_BODY, Plan
from ..answer.report import PLAN_GROUPS, Group, Report
from ..files.arrays import Array, cross, lengths
from ..motion.path import touch_downs_m
from ..problem.contact import LINEAR
from ..terrain.patch import Certainty, Patch
from ..terrain.polygon import half_planes
from .bodies import further_groups
from .geometry import (
    beyond,
    bowed,
    certainty_under,
    contact_frames,
    counts_of,
    exact_and_linear,
    off_sole,
    off_terrain,
    patch_distances,
    reach_rows,
    relative_rows,
    sole_points,
)
from .margins import margin_group, with_margins
from .postures import (
    Worst,
    check_whole_body,
    plan_defect,
    posture_report,
    refused,
    worst_groups,
)
from .stances import LARGEST_UNIT_M, Index, Schedule, Stances, expanded, violations, worst_of

_DRAWS = 200
SHARE = 0.95
"""Share of the grounds drawn, those on which every toe has to find its foothold."""
SEED = 46
"""The same grounds are drawn each time, so that a file is judged as its plan was."""


def ground_group(plan: Plan) -> Group | None:
    """The share of grounds on which some toe misses its foothold; None where no patch says how sure
    it is.
    """
    course = plan.problem
    patches = plan.patches
    sure = [
        (p, *known)
        for p, patch in enumerate(patches)
        if (known := _known(course.terrain, patch, plan.toes_m[p])) is not None
    ]
    if not sure:
        return None
    depths_m = touch_downs_m(plan)
    draws = np.random.default_rng(SEED)
    planes = dict[tuple[bytes, bytes], Array]()
    missed, deviations = np.zeros((len(sure), _DRAWS), dtype=bool), np.zeros(len(sure))
    for row, (p, certainty, from_edge) in enumerate(sure):
        key = certainty.covariance.tobytes(), certainty.about_m.tobytes()
        if key not in planes:
            values, vectors = np.linalg.eigh(certainty.covariance)
            root = vectors * np.sqrt(np.maximum(values, 0.0))
            planes[key] = draws.standard_normal((_DRAWS, 3)) @ root.T
        place, upward = plan.toes_m[p, :2], patches[p].normal[2]
        local = certainty.rough_m * draws.standard_normal(_DRAWS)
        off = upward * np.abs(planes[key] @ certainty.levers(place) + local)
        deviations[row] = upward * float(certainty.height_sd_m(place))
        beyond = certainty.edge_sd_m * draws.standard_normal(_DRAWS) > from_edge
        missed[row] = (off > depths_m[p]) | beyond
    share, worst = float(missed.any(axis=0).mean()), int(missed.sum(axis=1).argmax())
    foothold = course.footholds[sure[worst][0]]
    text = f"{foothold.limb} at frame {foothold.frame}: every toe finds its foothold on {1.0 - share:.1%} of the grounds drawn"
    return Group(
        "ground",
        value=share,
        limit=1.0 - SHARE,
        unit="1",
        where=foothold.limb,
        limb=foothold.limb,
        when=float(foothold.frame),
        message=f"{text}, expected {SHARE:.0%}" if share > 1.0 - SHARE else "",
        figures={
            "found_share": 1.0 - share,
            "grounds": _DRAWS,
            "height_sd_m": float(deviations.max()),
            "touch_down_m": float(depths_m.max()),
        },
    )


def _known(terrain: Sequence[Patch], patch: Patch, toe_m: Array) -> tuple[Certainty, float] | None:
    """The certainty of the ground under a toe, as terrain and patch say it, and the distance of the
    toe from where its edge most likely is [m]; None where it is exact.

    What the terrain says goes before what a plan says that may be of another hand.
    """
    sure, under = patch.certainty, certainty_under(terrain, patch, toe_m)
    if under is None:
        return None if sure is None else (sure, sure.inset_m + _from_border(patch, toe_m))
    rough_m = max(under[0].rough_m, 0.0 if sure is None else sure.rough_m)
    return replace(under[0], rough_m=rough_m), under[1]


def _from_border(patch: Patch, toe_m: Array) -> float:
    """Distance of a toe inside the border of its patch, 0 outside [m]."""
    axes = patch.frame[:, 1:]
    normals, offsets = half_planes((patch.vertices_m - patch.centre_m) @ axes)
    return max(float((offsets - normals @ ((toe_m - patch.centre_m) @ axes)).min()), 0.0)


BETWEEN = tuple(k / 6.0 for k in range(1, 6))
"""Shares of the way from one frame to the next at which it is recomputed."""
_NOT_ASKED = tuple(Group(name, verdict="not asked for") for name in WHOLE_BODY)
"""The whole body where nobody asks for it."""


def check_plan(
    plan: Plan,
    *,
    tolerance: float = 1e-6,
    joints: bool = False,
    between: bool = True,
    margins: bool = False,
    deadline: float = math.inf,
) -> Report[Plan]:
    """Check every constraint of the problem at the plan; never raises for a bad plan.

    Arguments:
        tolerance: largest violation allowed in any group, with lengths in the problem's length
            scale, forces in its force scale, moments in their product and angles in rad.
        joints: judge joints, torques and bodies, at key frames and on the way between them, too; of
            a posture contacts alone are judged.
        between: recompute points between the frames; without them, what convexity proves of the way
            is taken as proved.
        margins: measure what every stance bears beyond its weight, but for a rejected posture's;
            where a push is asked for it is always judged.
        deadline: of the whole body, when to stop (``time.perf_counter()``); what was not looked at
            by then is not checked.
    """
    defect, frame, limb = plan_defect(plan)
    if defect:
        return refused(plan, tolerance, defect, frame=frame, limb=limb)
    pushed = plan.problem.push_n > 0.0
    if plan.problem.is_posture:
        report = posture_report(plan, tolerance)
        margins, pushed = margins and report.accepted, pushed and report.accepted
    else:
        body = check_whole_body(plan, deadline=deadline) if joints else _NOT_ASKED
        with np.errstate(all="ignore"):
            report = _Sweep(plan, tolerance).report(body, BETWEEN if between else ())
    if not (margins or pushed):
        return report
    if margins:
        return with_margins(report)
    return replace(report, groups=(*report.groups, margin_group(plan, measured=False)))


class _Sweep:
    """A plan's stances, and the points on its ways, measured at once."""

    def __init__(self, plan: Plan, tolerance: float) -> None:
        self._plan, self._course, self._tolerance = plan, plan.problem, tolerance
        self._names = plan.problem.robot.limb_names
        self._who = Schedule.of_course(plan.problem)
        self._shoulders = np.array([limb.shoulder_m for limb in plan.problem.robot.limbs])
        self._reach = np.array([limb.reach_m for limb in plan.problem.robot.limbs])
        self._rows = reach_rows(plan.problem.robot.limbs)
        self._patches = plan.patches
        footholds = plan.problem.footholds
        self._limb = np.array([self._names.index(foothold.limb) for foothold in footholds])
        self._frame = np.array([foothold.frame for foothold in footholds])
        regions = [
            row[int(chosen)] for row, chosen in zip(plan.problem.regions, plan.choice, strict=True)
        ]
        self._off_patch = patch_distances([region.vertices_m for region in regions], plan.toes_m)
        self._points = counts_of(plan.problem.robot.limbs)
        self._forces, self._offsets = plan.forces_n[:, :, None], np.zeros((len(plan.toes_m), 1, 3))
        self._touches = plan.toes_m[:, None]
        if self._points:
            self._on_soles(regions)
        length_m = min(plan.problem.unit_m, LARGEST_UNIT_M)
        force_n = min(plan.problem.force_n, plan.problem.weight_n)
        self._units = {"m": length_m, "N": force_n, "Nm": force_n * length_m, "rad": 1.0, "": 1.0}
        units = {name: (unit, self._units[unit]) for name, unit in PLAN_GROUPS.items()}
        self._worst = Worst(units, self._names, tolerance)

    def _on_soles(self, regions: list[Patch]) -> None:
        """Forces are those at the points of soles, and these where yaw and centre put them, near to
        what is claimed.
        """
        plan, soles = self._plan, {limb.name: limb.sole_m for limb in self._course.robot.limbs}
        assert plan.points_m is not None
        assert plan.point_forces_n is not None
        self._forces, self._offsets = plan.point_forces_n, np.zeros_like(plan.points_m)
        self._touches = np.concatenate([self._touches, plan.points_m], axis=1)
        for p, (foothold, patch) in enumerate(
            zip(self._course.footholds, self._patches, strict=True)
        ):
            yaw = foothold.yaws_rad[int(plan.choice[p])] if foothold.yaws_rad else 0.0
            points = sole_points(soles[foothold.limb], patch, yaw)
            self._offsets[p, : len(points)] = points
            self._off_patch[p] = off_sole(
                patch, regions[p], points, plan.toes_m[p], plan.points_m[p]
            )

    def report(self, body: tuple[Group, ...], shares: tuple[float, ...]) -> Report[Plan]:
        """The report on all groups.

        Arguments:
            body: the groups of the whole body, as ``check_whole_body`` has them.
            shares: of the way from one frame to the next, at which it is recomputed.
        """
        ways = self._ways()
        between = self._stances(ways, shares)
        self._bowed(ways)
        self._idle()
        self._steps()
        each = np.repeat(np.arange(len(self._patches)), self._touches.shape[1])
        touched = [self._patches[p] for p in each]
        off = off_terrain(self._course.terrain, touched, self._touches.reshape(-1, 3))
        self._worst.note("terrain", off, self._frame[each], self._limb[each])
        bent, exact_m = self._linearisation()
        ground = ground_group(self._plan)
        return Report(
            groups=(
                *self._worst.groups.values(),
                *(() if ground is None else (ground,)),
                *further_groups(self._plan),
                *body,
            ),
            answer=self._plan,
            tolerance=self._tolerance,
            figures={
                "residual_nm": self._worst.groups["moment_balance"].value,
                "between": between if shares else math.nan,
                "linearisation_m": bent,
                "exact_reach_m": exact_m,
                "goal_m": float(lengths(self._plan.com_m[-1] - self._course.goal_m)),
                "proved": len(ways),
            },
        )

    def _stances(
        self, ways: list[tuple[int, int, int, list[int]]], shares: tuple[float, ...]
    ) -> float:
        """Measure the stances and ``shares`` of the ways; returns the largest violation on the
        ways.

        A stance is a point on the way from its frame to the next, none of the way on.
        """
        who, stances = self._who, len(self._who.frame)
        points = [(k, before, after, share) for k, before, after, _ in ways for share in shares]
        on_way = np.array(points, dtype=np.float64).reshape(-1, 4).T
        limbs = [limbs for *_, limbs in ways for _ in shares]
        carries = np.array([limb for each in limbs for limb in each], dtype=np.intp)
        carried = np.repeat(stances + np.arange(len(limbs)), [len(each) for each in limbs])
        nth, further = expanded(carries, self._points)
        row = np.arange(stances)
        frame, before, after, owner, limb, point = (
            np.concatenate([at, along.astype(np.intp)])
            for at, along in (
                *zip((who.frame, row, row), on_way[:3], strict=True),
                (who.stance, carried[nth]),
                (who.limb, carries[nth]),
                (who.point, further),
            )
        )
        share = np.concatenate([np.zeros(stances), on_way[3]])
        at = self._measured(frame, share, owner, limb, point, (before, after))
        values = violations(at)
        self._worst.groups |= worst_groups(
            at, values, frame, share, limb, self._names, self._tolerance
        )
        return float(worst_of(at, values)[stances:].max()) if limbs else 0.0

    def _measured(
        self,
        frame: Index,
        share: Array,
        owner: Index,
        limb: Index,
        point: Index,
        rows: tuple[Index, Index],
    ) -> Stances:
        """Points ``share`` of the way from each frame to the next, from the forces in one row to
        those in another.
        """
        course, plan, t = self._course, self._plan, share[:, None]
        following = np.minimum(frame + 1, course.frames - 1)
        foothold = self._who.holds[frame[owner], limb]
        axes = np.array([(patch.normal, patch.shear_reference) for patch in self._patches])
        friction = np.array([patch.friction for patch in self._patches])
        before, after = rows
        start, end = (self._forces[row[owner], limb, point] for row in (before, after))
        forces = (1.0 - t[owner]) * start + t[owner] * end
        each = np.ones(len(frame))

        def way(values: Array) -> Array:
            weight = share if values.ndim == 1 else t
            return np.asarray((1.0 - weight) * values[frame] + weight * values[following])

        bounds = [bound[foothold] * course.force_n for bound in course.force_bounds]
        return Stances(
            owner=owner,
            com_m=way(plan.com_m),
            rotation_rad=way(plan.rotation_rad),
            com_nominal_m=way(course.com_nominal_m),
            com_radius_m=way(course.com_radius_m),
            tilt_limit_rad=course.tilt_limit_rad * each,
            weight_n=course.weight_n * each,
            length_m=self._units["m"] * each,
            force_n=self._units["N"] * each,
            toes_m=plan.toes_m[foothold],
            forces_n=forces,
            frames=contact_frames(axes[:, 0], axes[:, 1])[foothold],
            friction=friction[foothold],
            shoulders_m=self._shoulders[limb],
            reach_m=self._reach[limb],
            force_min_n=bounds[0],
            force_max_n=bounds[1],
            off_patch_m=self._off_patch[foothold],
            rows=self._rows_of(limb),
            offsets_m=self._offsets[foothold, point] if self._points else None,
            wrench=self._wrench(frame, share),
        )

    def _wrench(self, frame: Index, share: Array) -> Array | None:
        """Wrench on the body ``share`` of the way from each frame to the next; its moment is about
        the body there.
        """
        wrench = self._course.wrench
        if wrench is None:
            return None
        t, following, com = share[:, None], np.minimum(frame + 1, len(wrench) - 1), self._plan.com_m
        force = (1.0 - t) * wrench[frame, :3] + t * wrench[following, :3]
        bent = cross(
            com[following] - com[frame], wrench[following, :3] - wrench[frame, :3]
        )  # c × F is no line
        moment = (1.0 - t) * wrench[frame, 3:] + t * wrench[following, 3:] + t * (1.0 - t) * bent
        return np.concatenate([force, moment], axis=1)

    def _rows_of(self, limb: Index) -> tuple[Array, Array] | None:
        """Half-spaces of reach of these limbs."""
        return None if self._rows is None else (self._rows[0][limb], self._rows[1][limb])

    def _ways(self) -> list[tuple[int, int, int, list[int]]]:
        """Some limb carries at every frame and on every way between two.

        Returns (frame, row of forces there, row at the next, limbs that stay) of every way that is
        covered.
        """
        course, holds, names = self._course, self._who.holds, self._names
        limbs_left = [
            [i for i, name in enumerate(names) if name not in away]
            for away in (*course.lifts, course.next_lift)
        ]
        rows: list[list[tuple[int, frozenset[int]]]] = [[] for _ in range(course.frames)]
        for row, stance in enumerate(course.stances):
            rows[stance.frame].append((row, frozenset(stance.limbs)))

        def carrying(frame: int, limbs: list[int]) -> int:
            """A stance of these limbs, or of some of them, at the frame; −1 where there is none."""
            return next((row for row, carry in rows[frame] if carry.issubset(limbs)), -1)

        ways, everybody = [], list(range(len(names)))
        for k in range(course.frames):
            for limbs in (limbs_left[k], limbs_left[k + 1]):
                if carrying(k, limbs or everybody) < 0:
                    self._worst.note("schedule", np.array([math.inf]), np.array([k]))
        for k, limbs in enumerate(limbs_left[1:-1]):
            before, after = carrying(k, limbs), carrying(k + 1, limbs)
            if not limbs or min(before, after) < 0:
                continue
            for i in limbs:
                if holds[k, i] != holds[k + 1, i]:
                    self._worst.note(
                        "schedule", np.array([math.inf]), np.array([k + 1]), np.array([i])
                    )
            ways.append((k, before, after, limbs))
        return ways

    def _bowed(self, ways: list[tuple[int, int, int, list[int]]]) -> None:
        """Half-spaces of reach on the ways, which are not convex in the share of the way."""
        for k, _, _, limbs in ways:
            limb, ends, plan = np.array(limbs), slice(k, k + 2), self._plan
            legs = plan.toes_m[self._who.holds[k, limb]] - plan.com_m[ends, None]
            if (rows := self._rows_of(limb)) is not None:
                most = bowed(plan.rotation_rad[ends], legs, rows)
                self._worst.note("reach", most, np.full(len(limb), k), limb)

    def _idle(self) -> None:
        """Toes that stood stay there; who carries nowhere at a frame is in place and in reach, and
        does not push.
        """
        course, plan, who = self._course, self._plan, self._who
        stood = [
            (p, foothold.toe_m)
            for p, foothold in enumerate(course.footholds)
            if foothold.toe_m is not None
        ]
        if stood:
            of = np.array([p for p, _ in stood])
            off = lengths(plan.toes_m[of] - np.array([toe for _, toe in stood]))
            self._worst.note("start", off, self._frame[of], self._limb[of])
        bears = np.zeros(plan.forces_n.shape[:2], dtype=bool)
        bears[who.stance, who.limb] = True
        row, limb = np.nonzero(~bears)
        self._worst.note(
            "idle_force", lengths(self._forces[row, limb]).max(axis=-1), who.frame[row], limb
        )
        carries = np.zeros(who.holds.shape, dtype=bool)
        np.logical_or.at(carries, who.frame, bears)
        frame, limb = np.nonzero(~carries)
        toes, v = plan.toes_m[who.holds[frame, limb]], self._shoulders[limb]
        to_toe = toes - plan.com_m[frame] - v - cross(plan.rotation_rad[frame], v)
        self._worst.note("patch", self._off_patch[who.holds[frame, limb]], frame, limb)
        out = beyond(
            lengths(to_toe) - self._reach[limb],
            plan.rotation_rad[frame],
            toes - plan.com_m[frame],
            self._rows_of(limb),
        )
        self._worst.note("reach", out, frame, limb)

    def _steps(self) -> None:
        """Steps and progress between neighbouring frames (E11)."""
        course, plan, holds = self._course, self._plan, self._who.holds
        step, limits, later = np.diff(plan.com_m, axis=0), course.steps, np.arange(1, course.frames)
        if not len(later):
            return
        self._worst.note("com_step", lengths(step) - limits.com_m, later)
        turn = np.diff(plan.rotation_rad, axis=0)
        self._worst.note("rotation_step", lengths(turn) - limits.rotation_rad, later)
        for field, limit in limits.linear.items():
            name, unit, slopes = LINEAR[field]
            along = np.concatenate([step, turn], axis=1) @ np.array(slopes).T
            self._worst.add(name, unit, self._units[unit])
            self._worst.note(name, (along - limit).max(axis=1), later)
        feet, normals, bounds = relative_rows(course.robot, holds)
        apart = np.vecdot(normals, plan.toes_m[feet[:, 1]] - plan.toes_m[feet[:, 0]]) - bounds
        self._worst.note("relative_reach", apart, self._frame[feet[:, 0]], self._limb[feet[:, 0]])
        moved = plan.toes_m[holds[1:]] - plan.toes_m[holds[:-1]]
        row, limb = np.indices(holds[1:].shape).reshape(2, -1)
        self._worst.note("toe_step", lengths(moved).ravel() - limits.toe_m, later[row], limb)
        self._least_steps(moved, turn, later)
        ahead = np.diff(course.com_nominal_m, axis=0)
        far = lengths(ahead)
        moving = far > 1e-9
        made = (step * ahead).sum(axis=1)[moving] / far[moving]
        self._worst.note("progress", limits.progress_m - made, later[moving])

    def _least_steps(self, toes: Array, turns: Array, later: Index) -> None:
        """Steps of toes that are put down anew, and of the rotation, are as long as they have to be
        (E11).

        Arguments:
            toes: steps, (M − 1, N, 3) [m].
            turns: of the rotation, (M − 1, 3) [rad].
        """
        course, holds = self._course, self._who.holds
        toe_sides, turn_sides = course.side_rows
        step, limb = np.nonzero(holds[1:] != holds[:-1])
        if len(toe_sides):
            moved, least = toes[step, limb], course.steps.least_toe_m
            self._worst.add("least_toe_step", "m", self._units["m"])
            self._worst.note(
                "least_toe_step", self._short(moved, least, toe_sides), later[step], limb
            )
        if len(turn_sides):
            least = course.steps.least_rotation_rad
            self._worst.add("least_rotation_step", "rad", 1.0)
            self._worst.note("least_rotation_step", self._short(turns, least, turn_sides), later)

    def _short(self, steps: Array, least: float, sides: Array) -> Array:
        """By how much steps are too short, or, on a course with sides, short of their half-spaces.

        Arguments:
            steps: Δ, shape (K, 3).
            sides: (n, b), shape (K, 4).
        """
        if self._course.sides is None:
            return np.asarray(least - lengths(steps))
        return np.asarray(sides[:, 3] - np.vecdot(sides[:, :3], steps))

    def _linearisation(self) -> tuple[float, float]:
        """Error with which I + [Θ]× places a shoulder, and distance of a toe out of reach with
        exp([Θ]×) [m].
        """
        exact, linear = exact_and_linear(self._plan.rotation_rad[:, None], self._shoulders)
        to_toe = self._plan.toes_m[self._who.holds] - self._plan.com_m[:, None] - exact
        beyond = float((lengths(to_toe) - self._reach).max())
        return float(lengths(exact - linear).max()), max(0.0, beyond)
