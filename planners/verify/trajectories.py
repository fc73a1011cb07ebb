"""The independent verifier of trajectories: it knows the robot, the terrain and the samples, not
how they were made.

Everything is measured between the optimiser's knots, in the world frame: balances by the momentum
of finite differences, cones and depths at the true surface, whose normals it takes from heights
alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np

from ..answer.report import Group, Report
from ..answer.trajectory import Trajectory
from ..arguments import cached_property
from ..files.arrays import LARGEST, Array
from ..physics import GRAVITY_M_S2
from .bodies import nothing, whole_body
from .trajectory_measurements import GROUPS as GROUPS
from .trajectory_measurements import Flags, Rows, Series, TrajectoryMeasurements
from .trajectory_measurements import WalkLimits as WalkLimits

_APART_M = 0.01
"""Between samples a swinging foot is looked at this often along its way [m]."""
_MOST_PIECES = 10
"""Points between two samples at most: a foot that is faster than ``Limits.foot_speed_m_s`` is
refused anyway."""


@dataclass(frozen=True, slots=True)
class _FootPhase:
    """Samples first … last of one foot's stance or swing.

    Arguments:
        whole: it begins and ends within the trajectory.
    """

    foot: int
    first: int
    last: int
    whole: bool = True


class _StepMeasurements:
    """Measurements of the steps of one trajectory; all series are shape (K, E) unless they say
    otherwise.
    """

    def __init__(self, measured: TrajectoryMeasurements) -> None:
        self.trajectory, self.feet = measured.trajectory, measured.feet
        self.times_s, self.step_s = measured.times_s, measured.step_s
        self._above, self._height_m = measured.above, measured.ground[0]
        self._swings = tuple(_phases(~self.trajectory.contact))

    # ------------------------------------------------------------------------------------- speed
    # and duration

    def foot_velocity(self) -> Series:
        """Speed of a foot between two samples at both of which it stands, shape (K − 1, E)
        [m/s].
        """
        return self._speed(self.trajectory.contact[:-1] & self.trajectory.contact[1:])

    def touch_speed(self) -> Series:
        """Speed of a foot between two samples at one of which it stands, shape (K − 1, E) [m/s]."""
        return self._speed(self.trajectory.contact[:-1] ^ self.trajectory.contact[1:])

    def stance_time(self, least_s: float) -> Series:
        """Time by which a stance is too short, from its first sample to the first one after it [s]."""
        return self._marked(
            (stance, least_s - (stance.last - stance.first + 1) * self.step_s)
            for stance in _phases(self.trajectory.contact)
            if stance.whole
        )

    def swing_time(self, least_s: float) -> Series:
        """Time by which a swing is too short, between the samples at which the foot stands before
        and after it [s]; a swing that the trajectory's ends cut off has none.
        """
        whole = (swing for swing in self._swings if swing.whole)
        return self._marked(
            (swing, least_s - (swing.last - swing.first + 2) * self.step_s) for swing in whole
        )

    def _speed(self, asked: Flags) -> Series:
        speed = np.linalg.norm(np.diff(self.trajectory.feet_m, axis=0), axis=-1) / self.step_s
        return Series(np.where(asked, speed, 0.0), self.feet, self.times_s[1:])

    # ------------------------------------------------------------------------------------------- in
    # the air

    def lift(self, least_m: float) -> Series:
        """Distance by which the highest point of a swing, along the normal, is too low [m]."""
        return self._marked(
            (swing, least_m - float(self._heights(swing).max())) for swing in self._swings
        )

    def clearance(self, least_m: float) -> Series:
        """Distance by which a foot comes too near the ground, along the normal, in the middle half
        of its swing [m].
        """
        return self._marked(
            (swing, least_m - float(self._middle(swing).min())) for swing in self._swings
        )

    def drag(self, near_m: float) -> Series:
        """Way of a foot in a swing while it is nearer to the ground than ``near_m``, along the
        normal [m].
        """
        return self._marked((swing, self._dragged(swing, near_m)) for swing in self._swings)

    def penetration_between(self) -> Series:
        """Depth of swinging feet between samples, every centimetre along cubics through the samples
        [m].
        """
        pieces = self._pieces()
        worst = np.zeros(len(self.feet)), np.zeros(len(self.feet))
        for number in range(len(self.feet)):
            points, times_s = self._between(number, pieces)
            if len(points):
                depth = -self._above(points)[0]
                worst[0][number], worst[1][number] = depth.max(), times_s[depth.argmax()]
        deepest = int(worst[0].argmax())
        return Series(worst[0][None], self.feet, worst[1][[deepest]])

    def _pieces(self) -> int:
        """Into how many pieces steps from sample to sample are cut."""
        longest = float(np.linalg.norm(np.diff(self.trajectory.feet_m, axis=0), axis=-1).max())
        return int(np.clip(np.ceil(longest / _APART_M), 2, _MOST_PIECES))

    def _between(self, number: int, pieces: int) -> tuple[Array, Array]:
        """Points of one foot between samples of which neither stands, shape (P, 3) [m], and their
        times (P,) [s].
        """
        flies = ~self.trajectory.contact[:, number]
        at = np.flatnonzero(flies[1:-2] & flies[2:-1] & flies[:-3] & flies[3:]) + 1
        shares = np.arange(1, pieces) / pieces
        weights = 0.5 * np.stack(
            [
                -shares + 2 * shares**2 - shares**3,
                2 - 5 * shares**2 + 3 * shares**3,
                shares + 4 * shares**2 - 3 * shares**3,
                -(shares**2) + shares**3,
            ]
        )
        near = self.trajectory.feet_m[at[:, None] + np.arange(-1, 3), number]
        points = np.einsum("kwi,ws->ksi", near, weights).reshape(-1, 3)
        return points, (self.times_s[at][:, None] + shares * self.step_s).ravel()

    def _heights(self, swing: _FootPhase) -> Array:
        return self._height_m[swing.first : swing.last + 1, swing.foot]

    def _middle(self, swing: _FootPhase) -> Array:
        """Heights in the middle half; of a swing that is cut off all but a quarter beside the end
        at which it lands.
        """
        heights = self._heights(swing)
        quarter = len(heights) // 4
        begins, ends = swing.first > 0, swing.last < len(self._height_m) - 1
        return heights[quarter * begins : len(heights) - quarter * ends]

    def _dragged(self, swing: _FootPhase, near_m: float) -> float:
        first, last = max(swing.first - 1, 0), min(swing.last + 1, len(self._height_m) - 1)
        way = self.trajectory.feet_m[first : last + 1, swing.foot]
        stands = self.trajectory.contact[first : last + 1, swing.foot]
        low = stands | (self._height_m[first : last + 1, swing.foot] < near_m)
        return float(np.linalg.norm(np.diff(way, axis=0), axis=1)[low[1:] & low[:-1]].sum())

    def _marked(self, found: Iterator[tuple[_FootPhase, float]]) -> Series:
        """A value a phase, at the sample where the phase begins."""
        values = np.zeros(self.trajectory.contact.shape)
        for phase, value in found:
            values[phase.first, phase.foot] = max(value, 0.0)
        return Series(values, self.feet, self.times_s)


def _phases(holds: Flags) -> Iterator[_FootPhase]:
    """Runs of samples at which it holds, foot by foot; those that an end of the trajectory cuts off
    are not whole.
    """
    for foot in range(holds.shape[1]):
        changes = [0, *(np.flatnonzero(np.diff(holds[:, foot])) + 1).tolist(), len(holds)]
        for first, end in pairwise(changes):
            if holds[first, foot]:
                yield _FootPhase(foot, first, end - 1, whole=first > 0 and end < len(holds))


_MOST_EDGES = 4000
"""Windows begin and end at every sample of trajectories up to so many, and at every so-manieth of
longer ones."""
_EVEN = 1e-9
"""Normal force of all feet below which there is none, in units of m·g."""


class MomentumMeasurements:
    """Measurements of the residuals of one trajectory, and of its two ends."""

    def __init__(self, measured: TrajectoryMeasurements) -> None:
        self._measured, self.trajectory = measured, measured.trajectory
        self.times_s, self.step_s = measured.times_s, measured.step_s

    # ------------------------------------------------------------------------------------------------
    # windows

    def impulse(self, rate_n: float) -> Series:
        """‖∫ (m (a − g) − Σ f) dt‖ over every window, less ``rate_n`` a second of it, shape (1, 1)
        [N s].
        """
        return self._windows(self._measured.force_residual(), rate_n)

    def angular_impulse(self, rate_nm: float) -> Series:
        """‖∫ (dL/dt − Σ (p_i − p) × f_i) dt‖ over every window, less ``rate_nm`` a second of it [N
        m s].
        """
        return self._windows(self._measured.moment_residual(), rate_nm)

    def _windows(self, residual: Series, rate: float) -> Series:
        impulses = (
            np.concatenate([np.zeros((1, 3)), np.cumsum(residual.values, axis=0)]) * self.step_s
        )
        stride = 1 + (len(impulses) - 1) // _MOST_EDGES
        edges = np.unique(np.append(np.arange(0, len(impulses), stride), len(impulses) - 1))
        sums, lasts = np.ascontiguousarray(impulses[edges].T), edges * self.step_s
        worst, begins = 0.0, 0
        most = float(np.linalg.norm(np.ptp(sums, axis=1)))  # of any window
        for apart in range(1, len(edges)):
            if most - rate * (apart - 1) * stride * self.step_s <= worst:
                break  # nor have longer ones more
            within = sums[:, apart:] - sums[:, :-apart]
            size = np.sqrt(np.einsum("ik,ik->k", within, within)) - rate * (
                lasts[apart:] - lasts[:-apart]
            )
            at = int(size.argmax())
            if size[at] > worst:
                worst, begins = float(size[at]), int(edges[at])
        return Series(np.array([[worst]]), ("torso",), self.times_s[[begins + 1]])

    # ---------------------------------------------------------------------------------------------
    # traction

    @cached_property
    def _lacking(self) -> Array:
        """Part of the force that the motion needs and that cones cannot give, of all feet, shape (K
        − 2,) [N].

        The force residual is added to the standing feet by their shares of the normal force. What
        ‖f_t‖ has beyond ν (f_n + s) counts, and any pull beyond the suction s; where no foot
        presses the residual counts whole.
        """
        trajectory, residual = self.trajectory, self._measured.force_residual().values
        normals, stands = self._measured.ground[1][1:-1], trajectory.contact[1:-1]
        forces = trajectory.forces_n[1:-1]
        presses = np.where(stands, np.maximum(np.sum(forces * normals, axis=-1), 0.0), 0.0)
        whole = presses.sum(axis=1)
        carried = whole > _EVEN * self._measured.weight_n
        shares = presses / np.where(carried, whole, 1.0)[:, None]
        supplied = forces + shares[..., None] * residual[:, None]
        beyond = self._measured.beyond_cone(supplied, normals, self._measured.suction_n)
        lacking = np.where(stands, np.maximum(beyond, 0.0), 0.0).sum(axis=1)
        return np.asarray(np.where(carried, lacking, np.linalg.norm(residual, axis=1)))

    def traction(self) -> Series:
        """Force that the motion needs and that the standing feet's cones cannot give, shape (K − 2,
        1) [N].
        """
        return Series(self._lacking[:, None], ("torso",), self.times_s[1:-1])

    def traction_impulse(self) -> Series:
        """Impulse of that part over the whole walk, up to each sample [N s]."""
        return Series(
            np.cumsum(self._lacking)[:, None] * self.step_s, ("torso",), self.times_s[1:-1]
        )

    def traction_way(self) -> Series:
        """Distance that the centre of mass gets by it, up to each sample, as if all of it pushed
        one way [m].
        """
        speed = self.traction_impulse().values / self.trajectory.robot.mass_kg
        return Series(np.cumsum(speed, axis=0) * self.step_s, ("torso",), self.times_s[1:-1])

    def traction_turn(self) -> Series:
        """Angle that the torso turns about the vertical by moments that the standing feet cannot
        give [rad].

        A foot gives at most ‖r‖ (‖n‖ + ν) (f_n + s) about the vertical through the centre of mass,
        all horizontal.
        """
        trajectory, normals = self.trajectory, self._measured.ground[1][1:-1]
        arms = (trajectory.feet_m - trajectory.torso_m[:, None])[1:-1]
        forces, stands = trajectory.forces_n[1:-1], trajectory.contact[1:-1]
        needed = (
            self._measured.moment_residual().values[:, 2] + np.cross(arms, forces).sum(axis=1)[:, 2]
        )
        presses = np.maximum(np.sum(forces * normals, axis=-1), 0.0) + self._measured.suction_n
        level = np.linalg.norm(normals[..., :2], axis=-1) + trajectory.friction
        moments = np.where(
            stands, np.linalg.norm(arms[..., :2], axis=-1) * level * presses, 0.0
        ).sum(axis=1)
        lacking = (
            np.maximum(np.abs(needed) - moments, 0.0)
            / np.linalg.eigvalsh(np.asarray(trajectory.robot.inertia_kgm2))[-1]
        )
        turned = np.cumsum(np.cumsum(lacking)) * self.step_s**2
        return Series(turned[:, None], ("torso",), self.times_s[1:-1])

    def angular_residual(self) -> Series:
        """Angular acceleration that the moments of the feet do not explain, shape (K − 2, 1)
        [rad/s²].
        """
        rotation, missing = self.trajectory.rotation[1:-1], self._measured.moment_residual().values
        moment = np.einsum("kji,kj->ki", rotation, missing)
        rate = np.linalg.solve(np.asarray(self._measured.robot.inertia_kgm2), moment.T).T
        return Series(np.linalg.norm(rate, axis=1)[:, None], ("torso",), self.times_s[1:-1])

    # -------------------------------------------------------------------------------------------
    # both ends

    def heading(self) -> Series:
        """Angle of the torso's x axis, seen from above, off the headings asked for at both ends,
        (2, 1) [rad].
        """
        headings = (self.trajectory.heading_rad, self.trajectory.heading_end_rad)
        axes = self.trajectory.rotation[[0, -1], :, 0]
        off = [
            0.0 if rad is None else float(np.arctan2(x[1], x[0])) - rad
            for rad, x in zip(headings, axes, strict=True)
        ]
        away = np.abs((np.array(off) + np.pi) % (2.0 * np.pi) - np.pi)
        return Series(away[:, None], ("torso",), self.times_s[[0, -1]])

    def rest(self) -> Series:
        """Speed of torso and feet, turning at the stand height, at the ends asked to be at rest
        [m/s].
        """
        points = np.concatenate([self.trajectory.feet_m, self.trajectory.torso_m[:, None]], axis=1)
        speed = np.linalg.norm(points[self._ends(1)] - points[self._ends(0)], axis=-1) / self.step_s
        turning = (
            np.linalg.norm(self._measured.spin[self._ends(0, 1)], axis=1)
            * self._measured.robot.stand_height_m
        )
        speed[:, -1] = np.maximum(speed[:, -1], turning)
        return Series(speed, (*self._measured.feet, "torso"), self.times_s[self._ends(0)])

    def rest_acceleration(self) -> Series:
        """Acceleration of the torso at the ends asked to be at rest, on a line through the next two
        samples [m/s²].
        """
        felt = self._measured.acceleration
        felt = np.linalg.norm(2.0 * felt[self._ends(0, 2)] - felt[self._ends(1, 2)], axis=1)
        return Series(felt[:, None], ("torso",), self.times_s[self._ends(0)])

    def _ends(self, step: int, shorter: int = 0) -> list[int]:
        """The first samples, the last ones, or none: as the task asks; ``step`` inwards of a series
        so much shorter.
        """
        last = self.trajectory.samples - 1 - shorter
        starts, stops = self.trajectory.still
        return [step] * starts + [last - step] * stops


def _defect_of(trajectory: Trajectory, step_s: float) -> str:
    """Defect that keeps a trajectory from being one at all, so that nothing can be measured; empty
    when nothing does.

    Arguments:
        step_s: the coarsest grid that is believed [s].
    """
    count, feet = trajectory.samples, len(trajectory.robot.feet)
    if count < 4:  # the acceleration at either end is on a line through two
        return f"times_s: expected four samples or more, got {count}"
    shapes = {
        "times_s": (count,),
        "torso_m": (count, 3),
        "rotation": (count, 3, 3),
        "feet_m": (count, feet, 3),
        "forces_n": (count, feet, 3),
        "contact": (count, feet),
        "adhesive": (feet,),
        "start": (2,),
        "goal": (2,),
    }
    for name, shape in shapes.items():
        array = getattr(trajectory, name)
        if array.shape != shape:
            return f"{name}: expected shape {shape}, got {array.shape}"
        if not np.isfinite(array).all():
            return f"{name}: expected finite numbers, got {array[~np.isfinite(array)][0]}"
        if not float(np.abs(array).max()) <= LARGEST:
            return f"{name}: expected magnitudes up to {LARGEST:g}, got {np.abs(array).max():g}"
    steps = np.diff(trajectory.times_s)
    if not float(steps.min()) > 0.0:
        return f"times_s: expected increasing times, got a step of {steps.min():g} s"
    if float(np.ptp(steps)) > 1e-6 * float(steps.max()):
        return (
            f"times_s: expected a uniform grid, got steps from {steps.min():g} to {steps.max():g} s"
        )
    if float(steps.max()) > step_s * (1.0 + 1e-6):
        return (
            f"times_s: expected samples every {step_s:g} s or less, got a step of {steps.max():g} s"
        )
    if not (math.isfinite(trajectory.friction) and 0.0 <= trajectory.friction <= LARGEST):
        return f"friction: expected a number of at least 0, got {trajectory.friction:g}"
    if trajectory.suction_n is not None and not 0.0 <= trajectory.suction_n <= LARGEST:
        return f"suction_n: expected a number of at least 0, got {trajectory.suction_n:g}"
    for name in ("heading_rad", "heading_end_rad"):
        heading = getattr(trajectory, name)
        if heading is not None and not abs(heading) <= LARGEST:
            return f"{name}: expected a finite number, got {heading:g}"
    return ""


_TIME_S = 1e-9
"""Times are sums of steps: what rounding makes of them [s]."""
_OVERFLOW = "the numbers overflow"
__all__ = ["GROUPS", "WalkLimits", "check_trajectory", "with_body"]


def check_trajectory(
    trajectory: Trajectory, limits: WalkLimits = WalkLimits(), *, body: bool = True
) -> Report[Trajectory]:
    """Check everything between the knots that a robot would have to live with; never raises for a
    bad trajectory.

    Arguments:
        body: judge joints, torques and bodies, too, of a robot that has a model; that takes most of
            the time.
    """
    with np.errstate(all="ignore"):
        defect = _defect_of(trajectory, limits.step_s)
        if defect:
            return _refused(trajectory, limits, defect)
        measured = TrajectoryMeasurements(trajectory)
        groups = _measured(measured, limits, body=body)
        if not all(math.isfinite(group.value) for group in groups):
            return _refused(trajectory, limits, _OVERFLOW)
        return Report(
            groups=groups,
            answer=trajectory,
            tolerance=0.0,
            figures=measured.figures(limits.cone),
            limits=asdict(limits),
            remark=measured.footing(),
        )


def with_body(report: Report[Trajectory], limits: WalkLimits = WalkLimits()) -> Report[Trajectory]:
    """The report of ``check_trajectory`` with the robot's own body, from one without: the other
    groups stay.

    Arguments:
        report: with ``body=False``, for the same limits.
    """
    if report.defect:
        return report
    with np.errstate(all="ignore"):
        groups = {
            group.name: group
            for group in _groups(*whole_body(TrajectoryMeasurements(report.answer), limits))
        }
    if not all(math.isfinite(group.value) for group in groups.values()):
        return _refused(report.answer, limits, _OVERFLOW)
    return replace(report, groups=tuple(groups.get(group.name, group) for group in report.groups))


def _measured(
    measured: TrajectoryMeasurements, limits: WalkLimits, *, body: bool
) -> tuple[Group, ...]:
    """The worst of every group, in the order of ``GROUPS``."""
    groups, unasked = whole_body(measured, limits) if body else nothing("not asked for")
    rows = (
        _balances(measured, limits)
        | _contacts(measured, limits)
        | _whole(measured, limits)
        | groups
    )
    return _groups(rows, unasked | _unasked(measured.trajectory))


def _groups(rows: Rows, unasked: dict[str, str]) -> tuple[Group, ...]:
    """The worst of every group that was measured, in the order of ``GROUPS``.

    Arguments:
        unasked: why some are not checked.
    """
    groups = []
    for group, unit in GROUPS.items():
        if group not in rows:
            continue
        series, limit, *rms = rows[group]
        worst, where, time_s = series.worst()
        value, reason = rms[0] if rms else worst, unasked.get(group, "")
        groups.append(
            Group(
                name=group,
                value=value,
                limit=limit,
                unit=unit,
                where=where,
                when=None if math.isnan(time_s) else time_s,
                message=reason,
                verdict="not checked" if reason and value <= limit else "",
            )
        )
    return tuple(groups)


def _unasked(trajectory: Trajectory) -> dict[str, str]:
    """Groups of which a trajectory does not say what is asked for, and what it does not say."""
    reasons = dict[str, str]()
    if trajectory.heading_rad is None and trajectory.heading_end_rad is None:
        reasons["heading"] = "no heading is asked for"
    if not all(trajectory.still):
        reasons |= dict.fromkeys(
            ("rest", "rest_acceleration"), "it is not asked to be at rest at both ends"
        )
    if trajectory.adhesive.any() and trajectory.suction_n is None:
        reasons["suction"] = "no suction of feet that stick"
    return reasons


def _balances(measured: TrajectoryMeasurements, limits: WalkLimits) -> Rows:
    """Newton and Euler, and who could supply what they lack."""
    weight, moment = measured.weight_n, measured.moment_scale_nm
    forces, moments, momentum = (
        measured.force_residual(),
        measured.moment_residual(),
        MomentumMeasurements(measured),
    )
    spin = limits.angular_residual * GRAVITY_M_S2 / measured.robot.stand_height_m
    return {
        "force_balance": (forces.size(), limits.force_balance * weight, forces.rms()),
        "force_peak": (forces.size(), limits.force_peak * weight),
        "moment_balance": (moments.size(), limits.moment_balance * moment, moments.rms()),
        "moment_peak": (moments.size(), limits.moment_peak * moment),
        "impulse": (momentum.impulse(limits.impulse_rate * weight), limits.impulse_s * weight),
        "angular_impulse": (
            momentum.angular_impulse(limits.angular_impulse_rate * moment),
            limits.angular_impulse_s * moment,
        ),
        "angular_residual": (momentum.angular_residual(), spin),
        "traction": (momentum.traction(), limits.traction * weight),
        "traction_impulse": (momentum.traction_impulse(), limits.traction_impulse_s * weight),
        "traction_way": (momentum.traction_way(), limits.traction_way_m),
        "traction_turn": (momentum.traction_turn(), limits.traction_turn_rad),
        "heading": (momentum.heading(), limits.heading_rad),
        "rest": (momentum.rest(), limits.rest_m_s),
        "rest_acceleration": (
            momentum.rest_acceleration(),
            limits.rest_acceleration * GRAVITY_M_S2,
        ),
    }


def _contacts(measured: TrajectoryMeasurements, limits: WalkLimits) -> Rows:
    """Feet: what they press with, where they stand, and how they step."""
    weight, steps = measured.weight_n, _StepMeasurements(measured)
    return {
        "cone": (measured.cone(), limits.cone * weight),
        "suction": (measured.suction(), limits.cone * weight),
        "force_foot": (measured.force_foot(), limits.force_foot * weight),
        "swing_force": (measured.swing_force(), limits.swing_force * weight),
        "contact_gap": (measured.contact_gap(), limits.contact_gap_m),
        "slip": (measured.slip(), limits.slip_m),
        "foot_velocity": (steps.foot_velocity(), limits.foot_velocity_m_s),
        "touch_speed": (steps.touch_speed(), limits.touch_speed_m_s),
        "stance_time": (steps.stance_time(limits.least_stance_s), _TIME_S),
        "swing_time": (steps.swing_time(limits.least_swing_s), _TIME_S),
        "lift": (steps.lift(limits.least_lift_m), 0.0),
        "clearance": (steps.clearance(limits.least_clearance_m), 0.0),
        "drag": (steps.drag(limits.contact_gap_m), limits.drag_m),
        "penetration": (measured.penetration(), limits.penetration_m),
        "penetration_between": (steps.penetration_between(), limits.penetration_m),
        "reach": (measured.reach(), limits.reach_m),
    }


def _whole(measured: TrajectoryMeasurements, limits: WalkLimits) -> Rows:
    """The motion as one, and the course."""
    trajectory = measured.trajectory
    return {
        "rotation": (measured.off_rotation(), limits.rotation),
        "start": (measured.miss(0, trajectory.start), limits.start_m),
        "goal": (measured.miss(-1, trajectory.goal), limits.goal_m),
        "domain": (measured.domain(), limits.domain_m),
        "continuity": (measured.jumps(), limits.continuity_m),
        "foot_speed": (measured.foot_speed(), limits.foot_speed_m_s),
        "torso_speed": (measured.torso_speed(), limits.torso_speed_m_s),
        "turn_rate": (measured.turn_rate(), limits.turn_rate_rad_s),
        "trunk": (measured.trunk(), limits.trunk_m),
    }


def _refused(trajectory: Trajectory, limits: WalkLimits, defect: str) -> Report[Trajectory]:
    groups = tuple(Group(group, math.inf, 0.0, unit) for group, unit in GROUPS.items())
    return Report(
        groups=groups, answer=trajectory, tolerance=0.0, limits=asdict(limits), defect=defect
    )
