"""Plan files: the same to the last bit when read back, and refused in one line after any change."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
import stat
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stancekit.envs.distributions.postures import distribution
from stancekit.planners.answer.answer import UNBOUNDED, Answer, Status
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.answer.plan import Plan
from stancekit.planners.answer.report import plan_arrays, plan_digest
from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import parse_json, read_text
from stancekit.planners.files.writing import write_bytes, write_text
from stancekit.planners.formats.plan_file import (
    answer_from_json,
    check_file,
    is_plan_file,
    json_records,
    read_envelopes,
    read_plan,
    read_problems,
    write_plan,
)
from stancekit.planners.problem import Problem
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.two_stage import TwoStagePlanner
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import assert_names, refuses


def refusal(call, *values):
    with pytest.raises(InvalidInput) as error:
        call(*values)
    assert "\n" not in str(error.value)
    return str(error.value)


# ------------------------------------------------------------------------------------------------------------
# reading


def test_what_is_no_text_file_is_named(tmp_path):
    file = tmp_path / "file.json"
    assert_names(refusal(read_text, file), file)
    assert_names(refusal(read_text, tmp_path), tmp_path)
    file.write_bytes(b"")
    assert_names(refusal(read_text, file), file)
    file.write_bytes(b" \n\t\n")
    assert_names(refusal(read_text, file), file)
    file.write_bytes(b'{"a": "\xff"}')
    assert_names(refusal(read_text, file), file)
    file.write_text('{"a": "ü"}', encoding="utf-8")
    assert read_text(file) == read_text(str(file)) == '{"a": "ü"}'


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


def test_a_broken_first_line_does_not_keep_the_others_back():
    found = records('{"a": \n{"a": 2}\n{"a": 3}\n')
    assert found[1:] == [("f line 2", {"a": 2}), ("f line 3", {"a": 3})]


@pytest.mark.parametrize("separator", ["\u2028", "\u2029", "\u0085"])
def test_only_line_ends_end_a_line(separator):
    text = "\n".join(json.dumps({"a": f"x{separator}y"}, ensure_ascii=False) for _ in range(2))
    assert [item for _, item in records(text)] == [{"a": f"x{separator}y"}] * 2


@given(
    st.lists(
        st.dictionaries(st.text(max_size=5), st.floats(allow_nan=False, allow_infinity=False)),
        min_size=2,
        max_size=5,
    )
)
def test_lines_arrays_and_indented_arrays_hold_the_same(items):
    lines = "\r\n".join(json.dumps(item) for item in items)
    for text in (lines, json.dumps(items), json.dumps(items, indent=2)):
        assert [item for _, item in records(text)] == items


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
    exact, limited = ExactPlanner(programs=programs), ExactPlanner(programs=programs, max_nodes=0)
    found = {
        "feasible": (drawn("wall-3", 0), exact.solve(drawn("wall-3", 0))),
        "infeasible": (drawn("wall-3", 225), exact.solve(drawn("wall-3", 225))),
        "trivial": (drawn("wall-3", 4), exact.solve(drawn("wall-3", 4))),
        "undecided": (drawn("wall-3", 0), limited.solve(drawn("wall-3", 0))),
        "refused": (
            drawn("wall-3", 0),
            TwoStagePlanner(projection=None, programs=programs).solve(drawn("wall-3", 0)),
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
        assert isinstance(answer, Plan)
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
    assert isinstance(answer_from_json(WITNESS, ASKED), Plan)
    proof = Certificate(tree=[[0, 0, 0, 0, 0]], multipliers=np.ones((1, 9)))
    assert isinstance(
        answer_from_json({"certificate": proof.to_json(), **WITNESS}, ASKED), Certificate
    )


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
