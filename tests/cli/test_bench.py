"""``stancekit bench``: one table and one picture a class, JSON lines, and one clear line for what
is wrong.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from stancekit import Motion, WalkQuestion
from stancekit.cli.bench import judge
from stancekit.planners.gait.walk_table import read_walk, table_of, walk_names
from stancekit.planners.plugins import FILE
from stancekit.planners.robot.walker import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.verify.trajectories import check_trajectory
from tests.refusals import refuses

PLAN = {
    "problems": ["wall-3"],
    "train": {"feasible": 10, "infeasible": 10, "seed": 0},
    "test": {"feasible": 6, "infeasible": 6, "seed": 1},
    "methods": ["heuristic", "quantile"],
    "projections": ["fix-p", "scp"],
    "quick": {"methods": ["quantile"]},
}


@pytest.fixture
def bench(stancekit):
    return lambda *arguments: stancekit("bench", "envelopes", *arguments)


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / "plan.yaml"
    path.write_text(yaml.safe_dump(PLAN))
    return path


def test_a_run_writes_table_and_picture_and_prints_rows(config: Path, bench) -> None:
    out = config.parent / "out"
    rows = bench("--config", config, "--out", out, "--workers", 1, "--json").records
    assert [row["selector"] for row in rows] == ["heuristic", "quantile", "lift"]
    assert rows == json.loads((out / "table.json").read_text())
    assert rows[0]["paper"]["p1_feasible"] == 0.7872
    assert "paper" not in rows[1]
    for row in rows:
        low, high = row["p1_feasible_interval"]
        assert low <= row["p1_feasible"] <= high
        assert row["p1_feasible_of"] == row["p1_infeasible_of"] == row["project_scp_of"] == 6
    assert (out / "wall-3.png").read_bytes()[:4] == b"\x89PNG"
    page = (out / "table.md").read_text()
    assert "|  | paper: GA | 77.8 | 97.7 | 67.1 | – | – |" in page
    ranks = {
        cells[2].strip(): int(cells[1])
        for cells in (line.split("|") for line in page.splitlines())
        if len(cells) > 3 and cells[1].strip().isdigit()
    }
    best = sorted(rows, key=lambda row: -row["balanced"])
    assert [name for name, _ in sorted(ranks.items(), key=lambda item: item[1])] == [
        row["selector"] for row in best
    ]
    printed = bench("--config", config, "--out", out, "--workers", 1, "--quick").out
    assert "quantile" in printed
    assert "paper: GA" in printed
    assert max(len(line) for line in printed.splitlines() if "out" not in line) <= 80


SUBMISSION = """
import numpy as np
import stancekit

def around(request):
    rows = request.dataset
    box = stancekit.Envelope.around(rows.points)
    return stancekit.EnvelopeSet.for_problems(rows.problem_class, list(rows.problems()), [box], {"method": "around"})

class Middle:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.repeat([-HALF, HALF], 6 * observation["friction"].shape[-1]).astype(np.float32), state

def middle(request):
    return Middle()
"""


def test_methods_of_a_file_stand_beside_ours_and_are_judged_anew_when_it_changes(
    monkeypatch: pytest.MonkeyPatch, bench
) -> None:
    methods = ["quantile", "mine.py:around", "mine.py:middle"]
    Path("plan.yaml").write_text(yaml.safe_dump(PLAN | {"methods": methods}))
    found = []
    for half in ("1.0", "0.05"):
        Path("mine.py").write_text(SUBMISSION.replace("HALF", half))
        for name in [name for name in sys.modules if name.startswith(FILE)]:
            monkeypatch.delitem(sys.modules, name)  # as in another process
        ran = bench("--config", "plan.yaml", "--out", "out", "--workers", 1, "--json")
        found.append(ran.records)
    wide, narrow = ({row["selector"]: row for row in rows} for rows in found)
    assert list(wide) == [*methods, "lift"]
    assert wide["mine.py:around"]["file"] == "mine-around.json"
    assert Path("out/wall-3/mine-around.json").is_file()
    assert wide["mine.py:middle"]["p1_feasible"] == 1.0
    assert narrow["mine.py:middle"]["p1_feasible"] == 0.0
    assert "| mine.py:middle | wall-3 | none kept |" in Path("out/table.md").read_text()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("problems: [", "expected YAML"),
        ("methods: 3", "methods: "),
        (yaml.safe_dump(PLAN | {"metods": []}), "metods: unknown key"),
        ("", "the file is empty"),
    ],
)
def test_a_bad_plan_is_one_line_and_exit_code_2(
    tmp_path: Path, refusal, content: str, message: str
) -> None:
    (tmp_path / "plan.yaml").write_text(content)
    said = refusal("bench", "envelopes", "--config", "plan.yaml", "--out", "out")
    assert said.startswith("plan.yaml: ")
    assert message in said


def test_a_folder_that_cannot_be_made_and_an_address_without_a_cluster_are_refused(
    config: Path, tmp_path: Path, refusal
) -> None:
    (tmp_path / "file").touch()
    asked = ("bench", "envelopes", "--config", config, "--out")
    assert "expected a folder or room for one" in refusal(*asked, "file/out")
    said = refusal(*asked, "out", "--address", "10.0.0.1:6379")
    assert "address: expected none for processes" in said


TIMES_S = 0.005 * np.arange(61)
KEYS = {
    "program": "standing",
    "robot": "anymal-boxes",
    "terrain": "level.npy",
    "spacing_m": 0.1,
    "friction": 0.5,
    "start": [0.0, 0.0],
    "goal": [0.0, 0.0],
    "cpu_process_s": 2.5,
    "cpu_solver_s": 1.5,
}


def standing() -> Motion:
    """ANYmal on level ground, a quarter of the weight on every foot, which are placed evenly about
    it.
    """
    robot = anymal()
    feet = np.array([foot.nominal_m for foot in robot.feet]) + robot.stand_height_m * np.array(
        [0.0, 0.0, 1.0]
    )
    force = np.array([0.0, 0.0, 0.25 * robot.weight_n])
    count = len(TIMES_S)
    return Motion(
        times_s=TIMES_S,
        torso_m=np.tile([0.0, 0.0, robot.stand_height_m], (count, 1)),
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        feet_m=np.tile(feet, (count, 1, 1)),
        forces_n=np.tile(force, (count, 4, 1)),
        contact=np.ones((count, 4), dtype=bool),
        problem=WalkQuestion(
            robot=robot,
            terrain=HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1),
            friction=0.5,
            adhesive=np.zeros(4, dtype=bool),
            start=np.zeros(2),
            goal=np.zeros(2),
        ),
    )


@pytest.fixture
def folder(tmp_path) -> Path:
    """A walk as CSV."""
    np.save(tmp_path / "level.npy", np.zeros((41, 41)))
    (tmp_path / "stands.yaml").write_text(yaml.safe_dump(KEYS))
    (tmp_path / "stands.csv").write_text(table_of(standing()))
    return tmp_path


def verdicts(trajectory: Motion) -> dict[str, float]:
    return {group.name: group.value for group in check_trajectory(trajectory).groups}


def test_a_table_is_judged_as_the_walk_it_was_written_of(folder):
    walk, own = read_walk(folder / "stands.yaml"), standing()
    assert walk.keys.cpu_process_s == 2.5
    assert check_trajectory(walk.trajectory).accepted
    assert verdicts(walk.trajectory) == pytest.approx(verdicts(own), abs=1e-9)
    for name in ("times_s", "torso_m", "rotation", "feet_m", "forces_n", "contact"):
        np.testing.assert_allclose(getattr(walk.trajectory, name), getattr(own, name), atol=1e-12)


def test_an_archive_says_the_same_and_a_foot_that_is_pushed_stands(folder):
    own = standing()
    (folder / "stands.csv").unlink()
    wxyz = np.tile([-1.0, 0.0, 0.0, 0.0], (own.samples, 1))
    arrays = {"t_s": own.times_s, "base_m": own.torso_m, "base_wxyz": wxyz, "feet_m": own.feet_m}
    forces = own.forces_n.copy()
    forces[:, 0] = 0.0
    np.savez(folder / "stands.npz", **arrays, forces_n=forces)
    walk = read_walk(folder / "stands.yaml")
    assert walk.trajectory.contact.sum(axis=0).tolist() == [
        0,
        own.samples,
        own.samples,
        own.samples,
    ]
    refused = {group.name for group in check_trajectory(walk.trajectory).refused}
    assert "force_balance" in refused


def test_a_forged_table_is_refused_by_the_check_not_believed(folder):
    """A base that says it is 10 cm higher than its feet can reach, with everything else as it
    was.
    """
    text = (folder / "stands.csv").read_text().splitlines()
    high = [",".join([*row.split(",")[:3], repr(0.9), *row.split(",")[4:]]) for row in text[1:]]
    (folder / "stands.csv").write_text("\n".join([text[0], *high]))
    report = check_trajectory(read_walk(folder / "stands.yaml").trajectory)
    assert "reach" in {group.name for group in report.refused}


def test_all_walks_of_a_folder_are_judged_beside_our_cells(folder, tmp_path, capsys):
    (folder / "again.yaml").write_text(yaml.safe_dump({**KEYS, "terrain": "ripple", "task": 3}))
    (folder / "again.csv").write_text((folder / "stands.csv").read_text())
    cells = tmp_path / "cells"
    cells.mkdir()
    row = {"verified": True, "cpu_s": 4.0, "force_rms": 0.01}
    (cells / "ripple-03-0-portfolio.json").write_text(json.dumps({"row": row}))
    assert judge(folder, cells, as_json=False) == 0
    assert "stancekit, portfolio" in capsys.readouterr().out
    found = json.loads((cells / "against.json").read_text())
    by_walk = {row["walk"]: row for row in found["walks"]}
    assert by_walk["stands"]["verified"]
    assert not by_walk["again"]["verified"]  # flat feet on a ripple
    assert by_walk["ripple-03-0-portfolio"]["cpu_solver_s"] == 4.0
    sums = {each["program"]: each for each in found["programs"]}
    assert (sums["standing"]["walks"], sums["standing"]["verified"]) == (2, 1)
    assert sums["standing"]["cpu_process_s"] == 2.5


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"program": None}, "program"),
        ({"terrain": "nowhere"}, "terrain"),
        ({"robot": "spider"}, "robot"),
        ({"friction": -1.0}, "friction"),
        ({"speed": 1.0}, "speed"),
    ],
)
def test_keys_that_are_wrong_are_refused_in_one_line(folder, changed, name):
    (folder / "stands.yaml").write_text(yaml.safe_dump({**KEYS, **changed}))
    with refuses("stands.yaml", name):
        read_walk(folder / "stands.yaml")


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        (lambda text: text.replace("base_x_m", "x"), "base_x_m"),
        (lambda text: text.replace("t_s,", "t_s,more,", 1), "more"),
        (lambda text: text.replace("\n0.005,", "\nnow,"), "stands.csv"),
        (lambda text: text.replace("\n0.005,", "\n"), "stands.csv"),
        (lambda text: text.replace(",1.0,0.0,0.0,0.0,", ",0.5,0.0,0.0,0.0,"), "base_wxyz"),
        (lambda text: text.replace(",1.0\n", ",0.5\n"), "stands"),
        (lambda text: "", "stands.csv"),
    ],
)
def test_samples_that_are_wrong_are_refused_in_one_line(folder, wrong, name):
    path = folder / "stands.csv"
    path.write_text(wrong(path.read_text()))
    with refuses(name):
        read_walk(folder / "stands.yaml")


def test_folders_without_walks_and_walks_without_samples(folder, tmp_path):
    with refuses("nowhere"):
        walk_names(tmp_path / "nowhere")
    (folder / "stands.csv").unlink()
    with refuses("stands.yaml", "stands.csv", "stands.npz"):
        read_walk(folder / "stands.yaml")
    (folder / "stands.yaml").unlink()
    with refuses(folder):
        walk_names(folder)
