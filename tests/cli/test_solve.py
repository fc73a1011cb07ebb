"""`stancekit solve`: answers that hold on paper, in input order, and one line for whatever is wrong
with the input.
"""

import json

import cvxpy as cp
import numpy as np
import pytest

from stancekit.cli.console import out
from tests.refusals import assert_names

ANSWER = [
    "where",
    "status",
    "method",
    "residual_nm",
    "residual",
    "lower_bound",
    "seconds",
    "solves",
]
POSTURE = ["com_m", "rotation_rad", "toes_m", "forces_n"]


def violations(problem, answer):
    """How far an answer is off, term by term, from the numbers of the two files alone."""
    com, turn, toes, forces = (np.array(answer[name]) for name in POSTURE)
    count = len(problem["contacts"])
    assert (com.shape, turn.shape, toes.shape, forces.shape) == ((3,), (3,), (count, 3), (count, 3))
    weight = np.array([0.0, 0.0, -problem["mass_kg"] * problem["gravity_m_s2"]])
    skew = np.array([[0.0, -turn[2], turn[1]], [turn[2], 0.0, -turn[0]], [-turn[1], turn[0], 0.0]])
    found = {
        "force [N]": np.linalg.norm(forces.sum(axis=0) + weight),
        "moment [Nm]": np.linalg.norm(np.cross(toes, forces).sum(axis=0) + np.cross(com, weight)),
        "com [m]": np.linalg.norm(com - problem["com_nominal_m"]) - problem["com_radius_m"],
        "tilt [rad]": np.abs(turn).max() - problem["tilt_limit_rad"],
    }
    for contact, toe, force in zip(problem["contacts"], toes, forces, strict=True):
        n, reference = np.array(contact["normal"]), np.array(contact["shear_reference"])
        z = reference - (reference @ n) * n
        z = z / np.linalg.norm(z)
        f = np.array([force @ n, force @ np.cross(z, n), force @ z])
        units = f / problem["force_scale_n"]
        corners = np.array(contact["vertices_m"])
        sides = np.roll(corners, -1, axis=0) - corners
        inward = np.cross(n, sides) / np.linalg.norm(sides, axis=1, keepdims=True)
        inward = (
            inward * np.sign(np.einsum("ij,ij->i", inward, corners.mean(axis=0) - corners))[:, None]
        )
        leg = toe - com - (np.eye(3) + skew) @ contact["shoulder_m"]
        for name, value in {
            "cone [N]": np.hypot(f[1], f[2]) - contact["friction"] * f[0],
            "box": max((contact["force_min"] - units).max(), (units - contact["force_max"]).max()),
            "reach [m]": np.linalg.norm(leg) - contact["reach_m"],
            "plane [m]": abs((toe - corners.mean(axis=0)) @ n),
            "patch [m]": -np.einsum("ij,ij->i", inward, toe - corners).min(),
        }.items():
            found[name] = max(found.get(name, -np.inf), value)
    return found


# ------------------------------------------------------------------------------------------------------------
# answers


@pytest.mark.parametrize(
    "method", [("exact",), ("two-stage",), ("nlp",), ("micp", "--intervals", "2")]
)
@pytest.mark.parametrize("name", ["ground-3", "wall-3", "wall-5"])
def test_postures_hold_on_paper(method, name, sampled, write, stancekit):
    problems = sampled[name][2:4] if "micp" in method else sampled[name]
    ran = stancekit("solve", write("p.jsonl", *problems), "--method", *method, "--json")
    assert (ran.code, ran.err) == (0, "")
    assert len(ran.records) == len(problems)
    feasible = [
        (p, a) for p, a in zip(problems, ran.records, strict=True) if a["status"] == "feasible"
    ]
    assert len(feasible) >= len(problems) / 2
    for problem, answer in feasible:
        worst = violations(problem, answer)
        assert max(worst.values()) < 1e-4, worst  # N, Nm, m: 98 N stand on the feet
        assert answer["residual_nm"] == pytest.approx(worst["moment [Nm]"], abs=1e-9)


def test_methods_agree_and_only_proofs_say_no(sampled, write, stancekit):
    file = write("p.jsonl", *sampled["wall-3"])
    said = {
        method: [
            record["status"]
            for record in stancekit("solve", file, "--method", method, "--json").records
        ]
        for method in ("exact", "two-stage", "lift", "nlp")
    }
    assert set(said["exact"]) == {"feasible", "infeasible"}
    assert set(said["nlp"]) == {"feasible", "undecided"}
    for statuses in said.values():
        for exact, other in zip(said["exact"], statuses, strict=True):
            assert other in (exact, "undecided")


def test_an_answer_has_these_keys_and_no_others(sampled, write, stancekit):
    ran = stancekit("solve", write("p.jsonl", *sampled["wall-3"]), "--json")
    yes, no, trivial = (ran.records[index] for index in (0, 1, 5))
    assert list(yes) == [*ANSWER, *POSTURE, "details"]
    assert list(no) == list(trivial) == [*ANSWER, "details"]
    assert [record["method"] for record in (yes, no, trivial)] == ["exact"] * 3
    assert yes["residual_nm"] < 1e-6
    assert yes["lower_bound"] == 0.0
    assert (no["residual_nm"], no["residual"]) == (None, None)
    assert 1e-4 < no["lower_bound"] < 1.0
    assert trivial["lower_bound"] == 1e6
    assert all(0.0 < record["seconds"] < 60.0 for record in ran.records)


def answers(ran):
    return [
        {key: value for key, value in record.items() if key not in ("where", "seconds")}
        for record in ran.records
    ]


def test_one_problem_an_array_lines_and_standard_input_give_the_same(sampled, write, stancekit):
    problems = sampled["wall-3"][:3]
    lines = stancekit("solve", write("lines.jsonl", *problems), "--json")
    assert [record["where"] for record in lines.records] == [
        f"lines.jsonl line {number}" for number in (1, 2, 3)
    ]
    array = stancekit("solve", write("array.json", json.dumps(problems, indent=1)), "--json")
    assert [record["where"] for record in array.records] == [
        f"array.json[{index}]" for index in (0, 1, 2)
    ]
    windows = "\r\n".join(
        ["\ufeff" + json.dumps(problems[0]), "", *(json.dumps(p) for p in problems[1:]), ""]
    )
    dos = stancekit("solve", write("dos.jsonl", windows), "--json")
    assert [record["where"] for record in dos.records] == [
        f"dos.jsonl line {number}" for number in (1, 3, 4)
    ]
    typed = stancekit("solve", "-", "--json", stdin=json.dumps(problems).encode())
    assert [record["where"] for record in typed.records] == ["-[0]", "-[1]", "-[2]"]
    names = [write(f"ünï {index}.json", problem) for index, problem in enumerate(problems)]
    single = stancekit("solve", *names, "--json")
    assert [record["where"] for record in single.records] == names
    assert answers(lines) == answers(array) == answers(dos) == answers(typed) == answers(single)


def test_the_answers_go_to_a_file_whole(sampled, write, stancekit, tmp_path):
    file = write("p.jsonl", *sampled["wall-3"][:3])
    ran = stancekit("solve", file, "--json", "--out", "a.jsonl")
    assert (tmp_path / "a.jsonl").read_text() == ran.out
    assert "certificate" not in ran.out
    proved = stancekit("solve", file, "--json", "--certificate")
    assert [set(record.get("certificate", ())) for record in proved.records] == [
        set(),
        {"tree", "multipliers"},
        set(),
    ]


def test_the_table_says_everything_within_the_width(sampled, write, stancekit, monkeypatch):
    name = "a rather long name of a file [bold] in brackets.jsonl"
    problems = [*sampled["wall-3"][:2], sampled["wall-3"][0] | {"mass_kg": -1.0}]
    for columns in (60, 80, 120):
        monkeypatch.setattr(out, "width", columns)
        ran = stancekit("solve", write(name, *problems))
        assert ran.code == 2
        assert max(len(line) for line in ran.out.splitlines()) <= columns
        assert "…" not in ran.out
        assert "[bold]" in ran.out.replace("\n", "").replace(" ", "")
        for word in ("feasible", "infeasible", "invalid"):
            assert word in ran.out.split()


def test_learned_envelopes_decide_nothing_alone(sampled, write, envelopes, stancekit):
    file = write("p.jsonl", *sampled["wall-3"])
    alone = stancekit("solve", file, "--method", "p1", "--envelopes", envelopes, "--json").records
    assert {record["status"] for record in alone} <= {"undecided", "infeasible"}
    assert all(record["lower_bound"] == 1e6 for record in alone if record["status"] == "infeasible")
    assert all("margin" in record["details"] for record in alone)
    both = stancekit(
        "solve", file, "--method", "two-stage", "--envelopes", envelopes, "--json"
    ).records
    assert any(record["status"] == "feasible" for record in both)


def test_a_relaxation_may_be_projected(sampled, write, envelopes, stancekit):
    file = write("p.jsonl", *sampled["wall-3"])
    for method in (("p1", "--envelopes", envelopes), ("lift",)):
        named = stancekit(
            "solve", file, "--method", *method, "--projection", "scp", "--json"
        ).records
        stages = ("two-stage", *method[1:])
        assert [record["status"] for record in named] == [
            record["status"]
            for record in stancekit("solve", file, "--method", *stages, "--json").records
        ]


# ----------------------------------------------------------------------------------------------------------
# undecided


@pytest.mark.parametrize("method", ["exact", "nlp", "micp"])
def test_out_of_time_is_undecided(method, sampled, write, stancekit):
    file = write("p.jsonl", sampled["wall-3"][0])
    ran = stancekit("solve", file, "--method", method, "--time-limit-s", "1e-9", "--json")
    (record,) = ran.records
    assert (ran.code, record["status"], record["lower_bound"]) == (0, "undecided", 0.0)
    assert record["message"]


def test_a_solver_that_fails_is_undecided(sampled, write, stancekit, monkeypatch):
    def fail(*_, **__):
        raise cp.SolverError("no licence")

    monkeypatch.setattr(cp.Problem, "solve", fail)
    ran = stancekit("solve", write("p.json", sampled["wall-3"][0]), "--method", "micp", "--json")
    assert (ran.code, ran.records[0]["status"], ran.records[0]["claim"]) == (
        0,
        "undecided",
        "unknown",
    )


# ----------------------------------------------------------------------------------------------------------
# bad input


def contact(**changes):
    def spoil(problem):
        problem["contacts"][1] |= changes

    return spoil


def whole(**changes):
    def spoil(problem):
        problem |= changes

    return spoil


def without(key):
    def spoil(problem):
        del problem[key]

    return spoil


def on_patch(change):
    """Change the second contact by what ``change`` makes of its corners and its normal."""

    def spoil(problem):
        here = problem["contacts"][1]
        here |= change(np.array(here["vertices_m"]), np.array(here["normal"]))

    return spoil


UNIT = "contacts[1].normal: expected a unit vector, got length "
SHAPE = "vertices_m: expected a "


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (whole(colour="red"), "colour: unknown key"),
        (without("mass_kg"), "mass_kg: expected this key, got nothing"),
        (contact(colour="red"), "contacts[1].colour: unknown key"),
        (whole(mass_kg=0.0), "mass_kg: expected a number above 0, got 0"),
        (whole(mass_kg=-3.0), "mass_kg: expected a number above 0, got -3"),
        (whole(mass_kg=1e300), "mass_kg: expected magnitudes up to 1e+06, got 1e+300"),
        (whole(mass_kg=float("nan")), "expected numbers as JSON has them, got NaN"),
        (whole(gravity_m_s2=float("inf")), "expected numbers as JSON has them, got Infinity"),
        (whole(com_nominal_m=[0.0, 0.0]), "com_nominal_m: expected shape (3,), got (2,)"),
        (whole(com_radius_m=-0.1), "com_radius_m: expected a number in [0, 1e+06], got -0.1"),
        (whole(tilt_limit_rad=2.0), "tilt_limit_rad: expected a number in [0, 1.5708], got 2"),
        (contact(friction=-0.5), "contacts[1].friction: expected a number in [0, 1e+06], got -0.5"),
        (contact(reach_m=0.0), "contacts[1].reach_m: expected a number above 0, got 0"),
        (contact(leg="XX"), "contacts[1].leg: expected one of LF, LM, LR, RF, RM, RR, got 'XX'"),
        (contact(leg="RF"), "contacts: expected every leg once, got ['RF', 'RF', 'LM']"),
        (contact(normal=[0.0, 0.0, 0.0]), UNIT + "0"),
        (contact(normal=[0.0, 2.0, 0.0]), UNIT + "2"),
        (
            contact(force_min=[2.0, 0.0, 0.0]),
            "contacts[1].force_min: expected at most force_max [1.0, 1.0, 1.0], got [2.0, 0.0, 0.0]",
        ),
        (contact(force_max=[1.0] * 4), "contacts[1].force_max: expected shape (3,), got (4,)"),
        (
            contact(vertices_m=[[0.0, 0.0]] * 3),
            "contacts[1].vertices_m: expected shape (any, 3), got (3, 2)",
        ),
        (
            contact(vertices_m=[[0.0, 0.0, 0.0]] * 2),
            "contacts[1].vertices_m: expected 3 or more vertices, got 2",
        ),
        (
            on_patch(lambda v, n: {"vertices_m": [v[0].tolist()] * 3}),
            f"contacts[1].{SHAPE}patch with an area, got one of diameter 0 m",
        ),
        (
            on_patch(
                lambda v, n: {
                    "vertices_m": [*v.tolist(), ((v[0] + 2.0 * v.mean(axis=0)) / 3.0).tolist()]
                }
            ),
            f"contacts[1].{SHAPE}convex polygon, its vertices in order around the border",
        ),
        (
            on_patch(lambda v, n: {"shear_reference": n.tolist()}),
            "contacts[1].shear_reference: expected a direction not along the normal, got ",
        ),
        (
            on_patch(
                lambda v, n: {"vertices_m": [*v.tolist(), (v[0] + v[2] - v[1] + 0.1 * n).tolist()]}
            ),
            f"contacts[1].{SHAPE}plane with the given normal, got vertices ",
        ),
    ],
)
def test_a_bad_problem_is_one_line_and_the_others_are_answered(
    spoil, message, problem, sampled, write, stancekit
):
    good = sampled["wall-3"][0]
    spoil(problem)
    ran = stancekit("solve", write("p.jsonl", good, problem, good), "--json")
    assert ran.code == 2
    assert [record["status"] for record in ran.records] == ["feasible", "invalid", "feasible"]
    assert ran.err.count("\n") == 1
    assert ran.err.startswith(f"stancekit: error: p.jsonl line 2: {message}")
    assert message.endswith(" ") or ran.err == f"stancekit: error: p.jsonl line 2: {message}\n"
    assert ran.records[1] == {
        "where": "p.jsonl line 2",
        "status": "invalid",
        "error": ran.err.removeprefix("stancekit: error: ").removesuffix("\n"),
    }


def test_everything_wrong_with_a_problem_is_said_at_once(problem, write, stancekit):
    del problem["mass_kg"]
    problem["contacts"][0]["friction"] = "high"
    problem["contacts"][2]["colour"] = "red"
    (record,) = stancekit("solve", write("p.json", problem), "--json").records
    for words in (
        "mass_kg: expected this key",
        "contacts[0].friction: ",
        "contacts[2].colour: unknown key",
    ):
        assert words in record["error"]


@pytest.mark.parametrize("form", ["stancekit/posture/2", "stancekit/envelope/1", 1])
def test_another_format_is_refused(form, problem, write, stancekit):
    (record,) = stancekit("solve", write("p.json", problem | {"format": form}), "--json").records
    assert record["error"].startswith("p.json: format: ")
    assert "stancekit/posture/1" in record["error"]
    assert repr(form) in record["error"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "f: expected some text, the file is empty"),
        (" \n\t\n", "f: expected some text, the file is empty"),
        (
            "{",
            "f: expected JSON, broken at line 1 column 2: Expecting property name enclosed in double quotes",
        ),
        ("[]", "f: expected one or more problems, got an empty array"),
        (
            "3",
            "f: expected a JSON object with format 'stancekit/posture/1' or 'stancekit/course/1', got int",
        ),
        (
            "null",
            "f: expected a JSON object with format 'stancekit/posture/1' or 'stancekit/course/1', got NoneType",
        ),
        ('{"mass_kg": 1, "mass_kg": 2}', "f: mass_kg: expected this key once, got it 2 times"),
        (b"\xff\xfe{\x00}\x00", "f: expected UTF-8 text, byte 0 is not"),
        (bytes(range(256)), "f: expected UTF-8 text, byte 128 is not"),
        ("[" * 100_000, "f: expected JSON: "),
        ("9" * 10_000, "f: expected JSON: "),
    ],
)
def test_a_bad_file_is_one_line_and_the_others_are_answered(
    content, message, sampled, write, stancekit
):
    ran = stancekit(
        "solve", write("f", content), write("good.json", sampled["wall-3"][0]), "--json"
    )
    assert ran.code == 2
    assert [record["status"] for record in ran.records] == ["invalid", "feasible"]
    assert ran.err.count("\n") == 1
    assert ran.records[0]["error"].startswith(message)
    assert message.endswith(" ") or ran.records[0]["error"] == message


def test_a_broken_line_is_told_by_its_number(sampled, write, stancekit):
    good = json.dumps(sampled["wall-3"][0])
    for lines in ((good, "{", good), ("{", good, good), (good, "{")):
        ran = stancekit("solve", write("p.jsonl", "\n".join(lines)), "--json")
        found = [record["status"] for record in ran.records]
        assert found == ["feasible" if line == good else "invalid" for line in lines]
        assert (
            f"p.jsonl line {found.index('invalid') + 1}: expected JSON, broken at line 1 column 2"
            in ran.err
        )


def test_what_is_no_file_is_told(stancekit, tmp_path):
    (tmp_path / "folder").mkdir()
    ran = stancekit("solve", "none.json", "folder", "-", "a" * 300, "--json")
    assert ran.code == 2
    assert [record["error"] for record in ran.records] == [
        "none.json: expected a file, found nothing there",
        "folder: expected a file, found a folder",
        "-: expected JSON on standard input, got nothing",
        "a" * 300 + ": expected a file, found nothing there",
    ]
    assert ran.err == "".join(f"stancekit: error: {record['error']}\n" for record in ran.records)


def test_control_characters_never_reach_the_terminal(problem, write, stancekit, refusals_met):
    ran = stancekit("solve", write("p.json", problem | {"a\nb\x1b[31m[red]": 1}))
    assert ran.err == "stancekit: error: p.json: a b?[31m[red]: unknown key\n"
    refusals_met.clear()  # the error itself holds the key as it is in the file, in two lines


# ------------------------------------------------------------------------------------------------------------
# options


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "FILE"),
        (
            ("p", "--time-limit-s", "0"),
            "--time-limit-s",
        ),
        (
            ("p", "--time-limit-s", "nan"),
            "--time-limit-s",
        ),
        (
            ("p", "--time-limit-s", "inf"),
            "--time-limit-s",
        ),
        (
            ("p", "--method", "p1"),
            "--envelopes",
        ),
        (
            ("p", "--method", "p1", "--relaxation", "foo"),
            "--relaxation",
        ),
        (
            ("p", "--method", "micp", "--intervals", "65"),
            "--intervals",
        ),
        (
            ("p", "--method", "micp", "--intervals", "3"),
            "--intervals",
        ),
        (
            ("p", "--method", "micp", "--intervals", "0"),
            "--intervals",
        ),
        (("p", "--intervals", "8"), "--intervals"),
        (("p", "--solver", "scip"), "--solver"),
        (
            ("p", "--projection", "fix-p"),
            "--projection",
        ),
        (
            ("p", "--envelopes", "e"),
            "--envelopes",
        ),
        (("p", "--method", "p1", "--envelopes", "e"), "e"),
        (("p", "--out", "none/a"), "none/a"),
        (("p", "--out", "."), "."),
    ],
)
def test_a_bad_option_is_one_line(options, message, refusal, tmp_path):
    assert_names(refusal("solve", *options), message)


def test_a_method_that_is_none_is_answered_with_those_there_are(refusal):
    said = refusal("solve", "p.json", "--method", "magic")
    for word in ("'magic'", "--method", "exact", "p1", "lift", "micp", "nlp", "two-stage"):
        assert word in said


@pytest.mark.parametrize("method", ["p1", "two-stage", "micp"])
def test_an_envelope_of_another_class_is_refused(method, sampled, write, envelopes, stancekit):
    file = write("p.jsonl", sampled["ground-3"][0], sampled["wall-5"][0], sampled["wall-3"][0])
    ran = stancekit("solve", file, "--method", method, "--envelopes", envelopes, "--json")
    assert ran.code == 2
    assert [record["status"] == "invalid" for record in ran.records] == [True, True, False]
    on_ground, five_legs = (record["error"] for record in ran.records[:2])
    assert on_ground.startswith("p.jsonl line 1: contacts[0].normal: expected one within ")
    assert "for an envelope learned for wall-3, got one " in on_ground
    assert five_legs == (
        "p.jsonl line 2: contacts: expected legs ['RF', 'RR', 'LM'] for an envelope learned for wall-3, "
        "got ['RF', 'RM', 'RR', 'LF', 'LR']"
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "stancekit/envelope/9"}, "format: "),
        ({"envelopes": []}, "envelopes: "),
        ({"legs": ["RF", "RR"]}, "normals: expected shape (2, 3), got (3, 3)"),
        ({"colour": "red"}, "colour: unknown key"),
    ],
)
def test_a_bad_envelope_file_is_one_line(change, message, envelopes, write, refusal):
    name = write("e.json", json.loads(envelopes.read_text()) | change)
    assert refusal("solve", "p.json", "--method", "p1", "--envelopes", name).startswith(
        f"e.json: {message}"
    )
