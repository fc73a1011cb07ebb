"""`stancekit bench gait` measures what is missing and prints what there is."""

from __future__ import annotations

import json

import pytest

from stancekit.cli.bench import BenchGait, success_table
from stancekit.learners.evaluation import gait_bench
from tests.refusals import refuses


@pytest.fixture(autouse=True)
def measured(monkeypatch):
    """Cells of which ours takes half the iterations of the baseline."""
    asked = []

    def measure(cell, settings, folder):
        asked.append(cell)
        ours = cell.method == "decoupled"
        return {
            "success": True,
            "verified": ours,
            "iterations": 4 if ours else 8,
            "cpu_s": 2.0,
            "linear_s": 1.0,
            "outside_cone": 0.0,
            "peak_acceleration_g": 0.25,
            "violations": [0.3, 0.01, 2e-5],
            "before": {"peak_acceleration_g": 0.5},
        }

    monkeypatch.setattr(gait_bench, "measure", measure)
    return asked


def bench(tmp_path, **options):
    return BenchGait(
        out=tmp_path, terrain="ripple", chart="ambient,decoupled", tasks=12, seeds=0, **options
    )


def test_the_tables_say_success_iterations_and_ratios(tmp_path, capsys):
    assert bench(tmp_path).run() == 0
    shown = capsys.readouterr().out
    assert "100 [34, 100] / 0 [0, 66] of 2" in " ".join(shown.split())
    assert "100 [34, 100] / 100 [34, 100] of 2" in " ".join(shown.split())
    assert (
        "ours: decoupled, centred over baseline: ambient, PCDM: ripple 0.50 × iterations, 1.00 × time"
        in shown
    )
    assert "baseline: ambient, PCDM, verified below success: ripple 100 points" in shown
    assert f"{tmp_path}: cells, table.json, pictures (directions, times)" in shown
    assert {path.stem for path in tmp_path.glob("*.png")} == {
        "directions-ripple",
        "times-ripple",
    }
    records = json.loads((tmp_path / "table.json").read_text())
    assert [record["method"] for record in records] == ["ambient", "decoupled"]


def test_a_portfolios_line_says_what_a_verified_walk_costs_and_how_far_it_is_smoothed(
    tmp_path, capsys, monkeypatch
):
    row = {
        "success": True,
        "verified": True,
        "iterations": 4,
        "cpu_s": 3.0,
        "linear_s": 1.0,
        "peak_acceleration_g": 0.25,
        "before": {"peak_acceleration_g": 0.5},
    }
    monkeypatch.setattr(gait_bench, "measure", lambda cell, settings, folder: row)
    assert BenchGait(out=tmp_path, terrain="cone", chart="portfolio", tasks=24, seeds=0).run() == 0
    said = (
        "ours: portfolio, smoothed, medians of a verified walk: cone 3.0 CPU-s, peak 0.50 → 0.25 g"
    )
    shown = capsys.readouterr().out
    assert said in shown
    assert f"{tmp_path}: cells, table.json\n" in shown  # nothing to draw of solves in phases
    assert list(tmp_path.glob("*.png")) == []


def test_json_is_an_object_a_cell(tmp_path, capsys):
    assert bench(tmp_path, json=True).run() == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(row["task"], row["method"]) for row in rows] == [
        (0, "ambient"),
        (0, "decoupled"),
        (12, "ambient"),
        (12, "decoupled"),
    ]


def test_kept_cells_alone_are_shown_without_measuring(tmp_path, capsys, measured):
    with refuses(tmp_path):
        bench(tmp_path, kept=True).run()
    bench(tmp_path).run()
    count = len(measured)
    assert bench(tmp_path, kept=True).run() == 0
    assert len(measured) == count


def test_kept_cells_are_looked_for_in_a_folder_that_there_is(tmp_path):
    with refuses("typo"):
        bench(tmp_path / "typo", kept=True).run()
    assert not (tmp_path / "typo").exists()
    assert bench(tmp_path / "new" / "one").run() == 0


def test_what_was_not_measured_is_a_dash():
    record = {
        "label": "ours",
        "terrain": "ripple",
        "success": 1.0,
        "verified": 0.5,
        "success_interval": [0.342, 1.0],
        "verified_interval": [0.094, 0.906],
        "cells": 2,
        "paper": None,
    }
    table = success_table(
        [record | {"capped": 0}, record | {"label": "other", "terrain": "cone", "capped": 1}]
    )
    assert [list(column.cells) for column in table.columns] == [
        ["ours", "other"],
        ["100 [34, 100] / 50 [9, 91] of 2", "–"],
        ["–", "100 [34, 100] / 50 [9, 91] of 2 ! 1"],
    ]
    assert "–: not measured" in table.caption


def test_quick_is_one_task_a_terrain(tmp_path, measured):
    assert BenchGait(quick=True, out=tmp_path).run() == 0
    assert {(cell.terrain, cell.task, cell.seed) for cell in measured} == {
        (name, 0, 0) for name in gait_bench.TERRAINS
    }


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"terrain": "moon"}, "--terrain"),
        ({"chart": "flat"}, "--chart"),
        ({"tasks": 0}, "--tasks"),
        ({"cap": -1.0}, "--cap"),
        ({"workers": 0}, "--workers"),
    ],
)
def test_options_out_of_range_are_refused(tmp_path, options, name):
    with refuses(name):
        BenchGait(out=tmp_path, **options).run()
