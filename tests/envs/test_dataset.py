"""Data sets: what was labelled is what is read, and what is no data set is refused with one
line.
"""

from __future__ import annotations

import copy
import json
import pickle
import shutil
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path

import gymnasium
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from stancekit.envs import scenes
from stancekit.envs.data import dataset, ledger
from stancekit.envs.data.dataset import Dataset, LabelledPosture, ScenePool, scenes_of, table_of
from stancekit.envs.data.ledger import LabelPlan, folder_of, pools
from stancekit.envs.distributions.postures import OwnDistribution, Repeatable, distribution
from stancekit.envs.refinement import EnvelopeRefinementEnv
from stancekit.envs.scenes import MOST_AHEAD, ListedScenes, OneByOne, SampledScenes
from stancekit.envs.selection import EnvelopeSelectionEnv
from stancekit.envs.vector import EnvelopeSelectionVectorEnv
from stancekit.learners.data import shards
from stancekit.learners.data.labelling import check_unseen, label
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled, observe_batch
from stancekit.planners.errors import InvalidInput, PlanningFailed
from stancekit.planners.verify import (
    check_certificate,
    check_certificates,
    check_plan,
    check_postures,
)
from tests.refusals import assert_names, refuses

PLAN = LabelPlan(
    distribution="wall-3", feasible=0, infeasible=36, shard_size=6, seed=11, natural=True
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A natural set of six shards, all kinds of rows."""
    path = tmp_path_factory.mktemp("data") / "set"
    label(PLAN, path)
    return path


@pytest.fixture
def data(folder: Path) -> Dataset:
    return Dataset.open(folder)


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    """A copy that may be spoilt."""
    return Path(shutil.copytree(folder, tmp_path / "set"))


def refusal(path: Path) -> str:
    with pytest.raises(InvalidInput) as error:
        Dataset.open(path)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_what_was_labelled_is_what_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[LabelledPosture] = []

    def spy(rows: list[LabelledPosture], contacts: int) -> pa.Table:
        written.extend(rows)
        return table_of(rows, contacts)

    monkeypatch.setattr(shards, "table_of", spy)
    label(PLAN, tmp_path)
    rows = list(Dataset.open(tmp_path).rows())
    assert len(rows) == len(written) == 36
    assert {row.kind for row in rows} == {"feasible", "infeasible", "trivial"}
    shard_of = [row.shard for row in written]  # rows are numbered where a shard's blocks are joined
    assert [row.row for row in rows] == [
        shard_of[:index].count(shard) for index, shard in enumerate(shard_of)
    ]
    for mine, theirs in zip(rows, written, strict=True):
        for name in (
            "shard",
            "sample",
            "status",
            "trivial",
            "lower_bound",
            "solves",
            "nodes",
            "kind",
        ):
            assert getattr(mine, name) == getattr(theirs, name), name
        assert mine.problem.to_json() == theirs.problem.to_json()
        np.testing.assert_equal(mine.point, theirs.point)
        for name in ("posture", "certificate"):
            one, other = getattr(mine, name), getattr(theirs, name)
            assert (one is None) == (other is None)
            assert one is None or one.to_json() == other.to_json()


def test_columns_are_aligned_with_the_rows(data: Dataset) -> None:
    rows = list(data.rows())
    assert data.labels.tolist() == [str(row.status) for row in rows]
    assert [rows[i].kind for i in (*data.feasible, *data.infeasible, *data.trivial)] == (
        ["feasible"] * len(data.feasible)
        + ["infeasible"] * len(data.infeasible)
        + ["trivial"] * len(data.trivial)
    )
    assert len(data.feasible) + len(data.infeasible) + len(data.trivial) == len(data) == 36
    np.testing.assert_array_equal(data.points, [rows[i].point for i in data.feasible])
    np.testing.assert_array_equal(data.infeasible_points, [rows[i].point for i in data.infeasible])
    assert np.isfinite(data.points).all()
    assert np.isfinite(data.infeasible_points).all()
    assert data.points.shape[1:] == (3, 6)
    assert [p.to_json() for p in data.problems()] == [row.problem.to_json() for row in rows]


def test_rows_are_found_from_either_end(data: Dataset) -> None:
    assert (data.row(-1).shard, data.row(-1).row) == (5, 5)
    assert (data.row(6).shard, data.row(6).row) == (1, 0)
    with pytest.raises(IndexError):
        data.row(36)


def test_a_point_is_p_and_f_of_its_witness(data: Dataset) -> None:
    row = data.row(int(data.feasible[0]))
    np.testing.assert_array_equal(Scaled.of(row.problem).point(row.posture), row.point)
    np.testing.assert_allclose(
        row.point[:, :3] * 0.6 + row.posture.com_m, row.posture.toes_m, atol=1e-12
    )
    for contact, point, force in zip(
        row.problem.contacts, row.point, row.posture.forces_n[0], strict=True
    ):
        np.testing.assert_allclose(98.1 * contact.patch.frame @ point[3:], force, atol=1e-9)
    with refuses("read-only", kind=ValueError):
        row.point[0, 0] = 1.0


def test_only_a_few_shards_are_in_memory_at_a_time(data: Dataset) -> None:
    assert max(len(data._open) for _ in data.rows()) == dataset.OPEN_SHARDS < PLAN.shards


def test_a_split_is_exact_disjoint_and_always_the_same(folder: Path, data: Dataset) -> None:
    parts = data.split((0.5, 0.25, 0.25))
    assert sorted(np.concatenate([part.chosen for part in parts])) == list(range(36))
    again = Dataset.open(folder).split((0.5, 0.25, 0.25))
    assert [part.chosen.tolist() for part in parts] == [part.chosen.tolist() for part in again]
    for name in ("feasible", "infeasible", "trivial"):
        count = len(getattr(data, name))
        assert abs(len(getattr(parts[0], name)) - 0.5 * count) <= 0.5
        assert sum(len(getattr(part, name)) for part in parts) == count
    first = parts[1].row(0)
    assert (first.shard, first.row) == divmod(int(parts[1].chosen[0]), 6)
    assert len(parts[1].points) == len(parts[1].feasible)
    assert len(data.split((0.1,))) == 1


@pytest.mark.parametrize("fractions", [(), (0.5, 0.6), (0.5, 0.0), (-0.5, 0.5)])
def test_fractions_that_are_none_are_refused(folder: Path, fractions: tuple[float, ...]) -> None:
    with refuses("fractions"):
        Dataset.open(folder).split(fractions)


def test_a_selection_keeps_its_order(data: Dataset) -> None:
    chosen = data.select([7, 3, 3])
    assert [(row.shard, row.row) for row in chosen.rows()] == [(1, 1), (0, 3), (0, 3)]
    assert chosen.labels.tolist() == data.labels[[7, 3, 3]].tolist()
    assert len(data.select([])) == len(data.select([]).points) == 0


def test_a_data_set_says_what_it_is(folder: Path, data: Dataset) -> None:
    assert repr(data) == f"Dataset('{folder}', wall-3, 36 rows)"
    assert data.problem_class == "wall-3"
    assert data.header.plan == PLAN
    assert data.header.legs == ["RF", "RR", "LM"]
    assert set(data.header.software) == {"stancekit", "numpy", "clarabel", "cvxpy"}
    assert json.loads((folder / "header.json").read_text())["format"] == "stancekit/dataset/1"


def test_a_data_set_can_be_sent_to_another_process(data: Dataset) -> None:
    data.row(0)
    assert (
        pickle.loads(pickle.dumps(data)).row(35).problem.to_json() == data.row(35).problem.to_json()
    )


def test_reading_never_unpickles(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise AssertionError("unpickled")

    monkeypatch.setattr(pickle, "loads", fail)
    monkeypatch.setattr(pickle, "load", fail)
    monkeypatch.setattr(pickle, "Unpickler", fail)
    assert len(list(Dataset.open(folder).rows())) == 36


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    assert_names(refusal(tmp_path / "x"), f"{tmp_path}/x")
    (tmp_path / "y").write_text("")
    assert_names(refusal(tmp_path / "y"), f"{tmp_path}/y")


def test_a_missing_header_is_refused(copied: Path) -> None:
    (copied / "header.json").unlink()
    assert_names(refusal(copied), f"{copied}/header.json")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"format": "stancekit/dataset/2"},
            "format",
        ),
        ({"format": None}, "format"),
        (
            {"colour": 1, "legs": []},
            "colour",
        ),
        ({"problem_class": 3}, "problem_class"),
        ({"plan": asdict(PLAN) | {"seed": "x", "colour": 1}}, "plan.seed"),
    ],
)
def test_a_header_with_wrong_keys_is_refused(
    copied: Path, changes: dict[str, object], message: str
) -> None:
    header = json.loads((copied / "header.json").read_text()) | changes
    (copied / "header.json").write_text(json.dumps(header))
    assert_names(refusal(copied), f"{copied}/header.json", message)


@pytest.mark.parametrize(
    ("content", "got"),
    [
        (
            b"{",
            "JSON, broken at line 1 column 2: Expecting property name enclosed in double quotes",
        ),
        (b"\xff", "UTF-8 text, byte 0 is not"),
        (b"[" * 10**5, "JSON: 60 levels of nesting or fewer, got more"),
    ],
)
def test_a_header_that_is_no_json_is_refused(copied: Path, content: bytes, got: str) -> None:
    (copied / "header.json").write_bytes(content)
    assert_names(refusal(copied), f"{copied}/header.json")


def test_a_set_with_missing_shards_is_refused(copied: Path) -> None:
    (copied / "shard-00002.parquet").unlink()
    (copied / "shard-00004.parquet").unlink()
    message = "shard-00002.parquet and 1 more shards are missing: label this plan again"
    assert refusal(copied) == f"{copied}: {message}"


def test_a_foreign_parquet_file_is_refused(copied: Path) -> None:
    pq.write_table(pa.table({"x": [1]}), copied / "shard-00001.parquet")
    message = "expected a shard (stancekit/shard/1), got another Parquet file"
    assert refusal(copied) == f"{copied}/shard-00001.parquet: {message}"


@pytest.mark.parametrize(
    ("keep", "got"),
    [
        (
            -100,
            "Parquet magic bytes not found in footer. Either the file is corrupted or this is not a parquet file.",
        ),
        (0, "Parquet file size is 0 bytes"),
    ],
)
def test_a_truncated_shard_is_refused(copied: Path, keep: int, got: str) -> None:
    path = copied / "shard-00001.parquet"
    path.write_bytes(path.read_bytes()[:keep])
    assert_names(refusal(copied), path)


def test_a_shard_of_another_data_set_or_place_is_refused(copied: Path, tmp_path: Path) -> None:
    label(replace(PLAN, seed=12, infeasible=2), tmp_path / "other")
    shutil.copy(tmp_path / "other" / "shard-00000.parquet", copied)
    assert_names(refusal(copied), f"{copied}/shard-00000.parquet")
    shutil.copy(copied / "shard-00003.parquet", copied / "shard-00000.parquet")
    assert_names(refusal(copied), f"{copied}/shard-00000.parquet")


def test_a_shard_with_other_rows_than_it_says_is_refused(copied: Path) -> None:
    opened = ledger.Ledger.open(copied)
    timing = opened.timings()[0]
    ledger.write_shard(copied, opened.read(0).slice(1), opened.tallies[0], timing)
    message = "expected 6 rows of the columns of stancekit/shard/1, got other rows"
    assert refusal(copied) == f"{copied}/shard-00000.parquet: {message}"


def test_a_flipped_byte_is_noticed_when_the_row_is_read(copied: Path) -> None:
    path = copied / "shard-00000.parquet"
    content = bytearray(path.read_bytes())
    column = (
        pq.read_metadata(path).row_group(0).column(pq.read_schema(path).get_field_index("problem"))
    )
    content[column.data_page_offset - 200] ^= 1  # in the dictionary of texts
    path.write_bytes(content)
    with refuses(path):
        list(Dataset.open(copied).rows())


def test_a_row_that_is_no_posture_problem_is_refused(copied: Path) -> None:
    opened = ledger.Ledger.open(copied)
    table = opened.read(0)
    texts = table.column("problem").to_pylist()
    texts[4] = texts[4].replace('"mass_kg":10.0', '"mass_kg":-1.0')
    where = table.schema.get_field_index("problem")
    table = table.set_column(where, table.schema.field("problem"), pa.array(texts))
    ledger.write_shard(copied, table, opened.tallies[0], opened.timings()[0])
    data = Dataset.open(copied)
    assert data.row(3).status in Status
    with refuses(f"{copied}/shard-00000.parquet", "row 4", "mass_kg"):
        data.row(4)


def test_it_is_what_a_data_loader_takes(data: Dataset) -> None:
    batches = list(pytest.importorskip("torch").utils.data.DataLoader(data, batch_size=8))
    assert [len(labels) for _, labels in batches] == [8, 8, 8, 8, 4]
    labels = np.concatenate([labels.numpy() for _, labels in batches])
    assert labels.tolist() == [
        {"feasible": 1, "infeasible": 0, "undecided": -1}[label] for label in data.labels
    ]
    seen = observe_batch([Scaled.of(problem) for problem in data.problems()])
    assert set(batches[0][0]) == set(seen)
    for name, values in seen.items():
        np.testing.assert_array_equal(
            np.concatenate([batch[name].numpy() for batch, _ in batches]), values
        )


def test_indices_count_from_either_end_and_end(folder: Path) -> None:
    data = Dataset.open(folder).select([3, 1])
    assert len(list(data)) == 2
    for first, last in zip(data[1][0].values(), data[-1][0].values(), strict=True):
        np.testing.assert_array_equal(first, last)
    with refuses("row 2", kind=IndexError):
        _ = data[2]
    with refuses("index", "select"):
        _ = data[0:1]


SELECTION = "stancekit.envs:stancekit/EnvelopeSelection-v0"


@pytest.mark.parametrize("name", ["pool-ground-3", "pool-wall-3", "pool-wall-4", "pool-wall-5"])
def test_a_pool_is_half_feasible_and_its_proofs_hold(name: str) -> None:
    data = Dataset.open(name)
    assert data.problem_class == name.removeprefix("pool-")
    assert (len(data.feasible), len(data.infeasible), len(data)) == (250, 250, 500)
    for row in data.select(np.concatenate([data.feasible[:3], data.infeasible[:3]])).rows():
        if row.posture is not None:
            assert check_plan(row.posture).accepted
        else:
            assert row.certificate is not None
            assert check_certificate(row.certificate).accepted


def test_an_environment_draws_from_a_pool_by_its_name() -> None:
    env = gymnasium.make(SELECTION, problem="wall-3", scenes="pool-wall-3")
    first, _ = env.reset(seed=0)
    again, _ = env.reset(seed=0)
    for name, seen in first.items():
        np.testing.assert_array_equal(seen, again[name])
    with refuses("pool-wall-5"):
        gymnasium.make(SELECTION, problem="wall-3", scenes="pool-wall-5")


def test_a_folder_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert folder_of("pool-wall-3") == pools()["pool-wall-3"]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pool-wall-3").mkdir()
    assert folder_of("pool-wall-3") == Path("pool-wall-3")
    assert folder_of("wall-3") == Path("wall-3")


BALANCED = LabelPlan(distribution="wall-3", feasible=20, infeasible=20, shard_size=20, seed=5)
LEGS = ("RF", "RR", "LM")


@pytest.fixture(scope="module")
def balanced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pool") / "set"
    label(BALANCED, path)
    return path


@pytest.fixture(scope="module")
def natural(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Samples as they come, those of one node undecided."""
    path = tmp_path_factory.mktemp("pool") / "natural"
    label(
        LabelPlan(
            distribution="wall-3", feasible=0, infeasible=60, natural=True, seed=4, max_nodes=1
        ),
        path,
    )
    return path


def keys(problems) -> set[str]:
    return {json.dumps(problem.to_json()) for problem in problems}


def test_the_parts_share_no_row_and_miss_none(balanced):
    dataset = Dataset.open(balanced)
    train, test, held = (dataset.only(part) for part in ("train", "test", "calibration"))
    assert len(train) > len(test) > 0
    assert sorted([*train.chosen, *test.chosen, *held.chosen]) == list(range(len(dataset)))
    assert dataset.only("all") is dataset
    picked = dataset.select(np.arange(10)).only("test")
    assert set(picked.chosen) == {k for k in test.chosen if k < 10}


def test_a_row_is_of_the_same_part_in_whatever_folder_it_is(balanced, tmp_path):
    label(
        LabelPlan(distribution="wall-3", feasible=10, infeasible=10, shard_size=20, seed=5),
        tmp_path / "fewer",
    )
    fewer, more = (Dataset.open(path) for path in (tmp_path / "fewer", balanced))
    assert fewer.header.digest != more.header.digest
    shared = keys(fewer.problems()) & keys(more.problems())
    assert shared
    for part in ("train", "test"):
        assert shared & keys(fewer.only(part).problems()) == shared & keys(
            more.only(part).problems()
        )


@pytest.mark.parametrize("part", ["", ":test", "as rows"])
def test_a_folder_gives_the_scenes_of_its_part_train_or_of_the_part_it_names(balanced, part):
    rows = Dataset.open(balanced).only("test" if part == ":test" else "train")
    env = gymnasium.make(
        "stancekit.envs:stancekit/EnvelopeSelection-v0",
        scenes=rows if part == "as rows" else f"{balanced}{part}",
    ).unwrapped
    expected = {
        scene.observation["vertices"].tobytes(): scene.feasible for scene in scenes_of(rows)
    }
    seen = Counter()
    for k in range(400):
        observation, _ = env.reset(seed=k if k == 0 else None)
        seen[observation["vertices"].tobytes()] += 1
    assert set(seen) == set(expected)  # 400 draws of some 30 rows
    assert 140 < Counter(expected[name] for name in seen.elements())[True] < 260


def test_rewards_and_info_are_those_of_the_same_scenes_listed(balanced):
    scenes = scenes_of(Dataset.open(balanced).only("train"))
    place = {scene.observation["vertices"].tobytes(): scene for scene in scenes}
    env, rng = EnvelopeSelectionEnv(scenes=balanced), np.random.default_rng(0)
    for k in range(6):
        observation, _ = env.reset(seed=k)
        listed = EnvelopeSelectionEnv(
            scenes=ListedScenes([place[observation["vertices"].tobytes()]])
        )
        listed.reset()
        middle = rng.uniform(-0.3, 0.3, 18)
        action = np.concatenate([middle - 0.5, middle + 0.5]).astype(np.float32)
        (_, mine, *_, said), (_, theirs, *_, heard) = env.step(action), listed.step(action)
        assert mine == theirs
        assert said.keys() == heard.keys()
        for name, value in said.items():
            np.testing.assert_array_equal(value, heard[name])


def test_a_batch_lives_through_what_single_environments_do_on_the_pool(balanced):
    batch, single = (
        EnvelopeSelectionVectorEnv(3, scenes=balanced),
        EnvelopeSelectionEnv(scenes=balanced),
    )
    seen, _ = batch.reset(seed=8)
    for k in range(3):
        np.testing.assert_array_equal(seen["vertices"][k], single.reset(seed=8 + k)[0]["vertices"])


def test_refinement_takes_a_folder_too(balanced):
    assert EnvelopeRefinementEnv(scenes=balanced).reset(seed=0)[0]["vertices"].shape == (27,)


def test_unbalanced_draws_have_trivial_rows_too(natural):
    decided = Dataset.open(natural)
    decided = decided.select(np.flatnonzero(decided.labels != "undecided"))
    rng = np.random.default_rng(0)
    assert len(decided.trivial)
    some = ScenePool(decided, balanced=False)
    assert len(some) == len(decided)
    drawn = keys(some.draw(rng).problem for _ in range(400))
    assert drawn & keys(decided.select(decided.trivial).problems())
    balanced = ScenePool(decided)
    drawn = keys(balanced.draw(rng).problem for _ in range(400))
    assert not drawn & keys(decided.select(decided.trivial).problems())


def test_what_is_no_pool_is_refused_in_one_line(balanced, natural, tmp_path):
    undecided = int((Dataset.open(natural).only("train").labels == "undecided").sum())
    kept = len(Dataset.open(natural).only("train"))
    assert undecided
    other = Path(shutil.copytree(balanced, tmp_path / "other"))
    header, named = json.loads((other / "header.json").read_text()), other / "header.json"
    named.write_text(json.dumps(header | {"format": "stancekit/dataset/2"}))
    for names, given in (
        ((natural, "train", undecided, kept), {"scenes": natural}),
        ((balanced, "ground-3", "wall-3"), {"scenes": balanced, "problem": "ground-3"}),
        ((tmp_path / "none",), {"scenes": tmp_path / "none"}),
        ((named, "format"), {"scenes": other}),
    ):
        with refuses(*map(str, names)):
            EnvelopeSelectionEnv(**given)
    dataset = Dataset.open(balanced)
    with refuses("set", "infeasible"):
        ScenePool(dataset.select(dataset.feasible))
    with refuses("part"):
        dataset.only("both")


def test_rows_are_chosen_by_numbers_or_by_a_mask(data):
    mask = data.labels == "feasible"
    assert np.array_equal(data.select(mask).chosen, data.chosen[data.feasible])
    assert set(data.select(mask.tolist()).labels) == {"feasible"}
    assert data.select(5).chosen.tolist() == [data.chosen[5]]
    for wrong in (mask[:-1], [len(data)], [0.7], ["feasible"], [[0, 1]], [[0], [1, 2]], True):
        with refuses("indices", str(len(data))):
            data.select(wrong)


def test_rows_that_were_learned_from_are_refused(balanced):
    dataset = Dataset.open(balanced)
    train, test, held = (dataset.only(part) for part in ("train", "test", "calibration"))
    first, second = dataset.split((0.5, 0.5))
    check_unseen(second, first.origin, "me")
    check_unseen(held, train.origin, "me")
    with refuses("me"):
        check_unseen(first, dataset.split((0.7,))[0].origin, "me")
    for seen, asked in ((dataset, dataset), (dataset, test), (train, dataset), (train, train)):
        with refuses("me"):
            check_unseen(asked, seen.origin, "me")
    check_unseen(test, train.origin, "me")
    check_unseen(train, test.origin, "me")
    check_unseen(dataset, {}, "me")
    with refuses("me", "set"):
        check_unseen(dataset, {**dataset.origin, "dataset": "another size of the same"}, "me")
    with refuses("me", "set"):
        check_unseen(test, {**train.origin, "calibration": test.origin}, "me")
    with refuses("me", "set"):
        check_unseen(
            test, {"dataset": dataset.header.digest}, "me"
        )  # files from before there were parts


WALL = distribution("wall-3")


def told(scene):
    """All that an environment tells of a scene, as bytes and text."""
    arrays = [
        *scene.observation.values(),
        scene.point,
        np.array([scene.feasible, scene.lower_bound]),
    ]
    return b"".join(values.tobytes() for values in arrays), scene.problem.to_json()


def drawn(source, count, rng):
    """Scenes, and the generator's state after each."""
    found = []
    for _ in range(count):
        found.append((told(source.draw(rng)), rng.bit_generator.state))
    return found


@pytest.mark.parametrize(
    ("law", "balanced", "count"),
    [
        ("wall-3", True, 70),
        ("ground-3", True, 16),
        ("wall-5", True, 10),
        ("wall-3", False, 12),
        ("wall-4", True, 8),
    ],
)
def test_blocks_change_nothing(law, balanced, count):
    law = distribution(law)
    ahead = drawn(SampledScenes(law, balanced=balanced), count, np.random.default_rng(3))
    assert ahead == drawn(OneByOne(law, balanced=balanced), count, np.random.default_rng(3))
    assert len({text for (text, _), _ in ahead}) == count
    assert len({bytes_[-16:-8] for (bytes_, _), _ in ahead}) == 2  # both labels


def test_scenes_are_drawn_in_ever_larger_blocks_and_verified_together(monkeypatch):
    sizes = []

    def check(postures):
        sizes.append(len(postures))
        return check_postures(postures)

    monkeypatch.setattr(scenes, "check_postures", check)
    drawn(
        SampledScenes(WALL, balanced=False),
        1 + 2 + 4 + 8 + 16 + 2 * MOST_AHEAD,
        np.random.default_rng(0),
    )
    assert len(sizes) == 7
    assert sizes[0] <= 1
    assert MOST_AHEAD // 4 < sizes[-1] <= MOST_AHEAD


def test_who_draws_from_the_generator_meanwhile_or_seeds_it_anew_changes_what_comes():
    source, one_by_one = SampledScenes(WALL), OneByOne(WALL)
    rng, other = np.random.default_rng(5), np.random.default_rng(5)
    for extra in (0, 0, 0, 1, 0, 3):
        assert rng.random(extra).tolist() == other.random(extra).tolist()
        assert told(source.draw(rng)) == told(one_by_one.draw(other))
    again = np.random.default_rng(5)
    assert told(source.draw(again)) == told(one_by_one.draw(np.random.default_rng(5)))
    assert told(source.draw(rng)) == told(one_by_one.draw(other))


def test_a_copy_keeps_its_own_scenes_and_shares_the_compiled_models():
    source, rng = SampledScenes(WALL), np.random.default_rng(5)
    drawn(source, 4, rng)
    other = copy.copy(source)
    assert other._expert.programs is source._expert.programs
    assert not other._ahead
    assert drawn(other, 3, np.random.default_rng(9)) == drawn(
        OneByOne(WALL), 3, np.random.default_rng(9)
    )
    assert source._ahead


def test_other_generators_are_drawn_from_one_by_one():
    twister = [np.random.Generator(np.random.MT19937(4)) for _ in range(2)]
    found, expected = (
        [told(source.draw(rng)) for _ in range(3)]
        for source, rng in zip((SampledScenes(WALL), OneByOne(WALL)), twister, strict=True)
    )
    assert found == expected


def test_draws_that_cannot_be_repeated_are_drawn_when_they_are_asked_for():
    class Counting:
        count = 0

        def sample(self, rng):
            self.count += 1
            return WALL.sample(rng)

    thing = Counting()
    own = OwnDistribution(thing, "counting")
    assert isinstance(WALL, Repeatable)
    assert not isinstance(own, Repeatable)
    thing.count = 0
    SampledScenes(own, balanced=False).draw(np.random.default_rng(1))
    assert thing.count == 1


@pytest.mark.parametrize("check", [check_certificates, check_postures])
def test_a_claim_that_the_verifier_refuses_is_decided_again_by_itself(check, monkeypatch):
    refused = []

    def refuse(given):
        refused.extend(given)
        return np.full(len(given), np.inf if check is check_postures else 0.0)

    expected = drawn(OneByOne(WALL), 12, np.random.default_rng(3))
    monkeypatch.setattr(scenes, check.__name__, refuse)
    assert drawn(SampledScenes(WALL), 12, np.random.default_rng(3)) == expected
    assert len(refused) > 3


class Failing:
    """A distribution some of whose draws fail."""

    name, terrain, legs, skip = "failing", "wall", WALL.legs, staticmethod(WALL.skip)

    def sample(self, rng):
        return self.batch(rng, 1).problem(0)

    def batch(self, rng, count):
        batch = WALL.batch(rng, count)
        if np.any(batch.friction[:, 0] > 1.15):
            raise InvalidInput("no footing")
        return batch


def test_a_draw_that_fails_is_told_when_its_turn_comes():
    found = {}
    for kind in (SampledScenes, OneByOne):
        source, rng, scenes = kind(Failing()), np.random.default_rng(6), []

        def draw_all(source=source, rng=rng, scenes=scenes):
            for _ in range(100):
                scenes.append(told(source.draw(rng)))

        with refuses():
            draw_all()
        found[kind] = scenes
    assert isinstance(Failing(), Repeatable)
    assert found[SampledScenes] == found[OneByOne]
    assert 3 <= len(found[OneByOne]) < 100


def test_a_label_that_never_comes_up_is_told(monkeypatch):
    monkeypatch.setattr(scenes, "MAX_DRAWS", 0)
    for kind in (SampledScenes, OneByOne):
        with refuses("wall-3", kind=PlanningFailed):
            kind(WALL).draw(np.random.default_rng(0))


def test_what_an_environment_shows_can_be_written_to():
    env = EnvelopeSelectionEnv()
    first, _ = env.reset(seed=0)
    kept = {name: values.copy() for name, values in first.items()}
    for values in first.values():
        values[:] = 0.0
    second, _, _, _, info = env.step(np.ones(36, np.float32))
    assert all(np.array_equal(second[name], kept[name]) for name in kept)
    info["expert_point"][:] = 7.0
    env.reset(seed=0)
    assert not np.any(env.step(np.ones(36, np.float32))[4]["expert_point"] == 7.0)
