"""`stancekit plan`: a course in, a verified plan out, and one line for whatever is wrong."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from dataclasses import astuple
from importlib import resources
from itertools import islice
from pathlib import Path

import pytest
import yaml

from stancekit.planners.answer.answer import Answer, Status
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.motion_file import check_file
from stancekit.planners.problem.course_file import builtin_courses
from stancekit.planners.search.answer import Method
from stancekit.views.page import check_page
from stancekit.views.plans import PlanView
from tests.refusals import assert_names


@pytest.fixture
def plan(stancekit):
    """``plan("walls", "--json")``: exit code, standard output, standard error."""
    return lambda *arguments: astuple(stancekit("plan", *arguments))


def test_a_plan_is_written_verified_and_told(plan, tmp_path):
    code, out, err = plan("walls", "--frames", 3, "--out", "climb.json", "--picture", "climb.png")
    assert (code, err) == (0, "")
    assert "feasible" in out
    assert "groups within their limits; the last key frame is " in out
    assert out.endswith("wrote climb.json\nwrote climb.png\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["climb.json", "climb.png"]
    assert check_file(tmp_path / "climb.json", joints=False).accepted
    assert (tmp_path / "climb.png").read_bytes().startswith(b"\x89PNG")


def test_a_plan_keeps_a_reserve_of_friction_unless_told_not_to(plan):
    code, out, _ = plan("walls", "--frames", 2)
    assert code == 0
    assert "planned with 80 % of the friction" in out
    assert "planned with" not in plan("walls", "--frames", 2, "--no-reserve")[1]


def test_json_is_one_object_with_everything(plan):
    code, out, err = plan(
        "stairs", "--frames", 3, "--json", "--no-reserve", "--projection", "fix-toes"
    )
    assert (code, err, out.count("\n")) == (0, "", 1)
    record = json.loads(out)
    assert (record["course"], record["frames"], record["status"]) == ("stairs", 3, "feasible")
    assert record["bound"] <= record["objective"] + 1e-7
    assert record["verdict"]["accepted"] is True
    assert {group["group"] for group in record["verdict"]["groups"]} >= {
        "friction",
        "toe_step",
        "progress",
    }
    assert [len(row) for row in record["plan"]["com_m"]] == [3, 3, 3]
    assert len(record["plan"]["forces_n"][0]) == 6
    assert min(record["compile_s"], record["seconds"], record["solver_seconds"]) >= 0.0


@pytest.mark.parametrize("status", [Status.INFEASIBLE, Status.UNDECIDED])
def test_no_plan_is_exit_code_1_and_says_why(status, plan, monkeypatch, tmp_path):
    why = "frame 3, limb RF: reach fails by 0.12 m"

    class Refusing(Method):  # or its word would count as far as the verifier accepts it
        name = "two-stage"

        def solve(self, course):
            return Answer(status=status, method=self.name, problem=course, message=why)

    monkeypatch.setattr("stancekit.courses.make_planner", lambda *_, **__: Refusing())
    code, out, err = plan("walls", "--out", "climb.json")
    assert code == 1
    assert err == f"stancekit: no plan: walls: {why}\n"
    assert status.value in out
    assert not list(tmp_path.iterdir())
    code, out, _ = plan("walls", "--json")
    record = json.loads(out)
    assert (code, record["status"], record["message"]) == (1, status.value, why)
    assert record["objective"] is None
    assert "plan" not in record


def test_the_decoupled_planner_has_no_plan_on_ice_and_says_so(plan):
    code, out, err = plan("icy-walls", "--frames", 4, "--method", "decoupled")
    assert code == 1
    assert "decoupled" in out
    assert err.startswith("stancekit: no plan: icy-walls: ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("walls", "--frames", 0), "frames"),
        *(
            (("walls", f"--time-limit-s={limit}"), "--time-limit-s")
            for limit in (0, "nan", -1, "soon")
        ),
        (("walls", "--out", "a.txt"), "a.txt"),
        (("walls", "--out", "a.npz"), "a.npz"),
        (("walls", "--out", "none/a.json"), "none/a.json"),
        (
            ("walls", "--picture", "a.gif"),
            "a.gif",
        ),
        (("walls", "--video", "a.avi"), "a.avi"),
        (("walls", "--html", "a.txt"), "a.txt"),
        (
            ("walls", "--out", "a.json", "--proof", "a.json"),
            "--out",
        ),
        (
            ("walls", "--out", "a.json", "--proof", "../{here}/a.json"),
            "--out",
        ),
        (("walls", "--envelopes", "none"), "none"),
        (
            ("walls", "--relaxation", "p1"),
            "--envelopes",
        ),
        (
            ("walls", "--relaxation", "foo"),
            "--relaxation",
        ),
        (
            ("walls", "--method", "nlp", "--solver", "scip"),
            "--solver",
        ),
        (
            ("walls", "--method", "exact", "--projection", "fix-p"),
            "--projection",
        ),
        (
            ("walls", "--method", "micp", "--intervals", 128),
            "--intervals",
        ),
        (
            ("walls", "--wrench", "down"),
            "--wrench",
        ),
        (
            ("walls", "--wrench", "0,1"),
            "--wrench",
        ),
        (
            ("walls", "--wrench", "0,0,inf"),
            "--wrench",
        ),
        (
            ("walls", "--wrench", "0,0,-99999"),
            "--wrench",
        ),
    ],
)
def test_bad_input_is_one_line_before_any_work(arguments, message, refusal, tmp_path):
    assert_names(
        refusal("plan", *(str(one).format(here=tmp_path.name) for one in arguments)), message
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--goal", "0.3,0", "--frames", "0"), "--frames"),
        (("--goal", "0.3,0", "--frames", "1001"), "--frames"),
        (("--goal", "1e300,0"), "--goal"),
    ],
)
def test_a_way_over_a_terrain_is_of_sound_numbers(options, message, refusal, tmp_path):
    mesh = tmp_path / "square.obj"
    mesh.write_text("v -2 -2 0\nv 2 -2 0\nv 2 2 0\nv -2 2 0\nf 1 2 3\nf 1 3 4\n", encoding="utf-8")
    assert_names(refusal("plan", str(mesh), "--start", "-0.3,0", *options), message)


def test_a_proof_is_not_written_where_a_picture_or_a_page_goes(refusal):
    for option, name in (("--picture", "a.png"), ("--html", "a.html")):
        said = refusal("plan", "walls", "--proof", name, option, name)
        assert said == f"{option}: expected another file than --proof, got {name} for both"


def test_a_course_or_ground_that_there_is_not_names_those_that_there_are(refusal, tmp_path):
    said = refusal("plan", "nowhere")
    assert all(name in said for name in builtin_courses())
    (tmp_path / "course.yaml").write_text("terrain: {kind: stair}")
    assert "; terrain.kind: expected one of 'polygons'" in refusal("plan", "course.yaml")


def test_a_file_of_modes_that_is_none_is_told(refusal, tmp_path):
    (tmp_path / "modes.json").write_text('{"format": "stancekit/modes/1", "names": 3, "boxes": {}}')
    said = refusal("plan", "walls", "--envelopes", "modes.json")
    assert said.startswith("modes.json: names: expected a list in brackets, got 3")


@pytest.mark.usefixtures("gl")
def test_a_page_and_a_video_are_written(plan, tmp_path, monkeypatch):
    whole = PlanView.frames
    monkeypatch.setattr(PlanView, "frames", lambda *of: islice(whole(*of), 3))
    try:
        check_page(tmp_path / "a.html")
    except InvalidInput as error:
        pytest.skip(str(error))
    code, out, err = plan("walls", "--frames", 2, "--html", "a.html", "--video", "a.mp4", "--json")
    assert (code, err, out.count("\n")) == (0, "", 1)
    assert json.loads(out)["files"] == ["a.mp4", "a.html"]
    assert (tmp_path / "a.html").read_text().startswith("<!doctype html>")
    assert b"ftyp" in (tmp_path / "a.mp4").read_bytes()[:16]


def test_planning_from_a_cold_start_loads_no_heavy_library_that_it_does_not_need(tmp_path):
    code = (
        "import sys; from stancekit.cli.plan import PlanCourse\n"
        "code = PlanCourse(course='walls', frames=8, out=__import__('pathlib').Path('a.json')).run()\n"
        "heavy = {'torch', 'matplotlib', 'casadi', 'sklearn', 'gymnasium', 'viser', 'mujoco', 'scipy'}\n"
        "heavy &= set(sys.modules)\n"
        "assert code == 0 and not heavy, heavy\n"
    )
    began = children_s()
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert children_s() - began < 8.0
    assert check_file(tmp_path / "a.json", joints=False).accepted


def children_s():
    """Processor time of the processes that were started and have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def test_a_proof_is_written_where_there_is_no_plan_and_verify_accepts_it(plan, stancekit, tmp_path):
    walls = resources.files("stancekit.configs.courses") / "walls.yaml"
    slippery = {**yaml.safe_load(walls.read_text()), "name": "ice"}
    slippery["terrain"]["friction"] = 0.3
    (tmp_path / "ice.yaml").write_text(yaml.safe_dump(slippery))
    code, said, err = plan("ice.yaml", "--frames", 3, "--proof", "proof.json")
    assert code == 1
    assert said.endswith("\nwrote proof.json\n")
    assert err.startswith("stancekit: no plan: ice: infeasible: ")
    ran = stancekit("verify", "proof.json")
    assert (ran.code, ran.out.startswith("proof.json: ice: infeasible: ")) == (0, True)
    assert "friction at frame 1 on LM, RF, RR would have to rise from 0.3 to at least " in err
    assert plan("walls", "--frames", 2, "--proof", "none.json")[0] == 0
    assert not (tmp_path / "none.json").exists()


def test_what_friction_would_do_is_said_where_another_limit_is_the_cheapest_and_half_of_it_is_ice(
    plan, tmp_path
):
    walls = resources.files("stancekit.configs.courses") / "icy-walls.yaml"
    slippery = {**yaml.safe_load(walls.read_text()), "name": "ice"}
    slippery["terrain"]["friction"] = 0.15
    (tmp_path / "ice.yaml").write_text(yaml.safe_dump(slippery))
    code, _, err = plan("ice.yaml")
    assert code == 1
    assert "reach of all limbs would have to rise from 0.35 m to at least " in err
    assert ", or friction at frame " in err
    assert " to rise from 0.15 to at least 1.17" in err


def test_friction_of_a_built_in_course_is_refused_with_where_it_is(refusal):
    said = refusal("plan", "icy-walls", "--friction", "0.3")
    first, _, path = said.partition("; its own friction is in its file: copy ")
    assert first == "--friction: expected a terrain's file as COURSE, got icy-walls"
    text = Path(path.strip().removesuffix(", change it, and plan the copy")).read_text()
    assert yaml.safe_load(text)["terrain"]["friction"] == 1.0


@pytest.mark.parametrize("option", [("--spacing-m", "0.1"), ("--noise-m", "0.01")])
def test_options_of_a_terrains_file_are_refused_with_any_other_course(option, refusal):
    assert_names(refusal("plan", "walls", *option), option[0])


def test_a_friction_below_none_is_refused(refusal):
    said = refusal("plan", "m.stl", "--start=0,0", "--goal=1,0", "--friction=-1")
    assert said == "--friction: expected a number from 0 on, got -1"


GAIT_ALL = """
name: gall
frames: 3
gait: all
start_m: [0.0, 0.0, 0.20]
goal_m: [0.1, 0.0, 0.20]
stride_m: 0.05
terrain: {kind: flat, friction: 0.6}
"""


def test_the_papers_own_gait_is_planned_and_judged_and_not_run(stancekit, refusal):
    """Decision 0006: only its frames can be checked, and nobody can execute it."""
    said = "groups within their limits; cannot be executed: no limb carries between frames"
    Path("gall.yaml").write_text(GAIT_ALL)
    planned = stancekit("plan", "gall.yaml", "--out", "gall.json")
    assert (planned.code, planned.err) == (0, "")
    assert " ".join(planned.out.split()).count(said) == 1
    verified = stancekit("verify", "gall.json")
    assert (verified.code, verified.out[:25]) == (0, "gall.json: accepted: all ")
    assert f"{said}; joints: checked; torque: checked; bodies: checked" in verified.out
    for verb in ("run", "simulate"):
        assert (
            "expected a plan that can be executed, this one cannot: no limb carries between frames"
            in refusal(verb, "gall.json")
        )


def test_what_there_is_when_the_time_ends_is_said_in_one_line(stancekit):
    ended = stancekit("plan", "walls", "--time-limit-s", "1e-6", "--json")
    assert (ended.code, ended.records[0]["status"]) == (1, "undecided")
    assert (
        ended.records[0]["message"] == "the time limit ended before the search for contacts began"
    )
    assert ended.err == f"stancekit: no plan: walls: {ended.records[0]['message']}\n"
