"""Trajectories as values and as files: what was written comes back to the last bit, what was
changed is refused.
"""

from __future__ import annotations

import base64
import io
import json
import os
import pickle
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit import Motion
from stancekit.planners.answer.motion import seal
from stancekit.planners.answer.trajectory import WalkQuestion, robot_from_json
from stancekit.planners.errors import InvalidInput, NoColumn
from stancekit.planners.formats.motion_file import (
    read_motion,
    write_motion,
)
from stancekit.planners.robot.walker import hexapod_walker
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory
from tests.forgeries.walks import changed
from tests.refusals import assert_names, refuses

SAMPLES = ("times_s", "torso_m", "rotation", "feet_m", "forces_n", "contact")


def still(count=41) -> Motion:
    """The hexapod stands on level ground; every foot carries the same."""
    robot = hexapod_walker()
    height = robot.stand_height_m
    terrain = HeightField.from_function(lambda x, y: 0.0 * x, 1.0, 0.25, name="level")
    return Motion(
        times_s=0.005 * np.arange(count),
        torso_m=np.tile([0.1, 0.2, height], (count, 1)),
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        feet_m=np.tile(
            [foot.nominal_m + np.array([0.1, 0.2, height]) for foot in robot.feet], (count, 1, 1)
        ),
        forces_n=np.tile([0.0, 0.0, robot.mass_kg * 9.81 / 6.0], (count, 6, 1)),
        contact=np.ones((count, 6), dtype=bool),
        problem=WalkQuestion(
            robot=robot,
            terrain=terrain,
            friction=0.75,
            adhesive=np.zeros(6, dtype=bool),
            start=[0.1, 0.2],
            goal=[0.1, 0.2],
        ),
        provenance={"chart": "by hand", "seed": 3},
    )


@pytest.fixture
def written(tmp_path):
    """The file of an accepted trajectory."""
    trajectory = still()
    write_motion(tmp_path / "walk.json", trajectory, check_trajectory(trajectory))
    return tmp_path / "walk.json"


def refusal(path) -> str:
    with pytest.raises(InvalidInput) as caught:
        read_motion(path)
    message = str(caught.value)
    assert "\n" not in message
    return message.replace(f"{path.parent}{os.sep}", "")


# ------------------------------------------------------------------------------------------------------
# values


def test_arrays_are_read_only_copies():
    feet = np.zeros((41, 6, 3))
    trajectory = replace(still(), feet_m=feet)
    feet[0] = 1.0
    assert not trajectory.feet_m.any()
    for each in (trajectory, deepcopy(trajectory), pickle.loads(pickle.dumps(trajectory))):
        with refuses("read-only", kind=ValueError):
            each.feet_m[0] = 1.0


def test_what_is_no_array_of_numbers_is_refused_at_once():
    for name, value in (("torso_m", [[1], [1, 2]]), ("provenance", {"seed": 10**400})):
        with refuses(name):
            replace(still(), **{name: value})


def test_columns_of_another_question_and_columns_that_lack_are_refused_at_once():
    walk = still()
    for name, other in (("choice", [0]), ("parts", ()), ("times_s", None), ("torso_m", None)):
        with refuses(name):
            replace(walk, **{name: other})
    with refuses("subject"):
        stancekit.margins(walk)
    with refuses("problem"):
        stancekit.Motion(problem=None)
    assert not hasattr(walk, "patches")
    with refuses("stances", kind=NoColumn):
        walk.forces_at(0)


def test_the_digest_hangs_on_every_field():
    base = still()
    grown = HeightField.from_function(lambda x, y: 1e-9 * x, 1.0, 0.25, name="level")
    changes = [
        {name: _nudged((vars(base) | vars(base.problem))[name])}
        for name in (*SAMPLES, "start", "goal", "adhesive")
    ]
    changes += [
        {"terrain": grown},
        {"friction": 0.7500001},
        {"provenance": {"chart": "by hand", "seed": 4}},
    ]
    changes += [{"robot": replace(base.robot, mass_kg=10.000001)}]
    digests = {changed(base, **change).digest for change in changes}
    assert still().digest == base.digest
    assert len(digests | {base.digest}) == len(changes) + 1


def _nudged(array):
    copy = np.array(array)
    copy.flat[-1] = not copy.flat[-1] if copy.dtype == bool else np.nextafter(copy.flat[-1], 9.0)
    return copy


def test_a_robot_comes_back_from_json():
    record = json.loads(json.dumps(hexapod_walker().to_json()))
    assert robot_from_json(record).to_json() == record
    for spoilt in (
        {},
        [],
        {**record, "feet": [{}]},
        {**record, "mass_kg": -1.0},
        {**record, "wheels": 4},
    ):
        with refuses("robot"):
            robot_from_json(spoilt)


# -------------------------------------------------------------------------------------------------------
# files


def test_a_file_gives_back_what_was_written(written):
    (walk, content), base = read_motion(written), still()
    assert content["verified"]
    assert content["verdict"] == json.loads(json.dumps(check_trajectory(base).to_json()))
    assert walk.digest == base.digest
    for name in SAMPLES:
        assert np.array_equal(getattr(walk, name), getattr(base, name))
    assert walk.provenance == base.provenance
    assert walk.problem.terrain.name == "level"
    assert os.listdir(written.parent) == ["walk.json"]


def _stored(path):
    archive = json.loads(path.read_text())["columns"]["npz"]
    with np.load(io.BytesIO(base64.b64decode(archive))) as packed:
        return dict(packed)


def _archive(arrays):
    content = io.BytesIO()
    np.savez(content, **{name: array for name, array in arrays.items() if array is not None})
    return content.getvalue()


def _packed(path, **changes):
    """Other samples."""
    _put(path, _archive(_stored(path) | changes))


def _put(path, content):
    """Another archive, or what is none, under the sum that the file then has."""
    data = json.loads(path.read_text())
    data["columns"]["npz"] = base64.b64encode(content).decode()
    path.write_text(
        json.dumps(data | {"sha256": seal({k: data[k] for k in data if k != "sha256"})})
    )


BASE = still()
SPOILT = {
    "digest": {"forces_n": BASE.forces_n + 1e-9},
    "feet_m": {"feet_m": None},
    "torso_m": {"torso_m": BASE.torso_m[1:]},
    "feet_m: ": {"feet_m": BASE.feet_m[:, 1:]},
    "contact": {"contact": BASE.contact[:, :3]},
    "truth values": {"contact": 1.0 * BASE.contact},
    "terrain_y_m": {"terrain_y_m": None},
    "walk.json: columns: level: heights_m": {"terrain_heights_m": np.zeros((4, 4))},
}


@pytest.mark.parametrize("message", SPOILT)
def test_samples_that_are_not_those_written_are_refused(written, message):
    _packed(written, **SPOILT[message])
    assert_names(refusal(written), "walk.json", message)


def test_samples_with_holes_or_objects_are_refused(written):
    holes = np.array(BASE.torso_m)
    holes[3, 1] = np.nan
    _packed(written, torso_m=holes)
    assert_names(refusal(written), "walk.json", "torso_m")
    _packed(written, torso_m=np.array([{"a": 1}], dtype=object))
    assert_names(refusal(written), "walk.json", "columns")


@pytest.mark.parametrize("name", ["walk.npz", "walk", "none/walk.json"])
def test_names_that_cannot_be_written_are_refused(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    trajectory = still()
    with refuses(name):
        write_motion(name, trajectory, check_trajectory(trajectory))
    assert os.listdir(tmp_path) == []


def test_an_answer_without_a_solution_has_a_line() -> None:
    answer = stancekit.Answer(status=stancekit.Status.UNDECIDED, method="nobody", message="a < b")
    assert repr(answer) == "Answer(undecided by nobody: a < b)"
    with pytest.raises(AttributeError):
        _ = answer.solution.com_m  # type: ignore[union-attr]
