"""Labels of leaps: tries follow from the plan alone, and the verifier judges each one's evidence
without a solver.
"""

import json
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import stancekit
from stancekit.envs.data.leap_tries import LeapTries, open_rows
from stancekit.envs.data.ledger import TryPlan
from stancekit.learners.data import leap_tries
from stancekit.learners.data.executors import executor
from stancekit.learners.data.leap_tries import label_leaps, recheck_leaps, scene
from stancekit.planners.errors import InvalidInput
from stancekit.planners.leap.finder import tries_of
from stancekit.planners.leap.numbers import LeapNumbers
from stancekit.planners.problem.leap_classes import leap_class, leap_to_json
from stancekit.planners.verify.leaps import check_leap
from tests.learners.data.test_labelling import Backwards, contents
from tests.refusals import refuses

PLAN = TryPlan(
    distribution="leap-hard",
    scenes=5,
    tries={"random": 4, "finder": 3, "noise": 2},
    shard_size=18,
    seed=3,
)
RUN = """
import json, sys
from stancekit.envs.data.ledger import TryPlan
from stancekit.learners.data.leap_tries import label_leaps

plan, path = json.loads(sys.argv[1])
label_leaps(TryPlan(**plan), path, progress=lambda p: input(f"{p.shards_done}\\n"))
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tries that were labelled without any interruption, in one process."""
    path = tmp_path_factory.mktemp("whole") / "set"
    label_leaps(PLAN, path)
    return path


@pytest.fixture
def tries(whole: Path) -> LeapTries:
    return LeapTries.open(whole)


@pytest.fixture
def copy(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "copy"))


def test_every_scene_has_the_planned_tries_of_each_order_and_no_choice_twice(whole: Path) -> None:
    rows = LeapTries.open(whole).tries()
    assert len(rows["scene"]) == PLAN.rows == 45
    for number in range(PLAN.scenes):
        own = rows["scene"] == number
        assert rows["order"][own].tolist() == ["random"] * 4 + ["finder"] * 3 + ["noise"] * 2
        assert rows["number"][own].tolist() == list(range(9))
        assert len(np.unique(rows["choice"][own], axis=0)) == 9
    assert set(rows["label"]) == {"solved", "refuted", "unsolved"}
    assert [tally.rows.total for tally in LeapTries.open(whole).ledger.tallies.values()] == [
        18,
        18,
        9,
    ]


def test_scenes_are_those_of_the_class_to_the_last_bit(tries: LeapTries) -> None:
    arrays = tries.scenes()
    assert arrays["vertices_m"].shape == (5, 8, 8, 3, 3)
    for number, leap in enumerate(tries.leaps()):
        drawn = leap_class("leap-hard").draw(
            np.random.default_rng([PLAN.seed, number]), f"leap-hard-3-{number}"
        )
        assert leap_to_json(leap) == leap_to_json(drawn) == leap_to_json(tries.leap(number))
        for j, foothold in enumerate(drawn.footholds):
            for r, patch in enumerate(foothold.candidates):
                assert np.array_equal(arrays["vertices_m"][number, j, r], patch.vertices_m)
                assert np.array_equal(arrays["normals"][number, j, r], patch.normal)
                assert arrays["friction"][number, j, r] == patch.friction
        assert np.array_equal(arrays["goal"][number, 0], drawn.goal.com_m)
    with refuses("scene 5", kind=IndexError):
        tries.leap(5)


def test_toes_that_stand_already_have_one_candidate_and_come_back_as_they_were(
    tmp_path: Path,
) -> None:
    label_leaps(replace(PLAN, distribution="leap-given", scenes=2, tries={"random": 1}), tmp_path)
    tries = LeapTries.open(tmp_path)
    arrays = tries.scenes()
    assert arrays["candidates"].tolist() == [[1] * 4 + [8] * 4] * 2
    assert arrays["vertices_m"].shape == (2, 8, 8, 4, 3)
    assert np.isnan(arrays["vertices_m"][:, 4:, :, 3]).all()
    assert np.isnan(arrays["friction"][:, :4, 1:]).all()
    assert np.isnan(arrays["stands_m"]).any(axis=2).tolist() == [[False] * 4 + [True] * 4] * 2
    assert leap_to_json(tries.leap(1)) == leap_to_json(scene(tries.header.plan, 1))


def test_each_label_has_its_evidence_and_nothing_else(tries: LeapTries) -> None:
    rows = tries.tries()
    for name, label in (("toes_m", "solved"), ("forces_n", "solved"), ("multipliers", "refuted")):
        there = ~np.isnan(rows[name]).reshape(len(tries), -1).any(axis=1)
        assert np.array_equal(there, rows["label"] == label)
    solved = np.flatnonzero(rows["label"] == "solved")
    assert len(solved) >= 2
    for index in solved.tolist():
        plan = tries.plan(index)
        assert check_leap(plan).accepted
        assert np.array_equal(plan.choice, rows["choice"][index])
    with refuses("try 0"):
        tries.plan(0)
    assert (rows["cost"][solved] <= 1e-6).all()
    assert np.isinf(rows["first_cost"][rows["label"] == "refuted"]).all()


def test_plans_come_back_to_the_last_bit(tries: LeapTries) -> None:
    index = int(np.flatnonzero(tries.tries()["label"] == "solved")[0])
    number = int(tries.tries()["scene"][index])
    seed = int(np.random.default_rng([PLAN.seed, number, 1]).integers(2**62))
    made = tries_of(scene(PLAN, number), PLAN.tries, seed=seed)  # type: ignore[arg-type]
    plan, kept = made[int(tries.tries()["number"][index])].plan, tries.plan(index)
    assert plan is not None
    for name in ("com_m", "velocity_m_s", "momentum_m2_s", "rotation_rad", "toes_m", "forces_n"):
        assert np.array_equal(getattr(plan, name), getattr(kept, name))


def test_two_processes_and_any_order_write_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    label_leaps(PLAN, tmp_path / "two", run=executor(workers=2))
    label_leaps(PLAN, tmp_path / "backwards", run=Backwards())
    assert contents(tmp_path / "two") == contents(tmp_path / "backwards") == contents(whole)


def test_a_run_that_is_killed_goes_on_to_the_same_bytes(whole: Path, tmp_path: Path) -> None:
    task = json.dumps([asdict(PLAN), str(tmp_path)])
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    run = subprocess.Popen([sys.executable, "-c", RUN, task], text=True, **pipes)
    while run.stdout.readline().strip() != "1":
        print(file=run.stdin, flush=True)
    print(file=run.stdin, flush=True)  # on with the next shard, after which it waits
    time.sleep(0.05)
    run.send_signal(signal.SIGKILL)
    run.wait()
    before = {file: file.stat().st_mtime_ns for file in tmp_path.glob("shard-*.parquet")}
    assert 1 <= len(before) < PLAN.shards
    seen: list[int] = []
    label_leaps(PLAN, tmp_path, progress=lambda p: seen.append(p.shards_done))
    assert seen == list(range(len(before), PLAN.shards + 1))
    assert all(file.stat().st_mtime_ns == then for file, then in before.items())
    assert contents(tmp_path) == contents(whole)


def test_the_verifier_accepts_all_rows_without_a_solver(
    monkeypatch: pytest.MonkeyPatch, tries: LeapTries
) -> None:
    monkeypatch.setattr("stancekit.planners.equilibrium.rows.Rows.solve", None)
    summary, report = tries.summary(), stancekit.verify(tries)
    assert report.accepted
    assert (report.witnesses, report.certificates) == (summary.solved, summary.refuted)
    assert summary.solved + summary.refuted + summary.unsolved == len(tries)
    assert report.smallest_bound > 0.0
    assert report.worst_residual < 1e-3


def rewritten(path: Path, shard: int, change: dict[str, np.ndarray]) -> None:
    """Write a shard anew with other columns, and its own tally."""
    file = path / f"shard-{shard:05d}.parquet"
    table = pq.read_table(file)
    for name, values in change.items():
        kind = table.schema.field(name).type
        storage = kind.storage_type if isinstance(kind, pa.FixedShapeTensorType) else kind
        cells = (
            [None if np.isnan(v).any() else v.ravel() for v in values]
            if values.ndim > 1
            else values.tolist()
        )
        array = pa.array(cells, storage)
        array = pa.ExtensionArray.from_storage(kind, array) if storage is not kind else array
        table = table.set_column(
            table.schema.get_field_index(name), table.schema.field(name), array
        )
    pq.write_table(table, file, write_page_checksum=True)


@pytest.mark.parametrize("forged", ["force", "toe", "multipliers", "choice", "label"])
def test_forged_evidence_is_refused_row_by_row(copy: Path, forged: str) -> None:
    tries = LeapTries.open(copy)
    starts, labels = tries.ledger.starts, tries.tries()["label"]
    begin, shard = next(
        (starts[k], k) for k in range(3) if len(set(labels[starts[k] : starts[k + 1]])) == 3
    )
    rows = {name: values[begin : starts[shard + 1]] for name, values in tries.tries().items()}
    solved, refuted, unsolved = (
        int(np.flatnonzero(rows["label"] == label)[0])
        for label in ("solved", "refuted", "unsolved")
    )
    if forged == "force":
        rows["forces_n"][solved, 0, 0, 2] += 5.0
    elif forged == "toe":
        rows["toes_m"][solved, 3] += 0.2
    elif forged == "multipliers":
        rows["multipliers"][refuted] *= -1.0
    elif forged == "choice":
        rows["choice"][[solved, refuted]] = 99
    else:
        rows["label"][unsolved] = "refuted"
    name = {"force": "forces_n", "toe": "toes_m"}.get(forged, forged)
    rewritten(copy, shard, {name: rows[name]})
    expected = {
        "force": {solved},
        "toe": {solved},
        "multipliers": {refuted},
        "choice": {solved, refuted},
    }
    report = recheck_leaps(LeapTries.open(copy))
    assert {index - begin for index in report.refused} == expected.get(forged, {unsolved})
    assert not report.accepted


@pytest.mark.parametrize(("row", "scene"), [(-1, 99), (0, -1), (1, 1), (-1, 0)])
def test_rows_of_scenes_that_are_not_the_shards_are_refused_by_every_reader(
    copy: Path, row: int, scene: int
) -> None:
    """Such rows are of no scene that a verifier looks at: any label would pass."""
    scenes = pq.read_table(copy / "shard-00000.parquet").column("scene").to_numpy().copy()
    scenes[row] = scene
    rewritten(copy, 0, {"scene": scenes})
    tries = LeapTries.open(copy)
    for read in (
        lambda: recheck_leaps(tries),
        tries.tries,
        tries.scenes,
        lambda: list(tries.leaps()),
    ):
        with refuses("shard-00000.parquet", "scene"):
            read()


def test_rows_that_say_other_scenes_than_their_first_are_refused(copy: Path) -> None:
    file = copy / "shard-00000.parquet"
    table = pq.read_table(file)
    friction = table.column("friction").to_pylist()
    friction[1] = [50.0] * len(friction[1])
    place = table.schema.get_field_index("friction")
    pq.write_table(
        table.set_column(
            place, table.schema.field(place), pa.array(friction, table.schema.field(place).type)
        ),
        file,
    )
    with refuses("shard-00000.parquet", "friction"):
        recheck_leaps(LeapTries.open(copy))


def test_a_solved_try_that_a_cut_of_its_scene_refutes_is_refused(
    monkeypatch: pytest.MonkeyPatch, tries: LeapTries
) -> None:
    rows = tries.tries()
    numbers = set(rows["scene"][rows["label"] == "refuted"].tolist())
    contradicted = [
        k for k in np.flatnonzero(rows["label"] == "solved").tolist() if rows["scene"][k] in numbers
    ]
    assert contradicted
    monkeypatch.setattr(
        leap_tries.Refuter, "bounds", lambda self, timing, row, choices: np.ones(len(choices))
    )
    assert recheck_leaps(tries).refused == tuple(contradicted)


def test_a_cut_bounds_choices_as_the_search_does(whole: Path) -> None:
    """Two programs: the planner's in arrays, and the verifier's, written from patches and limbs."""
    from stancekit.planners.leap.prove import proof_cut
    from stancekit.planners.verify.leap_proof import Refuter

    tries, rng = LeapTries.open(whole), np.random.default_rng(0)
    rows = tries.tries()
    refuted = np.flatnonzero(rows["label"] == "refuted")[::3]
    assert len(refuted) >= 4
    for index in refuted.tolist():
        leap = tries.leap(int(rows["scene"][index]))
        row = rows["multipliers"][index].astype(np.float64)
        choices = rng.integers(8, size=(20, 8))
        cut = proof_cut(LeapNumbers.of(leap), row)
        found = Refuter(leap).bounds(0, row, choices)
        assert np.allclose(found, [cut.value(choice) for choice in choices], atol=1e-9)
    assert np.isneginf(Refuter(leap).bounds(1, row, choices)).all()
    assert np.isneginf(Refuter(leap).bounds(0, row[1:], choices)).all()
    assert np.isneginf(Refuter(leap).bounds(0, np.full_like(row, np.nan), choices)).all()
    assert np.isneginf(Refuter(leap).bounds(0, row, choices + 8)).all()


def test_leaps_with_few_choices_have_fewer_tries(tmp_path: Path) -> None:
    few = leap_class("leap-few").model_copy(update={"candidates": 1})
    leap = few.draw(np.random.default_rng(0))
    assert len(tries_of(leap, {"random": 3, "finder": 2}, seed=0)) == 1


def test_damaged_shards_are_one_line(copy: Path) -> None:
    path = copy / "shard-00001.parquet"
    content = path.read_bytes()
    path.write_bytes(content[:100])
    with refuses(path):
        open_rows(copy)
    middle = len(content) // 3
    path.write_bytes(content[:middle] + bytes([content[middle] ^ 255]) + content[middle + 1 :])
    with refuses(path):
        recheck_leaps(LeapTries.open(copy))
    path.unlink()
    with refuses("shard-00001.parquet"):
        LeapTries.open(copy)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": 4}, "seed: expected 4 as planned, got 3"),
        ({"scenes": 6}, "scenes: expected 6 as planned, got 5"),
        (
            {"tries": {"random": 1}},
            "tries: expected {'random': 1} as planned, got {'random': 4, 'finder': 3, 'noise': 2}",
        ),
        (
            {"distribution": "leap-few"},
            "distribution: expected 'leap-few' as planned, got 'leap-hard'",
        ),
    ],
)
def test_another_plan_is_refused_and_changes_nothing(
    whole: Path, changes: dict[str, object], message: str
) -> None:
    before = contents(whole)
    with pytest.raises(InvalidInput) as error:
        label_leaps(replace(PLAN, **changes), whole)  # type: ignore[arg-type]
    assert str(error.value) == f"{whole}/header.json: {message}"
    assert contents(whole) == before


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"scenes": 0}, "scenes"),
        (
            {"tries": {}},
            "tries",
        ),
        (
            {"tries": {"no": 1}},
            "tries",
        ),
        ({"tries": {"rule": -1}}, "tries"),
        ({"shard_size": 0}, "shard_size"),
        ({"stop": 0.0}, "stop"),
        (
            {"scenes": 10**9},
            "shard_size",
        ),
    ],
)
def test_plans_out_of_range_are_refused(given: dict[str, object], message: str) -> None:
    with refuses(message):
        replace(PLAN, **given)  # type: ignore[arg-type]


def test_equal_plans_are_equal_whatever_the_sequence_of_their_tries() -> None:
    other = replace(PLAN, tries={"noise": 2, "finder": 3, "rule": 0, "random": 4})
    assert asdict(other) == asdict(PLAN)
    assert list(other.tries) == ["random", "finder", "noise"]


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("leap-far", {"scenes": 1}, "distribution"),
        ("leap-hard", {}, "scenes"),
        (
            "leap-hard",
            {"scenes": 1, "rows": 5},
            "rows",
        ),
        (
            "leap-hard",
            {"scenes": 1, "robot": "anymal"},
            "robot",
        ),
        (
            "leap-hard",
            {"scenes": 1, "natural": True},
            "natural",
        ),
        (
            "leap-hard",
            {"scenes": 1, "screen": "a.safetensors"},
            "screen",
        ),
        ("wall-3", {"scenes": 1}, "scenes"),
        ("wall-3", {"tries": {"rule": 1}}, "tries"),
    ],
)
def test_arguments_without_use_are_refused_by_name(
    name: str, given: dict[str, object], message: str, tmp_path: Path
) -> None:
    with refuses(message):
        stancekit.label(name, tmp_path / "set", **given)  # type: ignore[call-overload]
    assert not (tmp_path / "set").exists()


def test_the_two_kinds_of_data_sets_are_not_taken_for_each_other(
    whole: Path, tmp_path: Path
) -> None:
    for do in (
        lambda: stancekit.Dataset.open(whole),
        lambda: LeapTries.open("pool-wall-3"),
        lambda: stancekit.label("wall-3", whole, rows=(1, 1)),
    ):
        with refuses("header.json", "format"):
            do()
    assert isinstance(stancekit.load(whole), LeapTries)
    assert isinstance(open_rows("pool-wall-3"), stancekit.Dataset)


def test_the_card_says_what_labels_mean_and_what_all_scenes_share(whole: Path) -> None:
    header = json.loads((whole / "header.json").read_text())
    assert set(header["speaks_of"]) == {"solved", "refuted", "unsolved"}
    assert header["plan"] == asdict(PLAN)
    assert header["leap"]["footholds"][0] == {"limb": "LF", "phase": 0}
    assert header["shapes"]["forces_n"] == [9, 4, 3]
    assert "start" not in header["leap"]
