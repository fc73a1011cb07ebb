"""`stancekit gait`: walks that the verifier accepts, and nothing in a file that it refuses."""

from __future__ import annotations

import json
import os
import signal
from itertools import islice

import numpy as np
import pytest

from stancekit.envs import gait_video
from stancekit.planners.gait.attempt import Workbench
from stancekit.planners.gait.record import check_file, read_trajectory

SHORT = ("plain.npy", "--goal", "0.2,0.1", "--chart", "decoupled", "--duration-s", "2")


@pytest.fixture
def gait(stancekit, tmp_path):
    """``gait("ripple", "--goal", "1,1")`` in a folder that holds a gentle plain: code, standard output and error."""
    x = 0.05 * (np.arange(81) - 40.0)
    np.save(tmp_path / "plain.npy", 0.1 * x[:, None] + 0.0 * x)

    def call(*arguments):
        ran = stancekit("gait", *arguments)
        return ran.code, ran.out, ran.err

    return call


def test_an_accepted_walk_is_written_with_its_verdict(gait):
    code, out, err = gait(*SHORT, "--out", "walk.json", "--json")
    record = json.loads(out)
    assert (code, err) == (0, "")
    assert record["verified"]
    assert record["attempt"] == "decoupled"
    assert record["message"] == "accepted: all 19 groups within their limits"
    assert sorted(os.listdir()) == ["plain.npy", "walk.json", "walk.npz"]
    written = read_trajectory("walk.json")
    assert written.verified
    assert check_file("walk.json").digest == record["digest"]
    assert np.allclose(written.trajectory.goal_xy_m, [0.2, 0.1])
    (attempt,) = record["attempts"]
    assert attempt["violations"][-1] < 1e-4 <= min(attempt["violations"][:-1])
    assert attempt["iterations"] == len(attempt["violations"]) - 1


def test_verify_takes_the_file_and_refuses_one_changed_by_hand(gait, stancekit, tmp_path):
    gait(*SHORT, "--out", "walk.json")
    ran = stancekit("verify", "walk.json")
    assert (ran.code, ran.err) == (0, "")
    assert "accepted: all 19 groups within their limits" in ran.out
    header = tmp_path / "walk.json"
    header.write_text(header.read_text().replace('"friction": 0.75', '"friction": 0.95'))
    ran = stancekit("verify", "walk.json")
    assert (ran.code, ran.out) == (2, "")
    said = "walk.json: its digest does not fit its contents: changed since it was written"
    assert ran.err == f"stancekit: error: {said}\n"


def test_words_say_the_same_as_json(gait):
    code, out, _ = gait(*SHORT, "--out", "walk.json")
    assert code == 0
    assert "decoupled: " in out
    assert "accepted: all 19 groups within their limits" in out
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
    written = read_trajectory("walk.json")
    assert not written.verified
    assert not written.verdict["accepted"]
    assert not check_file("walk.json").accepted


def test_seeds_are_tried_from_their_own_guesses_and_the_smoothest_walk_is_kept(gait):
    code, out, _ = gait(*SHORT, "--seeds", "2", "--seed", "7", "--out", "walk.json", "--json")
    record = json.loads(out)
    assert code == 0
    assert [one["attempt"] for one in record["attempts"]] == ["decoupled", "decoupled, seed 8"]
    assert record["attempts"][0]["violations"][0] != record["attempts"][1]["violations"][0]
    peaks = [check_file("walk.json").figures["peak_acceleration_g"], record["figures"]["peak_acceleration_g"]]
    assert peaks[0] == peaks[1]


def test_the_portfolio_stops_at_the_first_chart_that_is_accepted(gait):
    _, out, _ = gait(*SHORT[:3], "--duration-s", "2", "--json")
    assert [one["chart"] for one in json.loads(out)["attempts"]] == ["decoupled"]


def test_pictures_pages_and_films_are_drawn(gait, monkeypatch):
    pytest.importorskip("imageio_ffmpeg")
    whole = gait_video.motion_frames
    monkeypatch.setattr(gait_video, "motion_frames", lambda *of, **how: islice(whole(*of, **how), 3))
    files = ["a.png", "b.svg", "c.mp4", "d.html"]
    drawn = ("--picture", "a.png", "--convergence", "b.svg", "--html", "d.html", "--video", "c.mp4")
    code, _, _ = gait(*SHORT, *drawn)
    assert code == 0
    assert sorted(os.listdir()) == sorted([*files, "plain.npy"])
    assert all(os.path.getsize(name) > 1000 for name in files)


# ------------------------------------------------------------------------------------------------- interrupted


def test_an_interrupted_run_keeps_its_point_and_goes_on_from_there(gait, monkeypatch):
    whole = Workbench.run
    begins, heard = [], []

    def interrupted(self, attempt, progress, **rest):
        begins.append(rest["guess"])

        def once(*at):
            heard.append(at[2])
            if len(begins) == 1 and at[1] == 2:
                os.kill(os.getpid(), signal.SIGINT)
            return progress(*at)

        return whole(self, attempt, once, **rest)

    monkeypatch.setattr(Workbench, "run", interrupted)
    code, out, err = gait(*SHORT, "--out", "walk.json")
    assert (code, out) == (130, "")
    assert err == "walk.partial.npz: kept; the same command goes on from there\nstancekit: interrupted\n"
    assert sorted(os.listdir()) == ["plain.npy", "walk.partial.npz"]
    code, out, _ = gait(*SHORT, "--out", "walk.json", "--json")
    assert code == 0
    assert begins[0] is None
    assert begins[1] is not None
    assert json.loads(out)["attempts"][0]["violations"] == heard[3:]
    assert heard[3] == pytest.approx(heard[2], rel=1e-9)
    assert sorted(os.listdir()) == ["plain.npy", "walk.json", "walk.npz"]


def test_another_command_does_not_take_up_what_is_left(gait, monkeypatch):
    whole = Workbench.run
    begins = []

    def stopped(self, attempt, progress, **rest):
        begins.append(rest["guess"])
        return whole(self, attempt, lambda *at: len(begins) == 1 or progress(*at), **rest)

    monkeypatch.setattr(Workbench, "run", stopped)
    assert gait(*SHORT, "--out", "walk.json")[0] == 130
    assert gait(*SHORT, "--friction", "0.8", "--out", "walk.json")[0] == 0
    assert begins == [None, None]


# --------------------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("lava", "--goal", "1,1"), "terrain: expected a file, one of ripple, "),
        (("ripple", "--goal", "1"), "--goal: expected a place X,Y in metres, got '1'"),
        (("ripple", "--goal", "1,1,1"), "--goal: expected a place X,Y in metres, got '1,1,1'"),
        (("ripple", "--goal", "1,nan"), "--goal: expected finite numbers"),
        (("ripple", "--goal", "9,9"), "--goal: expected torso and feet over the terrain, "),
        (("pit", "--goal", "1.3,0"), "--goal: expected ground to stand on, got a wall of 79°"),
        (("pit", "--goal", "2.2,0", "--start", "1.3,0"), "--start: expected ground to stand on, got a wall of 79°"),
        (("ripple", "--goal", "1,1", "--robot", "table"), "--robot: expected anymal, hexapod or a robot's file, "),
        (("ripple", "--goal", "1,1", "--adhesive", "LF,QQ"), "--adhesive: expected some of LF, RF, LH, RH, got QQ"),
        (("ripple", "--goal", "1,1", "--seeds", "0"), "--seeds: expected 1 to 1000, got 0"),
        (("ripple", "--goal", "1,1", "--seed", "-1"), "--seed: expected 0 or more, got -1"),
        (("ripple", "--goal", "1,1", "--max-iterations", "0"), "--max-iterations: expected 1 or more, got 0"),
        (("ripple", "--goal", "1,1", "--duration-s", "0"), "--duration-s: expected a number above 0, got 0"),
        (("ripple", "--goal", "1,1", "--friction", "-1"), "--friction: expected a number above 0, got -1"),
        (("ripple", "--goal", "1,1", "--out", "walk"), "walk: expected a name that ends in .json"),
        (("ripple", "--goal", "1,1", "--out", "none/walk.json"), "none/walk.json: expected an existing folder none"),
        (("ripple", "--goal", "1,1", "--unverified"), "--unverified: expected --out with it, got none"),
        (("ripple", "--goal", "1,1", "--picture", "a.gif"), "a.gif: expected a name that ends in .png, .pdf, .svg"),
        (("ripple", "--goal", "1,1", "--video", "a.avi"), "a.avi: expected a name that ends in .mp4, got .avi"),
        (("ripple", "--goal", "1,1", "--html", "a.txt"), "a.txt: expected a name that ends in .html, got .txt"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(gait, arguments, message):
    code, out, err = gait(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"stancekit: error: {message}"), err
    assert err.count("\n") == 1
    assert os.listdir() == ["plain.npy"]


def test_a_gait_longer_than_the_walk_is_said_so(gait):
    code, _, err = gait("ripple", "--goal", "0.1,0", "--duration-s", "0.5", "--chart", "decoupled")
    assert code == 2
    assert err.startswith("stancekit: error: ")
    assert err.count("\n") == 1
