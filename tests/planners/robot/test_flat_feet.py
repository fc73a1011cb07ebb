"""Feet of robots on two legs: what their shapes are, how they stand, and plans that stand on them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit import Motion
from stancekit.planners.formats.table_file import read_table
from stancekit.planners.motion.path import PlanPath
from stancekit.planners.robot.kinematics import Kinematics
from stancekit.planners.robot.leg import FootContact, rotations_of
from stancekit.planners.robot.model import robot_of
from stancekit.planners.robot.reach_sets import limbs_over
from stancekit.planners.robot.robot_model import model_of
from stancekit.planners.robot.walker import contact_robot
from stancekit.planners.search.friction_margin import narrowed
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.motions import check_motion
from tests.planners.robot.small_urdfs import biped
from tests.refusals import refuses


@pytest.mark.parametrize("foot", ["box", "balls", "ankle"])
def test_flat_feet_are_soles_on_which_two_alike_legs_stand_level_with_bent_knees(foot: str) -> None:
    model = model_of(biped(foot))
    left, right = model.legs
    assert left.sole is not None
    np.testing.assert_allclose(left.sole.size_m, (0.16, 0.08), atol=1e-6)
    np.testing.assert_allclose(left.nominal_m, right.nominal_m * [1.0, -1.0, 1.0], atol=1e-6)
    assert 0.5 < left.stance_rad[3] < 0.8
    level = left.chain.frames(left.stance_rad[None])[0][0, -1] @ left.sole.rotation
    np.testing.assert_allclose(level, np.eye(3), atol=1e-4)
    assert any("0.160 × 0.080 m" in text for text in model.guesses)
    with refuses("robot biped", "soles"):
        limbs_over(model, "outer")


def test_a_ball_is_no_sole_a_wheel_is_no_foot_and_a_person_says_what_else() -> None:
    assert model_of(biped("ball")).legs[0].radius_m == 0.03
    with refuses("wheel"):
        model_of(biped("wheel")).check_known()
    said = FootContact(
        point_m=np.array([0.0, 0.0, -0.04]),
        sole_m=np.array([[0.05, 0.03], [-0.05, 0.03], [-0.05, -0.03], [0.05, -0.03]]),
    )
    sole = model_of(biped("ball"), contacts={"*foot": said}).legs[0].sole
    assert sole is not None
    assert sole.size_m == pytest.approx((0.1, 0.06))
    with refuses("radius_m"):
        replace(said, radius_m=0.01)


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> Motion:
    ground = tmp_path_factory.mktemp("flat") / "flat.obj"
    ground.write_text("v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nf 1 2 3 4\n")
    body = contact_robot(model_of(biped()))
    answer = stancekit.plan(ground, robot=body, start=(0.0, 0.0), goal=(0.2, 0.0))
    assert answer.status.value == "feasible"
    return answer.solution


def test_plans_stand_on_whole_soles_that_are_apart_and_level(walked: Motion) -> None:
    toes = walked.toes_m[walked.problem.holds]
    assert np.abs(toes[:, 0, 1] - toes[:, 1, 1]).min() >= 0.08
    tilted = np.array(walked.joints_rad)
    tilted[1, 5] += 1e-3
    report = check_plan(replace(walked, joints_rad=tilted), joints=True)
    assert report.group("joints").verdict == "violated"


def test_no_corner_of_a_sole_is_beyond_the_terrain_whatever_its_footholds_say(
    walked: Motion,
) -> None:
    ground, sides = walked.problem.terrain[0], walked.toes_m[:, 1]
    for more_m, held in ((0.07, True), (0.005, False)):
        beams = []
        for y in (sides[sides > 0.0], sides[sides < 0.0]):
            low, high = y.min() - more_m, y.max() + more_m
            corners = np.array([[-1, low, 0], [1, low, 0], [1, high, 0], [-1, high, 0]])
            beams.append(replace(ground, vertices_m=corners))
        report = check_plan(replace(walked, problem=replace(walked.problem, terrain=tuple(beams))))
        assert (report.accepted, report.group("terrain").verdict == "holds") == (held, held)


def test_motions_on_soles_are_judged_by_all_of_them_and_not_by_their_middles(
    walked: Motion, tmp_path: Path
) -> None:
    done = stancekit.export(walked, tmp_path / "walk.csv", rate_hz=50.0)
    table, robot = read_table(done.path), robot_of(model_of(biped()))
    ground, sides = walked.problem.terrain[0], walked.toes_m[:, 1]

    def strips(inward_m: float, outward_m: float) -> list[Patch]:
        """Ground under both feet alone, from so far inside of their middles to so far outside."""
        made = []
        for side in (1.0, -1.0):
            y = side * np.array([sides[side * sides > 0.0] * side]).mean()
            low, high = sorted([y - side * inward_m, y + side * outward_m])
            corners = np.array([[-1, low, 0], [1, low, 0], [1, high, 0], [-1, high, 0]])
            made.append(replace(ground, vertices_m=corners))
        return made

    def failed(**columns: np.ndarray) -> set[str]:
        of = table.with_columns(**columns)
        return {g.name for g in check_motion(of, robot, [ground]).groups if g.verdict == "violated"}

    report = check_motion(table, robot, [ground])
    assert report.accepted
    assert all(report.group(name).verdict == "holds" for name in ("contact_gap", "balance", "slip"))
    assert report.group("effort").verdict == "not checked"  # where they press is not said
    for inward_m, outward_m, held in ((0.045, 0.05, True), (-0.02, 0.1, False)):
        said = check_motion(table, robot, strips(inward_m, outward_m)).group("balance")
        assert (said.verdict == "holds") == held
    first = {name: np.array(each[:1] + 0 * each) for name, each in table.columns.items()}
    first["time_s"] = table.time_s
    turned = np.linspace(0.0, 0.2, len(first["contact"]))  # about a foot's middle, both feet down
    about = table.columns["feet_m"][:1, 0]
    spun = rotations_of(np.outer(turned, [0.0, 0.0, 1.0]))
    first["origin_m"] = about + np.einsum("tij,tj->ti", spun, first["origin_m"] - about)
    first["quaternion"] = np.outer(np.cos(turned / 2), [1, 0, 0, 0.0])
    first["quaternion"][:, 3] = np.sin(turned / 2)
    assert "slip" in failed(**first)
    assert failed(contact=table.columns["contact"] | True) == {"contact_gap"}
    angles = np.array(table.columns["angles_rad"])
    angles[:, 5] += 0.15
    assert "penetration" in failed(angles_rad=angles)


def test_ankles_bear_the_moments_of_forces_at_the_corners_of_soles(walked: Motion) -> None:
    solver, course = Kinematics(walked.problem.robot), walked.problem
    stance = next(i for i, of in enumerate(course.stances) if len(of.limbs) == 1)
    (limb,), frame = course.stances[stance].limbs, course.stances[stance].frame
    moved = np.zeros_like(walked.point_forces_n)
    moved[:, :, 0] = walked.forces_n  # all of it at one corner
    plan = replace(walked, point_forces_n=moved)
    torques = solver.torques(
        plan.joints_rad[frame], np.eye(3), plan.forces_n[stance], plan.moments_nm[stance]
    )
    ankle = torques[solver.joints_of(limb)[-2:]]
    arm = plan.points_m[course.holds[frame, limb], 0] - plan.toes_m[course.holds[frame, limb]]
    np.testing.assert_allclose(
        np.abs(ankle), float(plan.forces_n[stance, limb, 2]) * np.abs(arm[:2])[[0, 1]], rtol=0.15
    )


STEP = (
    "v -2 -2 0\nv 0.2 -2 0\nv 0.2 2 0\nv -2 2 0\nv 0.2 -2 0.08\nv 2 -2 0.08\nv 2 2 0.08\n"
    "v 0.2 2 0.08\nf 1 2 3 4\nf 2 5 8 3\nf 5 6 7 8\n"
)


def test_torques_of_soles_are_judged_between_key_frames_too(walked: Motion) -> None:
    most = check_plan(walked, joints=True).group("torque").figures["torque_nm"]
    for more, verdict in ((0.02, "violated"), (1.0, "holds")):
        limited = {**walked.provenance, "torque_nm": most + more}
        plan = replace(walked, provenance=limited)
        assert check_plan(plan, joints=True).group("torque").verdict == verdict


def test_toes_hang_down_in_the_air_where_ankles_have_no_room_and_stay_off_the_step(
    tmp_path: Path,
) -> None:
    (tmp_path / "step.obj").write_text(STEP)
    body = contact_robot(model_of(biped(heel=0.75)))
    answer = stancekit.plan(tmp_path / "step.obj", robot=body, start=(0.0, 0.0), goal=(0.5, 0.0))
    assert answer.status.value == "feasible"
    moments = PlanPath(answer.solution).moments()
    air = moments.foothold < 0
    assert 0.1 < moments.ups[air][:, 0].max() < 0.6
    np.testing.assert_allclose(moments.ups[~air], [[0.0, 0.0, 1.0]] * (~air).sum(), atol=1e-9)
    sole = body.own_model().legs[0].sole
    ups = moments.ups[air] / np.linalg.norm(moments.ups[air], axis=1)[:, None]
    ahead = np.cross([0.0, 1.0, 0.0], ups)
    corners = moments.feet_m[air][:, None] + np.einsum("k,ti->tki", sole.points_m[:, 0], ahead)
    assert (corners[..., 2] - np.where(corners[..., 0] > 0.2, 0.08, 0.0)).min() > -1e-6


def test_soles_are_narrowed_to_where_ankles_hold_the_weight(walked: Motion) -> None:
    course = walked.problem
    assert narrowed(course, 0.5).robot.limbs[0].sole_m == pytest.approx(
        0.5 * course.robot.limbs[0].sole_m
    )
    weak = contact_robot(model_of(biped(heel_nm=2.0)))
    weight_n = weak.mass_kg * course.gravity_m_s2
    sole = narrowed(replace(course, robot=weak), 0.5).robot.limbs[0].sole_m
    np.testing.assert_allclose(weight_n * np.abs(sole[:, 0]).max(), 0.85 * 2.0, rtol=0.02)
