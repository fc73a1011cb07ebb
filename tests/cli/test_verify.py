"""`stancekit verify`: no claim passes without its evidence, and no evidence for another problem."""

import json
import sys
from pathlib import Path
from subprocess import run

import pytest

from tests.refusals import assert_names


@pytest.fixture
def pairs(stancekit, sampled, write):
    """Three problems, feasible, infeasible and feasible, and their answers with certificates."""
    problems = sampled["wall-3"][:3]
    write("problems.jsonl", *problems)
    assert (
        stancekit(
            "solve", "problems.jsonl", "--certificate", "--out", "answers.jsonl", "--json"
        ).code
        == 0
    )
    return problems


@pytest.fixture
def answers(pairs, tmp_path):
    return [json.loads(line) for line in (tmp_path / "answers.jsonl").read_text().splitlines()]


def verdicts(ran):
    return [record["verdict"] for record in ran.records]


def test_what_solve_wrote_is_accepted(pairs, stancekit):
    ran = stancekit("verify", "problems.jsonl", "answers.jsonl", "--json")
    assert (ran.code, ran.err) == (0, "")
    assert verdicts(ran) == ["accepted"] * 3
    assert [record["kind"] for record in ran.records] == ["posture", "certificate", "posture"]
    assert [record["where"] for record in ran.records] == [
        f"problems.jsonl line {number}" for number in (1, 2, 3)
    ]
    assert all(
        len(record["digest"]) == 64 and record["residual_nm"] < 1e-6 for record in ran.records[::2]
    )
    assert ran.records[1]["lower_bound"] > 1e-4
    assert ran.records[1]["leaves"] >= 1


def test_people_are_told_in_a_line_each(pairs, stancekit):
    ran = stancekit("verify", "problems.jsonl", "answers.jsonl")
    lines = ran.out.splitlines()
    assert (ran.code, len(lines)) == (0, 3)
    assert lines[0].startswith("problems.jsonl line 1: accepted: worst is ")
    assert lines[1].startswith("problems.jsonl line 2: accepted: refuted at all leaves (")
    message = stancekit("verify", "problems.jsonl", "answers.jsonl", "--explain").out.splitlines()
    assert message[0] == lines[0]
    assert message[1].startswith(lines[1] + "; infeasible: ")


def test_answers_and_problems_may_come_from_standard_input(pairs, stancekit, tmp_path):
    answers, problems = (
        (tmp_path / "answers.jsonl").read_bytes(),
        (tmp_path / "problems.jsonl").read_bytes(),
    )
    assert (
        verdicts(stancekit("verify", "problems.jsonl", "-", "--json", stdin=answers))
        == ["accepted"] * 3
    )
    assert (
        verdicts(stancekit("verify", "-", "answers.jsonl", "--json", stdin=problems))
        == ["accepted"] * 3
    )


def test_an_answer_to_another_problem_is_refused(pairs, answers, write, stancekit):
    write("turned.jsonl", answers[2], answers[1], answers[0])
    ran = stancekit("verify", "problems.jsonl", "turned.jsonl", "--json")
    assert (ran.code, verdicts(ran)) == (1, ["refused", "accepted", "refused"])
    write("feasible.json", pairs[0])
    ran = stancekit("verify", "feasible.json", write("no.json", answers[1]), "--json")
    assert (ran.code, verdicts(ran)) == (1, ["refused"])
    assert ran.records[0]["kind"] == "certificate"


def test_a_force_that_is_a_little_off_is_refused(pairs, answers, write, stancekit):
    answers[0]["forces_n"][0][2] += 0.01
    ran = stancekit("verify", "problems.jsonl", write("off.jsonl", *answers), "--json")
    assert (ran.code, verdicts(ran)) == (1, ["refused", "accepted", "accepted"])
    assert ran.records[0]["message"] == "worst is force_balance (z), off by 0.01 N"
    ran = stancekit("verify", "problems.jsonl", "off.jsonl", "--tolerance", "1e-3", "--json")
    assert (ran.code, verdicts(ran)) == (0, ["accepted"] * 3)


def test_a_claim_without_its_evidence_is_refused(pairs, answers, write, stancekit):
    del answers[1]["certificate"]
    bare = {"status": "feasible"}
    ran = stancekit(
        "verify",
        "problems.jsonl",
        write("a.jsonl", answers[0] | {"status": "infeasible"}, answers[1], bare),
    )
    assert ran.code == 1
    assert ran.out.splitlines() == [
        "problems.jsonl line 1: refused: it says infeasible and comes with a posture, expected a certificate "
        "(solve with --certificate)",
        "problems.jsonl line 2: refused: it says infeasible and comes with nothing, expected a certificate "
        "(solve with --certificate)",
        "problems.jsonl line 3: refused: it says feasible and comes with nothing, expected a posture",
    ]


def test_what_decides_nothing_is_told_apart(pairs, write, stancekit):
    file = write(
        "a.jsonl", *({"status": status} for status in ("undecided", "invalid", "undecided"))
    )
    ran = stancekit("verify", "problems.jsonl", file, "--json")
    assert (ran.code, verdicts(ran)) == (0, ["unclaimed"] * 3)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda answer: 3, "a.jsonl line 1: expected a JSON object, got int"),
        (
            lambda answer: {},
            "a.jsonl line 1: status: expected one of feasible, infeasible, undecided, invalid, got None",
        ),
        (
            lambda answer: {**answer, "status": "perhaps"},
            "a.jsonl line 1: status: expected one of ",
        ),
        (
            lambda answer: {k: v for k, v in answer.items() if k != "com_m"},
            "a.jsonl line 1: com_m: expected this key, got nothing",
        ),
        (
            lambda answer: {**answer, "com_m": "here"},
            "a.jsonl line 1: com_m, rotation_rad, toes_m, forces_n: expected lists of numbers",
        ),
        (
            lambda answer: {"status": "infeasible", "certificate": {"tree": []}},
            "a.jsonl line 1: certificate: expected an object with the keys tree and multipliers",
        ),
    ],
)
def test_a_bad_answer_is_one_line_and_the_others_are_checked(
    spoil, message, pairs, answers, write, stancekit
):
    ran = stancekit(
        "verify", "problems.jsonl", write("a.jsonl", spoil(answers[0]), *answers[1:]), "--json"
    )
    assert (ran.code, verdicts(ran)) == (2, ["invalid", "accepted", "accepted"])
    assert ran.err.count("\n") == 1
    assert ran.err.startswith(f"stancekit: error: {message}")
    assert ran.records[0]["message"] == ran.err.removeprefix("stancekit: error: ").removesuffix(
        "\n"
    )


def test_a_data_set_is_checked_against_itself(stancekit, labelled):
    ran = stancekit("verify", labelled, "--json")
    (report,) = ran.records
    assert ran.code == 0
    assert (report["accepted"], report["witnesses"], report["certificates"], report["refused"]) == (
        True,
        8,
        8,
        [],
    )
    assert "accepted         True" in stancekit("verify", labelled).out


def test_what_is_not_there_is_said_before_anything_is_imported_that_verifies():
    script = (
        "import sys\nfrom stancekit.cli.main import main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    print(end.code, 'stancekit.checks' in sys.modules)\n"
    )
    for files in (["none"], ["none", "neither"]):
        said = run(
            [sys.executable, "-c", script, "verify", *files],
            capture_output=True,
            text=True,
            check=False,
        )
        assert "found nothing there" in said.stderr
        assert said.stdout == "2 False\n"


def test_bad_input_is_one_line(refusal, pairs, labelled):
    assert_names(refusal("verify", "none"), "none")
    said = refusal("verify", "problems.jsonl")
    assert said.endswith(
        ": expected a data set folder, a plan, a proof or a gait; beside posture problems, the file of "
        "their answers (stancekit solve PROBLEMS --certificate --out ANSWERS)"
    )
    for content, message in (
        (b'{"a": NaN}', "NaN"),
        (b"\xff{", "expected UTF-8 text"),
        (b"[" * 100_000, ""),
    ):
        Path("damaged.json").write_bytes(content)
        said = refusal("verify", "damaged.json")
        assert said.startswith("damaged.json: ")
        assert message in said
        assert "answers after it" not in said
    assert_names(refusal("verify", "problems.jsonl", "none"), "none")
    for value in ("0", "1", "nan", "-1"):
        said = refusal("verify", "problems.jsonl", "answers.jsonl", "--tolerance", value)
        assert said.startswith("--tolerance: expected a number between 0 and 1, got ")
    for option in (("--tolerance", "0.1"), ("--explain",)):
        said = refusal("verify", labelled, *option)
        assert (
            said
            == f"{option[0]}: expected a file of answers with it, got a data set, which has its own plan"
        )


def test_there_is_one_answer_a_problem(refusal, pairs, answers, write):
    said = refusal("verify", "problems.jsonl", write("a.jsonl", *answers[:2]))
    assert said == "a.jsonl: expected 3 answers, one a problem, got 2"
