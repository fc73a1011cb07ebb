"""`stancekit evaluate`: shares that can be counted again, in a table that fits every terminal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from stancekit.cli.console import out
from stancekit.cli.fit import score_table
from stancekit.cli.run import loop_table, unused
from stancekit.learners.evaluation.evaluate import TABLE_I, Score, Share
from stancekit.learners.selectors.network import Architecture, BoxNetwork
from stancekit.learners.selectors.neural import NeuralSelector
from stancekit.motions import policy_of
from stancekit.planners.formats.question_file import write_boxes
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.relaxation.envelope import expert_envelopes
from stancekit.runner.control.closed_loop import LoopReport
from stancekit.runner.control.envelope_choice import Observation
from stancekit.runner.control.estimation import FrictionInterval
from stancekit.runner.safety.guard import Ended
from tests.refusals import assert_names, refuses

SHARES = ("p1_feasible", "p1_infeasible", "project_fix_p", "project_scp")


def test_the_rows_are_shares_with_their_intervals(stancekit, labelled, envelopes):
    ran = stancekit(
        "evaluate", labelled, "--envelopes", envelopes, "--projection", "fix-p", "scp", "--json"
    )
    assert (ran.code, ran.err) == (0, "")
    assert [record["selector"] for record in ran.records] == ["heuristic", "lift"]
    for record in ran.records:
        for name in SHARES:
            assert record[f"{name}_of"] == 8
            assert (8 * record[name]).is_integer()
            low, high = record[f"{name}_interval"]
            assert -1e-12 <= low <= record[name] <= high <= 1.0 + 1e-12
        assert record["project_fix_p"] <= record["project_scp"] <= record["p1_feasible"]
    assert ran.records[1]["p1_feasible"] == 1.0


def test_a_comparison_is_a_markdown_table_and_a_picture(stancekit, labelled, envelopes, tmp_path):
    asked = ("evaluate", labelled, "--envelopes", envelopes, "--projection", "fix-p", "--markdown")
    ran = stancekit(*asked, "--picture", tmp_path / "shares.png")
    rows = [line for line in ran.out.splitlines() if line.startswith("|")]
    assert {row.split("|")[2].strip() for row in rows} >= {"selector", "heuristic", "lift"}
    assert len({row.count("|") for row in rows}) == 1
    assert (tmp_path / "shares.png").read_bytes().startswith(b"\x89PNG")
    assert stancekit(*asked, "--picture", "shares.txt").code == 2


def test_shares_agree_with_solve(stancekit, labelled, envelopes, write):
    from stancekit.envs.data.dataset import Dataset

    data = Dataset.open(labelled)
    file = write("p.jsonl", *(data.row(index).problem.to_json() for index in data.feasible))
    solved = stancekit(
        "solve", file, "--method", "two-stage", "--envelopes", envelopes, "--json"
    ).records
    projected = ("--projection", "scp", "--no-lift", "--json")
    (row,) = stancekit("evaluate", labelled, "--envelopes", envelopes, *projected).records
    assert row["project_scp"] == sum(record["status"] == "feasible" for record in solved) / len(
        solved
    )


def test_a_projection_named_twice_counts_once(stancekit, labelled):
    once = stancekit("evaluate", labelled, "--projection", "scp", "--json").records
    twice = stancekit("evaluate", labelled, "--projection", "scp", "scp", "--json").records
    assert [{**row, "p1_ms": 0} for row in once] == [{**row, "p1_ms": 0} for row in twice]


def some_scores():
    ways = ("fix-p", "fix-f", "fix-toes", "scp", "nlp")
    names = (
        "gmm-printed",
        "lift",
        "none",
        "[red]brackets",
        "a name that is far too long for any table of the world",
    )
    for name, hits in zip(names, (187, 300, 0, 5, 150), strict=True):
        share = Share(hits=hits, of=300)
        yield Score(
            selector=name,
            p1_feasible=share,
            p1_infeasible=share,
            projected=dict.fromkeys(ways, share),
        )


@pytest.mark.parametrize("columns", [40, 80, 120, 200])
@pytest.mark.parametrize("problem_class", [*TABLE_I, "another class"])
def test_the_table_loses_nothing_in_any_terminal(
    columns, problem_class, stancekit, capsys, monkeypatch
):
    monkeypatch.setenv("COLUMNS", str(columns))
    out.print(score_table(problem_class, list(some_scores())))
    said = capsys.readouterr().out
    assert "…" not in said
    assert max(len(line) for line in said.splitlines()) <= 80
    for words in (
        "62.3±5",
        "100.0±1",
        "0.0±1",
        "[red]brackets",
        "fix-toes",
        "infeas.",
        "300 feasible and 300 infeasible",
    ):
        assert words in " ".join(said.split()), words
    assert ("paper: cluster" in said) == (problem_class in TABLE_I)


def test_the_usual_table_fits_into_80_columns(stancekit, labelled, envelopes):
    ran = stancekit("evaluate", labelled, "--envelopes", envelopes)
    assert (ran.code, ran.err) == (0, "")
    lines = ran.out.splitlines()
    assert max(len(line) for line in lines) <= 80
    assert [line.split()[0] for line in lines[2:] if "±" in line] == ["heuristic", "lift"]
    assert sum(line.startswith("paper: ") for line in lines) == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ("--no-lift",),
            "--selector",
        ),
        (("--projection",), "--projection"),
        (("--envelopes", "none.json"), "none.json"),
        (("--workers", "0"), "workers"),
    ],
)
def test_bad_options_are_one_line(options, message, refusal, labelled):
    assert_names(refusal("evaluate", labelled, *options), message)


def test_envelopes_of_another_class_are_refused(refusal, labelled, envelopes, write):
    other = json.loads(Path(envelopes).read_text()) | {"problem_class": "ground-3"}
    said = refusal("evaluate", labelled, "--envelopes", write("e.json", other))
    assert_names(said, "e.json", "wall-3", "ground-3")


def test_a_data_set_of_nothing_but_trivial_rows_is_refused(refusal, stancekit):
    draw = ("--natural", "--feasible", "1", "--infeasible", "0", "--seed", "6", "--workers", "1")
    (summary,) = stancekit("label", "wall-3", "data", *draw, "--json").records
    assert summary["rows"]["trivial"] == 1
    assert_names(refusal("evaluate", "data"), "data")
    assert_names(refusal("evaluate", "none"), "none")


def test_rows_that_were_trained_on_are_refused_and_the_other_part_is_not(
    stancekit, refusal, labelled
):
    stancekit("fit", labelled, "--method", "quantile", "--part", "train", "--out", "q.json")
    for part in ("all", "train"):
        assert_names(
            refusal("evaluate", labelled, "--envelopes", "q.json", "--part", part), "q.json"
        )
    ran = stancekit(
        "evaluate", labelled, "--envelopes", "q.json", "--part", "test", "--no-lift", "--json"
    )
    assert (ran.code, len(ran.records)) == (0, 1)


def test_a_selector_that_ships_goes_by_its_name_and_is_refused_for_another_class(
    stancekit, refusal, labelled
):
    ran = stancekit(
        "evaluate",
        labelled,
        "--selector",
        "neural-wall-3",
        "--projection",
        "fix-p",
        "--no-lift",
        "--json",
    )
    assert [(row["selector"], row["p1_feasible_of"]) for row in ran.records] == [
        ("neural-wall-3", 8)
    ]
    assert_names(refusal("evaluate", labelled, "--selector", "neural-ground-3"), "neural-ground-3")


COURSE = read_course("walls", frames=3)
EXPERT = expert_envelopes("wall")


def write_selector(kind: str, path: Path, problem: str = "wall-3") -> None:
    """A selector that was not trained: what it chooses is poor, and a box all the same."""
    torch.manual_seed(0)
    small = Architecture(width=8, layers=1)
    if kind == "envelope":
        write_boxes(path, EXPERT)
    else:
        NeuralSelector(
            BoxNetwork(small),
            problem_class=problem,
            legs=EXPERT.legs,
            force_scale_n=EXPERT.force_scale_n,
            length_scale_m=EXPERT.length_scale_m,
        ).save(path)


@pytest.mark.parametrize("kind", ["envelope", "neural"])
def test_any_selector_s_file_is_a_policy_whose_plans_are_verified(
    kind: str, tmp_path: Path
) -> None:
    path = tmp_path / ("selector.json" if kind == "envelope" else "selector.safetensors")
    write_selector(kind, path)
    policy = policy_of(str(path), COURSE)
    assert policy.learned.legs == EXPERT.legs
    seen = Observation(window=COURSE, standing=None, state=None, friction_share=1.0, frame=0)
    assert policy(seen).solve(COURSE).solution is not None
    assert sum(policy.answers) == 1
    if kind == "envelope":
        assert policy.answers == (1, 0)


def test_boxes_that_are_for_p1_joined_with_the_lift_are_refused(tmp_path: Path) -> None:
    NeuralSelector(
        BoxNetwork(Architecture(width=16, layers=1, heads=2, corner_width=8)),
        problem_class=EXPERT.problem_class,
        legs=EXPERT.legs,
        force_scale_n=1.0,
        length_scale_m=1.0,
        relaxation="joint",
    ).save(tmp_path / "joint.safetensors")
    with refuses("selector"):
        policy_of(str(tmp_path / "joint.safetensors"), COURSE)


def test_the_lift_needs_no_selector() -> None:
    assert policy_of("lift", COURSE) is None


def test_selectors_that_do_not_fit_are_refused_with_their_file(tmp_path: Path) -> None:
    path = tmp_path / "five.json"
    write_boxes(path, expert_envelopes("wall", legs=("RF", "RM", "RR", "LF", "LR")))
    with refuses("five.json", "policy"):
        policy_of(str(path), COURSE)
    with refuses("none.json"):
        policy_of(str(tmp_path / "none.json"), COURSE)
    path = tmp_path / "strange.safetensors"
    write_selector("neural", path, problem="moon-3")
    with refuses("strange.safetensors", "distribution"):
        policy_of(str(path), COURSE)


@pytest.mark.parametrize(("answers", "said"), [((0, 3), True), ((0, 0), True), ((1, 2), False)])
def test_a_run_to_which_the_policy_gave_no_plan_is_a_warning(
    answers: tuple[int, int], said: bool
) -> None:
    report = LoopReport(
        succeeded=True,
        message="",
        ended=Ended(left="held", message="", seconds=0.0),
        plans=3,
        replans=0,
        frames=4,
        friction=FrictionInterval(),
        planned_share=1.0,
        surfaces="",
        com_final_m=0.0,
        deviation_m=0.0,
        seconds=1.0,
        plan_s=0.1,
        wall_s=1.0,
    )
    assert ("warning" in list(loop_table(report, answers).columns[0].cells)) == said
    warned = f"the policy made none of the {answers[1]} plans that were made"
    assert unused(answers).startswith(warned)
