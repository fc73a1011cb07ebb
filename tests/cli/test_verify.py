"""`stancekit verify`: no claim passes without its evidence, and no evidence for another problem."""

from __future__ import annotations

import json
import sys
from functools import cache
from pathlib import Path
from subprocess import run

import numpy as np
import pytest

import stancekit as library
from stancekit import Motion
from stancekit.checks import _ground
from stancekit.planners.formats.motion_file import read_motion, write_motion
from stancekit.planners.terrain.families import drawn_surface, read_draw
from stancekit.planners.terrain.import_options import ImportOptions
from stancekit.planners.verify import PLAN_GROUPS, check_plan
from stancekit.planners.verify.motions import nearest
from stancekit.planners.verify.trajectories import GROUPS, check_trajectory
from stancekit.planners.verify.trajectory_measurements import WHOLE_BODY
from stancekit.runner.acceptance import Accepted
from tests.forgeries import stances, walks
from tests.forgeries.crawl import crawl
from tests.planners.search.test_doctor import HEAD, walk as tripods, written
from tests.refusals import assert_names, refuses


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


def test_a_proof_is_replayed_exactly_and_nothing_else_is(stancekit):
    library.save(library.solve(library.sample("wall-3", rng=8)[0]).certificate, "proof.json")
    library.save(library.solve(library.sample("wall-3", rng=0)[0]).solution, "posture.json")
    ran = stancekit("verify", "--exact", "proof.json")
    assert (ran.code, "1 balls" in " ".join(ran.out.split())) == (0, True)
    assert stancekit("verify", "--exact", "posture.json").code == 2


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
    assert ran.records[0]["message"].startswith("force_balance (z): 0.01 N")
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
    assert_names(refusal("verify", "problems.jsonl"), "problems.jsonl", "motion", "--certificate")
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
        judged = ("verify", "problems.jsonl", "answers.jsonl", "--tolerance", value)
        assert_names(refusal(*judged), "--tolerance")
    for option in (("--tolerance", "0.1"), ("--explain",)):
        assert_names(refusal("verify", labelled, *option), option[0], "data set")


def test_there_is_one_answer_a_problem(refusal, pairs, answers, write):
    assert_names(refusal("verify", "problems.jsonl", write("a.jsonl", *answers[:2])), "3", "2")


walk, plan = cache(crawl), cache(stances.honest_plan)
FORGED_WALKS = (
    "skating",
    "weight missing",
    "dragged",
    "facing elsewhere",
    "starting in motion",
    "sucking",
)
FORGED_PLANS = ("weight missing", "a toe moved", "a limb that moves carries", "the body tilted")


@cache
def walks_of() -> dict[str, Motion]:
    forged = {
        name: walks.KINDS[name](walk(), 2.0, np.random.default_rng(2)) for name in FORGED_WALKS
    }
    return {
        "honest": walk(),
        "open": walk().asked(heading_rad=None, still=(False, False)),
        **forged,
    }


@cache
def plans_of() -> dict[str, Motion]:
    forged = {
        name: stances.PLANS[name](plan(), 3.0, np.random.default_rng(3)) for name in FORGED_PLANS
    }
    return {"honest": plan(), **forged}


@pytest.mark.parametrize("name", ["honest", "open", *FORGED_WALKS])
def test_a_walk_has_one_verdict(name: str, stancekit, tmp_path: Path) -> None:
    path, trajectory = tmp_path / "walk.json", walks_of()[name]
    written = check_trajectory(trajectory)
    write_motion(path, trajectory, written)
    ran = stancekit("verify", path, "--json")
    message, python = ran.records[0]["report"], library.verify(library.load(path))
    assert (ran.code == 0) == message["accepted"] == python.accepted == written.accepted
    assert message["accepted"] == (name in ("honest", "open"))
    assert message["message"] == python.message == written.message
    assert (
        message["digest"]
        == python.digest
        == written.digest
        == read_motion(path)[1]["verdict"]["digest"]
    )
    assert sorted(message["checked"] + message["not_checked"]) == sorted(GROUPS)
    assert stancekit("verify", path).out.splitlines()[0] == f"{path}: {written.message}"


def test_a_walk_of_which_something_is_not_checked_says_so_and_is_not_run(
    stancekit, tmp_path: Path
) -> None:
    path, trajectory = tmp_path / "walk.json", walks_of()["open"]
    report = check_trajectory(trajectory)
    assert report.unchecked == ("heading", "rest", "rest_acceleration", *WHOLE_BODY)
    assert report.accepted
    assert_names(report.message, *report.unchecked)
    write_motion(path, trajectory, report)
    assert stancekit("verify", path, "--json").records[0]["report"]["not_checked"] == list(
        report.unchecked
    )
    with refuses("heading", "rest", "rest_acceleration"):
        Accepted.from_file(path)


@pytest.mark.parametrize("name", ["honest", *FORGED_PLANS])
def test_a_plan_has_one_verdict(name: str, stancekit, tmp_path: Path) -> None:
    path, made = tmp_path / "plan.json", plans_of()[name]
    written = check_plan(made, joints=True)
    write_motion(path, made, written)
    ran = stancekit("verify", path, "--json")
    (record,) = ran.records
    message, python = record["report"], library.verify(library.load(path))
    assert (
        (ran.code == 0)
        == message["accepted"]
        == python.accepted
        == written.accepted
        == (name == "honest")
    )
    assert record["verdict"] == ("accepted" if message["accepted"] else "refused")
    assert message["digest"] == python.digest == written.digest
    assert message["checked"] == list(python.checked) == list(written.checked)
    assert [group["group"] for group in message["groups"]][: len(PLAN_GROUPS)] == list(PLAN_GROUPS)
    if name == "honest":
        assert (
            Accepted.from_file(path).digest == check_plan(made).digest
        )  # of contacts; joints it asks of its world
    else:
        with refuses("plan.json"):
            Accepted.from_file(path)


@pytest.fixture(scope="module")
def walk_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a walk, and its CSV beside it."""
    path = tmp_path_factory.mktemp("motions") / "walk.json"
    level = library.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    found = library.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled").solution
    assert found is not None
    library.save(found, path)
    library.export(path, to="csv")
    return path


def test_a_motion_is_judged_by_the_command(walk_file: Path, stancekit) -> None:
    judged = ("verify", walk_file.with_suffix(".csv"), "--terrain", walk_file)
    (record,) = stancekit(*judged, "--json").records
    assert (record["kind"], record["verdict"], record["report"]["not_checked"]) == (
        "motion",
        "accepted",
        [],
    )


DIAMOND = "v -3 0 {z}\nv 0 -3 {z}\nv 3 0 {z}\nv 0 3 {z}\nf 1 2 3 4\n"
STEP = "v 2 -1 0\nv 2 1 0\nv 2 1 0.1\nv 2 -1 0.1\nv 3 1 0.1\nv 3 -1 0.1\nf 5 8 7 6\nf 8 10 9 7\n"


@pytest.mark.parametrize(
    ("z", "verdict"), [(0.0, "accepted"), (-0.02, "refused"), (0.02, "refused")]
)
def test_a_mesh_under_a_motion_may_have_steps_and_sides_along_no_axis(
    z: float, verdict: str, walk_file: Path, stancekit, tmp_path: Path
) -> None:
    ground = tmp_path / "of.python.obj"
    ground.write_text(DIAMOND.format(z=z) + STEP)
    judged = ("verify", walk_file.with_suffix(".csv"), "--robot", "anymal", "--terrain", ground)
    (record,) = stancekit(*judged, "--json").records
    assert record["verdict"] == verdict


@pytest.mark.parametrize(("rise_m", "held"), [(0.0, True), (0.1, False)])
def test_heights_that_are_not_the_mesh_are_doubted_and_hold_nothing_that_asks_for_the_ground(
    rise_m: float, held: bool, walk_file: Path, stancekit, tmp_path: Path
) -> None:
    """Of 5,618 triangles in millimetres, with a step a metre ahead of the walk."""
    ground, rows, rise = tmp_path / "many.obj", range(54), 1e3 * rise_m
    lines = [f"v {60 * x - 1500} {60 * y - 1500} {rise * (x > 44)}" for x in rows for y in rows]
    corners = [54 * x + y + 1 for x in rows[1:] for y in rows[1:]]
    lines += [f"f {k - 55} {k - 1} {k}\nf {k - 55} {k} {k - 54}" for k in corners]
    ground.write_text("\n".join(lines))
    judged = ("verify", walk_file.with_suffix(".csv"), "--robot", "anymal", "--terrain", ground)
    (record,) = stancekit(*judged, "--unit-m", "0.001", "--json").records
    assert ("contact_gap" in record["report"]["not_checked"], record["verdict"]) == (
        not held,
        "accepted",
    )
    assert held or record["report"]["doubts"][0].startswith(f"{ground}: more than 5000")


@pytest.mark.parametrize("name", ["stairs:0.3:3", "gaps:0.5:0", "walls:0.5:3"])
def test_a_motion_over_a_ground_by_its_name_is_judged_by_its_polygons(name: str) -> None:
    """To their very edges, which the heights that walks have over them round by centimetres."""
    for patch in drawn_surface(*read_draw(name, "")) or ():
        beside = patch.centre_m + 0.9999 * (patch.vertices_m - patch.centre_m)
        gaps, normals, _ = nearest(_ground(name, ImportOptions()), beside, np.full(4, 1e-3))
        np.testing.assert_allclose(
            [*gaps, *(normals @ patch.normal)], 4 * [-1e-3] + 4 * [1.0], atol=1e-9
        )


EDGE = ((-1.0, 0.1), (0.0, 0.1), (0.0, 0.0), (0.3, 0.0))
SLOT = ((-1.0, 0.0), (0.005, 0.0), (0.005, -0.3), (0.022, -0.3), (0.022, 0.0), (0.3, 0.0))


@pytest.mark.parametrize(("profile", "off_mm"), [(EDGE, 78.4), (SLOT, 300)])
def test_an_edge_on_a_line_of_the_grid_and_a_slot_between_lines_are_no_ground_to_stand_on(
    profile: tuple[tuple[float, float], ...], off_mm: float, tmp_path: Path
) -> None:
    """A step of 0.1 m, and a slot of 17 mm, whose side has 5,618 triangles; none ends at its edge."""
    ground, rows = tmp_path / "edge.obj", range(54)
    lines = [f"v {0.3 + 0.03 * x} {0.03 * y - 0.8} 0" for x in rows for y in rows]
    corners = [54 * x + y + 1 for x in rows[1:] for y in rows[1:]]
    lines += [f"f {k - 55} {k - 1} {k}\nf {k - 55} {k} {k - 54}" for k in corners]
    lines += [f"v {x} {y} {z}" for x, z in profile for y in (-0.8, 0.79)]
    lines += [
        f"f -{k} -{k - 2} -{k - 1}\nf -{k - 2} -{k - 3} -{k - 1}"
        for k in range(2 * len(profile), 2, -2)
    ]
    ground.write_text("\n".join(lines))
    with pytest.warns(UserWarning, match=f"judged by heights that are up to {off_mm} mm off them"):
        assert _ground(str(ground), ImportOptions()).doubt


def test_mujocos_key_frames_are_judged(walk_file: Path, stancekit) -> None:
    assert stancekit("export", walk_file, "--to", "mujoco").code == 0
    frames, options = walk_file.with_suffix(".xml"), ("--terrain", walk_file, "--json")
    ran = stancekit("verify", frames, "--robot", "anymal", *options)
    unchecked = ["torque", "contact_gap", "forces", "cone", "swing_force"]
    assert (ran.code, ran.records[-1]["report"]["not_checked"]) == (0, unchecked)


def spoiled(text: str, how: str) -> str:
    """A CSV with something wrong."""
    head, *rows = text.splitlines()
    return {
        "nan": "\n".join([head, ",".join(["nan", *rows[0].split(",")[1:]]), *rows[1:]]),
        "gap": "\n".join([head, *rows[:50], *rows[60:]]),
        "backwards": "\n".join([head, *reversed(rows)]),
        "short": "\n".join([head, rows[0], rows[1][:100], *rows[2:]]),
        "column": "\n".join([head.replace("body.qw", "body.q0"), *rows]),
        "joint": "\n".join([head.replace("LF_HAA", "arm"), *rows]),
        "axis": "\n".join([head.replace("body.x", "com_v.q"), *rows]),
        "empty": head,
    }[how]


@pytest.mark.parametrize(
    ("how", "line"),
    [
        ("nan", "row 1, column t: expected a finite number, got 'nan'"),
        (
            "gap",
            "time_s: row 50: expected a uniform grid, got a gap of 0.11 s at 0.49 s where others are 0.01 s",
        ),
        ("backwards", "expected times that increase"),
        ("short", "row 2: expected "),
        (
            "column",
            "expected columns as t, q.JOINT, force.LIMB.x, got 'body.q0', did you mean 'body.qz'?",
        ),
        ("joint", "joints: expected those of anymal"),
        ("axis", "got 'com_v.q'"),
        ("empty", "expected rows below the header, got none"),
    ],
)
def test_a_bad_motion_is_one_line(
    how: str, line: str, walk_file: Path, tmp_path: Path, refusal
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(spoiled(walk_file.with_suffix(".csv").read_text(), how))
    assert line in refusal("verify", path, "--terrain", walk_file)


def test_options_that_do_not_fit_are_one_line(walk_file: Path, refusal) -> None:
    table = walk_file.with_suffix(".csv")
    for arguments, line in (
        ((table,), "moves over, as the name or file of heights or the file of a plan or a walk"),
        ((table, "--terrain", walk_file, "--course", "walls"), "got both"),
        ((walk_file, "--terrain", walk_file), "--terrain: expected none with"),
        ((table, "--terrain", walk_file, "--robot", "nobody"), "--robot: expected"),
        (
            (table, "--terrain", walk_file, "--tolerance", "0.1"),
            "--tolerance: expected none with a motion",
        ),
        ((table, "--terrain", "nowhere"), "--terrain: expected a file, one of"),
        ((table, "--terrain", "rough:0:1", "--holes", "fill"), "--holes: expected none with"),
        ((walk_file, "--unit-m", "0.001"), "--unit-m: expected none with"),
    ):
        assert line in refusal("verify", *arguments)


def test_exports_that_cannot_be_are_one_line(walk_file: Path, tmp_path: Path, refusal) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "other.json").write_text("{}")
    for arguments, line in (
        (
            (walk_file,),
            "--to: expected one of csv, npz, jointtrajectory, mujoco, reference, crocoddyl, foxglove, got none",
        ),
        ((walk_file, "--to", "svg"), "--to: expected one of csv"),
        (
            (walk_file, "--to", "csv", "--out", tmp_path / "file" / "walk.csv"),
            "expected an existing folder",
        ),
        (
            (walk_file, "--to", "csv", "--out", tmp_path / "walk.txt"),
            "--out: expected a name that ends in .csv",
        ),
        (
            (walk_file, "--to", "csv", "--rate-hz", "-1"),
            "--rate-hz: expected a number in (0, 10000], got -1",
        ),
        (
            (tmp_path / "other.json", "--to", "csv"),
            "stancekit/motion/1",
        ),
    ):
        assert line in refusal("export", *arguments)


def test_the_stance_of_a_sequence_that_is_refuted_is_drawn(stancekit):
    slope = [[*line, 0.6, 0.0, 0.8, 0.1] for line in tripods()]
    written(slope, (*HEAD, "nx", "ny", "nz", "friction"))
    ran = stancekit("verify", "steps.csv", "--picture", "why.png", "--out", "climb.json")
    assert (ran.code, library.verify("climb.json").kind) == (1, "no-posture")
    assert Path("why.png").stat().st_size > 10_000
