"""The newest change wins: nothing is queued, what is stale is dropped, and judging goes on beside
it.
"""

from __future__ import annotations

import threading

import numpy as np
import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.views.playground import pictures as session_module
from stancekit.views.playground.keys_scenario import KeysScenario
from stancekit.views.playground.page_parts import (
    SceneAnswer,
    cone_share,
    limb_table,
    loads,
    margins,
    verdict,
)
from stancekit.views.playground.pictures import Session
from stancekit.views.playground.playground import Files, struck
from tests.refusals import refuses

PATIENCE_S = 60.0


def test_of_many_changes_during_one_answer_only_the_newest_is_answered(monkeypatch):
    begun, go_on, seen, last = threading.Event(), threading.Event(), [], threading.Event()

    def slow(scenario):
        begun.set()
        assert go_on.wait(PATIENCE_S)
        return SceneAnswer(message=str(scenario))

    def on_answer(number, scenario, answer, since):
        seen.append((number, answer.message))
        if answer.message == "9":
            last.set()

    monkeypatch.setattr(session_module, "quick_answer", slow)
    pictures = Session(0, on_answer, judges=False)
    pictures.start()
    assert begun.wait(PATIENCE_S)
    for _ in range(9):
        pictures.change(lambda number: number + 1)
    go_on.set()
    assert last.wait(PATIENCE_S)
    pictures.close()
    assert seen == [(0, "0"), (9, "9")]


def test_a_slow_edit_keeps_what_others_changed_meanwhile():
    begun, go_on = threading.Event(), threading.Event()
    pictures = Session((), lambda *_: None, judges=False)

    def slow(scenario):
        begun.set()
        assert go_on.wait(PATIENCE_S)
        return (*scenario, "slow")

    waits = threading.Thread(target=pictures.change, args=(slow,))
    waits.start()
    assert begun.wait(PATIENCE_S)
    pictures.change(lambda scenario: (*scenario, "quick"))
    go_on.set()
    waits.join(PATIENCE_S)
    assert pictures.scenario == ("quick", "slow")
    assert pictures.number == 2


def test_an_edit_that_is_refused_changes_nothing():
    pictures = Session(KeysScenario.of("walls"), lambda *_: None, judges=False)

    def edit(scenario):
        raise InvalidInput("no")

    with pytest.raises(InvalidInput):
        pictures.change(edit)
    assert pictures.number == 0
    pictures.close()


def test_a_scene_at_rest_is_judged_in_another_process_and_a_stale_verdict_is_dropped():
    answers, accepted, quick = [], threading.Event(), threading.Event()

    def on_answer(number, scenario, answer, since):
        answers.append((number, answer.patient))
        if number == 0:
            quick.set()
        if number == 1 and answer.accepted:
            accepted.set()

    pictures = Session(KeysScenario.of("walls", frames=2), on_answer, rest_s=0.0)
    pictures.start()
    assert quick.wait(PATIENCE_S)
    pictures.change(lambda scenario: scenario.slid("friction", 0.9))
    assert accepted.wait(PATIENCE_S)
    pictures.close()
    assert answers[0] == (0, False)
    assert answers[-1] == (1, True)
    assert answers.index((1, False)) < answers.index((1, True))
    assert (0, True) not in answers[answers.index((1, False)) :]


def test_shares_of_cones_are_those_of_the_definition():
    normal = np.array([0.0, 1.0, 0.0])
    assert cone_share(np.array([3.0, 10.0, 4.0]), normal, 0.5) == pytest.approx(1.0)
    assert cone_share(np.array([0.0, 10.0, 2.0]), normal, 0.8) == pytest.approx(0.25)
    assert np.isnan(cone_share(np.zeros(3), normal, 0.5))
    assert cone_share(np.array([0.0, 5.0, 0.0]), normal, 0.0) == 0.0


def test_tables_say_what_the_plan_has_with_units_and_names_are_text(monkeypatch):
    from stancekit.planners.motion.plan_motion import PlanMotion
    from stancekit.views.playground.page_parts import patient_answer, solver_of

    answer = patient_answer(KeysScenario.of("walls", frames=3))
    plan = answer.plan
    assert plan is not None
    now = PlanMotion(plan).key(2)
    rows = loads(plan, now, solver_of(plan.problem))
    assert [row.force_n for row in rows] == pytest.approx(np.linalg.norm(plan.forces_at(2), axis=1))
    share, frame, limb = margins(plan)
    assert 0.0 < share <= 0.8 + 1e-6  # it is planned with 80 % of the friction
    assert limb in plan.problem.robot.limb_names
    assert 0 <= frame < 3
    assert answer.report is not None
    assert max(row.torque for row in rows) <= answer.report.group("torque").figures["share"] + 1e-6
    table = limb_table(rows, "<b>here</b>")
    assert "force [N]" in table
    assert "torque [Nm]" in table
    assert "&lt;b&gt;here" in table
    assert "<script" not in verdict(SceneAnswer(message="<script>alert(1)</script>"), 3, 12.0)


def test_a_ray_meets_the_nearest_patch():
    course = KeysScenario.of("walls").course()
    assert struck(course, [0.0, 0.0, 0.3], [0.0, 1.0, 0.0]) == 0
    assert struck(course, [0.0, 0.0, 0.3], [0.0, -1.0, 0.0]) == 1
    assert struck(course, [0.0, -2.0, 0.3], [0.0, 1.0, 0.0]) == 1
    assert struck(course, [0.0, 0.0, 0.3], [1.0, 0.0, 0.0]) is None


class _Named:
    value = "played"


@pytest.mark.parametrize("name", ["", "..", "a/b", "/etc/x", ".hidden", "../x"])
def test_files_are_written_in_the_folder_and_nowhere_else(name, tmp_path):
    files = Files.__new__(Files)
    files._folder, files._name = tmp_path, _Named()
    files._now = lambda: (KeysScenario.of("walls"), SceneAnswer())
    assert files.save_course() == tmp_path / "played-course.yaml"
    files._name.value = name
    with refuses("name"):
        files.save_course()
    with refuses("plan"):
        files.save_plan()
