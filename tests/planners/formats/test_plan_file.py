"""Plan files: the same to the last bit when read back, and refused in one line after any change."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
from dataclasses import replace

import numpy as np
import pytest

from stancekit.planners.answer.report import plan_arrays, plan_digest
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.plan_file import check_file, is_plan_file, read_plan, write_plan
from stancekit.planners.verify import check_plan
from tests.refusals import assert_names, refuses


@pytest.fixture
def written(walk, tmp_path):
    plan = walk(4)
    write_plan(tmp_path / "plan.json", plan, check_plan(plan))
    return plan, tmp_path / "plan.json"


def edited(path, change):
    """The header changed by hand."""
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


def stored(data):
    """The arrays in a plan's file."""
    with np.load(io.BytesIO(base64.b64decode(data["arrays"]["npz"]))) as arrays:
        return dict(arrays)


def archive(arrays):
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def seal(data):
    """The file with the sum that its content has."""
    content = {name: value for name, value in data.items() if name != "sha256"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return json.dumps(content | {"sha256": hashlib.sha256(text.encode()).hexdigest()})


def resealed(path, change_header=lambda data: None, change_arrays=lambda arrays: None):
    """A file that a program changed, sums and all, so that only a look at the content can refuse
    it.
    """
    data = json.loads(path.read_text())
    arrays = stored(data)
    change_arrays(arrays)
    data["arrays"]["npz"] = base64.b64encode(archive(arrays)).decode()
    change_header(data)
    path.write_text(seal(data))


def test_a_plan_is_the_same_to_the_last_bit_when_read_back(written):
    plan, path = written
    again, header = read_plan(path)
    for name, array in plan_arrays(plan).items():
        assert (
            np.array_equal(array, getattr(again, name))
            if array is not None
            else getattr(again, name) is None
        )
    assert again.problem.to_json() == plan.problem.to_json()
    assert again.provenance == plan.provenance
    assert (header["format"], header["verified"]) == ("stancekit/plan/3", True)
    assert header["verdict"]["digest"] == check_plan(again).digest
    assert os.listdir(path.parent) == ["plan.json"]


def test_modes_come_back_where_there_are_any(walk, tmp_path):
    plan = replace(walk(3), modes=[0, 1, 1])
    write_plan(tmp_path / "a.json", plan, check_plan(plan))
    assert read_plan(tmp_path / "a.json")[0].modes.tolist() == [0, 1, 1]


def test_the_same_plan_gives_the_same_bytes(walk, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        plan = walk(3)
        write_plan(tmp_path / name / "plan.json", plan, check_plan(plan))
    assert (tmp_path / "a/plan.json").read_bytes() == (tmp_path / "b/plan.json").read_bytes()


def test_a_rejected_plan_is_written_as_such(walk, tmp_path):
    plan = walk(3)
    plan = replace(plan, com_m=plan.com_m + np.array([0.0, 0.01, 0.0]))
    write_plan(tmp_path / "a.json", plan, check_plan(plan))
    assert read_plan(tmp_path / "a.json")[1]["verified"] is False
    check = check_file(tmp_path / "a.json", joints=False)
    assert (check.accepted, check.same) == (False, True)
    assert "moment_balance" in [group.name for group in check.report.refused]


def test_a_report_on_another_plan_is_refused(walk, tmp_path):
    with refuses("report"):
        write_plan(tmp_path / "a.json", walk(3), check_plan(walk(3)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data["course"].update(goal_m=[9.0, 0.0, 0.2]),
        lambda data: data["course"]["placements"][7]["candidates"][1].update(friction=0.9),
        lambda data: data.update(verified=False),
        lambda data: data["verdict"].update(accepted=False),
        lambda data: data["verdict"].update(tolerance=1.0),
        lambda data: data["provenance"].update(method="by hand"),
        lambda data: data["arrays"].update(npz="UEsDBA=="),
        lambda data: data.update(sha256=None),
    ],
)
def test_a_header_that_was_edited_by_hand_is_refused(change, written):
    path = written[1]
    edited(path, change)
    with pytest.raises(InvalidInput) as refused:
        read_plan(path)
    assert_names(str(refused.value), path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("????", "arrays"),
        ("é", "arrays"),
        ("", "arrays"),
        (
            "bm8gYXJjaGl2ZQ==",
            "arrays",
        ),
    ],
)
def test_numbers_that_are_no_archive_are_refused_even_under_right_sums(text, message, written):
    resealed(written[1], change_header=lambda data: data["arrays"].update(npz=text))
    with pytest.raises(InvalidInput) as refused:
        read_plan(written[1])
    assert_names(str(refused.value), message)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda a: a.update(com_m=a["com_m"][:-1]), "com_m"),
        (lambda a: a.update(choice=a["choice"] + 0.5), "choice"),
        (lambda a: a["toes_m"].__setitem__((0, 0), np.nan), "toes_m"),
        (lambda a: a.pop("forces_n"), "forces_n"),
        (lambda a: a.update(more=np.zeros(1)), "more"),
        (lambda a: a.update(com_m=np.array([None], dtype=object)), "arrays"),
        (lambda a: a["com_m"].__setitem__((0, 0), 0.001), "digest"),
    ],
)
def test_numbers_that_do_not_fit_are_refused_even_under_right_sums(change, name, written):
    resealed(written[1], change_arrays=change)
    with refuses(name):
        read_plan(written[1])


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda d: d.update(format="stancekit/plan/4"), "stancekit/plan/4"),
        (lambda d: d.update(format=["stancekit/plan/2"]), "format"),
        (lambda d: d.update(format="stancekit/plan/1"), "stancekit/plan/1"),
        (lambda d: d["arrays"].pop("limbs"), "arrays.limbs"),
        (lambda d: d.update(verdict={}), "verdict"),
        (lambda d: d.update(arrays=[]), "arrays"),
        (lambda d: d.update(provenance=3), "provenance"),
        (lambda d: d["course"].pop("goal_m"), "goal_m"),
        (lambda d: d.update(course=None), "course"),
        (lambda d: d.pop("verified"), "verified"),
        (lambda d: d.update(more=1), "more"),
        (lambda d: d["verdict"].update(accepted=False), "digest"),
    ],
)
def test_a_header_that_does_not_fit_is_refused_even_under_right_sums(change, name, written):
    resealed(written[1], change_header=change)
    with refuses(name):
        read_plan(written[1])


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data["verdict"].update(digest="0" * 64),
        lambda data: data["verdict"].update(accepted=not data["verdict"]["accepted"]),
        lambda data: data["verdict"].update(tolerance=2.0 * data["verdict"]["tolerance"]),
        lambda data: data["course"]["robot"].update(mass_kg=10.0 + 1e-9),
    ],
    ids=["digest", "verdict", "tolerance", "mass"],
)
def test_a_verdict_of_other_content_is_refused_though_the_file_is_sealed_anew(written, change):
    resealed(written[1], change_header=change)
    with refuses("digest"):
        read_plan(written[1])


def test_a_file_that_is_none_is_told(tmp_path):
    for text in ("", "{", "[]"):
        (tmp_path / "a.json").write_text(text)
        with refuses("a.json"):
            read_plan(tmp_path / "a.json")
    for name in ("b.json", "b.txt"):
        with refuses(name):
            read_plan(tmp_path / name)


def test_a_forged_verdict_is_found_by_looking_again(walk, tmp_path):
    plan = walk(3)
    plan = replace(plan, com_m=plan.com_m + np.array([0.0, 0.01, 0.0]))
    write_plan(tmp_path / "a.json", plan, check_plan(plan))

    def forge(data):
        data["verdict"].update(
            accepted=True, digest=plan_digest(plan, data["verdict"]["tolerance"], True)
        )
        data["verified"] = True

    resealed(tmp_path / "a.json", change_header=forge)
    check = check_file(tmp_path / "a.json", joints=False)
    assert (check.accepted, check.same) == (False, False)
    assert check.to_json()["verdict"] == "refused"


def test_a_plan_file_is_known_by_its_format(written, tmp_path):
    assert is_plan_file(written[1])
    (tmp_path / "b.json").write_text('{"format": "stancekit/posture/1"}')
    (tmp_path / "c.json").write_text("no JSON")
    assert not any(
        is_plan_file(tmp_path / name) for name in ("b.json", "c.json", "none.json", "plan", ".")
    )
