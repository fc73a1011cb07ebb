"""Table II: cells are measured once, kept, and measured again only under other settings."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from stancekit.cli.bench import speed_ups, table
from stancekit.learners.evaluation.planner_bench import (
    PlannerBenchSettings,
    growth,
    run,
)
from tests.refusals import refuses

SMALL = PlannerBenchSettings(
    two_stage=(1,), micp=(1,), optimised=(), cap_s=60.0, repeats=1, samples=100
)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    return folder, list(run(SMALL, folder))


def test_a_run_goes_on_with_what_is_missing(measured):
    folder, rows = measured
    kept, gone = folder / "lift-1.json", folder / "envelope-1.json"
    whole = json.loads(kept.read_text())
    kept.write_text(json.dumps(whole | {"row": whole["row"] | {"seconds": 123.0}}))
    gone.unlink()
    again = list(run(SMALL, folder))
    assert again[0]["seconds"] == 123.0  # not measured again
    assert again[1]["status"] == "feasible"
    assert again[2:] == rows[2:]
    other = next(run(replace(SMALL, repeats=2), folder))
    assert other["seconds"] != 123.0  # other settings: measured again


def test_a_broken_envelope_file_is_refused(tmp_path):
    (tmp_path / "envelope.json").write_text('{"format": "stancekit/envelope/1"}')
    with refuses("envelope.json"):
        next(run(SMALL, tmp_path))


def test_growth_is_the_exponent_of_the_frames():
    rows = [{"method": "x", "frames": m, "cpu_s": 0.1 * m**1.5} for m in (4, 8, 16)]
    assert growth(rows, "x") == pytest.approx(1.5)
    assert np.isnan(growth(rows[:1], "x"))


def test_speed_ups_compare_programs_of_as_many_intervals_and_say_what_a_time_limit_hides():
    def row(method, cpu_s, capped=False):
        return {"method": method, "frames": 4, "optimised": False, "cpu_s": cpu_s, "capped": capped}

    rows = [
        row("MICP, K = 4", 8.0, True),
        row("MICP, K = 4, envelope rows", 2.0),
        row("MICP, K = 2", 1.0),
        row("MICP, K = 2, shrunk grid", 4.0, True),
        row("two-stage, lift", 0.1),
    ]
    assert speed_ups(rows) == [
        "MICP, K = 4, envelope rows, M = 4: ≥ 4.0 ×",
        "MICP, K = 2, shrunk grid, M = 4: ≤ 0.2 ×",
    ]


def test_the_table_has_a_row_a_cell_and_the_papers_times(measured):
    _, rows = measured
    shown = table([*rows, rows[2] | {"frames": 8, "capped": True, "paper": {"more_than": 1000}}])
    assert shown.row_count == len(rows) + 1
    assert all(column.header for column in shown.columns)
    assert [
        list(column.cells)[-1]
        for column in shown.columns
        if column.header in ("M", "answer", "paper s")
    ] == ["8", "feasible", "> 1000"]
