"""Numbers of a problem: units on and off again, and the parts that searches make of a problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stancekit.planners.equilibrium.scaled import Point, Scaled, skew
from stancekit.planners.search.answer import plan_of

SEEDS = st.integers(0, 2**32 - 1)


def same(one, other):
    """Number for number."""
    assert one.layout == other.layout
    for name in (
        "vertices",
        "frames",
        "friction",
        "shoulders",
        "reach",
        "force_min",
        "force_max",
        "com",
        "progress",
    ):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def without(course, opened):
    """The course with these candidates alone."""
    footholds = tuple(
        replace(
            put,
            candidates=tuple(
                patch for patch, on in zip(put.candidates, row, strict=False) if on > 0.0
            ),
        )
        for put, row in zip(course.footholds, opened, strict=True)
    )
    return replace(course, footholds=footholds)


@given(SEEDS)
@settings(max_examples=40)
def test_a_part_of_the_candidates_is_the_problem_made_without_the_others(rough, seed):
    rng = np.random.default_rng(seed)
    course = rough(int(rng.integers(8)), frames=int(rng.integers(1, 4)), regions=3)
    scaled = Scaled.of(course)
    opened = scaled.opened() * (rng.random(scaled.opened().shape) < 0.6)
    for p in np.flatnonzero(opened.sum(axis=1) == 0.0):
        opened[p, rng.choice(np.flatnonzero(scaled.opened()[p]))] = 1.0
    part = scaled.only(opened)
    same(part, Scaled.of(without(course, opened)))
    np.testing.assert_array_equal(part.opened(), opened)
    assert part.which == tuple(tuple(int(r) for r in np.flatnonzero(row)) for row in opened)
    fewer = opened * np.eye(scaled.options)[opened.argmax(axis=1)]
    same(part.only(fewer), scaled.only(fewer))  # parts of parts
    same(scaled.chosen(opened.argmax(axis=1)), scaled.only(fewer))
    same(part.chosen(opened.argmax(axis=1)), Scaled.of(course.with_choice(opened.argmax(axis=1))))


def test_all_of_them_are_the_problem_itself(rough):
    scaled = Scaled.of(rough(0, regions=3))
    assert scaled.only(scaled.opened()) is scaled
    assert scaled.only(np.ones_like(scaled.opened())) is scaled


def test_values_of_candidates_stand_where_their_numbers_say_in_parts_too(rough):
    course = rough(0, regions=3)
    scaled = Scaled.of(course)
    friction = scaled.by_candidate(scaled.friction, -1.0)
    for p, put in enumerate(course.footholds):
        for r in range(scaled.options):
            assert friction[p, r] == (
                put.candidates[r].friction if r < len(put.candidates) else -1.0
            )
    last = np.array([len(put.candidates) - 1 for put in course.footholds])
    assert last.max() == 2
    part = scaled.chosen(last)
    table = part.by_candidate(part.friction, -1.0)
    for p, put in enumerate(course.footholds):
        assert table[p, last[p]] == put.candidates[last[p]].friction
        assert (np.delete(table[p], last[p]) == -1.0).all()


def test_a_piece_takes_the_place_of_its_candidate_and_of_no_other(rough):
    scaled = Scaled.of(rough(3, regions=3))
    for candidate in range(1, len(scaled.pieces)):
        border = scaled.pieces[candidate][:3] * 0.5
        part = scaled.with_piece(candidate, border)
        for k, (mine, theirs) in enumerate(zip(part.pieces, scaled.pieces, strict=True)):
            np.testing.assert_array_equal(mine, border if k == candidate else theirs)
        assert part.which == scaled.which
        np.testing.assert_array_equal(part.friction, scaled.friction)
    kept = scaled.with_piece(1, 0.5 * scaled.pieces[1])
    assert kept.layout is scaled.layout  # the program of the layout is the same


def test_force_boxes_are_those_that_are_given_and_nothing_else_changes(rough):
    scaled = Scaled.of(rough(1, regions=2))
    low, high = scaled.force_min + 0.1, scaled.force_max - 0.1
    part = scaled.with_force_box(low, high)
    np.testing.assert_array_equal(part.force_min, low)
    np.testing.assert_array_equal(part.force_max, high)
    same(part.with_force_box(scaled.force_min, scaled.force_max), scaled)


def test_what_is_worked_out_once_is_worked_out_anew_for_a_part(rough):
    """Arms, pieces and whether the box is implied are kept on a problem, and must not be handed on
    to its parts.
    """
    scaled = Scaled.of(rough(0, regions=2))
    whole = (scaled.arms, scaled.pieces, scaled.patches, scaled.box_implied)
    part = scaled.with_piece(1, scaled.pieces[1] + 0.01).with_force_box(
        scaled.force_min + 0.01, scaled.force_max
    )
    assert not part.box_implied
    assert whole[3]
    vertex = part.layout.contact_vertices[1]
    for row, v in enumerate(vertex):
        expected = np.cross(part.vertices[v], part.frames[part.layout.vertex_candidates[v]].T).T
        np.testing.assert_allclose(part.arms[row], expected, atol=1e-15)
    np.testing.assert_array_equal(
        part.patches[1, 0], part.vertices[part.layout.vertex_candidates == 1][0]
    )


def test_a_toe_that_stands_is_a_patch_of_one_point(rough):
    course = rough(1)
    scaled = Scaled.of(course)
    assert scaled.layout.corners[0] == (1,)
    np.testing.assert_array_equal(
        scaled.pieces[0], course.footholds[0].toe_m[None] / course.length_scale_m
    )


def test_the_layout_says_who_stands_on_what_and_who_carries(rough):
    course = rough(2, frames=3, regions=2)
    layout = Scaled.of(course).layout
    rows = [
        (s, i, course.holds[stance.frame, i])
        for s, stance in enumerate(course.stances)
        for i in stance.limbs
    ]
    np.testing.assert_array_equal(np.array(layout.contacts).T, rows)
    np.testing.assert_array_equal(layout.stance_frames, [stance.frame for stance in course.stances])
    moved = [
        (course.holds[k - 1, i], course.holds[k, i])
        for k in range(1, 3)
        for i in range(4)
        if course.holds[k - 1, i] != course.holds[k, i]
    ]
    np.testing.assert_array_equal(layout.moves, moved)
    under, vertices = layout.under(np.array([3, 0, 3]))
    starts = np.cumsum([0, *(sum(counts) for counts in layout.corners)])
    expected = [(at, v) for at, p in enumerate((3, 0, 3)) for v in range(starts[p], starts[p + 1])]
    np.testing.assert_array_equal(np.column_stack([under, vertices]), expected)


@pytest.mark.parametrize("seed", range(3))
def test_units_come_off_and_on_again(mixed, seed):
    problem = replace(mixed(seed, (3, 4, 5)), force_scale_n=37.0, length_scale_m=0.41)
    scaled, rng = Scaled.of(problem), np.random.default_rng(seed)
    com, toes, forces = rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
    point = Point(com=com[None], rotation=np.zeros((1, 3)), toes=toes, forces=forces, residual=0.0)
    posture = plan_of(problem, scaled, scaled.numbers, point)
    np.testing.assert_allclose(posture.com_m, 0.41 * com[None])
    for contact, mine, force in zip(problem.contacts, posture.forces_n[0], forces, strict=True):
        n, y, z = contact.patch.frame.T
        np.testing.assert_allclose(
            mine, 37.0 * (force[0] * n + force[1] * y + force[2] * z), atol=1e-12
        )
    np.testing.assert_allclose(scaled.point(posture), np.hstack([toes - com, forces]), atol=1e-12)
    assert scaled.weight == pytest.approx(98.1 / 37.0)
    v, w = rng.normal(size=(2, 4, 3))
    np.testing.assert_allclose(np.einsum("kij,kj->ki", skew(v), w), np.cross(v, w), atol=1e-14)
