"""`stancekit gait`: walks that the verifier accepts, and nothing in a file that it refuses."""

from __future__ import annotations

import json
import os
import signal
from contextlib import contextmanager
from dataclasses import astuple
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from stancekit.cli import gait as gait_command
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.formats.motion_file import check_file, read_motion
from stancekit.views.gaits import GaitView
from tests.planners.robot.small_urdfs import quadruped
from tests.refusals import assert_names

LIVELY = ("plain.npy", "--goal", "0.5,0.1", "--chart", "decoupled", "--duration-s", "2")
SHORT = ("plain.npy", "--goal", "0.2,0.1", "--chart", "decoupled", "--duration-s", "2")

ACCEPTED = "accepted: all 44 groups within their limits"
"""Of ANYmal, joints, torque, bodies and all."""


@pytest.fixture
def gait(stancekit, tmp_path):
    """``gait("ripple", "--goal", "1,1")`` in a folder that holds a gentle plain: code, standard
    output and error.
    """
    x = 0.05 * (np.arange(81) - 40.0)
    np.save(tmp_path / "plain.npy", 0.1 * x[:, None] + 0.0 * x)

    return lambda *arguments: astuple(stancekit("gait", *arguments))


@pytest.fixture(scope="module")
def short():
    """What an accepted walk's command printed as JSON, and the file that it wrote, in the folder of
    the test.
    """
    kept = {}

    def get(gait):
        if not kept:
            code, kept["out"], err = gait(*SHORT, "--out", "walk.json", "--json")
            assert (code, err) == (0, "")
            assert sorted(os.listdir()) == ["plain.npy", "walk.json"]
            kept["walk"] = Path("walk.json").read_bytes()
        Path("walk.json").write_bytes(kept["walk"])
        return json.loads(kept["out"])

    return get


def test_an_accepted_walk_is_written_with_its_verdict(gait, short):
    record = short(gait)
    assert record["verified"]
    assert record["attempt"] == "decoupled"
    assert record["message"] == ACCEPTED
    walk, content = read_motion("walk.json")
    assert content["verified"]
    assert check_file("walk.json").report.digest == record["digest"]
    assert np.allclose(walk.problem.goal, [0.2, 0.1])
    (attempt,) = record["attempts"]
    assert attempt["violations"][-1] < 1e-4 <= min(attempt["violations"][:-1])
    assert attempt["iterations"] == len(attempt["violations"]) - 1


def test_a_urdf_walks_and_its_own_legs_reach_every_foot(gait, stancekit, refusal, tmp_path):
    import pinocchio as pin

    (tmp_path / "dog.urdf").write_text(quadruped(effort=60.0))
    code, out, err = gait(*SHORT, "--robot", "dog.urdf", "--out", "walk.json", "--json")
    record = json.loads(out)
    assert (code, err) == (0, "")
    assert record["joints"].keys() == {"joints", "joint_speed", "torque", "legs_moment"}
    assert record["joints"]["joints"]["value"] < 1e-5
    assert record["joints"]["torque"]["where"][3:] in ("HAA", "HFE", "KFE")
    assert record["message"] == (  # bones without shapes
        "accepted as far as checked: bodies is not; 43 groups within their limits; cannot be executed: bodies is not "
        "checked"
    )
    assert stancekit("verify", "walk.json", "--robot", "dog.urdf").code == 0
    (tmp_path / "dog.urdf").write_text(quadruped(effort=61.0))
    assert refusal("verify", "walk.json", "--robot", "dog.urdf").startswith(
        "walk.json: expected a walk of the robot quadruped as its file is, got one of quadruped with "
        "numbers of its own: model.digest: expected "
    )
    os.remove("dog.urdf")
    walk = read_motion("walk.json")[0]
    whole = pin.buildModelFromXML(walk.robot.model.urdf, pin.JointModelFreeFlyer())
    assert pin.computeTotalMass(whole) == pytest.approx(walk.robot.mass_kg)
    assert walk.robot.limb_names == ("LF", "RF", "LH", "RH")
    code, out, _ = gait(*SHORT, "--robot", "anymal-boxes", "--json")
    assert json.loads(out)["joints"] is None


def test_verify_takes_the_file_and_refuses_one_changed_by_hand(
    gait, short, stancekit, refusal, tmp_path
):
    short(gait)
    ran = stancekit("verify", "walk.json")
    assert (ran.code, ran.err) == (0, "")
    assert ACCEPTED in ran.out
    header = tmp_path / "walk.json"
    header.write_text(header.read_text().replace('"friction": 0.75', '"friction": 0.95'))
    assert_names(refusal("verify", "walk.json"), "walk.json", "digest")


def test_words_say_the_same_as_json(gait):
    code, out, _ = gait(*SHORT, "--out", "walk.json")
    assert code == 0
    assert "decoupled: " in out
    assert ACCEPTED in out
    assert "walk.json: 401 samples" in out


def test_what_the_verifier_refuses_is_not_written_unless_asked_for_and_then_marked(gait):
    hard = (*SHORT[:2], "0.9,0.1", *SHORT[3:], "--max-iterations", "2")
    code, out, _ = gait(*hard, "--out", "walk.json")
    assert code == 1
    assert "walk.json: not written; --unverified writes what the verifier refuses" in out
    assert os.listdir() == ["plain.npy"]
    code, out, _ = gait(*hard, "--out", "walk.json", "--unverified")
    assert code == 1
    assert "walk.json: 401 samples, NOT VERIFIED" in out
    _, content = read_motion("walk.json")
    assert not content["verified"]
    assert not content["verdict"]["accepted"]
    assert not check_file("walk.json").accepted


def test_seeds_are_tried_from_their_own_guesses_and_the_smoothest_walk_is_kept(gait):
    code, out, _ = gait(*SHORT, "--seeds", "2", "--seed", "7", "--out", "walk.json", "--json")
    record = json.loads(out)
    assert code == 0
    assert [one["attempt"] for one in record["attempts"]] == ["decoupled", "decoupled, seed 8"]
    assert record["attempts"][0]["violations"][0] != record["attempts"][1]["violations"][0]
    peaks = [
        check_file("walk.json").report.figures["peak_acceleration_g"],
        record["figures"]["peak_acceleration_g"],
    ]
    assert peaks[0] == peaks[1]


def test_the_second_phase_lowers_the_peak_and_raw_leaves_it_out(gait):
    code, out, _ = gait(*LIVELY, "--json")
    (smooth,) = json.loads(out)["attempts"]
    assert code == 0
    assert smooth["phases"]["smooth"]["solves"] > 0
    assert smooth["peak_g"]["after"] < smooth["peak_g"]["before"]
    assert smooth["cpu_seconds"] == pytest.approx(
        sum(one["cpu_seconds"] for one in smooth["phases"].values())
    )
    _, out, _ = gait(*LIVELY, "--json", "--raw")
    (raw,) = json.loads(out)["attempts"]
    assert (raw["phases"]["smooth"]["solves"], raw["phases"]["densify"]["solves"]) == (0, 0)
    assert raw["peak_g"] == {
        "before": smooth["peak_g"]["before"],
        "after": smooth["peak_g"]["before"],
    }


def test_the_robot_faces_where_it_is_told(gait):
    gait(*SHORT, "--raw", "--heading", "goal", "--out", "walk.json")
    turned = read_motion("walk.json")[0].rotation[0]
    assert np.arctan2(turned[1, 0], turned[0, 0]) == pytest.approx(np.arctan2(0.1, 0.2), abs=1e-3)


def test_a_picture_of_heights_is_a_terrain(gait):
    Image.fromarray(np.full((81, 81), 128, dtype=np.uint8)).save("flat.png")
    read = ("flat.png", *SHORT[1:], "--raw", "--heights-m", "0,1", "--spacing-m", "0.05")
    assert gait(*read, "--out", "walk.json")[0] == 0
    assert read_motion("walk.json")[0].problem.terrain.heights_m == pytest.approx(128 / 255)


def test_the_portfolio_stops_at_the_first_chart_that_is_accepted(gait):
    _, out, _ = gait(*SHORT[:3], "--duration-s", "2", "--raw", "--json")
    assert [one["chart"] for one in json.loads(out)["attempts"]] == ["decoupled"]


@pytest.mark.usefixtures("gl")
def test_pictures_pages_and_films_are_drawn(gait, monkeypatch):
    whole = GaitView.frames
    monkeypatch.setattr(GaitView, "frames", lambda *of: islice(whole(*of), 3))
    files = ["a.png", "c.mp4", "d.html"]
    drawn = ("--picture", "a.png", "--html", "d.html", "--video", "c.mp4")
    code, _, _ = gait(*SHORT, *drawn)
    assert code == 0
    assert sorted(os.listdir()) == sorted([*files, "plain.npy"])
    assert all(os.path.getsize(name) > 1000 for name in files)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_says_so_and_leaves_nothing(gait, monkeypatch, number):
    @contextmanager
    def watching(title):
        yield lambda attempt, iteration, *at: os.kill(os.getpid(), number) if iteration else None

    monkeypatch.setattr(gait_command, "watching", watching)
    assert gait(*SHORT, "--out", "walk.json") == (130, "", "stancekit: interrupted\n")
    assert os.listdir() == ["plain.npy"]


def test_a_run_whose_time_is_up_answers_with_the_best_so_far(gait):
    code, out, _ = gait(*LIVELY, "--total-s", "0.01", "--json")
    record = json.loads(out)
    assert [one["phases"]["smooth"]["solves"] for one in record["attempts"]] == [0]
    assert code == (0 if record["verified"] else 1)


# ---------------------------------------------------------------------------------------------------
# bad input


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("lava", "--goal", "1,1"), "terrain: expected a file, one of ripple, "),
        (("ripple", "--goal", "1"), "--goal: expected a place X,Y in metres, got '1'"),
        (("ripple", "--goal", "1,1,1"), "--goal: expected a place X,Y in metres, got '1,1,1'"),
        (("ripple", "--goal", "1,nan"), "--goal: expected a place"),
        (("ripple", "--goal", "9,9"), "--goal: expected torso and feet over the terrain, "),
        (("pit", "--goal", "1.3,0"), "--goal: expected ground to stand on, got a wall of 79°"),
        (
            ("pit", "--goal", "2.2,0", "--start", "1.3,0"),
            "--start: expected ground to stand on, got a wall of 79°",
        ),
        (
            ("ripple", "--goal", "1,1", "--heading", "north"),
            "--heading: expected an angle in rad, or goal, got 'north'",
        ),
        (
            ("ripple", "--goal", "1,1", "--heading", "nan"),
            "--heading: expected finite numbers, got nan",
        ),
        (
            ("ripple", "--goal", "1,1", "--total-s", "0"),
            "--total-s: expected a number above 0, got 0",
        ),
        (
            ("ripple", "--goal", "1,1", "--heights-m", "1"),
            "--heights-m: expected 2 numbers with commas between them",
        ),
        (
            ("ripple", "--goal", "1,1", "--robot", "table"),
            "--robot: expected anymal, anymal-boxes, hexapod, a1, ",
        ),
        (
            ("ripple", "--goal", "1,1", "--adhesive", "LF,QQ"),
            "--adhesive: expected some of LF, RF, LH, RH, got ",
        ),
        (("ripple", "--goal", "1,1", "--seeds", "0"), "--seeds: expected 1 to 1000, got 0"),
        (("ripple", "--goal", "1,1", "--seed", "-1"), "--seed: expected 0 or more, got -1"),
        (
            ("ripple", "--goal", "1,1", "--max-iterations", "0"),
            "--max-iterations: expected 1 or more, got 0",
        ),
        (
            ("ripple", "--goal", "1,1", "--duration-s", "0"),
            "--duration-s: expected a number in (0, 120], got 0",
        ),
        (
            ("ripple", "--goal", "1,1", "--friction", "-1"),
            "--friction: expected a number in (0, 10], got -1",
        ),
        (("ripple", "--goal", "1,1", "--out", "walk"), "walk: expected a name that ends in .json"),
        (
            ("ripple", "--goal", "1,1", "--out", "none/walk.json"),
            "none/walk.json: expected an existing folder none",
        ),
        (
            ("ripple", "--goal", "1,1", "--unverified"),
            "--unverified: expected --out with it, got none",
        ),
        (
            ("ripple", "--goal", "1,1", "--picture", "a.gif"),
            "a.gif: expected a name that ends in .png, .pdf, .svg",
        ),
        (
            ("ripple", "--goal", "1,1", "--video", "a.avi"),
            "a.avi: expected a name that ends in .mp4, got .avi",
        ),
        (
            ("ripple", "--goal", "1,1", "--html", "a.txt"),
            "a.txt: expected a name that ends in .html, got .txt",
        ),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(refusal, arguments, message):
    assert refusal("gait", *arguments).startswith(message)


URDF = """<robot name="cart"><link name="body"/>{}</robot>""".format(
    "".join(
        f'<link name="F{k}"/><joint name="j{k}" type="revolute"><parent link="body"/><child link="F{k}"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for k in range(3)
    )
)
ROBOT = """urdf: cart.urdf
feet: [F0, F1, F2]
posture_rad: {"j*": 0}
trunk_half_m: [0.1, 0.1, 0.1]
"""


@pytest.fixture
def files(stancekit, tmp_path):
    """Terrains and robots of which every one is wrong."""
    flat = np.zeros((81, 81))
    x = 0.05 * (np.arange(81) - 40.0)
    np.save("hole.npy", np.where(np.arange(81) == 7, np.nan, flat))
    np.save("row.npy", flat[:1])
    np.save("step.npy", np.where(x > 0.5, 0.6, 0.0)[:, None] + flat)
    block = np.where((x[:, None] > 0.15) & (x > 0.05), 1.6, 0.0)
    np.save("block.npy", gaussian_filter(block, 2.0))
    (tmp_path / "cart.urdf").write_text(URDF)
    (tmp_path / "cart.yaml").write_text(ROBOT)
    (tmp_path / "hole.csv").write_text("0,0,0,0\n0,0,,0\n0,0,0,0\n0,0,0,0\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("hole.npy", "--goal", "1,0"),
            "hole.npy: expected a height everywhere, got holes at 81 of 6561",
        ),
        (
            ("hole.csv", "--goal", "1,0"),
            "hole.csv: expected a height everywhere, got holes at 1 of 16 grid points",
        ),
        (("row.npy", "--goal", "1,0"), "row.npy: x_m: expected 4 or more grid lines, got 1"),
        (
            ("step.npy", "--goal", "1,0"),
            "step.npy: finer than its spline can hold: between grid points it swings 60 mm",
        ),
        (
            ("block.npy", "--goal=-1,0"),
            "--start: expected ground that all feet reach, got heights from 0.00 to 1.4",
        ),
        (
            ("block.npy", "--start=-1,0", "--goal", "0,0"),
            "--goal: expected ground that all feet reach, got heights",
        ),
        (
            ("ripple", "--goal", "1,0", "--robot", "cart.yaml"),
            "cart.yaml: cart.urdf: expected links with mass",
        ),
        (
            ("ripple", "--goal", "0.1,0", "--duration-s", "0.5"),
            "--duration-s: expected 1.3 s or more for one cycle",
        ),
        (
            ("ripple", "--goal", "1,0", "--gait", "tripod"),
            "--gait: expected one for 4 feet, got tripod",
        ),
    ],
)
def test_terrains_robots_and_walks_that_cannot_be_are_one_line(refusal, files, arguments, message):
    assert refusal("gait", *arguments, "--out", "walk.json").startswith(message)


def test_a_wall_on_the_way_that_is_too_steep_for_friction_is_said_as_a_search_begins(
    gait, monkeypatch
):
    code, _, err = gait("hill", "--start=-2.6,0", "--goal=-0.4,0.35")  # none begins
    assert (
        code,
        err.count("\n"),
        err.endswith("; one chart alone, --chart NAME, looks all the same\n"),
    ) == (1, 1, True)

    def work(*asked, progress, **_):
        progress(asked[3][0], 1, 1.0, 1.0, "feasible")
        raise PlanningFailed("work")

    monkeypatch.setattr("stancekit.walks.walked", work)
    code, _, err = gait("pit", "--goal", "2.2,0", "--chart", "ambient")
    assert code == 1
    assert err == (
        "pit is 79° at its steepest on the way, and friction 0.75 holds on 37°: there may be no walk. The search "
        "ends after 240 s of CPU time; feet that stick may help: --adhesive LF,RF\n"
        "stancekit: pit: work\n"
    )


def test_a_walk_is_simulated_at_its_own_pace_and_filmed_not_drawn(gait, short, stancekit, refusal):
    short(gait)
    ran = stancekit("simulate", "walk.json", "--json")
    (said,) = ran.records
    assert (ran.code, said["succeeded"], said["world"]) == (0, True, "mujoco")
    for option, value in (("--pace", "2"), ("--picture", "end.png")):
        assert refusal("simulate", "walk.json", option, value).startswith(f"{option}: expected")


MAGIC = {".png": b"\x89PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}


@pytest.fixture
def file(sampled, write):
    return write("p.jsonl", *sampled["wall-3"][:2], sampled["wall-3"][0] | {"mass_kg": -1.0})


@pytest.mark.parametrize("suffix", sorted(MAGIC))
def test_every_format_is_written(suffix, file, stancekit, tmp_path):
    ran = stancekit("picture", file, "--out", f"a{suffix}", "--json")
    assert (ran.code, ran.err) == (0, "")
    assert ran.records == [{"where": "p.jsonl line 1", "out": f"a{suffix}", "status": "feasible"}]
    assert (tmp_path / f"a{suffix}").read_bytes().startswith(MAGIC[suffix])
    assert sorted(os.listdir(tmp_path)) == sorted([f"a{suffix}", file])


def test_people_are_told_what_was_drawn(file, stancekit):
    ran = stancekit("picture", file, "--out", "a.png", "--index", "1")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.startswith("a.png: exact: infeasible, ")
    assert ran.out.count("\n") == 1


def test_the_problem_may_come_from_standard_input(file, stancekit, tmp_path):
    ran = stancekit(
        "picture", "-", "--out", "a.png", "--json", stdin=(tmp_path / file).read_bytes()
    )
    assert (ran.code, ran.records[0]["where"]) == (0, "- line 1")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--out", "a.jpg"), "a.jpg"),
        (("--out", "a"), "a"),
        (("--out", "none/a.png"), "none/a.png"),
        (("--out", "folder.png"), "folder.png"),
        (("--out", "a.png", "--index", "99"), "--index"),
        (("--out", "a.png", "--index", "-1"), "--index"),
        (
            ("--out", "a.png", "--index", "2"),
            "mass_kg",
        ),
    ],
)
def test_bad_input_is_one_line(options, message, file, refusal, tmp_path):
    (tmp_path / "folder.png").mkdir()
    assert_names(refusal("picture", file, *options), message)


def test_a_file_that_is_none_is_told(refusal):
    assert_names(refusal("picture", "none", "--out", "a.png"), "none")
