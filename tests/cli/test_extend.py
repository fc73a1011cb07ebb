"""One file extends it: distributions, selectors, methods and planners that somebody else brings."""

import json
from pathlib import Path

import numpy as np
import pytest

import stancekit as library
from stancekit.envs.data.dataset import Dataset
from stancekit.planners.answer.answer_file import read_envelopes

MINE = '''
"""What somebody else brings."""

from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

import stancekit
from stancekit.planners.projection.project import project


class Slippery:
    """A distribution: the walls of paper E with nine tenths of their friction."""

    terrain = "wall"

    def sample(self, rng):
        (problem,) = stancekit.sample("wall-3", rng=rng)
        patches = [contact.patch.with_friction(0.9 * contact.patch.friction) for contact in problem.contacts]
        contacts = [replace(c, patch=patch) for c, patch in zip(problem.contacts, patches, strict=True)]
        return replace(problem, contacts=tuple(contacts))


class Widest:
    """A selector: the whole domain for every scene."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        count = observation["friction"].shape[-1]
        return np.repeat([-1.0, 1.0], 6 * count).astype(np.float32), state


def around(request):
    """A method of fitting: the box around all solutions."""
    rows = request.dataset
    box = stancekit.Envelope.around(rows.points)
    return stancekit.EnvelopeSet.for_problems(rows.problem_class, list(rows.problems()), [box], {"method": "around"})


class Centres:
    """A planner of postures: toes at the patches' centres, the rest by a linear program in (c, f) with inner cones."""

    def __init__(self, options):
        self.options = options

    def solve(self, problem):
        toes = np.array([contact.patch.centre_m for contact in problem.contacts])
        frames = np.array([contact.patch.frame for contact in problem.contacts])
        count, weight = len(toes), problem.weight_n
        forces = np.concatenate([frame for frame in frames], axis=1)
        moments = np.concatenate([np.cross(toe, frame, axisb=0, axisc=0) for toe, frame in zip(toes, frames)], axis=1)
        lever = weight * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # c × (0, 0, −m g)
        balance = np.block([[np.zeros((3, 3)), forces], [lever, moments]])
        cones = np.zeros((4 * count, 3 + 3 * count))
        for k, contact in enumerate(problem.contacts):
            for row, (axis, sign) in enumerate([(1, 1), (1, -1), (2, 1), (2, -1)]):
                cones[4 * k + row, 3 + 3 * k] = -contact.patch.friction / np.sqrt(2.0)
                cones[4 * k + row, 3 + 3 * k + axis] = sign
        room = problem.com_radius_m / np.sqrt(3.0)
        scale = problem.force_scale_n
        bounds = [(c - room, c + room) for c in problem.com_nominal_m]
        bounds += [(scale * a, scale * b) for contact in problem.contacts
                   for a, b in zip(contact.force_min, contact.force_max, strict=True)]
        found = linprog(np.zeros(3 + 3 * count), cones, np.zeros(len(cones)), balance,
                        [0.0, 0.0, weight, 0.0, 0.0, 0.0], bounds)
        if not found.success:
            return None
        local = found.x[3:].reshape(count, 3)
        world = np.einsum("kij,kj->ki", frames, local)
        return stancekit.Posture(com_m=found.x[:3], rotation_rad=np.zeros(3), toes_m=toes, forces_n=world)


def onward(programs, scaled, start, steps):
    """A projection: SCP from where holding the toes ends."""
    return project(programs, "scp", scaled, project(programs, "fix-toes", scaled, start), steps=steps)


def dreamt(programs, scaled, start, steps):
    """A projection that leaves everything where it is and says that it holds."""
    return replace(start, residual=0.0)


class Boaster(Centres):
    """Says feasible of everything, with nothing to show."""

    def solve(self, problem):
        return stancekit.Outcome(status=stancekit.Status.FEASIBLE, method="boast")


def bare(options):
    """A planner of courses: the two-stage planner with all of the friction, its plan alone."""

    class Bare:
        def solve(self, course):
            return stancekit.plan(course, reserve=False).plan

    return Bare()


class Dreamer:
    """A planner of courses that plans for a course with twice the friction."""

    def __init__(self, options):
        pass

    def solve(self, course):
        def gripping(patch):
            return patch.with_friction(2.0 * patch.friction + 1.0)

        footholds = [replace(p, candidates=tuple(map(gripping, p.candidates))) for p in course.footholds]
        easy = replace(course, terrain=tuple(map(gripping, course.terrain)), footholds=tuple(footholds))
        return stancekit.plan(easy, reserve=False).plan
'''


@pytest.fixture
def mine(tmp_path: Path) -> str:
    (tmp_path / "mine.py").write_text(MINE)
    return "mine.py"


def test_a_distribution_is_drawn_labelled_learned_and_compared(mine, stancekit, tmp_path):
    drawn = stancekit("sample", f"{mine}:Slippery", "--count", 2).records
    plain = stancekit("sample", "wall-3", "--count", 2).records
    for ours, theirs in zip(drawn, plain, strict=True):
        rows = zip(ours["contacts"], theirs["contacts"], strict=True)
        assert [a["friction"] / b["friction"] for a, b in rows] == pytest.approx([0.9] * 3)
    quota = ("--feasible", 6, "--infeasible", 6, "--shard-size", 6)
    for workers in (1, 2):
        ran = stancekit("label", f"{mine}:Slippery", f"data{workers}", *quota, "--workers", workers, "--json")
        assert (ran.code, ran.records[0]["rows"]["feasible"]) == (0, 6)
    one, two = (Dataset.open(tmp_path / f"data{workers}") for workers in (1, 2))
    assert [p.to_json() for p in one.problems()] == [p.to_json() for p in two.problems()]
    assert stancekit("verify", "data1", "--json").records[0]["accepted"]
    assert stancekit("fit", "data1", "--method", "quantile", "--out", "e.json").code == 0
    (row,) = stancekit("evaluate", "data1", "--envelope", "e.json", "--no-lift", "--project", "fix-p", "--json").records
    assert (row["selector"], row["p1_feasible_of"], row["p1_infeasible_of"]) == ("e", 6, 6)


def test_a_distribution_in_yaml_is_the_built_in_one_with_its_own_numbers(stancekit, write, tmp_path):
    write("ice.yaml", "terrain: wall\nlegs: [RF, RR, LM]\nfriction: [0.0, 0.05]\n")
    for record in stancekit("sample", "ice.yaml", "--count", 4).records:
        assert all(0.0 <= contact["friction"] <= 0.05 for contact in record["contacts"])
    write("same.yaml", "terrain: wall\nlegs: [RF, RR, LM]\nfriction: [0.1, 1.2]\n")
    assert stancekit("sample", "same.yaml").out == stancekit("sample", "wall-3").out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "terrain: moon\nlegs: [RF]\nfriction: [0, 1]\n",
            "d.yaml: terrain: expected ground, wall, or a terrain's file, got 'moon'",
        ),
        ("terrain: wall\nlegs: [XX]\nfriction: [0, 1]\n", "d.yaml: leg: expected one of LF, LM"),
        ("terrain: wall\nlegs: [RF]\nfriction: [2, 1]\n", "d.yaml: friction: expected 0 ≤ low ≤ high, got 2 and 1"),
        ("terrain: wall\nlegs: [RF]\nfriction: [0, 1]\nice: 1\n", "d.yaml: ice: "),
    ],
)
def test_a_wrong_distribution_in_yaml_is_one_line(text, words, refusal, write):
    assert refusal("sample", write("d.yaml", text)).startswith(words)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_selector_is_compared_beside_the_others(workers, mine, stancekit, labelled):
    ran = stancekit(
        "evaluate", labelled, "--selector", f"{mine}:Widest", "--no-lift", "--project", "scp", "--workers", workers,
        "--json",
    )  # fmt: skip
    (row,) = ran.records
    assert (row["selector"], row["p1_feasible_of"]) == ("Widest", 8)
    assert row["p1_feasible"] == 1.0  # P1 over the whole domain admits whatever is feasible


def test_a_method_of_fitting_writes_what_its_file_says(mine, stancekit, labelled, tmp_path):
    (record,) = stancekit("fit", labelled, "--method", f"{mine}:around", "--out", "e.json", "--json").records
    assert record["provenance"] == {"method": "around"}
    rows, (box,) = Dataset.open(labelled), read_envelopes(tmp_path / "e.json").envelopes
    np.testing.assert_allclose(box.low, rows.points.min(axis=0))


def test_a_planner_of_postures_answers_through_the_verifier(mine, stancekit, write, sampled):
    problems = write("p.jsonl", *sampled["ground-3"], *sampled["wall-3"])
    ran = stancekit("solve", problems, "--method", f"{mine}:Centres", "--out", "a.jsonl", "--json")
    exact = [line["status"] for line in stancekit("solve", problems, "--json").records]
    found = [line["status"] for line in ran.records]
    assert found.count("feasible") > 2
    assert found.count("undecided") > 2
    assert all(theirs == "feasible" for ours, theirs in zip(found, exact, strict=True) if ours == "feasible")
    checked = stancekit("verify", problems, "a.jsonl", "--json").records
    assert [line["verdict"] for line in checked] == [{"feasible": "accepted"}.get(ours, "unclaimed") for ours in found]


def test_a_planner_that_only_claims_decides_nothing(mine, stancekit, write, sampled):
    ran = stancekit("solve", write("p.json", sampled["wall-3"][0]), "--method", f"{mine}:Boaster", "--json")
    assert (ran.records[0]["status"], ran.records[0]["claim"]) == ("undecided", "feasible")


def test_a_projection_is_named_wherever_one_is_and_verified(mine, stancekit, labelled, write, sampled):
    (row,) = stancekit("evaluate", labelled, "--project", f"{mine}:onward", "--json").records
    (known,) = stancekit("evaluate", labelled, "--project", "scp", "--json").records
    assert row[f"project_{mine}:onward"] >= known["project_scp"] > 0.9
    problems = write("p.jsonl", *sampled["wall-3"])
    said = {}
    for name in ("scp", f"{mine}:onward", f"{mine}:dreamt"):
        ran = stancekit("solve", problems, "--method", "lift", "--project", name, "--json")
        said[name] = [line["status"] for line in ran.records]
    assert said["scp"].count("feasible") > 2
    assert said[f"{mine}:onward"] == said["scp"]
    assert "feasible" not in said[f"{mine}:dreamt"]
    ran = stancekit("plan", "walls", "--frames", 2, "--projection", f"{mine}:onward", "--json")
    assert ran.records[0]["status"] == "feasible"


def test_a_planner_of_courses_answers_through_the_verifier(mine, stancekit):
    ran = stancekit("plan", "walls", "--frames", 3, "--planner", f"{mine}:bare", "--out", "climb.json", "--json")
    (record,) = ran.records
    assert (ran.code, record["status"], record["verdict"]["accepted"]) == (0, "feasible", True)
    assert record["bound"] is None  # nobody has proved one
    assert stancekit("verify", "climb.json").code == 0


def test_a_plan_of_an_easier_course_is_refused(mine, stancekit):
    ran = stancekit("plan", "icy-walls", "--frames", 3, "--planner", f"{mine}:Dreamer", "--json")
    assert (ran.code, ran.records[0]["status"]) == (1, "undecided")
    assert ran.records[0]["message"].startswith("plan refused: rejected: ")


def test_an_installed_package_is_found_by_its_entry_points(mine, stancekit, labelled, tmp_path, monkeypatch):
    site = tmp_path / "site"
    (site / "wide-0.1.dist-info").mkdir(parents=True)
    (site / "wide.py").write_text(MINE)
    (site / "wide-0.1.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: wide\nVersion: 0.1\n")
    groups = {"distributions": "Slippery", "selectors": "Widest", "methods": "around", "planners": "Centres",
              "course_planners": "bare", "projections": "onward"}  # fmt: skip
    lines = [f"[stancekit.{group}]\nour-{group} = wide:{name}\n" for group, name in groups.items()]
    (site / "wide-0.1.dist-info" / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(site)
    assert stancekit("sample", "our-distributions").records[0]["contacts"]
    assert stancekit("fit", labelled, "--method", "our-methods", "--out", "e.json").code == 0
    assert stancekit("plan", "walls", "--frames", 2, "--planner", "our-course_planners").code == 0
    ours = ("--no-lift", "--project", "our-projections", "--json")
    (row,) = stancekit("evaluate", labelled, "--selector", "our-selectors", *ours).records
    assert row["selector"] == "our-selectors"
    assert library.solve(library.sample("ground-3", rng=3)[0], "our-planners").method == "our-planners"
    assert "our-methods" in stancekit("fit", "--help").out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("sample", "moon"), "distribution: expected one of ground-3, wall-3, wall-5, or FILE.py:NAME, got 'moon'"),
        (("sample", "mine.py:Nobody"), "mine.py: expected 'Nobody' in it, found no such name; it defines Slippery, "),
        (("sample", "mine.py:around"), "distribution mine.py:around: expected something with sample(rng), or a class "),
        (("solve", "p.json", "--method", "luck"), "--method: expected one of exact, p1, lift, two-stage, nlp, micp, "),
        (("plan", "walls", "--planner", "luck"), "--planner: expected one of two-stage, micp, nlp, decoupled, exact, "),
        (("plan", "walls", "--planner", "none.py:A"), "none.py: expected a file, found nothing there"),
    ],
)
def test_what_is_not_there_is_one_line(arguments, words, mine, refusal, write, problem):
    write("p.json", json.dumps(problem))
    assert refusal(*arguments).startswith(words)


FAULTY = """
import numpy as np


class Scenes:
    def sample(self, rng):
        raise RuntimeError("no scene today")


class Bare:
    def predict(self, observation):
        return np.zeros(36)


class Short:
    def predict(self, observation):
        return np.zeros(3), None


class Plain:
    def predict(self, observation):
        return np.repeat([-1.0, 1.0], 6 * observation["friction"].shape[-1]), None


class Wants:
    def __init__(self, more):
        pass

    def predict(self, observation):
        return None

    solve = sample = predict


def plans():
    return None
"""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("evaluate", "data", "--selector", "own.py:Bare"), "selector {own}:Bare: expected (action, state), got a nda"),
        (("evaluate", "data", "--selector", "own.py:Short"), "action: expected shape (36,), got (3,)"),
        (("evaluate", "data", "--selector", "own.py:Wants"), "selector own.py:Wants: expected something with predict("),
        (("sample", "own.py:Wants"), "distribution own.py:Wants: expected something with sample(rng), or a class of "),
        (("solve", "p.json", "--method", "own.py:plans"), "method own.py:plans: expected something to call with Plann"),
        (("plan", "walls", "--planner", "own.py:plans"), "planner own.py:plans: expected something to call with Plann"),
        (("fit", "data", "--method", "own.py:plans", "--out", "e.json"), "method own.py:plans: expected something to "),
        (("warp", "own.py:plans"), "terrain own.py:plans: expected a height field, a Terrain, or a function of x and "),
    ],
)
def test_what_a_file_of_ones_own_does_wrong_is_one_line(arguments, words, refusal, write, problem, labelled, tmp_path):
    write("p.json", json.dumps(problem))
    own = write("own.py", FAULTY)
    given = [labelled if word == "data" else word for word in arguments]
    assert refusal(*given).startswith(words.format(own=tmp_path / own))


def test_what_a_file_of_ones_own_raises_is_one_line_with_its_place(stancekit, write, tmp_path):
    ran = stancekit("sample", write("own.py", FAULTY) + ":Scenes")
    where = f"{tmp_path / 'own.py'} line 7"
    line = f"stancekit: failed: {where}: RuntimeError: no scene today; STANCEKIT_TRACE=1 shows more\n"
    assert (ran.code, ran.err) == (1, line)


def test_a_selector_that_takes_the_observation_alone_is_enough(stancekit, write, labelled):
    write("own.py", FAULTY)
    ran = stancekit("evaluate", labelled, "--selector", "own.py:Plain", "--no-lift", "--project", "scp", "--json")
    assert ran.records[0]["p1_feasible"] == 1.0


def test_modes_are_learned_from_labelled_terrains_and_planned_with(stancekit):
    for name in ("ground-3", "wall-3"):
        assert stancekit("label", name, name, "--feasible", 120, "--infeasible", 1, "--shard-size", 121).code == 0
    fitted = stancekit("fit", "ground-3", "wall-3", "--method", "modes", "--share", 0, "--out", "modes.json", "--json")
    assert (fitted.code, fitted.records[0]["modes"], fitted.records[0]["problem_class"]) == (0, 2, "ground+wall")
    ran = stancekit("plan", "ground-to-wall", "--envelope", "modes.json", "--out", "climb.json", "--json")
    assert (ran.code, ran.records[0]["status"]) == (0, "feasible")
    assert set(ran.records[0]["plan"]["modes"]) == {0, 1}
    assert stancekit("verify", "climb.json").code == 0


def test_modes_want_a_data_set_a_terrain(refusal, labelled):
    asked = ("fit", labelled, "--method", "modes", "--out", "m.json")
    assert refusal(*asked) == "data sets: expected two or more, one a mode, got 1"
    assert refusal("fit", labelled, labelled, "--method", "gmm", "--out", "m.json") == "data sets: expected one, got 2"
