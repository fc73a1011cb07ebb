"""The playground's verb: what it begins with, and what it says where it cannot; pages are tested
with views.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pytest

from stancekit import PlanSettings, draw, plan, save
from stancekit.cli.play import Play
from stancekit.cli.solve import Between
from stancekit.planners.problem.course_file import read_course
from stancekit.views.playground.scenario import Scenario

COMMAND = [sys.executable, "-m", "stancekit.cli.main", "play"]


def test_it_serves_on_this_machine_and_ends_with_ctrl_c():
    served = subprocess.Popen(
        [*COMMAND, "walls", "--frames", "2", "--port", "0", "--no-browser"],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's "&" ignores it
    )
    address, rest = served.stdout.readline().split(" ", 1)
    assert rest == "shows walls; Ctrl-C ends\n"
    assert address.startswith("http://127.0.0.1:")
    with urlopen(address) as answer:
        assert b"<html" in answer.read().lower()
    served.send_signal(signal.SIGINT)
    said = served.communicate()  # a test that hangs has failed
    assert served.returncode == 130
    assert said == ("", "stancekit: interrupted\n")


def test_a_port_that_is_taken_is_one_line(stancekit):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        ran = stancekit("play", "walls", "--port", str(port), "--no-browser")
    assert ran.code == 2
    assert ran.err == (
        f"stancekit: error: --port: expected a port to listen at on 127.0.0.1, got {port}: Address already in use; "
        "--port 0 takes a free one\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nosuch",), "course: expected one of "),
        (("walls", "--port", "99999"), "--port: expected 0 to 65535, got 99999"),
        (("walls", "--folder", "no/such"), "--folder: expected a folder, got no/such"),
        (
            ("rubble.stl",),
            "--start: expected --start X,Y and --goal X,Y with the terrain rubble.stl, got none",
        ),
        (
            ("walls", "--start", "0,0"),
            "--start: expected --start X,Y and --goal X,Y together, got one of them",
        ),
        (("walls", "--robot", "nosuch.urdf"), "nosuch.urdf: "),
        (("leap-stones:3",), "family: expected one of "),
    ],
)
def test_what_it_cannot_begin_with_is_one_line(arguments, message, refusal):
    assert message in refusal(
        "play", *arguments, "--no-browser", *(() if "--port" in arguments else ("--port", "0"))
    )


def test_courses_are_scenes_of_their_kind(tmp_path: Path):
    assert Play(course="walls")._scenario(None).kind == "walls"
    (tmp_path / "walls.json").write_text(Scenario.about(read_course("walls")).text()[1])
    assert Play(course=str(tmp_path / "walls.json"))._scenario(None).kind == "laid"


def test_the_proof_of_a_course_is_drawn_and_played(tmp_path: Path, stancekit):
    answer = plan("walls", frames=2, settings=PlanSettings(wrench=(0.0, 0.0, -4e3, 0.0, 0.0, 0.0)))
    save(answer.certificate, tmp_path / "proof.json")
    assert Play(course=str(tmp_path / "proof.json"))._scenario(None).given.frames == 2
    words = [text.get_text() for axes in draw(answer).axes for text in axes.texts]
    assert [word for word in words if word.startswith("LF, LR, RM: wrench 4000 N, holds at most")]
    stancekit("picture", str(tmp_path / "proof.json"), "--out", str(tmp_path / "why.png"))
    assert (tmp_path / "why.png").stat().st_size > 10_000


def test_a_terrains_file_is_laid_out_between_two_places(tmp_path: Path):
    import trimesh

    box = trimesh.creation.box(
        (3.0, 2.0, 0.1), trimesh.transformations.translation_matrix((0.5, 0.0, -0.05))
    )
    box.export(tmp_path / "floor.stl")
    between = Between(start="0,0", goal="0.5,0.1")
    scenario = Play(course=str(tmp_path / "floor.stl"), between=between)._scenario(None)
    course = scenario.course()
    assert course.goal_m[:2] == pytest.approx([0.5, 0.1])
    moved = scenario.dragged("goal", course.goal_m + np.array([0.0, 0.2, 7.0]))
    assert moved.course().goal_m == pytest.approx([0.5, 0.3, course.goal_m[2]], abs=1e-3)
    (tmp_path / "again.yaml").write_text(moved.text()[1])
    again = read_course(tmp_path / "again.yaml")
    assert again.com_nominal_m == pytest.approx(moved.course().com_nominal_m, abs=1e-3)
    assert moved.slid("friction", 0.3).course().terrain[0].friction == 0.3
