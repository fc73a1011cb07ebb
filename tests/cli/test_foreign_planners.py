"""Planners of one's own that lie, change what they are given, return anything, raise or print: one
line at most, and nothing comes out of them as an answer that the verifier did not accept.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import stancekit as library
from stancekit.planners.answer.certificate import Certificate
from stancekit.planners.answer.plan import Plan
from stancekit.planners.formats.plan_file import answer_from_json
from stancekit.planners.problem import Problem
from stancekit.planners.search import methods
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import assert_names

LIARS = '''
"""Each is asked about one problem, and answers another."""
import sys
from dataclasses import replace
import numpy as np
import stancekit
from stancekit.planners.search.exact import ExactPlanner
from stancekit.planners.search.two_stage import TwoStagePlanner

def easier(problem):
    contacts = (replace(c, patch=c.patch.with_friction(c.patch.friction + 3.0), reach_m=3.0 * c.reach_m)
                for c in problem.contacts)
    return problem.posture_with(contacts=tuple(contacts), com_radius_m=0.5)

def harder(problem):
    return problem.posture_with(contacts=tuple(replace(c, reach_m=0.01) for c in problem.contacts))

def changed(subject, into):
    vars(subject).clear()
    vars(subject).update(vars(into))
    return into

class Planner:
    def __init__(self, options):
        self.options = options

class Dreams(Planner):
    def solve(self, problem):
        return ExactPlanner().solve(easier(problem))

class GivesUp(Planner):
    def solve(self, problem):
        return ExactPlanner().solve(harder(problem)).certificate

class MakesEasier(Planner):
    def solve(self, problem):
        return ExactPlanner().solve(changed(problem, easier(problem)))

class MakesHarder(Planner):
    def solve(self, problem):
        return ExactPlanner().solve(changed(problem, harder(problem)))

class WritesArrays(Planner):
    def solve(self, problem):
        for contact in problem.contacts:
            for array in (contact.force_max, contact.patch.vertices_m):
                array.setflags(write=True)
                array *= 0.5
        return ExactPlanner().solve(problem)

class Tolerant(Planner):
    def solve(self, problem):
        object.__setattr__(self.options.acceptance, "tolerance", 1e9)
        object.__setattr__(self.options.acceptance, "gap", -1e9)
        return Dreams(self.options).solve(problem)

class Late(Planner):
    """Its posture is another one every other time that it is looked at."""
    def solve(self, problem):
        found = ExactPlanner().solve(problem).solution
        class Shifting(stancekit.Plan):
            def to_json(self):
                return {**stancekit.Plan.to_json(self), "com_m": [0.0, 0.0, 9.0]}
        return found and Shifting(**{name: value for name, value in vars(found).items()})

class EasierCourse(Planner):
    """It changes the course that it is given, and the plan is good for what that is now."""
    def solve(self, course):
        def gripping(patch):
            return patch.with_friction(patch.friction + 3.0)
        puts = tuple(replace(p, candidates=tuple(map(gripping, p.candidates))) for p in course.footholds)
        rough = replace(course, terrain=tuple(map(gripping, course.terrain)), footholds=puts)
        return TwoStagePlanner().solve(changed(course, rough)).solution
'''
GARBAGE = """
import sys
import numpy as np
import stancekit
from stancekit.planners.answer.answer import Answer

def returning(thing):
    class Planner:
        def __init__(self, options):
            pass
        def solve(self, problem):
            return thing() if callable(thing) else thing
    return Planner

def raising(error):
    def wrong():
        raise error
    return returning(wrong)

def said(**words):
    return returning(stancekit.Answer(**{"status": stancekit.Status.UNDECIDED, "method": "mine", **words}))

def told(**words):
    return returning(Answer(**{"status": stancekit.Status.UNDECIDED, "method": "mine", **words}))

class Wordless(Exception):
    def __str__(self):
        raise ValueError

Text, Number, Table = returning("feasible"), returning(5), returning({"status": "feasible"})
Empty, EmptyPosture = (returning(object.__new__(kind)) for kind in (stancekit.Answer, stancekit.Plan))
Raises, Leaves, LeavesQuietly = raising(ValueError("so\\nit is")), raising(SystemExit("bye")), raising(SystemExit(0))
Piped, Deep, Silent = raising(BrokenPipeError("pipe")), raising(RecursionError("deep")), raising(Wordless())
PostureText, ProofNumber, StatusText = said(solution="here"), said(certificate=3), said(status="maybe")
Message, Claim, Details, Solves = said(message=object()), said(claim=b"x"), said(details={"a": []}), said(
    effort=stancekit.Effort(solves="x")
)
CourseMessage, CourseProof = told(message=object()), told(certificate="no")
Blank = returning(object.__new__(stancekit.Plan))

class Prints(returning(None)):
    def solve(self, problem):
        print('{"status": "feasible"}')

class Solveless:
    def __init__(self, options):
        pass

class Unmakeable:
    def __init__(self, options):
        raise KeyError("mine")

def leaves(options):
    sys.exit(0)

def nothing(options):
    return None

def wants_nothing():
    pass
"""
SHORT = "walls", "--frames", 2


@pytest.fixture
def liars(tmp_path: Path) -> str:
    (tmp_path / "liars.py").write_text(LIARS)
    return "liars.py"


@pytest.fixture
def garbage(tmp_path: Path) -> str:
    (tmp_path / "garbage.py").write_text(GARBAGE)
    return "garbage.py"


@pytest.mark.parametrize(
    "name", ["Dreams", "GivesUp", "MakesEasier", "MakesHarder", "WritesArrays", "Tolerant", "Late"]
)
def test_whatever_a_planner_does_an_answer_is_one_to_the_problem_that_was_asked(
    name, liars, stancekit, write, sampled
):
    problems = [Problem.from_json(item) for item in sampled["wall-3"][:6]]
    ran = stancekit(
        "solve",
        write("p.jsonl", *sampled["wall-3"][:6]),
        "--method",
        f"{liars}:{name}",
        "--certificate",
        "--json",
    )
    assert (ran.code, ran.err, len(ran.records)) == (0, "", 6)
    truth = [library.solve(problem).status.value for problem in problems]
    assert {"feasible", "infeasible"} <= set(truth)
    for problem, line, true in zip(problems, ran.records, truth, strict=True):
        assert line["status"] in (true, "undecided")
        answer = answer_from_json(line, problem)
        if line["status"] == "feasible":
            assert isinstance(answer, Plan)
            assert check_plan(answer).accepted
        elif line["status"] == "infeasible":
            assert isinstance(answer, Certificate)
            assert check_certificate(answer).accepted
        assert problem.to_json() in sampled["wall-3"][:6]
    if name == "Late":
        assert "feasible" in [line["status"] for line in ran.records]


def test_a_planner_that_changes_its_course_plans_for_none_that_was_asked_for(liars, stancekit):
    ran = stancekit(
        "plan", "icy-walls", "--frames", 3, "--planner", f"{liars}:EasierCourse", "--json"
    )
    assert (ran.code, ran.records[0]["status"]) == (1, "undecided")
    assert ran.records[0]["message"].startswith("plan refused: rejected: ")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Text", "expected an Answer, a Plan, a Certificate or None, got a str, 'feasible'"),
        ("Number", "expected an Answer, a Plan, a Certificate or None, got a int, 5"),
        ("Table", "expected an Answer, a Plan, a Certificate or None, got a dict, "),
        ("Empty", "AttributeError: 'Answer' object has no attribute "),
        ("EmptyPosture", "AttributeError: 'Plan' object has no attribute "),
        ("Raises", "ValueError: so it is"),
        ("Leaves", "SystemExit: bye"),
        ("LeavesQuietly", "SystemExit: 0"),
        ("Piped", "BrokenPipeError: pipe"),
        ("Deep", "RecursionError: deep"),
        ("Silent", "Wordless: "),
        ("PostureText", "expected a Plan as evidence, got a str, 'here'"),
        ("ProofNumber", "expected a Certificate as evidence, got a int, 3"),
        ("StatusText", "ValueError: 'maybe' is not a valid Status"),
        ("Message", "expected text in its outcome, got a object, "),
        ("Claim", "expected text in its outcome, got a bytes, "),
        ("Details", "TypeError: float() argument must be "),
        ("Solves", "ValueError: invalid literal for int()"),
        ("Solveless", "expected something with solve, got a Solveless, "),
        ("nothing", "expected something with solve, got a NoneType, None"),
        ("Unmakeable", "KeyError: 'mine'"),
        ("leaves", "SystemExit: 0"),
        ("wants_nothing", "expected something to call with PlannerOptions, got <function wan"),
    ],
)
def test_a_planner_that_is_none_is_one_line(name, said, garbage, stancekit, write, problem):
    ran = stancekit("solve", write("p.json", json.dumps(problem)), "--method", f"{garbage}:{name}")
    where = "" if "p.json" not in ran.err else "p.json: "
    assert ran.code == 2
    assert ran.err.startswith(f"stancekit: error: {where}method {garbage}:{name}: {said}")
    assert ran.err.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Text", "expected an Answer, a Plan, a Certificate or None, got a str, 'feasible'"),
        ("Blank", "AttributeError: 'Plan' object has no attribute "),
        ("CourseMessage", "expected text in its outcome, got a object, "),
        ("CourseProof", "expected a Certificate as evidence, got a str, 'no'"),
        ("Raises", "ValueError: so it is"),
        ("LeavesQuietly", "SystemExit: 0"),
        ("Solveless", "expected something with solve, got a Solveless, "),
        ("leaves", "SystemExit: 0"),
    ],
)
def test_a_planner_of_courses_that_is_none_is_one_line(name, said, garbage, refusal):
    assert refusal("plan", *SHORT, "--planner", f"{garbage}:{name}").startswith(
        f"planner {garbage}:{name}: {said}"
    )


def test_what_a_planner_prints_is_no_result(garbage, stancekit, write, problem):
    ran = stancekit(
        "solve", write("p.json", json.dumps(problem)), "--method", f"{garbage}:Prints", "--json"
    )
    assert [line["status"] for line in ran.records] == ["undecided"]
    assert ran.err == '{"status": "feasible"}\n'


def test_a_file_that_ends_the_program_is_one_line(refusal, write, problem, tmp_path):
    (tmp_path / "quits.py").write_text("raise SystemExit(0)\n")
    asked = ("solve", write("p.json", json.dumps(problem)), "--method", "quits.py:Planner")
    assert_names(refusal(*asked), "quits.py")


@pytest.mark.parametrize(("said", "claim"), [("", "feasible"), ("optimal", "optimal")])
def test_who_takes_over_a_name_of_the_package_is_verified_like_any_other(
    monkeypatch, problem, said, claim
):
    class Boaster:
        def __init__(self, options):
            pass

        def solve(self, problem):
            return library.Answer(status=library.Status.FEASIBLE, method="exact", claim=said)

    monkeypatch.setitem(methods.PLANNERS._things, "exact", Boaster)
    outcome = library.solve(Problem.from_json(problem), "exact")
    assert (outcome.status, outcome.claim) == (library.Status.UNDECIDED, claim)
