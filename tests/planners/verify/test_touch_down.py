"""Toes find their footholds on grounds that are drawn from the certainty of the patches that they
stand on.
"""

from dataclasses import replace

import numpy as np
import pytest

import stancekit
from stancekit.planners.formats.plan_file import read_plan, write_plan
from stancekit.planners.terrain.certainty import Certainty
from stancekit.planners.verify import check_plan
from stancekit.planners.verify.touch_down import ground_group


@pytest.fixture(scope="module")
def answer():
    rng = np.random.default_rng(0)
    heights = 0.01 * rng.standard_normal((101, 61))
    found = stancekit.terrain(stancekit.HeightField.from_array(heights, spacing_m=0.02))
    return stancekit.plan(found, start_xy_m=[-0.2, 0.0], goal_xy_m=[0.1, 0.0])


def with_certainty(plan, certainty):
    footholds = tuple(
        replace(put, candidates=tuple(patch.with_certainty(certainty) for patch in put.candidates))
        for put in plan.problem.footholds
    )
    return replace(plan, problem=replace(plan.problem, footholds=footholds))


def test_a_plan_over_a_noisy_map_has_the_group_and_its_file_keeps_it(answer, tmp_path):
    assert answer.report.accepted
    group = answer.report.group("ground")
    assert group.verdict == "holds"
    assert group.figures["found_share"] >= 0.95
    write_plan(tmp_path / "plan.json", answer.solution, answer.report)
    again = check_plan(read_plan(tmp_path / "plan.json")[0])
    assert again.group("ground").figures == group.figures


@pytest.mark.parametrize(("sd_m", "holds"), [(0.001, True), (0.005, True), (0.02, False)])
def test_a_ground_that_is_not_known_to_the_touch_down_is_refused(answer, sd_m, holds):
    sure = Certainty(about_m=[0.0, 0.0], covariance=np.diag([sd_m**2, 0.0, 0.0]), inset_m=0.02)
    group = ground_group(with_certainty(answer.solution, sure))
    assert (group.verdict == "holds") is holds
    assert group.figures["height_sd_m"] == pytest.approx(sd_m, rel=1e-3)


def test_exact_terrain_has_no_such_group(answer):
    assert ground_group(with_certainty(answer.solution, None)) is None
