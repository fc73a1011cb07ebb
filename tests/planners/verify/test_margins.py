"""Margins of stances: closed forms, another program, and plans that are to bear a push."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit import Motion
from stancekit.planners.answer.plan import MARGIN
from stancekit.planners.files.arrays import Array
from stancekit.planners.problem.contact import Contact
from stancekit.planners.problem.problem import Problem
from stancekit.planners.terrain.patch import Patch
from stancekit.planners.verify import check_plan, margins
from stancekit.planners.verify.margins import (
    YIELDS,
    borne_share,
    margin_group,
    pushes,
    stance_margins,
    stances_of,
    support_region,
)
from tests.refusals import assert_names, refuses

HALF_M, HEIGHT_M, MASS_KG = 0.2, 0.3, 10.0
WEIGHT_N = 9.81 * MASS_KG


TOES_M = np.array([[HALF_M * x, HALF_M * y, 0.0] for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))])


def four_feet(com_m: Array, friction: float, patch_m: float = 0.05) -> Problem:
    """A posture on four square patches of level ground at the corners of a square."""
    contacts = []
    for toe in TOES_M:
        corners = toe + patch_m * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
        patch = Patch(
            vertices_m=corners, normal=[0, 0, 1], shear_reference=[1, 0, 0], friction=friction
        )
        contacts.append(
            Contact(
                leg=f"leg{len(contacts)}",
                shoulder_m=toe,
                reach_m=0.6,
                patch=patch,
                force_min=[0, -1, -1],
                force_max=[1, 1, 1],
            )
        )
    return Problem.posture(contacts, mass_kg=MASS_KG, com_nominal_m=com_m, com_radius_m=0.1)


def table(com_m: tuple[float, float], friction: float) -> Motion:
    """Four feet at the corners of a square on level ground, the centre of mass above it."""
    com = np.array([*com_m, HEIGHT_M])
    u, v = 0.5 + np.array(com_m) / (2.0 * HALF_M)  # bilinear shares of the weight
    shares = np.array([u * v, (1 - u) * v, (1 - u) * (1 - v), u * (1 - v)])
    forces = np.zeros((1, 4, 3))
    forces[0, :, 2] = shares * WEIGHT_N
    return Motion(
        problem=four_feet(com, friction).course(),
        com_m=com[None],
        rotation_rad=np.zeros((1, 3)),
        toes_m=TOES_M,
        choice=np.zeros(4, dtype=int),
        forces_n=forces,
        provenance={},
    )


def only(plan: Motion, yields_m: float = 0.0) -> dict[str, float]:
    """The margins of a plan's one stance."""
    return {
        name: float(value) for name, (value,) in stance_margins(plan, yields_m=yields_m).items()
    }


@pytest.mark.parametrize("com_m", [(0.0, 0.0), (0.05, 0.0), (0.03, -0.12)])
def test_a_table_tips_about_its_nearest_side(com_m: tuple[float, float]) -> None:
    margin = only(table(com_m, friction=5.0))
    inside = HALF_M - max(abs(x) for x in com_m)
    assert margin["support_m"] == pytest.approx(inside, rel=0.02)
    assert margin["support_m"] <= inside + 1e-6
    assert margin["push_n"] == pytest.approx(WEIGHT_N * inside / HEIGHT_M, rel=0.02)  # F h = w d
    assert margin["push_n"] <= WEIGHT_N * inside / HEIGHT_M + 1e-4


def test_the_verdict_is_on_a_body_that_gives_way_and_a_push_that_is_asked_for_is_balanced() -> None:
    plan = table((0.0, 0.0), friction=5.0)
    yields_m = 0.12 * np.mean([limb.reach_m for limb in plan.problem.robot.limbs])
    group = margin_group(plan)
    assert group.figures["push_n"] == pytest.approx(
        WEIGHT_N * HALF_M / (HEIGHT_M + yields_m), rel=0.02
    )
    balanced_n = WEIGHT_N * HALF_M / HEIGHT_M
    for share, verdict in ((0.95, "holds"), (1.05, "violated")):
        asked = replace(plan, problem=replace(plan.problem, push_n=share * balanced_n))
        assert margin_group(asked).verdict == verdict


def test_a_table_on_ice_slides_before_it_tips() -> None:
    margin = only(table((0.0, 0.0), friction=0.1))
    assert margin["push_n"] == pytest.approx(0.1 * WEIGHT_N, rel=0.02)
    assert margin["support_m"] == pytest.approx(HALF_M, rel=0.02)
    assert margin["friction_left"] > 0.9  # nothing pushes


def test_a_centre_beyond_the_feet_has_no_margin() -> None:
    margin = only(table((0.21, 0.0), friction=1.0))
    assert (margin["push_n"], margin["support_m"]) == (0.0, 0.0)


def test_the_region_of_a_table_is_the_square_of_its_feet() -> None:
    plan = table((0.02, 0.01), friction=1.0)
    corners = support_region(plan, plan.problem.stances[0])
    assert np.abs(corners).max() <= HALF_M + 1e-6
    for corner in HALF_M * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]):
        assert np.linalg.norm(corners - corner, axis=1).min() < 1e-5


@pytest.fixture(scope="module")
def climb() -> Motion:
    found = stancekit.plan("stairs", stancekit.TwoStage(reserve=False), frames=5).solution
    assert found is not None
    return found


@pytest.mark.parametrize("scatter", [0.0, 0.1, 2.0])
def test_what_forces_near_the_plans_show_is_never_more_than_there_is(
    climb: Motion, scatter: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Borne pushes are those of every stance looked at, also of forces that are none."""
    rng = np.random.default_rng(int(100 * scatter))
    noise = scatter * climb.problem.weight_n * rng.standard_normal(climb.forces_n.shape)
    plan = replace(climb, forces_n=np.where(climb.forces_n == 0.0, 0.0, climb.forces_n + noise))
    at = stances_of(plan)
    shifts = pushes(at.borne, 0.05)
    sure = margins._sure_distances(plan, at, shifts)
    assert (sure <= at.margins(shifts).lower).all()
    assert (sure > 0.02).any() or scatter > 1.0
    found = borne_share(plan, (0.14, 0.06, 0.03)), borne_share(plan, (0.01,), 0.05)
    monkeypatch.setattr(margins, "_sure_distances", lambda *_: np.zeros(len(sure)))
    assert found == (borne_share(plan, (0.14, 0.06, 0.03)), borne_share(plan, (0.01,), 0.05))


def test_a_plan_bears_the_push_that_is_asked_for() -> None:
    plain = stancekit.plan("stairs", frames=6, settings=stancekit.PlanSettings(margins=True))
    assert plain.report is not None
    wanted_n = 1.5 * plain.report.group(MARGIN).figures["push_n"]
    found = stancekit.plan("stairs", frames=6, settings=stancekit.PlanSettings(push_n=wanted_n))
    assert found.status is stancekit.Status.FEASIBLE
    assert found.solution is not None
    assert found.solution.problem.push_n == wanted_n
    assert stance_margins(found.solution)["push_n"].min() >= wanted_n
    assert plain.solution is not None
    asked = replace(plain.solution, problem=replace(plain.solution.problem, push_n=wanted_n))
    report = check_plan(asked)
    assert not report.accepted
    assert report.contacts
    assert [group.name for group in report.refused] == [MARGIN]
    assert_names(report.group(MARGIN).message, f"{wanted_n:.3g} N")


def test_a_push_that_no_stance_bears_is_undecided_and_one_beyond_all_feet_is_refused() -> None:
    found = stancekit.plan("stairs", frames=4, settings=stancekit.PlanSettings(push_n=90.0))
    assert found.status is stancekit.Status.UNDECIDED
    assert found.certificate is None
    with refuses("push_n"):
        stancekit.plan("stairs", frames=4, settings=stancekit.PlanSettings(push_n=5000.0))
    with refuses("two-stage"):
        stancekit.plan("stairs", "nlp", frames=2, settings=stancekit.PlanSettings(push_n=5.0))


def test_verify_measures_the_margins_of_a_posture_and_none_of_a_refused_one() -> None:
    """Toes on patches of 1 mm: w d = F (h + y) about the nearest side, d and h of the posture."""
    problem = four_feet(np.array([0.06, 0.0, HEIGHT_M]), friction=5.0, patch_m=0.0005)
    posture = stancekit.solve(problem).solution
    report = stancekit.verify(posture, margins=True)
    (com,), figures = posture.com_m, report.group(MARGIN).figures
    inside = HALF_M - np.abs(com[:2]).max()
    assert figures["support_m"] == pytest.approx(inside, rel=0.02, abs=0.001)
    height = com[2] + YIELDS * 0.6
    assert figures["push_n"] == pytest.approx(WEIGHT_N * inside / height, rel=0.03)
    assert report.remark.startswith(f"it bears a push of {figures['push_n']:.3g} N")
    assert report.worst < 1e-6  # of contacts
    assert report.group("margin").to_json()["figures"]["push_n"] == figures["push_n"]

    away = replace(posture, com_m=posture.com_m + np.array([0.0, 0.0, 0.9]))
    refused = stancekit.verify(away, margins=True)
    assert (refused.accepted, refused.remark) == (False, "")
