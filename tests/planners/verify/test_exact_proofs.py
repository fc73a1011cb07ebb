"""Proofs in exact arithmetic: what is true is decided, a fault of any size is refused."""

from __future__ import annotations

from dataclasses import replace
from math import nextafter

import numpy as np
import pytest

import stancekit as library
from stancekit.planners.leap.finder import LeapFinder, find_leap
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.leap_classes import leap_class
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify.exact import check_exact
from stancekit.planners.verify.lagrangian import multiplier_shapes
from stancekit.planners.verify.stances import Schedule

LEAF = [0.0] * 5


def slippery(**steps):
    course = read_course("walls", frames=2)
    footholds = tuple(
        replace(put, candidates=(replace(put.candidates[0], friction=0.3),) * 2)
        for put in course.footholds
    )
    return replace(course, footholds=footholds, steps=replace(course.steps, **steps))


@pytest.fixture(scope="module")
def proofs():
    """Certificates of a posture, of courses that slip and that cannot turn so far, and of a leap with
    two leaves.
    """
    posture, course = library.sample("wall-3", rng=8)[0], slippery(yaw_rad=0.1)
    steps = replace(course.steps, least_rotation_rad=0.156, rotation_rad=0.2)
    turned = replace(read_course("walls", frames=2), tilt_limit_rad=0.03, steps=steps)
    leap = leap_class("leap-few").draw(np.random.default_rng(4))
    answers = (
        library.solve(posture),
        TwoStage().solve(course),
        TwoStage().solve(turned),
        find_leap(leap, LeapFinder(solves=4)),
    )
    problems = (posture, course, turned, leap)
    return [a.certificate.of(one) for a, one in zip(answers, problems, strict=True)]


def replayed(certificate, tree=None, rows=None, question=None):
    tree = certificate.tree.tolist() if tree is None else tree
    rows = certificate.multipliers.tolist() if rows is None else rows
    return check_exact(question or certificate.question, tree, rows)


def test_true_proofs_are_decided_and_a_missing_leaf_or_multiplier_refuses_them(proofs):
    for proof in proofs:
        held, kinds, _ = replayed(proof)
        assert held
        assert len(kinds) == len(proof.multipliers)
        for tree, rows in (
            (None, proof.multipliers[:-1].tolist()),
            (None, proof.multipliers[:, :-1].tolist()),
            (None, np.pad(proof.multipliers, ((0, 0), (0, 1))).tolist()),
            (proof.tree[:-1].tolist(), None),
            ([*proof.tree.tolist(), LEAF], None),
        ):
            assert not replayed(proof, tree, rows)[0]


@pytest.mark.parametrize(
    "node", [(1, 3, 1, 0, 0), (2, 0, 1, 0.25, 2), (2, 2, 0, 1.5, 3.75), (3, 1, 1, 0.25, 0)]
)
def test_parts_cover_the_whole_though_corners_are_rounded(proofs, node):
    question, rng = proofs[1].question, np.random.default_rng(0)
    for put in question["placements"]:
        for patch in put["candidates"]:  # in no plane
            corners = np.array(patch["vertices_m"])
            patch["vertices_m"] = (corners + 1e-9 * rng.normal(size=corners.shape)).tolist()
    again = [] if node[0] == 1 else [node]  # the first part once more
    tree = [node, *again, *[LEAF] * (2 + len(again))]
    row = proofs[1].multipliers[0].tolist()
    assert replayed(proofs[1], tree, [row] * (2 + len(again)), question)[0]
    assert not replayed(proofs[1], tree[:-1], [row] * (1 + len(again)), question)[0]


def barely(reach_m):
    """A posture of one leg, straight down, whose foot is .25 m below its shoulder: a proof by one
    multiplier that its reach is less.
    """
    corners = [[0.0, 0.0, -0.25], [0.5, 0.0, -0.25], [0.0, 0.5, -0.25]]
    numbers = dict.fromkeys(("com_radius_m", "tilt_limit_rad"), 0.0)
    scales = dict.fromkeys(("mass_kg", "gravity_m_s2", "force_scale_n", "length_scale_m"), 1.0)
    frame = {"normal": [0.0, 0.0, 1.0], "shear_reference": [1.0, 0.0, 0.0], "friction": 0.5}
    forces = {"force_min": [0.0, -1.0, -1.0], "force_max": [1.0, 1.0, 1.0]}
    reach = {"shoulder_m": [0.0, 0.0, 0.0], "reach_m": reach_m, "vertices_m": corners}
    contact = {"leg": "LF", **reach, **frame, **forces}
    return {**numbers, **scales, "com_nominal_m": [0.0, 0.0, 0.0], "contacts": [contact]}


def test_the_last_bit_of_a_bound_decides():
    rows = [[0.0] * 6 + [0.0, 0.0, -1.0]]
    for reach_m, held in ((nextafter(0.25, 0.0), True), (0.25, False), (nextafter(0.25, 1), False)):
        came, kinds, message = check_exact(barely(reach_m), [LEAF], rows)
        assert (came, kinds) == (held, ["rational"] * held)
        assert held or "leaf 0" in message
    barely_wrong = [[0.0] * 6 + [0.0, 0.0, -1.0 + 1e-9]]
    assert check_exact(barely(nextafter(0.25, 0.0)), [LEAF], barely_wrong)[0]  # any length will do
    aside = [[0.0] * 6 + [-1e-9, 0.0, -1.0]]
    assert not check_exact(barely(nextafter(0.25, 0.0)), [LEAF], aside)[0]


def test_multipliers_have_to_lie_in_their_cones(proofs):
    shapes = multiplier_shapes(Schedule.of_course(proofs[1].problem))
    rows = proofs[1].multipliers.copy()
    rows[0, -shapes["linear_step"][1]] = -1e-9
    held, _, message = replayed(proofs[1], rows=rows.tolist())
    assert not held
    assert "leaf 0" in message
