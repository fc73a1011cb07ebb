"""Contact sequences from elsewhere: what is named of those that were spoiled, and nothing of others."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit.planners.problem.sequence import read_sequence
from stancekit.planners.robot.model import hexapod
from stancekit.planners.search.doctor import diagnosed
from tests.refusals import refuses

HEAD = ("step", "foot", "x", "y", "z")
TRIPODS = (("LF", "LR", "RM"), ("LM", "RF", "RR"))
Line = list[str | float]


def walk(strides: int = 3, heading_rad: float = 0.0) -> list[Line]:
    """A hexapod on level ground that walks so many half cycles of a tripod gait, 8 cm each."""
    turn = np.exp(1j * heading_rad)
    places = {
        limb.name: limb.shoulder_m + 0.15 * np.array([0.0, np.sign(limb.shoulder_m[1]), 0.0])
        for limb in hexapod().limbs
    }
    lines: list[Line] = []
    for step in range(strides + 1):
        for name in TRIPODS[step % 2] if step else places:
            places[name] = places[name] + np.array([0.08 * min(step, 1), 0.0, 0.0])
            place = complex(*places[name][:2]) * turn
            lines.append([step, name, place.real, place.imag, 0.0])
    return lines


def written(lines: list[Line], head: tuple[str, ...] = HEAD) -> Path:
    with Path("steps.csv").open("w", newline="") as file:
        csv.writer(file).writerows([head, *lines])
    return Path("steps.csv")


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("heading_rad", "terrain"), [(0.0, None), (2.0, None), (0.0, "rough:0:1")])
def test_a_sequence_that_holds_is_completed_wherever_it_faces(
    heading_rad: float, terrain: str | None
) -> None:
    check = stancekit.verify(written(walk(heading_rad=heading_rad)), terrain=terrain)
    assert (check.accepted, check.kind) == (True, "sequence")
    plan = check.report.answer
    stances = [group for group in check.report.groups if group.name.startswith("step ")]
    assert len(stances) == len(plan.problem.stances)
    assert min(group.figures["support_m"] for group in stances) > 0.03
    assert stancekit.verify(plan).accepted
    back = plan.toes_m[:, :2] @ np.array([1.0, 1j]) * np.exp(1j * heading_rad)
    given = {(line[0], line[1]): complex(line[2], line[3]) for line in walk(3, heading_rad)}
    wanted = [given[each.frame / 2, each.limb] for each in plan.problem.footholds]
    assert np.abs(back - wanted).max() < 2e-3


def test_the_foot_that_is_out_of_reach_is_named_and_mended() -> None:
    lines = walk()
    row = next(k for k, line in enumerate(lines) if line[:2] == [1, "RF"])
    lines[row][3] = float(lines[row][3]) - 0.45
    assert not stancekit.verify(written(lines), terrain="rough:0:1").accepted
    report = stancekit.verify(written(lines), explain=True).report
    assert not report.accepted
    assert {(group.limb, group.figures["limit"]) for group in report.refused} == {("RF", "reach")}
    assert stancekit.verify(report.answer).accepted
    assert "RF of step 1 by " in report.remark
    assert " by ".join(report.remark.split(" by ")[:2]).count("of step") == 1


def test_feet_that_slip_are_told_the_friction_that_they_need() -> None:
    slope = np.radians(25.0)
    lines: list[Line] = [[*line, -np.sin(slope), 0.0, np.cos(slope), 0.2] for line in walk()]
    head = (*HEAD, "nx", "ny", "nz", "friction")
    report = stancekit.verify(written(lines, head)).report
    needed = {group.figures["needed"] for group in report.refused}
    assert max(needed) == pytest.approx(np.tan(slope), abs=2e-3)
    assert stancekit.verify(report.answer).accepted  # which is the proof of a stance


def test_a_foot_in_the_air_is_told_how_far_the_ground_is() -> None:
    lines = walk()
    lines[8][4] = 0.3
    report = stancekit.verify(written(lines), terrain="rough:0:1").report
    off = [group.value for group in report.refused if group.name.startswith("ground under")]
    assert off == [pytest.approx(0.3, abs=1e-6)]


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda lines: lines[7].__setitem__(1, "tail"), "foot"),
        (lambda lines: lines[0].__setitem__(0, 9), "step"),
        (lambda lines: [line.__setitem__(k, 1e3 * line[k]) for line in lines for k in (2, 3)], "x"),
        (lambda lines: lines.pop(2), "step"),
        (lambda lines: lines.append(lines[-1]), "row 16"),
        (lambda lines: lines[3].__setitem__(4, "nan"), "column z"),
        (lambda lines: lines.extend([4, *line[1:]] for line in lines[:6]), "step 4"),
    ],
)
def test_what_is_no_sequence_of_this_robot_is_refused(change, where) -> None:
    lines = walk()
    change(lines)
    with refuses("steps.csv", where):
        stancekit.verify(written(lines))


def test_the_body_is_where_the_sequence_says_and_moves_between_its_steps() -> None:
    """Feet of a step that lift are those that the body of the step before stands over."""
    lines = [[*line, 0.02 if line[0] else -0.04, 0.0, 0.2] for line in walk(1)]
    report = stancekit.verify(written(lines, (*HEAD, "com.x", "com.y", "com.z"))).report
    assert report.accepted
    np.testing.assert_allclose(report.answer.com_m[[0, 2], 0], [-0.04, 0.02], atol=0.02)


def test_one_that_turns_is_judged_stance_by_stance_and_never_accepted() -> None:
    rows = dict(read_sequence(written(walk())))
    place = (rows["x"] + 1j * rows["y"]) * np.exp(0.5j * rows["step"])
    rows["x"], rows["y"] = place.real, place.imag
    report = diagnosed(rows, hexapod(), None)
    assert not report.accepted
    assert {group.verdict for group in report.groups if group.name.startswith("step 0")} == {
        "holds"
    }


def test_a_doubt_about_the_ground_stands_beside_the_proof_that_refuses_a_sequence() -> None:
    lines = walk()
    next(line for line in lines if line[:2] == [2, "RM"])[2] = 1.5
    floor = "v -3 -3 0\nv 3 -3 0\nv 3 3 0\nv -3 3 0\nf 1 2 3\nf 1 3 4\n"
    solid = "v 2 2 0\nv 2.2 2 0\nv 2 2.2 0\nv 2 2 .2\nf 5 6 7\nf 5 7 8\nf 5 8 6\nf 6 8 7\n"
    Path("mended.obj").write_text(floor + solid)
    with pytest.warns(UserWarning, match="inside out"):
        report = stancekit.verify(written(lines), terrain="mended.obj").report
    assert (report.accepted, len(report.doubts)) == (False, 1)
    assert "inside out" in report.doubts[0]
