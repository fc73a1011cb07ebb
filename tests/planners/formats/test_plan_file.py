"""Plan files: the same to the last bit when read back, and refused in one line after any change."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
import stat
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stancekit import Certificate, Motion
from stancekit.envs.distributions.postures import distribution
from stancekit.planners.answer.answer import UNBOUNDED, Answer, Status
from stancekit.planners.answer.motion import seal as sum_of
from stancekit.planners.answer.report import verdict_digest
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import parse_json, read_text
from stancekit.planners.files.writing import write_bytes, write_text
from stancekit.planners.formats.motion_file import (
    check_file,
    read_evidence,
    read_motion,
    write_certificate,
    write_motion,
)
from stancekit.planners.formats.question_file import (
    answer_from_json,
    json_records,
    read_envelopes,
    read_problems,
)
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.projection.whole_body import with_joints
from stancekit.planners.robot.robot_model import RobotModel, model_of
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.friction_margin import slippery
from stancekit.planners.search.two_stage import TwoStage
from stancekit.planners.verify import check_certificate, check_plan
from stancekit.planners.verify.postures import REACHED_M
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import assert_names, refuses


def refusal(call, *values):
    with pytest.raises(InvalidInput) as error:
        call(*values)
    assert "\n" not in str(error.value)
    return str(error.value)


# ------------------------------------------------------------------------------------------------------------
# reading


def test_what_is_no_text_file_is_named(tmp_path):
    assert_names(refusal(read_text, tmp_path), tmp_path)
    assert_names(refusal(read_text, tmp_path / "file.json"), "file.json")
    for content in (b"", b" \n\t\n", b'{"a": "\xff"}'):
        (tmp_path / "file.json").write_bytes(content)
        assert_names(refusal(read_text, tmp_path / "file.json"), "file.json")


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_a_file_that_may_not_be_read_is_named(tmp_path):
    file = tmp_path / "file.json"
    file.write_text("{}")
    file.chmod(0)
    assert_names(refusal(read_text, file), file)


def test_a_name_that_no_file_can_have_is_refused():
    assert "expected a file" in refusal(read_text, '{"mass_kg": 10.0}' * 20)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "broken at line 1 column 2: Expecting property name enclosed in double quotes"),
        ('{\n "a": 1,\n "b": }', "broken at line 3 column 7: Expecting value"),
        ('{"a": 1} {"b": 2}', "broken at line 1 column 10: Extra data"),
        ("nothing", "broken at line 1 column 1: Expecting value"),
    ],
)
def test_broken_json_is_named_with_line_and_column(tmp_path, text, message):
    assert_names(refusal(parse_json, text, "x.json"), "x.json")
    file = tmp_path / "x.json"
    file.write_text(text, encoding="utf-8")
    assert_names(refusal(read_envelopes, file), file)


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path):
    (tmp_path / "x.json").write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert parse_json(read_text(tmp_path / "x.json"), "x.json") == {"a": 1}


def test_a_key_that_comes_twice_is_refused():
    assert_names(refusal(parse_json, '{"a": {"b": 1, "c": 2, "b": 1}}', "x.json"), "x.json", "b")


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 10_000])
def test_absurd_json_is_refused_too(text):
    assert_names(refusal(parse_json, text, "x.json"), "x.json")


def records(text):
    """The records, an error as its message."""
    found = json_records(text, "f")
    return [(where, str(item) if isinstance(item, InvalidInput) else item) for where, item in found]


def test_records_come_from_an_object_an_array_or_lines():
    assert records('{"a": 1}') == [("f", {"a": 1})]
    assert records('{\n"a": 1\n}\n') == [("f", {"a": 1})]
    assert records('[{"a": 1}, 2]') == [("f[0]", {"a": 1}), ("f[1]", 2)]
    assert records('[\n{"a": 1},\n{"a": 2}\n]') == [("f[0]", {"a": 1}), ("f[1]", {"a": 2})]
    assert records('{"a": 1}\n\n{"a": 2}\n') == [("f line 1", {"a": 1}), ("f line 3", {"a": 2})]
    assert records('\n{"a": 1}\n') == [("f", {"a": 1})]
    assert records("[]") == [("f", "f: expected one or more problems, got an empty array")]


def test_a_broken_line_does_not_keep_the_others_back():
    assert records('{"a": 1}\n{"a": \n{"a": 3}') == [
        ("f line 1", {"a": 1}),
        ("f line 2", "f line 2: expected JSON, broken at line 1 column 7: Expecting value"),
        ("f line 3", {"a": 3}),
    ]
    assert records("[1,\n2") == [
        ("f", "f: expected JSON, broken at line 2 column 2: Expecting ',' delimiter")
    ]


@pytest.mark.parametrize(
    "text", ['[\n{"a": 1},\n{"b": 2}\n', '{"a": [\n  {"b": 1}\n  {"b": 2}\n]}', "1\n2\n"]
)
def test_what_is_broken_but_no_json_lines_is_one_error(text):
    ((where, message),) = records(text)
    assert where == "f"
    assert message.startswith("f: expected JSON, broken at line ")


@pytest.mark.parametrize("separator", ["\u2028", "\u2029", "\u0085"])
def test_only_line_ends_end_a_line(separator):
    text = "\n".join(json.dumps({"a": f"x{separator}y"}, ensure_ascii=False) for _ in range(2))
    assert [item for _, item in records(text)] == [{"a": f"x{separator}y"}] * 2


def test_problems_are_read_one_by_one_with_their_errors(drawn):
    good, bad = drawn("wall-3", 0).to_json(), drawn("wall-3", 1).to_json() | {"mass_kg": -1.0}
    text = "\n".join([json.dumps(good), json.dumps(bad), "{", json.dumps(good)])
    found = list(read_problems(text, "f"))
    assert [where for where, _ in found] == ["f line 1", "f line 2", "f line 3", "f line 4"]
    assert [type(item) for _, item in found] == [Problem, InvalidInput, InvalidInput, Problem]
    assert found[0][1].to_json() == good
    assert str(found[1][1]) == "f line 2: mass_kg: expected a number above 0, got -1"
    assert str(found[2][1]).startswith("f line 3: expected JSON, broken at line 1 column 2: ")
    ((where, item),) = read_problems(json.dumps([3]), "f")
    assert (where, str(item)) == (
        "f[0]",
        "f[0]: expected a JSON object with format 'stancekit/posture/1' or 'stancekit/course/1', got int",
    )


# ------------------------------------------------------------------------------------------------------------
# writing


def test_text_and_bytes_are_written_as_they_are(tmp_path):
    write_text(tmp_path / "a.txt", "ü\n")
    assert (tmp_path / "a.txt").read_bytes() == "ü\n".encode()
    write_bytes(tmp_path / "a.txt", b"\x00\xff")
    assert (tmp_path / "a.txt").read_bytes() == b"\x00\xff"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_new_file_has_the_permissions_of_any_new_file(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_bytes(tmp_path / "ours", b"")
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "ours")]
    assert modes[0] == modes[1]


@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_where_writing_fails_the_old_file_stays_and_nothing_else(
    tmp_path, monkeypatch, step, failure
):
    file = tmp_path / "a.json"
    write_text(file, "old")

    def fail(*_):
        raise failure

    monkeypatch.setattr(os, step, fail)
    with pytest.raises((InvalidInput, KeyboardInterrupt)) as error:
        write_text(file, "new")
    monkeypatch.undo()
    if isinstance(failure, OSError):
        assert_names(str(error.value), file)
    assert file.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.json"]


def test_a_place_where_nothing_can_be_written_is_named(tmp_path):
    file = tmp_path / "none" / "a.json"
    assert_names(refusal(write_text, file, "x"), file)
    (tmp_path / "folder").mkdir()
    assert_names(refusal(write_text, tmp_path / "folder", "x"), tmp_path / "folder")
    assert os.listdir(tmp_path) == ["folder"]


@pytest.mark.parametrize("name", ["n" * 300, "n" * 250, "loop"])
def test_a_name_that_cannot_be_written_to_is_refused(tmp_path, name):
    (tmp_path / "loop").symlink_to("loop")
    assert "cannot be written" in refusal(write_text, tmp_path / name, "x")


def test_a_pipe_is_written_to_as_it_is(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_text(tmp_path / "pipe", "text")
    assert os.read(reader, 10) == b"text"
    os.close(reader)
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
    assert os.listdir(tmp_path) == ["pipe"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


# ------------------------------------------------------------------------------------------------------------
# answers


@pytest.fixture(scope="module")
def outcomes(programs, drawn):
    """One outcome of every status, and a trivially infeasible one, with their problems."""
    exact, limited = Exact(programs=programs), Exact(programs=programs, max_nodes=0)
    found = {
        "feasible": (drawn("wall-3", 0), exact.solve(drawn("wall-3", 0))),
        "infeasible": (drawn("wall-3", 225), exact.solve(drawn("wall-3", 225))),
        "trivial": (drawn("wall-3", 4), exact.solve(drawn("wall-3", 4))),
        "undecided": (drawn("wall-3", 0), limited.solve(drawn("wall-3", 0))),
        "refused": (
            drawn("wall-3", 0),
            TwoStage(projection=None, programs=programs).solve(drawn("wall-3", 0)),
        ),
    }
    statuses = {name: outcome.status.value for name, (_, outcome) in found.items()}
    assert statuses == {
        "feasible": "feasible",
        "infeasible": "infeasible",
        "trivial": "infeasible",
        "undecided": "undecided",
        "refused": "undecided",
    }
    return found


@pytest.mark.parametrize("name", ["feasible", "infeasible", "trivial", "undecided", "refused"])
@pytest.mark.parametrize("proof", [True, False])
def test_an_outcome_is_strict_json_that_can_be_checked(outcomes, name, proof):
    problem, outcome = outcomes[name]
    record = json.loads(json.dumps(outcome.to_json(proof=proof), allow_nan=False))
    assert record["status"] == outcome.status.value
    assert (record["method"], record["solves"], record["seconds"]) == (
        outcome.method,
        outcome.effort.solves,
        outcome.effort.seconds,
    )
    answer = answer_from_json(record, problem)
    if name == "feasible":
        assert isinstance(answer, Motion)
        assert check_plan(answer).accepted
        assert record["residual"] == outcome.residual
        assert "certificate" not in record
    elif name in ("infeasible", "trivial"):
        assert ("certificate" in record) == proof
        assert answer is None or check_certificate(answer).figures["lower_bound"] == outcome.bound
        assert record["lower_bound"] == (UNBOUNDED if name == "trivial" else outcome.bound)
        assert record["residual"] is None
    else:
        assert answer is None
        assert record["lower_bound"] == 0.0
        assert record["message"] == outcome.message
    assert ("claim" in record) == bool(outcome.claim)


def test_numbers_that_are_none_become_null():
    outcome = Answer(
        status=Status.UNDECIDED,
        method="p1",
        details={"margin": np.inf, "gap": np.nan, "chosen": 1.0},
        bound=np.inf,
    )
    record = outcome.to_json()
    json.dumps(record, allow_nan=False)
    assert record["details"] == {"margin": None, "gap": None, "chosen": 1.0}
    assert (record["residual"], record["residual_nm"], record["lower_bound"]) == (
        None,
        None,
        UNBOUNDED,
    )


ASKED = distribution("wall-3").sample(np.random.default_rng(0))
WITNESS = {
    "com_m": [0, 0, 0],
    "rotation_rad": [0, 0, 0],
    "toes_m": [[0, 0, 0]],
    "forces_n": [[0, 0, 98.1]],
}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ([], "expected a JSON object, got list"),
        (
            {k: v for k, v in WITNESS.items() if k != "toes_m"},
            "toes_m: expected this key, got nothing",
        ),
        (
            WITNESS | {"com_m": ["a", 0, 0]},
            "com_m, rotation_rad, toes_m, forces_n: expected lists of numbers",
        ),
        (
            WITNESS | {"com_m": ["0"] * 3},
            "com_m, rotation_rad, toes_m, forces_n: expected lists of numbers",
        ),
        (
            WITNESS | {"com_m": ["\u0660"] * 3},
            "com_m, rotation_rad, toes_m, forces_n: expected lists of numbers",
        ),
        (
            WITNESS | {"com_m": [True, False, False]},
            "com_m, rotation_rad, toes_m, forces_n: expected lists of numbers",
        ),
        (
            {"certificate": {"tree": [["0"] * 5], "multipliers": [[1]]}},
            "certificate: expected two tables of numbers",
        ),
        (
            WITNESS | {"toes_m": [[0], [0, 1]]},
            "com_m, rotation_rad, toes_m, forces_n: expected lists of numbers",
        ),
        ({"certificate": 3}, "certificate: expected an object with the keys tree and multipliers"),
        (
            {"certificate": {"tree": []}},
            "certificate: expected an object with the keys tree and multipliers",
        ),
        (
            {"certificate": {"tree": "a", "multipliers": []}},
            "certificate: expected two tables of numbers",
        ),
        (
            {"certificate": {"tree": [[0, 0, 0]], "multipliers": [1]}},
            "certificate: expected a tree of shape (K, 5) and multipliers of shape (leaves, count), "
            "got (1, 3) and (1,)",
        ),
    ],
)
def test_an_answer_that_cannot_be_read_is_named(data, message):
    assert_names(
        refusal(answer_from_json, data, ASKED), *message.partition(": expected")[0].split(", ")
    )


@pytest.mark.parametrize(
    "data",
    [
        WITNESS | {"com_m": [10**400, 0, 0]},
        {"certificate": {"tree": [[10**400] * 4], "multipliers": [[1]]}},
    ],
    ids=["posture", "certificate"],
)
def test_an_answer_with_integers_beyond_all_floats_is_refused(data):
    assert "expected" in refusal(answer_from_json, data, ASKED)


def test_an_answer_without_posture_or_certificate_claims_nothing():
    assert answer_from_json({"status": "undecided"}, ASKED) is None
    assert answer_from_json({"certificate": None}, ASKED) is None
    assert isinstance(answer_from_json(WITNESS, ASKED), Motion)
    proof = Certificate(tree=[[0, 0, 0, 0, 0]], multipliers=np.ones((1, 9)))
    assert isinstance(
        answer_from_json({"certificate": proof.to_json(), **WITNESS}, ASKED), Certificate
    )


@pytest.fixture
def written(walk, tmp_path):
    plan = walk(4)
    write_motion(tmp_path / "plan.json", plan, check_plan(plan))
    return plan, tmp_path / "plan.json"


def edited(path, change):
    """The header changed by hand."""
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))


def stored(data):
    """The arrays in a plan's file."""
    with np.load(io.BytesIO(base64.b64decode(data["columns"]["npz"]))) as arrays:
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
    data["columns"]["npz"] = base64.b64encode(archive(arrays)).decode()
    change_header(data)
    path.write_text(seal(data))


def test_a_plan_is_the_same_to_the_last_bit_when_read_back(written):
    plan, path = written
    again, header = read_motion(path)
    assert again.arrays().keys() == plan.arrays().keys()
    for name, array in plan.arrays().items():
        np.testing.assert_array_equal(getattr(again, name), array)
    assert again.problem.to_json() == plan.problem.to_json()
    assert again.provenance == plan.provenance
    assert (header["format"], header["verified"]) == ("stancekit/motion/1", True)
    assert header["verdict"]["digest"] == check_plan(again).digest
    assert os.listdir(path.parent) == ["plan.json"]


def test_modes_come_back_where_there_are_any(walk, tmp_path):
    plan = replace(walk(3), modes=[0, 1, 1])
    write_motion(tmp_path / "a.json", plan, check_plan(plan))
    assert read_motion(tmp_path / "a.json")[0].modes.tolist() == [0, 1, 1]


def test_the_same_plan_gives_the_same_bytes(walk, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        plan = walk(3)
        write_motion(tmp_path / name / "plan.json", plan, check_plan(plan))
    assert (tmp_path / "a/plan.json").read_bytes() == (tmp_path / "b/plan.json").read_bytes()


def test_a_rejected_plan_is_written_as_such(walk, tmp_path):
    plan = walk(3)
    plan = replace(plan, com_m=plan.com_m + np.array([0.0, 0.01, 0.0]))
    write_motion(tmp_path / "a.json", plan, check_plan(plan))
    assert read_motion(tmp_path / "a.json")[1]["verified"] is False
    check = check_file(tmp_path / "a.json", joints=False)
    assert (check.accepted, check.same) == (False, True)
    assert "moment_balance" in [group.name for group in check.report.refused]


def test_a_report_on_another_plan_is_refused(walk, tmp_path):
    with refuses("report"):
        write_motion(tmp_path / "a.json", walk(3), check_plan(walk(2)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data["question"].update(goal_m=[9.0, 0.0, 0.2]),
        lambda data: data["question"]["placements"][7]["candidates"][1].update(friction=0.9),
        lambda data: data.update(verified=False),
        lambda data: data["verdict"].update(accepted=False),
        lambda data: data["verdict"].update(tolerance=1.0),
        lambda data: data["provenance"].update(method="by hand"),
        lambda data: data["columns"].update(npz="UEsDBA=="),
        lambda data: data.update(sha256=None),
    ],
)
def test_a_header_that_was_edited_by_hand_is_refused(change, written):
    path = written[1]
    edited(path, change)
    with refuses(path):
        read_motion(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("????", "columns"),
        ("é", "columns"),
        ("", "columns"),
        ("bm8gYXJjaGl2ZQ==", "columns"),
    ],
)
def test_numbers_that_are_no_archive_are_refused_even_under_right_sums(text, message, written):
    resealed(written[1], change_header=lambda data: data["columns"].update(npz=text))
    with refuses(message):
        read_motion(written[1])


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda a: a.update(com_m=a["com_m"][:-1]), "com_m"),
        (lambda a: a.update(choice=a["choice"] + 0.5), "choice"),
        (lambda a: a["toes_m"].__setitem__((0, 0), np.nan), "toes_m"),
        (lambda a: a.pop("forces_n"), "forces_n"),
        (lambda a: a.update(more=np.zeros(1)), "more"),
        (lambda a: a.update(com_m=np.array([None], dtype=object)), "columns"),
        (lambda a: a["com_m"].__setitem__((0, 0), 0.001), "digest"),
    ],
)
def test_numbers_that_do_not_fit_are_refused_even_under_right_sums(change, name, written):
    resealed(written[1], change_arrays=change)
    with refuses(name):
        read_motion(written[1])


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda d: d.update(format="stancekit/motion/4"), "stancekit/motion/4"),
        (lambda d: d.update(format=["stancekit/motion/2"]), "format"),
        (lambda d: d.update(format="stancekit/plan/3"), "stancekit/plan/3"),
        (lambda d: d["columns"].pop("limbs"), "columns.limbs"),
        (lambda d: d.update(verdict={}), "verdict"),
        (lambda d: d.update(columns=[]), "columns"),
        (lambda d: d.update(provenance=3), "provenance"),
        (lambda d: d["question"].pop("goal_m"), "goal_m"),
        (lambda d: d.update(question=None), "question"),
        (lambda d: d.pop("verified"), "verified"),
        (lambda d: d.update(more=1), "more"),
        (lambda d: d["verdict"].update(accepted=False), "digest"),
    ],
)
def test_a_header_that_does_not_fit_is_refused_even_under_right_sums(change, name, written):
    resealed(written[1], change_header=change)
    with refuses(name):
        read_motion(written[1])


@pytest.mark.parametrize(
    "change",
    [
        lambda data: data["verdict"].update(digest="0" * 64),
        lambda data: data["verdict"].update(accepted=not data["verdict"]["accepted"]),
        lambda data: data["verdict"].update(tolerance=2.0 * data["verdict"]["tolerance"]),
        lambda data: data["question"]["robot"].update(mass_kg=10.0 + 1e-9),
    ],
    ids=["digest", "verdict", "tolerance", "mass"],
)
def test_a_verdict_of_other_content_is_refused_though_the_file_is_sealed_anew(written, change):
    resealed(written[1], change_header=change)
    with refuses("digest"):
        read_motion(written[1])


def test_a_file_that_is_none_is_told(tmp_path):
    for text in ("", "{", "[]"):
        (tmp_path / "a.json").write_text(text)
        with refuses("a.json"):
            read_motion(tmp_path / "a.json")
    for name in ("b.json", "b.txt"):
        with refuses(name):
            read_motion(tmp_path / name)


def test_a_forged_verdict_is_found_by_looking_again(walk, tmp_path):
    plan = walk(3)
    plan = replace(plan, com_m=plan.com_m + np.array([0.0, 0.01, 0.0]))
    write_motion(tmp_path / "a.json", plan, check_plan(plan))

    def forge(data):
        data["verdict"]["accepted"] = True
        data["verdict"]["digest"] = verdict_digest(data["verdict"], plan.digest)
        data["verified"] = True

    resealed(tmp_path / "a.json", change_header=forge)
    check = check_file(tmp_path / "a.json", joints=False)
    assert (check.accepted, check.same) == (False, False)
    assert check.to_json()["verdict"] == "refused"


COURSE = """
name: flat
robot: dog.urdf
frames: 3
gait: wave
start_m: [0.0, 0.0]
goal_m: [0.1, 0.0, 0.45]
terrain: {kind: flat, friction: 0.7}
"""
Forgery = Callable[[dict[str, Any], dict[str, Any]], None]
"""Changes the header and the arrays of a file."""


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Motion:
    folder = tmp_path_factory.mktemp("course")
    (folder / "dog.urdf").write_text(quadruped())
    (folder / "flat.yaml").write_text(COURSE)
    outcome = TwoStage().solve(read_course(folder / "flat.yaml"))
    assert outcome.solution is not None
    return with_joints(outcome.solution)


@pytest.fixture
def path(plan: Motion, tmp_path: Path) -> Path:
    write_motion(tmp_path / "plan.json", plan, check_plan(plan, joints=True))
    return tmp_path / "plan.json"


def forged(path: Path, forge: Forgery) -> None:
    """The file as a program leaves it that knows every sum: model, verdict and file are of the
    forged content.
    """
    header = json.loads(path.read_text())
    with np.load(io.BytesIO(base64.b64decode(header["columns"]["npz"]))) as stored:
        arrays = dict(stored)
    forge(header, arrays)
    if "model" in header["question"]["robot"]:
        header["question"]["robot"]["model"]["digest"] = model_of_header(header).digest
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    header["columns"]["npz"] = base64.b64encode(buffer.getvalue()).decode()
    head = {name: header[name] for name in ("question", "provenance")}
    content = hashlib.sha256(json.dumps(head, sort_keys=True, separators=(",", ":")).encode())
    for name, array in sorted(arrays.items()):
        content.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        content.update(np.ascontiguousarray(array).tobytes())
    verdict = header["verdict"]
    told = {name: verdict[name] for name in ("accepted", "tolerance", "checked", "limits")}
    verdict["digest"] = sum_of({**told, "answer": content.hexdigest()})
    path.write_text(seal(header))


def model_of_header(header: dict[str, Any]) -> RobotModel:
    raw = header["question"]["robot"]["model"]
    return model_of(
        raw["urdf"],
        feet={leg["name"]: leg["foot"] for leg in raw["legs"]},
        name=header["question"]["robot"]["name"],
        posture_rad={
            joint: angle for leg in raw["legs"] for joint, angle in leg["stance_rad"].items()
        },
    )


def in_urdf(old: str, new: str, count: int = -1) -> Forgery:
    def forge(header: dict[str, Any], arrays: dict[str, Any]) -> None:
        model = header["question"]["robot"]["model"]
        assert old in model["urdf"]
        model["urdf"] = model["urdf"].replace(old, new, count)

    return forge


def nothing(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    pass


def test_the_verdict_of_the_file_alone_is_that_of_the_plan(plan: Motion, path: Path) -> None:
    report = check_plan(plan, joints=True)
    check = check_file(path)
    assert check.accepted
    assert [check.report.group(name).verdict for name in ("joints", "torque")] == ["holds"] * 2
    header = json.loads(path.read_text())
    assert header["verdict"]["checked"] == ["contacts", "joints", "torque"]
    parts = ("HAA", "HFE", "KFE")
    assert header["columns"]["joints"] == [
        f"{leg}_{part}" for leg in ("LF", "RF", "LH", "RH") for part in parts
    ]
    again = read_motion(path)[0]
    assert plan.joints_rad is not None
    np.testing.assert_array_equal(again.joints_rad, plan.joints_rad)
    assert check_plan(again, joints=True).digest == report.digest != check_plan(again).digest


def test_a_file_that_a_program_wrote_anew_is_the_same(path: Path) -> None:
    before = json.loads(path.read_text())["verdict"]["digest"]
    forged(path, nothing)
    assert json.loads(path.read_text())["verdict"]["digest"] == before
    assert check_file(path).accepted


def test_without_joints_in_the_file_the_verifier_finds_some(path: Path) -> None:
    def forge(header: dict[str, Any], arrays: dict[str, Any]) -> None:
        del arrays["joints_rad"], header["columns"]["joints"]

    forged(path, forge)
    assert read_motion(path)[0].joints_rad is None
    check = check_file(path)
    assert check.accepted
    assert check.report.group("joints").verdict == "holds"


def _shifted(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["joints_rad"][1, 4] += 2.0 * REACHED_M / 0.3


def _swapped(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["joints_rad"] = arrays["joints_rad"][:, [3, 4, 5, 0, 1, 2, *range(6, 12)]]


@pytest.mark.parametrize(
    ("forge", "group"),
    [
        (_shifted, "joints"),
        (_swapped, "joints"),
        (in_urdf('0 0 -.3"', '0 0 -.30002"'), "joints"),
        (in_urdf('radius="0.02"', 'radius="0.0201"'), "joints"),
        (in_urdf('effort="40.0"', 'effort="1.0"'), "torque"),
        (in_urdf('0.28 -0.14 0"', '0.28 -0.14 0.001"'), "joints"),
    ],
)
def test_a_forged_file_is_refused_whatever_it_says(path: Path, forge: Forgery, group: str) -> None:
    forged(path, forge)
    check = check_file(path)
    assert not check.accepted
    assert check.report.contacts
    assert check.report.group(group).verdict == "violated"
    assert not check.same


@pytest.mark.parametrize("effort", ["1e9", "2000", "0"])
def test_a_torque_limit_that_no_joint_has_is_told_and_counts_for_nothing(
    path: Path, effort: str
) -> None:
    forged(path, in_urdf('effort="40.0"', f'effort="{effort}"', 3))
    check = check_file(path)
    assert check.report.group("torque").verdict == "not checked"
    assert check.report.checked == ("contacts", "joints")
    assert_names(check.message, "torque", "LF_HAA", "LF_HFE", "LF_KFE")
    assert not check.accepted


def _nan(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["joints_rad"][0, 0] = np.nan


def _short(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    arrays["joints_rad"] = arrays["joints_rad"][:, :8]


def _renamed(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    header["columns"]["joints"][0] = "LF_HFE"


def _unnamed(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    del header["columns"]["joints"]


def _list(header: dict[str, Any], arrays: dict[str, Any]) -> None:
    header["verdict"]["checked"] = ["contacts", "hands"]


@pytest.mark.parametrize(
    ("forge", "name"),
    [
        (_nan, "joints_rad"),
        (
            _short,
            "joints_rad",
        ),
        (_renamed, "columns.joints"),
        (_unnamed, "columns.joints"),
        (_list, "verdict.checked"),
        (
            in_urdf('<mass value="10.0"/>', '<mass value="10.001"/>'),
            "robot quadruped",
        ),
    ],
)
def test_a_file_that_contradicts_itself_is_no_plan(path: Path, forge: Forgery, name: str) -> None:
    forged(path, forge)
    with refuses(path, name):
        check_file(path)


def test_what_was_checked_is_under_the_digest(path: Path) -> None:
    header = json.loads(path.read_text())
    header["verdict"]["checked"] = ["contacts"]
    path.write_text(seal(header))
    with refuses("digest"):
        check_file(path)


def test_a_robot_that_is_named_has_to_be_the_files(path: Path) -> None:
    for name, effort in (("dog.urdf", 40.0), ("strong.urdf", 60.0)):
        path.with_name(name).write_text(quadruped(effort=effort))
    assert check_file(path, robot=str(path.with_name("dog.urdf"))).accepted
    forged(path, in_urdf('effort="40.0"', 'effort="60.0"'))
    assert check_file(path).accepted  # it is a plan for such a robot
    assert check_file(path, robot=str(path.with_name("strong.urdf"))).accepted
    with refuses(path):
        check_file(path, robot=str(path.with_name("dog.urdf")))


def test_links_that_only_the_file_lets_touch_are_not_the_robots(path: Path) -> None:
    def lets_touch(header: dict[str, Any], arrays: dict[str, Any]) -> None:
        header["question"]["robot"]["model"]["disabled_pairs"] = [["LF_FOOT", "RF_FOOT"]]

    forged(path, lets_touch)
    assert check_file(path).accepted
    path.with_name("dog.urdf").write_text(quadruped())
    with refuses("quadruped"):
        check_file(path, robot=str(path.with_name("dog.urdf")))


@pytest.fixture(scope="module")
def proved():
    """Two icy walls between which no tripod can hang, and the certificate."""
    course = slippery(read_course("walls", frames=2), 0.3)
    return course, TwoStage().solve(course).certificate


@pytest.fixture
def proof_path(proved, tmp_path):
    write_certificate(tmp_path / "proof.json", proved[1].of(proved[0]))
    return tmp_path / "proof.json"


def test_a_proof_is_the_same_to_the_last_bit_when_read_back(proved, proof_path):
    certificate, _ = read_evidence(proof_path)
    assert certificate.refuted.to_json() == proved[0].to_json()
    assert np.array_equal(certificate.tree, proved[1].tree)
    assert np.array_equal(certificate.multipliers, proved[1].multipliers)
    check = check_file(proof_path)
    assert check.accepted
    assert check.report.groups == check_certificate(proved[1].of(proved[0])).groups
    assert_names(check.message, "walls", "infeasible", "friction")


def test_a_proof_of_another_course_is_refused(proved, proof_path):
    grippy = slippery(proved[0], 4.0)
    resealed(proof_path, lambda data: data.update(question=grippy.to_json()))
    assert TwoStage().solve(grippy).solution is not None
    check = check_file(proof_path)
    assert not check.accepted
    assert check.to_json()["verdict"] == "refused"


@pytest.mark.parametrize(
    ("change", "change_arrays", "name"),
    [
        (lambda d: d.update(format="stancekit/proof/1"), None, "stancekit/proof/1"),
        (lambda d: d.update(more=1), None, "more"),
        (lambda d: d["question"].update(frames=0), None, "question"),
        (None, lambda a: a.update(tree=a["tree"][0]), "tree"),
        (None, lambda a: a.update(tree=a["tree"][:, :3]), "tree"),
        (None, lambda a: a.update(multipliers=a["multipliers"].astype(str)), "multipliers"),
        (None, lambda a: a.pop("multipliers"), "multipliers"),
    ],
)
def test_odd_proofs_are_refused_in_one_line_even_under_right_sums(
    change, change_arrays, name, proof_path
):
    resealed(proof_path, change or (lambda data: None), change_arrays or (lambda arrays: None))
    with refuses(proof_path, name):
        read_evidence(proof_path)


def test_multipliers_that_prove_nothing_are_refused_and_never_raise(proved, proof_path):
    rows = proved[1].multipliers
    for table in (np.zeros_like(rows), -rows, rows[:, :-1], np.vstack([rows, rows])):
        write_certificate(proof_path, replace(proved[1], multipliers=table).of(proved[0]))
        assert not check_file(proof_path).accepted
