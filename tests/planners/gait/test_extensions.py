"""A chart and a terrain of one's own, each in one file outside the package."""

import json
from pathlib import Path

import numpy as np
import pytest

from stancekit.cli.main import main
from stancekit.envs.warped_gait import WarpedGaitEnv
from stancekit.planners.errors import InvalidInput
from stancekit.planners.formats.trajectory_file import check_file
from stancekit.planners.gait.charts import CHARTS
from stancekit.planners.gait.gait_program import formulate
from stancekit.planners.gait.walk_table import GaitSettings
from stancekit.planners.problem.walk import Walk
from stancekit.planners.robot.single_body import anymal
from stancekit.planners.terrain.heightfield import HeightField
from stancekit.planners.terrain.reference import TERRAINS, named_terrain

CHART = '''
"""The shear with the torso's height counted from elsewhere: the same walk, other numbers."""

from stancekit.planners.gait.charts.warped import Shear


class Lifted(Shear):
    """The torso's height counts from 10 cm above the ground."""

    def torso(self, bar, expansion):
        p, rotation = super().torso(bar, expansion)
        p[2] += 0.1
        return p, rotation

    def torso_bar(self, p_WB):
        return super().torso_bar(p_WB) - [0.0, 0.0, 0.1]


class NoChart:
    pass
'''
TERRAIN = '''
"""A bump, and a field of one's own."""

import numpy as np

from stancekit.planners.terrain.heightfield import HeightField


def bump(x, y):
    return 0.08 * np.exp(-(x**2) - y**2)


plain = HeightField(np.linspace(-2.0, 2.0, 9), np.linspace(-2.0, 2.0, 9), np.zeros((9, 9)), "plain")
number = 3
'''


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(CHART)
    Path("ground.py").write_text(TERRAIN)
    return tmp_path


def test_a_chart_of_ones_own_finds_the_walk_of_its_sibling(files: Path) -> None:
    field = HeightField.from_function(lambda x, y: 0.05 * np.sin(2.0 * x) * np.cos(y), 2.0, 0.1)
    task = Walk(
        robot=anymal(), terrain=field, start_xy_m=[0.0, 0.0], goal_xy_m=[0.2, 0.1], duration_s=2.0
    )
    own = formulate(task, GaitSettings(chart="mine.py:Lifted")).solve()
    other = formulate(task, GaitSettings(chart="shear")).solve()
    assert own.success
    assert own.trajectory().provenance["chart"] == "mine.py:Lifted"
    np.testing.assert_allclose(own.trajectory().torso_m, other.trajectory().torso_m, atol=1e-6)
    heights = own.program.structure.layout.torso[:, 2]
    np.testing.assert_allclose(own.x[heights], other.x[heights] - 0.1, atol=1e-6)


def test_the_command_line_takes_both_by_file_and_name(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--goal", "0.2,0.1", "--duration-s", "2", "--raw", "--out", "walk.json", "--json"]
    with pytest.raises(SystemExit) as ended:
        main(["gait", "ground.py:bump", "--chart", "mine.py:Lifted", *asked])
    assert ended.value.code == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["attempts"][0]["chart"] == "mine.py:Lifted"
    report = check_file("walk.json")
    assert report.accepted
    assert report.answer.terrain.name == "ground.py:bump"
    assert float(report.answer.terrain.height(np.zeros(2))) == pytest.approx(0.08, abs=1e-6)


def test_a_height_field_in_a_file_is_taken_as_it_is(files: Path) -> None:
    assert named_terrain("ground.py:plain").x_m.tolist() == np.linspace(-2.0, 2.0, 9).tolist()


def test_the_environment_chooses_among_charts_and_terrains_of_ones_own(files: Path) -> None:
    env = WarpedGaitEnv("ground.py:bump", charts=("shear", "mine.py:Lifted"))
    observation, _ = env.reset(seed=0)
    assert np.abs(observation["heights"]).max() > 0.001
    assert env.action_space.nvec[0] == 2
    info = env.step(np.array([1, 0, 0]))[-1]
    assert info["feasible"] == 1


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (
            lambda: CHARTS.get("mine.py:NoChart"),
            "chart mine.py:NoChart: expected a class of charts, as those in ",
        ),
        (
            lambda: GaitSettings(chart="polar"),
            "chart: expected one of ambient, shear, decoupled, warped, ",
        ),
        (
            lambda: TERRAINS.get("ground.py:number"),
            "terrain ground.py:number: expected a height field, a Formula, or ",
        ),
        (
            lambda: named_terrain("ground.py"),
            "terrain: expected FILE.py:NAME, got no name after ground.py",
        ),
    ],
)
def test_what_is_none_is_refused(files: Path, ask, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidInput) as refused:
        ask()
    assert str(refused.value).startswith(message)
