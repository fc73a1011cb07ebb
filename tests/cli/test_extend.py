"""One file extends it: what somebody else brings, by FILE.py:NAME and by entry point."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import stancekit as library
from stancekit import Certificate, Motion
from stancekit.envs.data.dataset import Dataset
from stancekit.planners.formats.question_file import answer_from_json, read_envelopes
from stancekit.planners.problem import Problem
from stancekit.planners.problem.course_file import read_course
from stancekit.planners.problem.course_terrain import family_keys
from stancekit.planners.search import methods
from stancekit.planners.terrain.reference import named_terrain
from stancekit.planners.verify import check_certificate, check_plan
from tests.refusals import assert_names

MINE = '''
"""What somebody else brings."""

from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

import stancekit
from stancekit.planners.gait.charts.warped import Shear
from stancekit.planners.projection.project import project
from stancekit.planners.terrain.polygon import surface_patch


class Slippery:
    """A distribution: the walls of paper E with nine tenths of their friction."""

    terrain = "wall"

    def sample(self, rng):
        (problem,) = stancekit.sample("wall-3", rng=rng)
        patches = [contact.patch.with_friction(0.9 * contact.patch.friction) for contact in problem.contacts]
        contacts = [replace(c, patch=patch) for c, patch in zip(problem.contacts, patches, strict=True)]
        return problem.posture_with(contacts=tuple(contacts))


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
        room = problem.com_radius_m[0] / np.sqrt(3.0)
        scale = problem.force_scale_n
        bounds = [(c - room, c + room) for c in problem.com_nominal_m[0]]
        bounds += [(scale * a, scale * b) for contact in problem.contacts
                   for a, b in zip(contact.force_min, contact.force_max, strict=True)]
        found = linprog(np.zeros(3 + 3 * count), cones, np.zeros(len(cones)), balance,
                        [0.0, 0.0, weight, 0.0, 0.0, 0.0], bounds)
        if not found.success:
            return None
        local = found.x[3:].reshape(count, 3)
        world = np.einsum("kij,kj->ki", frames, local)
        return stancekit.Motion.of_posture(problem, com_m=found.x[:3], rotation_rad=np.zeros(3), toes_m=toes,
                                         forces_n=world)


def onward(programs, scaled, start, steps):
    """A projection: SCP from where holding the toes ends."""
    return project(programs, "scp", scaled, project(programs, "fix-toes", scaled, start), steps=steps)


def dreamt(programs, scaled, start, steps):
    """A projection that leaves everything where it is and says that it holds."""
    return replace(start, residual=0.0)


def bare(options):
    """A planner of courses: the two-stage planner with all of the friction, its plan alone."""

    class Bare:
        def solve(self, course):
            return stancekit.plan(course, stancekit.TwoStage(reserve=False)).solution

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
        return stancekit.plan(easy, stancekit.TwoStage(reserve=False)).solution


def halves(level, rng):
    """height of the left half over the right: 0.1 · level m"""
    friction = rng.uniform(0.6, 0.9)
    sides = ((-0.8, 0.0, 0.0), (0.0, 0.8, 0.1 * level))
    corners = ((-0.8, 0), (1.1, 0), (1.1, 1), (-0.8, 1))
    return [surface_patch(np.array([(x, side[k], side[2]) for x, k in corners]), friction) for side in sides]


def rolling(difficulty, rng):
    """A random terrain: one wave."""
    phase = rng.uniform(0.0, 6.28)
    return lambda x, y: 0.1 * difficulty * np.sin(2.0 * x + phase) + 0.0 * y


def bump(x, y):
    """A terrain."""
    return 0.08 * np.exp(-(x**2) - y**2)


class Sheared(Shear):
    """A chart."""
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
        ran = stancekit(
            "label", f"{mine}:Slippery", f"data{workers}", *quota, "--workers", workers, "--json"
        )
        assert (ran.code, ran.records[0]["rows"]["feasible"]) == (0, 6)
    one, two = (Dataset.open(tmp_path / f"data{workers}") for workers in (1, 2))
    assert [p.to_json() for p in one.problems()] == [p.to_json() for p in two.problems()]
    assert stancekit("verify", "data1", "--json").records[0]["accepted"]
    assert stancekit("fit", "data1", "--method", "quantile", "--out", "e.json").code == 0
    assert stancekit("label", f"{mine}:Slippery", "fresh", *quota, "--seed", 1).code == 0
    projected = ("--projection", "fix-p", "--no-lift", "--json")
    (row,) = stancekit("evaluate", "fresh", "--envelopes", "e.json", *projected).records
    assert (row["selector"], row["p1_feasible_of"], row["p1_infeasible_of"]) == ("e", 6, 6)


def test_a_distribution_in_yaml_is_the_built_in_one_with_its_own_numbers(
    stancekit, write, tmp_path
):
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
            "d.yaml: terrain: expected ground, wall, or a terrain's file or name, got 'moon'",
        ),
        ("terrain: wall\nlegs: [XX]\nfriction: [0, 1]\n", "d.yaml: leg: expected one of LF, LM"),
        (
            "terrain: wall\nlegs: [RF]\nfriction: [2, 1]\n",
            "d.yaml: friction: expected 0 ≤ low ≤ high, got 2 and 1",
        ),
        ("terrain: wall\nlegs: [RF]\nfriction: [0, 1]\nice: 1\n", "d.yaml: ice: "),
    ],
)
def test_a_wrong_distribution_in_yaml_is_one_line(text, words, refusal, write):
    assert refusal("sample", write("d.yaml", text)).startswith(words)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_selector_is_compared_beside_the_others(workers, mine, stancekit, labelled):
    ran = stancekit(
        "evaluate",
        labelled,
        "--selector",
        f"{mine}:Widest",
        "--no-lift",
        "--projection",
        "scp",
        "--workers",
        workers,
        "--json",
    )
    (row,) = ran.records
    assert (row["selector"], row["p1_feasible_of"]) == ("Widest", 8)
    assert row["p1_feasible"] == 1.0  # P1 over the whole domain admits whatever is feasible


def test_a_method_of_fitting_writes_what_its_file_says(mine, stancekit, labelled, tmp_path):
    (record,) = stancekit(
        "fit", labelled, "--method", f"{mine}:around", "--out", "e.json", "--json"
    ).records
    assert record["provenance"]["method"] == "around"
    assert list(record["provenance"]["code"]) == ["mine.py"]
    rows, (box,) = Dataset.open(labelled), read_envelopes(tmp_path / "e.json").envelopes
    np.testing.assert_allclose(box.low, rows.points.min(axis=0))


def test_a_planner_of_postures_answers_through_the_verifier(mine, stancekit, write, sampled):
    problems = write("p.jsonl", *sampled["ground-3"], *sampled["wall-3"])
    ran = stancekit("solve", problems, "--method", f"{mine}:Centres", "--out", "a.jsonl", "--json")
    exact = [line["status"] for line in stancekit("solve", problems, "--json").records]
    found = [line["status"] for line in ran.records]
    assert found.count("feasible") > 2
    assert found.count("undecided") > 2
    assert all(
        theirs == "feasible"
        for ours, theirs in zip(found, exact, strict=True)
        if ours == "feasible"
    )
    checked = stancekit("verify", problems, "a.jsonl", "--json").records
    assert [line["verdict"] for line in checked] == [
        {"feasible": "accepted"}.get(ours, "unclaimed") for ours in found
    ]


def test_a_projection_is_named_wherever_one_is_and_verified(
    mine, stancekit, labelled, write, sampled
):
    (row,) = stancekit("evaluate", labelled, "--projection", f"{mine}:onward", "--json").records
    (known,) = stancekit("evaluate", labelled, "--projection", "scp", "--json").records
    assert row[f"project_{mine}:onward"] >= known["project_scp"] > 0.9
    problems = write("p.jsonl", *sampled["wall-3"])
    said = {}
    for name in ("scp", f"{mine}:onward", f"{mine}:dreamt"):
        ran = stancekit("solve", problems, "--method", "lift", "--projection", name, "--json")
        said[name] = [line["status"] for line in ran.records]
    assert said["scp"].count("feasible") > 2
    assert said[f"{mine}:onward"] == said["scp"]
    assert "feasible" not in said[f"{mine}:dreamt"]
    ran = stancekit("plan", "walls", "--frames", 2, "--projection", f"{mine}:onward", "--json")
    assert ran.records[0]["status"] == "feasible"


def test_a_planner_of_courses_answers_through_the_verifier(mine, stancekit):
    ran = stancekit(
        "plan", "walls", "--frames", 3, "--method", f"{mine}:bare", "--out", "climb.json", "--json"
    )
    (record,) = ran.records
    assert (ran.code, record["status"], record["verdict"]["accepted"]) == (0, "feasible", True)
    assert record["bound"] is None  # nobody has proved one
    assert stancekit("verify", "climb.json").code == 0


def test_a_plan_of_an_easier_course_is_refused(mine, stancekit):
    ran = stancekit("plan", "icy-walls", "--frames", 3, "--method", f"{mine}:Dreamer", "--json")
    assert (ran.code, ran.records[0]["status"]) == (1, "undecided")
    assert ran.records[0]["message"].startswith("plan refused: rejected: ")


def test_scenes_of_a_family_are_planned(mine, stancekit, tmp_path):
    scene = f"{mine}:halves:0.5:7"
    (record,) = stancekit("plan", scene, "--out", "walk.json", "--json").records
    assert (record["status"], record["verdict"]["accepted"]) == ("feasible", True)
    heights = {vertex[2] for patch in read_course(scene).terrain for vertex in patch.vertices_m}
    assert heights == {0.0, 0.05}
    (tmp_path / mine).unlink()
    assert stancekit("verify", "walk.json").code == 0  # a plan's file holds its terrain


def test_a_random_terrain_is_drawn_by_difficulty_and_seed(mine, stancekit):
    drawn = named_terrain(f"{mine}:rolling:0.5:7")
    phase = np.random.Generator(np.random.PCG64(7)).uniform(0.0, 6.28)
    place = np.array([2.0, 1.3])  # beyond the level middle
    assert float(drawn.height(place)) == pytest.approx(0.05 * np.sin(4.0 + phase), abs=1e-4)
    walk = ("--goal", "0.2,0.1", "--duration-s", "2", "--raw", "--out", "walk.json", "--json")
    assert stancekit("gait", f"{mine}:rolling:0.5:7", *walk).code == 0


def test_a_course_names_no_file_that_would_be_run(mine, refusal, write):
    course = write(
        "c.yaml",
        yaml.safe_dump(
            {
                **family_keys("gaps:0.1"),
                "terrain": {"kind": "family", "family": f"{mine}:halves", "level": 0.5},
            }
        ),
    )
    assert_names(refusal("plan", course), "c.yaml", "terrain.family")


def test_an_installed_package_is_found_by_its_entry_points(
    mine, stancekit, labelled, tmp_path, monkeypatch
):
    site = tmp_path / "site"
    (site / "wide-0.1.dist-info").mkdir(parents=True)
    (site / "wide.py").write_text(MINE)
    (site / "wide-0.1.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: wide\nVersion: 0.1\n"
    )
    groups = {
        "distributions": "Slippery",
        "selectors": "Widest",
        "methods": "around",
        "planners": "Centres",
        "projections": "onward",
        "families": "halves",
        "terrains": "bump",
        "charts": "Sheared",
    }
    lines = [f"[stancekit.{group}]\nour-{group} = wide:{name}\n" for group, name in groups.items()]
    lines.insert(1 + list(groups).index("planners"), "our-climbs = wide:bare\n")
    (site / "wide-0.1.dist-info" / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(site)
    assert stancekit("sample", "our-distributions").records[0]["contacts"]
    assert stancekit("fit", labelled, "--method", "our-methods", "--out", "e.json").code == 0
    assert stancekit("plan", "walls", "--frames", 2, "--method", "our-climbs").code == 0
    ours = ("--no-lift", "--projection", "our-projections", "--json")
    (row,) = stancekit("evaluate", labelled, "--selector", "our-selectors", *ours).records
    assert row["selector"] == "our-selectors"
    assert (
        library.solve(library.sample("ground-3", rng=3)[0], "our-planners").method == "our-planners"
    )
    assert "our-methods" in stancekit("fit", "--help").out
    assert stancekit("plan", "our-families:0.2:1", "--frames", 2).code == 0
    raw = (
        "--goal",
        "0.1,0.1",
        "--duration-s",
        "2",
        "--raw",
        "--chart",
        "our-charts",
        "--out",
        "walk.json",
        "--json",
    )
    (answer,) = stancekit("gait", "our-terrains", *raw).records
    assert answer["attempts"][0]["chart"] == "our-charts"
    assert stancekit("verify", "walk.json").code == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("sample", "moon"),
            "distribution: expected one of ground-3, wall-3, wall-5, "
            "another ground-k, wall-k or terrain-k, a YAML file, or FILE.py:NAME, got 'moon'",
        ),
        (
            ("sample", "mine.py:Nobody"),
            "mine.py: expected 'Nobody' in it, found no such name; it defines Slippery, ",
        ),
        (
            ("sample", "mine.py:around"),
            "distribution mine.py:around: expected something with sample(rng), or a class ",
        ),
        (
            ("solve", "p.json", "--method", "luck"),
            "--method: expected one of exact, p1, lift, two-stage, nlp, micp, ",
        ),
        (
            ("plan", "walls", "--method", "luck"),
            "--method: expected one of two-stage, micp, nlp, decoupled, exact, ",
        ),
        (
            ("plan", "walls", "--method", "none.py:A"),
            "none.py: expected a file, found nothing there",
        ),
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


def scattered(level, rng):
    return 3
"""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("evaluate", "data", "--selector", "own.py:Bare"),
            "selector own.py:Bare: expected (action, state), got a n",
        ),
        (
            ("evaluate", "data", "--selector", "own.py:Short"),
            "selector own.py:Short: action: expected shape (36,), al",
        ),
        (
            ("evaluate", "data", "--selector", "own.py:Wants"),
            "selector own.py:Wants: expected something with predict(",
        ),
        (
            ("sample", "own.py:Wants"),
            "distribution own.py:Wants: expected something with sample(rng), or a class of ",
        ),
        (
            ("solve", "p.json", "--method", "own.py:plans"),
            "method own.py:plans: expected something to call with Plann",
        ),
        (
            ("plan", "walls", "--method", "own.py:plans"),
            "method own.py:plans: expected something to call with Plann",
        ),
        (
            ("fit", "data", "--method", "own.py:plans", "--out", "e.json"),
            "method own.py:plans: expected a function ",
        ),
        (
            ("plan", "own.py:scattered:0.5"),
            "family own.py:scattered: expected a Terrain, a list of patches or a ",
        ),
        (
            ("plan", "own.py:plans:0.5"),
            "family own.py:plans: expected a function of a level and a generator",
        ),
        (
            ("warp", "own.py:scattered:0.5:1"),
            "family own.py:scattered: expected a Terrain, a list of patches or a function of x and y, got 3",
        ),
        (
            ("warp", "own.py:plans"),
            "terrain own.py:plans: expected a height field, or a function of x and ",
        ),
    ],
)
def test_what_a_file_of_ones_own_does_wrong_is_one_line(
    arguments, words, refusal, write, problem, labelled
):
    write("p.json", json.dumps(problem))
    write("own.py", FAULTY)
    given = [labelled if word == "data" else word for word in arguments]
    assert refusal(*given).startswith(words)


def test_what_a_file_of_ones_own_raises_is_one_line_with_its_place(stancekit, write, tmp_path):
    ran = stancekit("sample", write("own.py", FAULTY) + ":Scenes")
    where = f"{tmp_path / 'own.py'} line 7"
    line = (
        f"stancekit: failed: {where}: RuntimeError: no scene today; STANCEKIT_TRACE=1 shows more\n"
    )
    assert (ran.code, ran.err) == (1, line)


def test_a_selector_that_takes_the_observation_alone_is_enough(stancekit, write, labelled):
    write("own.py", FAULTY)
    ran = stancekit(
        "evaluate",
        labelled,
        "--selector",
        "own.py:Plain",
        "--no-lift",
        "--projection",
        "scp",
        "--json",
    )
    assert ran.records[0]["p1_feasible"] == 1.0


def test_modes_are_learned_from_labelled_terrains_and_planned_with(stancekit):
    for name in ("ground-3", "wall-3"):
        assert (
            stancekit(
                "label", name, name, "--feasible", 120, "--infeasible", 1, "--shard-size", 121
            ).code
            == 0
        )
    fitted = stancekit(
        "fit",
        "ground-3",
        "wall-3",
        "--method",
        "modes",
        "--share",
        0,
        "--out",
        "modes.json",
        "--json",
    )
    assert (fitted.code, fitted.records[0]["modes"], fitted.records[0]["problem_class"]) == (
        0,
        2,
        "ground+wall",
    )
    ran = stancekit(
        "plan", "ground-to-wall", "--envelopes", "modes.json", "--out", "climb.json", "--json"
    )
    assert (ran.code, ran.records[0]["status"]) == (0, "feasible")
    assert set(ran.records[0]["plan"]["modes"]) == {0, 1}
    assert stancekit("verify", "climb.json").code == 0


def test_modes_want_a_data_set_a_terrain(refusal, labelled):
    asked = ("fit", labelled, "--method", "modes", "--out", "m.json")
    assert_names(refusal(*asked), "data sets")
    assert_names(
        refusal("fit", labelled, labelled, "--method", "gmm", "--out", "m.json"), "data sets"
    )


LIARS = '''
"""Each is asked about one problem, and answers another."""
import sys
from dataclasses import replace
import numpy as np
import stancekit
from stancekit.planners.search.exact import Exact
from stancekit.planners.search.two_stage import TwoStage

def easier(problem):
    contacts = (replace(c, patch=c.patch.with_friction(c.patch.friction + 3.0), reach_m=3.0 * c.reach_m)
                for c in problem.contacts)
    return problem.posture_with(contacts=tuple(contacts), com_radius_m=0.5)

def harder(problem):
    return problem.posture_with(contacts=tuple(replace(c, reach_m=0.01) for c in problem.contacts))

def changed(subject, into):
    vars(subject).clear()
    vars(subject).update(vars(into))
    return into

class Planner:
    def __init__(self, options):
        self.options = options

class Dreams(Planner):
    def solve(self, problem):
        return Exact().solve(easier(problem))

class GivesUp(Planner):
    def solve(self, problem):
        return Exact().solve(harder(problem)).certificate

class MakesEasier(Planner):
    def solve(self, problem):
        return Exact().solve(changed(problem, easier(problem)))

class MakesHarder(Planner):
    def solve(self, problem):
        return Exact().solve(changed(problem, harder(problem)))

class WritesArrays(Planner):
    def solve(self, problem):
        for contact in problem.contacts:
            for array in (contact.force_max, contact.patch.vertices_m):
                array.setflags(write=True)
                array *= 0.5
        return Exact().solve(problem)

class Tolerant(Planner):
    def solve(self, problem):
        object.__setattr__(self.options.acceptance, "tolerance", 1e9)
        object.__setattr__(self.options.acceptance, "gap", -1e9)
        return Dreams(self.options).solve(problem)

class Late(Planner):
    """Its posture is another one every other time that it is looked at."""
    def solve(self, problem):
        found = Exact().solve(problem).solution
        class Shifting(stancekit.Motion):
            def to_json(self):
                return {**stancekit.Motion.to_json(self), "com_m": [0.0, 0.0, 9.0]}
        return found and Shifting(**{name: value for name, value in vars(found).items()})

class EasierCourse(Planner):
    """It changes the course that it is given, and the plan is good for what that is now."""
    def solve(self, course):
        def gripping(patch):
            return patch.with_friction(patch.friction + 3.0)
        puts = tuple(replace(p, candidates=tuple(map(gripping, p.candidates))) for p in course.footholds)
        rough = replace(course, terrain=tuple(map(gripping, course.terrain)), footholds=puts)
        return TwoStage().solve(changed(course, rough)).solution
'''
GARBAGE = """
import sys
import numpy as np
import stancekit
from stancekit.planners.answer.answer import Answer

def returning(thing):
    class Planner:
        def __init__(self, options):
            pass
        def solve(self, problem):
            return thing() if callable(thing) else thing
    return Planner

def raising(error):
    def wrong():
        raise error
    return returning(wrong)

def said(**words):
    return returning(stancekit.Answer(**{"status": stancekit.Status.UNDECIDED, "method": "mine", **words}))

def told(**words):
    return returning(Answer(**{"status": stancekit.Status.UNDECIDED, "method": "mine", **words}))

class Wordless(Exception):
    def __str__(self):
        raise ValueError

Text, Number, Table = returning("feasible"), returning(5), returning({"status": "feasible"})
Empty, EmptyPosture = (returning(object.__new__(kind)) for kind in (stancekit.Answer, stancekit.Motion))
Raises, Leaves, LeavesQuietly = raising(ValueError("so\\nit is")), raising(SystemExit("bye")), raising(SystemExit(0))
Piped, Deep, Silent = raising(BrokenPipeError("pipe")), raising(RecursionError("deep")), raising(Wordless())
PostureText, ProofNumber, StatusText = said(solution="here"), said(certificate=3), said(status="maybe")
Message, Claim, Details, Solves = said(message=object()), said(claim=b"x"), said(details={"a": []}), said(
    effort=stancekit.Effort(solves="x")
)
CourseMessage, CourseProof = told(message=object()), told(certificate="no")
Blank = returning(object.__new__(stancekit.Motion))

class Prints(returning(None)):
    def solve(self, problem):
        print('{"status": "feasible"}')

class Solveless:
    def __init__(self, options):
        pass

class Unmakeable:
    def __init__(self, options):
        raise KeyError("mine")

def leaves(options):
    sys.exit(0)

def nothing(options):
    return None

def wants_nothing():
    pass
"""
SHORT = "walls", "--frames", 2


@pytest.fixture
def liars(tmp_path: Path) -> str:
    (tmp_path / "liars.py").write_text(LIARS)
    return "liars.py"


@pytest.fixture
def garbage(tmp_path: Path) -> str:
    (tmp_path / "garbage.py").write_text(GARBAGE)
    return "garbage.py"


@pytest.mark.parametrize(
    "name", ["Dreams", "GivesUp", "MakesEasier", "MakesHarder", "WritesArrays", "Tolerant", "Late"]
)
def test_whatever_a_planner_does_an_answer_is_one_to_the_problem_that_was_asked(
    name, liars, stancekit, write, sampled
):
    problems = [Problem.from_json(item) for item in sampled["wall-3"][:6]]
    ran = stancekit(
        "solve",
        write("p.jsonl", *sampled["wall-3"][:6]),
        "--method",
        f"{liars}:{name}",
        "--certificate",
        "--json",
    )
    assert (ran.code, ran.err, len(ran.records)) == (0, "", 6)
    truth = [library.solve(problem).status.value for problem in problems]
    assert {"feasible", "infeasible"} <= set(truth)
    for problem, line, true in zip(problems, ran.records, truth, strict=True):
        assert line["status"] in (true, "undecided")
        answer = answer_from_json(line, problem)
        if line["status"] == "feasible":
            assert isinstance(answer, Motion)
            assert check_plan(answer).accepted
        elif line["status"] == "infeasible":
            assert isinstance(answer, Certificate)
            assert check_certificate(answer).accepted
        assert problem.to_json() in sampled["wall-3"][:6]
    if name == "Late":
        assert "feasible" in [line["status"] for line in ran.records]


def test_a_planner_that_changes_its_course_plans_for_none_that_was_asked_for(liars, stancekit):
    ran = stancekit(
        "plan", "icy-walls", "--frames", 3, "--method", f"{liars}:EasierCourse", "--json"
    )
    assert (ran.code, ran.records[0]["status"]) == (1, "undecided")
    assert ran.records[0]["message"].startswith("plan refused: rejected: ")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Text", "expected an Answer, a Motion, a Certificate or None, got a str, 'feasible'"),
        ("Number", "expected an Answer, a Motion, a Certificate or None, got a int, 5"),
        ("Table", "expected an Answer, a Motion, a Certificate or None, got a dict, "),
        ("Empty", "AttributeError: 'Answer' object has no attribute "),
        ("EmptyPosture", "AttributeError: 'Motion' object has no attribute "),
        ("Raises", "ValueError: so it is"),
        ("Leaves", "SystemExit: bye"),
        ("LeavesQuietly", "SystemExit: 0"),
        ("Piped", "BrokenPipeError: pipe"),
        ("Deep", "RecursionError: deep"),
        ("Silent", "Wordless: "),
        ("PostureText", "expected a Motion as evidence, got a str, 'here'"),
        ("ProofNumber", "expected a Certificate as evidence, got a int, 3"),
        ("StatusText", "ValueError: 'maybe' is not a valid Status"),
        ("Message", "expected text in its outcome, got a object, "),
        ("Claim", "expected text in its outcome, got a bytes, "),
        ("Details", "TypeError: float() argument must be "),
        ("Solves", "ValueError: invalid literal for int()"),
        ("Solveless", "expected something with solve, got a Solveless, "),
        ("nothing", "expected something with solve, got a NoneType, None"),
        ("Unmakeable", "KeyError: 'mine'"),
        ("leaves", "SystemExit: 0"),
        ("wants_nothing", "expected something to call with PlannerOptions, got <function wan"),
    ],
)
def test_a_planner_that_is_none_is_one_line(name, said, garbage, stancekit, write, problem):
    ran = stancekit("solve", write("p.json", json.dumps(problem)), "--method", f"{garbage}:{name}")
    where = "" if "p.json" not in ran.err else "p.json: "
    assert ran.code == 2
    assert ran.err.startswith(f"stancekit: error: {where}method {garbage}:{name}: {said}")
    assert ran.err.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Text", "expected an Answer, a Motion, a Certificate or None, got a str, 'feasible'"),
        ("Blank", "AttributeError: 'Motion' object has no attribute "),
        ("CourseMessage", "expected text in its outcome, got a object, "),
        ("CourseProof", "expected a Certificate as evidence, got a str, 'no'"),
        ("Raises", "ValueError: so it is"),
        ("LeavesQuietly", "SystemExit: 0"),
        ("Solveless", "expected something with solve, got a Solveless, "),
        ("leaves", "SystemExit: 0"),
    ],
)
def test_a_planner_of_courses_that_is_none_is_one_line(name, said, garbage, refusal):
    assert refusal("plan", *SHORT, "--method", f"{garbage}:{name}").startswith(
        f"method {garbage}:{name}: {said}"
    )


def test_what_a_planner_prints_is_no_result(garbage, stancekit, write, problem):
    ran = stancekit(
        "solve", write("p.json", json.dumps(problem)), "--method", f"{garbage}:Prints", "--json"
    )
    assert [line["status"] for line in ran.records] == ["undecided"]
    assert ran.err == '{"status": "feasible"}\n'


def test_a_file_that_ends_the_program_is_one_line(refusal, write, problem, tmp_path):
    (tmp_path / "quits.py").write_text("raise SystemExit(0)\n")
    asked = ("solve", write("p.json", json.dumps(problem)), "--method", "quits.py:Planner")
    assert_names(refusal(*asked), "quits.py")


@pytest.mark.parametrize(("said", "claim"), [("", "feasible"), ("optimal", "optimal")])
def test_who_takes_over_a_name_of_the_package_is_verified_like_any_other(
    monkeypatch, problem, said, claim
):
    class Boaster:
        def __init__(self, options):
            pass

        def solve(self, problem):
            return library.Answer(status=library.Status.FEASIBLE, method="exact", claim=said)

    monkeypatch.setitem(methods.PLANNERS._things, "exact", Boaster)
    outcome = library.solve(Problem.from_json(problem), "exact")
    assert (outcome.status, outcome.claim) == (library.Status.UNDECIDED, claim)
