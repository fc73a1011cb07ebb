"""External wrenches: closed forms, proofs that nobody can carry one, and what a stance holds of it
at most.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit import Motion
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem import Contact, Problem
from stancekit.planners.problem.contact import at_point
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.terrain import Patch
from stancekit.planners.verify import check_certificate, check_plan, explain
from stancekit.planners.verify.certificate import Forest
from stancekit.planners.verify.wrench_held import least_held
from tests.refusals import assert_names

HALF_M, EDGE_M, HEIGHT_M, MASS_KG = 0.2, 0.05, 0.3, 10.0
WEIGHT_N = 9.81 * MASS_KG
CORNERS = {"LF": (1, 1), "LR": (-1, 1), "RR": (-1, -1), "RF": (1, -1)}


def table(friction: float = 5.0, legs: Sequence[str] = tuple(CORNERS)) -> Problem:
    """Feet on small squares at the corners of a square on level ground, the body fixed above its
    middle.
    """
    contacts = []
    for leg in legs:
        x, y = CORNERS[leg]
        middle = np.array([HALF_M * x, HALF_M * y, 0.0])
        square = middle + EDGE_M * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
        contacts.append(
            Contact(
                leg=leg,
                shoulder_m=[HALF_M * x, HALF_M * y, 0.0],
                reach_m=0.6,
                patch=Patch(
                    vertices_m=square,
                    normal=[0, 0, 1],
                    shear_reference=[1, 0, 0],
                    friction=friction,
                ),
                force_min=[0, -1, -1],
                force_max=[1, 1, 1],
            )
        )
    return Problem.posture(
        contacts, mass_kg=MASS_KG, com_nominal_m=[0, 0, HEIGHT_M], com_radius_m=0.0
    )


def standing(problem: Problem, forces_n: Array) -> Motion:
    """The feet in the middle of their squares."""
    toes = np.array([[HALF_M * x, HALF_M * y, 0.0] for x, y in CORNERS.values()])
    com = np.array([0, 0, HEIGHT_M])
    return Motion.of_posture(
        problem, com_m=com, rotation_rad=np.zeros(3), toes_m=toes, forces_n=forces_n
    )


PAYLOAD = at_point((0, 0, -0.2 * WEIGHT_N), (0, 0, 0), (0.1, -0.08, 0.07))


def test_the_forces_of_a_table_with_a_payload_are_those_of_statics() -> None:
    """Bilinear shares of the weight, and those of the load, by where each is over the square."""
    u, v = 0.5 + 0.1 / (2.0 * HALF_M), 0.5 - 0.08 / (2.0 * HALF_M)
    shares = np.array([u * v, (1 - u) * v, (1 - u) * (1 - v), u * (1 - v)])
    forces = np.zeros((4, 3))
    forces[:, 2] = 0.25 * WEIGHT_N + 0.2 * WEIGHT_N * shares
    problem = table().posture_with(wrench=PAYLOAD)
    assert check_plan(standing(problem, forces)).accepted
    for wrong in (
        None,
        1.001 * PAYLOAD,
        at_point(PAYLOAD[:3], (0, 0, 0), (0.1, 0.08, 0.07)),
        -PAYLOAD,
    ):
        report = check_plan(standing(problem.posture_with(wrench=wrong), forces))
        assert not report.accepted
        assert report.worst > 1e-5


def test_three_feet_on_ice_carry_what_statics_says() -> None:
    problem = table(friction=0.0, legs=("LF", "LR", "RR")).posture_with(
        com_nominal_m=[-0.05, 0.05, HEIGHT_M],
        wrench=at_point((0, 0, -20.0), (0, 0, 0), (-0.03, 0.01, 0.3)),
    )
    for method in ("exact", "two-stage", "nlp"):
        posture = stancekit.solve(problem, method).solution
        assert posture is not None
        toes, com = posture.toes_m, posture.com_m[0]
        arms = np.vstack([np.ones(3), toes[:, :2].T])
        load = com[:2] + np.array([-0.03, 0.01])
        vertical = np.linalg.solve(
            arms, WEIGHT_N * np.array([1.0, *com[:2]]) + 20.0 * np.array([1.0, *load])
        )
        np.testing.assert_allclose(posture.forces_n[0, :, 2], vertical, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "friction", "wrench", "most"),
    [
        ("tips", 5.0, [1, 0, 0, 0, 0, 0], WEIGHT_N * (HALF_M + EDGE_M) / HEIGHT_M),  # F h = w d
        ("tips sideways", 5.0, [0, -1, 0, 0, 0, 0], WEIGHT_N * (HALF_M + EDGE_M) / HEIGHT_M),
        ("slides", 0.1, [0, 1, 0, 0, 0, 0], 0.1 * WEIGHT_N),
        (
            "is crushed",
            0.5,
            [0, 0, -1, 0, 0, 0],
            3.0 * WEIGHT_N,
        ),  # each foot bears the weight at most
        ("lifts off", 0.5, [0, 0, 1, 0, 0, 0], WEIGHT_N),
        ("is turned over", 5.0, [0, 0, 0, 1, 0, 0], WEIGHT_N * (HALF_M + EDGE_M)),
        (
            "is turned about",
            0.1,
            [0, 0, 0, 0, 0, 1],
            0.1 * WEIGHT_N * np.sqrt(2.0) * (HALF_M + EDGE_M),
        ),
    ],
)
def test_a_table_holds_what_statics_says(
    name: str, friction: float, wrench: list[float], most: float
) -> None:
    problem, direction = table(friction), np.array(wrench)
    below = stancekit.solve(problem.posture_with(wrench=0.995 * most * direction))
    assert below.solution is not None, name
    for share in (1.005, 2.0):
        answer = stancekit.solve(problem.posture_with(wrench=share * most * direction))
        assert answer.certificate is not None, name
        assert check_certificate(answer.certificate).accepted
        assert stancekit.verify(answer.certificate).accepted
        held = replace(
            answer.certificate, problem=problem.posture_with(wrench=0.999 * most * direction)
        )
        assert not check_certificate(
            held, tolerance=0.0
        ).accepted  # whatever the multipliers: there is a posture
        why = explain(answer.certificate)
        unit = "N" if direction[:3].any() else "Nm"
        assert_names(why.message, "infeasible", unit, "LF", "LR", "RR", "RF")
        first = why.relaxations[0]
        assert (first.unit, first.now) == (unit, pytest.approx(share * most))
        assert first.needed == pytest.approx(most, rel=2e-3)
        assert first.needed >= most * (1.0 - 1e-6)  # it is never said to hold less than it does


def test_a_certificate_is_one_of_its_own_wrench_alone() -> None:
    """What proves that a wrench is too much proves nothing of half of it, of none, or of another
    direction.
    """
    problem = table(friction=0.1).posture_with(wrench=[0, 0.15 * WEIGHT_N, 0, 0, 0, 0])
    certificate = stancekit.solve(problem).certificate
    assert certificate is not None
    assert check_certificate(certificate).accepted
    for other in (
        None,
        [0, 0.09 * WEIGHT_N, 0, 0, 0, 0],
        [0, -0.15 * WEIGHT_N, 0, 0, 0, 0],
        PAYLOAD,
    ):
        forged = replace(certificate, problem=problem.posture_with(wrench=other))
        assert not check_certificate(forged).accepted
        assert not explain(forged).relaxations
    turned = replace(certificate, multipliers=-certificate.multipliers)
    assert not check_certificate(turned).accepted
    more = replace(
        certificate, problem=problem.posture_with(wrench=[0, 0.3 * WEIGHT_N, 0, 0, 0, 0])
    )
    assert check_certificate(more).accepted  # the same proof is one of more of it


def test_a_proof_survives_its_file(tmp_path: Path) -> None:
    problem = table(friction=0.1).posture_with(wrench=[0, 0.15 * WEIGHT_N, 0, 0, 0, 0])
    answer = stancekit.solve(problem)
    stancekit.save(answer.certificate, tmp_path / "proof.json")
    read = stancekit.load(tmp_path / "proof.json")
    assert stancekit.verify(read).accepted
    assert explain(read).message == explain(answer.certificate).message
    np.testing.assert_array_equal(read.refuted.wrench, problem.wrench)


def test_mirrored_wrenches_are_held_alike() -> None:
    held = []
    for sign in (1.0, -1.0):
        problem = table(friction=0.3).posture_with(wrench=[0, sign * 60.0, 0, sign * 4.0, 0, 0])
        forest = Forest.of_postures((problem,))
        found = least_held(forest.numbers, forest.patches)
        assert found is not None
        held.append(found[1])
    assert held[0] == pytest.approx(held[1], abs=1e-3)


def test_what_is_not_the_wrenchs_fault_is_not_said_of_it() -> None:
    short = table().posture_with(wrench=[0, 1.0, 0, 0, 0, 0], com_nominal_m=[0, 0, 0.9])
    answer = stancekit.solve(short)
    assert answer.certificate is not None
    assert "holds" not in explain(answer.certificate).message


@pytest.fixture
def pulled(walk: Callable[..., Motion]) -> Motion:
    """A walk whose forces carry a rope that pulls harder frame by frame, on vertical loads
    alone.
    """
    plan = walk()
    course = plan.problem
    wrench = np.zeros((course.frames, 6))
    wrench[:, 2] = -np.array([0.0, 5.0, 20.0, 10.0, 0.0])
    forces = np.array(plan.forces_n)
    for row, stance in enumerate(course.stances):
        limbs, frame = list(stance.limbs), stance.frame
        under = plan.toes_m[course.holds[frame, limbs]]
        balance = np.vstack([np.ones(len(limbs)), under[:, :2].T])
        load = course.weight_n - wrench[frame, 2]
        forces[row, limbs, 2] = load * np.linalg.pinv(balance) @ [1.0, *plan.com_m[frame, :2]]
    return replace(plan, problem=replace(course, wrench=wrench), forces_n=forces)


def test_a_plan_carries_a_wrench_that_changes_from_frame_to_frame(pulled: Motion) -> None:
    report = check_plan(pulled)
    assert report.accepted, report.message
    assert report.figures["between"] < 1e-9
    for frame in range(pulled.problem.frames):
        wrench = np.array(pulled.problem.wrench)
        wrench[frame, 2] -= 0.01
        refused = check_plan(replace(pulled, problem=replace(pulled.problem, wrench=wrench)))
        assert not refused.accepted
        assert refused.group("force_balance").when == frame
    assert not check_plan(replace(pulled, problem=replace(pulled.problem, wrench=None))).accepted


def test_between_frames_the_moment_about_the_origin_goes_over_linearly() -> None:
    """An oblique rope whose force and arm change: forces that go over linearly carry it all the
    way.
    """
    course = read_course("stairs", 4)
    unit = course.weight_n * np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    wrench = np.random.default_rng(0).uniform(-0.1, 0.1, (course.frames, 6)) * unit
    answer = stancekit.plan(replace(course, wrench=wrench))
    plan, report = answer.solution, answer.report
    assert plan is not None
    assert report is not None
    assert report.accepted
    assert 0.0 < report.figures["between"] < 1e-6
    rows = {(s.frame, s.limbs): row for row, s in enumerate(course.stances)}
    lifted = [{course.legs.index(name) for name in names} for names in course.lifts]
    ways = [
        (k, limbs) for k, limbs in rows if (k + 1, limbs) in rows and not lifted[k + 1] & set(limbs)
    ]
    assert len(ways) == course.frames - 1
    about_origin = wrench[:, 3:] + np.cross(plan.com_m, wrench[:, :3])
    for k, limbs in ways:
        toes = plan.toes_m[course.holds[k, list(limbs)]]
        for t in (0.3, 0.5, 0.9):
            before, after = (plan.forces_n[rows[at, limbs]][list(limbs)] for at in (k, k + 1))
            forces, com = (
                (1 - t) * before + t * after,
                (1 - t) * plan.com_m[k] + t * plan.com_m[k + 1],
            )
            force = (1 - t) * wrench[k, :3] + t * wrench[k + 1, :3] - [0, 0, course.weight_n]
            moment = (
                (1 - t) * about_origin[k]
                + t * about_origin[k + 1]
                - np.cross(com, [0, 0, course.weight_n])
            )
            np.testing.assert_allclose(forces.sum(axis=0) + force, 0.0, atol=1e-4)
            np.testing.assert_allclose(np.cross(toes, forces).sum(axis=0) + moment, 0.0, atol=1e-4)


def test_a_course_that_nobody_can_climb_with_a_wrench_says_who_cannot_hold_it() -> None:
    answer = stancekit.plan(
        "stairs", frames=4, settings=stancekit.PlanSettings(wrench=(90.0, 0.0, 0.0))
    )
    assert answer.status.value == "infeasible"
    assert answer.certificate is not None
    assert stancekit.verify(answer.certificate).accepted
    message = explain(answer.certificate).message
    assert_names(message, "infeasible", "68.7 N", "90 N")  # .7 of the weight
    assert message.rpartition(" at frame ")[2] in ("0", "1", "2", "3")
    weaker = replace(
        answer.certificate, problem=replace(answer.problem, wrench=0.5 * answer.problem.wrench)
    )
    assert not check_certificate(weaker).accepted
