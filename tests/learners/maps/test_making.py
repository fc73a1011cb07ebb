"""Where a robot can stand: proved poses are what the exact planner says, the rest is unknown or likely
at a measured error.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import beta

import stancekit
from stancekit.learners.maps import making
from stancekit.learners.maps.making import Maker, MapSettings, Poses, make_map
from stancekit.planners.problem.standing_map import (
    FEASIBLE,
    INFEASIBLE,
    LIKELY,
    LIMITS,
    UNKNOWN,
    UNLIKELY,
)
from tests.refusals import refuses

PIT = """v -2 -2 0
v 2 -2 0
v 2 2 0
v -2 2 0
f 1 2 3
f 1 3 4
"""


@pytest.fixture(scope="module")
def level(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("level") / "level.obj"
    path.write_text(PIT)
    return path


ground = cache(stancekit.terrain)


def poses(
    terrain: str | Path,
    spacing_m: float = 0.5,
    headings: int = 4,
    friction: float = 0.5,
    robot: str | None = None,
) -> Poses:
    return Poses.of(
        ground(terrain, robot=robot),
        robot,
        terrain=str(terrain),
        spacing_m=spacing_m,
        headings=headings,
        friction=friction,
    )


def test_level_ground_is_feasible_but_where_toes_lack_a_place(level: Path) -> None:
    made = poses(level)
    found = make_map(made, MapSettings())
    assert (found.verdict[2:-2, 2:-2] == FEASIBLE).all()
    assert (np.stack([found.margin, found.support_m, found.push_n])[:, 2:-2, 2:-2] > 0.0).all()
    assert found.shares()["proved"] == 1.0
    off = made.off.reshape(made.shape)
    assert (found.verdict[off] == INFEASIBLE).all()
    assert (found.limit[off] == LIMITS.index("foothold")).all()


def test_without_friction_on_a_slope_friction_is_in_the_way(tmp_path: Path) -> None:
    path = tmp_path / "slope.obj"
    path.write_text(
        PIT.replace("v -2 -2 0", "v -2 -2 -0.8")
        .replace("v -2 2 0", "v -2 2 -0.8")
        .replace("v 2 -2 0", "v 2 -2 0.8")
        .replace("v 2 2 0", "v 2 2 0.8")
    )
    found = make_map(poses(path, friction=0.2), MapSettings())
    assert (found.verdict[3:-3, 3:-3] == INFEASIBLE).all()
    assert set(found.limit[3:-3, 3:-3].ravel().tolist()) == {LIMITS.index("friction")}
    grips = make_map(poses(path, friction=0.8), MapSettings())
    assert (grips.verdict[3:-3, 3:-3] == FEASIBLE).all()


def test_proved_poses_are_what_the_planner_says_one_by_one() -> None:
    made = poses("rubble:0.4:3", spacing_m=1.1, headings=2, friction=0.4)
    found = make_map(made, MapSettings())
    batch = made.batch(np.arange(len(made)))
    verdict, off = found.verdict.ravel(), made.off
    assert {FEASIBLE, INFEASIBLE} <= set(verdict.tolist())
    for k in range(0, len(made), 5):
        if not off[k]:
            said = stancekit.solve(batch.problem(k)).status.value
            assert ["unknown", "feasible", "infeasible"][verdict[k]] in (said, "unknown")


def test_every_pose_is_in_the_axes_of_its_body(level: Path) -> None:
    made = poses(level, headings=8)
    middle = int(np.ravel_multi_index((3, 3, 0), made.shape))
    batch = made.batch(np.arange(middle, middle + 8))
    centres = batch.vertices_m.mean(axis=2)
    assert np.abs(centres - made.stance.centre_m).max() < 0.02  # of the lattice
    assert np.allclose(batch.normals, [0.0, 0.0, 1.0])


def test_poses_are_proved_from_coarse_to_fine(level: Path) -> None:
    maker = Maker(poses(level, spacing_m=0.2))
    i, j, k = np.unravel_index(maker.coarse_to_fine(), maker.poses.shape)
    assert (np.stack([i, j, k])[:, :10][:2] % 4 == 0).all()
    assert len(i) == len(maker.open)


def test_what_is_not_reached_is_unknown(level: Path) -> None:
    found = make_map(poses(level, spacing_m=0.2), MapSettings(time_limit_s=1e-6))
    assert (found.verdict[5:-5, 5:-5] == UNKNOWN).all()
    assert np.isnan([found.margin[5:-5, 5:-5], found.support_m[5:-5, 5:-5]]).all()


def test_a_map_goes_on_from_its_file(
    level: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, path = poses(level, spacing_m=0.4), tmp_path / "m.npz"
    maker = Maker(made)
    maker.prove(maker.coarse_to_fine()[:60])
    maker.map({}).save(path)
    seen = list[int]()
    prove = Maker.prove
    monkeypatch.setattr(Maker, "prove", lambda self, w: (seen.extend(w.tolist()), prove(self, w)))
    found = make_map(made, MapSettings(), checkpoint=path)
    assert len(seen) == len(set(seen)) == int((~made.off).sum()) - 60
    assert np.array_equal(found.verdict, make_map(made, MapSettings()).verdict)
    with refuses("friction"):
        make_map(poses(level, spacing_m=0.4, friction=0.6), MapSettings(), checkpoint=path)


def test_likely_answers_are_held_by_the_rest_of_the_map(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(making, "SHARE_OF_FIT", 0.0)
    monkeypatch.setattr(making, "CALIBRATION", 180)
    made = poses("rubble:0.4:3", spacing_m=0.5, headings=4, friction=0.4)
    maker = Maker(made)
    maker.prove(maker.coarse_to_fine()[:270])
    made_so = maker.map({}, error=None)
    path = tmp_path / "m.npz"
    monkeypatch.setattr(making.StandingMap, "read", lambda _: made_so)
    path.touch()
    settings = MapSettings(fit=True, error=0.1, time_limit_s=1e-3, epochs=15)
    found = make_map(made, settings, checkpoint=path)
    assert found.error == 0.1
    verdict = found.verdict.ravel()
    likely = np.flatnonzero((verdict == LIKELY) | (verdict == UNLIKELY))
    assert len(likely) > 100
    truth = Maker(made)
    truth.prove(likely)
    for called, right in ((LIKELY, FEASIBLE), (UNLIKELY, INFEASIBLE)):
        mine = likely[verdict[likely] == called]
        wrong = int((truth.verdict[mine] != right).sum())
        if len(mine):
            assert beta.ppf(0.01, wrong, len(mine) - wrong + 1) <= 0.1 or wrong == 0


def test_a_surrogate_of_the_robot_is_calibrated_on_the_map(
    level: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = stancekit.label("ground-6", tmp_path / "rows", rows=(20, 10), natural=True)
    surrogate = stancekit.fit(rows, "surrogate", epochs=2, width=16, layers=1)
    surrogate.save(tmp_path / "s.safetensors")
    monkeypatch.setattr(making, "SHARE_OF_FIT", 0.0)
    monkeypatch.setattr(making, "CALIBRATION", 60)
    how = {"spacing_m": 1.1, "headings": 3, "friction": 0.4, "error": 0.2, "time_limit_s": 1e-3}
    found = stancekit.map("rubble:0.4:3", surrogate=tmp_path / "s.safetensors", **how)  # type: ignore[arg-type]
    card = found.card
    assert card["surrogate"] == surrogate.digest
    assert card["learned_from"] == surrogate.provenance["learned_from"]
    assert sum(card["calibrated_on"].values()) == 60
    assert found.error == 0.2
    with refuses("fit"):
        stancekit.map(level, fit=True, surrogate=surrogate, **how)  # type: ignore[arg-type]
    three = stancekit.label("ground-3", tmp_path / "three", rows=(4, 4))
    other = stancekit.fit(three, "surrogate", epochs=1, width=16, layers=1)
    with refuses("surrogate", "ground-3"):
        stancekit.map(level, surrogate=other, **how)  # type: ignore[arg-type]
    with refuses("surrogate"):
        stancekit.map(level, surrogate=7, **how)  # type: ignore[arg-type]


def test_limits_hold_the_share_of_wrong_calls() -> None:
    rng, broken = np.random.default_rng(1), 0
    for _ in range(200):
        scores = rng.normal(size=1500)
        feasible = rng.random(1500) < 1.0 / (1.0 + np.exp(-3.0 * scores))
        low, high = making._limits(scores, feasible, 0.05, 0)
        fresh = rng.normal(size=20_000)
        truth = rng.random(20_000) < 1.0 / (1.0 + np.exp(-3.0 * fresh))
        above, below = fresh > high, fresh < low
        broken += bool(above.any() and (~truth[above]).mean() > 0.05)
        broken += bool(below.any() and truth[below].mean() > 0.05)
    assert broken <= 0.05 * 200 + 6
    assert making._limits(np.zeros(5), np.ones(5, dtype=bool), 0.005, 0) == (-np.inf, np.inf)


@pytest.mark.parametrize(
    ("how", "line"),
    [
        ({"spacing_m": 10.0}, "spacing_m"),
        ({"spacing_m": 0.0}, "spacing_m"),
        ({"headings": 0}, "headings"),
        ({"spacing_m": 1e-4, "headings": 64}, "headings"),
        ({"friction": -1.0}, "friction"),
        ({"error": 0.0}, "error"),
        ({"error": 1.0}, "error"),
        ({"time_limit_s": 0.0}, "time_limit_s"),
    ],
)
def test_bad_numbers_are_refused(level: Path, how: dict[str, float], line: str) -> None:
    with refuses(line):
        stancekit.map(level, **how)  # type: ignore[arg-type]


def test_a_file_proves_no_footholds_and_no_poses_of_another_height(
    level: Path, tmp_path: Path
) -> None:
    made, path = poses(level, spacing_m=0.4), tmp_path / "m.npz"
    plain = make_map(made, MapSettings())
    everywhere = np.full(plain.shape, FEASIBLE, dtype=np.uint8)
    replace(plain, verdict=everywhere, limit=np.ones(plain.shape, dtype=np.uint8)).save(path)
    found = make_map(made, MapSettings(), checkpoint=path)
    assert np.array_equal(found.verdict, plain.verdict)
    assert np.array_equal(found.limit, plain.limit)
    replace(plain, z_m=plain.z_m + np.float32(0.01)).save(path)
    with refuses("height"):
        make_map(made, MapSettings(), checkpoint=path)
