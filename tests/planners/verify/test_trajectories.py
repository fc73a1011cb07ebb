"""The verifier of trajectories against motions in closed form, each group made to fail by one
fault.
"""

from __future__ import annotations

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from stancekit import Motion, WalkQuestion
from stancekit.planners.robot.model import Foot, Robot
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify import trajectories
from stancekit.planners.verify.trajectories import GROUPS, LIMITS, check_trajectory
from stancekit.planners.verify.trajectory_measurements import WHOLE_BODY, TrajectoryMeasurements
from tests.forgeries import walks
from tests.refusals import assert_names

G = 9.81
STEP_S = 0.005
TIMES_S = STEP_S * np.arange(101)
FEET = ("LF", "RF", "LH", "RH")


def robot(mass_kg=30.0, inertia=(1.0, 2.0, 2.4)) -> Robot:
    """Four feet on a rectangle, boxes of ±.15, ±.12, ±.12 m."""
    half = np.array([0.15, 0.12, 0.12])
    feet = []
    for name, x, y in zip(FEET, (1, 1, -1, -1), (1, -1, 1, -1), strict=True):
        nominal = np.array([0.35 * x, 0.2 * y, -0.45])
        feet.append(
            Foot(
                name=name,
                nominal_m=nominal,
                reach_min_m=nominal - half,
                reach_max_m=nominal + half,
                hip_m=np.array([0.3 * x, 0.12 * y, 0.0]),
            )
        )
    return Robot(
        name="table",
        mass_kg=mass_kg,
        inertia_kgm2=np.diag(inertia),
        feet=tuple(feet),
        stand_height_m=0.45,
        trunk_half_m=np.array([0.3, 0.15, 0.1]),
    )


def plane(slope_x=0.0, slope_y=0.0) -> HeightField:
    return HeightField.from_function(
        lambda x, y: slope_x * x + slope_y * y, 3.0, 0.25, name="plane"
    )


def nominal(of: Robot) -> np.ndarray:
    return np.array([foot.nominal_m for foot in of.feet])


def upright(normal) -> np.ndarray:
    """R_WB whose z is the normal and whose x lies over the world's x."""
    x = np.cross([0.0, 1.0, 0.0], normal)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])


def balancing(arms, net, moment) -> np.ndarray:
    """The smallest forces at these arms with this sum and this moment, shape (E, 3)."""
    skew = [np.cross(arm, np.eye(3)).T for arm in arms]
    rows = np.vstack([np.hstack([np.eye(3)] * len(arms)), np.hstack(skew)])
    found, *_ = np.linalg.lstsq(rows, np.concatenate([net, moment]), rcond=None)
    assert np.allclose(rows @ found, np.concatenate([net, moment]), atol=1e-8)
    return found.reshape(-1, 3)


def carrying(arms, weight_n) -> np.ndarray:
    """Upward forces at these arms that hold the weight without a moment, shape (E, 3)."""
    shares, missed = nnls(np.vstack([arms[:, :2].T, np.ones(len(arms))]), [0.0, 0.0, 1.0])
    assert missed < 1e-12
    return weight_n * np.outer(shares, [0.0, 0.0, 1.0])


def standing(slope_x=0.0, slope_y=0.0, friction=0.75) -> Motion:
    """Still on a plane, the torso along it, the feet at their nominal places, the forces straight
    up and exact.
    """
    body, terrain = robot(), plane(slope_x, slope_y)
    normal = np.array([-slope_x, -slope_y, 1.0])
    normal = normal / np.linalg.norm(normal)
    rotation, torso = upright(normal), 0.45 * normal
    feet = torso + nominal(body) @ rotation.T
    forces = carrying(feet - torso, body.mass_kg * G)
    count = len(TIMES_S)
    return Motion(
        times_s=TIMES_S,
        torso_m=np.tile(torso, (count, 1)),
        rotation=np.tile(rotation, (count, 1, 1)),
        feet_m=np.tile(feet, (count, 1, 1)),
        forces_n=np.tile(forces, (count, 1, 1)),
        contact=np.ones((count, 4), dtype=bool),
        problem=WalkQuestion(
            robot=body,
            terrain=terrain,
            friction=friction,
            adhesive=np.zeros(4, dtype=bool),
            start=torso[:2],
            goal=torso[:2],
            heading_rad=0.0,
            still=(True, True),
        ),
        provenance={"chart": "by hand", "seconds": 0.5},
    )


def flying(spin=(0.0, 0.0, 1.2), velocity=(0.8, -0.3, 2.4), inertia=(1.0, 2.0, 2.4)) -> Motion:
    """Through the air, the feet held still under the body, the spin by Euler's equations
    (integrated by scipy).
    """
    body = robot(inertia=inertia)
    moments = np.array(inertia)

    def rates(_time, state):
        (x, y, z, w), omega = state[:4], state[4:]
        a, b, c = omega
        turn = 0.5 * np.array(
            [
                w * a + y * c - z * b,
                w * b + z * a - x * c,
                w * c + x * b - y * a,
                -x * a - y * b - z * c,
            ]
        )
        return np.concatenate([turn, np.cross(moments * omega, omega) / moments])

    state = np.array([0.0, 0.0, 0.0, 1.0, *spin])
    run = solve_ivp(rates, (0.0, TIMES_S[-1]), state, t_eval=TIMES_S, rtol=1e-11, atol=1e-12)
    rotation = Rotation.from_quat(run.y[:4].T).as_matrix()
    t = TIMES_S[:, None]
    torso = (
        np.array([0.0, 0.0, 1.5])
        + np.array(velocity) * t
        - 0.5 * G * t**2 * np.array([0.0, 0.0, 1.0])
    )
    count = len(TIMES_S)
    return walks.changed(
        standing(),
        robot=body,
        torso_m=torso,
        rotation=rotation,
        feet_m=torso[:, None] + np.einsum("kij,ej->kei", rotation, nominal(body)),
        forces_n=np.zeros((count, 4, 3)),
        contact=np.zeros((count, 4), dtype=bool),
        start=torso[0, :2],
        goal=torso[-1, :2],
        heading_rad=None,
        still=(False, False),
    )


def swaying(amplitude_m=0.02, roll_rad=0.05, rate=6.0) -> Motion:
    """On level ground, the torso bobbing and rolling about its x by sines, the forces from their
    second derivatives.
    """
    still = standing()
    body = still.robot
    phase = rate * TIMES_S
    lift, roll = amplitude_m * np.sin(phase), roll_rad * np.sin(phase)
    torso = still.torso_m + np.outer(lift, [0.0, 0.0, 1.0])
    rotation = Rotation.from_rotvec(np.outer(roll, [1.0, 0.0, 0.0])).as_matrix()
    force = body.mass_kg * (G - rate**2 * lift)
    moment = -body.inertia_kgm2[0, 0] * rate**2 * roll
    forces = [
        balancing(still.feet_m[k] - torso[k], [0.0, 0.0, force[k]], [moment[k], 0.0, 0.0])
        for k in range(len(phase))
    ]
    return walks.changed(
        still, torso_m=torso, rotation=rotation, forces_n=np.array(forces), still=(False, False)
    )


def stepping() -> Motion:
    """Standing, but the left forefoot swings up and ahead from .15 s to .35 s; the others carry
    what they can.
    """
    still = standing()
    feet, forces, contact = (
        np.array(array) for array in (still.feet_m, still.forces_n, still.contact)
    )
    swing = (TIMES_S > 0.1499) & (TIMES_S < 0.3501)
    phase = np.clip((TIMES_S - 0.15) / 0.2, 0.0, 1.0)
    smooth = phase**3 * (10.0 - 15.0 * phase + 6.0 * phase**2)
    feet[:, 0, 0] += 0.08 * smooth
    feet[:, 0, 2] += 0.06 * 64.0 * (phase * (1.0 - phase)) ** 3
    contact[swing, 0] = False
    torso = still.torso_m - np.array([0.05, 0.03, 0.0])
    for k in range(len(TIMES_S)):
        standing_feet = np.flatnonzero(contact[k])
        forces[k] = 0.0
        forces[k, standing_feet] = carrying(
            feet[k, standing_feet] - torso[k], still.robot.mass_kg * G
        )
    return walks.changed(
        still,
        torso_m=torso,
        feet_m=feet,
        forces_n=forces,
        contact=contact,
        start=torso[0, :2],
        goal=torso[0, :2],
    )


def refused(trajectory, limits=LIMITS) -> dict[str, tuple[str, float]]:
    """The groups that break their limits, with where and when."""
    return {g.name: (g.where, g.when) for g in check_trajectory(trajectory, limits).refused}


def figures(trajectory):
    return check_trajectory(trajectory).figures


# ------------------------------------------------------------------------------------------------
# closed forms


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.1)])
def test_standing_still_with_exact_forces_is_accepted_on_level_and_sloped_ground(slope):
    report = check_trajectory(standing(*slope))
    assert report.accepted, report.message
    assert tuple(g.name for g in report.groups) == tuple(GROUPS)
    shown = {"cone", "force_foot"}  # what a foot that stands has
    assert (
        max(g.value for g in report.groups if g.unit in ("m", "N", "Nm") and g.name not in shown)
        < 1e-9
    )
    assert report.figures["friction_needed"] == pytest.approx(np.hypot(*slope), abs=1e-9)


def test_a_slope_steeper_than_the_friction_is_refused():
    assert set(refused(standing(0.5, 0.0, friction=0.48))) == {
        "cone",
        "traction_impulse",
        "traction_way",
    }
    assert not refused(standing(0.5, 0.0, friction=0.52))


def test_an_adhesive_foot_has_no_cone():
    steep = standing(0.5, 0.0, friction=0.1)
    assert set(refused(steep)) == {"cone", "traction", "traction_impulse", "traction_way"}
    stuck = steep.asked(adhesive=np.ones(4, dtype=bool))
    assert not refused(stuck)
    assert check_trajectory(stuck).unchecked == ("suction", *WHOLE_BODY)
    assert_names(check_trajectory(stuck).hindrance, "suction")
    assert "cone" in refused(steep.asked(adhesive=np.array([True, True, True, False])))


@given(slope=st.floats(0.2, 0.5), share=st.floats(0.3, 3.0))
@settings(max_examples=30)
def test_suction_begins_the_cone_at_its_pull(slope, share):
    """On a slope a foot that carries a quarter needs ‖f_t‖ / ν − f_n of suction, and no more."""
    still = standing(slope, 0.0, friction=0.1)
    normal = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    force = still.forces_n[0]
    needed = float((np.linalg.norm(np.cross(force, normal), axis=1) / 0.1 - force @ normal).max())
    report = check_trajectory(
        still.asked(adhesive=np.ones(4, dtype=bool), suction_n=share * needed)
    )
    assert report.unchecked == WHOLE_BODY  # the robot is but boxes
    assert report.accepted == (0.1 * (1.0 - share) * needed <= 1e-3 * still.robot.weight_n)


@pytest.mark.parametrize("acceleration", [0.05, 0.14, 0.18])
@pytest.mark.parametrize(
    ("fault", "group"), [("leaning", "traction_way"), ("turning", "traction_turn")]
)
def test_a_body_on_ice_gets_no_farther_than_nobody_pushes_it(fault, group, acceleration):
    """Both are ½ a t² at the last inner sample, in closed form, and .02 of it is too much."""
    moves = {"leaning": leaning, "turning": turning}[fault]
    found = {g.name: g for g in check_trajectory(moves(standing(), acceleration)).groups}[group]
    expected = 0.5 * acceleration * TIMES_S[-2] ** 2
    share = (
        1.0
        if fault == "leaning"
        else robot().inertia_kgm2[2, 2] / np.linalg.eigvalsh(robot().inertia_kgm2)[-1]
    )
    assert found.value == pytest.approx(share * expected, rel=0.02)
    assert (found.verdict == "holds") == (found.value <= 0.02)


def test_no_foot_pulls_where_there_is_no_friction():
    """ν = 0 leaves nothing of ν f_n, and the pull alone is what is wrong."""
    ice = standing(friction=0.0)
    assert not refused(ice)
    assert refused(changed(ice, "forces_n", [0.0, 0.0, -0.4], (50, 2)))["cone"] == (
        "LH",
        TIMES_S[50],
    )


def test_a_ballistic_hop_is_accepted_and_one_without_gravity_is_not():
    hop = flying()
    assert not refused(hop)
    assert figures(hop)["peak_acceleration_g"] == pytest.approx(1.0, abs=1e-9)
    straight = hop.torso_m[0] + np.outer(TIMES_S, [0.8, -0.3, 2.4])
    floating = replace(hop, torso_m=straight, feet_m=hop.feet_m + (straight - hop.torso_m)[:, None])
    lacks = {
        "force_balance",
        "force_peak",
        "impulse",
        "traction",
        "traction_impulse",
        "traction_way",
    }
    assert set(refused(floating)) == lacks
    assert figures(floating)["force_rms"] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    "spin", [(0.0, 0.0, 1.5), (1.5, 0.1, 0.1), (0.1, 2.0, 0.3), (0.8, -1.0, 0.9)]
)
def test_a_free_tumble_keeps_its_angular_momentum_whatever_axis_it_is_about(spin):
    tumble = flying(spin=spin)
    assert not refused(tumble)
    assert figures(tumble)["moment_peak"] < 1e-6
    locked = tumble.asked(robot=robot(inertia=(2.4, 2.0, 1.0)))
    assert figures(locked)["moment_peak"] > 1e-3 or np.count_nonzero(spin) == 1


def test_bobbing_and_rolling_with_the_forces_of_newton_and_euler_is_accepted():
    sway = swaying()
    assert not refused(sway)
    assert figures(sway)["force_peak"] < 1e-4
    assert figures(sway)["moment_peak"] < 1e-4
    assert figures(sway)["peak_acceleration_g"] == pytest.approx(0.02 * 36.0 / G, rel=1e-2)


def test_the_residuals_are_what_is_missing_in_newtons_and_newton_metres():
    sway = swaying()
    push = np.array(sway.forces_n)
    push[40, 0] += [20.0, 0.0, 0.0]
    motion, pushed = (
        TrajectoryMeasurements(sway),
        TrajectoryMeasurements(replace(sway, forces_n=push)),
    )
    arm = sway.feet_m[40, 0] - sway.torso_m[40]
    force = pushed.force_residual - motion.force_residual
    moment = pushed.moment_residual - motion.moment_residual
    assert np.allclose(force[39], [-20.0, 0.0, 0.0], atol=1e-9)
    assert np.allclose(moment[39], -np.cross(arm, [20.0, 0.0, 0.0]), atol=1e-9)
    assert np.count_nonzero(np.abs(force).max(axis=1) > 1e-9) == 1


def test_a_step_is_accepted_and_its_swing_may_not_press():
    step = stepping()
    assert not refused(step)
    forces = np.array(step.forces_n)
    forces[50, 0, 2] = 1.0
    assert refused(replace(step, forces_n=forces)) == {"swing_force": ("LF", TIMES_S[50])}


def test_curved_ground_is_met_at_its_true_normal():
    """One foot on a dome: the normal of a sphere of radius r is known, and so is the distance of a
    point from it.
    """
    radius = 5.0
    dome = HeightField.from_function(
        lambda x, y: np.sqrt(radius**2 - x**2 - y**2) - radius, 2.0, 0.05
    )
    still = standing()
    points = np.array([[0.7, 0.4], [-0.9, 0.2], [0.1, -1.1], [0.0, 0.0]])
    above = radius + np.array([0.0, 5e-4, -5e-4, 0.0])
    normals = np.column_stack([points, np.sqrt(radius**2 - (points**2).sum(axis=1))]) / radius
    feet = above[:, None] * normals - [0.0, 0.0, radius]
    lean = 100.0 * (
        normals
        + 0.3
        * np.cross(normals, [0.0, 1.0, 0.0])
        / np.linalg.norm(np.cross(normals, [0.0, 1.0, 0.0]), axis=1, keepdims=True)
    )
    motion = TrajectoryMeasurements(
        walks.changed(
            still,
            terrain=dome,
            feet_m=np.tile(feet, (101, 1, 1)),
            forces_n=np.tile(lean, (101, 1, 1)),
        )
    )
    assert np.allclose(np.abs(motion.ground[0][0]), [0.0, 5e-4, 5e-4, 0.0], atol=1e-6)
    assert np.allclose(motion.beyond[0], 100.0 * (0.3 - 0.75), atol=1e-2)


# ---------------------------------------------------------------------------------------------- one
# fault a group


def moved(trajectory, name, change, where=np.s_[:]):
    array = np.array(getattr(trajectory, name))
    array[where] = array[where] + change
    return replace(trajectory, **{name: array})


def stretched(trajectory):
    scaled = np.array(trajectory.rotation)
    scaled[20] *= 1.0 + 1e-5
    return replace(trajectory, rotation=scaled)


def mirrored(trajectory):
    return replace(trajectory, rotation=trajectory.rotation * np.array([1.0, 1.0, -1.0]))


def whirled(trajectory):
    turned = np.array(trajectory.rotation)
    turned[60:] = turned[60:] @ Rotation.from_rotvec([0.0, 0.0, 0.04]).as_matrix()
    return replace(trajectory, rotation=turned)


def lowered(trajectory):
    """A stone under the trunk, between its corners and away from the feet."""
    stone = HeightField.from_function(
        lambda x, y: 0.4 * np.exp(-((x / 0.08) ** 2) - (y / 0.08) ** 2), 3.0, 0.02
    )
    return trajectory.asked(terrain=stone)


def changed(trajectory, name, value, where):
    array = np.array(getattr(trajectory, name))
    array[where] = value
    return replace(trajectory, **{name: array})


def flattened(trajectory, height, ahead=1.0):
    """The swing's height and way times these factors."""
    feet = np.array(trajectory.feet_m)
    feet[:, 0, 2] *= height
    feet[:, 0, 0] = feet[0, 0, 0] + ahead * (feet[:, 0, 0] - feet[0, 0, 0])
    return replace(trajectory, feet_m=feet)


def leaning(trajectory, acceleration):
    """Pushed ahead by nobody on ground without friction [m/s²]."""
    ahead = 0.5 * acceleration * TIMES_S[:, None] ** 2 * [1.0, 0.0, 0.0]
    return moved(trajectory.asked(friction=0.0), "torso_m", ahead)


def turning(trajectory, acceleration):
    """Turned about the vertical by nobody on ground without friction [rad/s²]."""
    turn = Rotation.from_rotvec(
        np.outer(0.5 * acceleration * TIMES_S**2, [0.0, 0.0, 1.0])
    ).as_matrix()
    return replace(trajectory.asked(friction=0.0), rotation=turn @ trajectory.rotation)


FAULTS = {
    "rotation": (standing, stretched, "torso", 0.1),
    "start": (
        standing,
        lambda t: t.asked(start=t.problem.start + np.array([0.006, 0.0])),
        "torso",
        0.0,
    ),
    "goal": (
        standing,
        lambda t: t.asked(goal=t.problem.goal + np.array([0.0, -0.006])),
        "torso",
        0.5,
    ),
    "domain": (
        standing,
        lambda t: t.asked(terrain=HeightField.from_function(lambda x, y: 0 * x, 0.3)),
        "LF",
        0.0,
    ),
    "continuity": (
        stepping,
        lambda t: moved(t, "feet_m", [0.0, 0.0, 0.008], np.s_[50, 0]),
        "LF",
        0.25,
    ),
    "foot_speed": (
        stepping,
        lambda t: moved(t, "feet_m", [0.0, 0.06, 0.06], np.s_[45:55, 0]),
        "LF",
        0.225,
    ),
    "torso_speed": (
        flying,
        lambda t: moved(t, "torso_m", [0.0, 0.02, 0.0], np.s_[60:]),
        "torso",
        0.3,
    ),
    "turn_rate": (flying, whirled, "torso", 0.3),
    "force_balance": (standing, lambda t: replace(t, forces_n=1.06 * t.forces_n), "torso", 0.005),
    "force_peak": (
        standing,
        lambda t: moved(t, "forces_n", [0.0, 0.0, 40.0], np.s_[30]),
        "torso",
        0.15,
    ),
    "moment_balance": (standing, lambda t: moved(t, "feet_m", [0.025, 0.0, 0.0]), "torso", 0.005),
    "moment_peak": (
        standing,
        lambda t: moved(t, "forces_n", [[0, 0, 60], [0, 0, 60], [0, 0, -60], [0, 0, -60]], 30),
        "torso",
        0.15,
    ),
    "cone": (
        standing,
        lambda t: moved(t, "forces_n", [60.0, 0.0, 0.0], np.s_[70:75, 2]),
        "LH",
        0.35,
    ),
    "swing_force": (
        stepping,
        lambda t: moved(t, "forces_n", [0.0, 0.0, 0.5], np.s_[50, 0]),
        "LF",
        0.25,
    ),
    "contact_gap": (
        standing,
        lambda t: moved(t, "feet_m", [0.0, 0.0, 0.0012], np.s_[:, 3]),
        "RH",
        0.0,
    ),
    "slip": (
        standing,
        lambda t: moved(t, "feet_m", np.linspace(0, 2e-3, 101)[:, None] * [1, 0, 0], np.s_[:, 1]),
        "RF",
        0.5,
    ),
    "penetration": (
        stepping,
        lambda t: moved(t, "feet_m", [0.0, 0.0, -0.0612], np.s_[50, 0]),
        "LF",
        0.25,
    ),
    "reach": (standing, lambda t: moved(t, "torso_m", [0.0, 0.0, 0.1235]), "LF", 0.0),
    "trunk": (standing, lowered, "torso", 0.0),
    "impulse": (
        standing,
        lambda t: changed(t, "forces_n", 0.5 * t.forces_n[0], np.s_[30:54]),
        "torso",
        0.15,
    ),
    "angular_impulse": (
        standing,
        lambda t: moved(t, "forces_n", [[0, 0, 4], [0, 0, 4], [0, 0, -4], [0, 0, -4]]),
        "torso",
        0.005,
    ),
    "angular_residual": (
        standing,
        lambda t: moved(t, "forces_n", [[0, 0, 60], [0, 0, 60], [0, 0, -60], [0, 0, -60]], 30),
        "torso",
        0.15,
    ),
    "traction": (
        standing,
        lambda t: moved(t.asked(friction=0.0), "torso_m", [7.5e-6, 0.0, 0.0], 60),
        "torso",
        0.3,
    ),
    "traction_impulse": (standing, lambda t: leaning(t, 0.3), "torso", 0.495),
    "traction_way": (standing, lambda t: leaning(t, 0.3), "torso", 0.495),
    "traction_turn": (standing, lambda t: turning(t, 0.4), "torso", 0.495),
    "suction": (
        standing,
        lambda t: moved(
            t.asked(adhesive=np.ones(4, dtype=bool), suction_n=50.0),
            "forces_n",
            [0.0, 0.0, -150.0],
            np.s_[70:75, 2],
        ),
        "LH",
        0.35,
    ),
    "force_foot": (
        standing,
        lambda t: moved(t, "forces_n", [0.0, 0.0, 800.0], (30, 1)),
        "RF",
        0.15,
    ),
    "foot_velocity": (
        standing,
        lambda t: moved(t, "feet_m", [9e-4, 0.0, 0.0], np.s_[60:, 1]),
        "RF",
        0.3,
    ),
    "touch_speed": (stepping, lambda t: moved(t, "feet_m", [3e-3, 0.0, 0.0], (30, 0)), "LF", 0.15),
    "stance_time": (stepping, lambda t: changed(t, "contact", True, np.s_[45:50, 0]), "LF", 0.225),
    "swing_time": (standing, lambda t: changed(t, "contact", False, np.s_[40:45, 0]), "LF", 0.2),
    "lift": (stepping, lambda t: flattened(t, 0.05), "LF", 0.15),
    "clearance": (stepping, lambda t: changed(t, "feet_m", 5e-4, (50, 0, 2)), "LF", 0.15),
    "drag": (stepping, lambda t: flattened(t, 0.0, 1.8), "LF", 0.15),
    "penetration_between": (
        stepping,
        lambda t: changed(t, "feet_m", [2e-2, 2e-4, 2e-4, 2e-2], np.s_[49:53, 0, 2]),
        "LF",
        0.2525,
    ),
    "heading": (standing, lambda t: t.asked(heading_rad=0.02), "torso", 0.0),
    "rest": (standing, lambda t: moved(t, "torso_m", [1e-4, 0.0, 0.0], 0), "torso", 0.0),
    "rest_acceleration": (
        standing,
        lambda t: moved(t, "torso_m", [1e-5, 0.0, 0.0], 0),
        "torso",
        0.0,
    ),
}


def test_there_is_a_fault_for_every_group():
    """Those that ask for the robot's own legs have theirs in ``test_trajectory_whole_body``."""
    assert set(FAULTS) == set(GROUPS) - set(WHOLE_BODY)


@pytest.mark.parametrize("group", FAULTS)
def test_one_deliberate_fault_is_caught_by_its_group_with_where_and_when(group):
    make, fault, where, time_s = FAULTS[group]
    assert check_trajectory(make()).accepted
    report = check_trajectory(fault(make()))
    assert not report.accepted
    found = {g.name: g for g in report.refused}
    assert group in found, report.message
    assert found[group].where == where
    assert found[group].when == pytest.approx(time_s, abs=1e-9)
    assert group in report.message


def test_a_reflection_is_no_rotation():
    assert "rotation" in refused(mirrored(standing()))


def test_a_fault_of_one_sample_is_not_averaged_away_over_ten_seconds():
    """RMS over a long trajectory forgives one sample's impulse; the limit on the single sample does
    not.
    """
    still = standing()
    long = 2001
    stretched_out = replace(
        still,
        times_s=STEP_S * np.arange(long),
        **{
            name: np.repeat(getattr(still, name)[:1], long, axis=0)
            for name in ("torso_m", "rotation", "feet_m", "forces_n", "contact")
        },
    )
    assert check_trajectory(stretched_out).accepted
    assert set(refused(moved(stretched_out, "forces_n", [0.0, 0.0, 35.0], 1000))) == {"force_peak"}


@settings(max_examples=60)
@given(
    foot=st.integers(0, 3),
    first=st.integers(1, 99),
    length=st.integers(1, 99),
    azimuth=st.floats(0.0, 2.0 * np.pi),
    slope=st.floats(-0.4, 0.4),
    distance=st.floats(1.01e-3, 0.3),
)
def test_a_foot_that_moves_beyond_the_limit_while_it_stands_is_caught(
    foot, first, length, azimuth, slope, distance
):
    still = standing(slope)
    along = upright([-slope, 0.0, 1.0] / np.hypot(slope, 1.0)) @ [
        np.cos(azimuth),
        np.sin(azimuth),
        0.0,
    ]
    shifted = moved(still, "feet_m", distance * along, np.s_[first : first + length, foot])
    found = {g.name: g for g in check_trajectory(shifted).refused}
    assert found["slip"].where == FEET[foot]
    assert found["slip"].value == pytest.approx(distance, rel=1e-6)


@settings(max_examples=40)
@given(
    foot=st.integers(0, 3),
    at=st.integers(0, 100),
    depth=st.floats(1.01e-3, 0.3),
    slope=st.floats(-0.6, 0.6),
)
def test_a_standing_foot_off_the_ground_is_caught_either_side_of_it(foot, at, depth, slope):
    still = standing(slope)
    normal = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    for side in (-1.0, 1.0):
        found = {
            g.name: g
            for g in check_trajectory(
                moved(still, "feet_m", side * depth * normal, (at, foot))
            ).refused
        }
        assert (found["contact_gap"].where, found["contact_gap"].when) == (FEET[foot], TIMES_S[at])
        assert found["contact_gap"].value == pytest.approx(depth, rel=1e-6)


@settings(max_examples=30)
@given(yaw=st.floats(-3.1, 3.1), x=st.floats(-1.0, 1.0), y=st.floats(-1.0, 1.0))
def test_the_verdict_does_not_depend_on_where_north_is(yaw, x, y):
    sway = swaying()
    turn = Rotation.from_euler("z", yaw).as_matrix()
    shift = np.array([x, y, 0.0])
    torso = sway.torso_m @ turn.T + shift
    elsewhere = walks.changed(
        sway,
        torso_m=torso,
        rotation=turn @ sway.rotation,
        feet_m=sway.feet_m @ turn.T + shift,
        forces_n=sway.forces_n @ turn.T,
        start=torso[0, :2],
        goal=torso[-1, :2],
        heading_rad=yaw,
    )
    here, there = check_trajectory(sway), check_trajectory(elsewhere)
    assert there.accepted
    for one, other in zip(here.groups, there.groups, strict=True):
        assert other.value == pytest.approx(one.value, abs=1e-7)


# ------------------------------------------------------------------------------------------------
# what is none


def test_what_is_no_trajectory_is_refused_and_never_raises():
    still = standing()
    spoilt = np.array(still.forces_n)
    spoilt[3, 2, 1] = np.nan
    late = np.array(TIMES_S)
    late[50] += 1e-3
    faults = (
        ("forces_n", spoilt),
        ("torso_m", still.torso_m[:-1]),
        ("feet_m", still.feet_m[:, :3]),
        ("contact", still.contact[:, 0]),
        ("adhesive", still.problem.adhesive[:2]),
        ("goal", [0.0, 0.0, 0.0]),
        ("feet_m", still.feet_m + 1e9),
        ("times_s", TIMES_S[:2]),
        ("times_s", TIMES_S[:3]),
        ("times_s", TIMES_S[::-1]),
        ("times_s", late),
        ("times_s", 10.0 * TIMES_S),
        ("friction", np.nan),
    )
    for name, value in faults:
        report = check_trajectory(walks.changed(still, **{name: value}))
        assert not report.accepted
        assert_names(report.message, name)
        assert len(report.digest) == 64
        json.dumps(report.to_json(), allow_nan=False)


@settings(max_examples=60)
@given(
    name=st.sampled_from(["times_s", "torso_m", "rotation", "feet_m", "forces_n", "start"]),
    value=st.sampled_from([0.0, -1.0, 1e6, -1e6, 1e-300, np.inf, -np.inf, np.nan, 1e308]),
    share=st.floats(0.0, 1.0),
    seed=st.integers(0, 2**16),
)
def test_no_values_make_it_raise_or_accept(name, value, share, seed):
    still, known = standing(), vars(standing()) | vars(standing().problem)
    array = np.array(known[name])
    hit = np.random.default_rng(seed).random(array.shape) < share
    array[hit] = value
    report = check_trajectory(walks.changed(still, **{name: array}))
    assert report.accepted == bool(np.allclose(array, known[name], rtol=0.0, atol=1e-12))
    json.dumps(report.to_json(), allow_nan=False)


# ------------------------------------------------------------------------------------------------
# the report


def test_scales_follow_the_robot():
    """Forces are judged in units of m·g, so a robot of twice the mass with twice the forces is
    judged the same.
    """
    light, heavy = standing(), standing()
    heavy = replace(heavy.asked(robot=robot(mass_kg=60.0)), forces_n=2.0 * heavy.forces_n)
    limit = 1.0 + LIMITS["impulse_rate"] + LIMITS["impulse_s"] / 0.495
    for factor in (limit - 1e-3, limit + 1e-3):
        verdicts = [
            check_trajectory(replace(t, forces_n=factor * t.forces_n)).accepted
            for t in (light, heavy)
        ]
        assert verdicts == [factor < limit] * 2


def test_the_verifier_shares_no_code_with_planners_but_data_types() -> None:
    """What its two files import, and what that imports: arrays, errors, the robot, the terrain and
    the samples.

    A walker carries its URDF's model, which but one file of the verifier's looks at: that shares
    the robot's legs, and inverse kinematics that nothing is believed of until pinocchio has put the
    feet there. A robot of a file is read with what it touches with and with the hulls of its
    meshes, one by name by what reads robots, and a robot's legs are asked for where they are drawn
    up, or for their sets, which the verifier does not; the words of a verdict are those of every
    report. A motion knows the ground under it and why no runner executes it, of which no group asks; what
    is imported for its types alone runs nothing.
    """
    planners = Path(trajectories.__file__).parents[1]
    allowed = {
        "answer/motion.py",
        "answer/trajectory.py",
        "arguments.py",
        "errors.py",
        "files/arrays.py",
        "files/codec.py",
        "files/documents.py",
        "files/writing.py",
        "files/yaml_text.py",
        "physics.py",
        "robot/model.py",
        "terrain/obstacles.py",
        "terrain/patch.py",
        "terrain/polygon.py",
        "verify/trajectories.py",
        "verify/trajectory_measurements.py",
    }
    todo, seen = ["verify/trajectories.py"], set()
    carried = {
        "answer/certificate.py",
        "answer/report.py",
        "robot/contacts.py",
        "robot/hulls.py",
        "robot/leg.py",
        "robot/meshes.py",
        "robot/reach_sets.py",
        "robot/robot_file.py",
        "robot/robot_model.py",
        "robot/walker.py",
        "verify/bodies.py",
    }
    while todo:
        name = todo.pop()
        if name in seen or name in carried:
            continue
        seen.add(name)
        tree = ast.parse((planners / name).read_text(encoding="utf-8"))
        guards = (each for each in tree.body if ast.unparse(each).startswith("if TYPE_CHECKING"))
        typed = {node for guard in guards for node in ast.walk(guard)}
        for node in ast.walk(tree):
            assert not (
                name.startswith("verify/")
                and isinstance(node, ast.Attribute)
                and node.attr == "model"
            ), name
            assert not isinstance(node, ast.Import) or all(
                one.name != "casadi" for one in node.names
            ), name
            if isinstance(node, ast.ImportFrom) and node.level and node not in typed:
                folder = (
                    (planners / name)
                    .parents[node.level - 1]
                    .joinpath(*(node.module or "").split("."))
                )
                if folder.with_suffix(".py").exists():
                    todo.append(folder.with_suffix(".py").relative_to(planners).as_posix())
                else:
                    todo += [
                        f"{folder.relative_to(planners).as_posix()}/{one.name}.py"
                        for one in node.names
                    ]
    assert seen == allowed, sorted(seen ^ allowed)


def test_footing_is_reported_of_places_and_of_what_is_beside_them_and_refuses_nothing() -> None:
    """A plane needs its own slope; a cliff 10 mm beside a foot that stands on level ground counts,
    one 40 mm away does not, and feet that stick need no friction. The line says so, and what was
    accepted stays accepted.
    """
    walk = standing(0.3, 0.1)
    assert check_trajectory(walk).figures["footing_friction"] == pytest.approx(
        np.hypot(0.3, 0.1), abs=1e-6
    )
    foot = standing().feet_m[0, 0]
    needs = {}
    for away in (0.01, 0.04):
        x, y = np.linspace(-1.5, 1.5, 1501), np.linspace(-1.5, 1.5, 7)
        heights = np.repeat(np.clip(x - float(foot[0]) - away, 0.0, 0.02)[:, None], len(y), axis=1)
        beside = walks.changed(standing(), terrain=HeightField(x_m=x, y_m=y, heights_m=heights))
        report = check_trajectory(beside)
        needs[away] = report.figures["footing_friction"]
        assert report.accepted
        assert report.remark.startswith("no sure" if needs[away] > 0.75 else "sure")
    assert [needs[0.01], needs[0.04]] == pytest.approx([1.0, 0.0], abs=0.02)
    sticks = walk.asked(adhesive=np.ones(4, dtype=bool), suction_n=50.0)
    assert check_trajectory(sticks).figures["footing_friction"] == 0.0
