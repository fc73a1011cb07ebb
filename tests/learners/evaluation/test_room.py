"""Room for learning: its shares by hand, and intervals that cover."""

import numpy as np

from stancekit.learners.evaluation.room import leap_room, paired


def row(scene, method, found, tries, solves):
    return {"scene": scene, "method": method, "found": found, "tries": tries, "solves": solves}


ROWS = [
    row(0, "random", False, 50, 50),
    row(0, "rule-tuned", True, 1, 3),
    row(0, "finder", True, 1, 3),
    row(0, "net", True, 1, 2),
    row(0, "noise", False, 40, 50),
    row(0, "noise-again", False, 40, 50),
    row(1, "random", True, 20, 30),
    row(1, "rule-tuned", False, 40, 50),
    row(1, "finder", True, 5, 11),
    row(1, "net", True, 1, 4),
    row(1, "noise", True, 9, 20),
    row(1, "noise-again", False, 40, 50),
    row(2, "random", False, 50, 50),
    row(2, "rule-tuned", False, 40, 50),
    row(2, "finder", False, 40, 50),
    row(2, "net", False, 40, 50),
    row(2, "noise", True, 9, 20),
    row(2, "noise-again", False, 40, 50),
    row(3, "random", False, 50, 50),
    row(3, "rule-tuned", False, 40, 50),
    row(3, "finder", False, 40, 50),
    row(3, "net", False, 40, 50),
    row(3, "noise", False, 40, 50),
    row(3, "noise-again", False, 40, 50),
]


def test_room_is_what_the_control_leaves_of_the_union():
    one, twelve = (
        leap_room(ROWS, "leap-few", 50, tries=1),
        leap_room(ROWS, "leap-few", 50, solves=12),
    )
    assert (one.scenes, one.control[0], one.oracle[0], one.room) == (4, 0.25, 0.75, 50.0)
    assert (one.learned_by, one.learned[0], one.gain[0]) == ("net", 0.5, 25.0)
    assert (twelve.controlled_by, twelve.control[0], twelve.room, twelve.gain[0]) == (
        "finder",
        0.5,
        25.0,
        0.0,
    )
    assert one.again[0] == 0.5  # scene 2 was found by noise of the first seed alone
    assert one.random[0] == 0.0


def test_paired_intervals_cover_a_difference_that_is_known():
    rng, inside = np.random.default_rng(0), 0
    for k in range(40):
        control = rng.random(400) < 0.5
        learned = np.where(rng.random(400) < 0.2, True, control)  # + 10 points
        _, low, high = paired(learned, control, seed=k)
        inside += low <= 10.0 <= high
    assert inside >= 34
