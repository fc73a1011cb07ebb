"""Proof files: the same to the last bit when read back, checked anew whatever they say, refused in
one line if odd.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.proof_file import check_proof_file, read_proof, write_proof
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_certificate
from tests.refusals import assert_names


@pytest.fixture(scope="module")
def proved():
    """Two icy walls between which no tripod can hang, and the certificate."""
    course = slippery(read_course("walls", frames=2), 0.3)
    return course, TwoStagePlanner().solve(course).certificate


@pytest.fixture
def written(proved, tmp_path):
    write_proof(tmp_path / "proof.json", proved[1].of(proved[0]))
    return tmp_path / "proof.json"


def changed(path, **parts):
    path.write_text(json.dumps(json.loads(path.read_text()) | parts))


def test_a_proof_is_the_same_to_the_last_bit_when_read_back(proved, written):
    course, certificate = read_proof(written)
    assert course.to_json() == proved[0].to_json()
    assert np.array_equal(certificate.tree, proved[1].tree)
    assert np.array_equal(certificate.multipliers, proved[1].multipliers)
    check = check_proof_file(written)
    assert check.accepted
    assert check.report.groups == check_certificate(proved[1].of(proved[0])).groups
    assert_names(check.message, "walls", "infeasible", "friction")


def test_a_proof_of_another_course_is_refused(proved, written):
    grippy = slippery(proved[0], 4.0)
    changed(written, subject=grippy.to_json())
    assert TwoStagePlanner().solve(grippy).solution is not None
    check = check_proof_file(written)
    assert not check.accepted
    assert check.to_json()["verdict"] == "refused"


def test_odd_files_are_refused_in_one_line(proved, written):
    tree, rows = proved[1].tree.tolist(), proved[1].multipliers.tolist()
    nothing = replace(proved[0], name="").to_json() | {"frames": 0}
    for parts, message in (
        ({"format": "stancekit/plan/1"}, "expected format 'stancekit/proof/1'"),
        (
            {"more": 1},
            "expected the keys format, subject, tree, multipliers; missing or unknown: more",
        ),
        ({"tree": [["0", 1, 0, 0, 0]]}, "tree: expected a table of numbers"),
        ({"tree": tree[0]}, "tree: expected a table of numbers"),
        (
            {"tree": [[0, 1, 0]]},
            "certificate: expected a tree of shape (K, 5) and multipliers of shape",
        ),
        ({"multipliers": [[1.0], [1.0, 2.0]]}, "multipliers: expected a table of numbers"),
        ({"multipliers": [["a"] * len(rows[0])]}, "multipliers: expected a table of numbers"),
        ({"subject": nothing}, "subject: "),
    ):
        before = written.read_text()
        changed(written, **parts)
        with pytest.raises(InvalidInput) as error:
            read_proof(written)
        assert str(error.value).startswith(f"{written}: {message}")
        assert "\n" not in str(error.value)
        written.write_text(before)


def test_multipliers_that_prove_nothing_are_refused_and_never_raise(proved, written):
    rows = proved[1].multipliers
    for table in (np.zeros_like(rows), -rows, rows[:, :-1], np.vstack([rows, rows])):
        changed(written, multipliers=table.tolist())
        assert not check_proof_file(written).accepted
