"""Data sets: what was labelled is what is read, and what is no data set is refused with one
line.
"""

import json
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from stancekit.envs.data import dataset, ledger
from stancekit.envs.data.dataset import Dataset, LabelledPosture, table_of
from stancekit.envs.data.ledger import LabelPlan
from stancekit.learners.data import shards
from stancekit.learners.data.labelling import label
from stancekit.planners.answer.answer import Status
from stancekit.planners.equilibrium.scaled import Scaled, observe_batch
from stancekit.planners.errors import InvalidInput
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
def copy(folder: Path, tmp_path: Path) -> Path:
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


def test_columns_are_aligned_with_the_rows(folder: Path) -> None:
    data = Dataset.open(folder)
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


def test_rows_are_found_from_either_end(folder: Path) -> None:
    data = Dataset.open(folder)
    assert (data.row(-1).shard, data.row(-1).row) == (5, 5)
    assert (data.row(6).shard, data.row(6).row) == (1, 0)
    with pytest.raises(IndexError):
        data.row(36)


def test_a_point_is_p_and_f_of_its_witness(folder: Path) -> None:
    data = Dataset.open(folder)
    row = data.row(int(data.feasible[0]))
    assert row.posture is not None
    assert row.point is not None
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


def test_only_a_few_shards_are_in_memory_at_a_time(folder: Path) -> None:
    data = Dataset.open(folder)
    most = max(len(data._open) for _ in data.rows())
    assert most == dataset.OPEN_SHARDS < PLAN.shards


def test_a_split_is_exact_disjoint_and_always_the_same(folder: Path) -> None:
    data = Dataset.open(folder)
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
    with pytest.raises(InvalidInput) as error:
        Dataset.open(folder).split(fractions)
    assert_names(str(error.value), "fractions")


def test_a_selection_keeps_its_order(folder: Path) -> None:
    data = Dataset.open(folder)
    chosen = data.select([7, 3, 3])
    assert [(row.shard, row.row) for row in chosen.rows()] == [(1, 1), (0, 3), (0, 3)]
    assert chosen.labels.tolist() == data.labels[[7, 3, 3]].tolist()
    assert len(data.select([])) == len(data.select([]).points) == 0


def test_a_data_set_says_what_it_is(folder: Path) -> None:
    data = Dataset.open(folder)
    assert repr(data) == f"Dataset('{folder}', wall-3, 36 rows)"
    assert data.problem_class == "wall-3"
    assert data.header.plan == PLAN
    assert data.header.legs == ["RF", "RR", "LM"]
    assert set(data.header.software) == {"stancekit", "numpy", "clarabel", "cvxpy"}
    assert json.loads((folder / "header.json").read_text())["format"] == "stancekit/dataset/1"


def test_a_data_set_can_be_sent_to_another_process(folder: Path) -> None:
    data = Dataset.open(folder)
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


def test_a_missing_header_is_refused(copy: Path) -> None:
    (copy / "header.json").unlink()
    assert_names(refusal(copy), f"{copy}/header.json")


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
    ],
)
def test_a_header_with_wrong_keys_is_refused(
    copy: Path, changes: dict[str, object], message: str
) -> None:
    header = json.loads((copy / "header.json").read_text()) | changes
    (copy / "header.json").write_text(json.dumps(header))
    assert_names(refusal(copy), f"{copy}/header.json", message)


def test_a_header_with_a_wrong_plan_is_refused(copy: Path) -> None:
    header = json.loads((copy / "header.json").read_text())
    header["plan"] |= {"seed": "x", "colour": 1}
    (copy / "header.json").write_text(json.dumps(header))
    assert_names(refusal(copy), f"{copy}/header.json", "plan.seed")


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
def test_a_header_that_is_no_json_is_refused(copy: Path, content: bytes, got: str) -> None:
    (copy / "header.json").write_bytes(content)
    assert_names(refusal(copy), f"{copy}/header.json")


def test_a_set_with_missing_shards_is_refused(copy: Path) -> None:
    (copy / "shard-00002.parquet").unlink()
    (copy / "shard-00004.parquet").unlink()
    message = "shard-00002.parquet and 1 more shards are missing: label this plan again"
    assert refusal(copy) == f"{copy}: {message}"


def test_a_foreign_parquet_file_is_refused(copy: Path) -> None:
    pq.write_table(pa.table({"x": [1]}), copy / "shard-00001.parquet")
    message = "expected a shard (stancekit/shard/1), got another Parquet file"
    assert refusal(copy) == f"{copy}/shard-00001.parquet: {message}"


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
def test_a_truncated_shard_is_refused(copy: Path, keep: int, got: str) -> None:
    path = copy / "shard-00001.parquet"
    path.write_bytes(path.read_bytes()[:keep])
    assert_names(refusal(copy), path)


def test_a_shard_of_another_data_set_or_place_is_refused(copy: Path, tmp_path: Path) -> None:
    label(replace(PLAN, seed=12, infeasible=2), tmp_path / "other")
    shutil.copy(tmp_path / "other" / "shard-00000.parquet", copy)
    assert_names(refusal(copy), f"{copy}/shard-00000.parquet")
    shutil.copy(copy / "shard-00003.parquet", copy / "shard-00000.parquet")
    assert_names(refusal(copy), f"{copy}/shard-00000.parquet")


def test_a_shard_with_other_rows_than_it_says_is_refused(copy: Path) -> None:
    opened = ledger.Ledger.open(copy)
    timing = opened.timings()[0]
    ledger.write_shard(copy, opened.read(0).slice(1), opened.tallies[0], timing)
    message = "expected 6 rows of the columns of stancekit/shard/1, got others"
    assert refusal(copy) == f"{copy}/shard-00000.parquet: {message}"


def test_a_flipped_byte_is_noticed_when_the_row_is_read(copy: Path) -> None:
    path = copy / "shard-00000.parquet"
    content = bytearray(path.read_bytes())
    column = (
        pq.read_metadata(path).row_group(0).column(pq.read_schema(path).get_field_index("problem"))
    )
    content[column.data_page_offset - 200] ^= 1  # in the dictionary of texts
    path.write_bytes(content)
    with refuses(path):
        list(Dataset.open(copy).rows())


def test_a_row_that_is_no_posture_problem_is_refused(copy: Path) -> None:
    opened = ledger.Ledger.open(copy)
    table = opened.read(0)
    texts = table.column("problem").to_pylist()
    texts[4] = texts[4].replace('"mass_kg":10.0', '"mass_kg":-1.0')
    where = table.schema.get_field_index("problem")
    table = table.set_column(where, table.schema.field("problem"), pa.array(texts))
    ledger.write_shard(copy, table, opened.tallies[0], opened.timings()[0])
    data = Dataset.open(copy)
    assert data.row(3).status in Status
    with pytest.raises(InvalidInput) as error:
        data.row(4)
    assert_names(str(error.value), f"{copy}/shard-00000.parquet", "row 4", "mass_kg")


def test_it_is_what_a_data_loader_takes(folder: Path) -> None:
    data = Dataset.open(folder)
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
