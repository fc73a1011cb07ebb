"""The bench of gaits measures by the paper's protocol, keeps every cell, and counts what it has."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from stancekit.learners.evaluation import gait_bench
from stancekit.learners.evaluation.gait_bench import (
    METHODS,
    PAPER,
    GaitBenchSettings,
    GaitCell,
    cells,
    gait_task,
    kept,
    quartiles,
    ratios,
    run,
    table,
)
from stancekit.planners.errors import PlanningFailed
from stancekit.planners.gait.settings import GaitSettings
from tests.refusals import refuses

FAST = GaitBenchSettings(
    terrains=("ripple", "hill"), methods=("ambient", "decoupled"), every=8, seeds=1
)


def row(method, terrain="ripple", task=0, seed=0, **figures):
    return {
        "method": method,
        "terrain": terrain,
        "task": task,
        "seed": seed,
        "success": True,
        "verified": True,
    } | figures


@pytest.fixture
def measured(monkeypatch):
    """Cells that were measured, instead of measuring them."""
    asked = []

    def measure(cell, settings, folder):
        asked.append(cell)
        return {"success": True, "verified": False, "iterations": 3, "cpu_s": 1.5, "linear_s": 1.0}

    monkeypatch.setattr(gait_bench, "measure", measure)
    return asked


def test_the_whole_bench_is_the_papers_protocol():
    every = cells(GaitBenchSettings())
    tasks = {
        name: len({cell.task for cell in every if cell.terrain == name})
        for name in gait_bench.TERRAINS
    }
    assert tasks == {"ripple": 24, "cone": 24, "hill": 15, "pit": 15}
    assert {cell.seed for cell in every} == {0, 1, 2, 3}
    assert len(every) == len(set(every)) == (24 + 24 + 15 + 15) * 4 * len(METHODS)
    assert GaitBenchSettings().iterations == 200
    assert GaitSettings().tolerance == 1e-4


def test_a_run_that_stops_early_has_seen_all_terrains_and_methods():
    first = cells(FAST)[:4]
    assert [(cell.terrain, cell.method) for cell in first] == [
        ("ripple", "ambient"),
        ("ripple", "decoupled"),
        ("hill", "ambient"),
        ("hill", "decoupled"),
    ]
    ripples = [
        cell.task for cell in cells(FAST) if cell.terrain == "ripple" and cell.method == "ambient"
    ][:3]
    assert ripples == [0, 16, 8]


def test_the_published_methods_have_the_papers_dynamics_and_every_method_can_be_set():
    for name, method in METHODS.items():
        settings = GaitSettings(**method.settings)
        assert (name in ("ambient", "warped", "ambient-lbfgs", "warped-lbfgs")) == (
            settings.dynamics == "printed"
        )
        assert settings.hessian == ("lbfgs" if name.endswith("lbfgs") else "exact")
    assert set(PAPER) <= set(METHODS)
    assert [PAPER["warped-lbfgs"][name] for name in gait_bench.TERRAINS] == [0.92, 1.0, 1.0, 0.13]


def test_robots_in_pits_face_their_goal():
    task = gait_task("pit", 5)
    way = task.goal - task.start
    assert [
        gait_bench.math.cos(task.start_yaw_rad),
        gait_bench.math.sin(task.start_yaw_rad),
    ] == pytest.approx(way / 2.2)
    assert task.adhesive == (True, True, False, False)
    assert gait_task("ripple", 5).start_yaw_rad == 0.0


def test_cells_are_kept_and_not_measured_again(tmp_path, measured):
    first = list(run(FAST, tmp_path))
    count = len(measured)
    assert count == len(first) == len(cells(FAST))
    assert list(run(FAST, tmp_path)) == first
    assert kept(FAST, tmp_path) == first
    assert len(measured) == count


def test_another_protocol_measures_anew(tmp_path, measured):
    list(run(FAST, tmp_path))
    count = len(measured)
    assert kept(replace(FAST, noise=0.05), tmp_path) == []
    list(run(replace(FAST, noise=0.05), tmp_path))
    assert len(measured) == 2 * count


def test_a_cell_without_a_solve_is_a_row(tmp_path, monkeypatch):
    monkeypatch.setattr(
        gait_bench, "measure", lambda *_: {"success": False, "verified": False, "status": "folds"}
    )
    assert kept(FAST, tmp_path) == []
    assert kept(FAST, tmp_path) == [] != list(run(FAST, tmp_path)) == kept(FAST, tmp_path)


def test_a_run_that_was_stopped_goes_on(tmp_path, measured):
    begun = run(FAST, tmp_path)
    for _ in range(3):
        next(begun)
    begun.close()
    assert len(kept(FAST, tmp_path)) == 3
    assert len(list(run(FAST, tmp_path))) == len(cells(FAST))
    assert len(measured) == len(cells(FAST))


def test_a_cell_is_a_solve_and_the_verifiers_word(tmp_path):
    settings = GaitBenchSettings(terrains=("ripple",), methods=("decoupled",), every=24, seeds=0)
    (found,) = run(settings, tmp_path)
    assert found["success"]
    assert found["verified"] == (found["refused"] == [])
    assert found["violations"][-1] < 1e-4 <= found["violations"][-2]
    assert found["iterations"] == len(found["violations"]) - 1
    assert found["cpu_s"] == pytest.approx(found["evaluating_s"] + found["linear_s"])
    assert found["outside_cone"] == 0.0
    assert json.loads((tmp_path / "ripple-00-0-decoupled.json").read_text())["row"] == found


def test_a_terrain_without_a_map_is_a_failure_that_says_why(tmp_path, monkeypatch):
    def folds(terrain, folder):
        raise PlanningFailed("the map folds")

    monkeypatch.setattr(gait_bench, "_map", folds)
    found = gait_bench.measure(GaitCell("pit-87", 0, 0, "warped"), GaitBenchSettings(), tmp_path)
    assert found == {
        "success": False,
        "verified": False,
        "status": "the map folds",
        "message": "the map folds",
    }


def test_shares_and_quartiles_are_of_the_cells_that_are_there():
    rows = [
        row("ambient-lbfgs", iterations=k, cpu_s=1.0, linear_s=0.25, verified=k > 2)
        for k in (1, 2, 3, 4, 5)
    ]
    rows.append(
        {
            **row("ambient-lbfgs", iterations=200, cpu_s=99.0, capped=True),
            "success": False,
            "verified": False,
        }
    )
    (record,) = table(rows)
    assert record["cells"] == 6
    assert record["success"] == pytest.approx(5 / 6)
    assert record["verified"] == pytest.approx(3 / 6)
    assert record["paper"] == 0.48
    assert record["capped"] == 1
    assert record["iterations"] == [2.0, 3.0, 4.0]  # of those that succeeded
    assert record["linear_share"] == [0.25, 0.25, 0.25]
    assert record["peak_g"] is None
    assert quartiles([]) is None


def test_the_share_of_cells_that_leave_the_cone_is_of_those_that_succeeded():
    rows = [row("warped", outside_cone=value, cpu_s=1.0, linear_s=0.5) for value in (0.0, 0.1, 0.2)]
    rows.append(
        {
            **row("warped", outside_cone=0.5, cpu_s=9.0, linear_s=1.0),
            "success": False,
            "verified": False,
        }
    )
    (record,) = table(rows)
    assert record["left_cone"] == pytest.approx(2 / 3)
    assert record["verified_cpu_s"] == [1.0, 1.0, 1.0]
    (record,) = table([{**row("warped"), "success": False}])
    assert record["left_cone"] is None


def test_ratios_compare_cells_in_which_both_succeeded():
    rows = [row("ambient", task=k, iterations=10, cpu_s=2.0) for k in range(3)]
    rows += [row("decoupled", task=k, iterations=5, cpu_s=3.0) for k in range(2)]
    rows += [{**row("decoupled", task=2, iterations=200, cpu_s=90.0), "success": False}]
    assert ratios(rows, "decoupled") == {"ripple": 0.5}
    assert ratios(rows, "decoupled", "cpu_s") == {"ripple": 1.5}
    assert ratios(rows, "warped") == {}


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"terrains": ("moon",)}, "terrains"),
        ({"methods": ()}, "methods"),
        ({"every": 0}, "every"),
        ({"cap_s": 0.0}, "cap_s"),
    ],
)
def test_settings_out_of_range_are_refused(settings, name):
    with refuses(name):
        GaitBenchSettings(**settings)
