"""Labelling: the rows follow from the plan alone, whoever draws them and however often they are
interrupted.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import logging
import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from stancekit.envs.data import ledger
from stancekit.envs.data.dataset import Dataset
from stancekit.envs.data.ledger import LabelPlan
from stancekit.envs.distributions.postures import PostureDistribution, distribution
from stancekit.learners.data import shards
from stancekit.learners.data.executors import Answer, Task, due, processes
from stancekit.learners.data.labelling import Progress, label, recheck
from stancekit.learners.data.shards import samples
from stancekit.planners.answer.answer import Status
from stancekit.planners.errors import StancekitError
from stancekit.planners.search.batch import canonical
from stancekit.planners.search.exact import Exact
from tests.refusals import refuses

PLAN = LabelPlan(distribution="wall-3", feasible=9, infeasible=7, shard_size=3, seed=5)
NATURAL = LabelPlan(
    distribution="wall-3", feasible=0, infeasible=40, shard_size=20, seed=6, natural=True
)

RUN = """
import json, sys
from stancekit.envs.data.ledger import LabelPlan
from stancekit.learners.data.labelling import label

plan, path, workers = json.loads(sys.argv[1])
label(LabelPlan(**plan), path, workers=workers, progress=lambda p: print(p.shards_done, flush=True))
"""
KILLED = """
import json, os, signal, sys
from pathlib import Path
from stancekit.envs.data import ledger
from stancekit.envs.distributions import postures
from stancekit.learners.data import labelling, shards
from stancekit.planners.search import batch, exact

plan, path, deaths = json.loads(sys.argv[1])


def die(function, calls):
    real, left = getattr(os, function), [calls]

    def deadly(*arguments):
        left[0] -= 1
        if left[0] == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*arguments)

    setattr(os, function, deadly)
    labelling.label(ledger.LabelPlan(**plan), Path(path) / f"{function}-{calls}")
    os._exit(0)


ended = []
for function, calls in deaths:
    child = os.fork() or die(function, calls)
    ended.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
print(json.dumps(ended))
"""
DEATHS = (
    ("fsync", 1, 0),
    ("fsync", 3, 0),
    ("replace", 3, 0),
    ("replace", 4, 1),
    ("fsync", 13, 2),
    ("replace", 13, 5),
)
"""A function of os, before which of its calls a run is killed, and the shards that are whole then.
There is a header, then for each shard its times and the shard; each of them, then its folder, is
synchronised."""


@pytest.fixture(scope="module")
def balanced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A balanced set, labelled without any interruption."""
    path = tmp_path_factory.mktemp("balanced") / "set"
    label(PLAN, path)
    return path


@pytest.fixture(scope="module")
def natural(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("natural") / "set"
    label(NATURAL, path)
    return path


def contents(path: Path) -> dict[str, str]:
    """Digest of every file that must follow from the plan, and the names of all others but the
    times.
    """
    kept = [file for file in sorted(path.iterdir()) if not file.name.startswith("timing-")]
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in kept}


def test_a_balanced_set_has_exactly_the_planned_rows(balanced: Path) -> None:
    data = Dataset.open(balanced)
    assert (len(data.feasible), len(data.infeasible), len(data)) == (9, 7, 16)
    assert [tally.rows.total for tally in data.ledger.tallies.values()] == [3, 3, 2, 3, 2, 3]
    for shard, tally in data.ledger.tallies.items():
        assert (tally.rows.feasible, tally.rows.infeasible) == PLAN.quota(shard)


def test_trivially_infeasible_samples_are_counted_but_never_kept_in_a_balanced_set(
    balanced: Path,
) -> None:
    data = Dataset.open(balanced)
    drawn = data.summary().drawn
    assert drawn.trivial > 0
    assert drawn.total > len(data)
    assert len(data.trivial) == 0
    assert not any(row.trivial or row.point is None for row in data.rows())


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7, 100])
@pytest.mark.parametrize(
    ("feasible", "infeasible"), [(18, 14), (1, 1), (0, 9), (45, 1), (1, 46), (500, 500)]
)
def test_quotas_add_up_and_no_shard_is_empty(feasible: int, infeasible: int, size: int) -> None:
    plan = LabelPlan(
        distribution="wall-3", feasible=feasible, infeasible=infeasible, shard_size=size
    )
    quotas = [plan.quota(shard) for shard in range(plan.shards)]
    assert [sum(column) for column in zip(*quotas, strict=True)] == [feasible, infeasible]
    assert all(1 <= sum(quota) <= size + 1 and min(quota) >= 0 for quota in quotas)


def content(path: Path) -> tuple[str, list[float]]:
    """A digest of all that is no number in the rows of all shards, and of how many numbers there are;
    and of the numbers of each column two sums with weights drawn by seed: processors differ in the
    last bits.
    """
    words, numbers = hashlib.sha256(), dict[str, list[float]]()
    for file in sorted(path.glob("shard-*.parquet")):
        table = pq.read_table(file)
        tally = json.loads(table.schema.metadata[b"stancekit"])
        words.update(
            json.dumps([tally["rows"], tally["drawn"], tally["undecided_samples"]]).encode()
        )
        for name in table.column_names:
            values = table.column(name).combine_chunks()
            values = values.storage if isinstance(values, pa.ExtensionArray) else values
            for value in values.to_pylist():
                parsed = json.loads(value) if name == "problem" else value
                words.update(_words(parsed, numbers.setdefault(name, [])).encode())
    sums = list[float]()
    for column in filter(None, numbers.values()):
        weights = np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(column)))
        sums += (weights @ np.array(column)).tolist()
    return words.hexdigest(), sums


def _words(value: object, numbers: list[float]) -> str:
    """A value without its fractions, which are added to ``numbers``."""
    if isinstance(value, float):
        numbers.append(value)
        return "#"
    if isinstance(value, dict):
        return "".join(f"{name}:{_words(each, numbers)};" for name, each in value.items())
    if isinstance(value, list):
        return f"[{','.join(_words(each, numbers) for each in value)}]"
    return str(value)


@pytest.mark.parametrize(
    ("plan", "words", "sums"),
    [
        (
            LabelPlan(distribution="wall-3", feasible=60, infeasible=40, seed=3),
            "97a7575c5968fa8f7851c5b0b962cb0fdb25d3cf9c3f5ae90816b688a930686f",
            [
                520.6475785,
                -329.4168659,
                0.6290248,
                -0.0994399,
                0.0314749,
                0.0626237,
                -0.0219399,
                -0.2171927,
                -5.1000158,
                0.9048126,
                903.1881003,
                -346.0202806,
                3.1694805,
                11.6473779,
                1.2239518,
                4.8823022,
                11.3717044,
                -4.0054673,
            ],
        ),
        (
            LabelPlan(distribution="ground-3", feasible=80, infeasible=0, natural=True, seed=1),
            "57b3acadcf0f787e96b4b2573194920a91315157d8689973e784b4ec8fb4edfd",
            [
                406.7212497,
                -190.187817,
                0.0,
                0.0,
                -0.0755456,
                -0.229117,
                -0.4978355,
                -0.3222894,
                0.9237165,
                0.3943128,
                -135.4439827,
                -192.6649381,
                6.8220359,
                9.8791073,
            ],
        ),
    ],
)
def test_rows_at_the_default_shard_size_are_those_of_version_0_1(
    plan: LabelPlan,
    words: str,
    sums: list[float],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The values are of what commit 51a6ced writes, which drew a shard in one task."""
    monkeypatch.setattr("stancekit.learners.data.labelling.LEAST", 8)
    label(plan, tmp_path / "serial")
    label(plan, tmp_path / "shared", run=Backwards())
    for name in ("serial", "shared"):
        said, of_numbers = content(tmp_path / name)
        assert said == words
        np.testing.assert_allclose(of_numbers, sums, rtol=0.0, atol=1e-5)
    assert contents(tmp_path / "serial") == contents(tmp_path / "shared")


class Backwards:
    """An executor that takes all tasks there are, and answers the last one first."""

    workers = 5

    def __call__(self, tasks: Iterable[Task[Answer] | None]) -> Iterator[Answer]:
        source = iter(tasks)
        while flying := list(due(source, None)):
            for task in reversed(flying):
                yield task()


def test_two_workers_write_the_same_bytes_as_one(balanced: Path, tmp_path: Path) -> None:
    label(PLAN, tmp_path, workers=2)
    assert contents(tmp_path) == contents(balanced)
    assert len(contents(tmp_path)) == PLAN.shards + 1


def test_any_executor_in_any_order_writes_the_same_bytes(balanced: Path, tmp_path: Path) -> None:
    label(PLAN, tmp_path, run=Backwards())
    assert contents(tmp_path) == contents(balanced)


def test_no_row_depends_on_where_a_block_begins(
    balanced: Path, natural: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for size, plan, whole in ((1, PLAN, balanced), (7, NATURAL, natural)):
        monkeypatch.setattr(shards, "BLOCK", size)
        label(plan, tmp_path / str(size))
        assert contents(tmp_path / str(size)) == contents(whole)


def test_rows_hold_what_the_exact_planner_proves_of_each_problem_alone(natural: Path) -> None:
    exact = Exact(max_nodes=NATURAL.max_nodes, time_limit_s=math.inf)
    kinds = set()
    for row in Dataset.open(natural).rows():
        alone = exact.solve(row.problem)
        kinds.add(row.kind)
        assert (row.status, row.lower_bound) == (alone.status, alone.bound)
        if row.certificate is not None and alone.certificate is not None:
            assert row.solves == alone.effort.solves
            assert row.certificate.to_json() == alone.certificate.to_json()
    assert kinds == {"feasible", "infeasible", "trivial"}


def test_rows_hold_the_canonical_posture_of_each_problem_alone(natural: Path) -> None:
    drawn = distribution("wall-3")
    batches = [drawn.batch(ledger_stream(shard), 20) for shard in range(2)]
    looked_at = 0
    for row in Dataset.open(natural).rows():
        alone = canonical(batches[row.shard].select(np.array([row.sample]))).get(0)
        if row.posture is None:
            assert alone is None
        elif alone is not None:
            looked_at += 1
            for name in ("com_m", "rotation_rad", "toes_m", "forces_n"):
                assert getattr(row.posture, name).tobytes() == getattr(alone[0], name).tobytes()
    assert looked_at >= 0.9 * len(Dataset.open(natural).feasible) > 5


def ledger_stream(shard: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(NATURAL.seed, spawn_key=(shard,)))


def test_a_header_that_does_not_say_how_witnesses_were_chosen_is_refused(tmp_path: Path) -> None:
    label(replace(PLAN, feasible=4, infeasible=0, shard_size=2), tmp_path)
    header = json.loads((tmp_path / "header.json").read_text())
    assert header.pop("witness") == "canonical/1"
    (tmp_path / "header.json").write_text(json.dumps(header))
    with refuses("header.json", "witness"):
        Dataset.open(tmp_path)


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders by the deaths of the runs that filled them, each in a process of its own, started
    from one.
    """
    path = tmp_path_factory.mktemp("killed")
    task = json.dumps([asdict(PLAN), str(path), [death[:2] for death in DEATHS]])
    done = subprocess.run(
        [sys.executable, "-c", KILLED, task], capture_output=True, text=True, check=True
    )
    assert json.loads(done.stdout) == [-signal.SIGKILL] * len(DEATHS)
    return path


@pytest.mark.parametrize(("function", "calls", "shards"), DEATHS)
def test_a_run_killed_at_any_step_is_resumed_to_the_same_bytes(
    balanced: Path, killed: Path, function: str, calls: int, shards: int
) -> None:
    path = killed / f"{function}-{calls}"
    before = {file: file.stat().st_mtime_ns for file in path.glob("shard-*.parquet")}
    assert len(before) == shards
    assert len(list(path.glob(".*.tmp"))) == 1
    seen: list[int] = []
    label(PLAN, path, progress=lambda p: seen.append(p.shards_done))
    assert seen == list(range(shards, PLAN.shards + 1))
    assert all(file.stat().st_mtime_ns == then for file, then in before.items())
    assert contents(path) == contents(balanced)


def test_a_run_on_two_processes_that_is_killed_is_resumed_to_the_same_bytes(
    balanced: Path, tmp_path: Path
) -> None:
    task = json.dumps([asdict(PLAN), str(tmp_path), 2])
    run = subprocess.Popen([sys.executable, "-c", RUN, task], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    while run.stdout.readline().strip() != "2":
        assert run.poll() is None
    time.sleep(0.01)  # a shard takes about twice as long
    run.kill()
    run.wait()
    label(PLAN, tmp_path, workers=2)  # while the orphans finish what they were given
    run.stdout.read()  # until they are gone
    assert contents(tmp_path) == contents(balanced)
    assert len(Dataset.open(tmp_path)) == PLAN.rows


def test_what_a_killed_run_was_writing_is_removed(balanced: Path, tmp_path: Path) -> None:
    label(PLAN, tmp_path)
    (tmp_path / "shard-00003.parquet").rename(tmp_path / ".shard-00003.parquet.123.tmp")
    (tmp_path / ".timing-00003.json.123.tmp").write_text("{")
    (tmp_path / "notes.txt").write_text("mine")
    label(PLAN, tmp_path)
    assert contents(tmp_path).keys() == contents(balanced).keys() | {"notes.txt"}
    assert len(Dataset.open(tmp_path)) == PLAN.rows


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": 6, "max_nodes": 9}, "seed"),
        ({"feasible": 8}, "feasible"),
        ({"natural": True}, "natural"),
        ({"distribution": "wall-5"}, "distribution"),
    ],
)
def test_another_plan_is_refused_and_changes_nothing(
    balanced: Path, changes: dict[str, object], message: str
) -> None:
    before = contents(balanced)
    with refuses(f"{balanced}/header.json", message):
        label(replace(PLAN, **changes), balanced)  # type: ignore[arg-type]
    assert contents(balanced) == before


def test_a_distribution_that_draws_something_else_now_is_refused(balanced: Path) -> None:
    changed = replace(distribution("wall-3"), friction=(0.5, 0.6))
    with refuses(f"{balanced}/header.json", "first_sample"):
        label(PLAN, balanced, source=changed)


def test_rows_of_own_code_are_not_gone_on_with_by_other_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = replace(PLAN, distribution="drawn.py:Mine", feasible=1, infeasible=0)
    for name, note in (("one", ""), ("other", "# draws the same\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "drawn.py").write_text(
            "from stancekit.envs.distributions.postures import WALL_3\n"
            f"class Mine:\n    def sample(self, rng):\n        return WALL_3.sample(rng)\n{note}"
        )
    monkeypatch.chdir(tmp_path / "one")
    label(plan, tmp_path / "rows")
    label(plan, tmp_path / "rows")
    monkeypatch.chdir(tmp_path / "other")
    with refuses("header.json", "code", "drawn.py"):
        label(plan, tmp_path / "rows")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"feasible": -1}, "feasible"),
        ({"shard_size": 0}, "shard_size"),
        ({"seed": 1.5}, "seed"),
        ({"gap": 0.0}, "gap"),
        (
            {"feasible": 0, "infeasible": 0},
            "infeasible",
        ),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused(values: dict[str, object], message: str) -> None:
    with refuses(message):
        replace(PLAN, **values)  # type: ignore[arg-type]


def test_bad_arguments_are_refused(tmp_path: Path) -> None:
    with refuses("workers"):
        processes(0)
    with refuses("distribution"):
        label(replace(PLAN, distribution="moon"), tmp_path)
    with refuses("distribution"):
        label(PLAN, tmp_path, source=distribution("wall-5"))
    (tmp_path / "file").write_text("")
    with refuses(f"{tmp_path}/file"):
        label(PLAN, tmp_path / "file")


def test_shards_without_their_header_are_not_continued(tmp_path: Path) -> None:
    label(replace(PLAN, feasible=1, infeasible=0), tmp_path)
    (tmp_path / "header.json").unlink()
    with refuses(f"{tmp_path}/header.json"):
        label(PLAN, tmp_path)


def test_a_shard_whose_label_never_comes_gives_up_early_and_one_whose_label_came_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stancekit.learners.data.shards.BARREN", 20)
    slippery = PostureDistribution(
        name="slippery", terrain="wall", legs=("RF", "RR", "LM"), friction=(0.0, 0.01)
    )
    with pytest.raises(StancekitError) as error:
        label(
            replace(PLAN, distribution="slippery", feasible=2, infeasible=0),
            tmp_path / "none",
            source=slippery,
        )
    assert str(error.value) == "slippery: shard 0 lacks 2 feasible rows after 20 draws: 20 trivial"
    monkeypatch.setattr("stancekit.learners.data.shards.BARREN", 5)
    summary = label(replace(PLAN, feasible=12, infeasible=0, shard_size=12), tmp_path / "some")
    assert summary.rows.feasible == 12
    assert summary.drawn.total > 5


def test_a_failure_in_a_worker_process_arrives(tmp_path: Path) -> None:
    with refuses("wall-3", kind=StancekitError):
        label(
            replace(PLAN, feasible=0, infeasible=10, shard_size=5),
            tmp_path,
            workers=2,
            draws_per_row=1,
        )


def test_a_natural_set_keeps_the_first_samples_as_they_come(natural: Path) -> None:
    data = Dataset.open(natural)
    assert [(row.shard, row.sample) for row in data.rows()] == [
        (shard, k) for shard in range(2) for k in range(20)
    ]
    assert {row.kind for row in data.rows()} == {"feasible", "infeasible", "trivial"}
    summary = data.summary()
    assert summary.rows == summary.drawn
    assert summary.rows.total == 40
    for row in data.rows():
        assert (row.posture is not None) == (row.status is Status.FEASIBLE)
        assert (row.certificate is not None) == (row.status is Status.INFEASIBLE)
        assert (row.point is None) == row.trivial


def test_every_row_can_be_drawn_again_to_the_last_bit(balanced: Path) -> None:
    data = Dataset.open(balanced)
    streams = {
        shard: list(itertools.islice(samples(PLAN, shard), 200)) for shard in range(PLAN.shards)
    }
    for row in data.rows():
        drawn = streams[row.shard][row.sample]
        assert json.dumps(row.problem.to_json()) == json.dumps(drawn.to_json())
        for mine, theirs in zip(row.problem.contacts, drawn.contacts, strict=True):
            assert mine.patch.vertices_m.tobytes() == theirs.patch.vertices_m.tobytes()
            assert mine.patch.normal.tobytes() == theirs.patch.normal.tobytes()
            assert mine.patch.friction == theirs.patch.friction


def test_samples_that_stay_undecided_are_listed(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    plan = replace(NATURAL, gap=0.5, max_nodes=1, shard_size=40)
    with caplog.at_level(logging.WARNING):
        label(plan, tmp_path)
    data = Dataset.open(tmp_path)
    (tally,) = data.ledger.tallies.values()
    undecided = np.flatnonzero(data.labels == "undecided")
    assert tally.undecided_samples == undecided.tolist() != []
    assert f"{len(undecided)} of 40 samples stayed undecided" in caplog.text
    row = data.row(int(undecided[0]))
    assert (row.point, row.posture, row.certificate, row.lower_bound) == (None, None, None, 0.0)
    assert recheck(data).accepted


def test_progress_begins_with_what_is_there_and_ends_with_everything(
    balanced: Path, tmp_path: Path
) -> None:
    seen: list[Progress] = []
    summary = label(PLAN, tmp_path, progress=seen.append)
    assert [p.shards_done for p in seen] == list(range(7))
    assert (seen[-1].rows, seen[-1].drawn, seen[-1].shards) == (16, summary.drawn.total, 6)
    assert seen[0].rate == 0.0 < seen[-1].rate
    label(PLAN, balanced, progress=seen.append)
    assert (seen[-1].shards_done, seen[-1].rows, seen[-1].rate) == (6, 16, 0.0)


def test_the_summary_counts_and_times_all_samples(tmp_path: Path) -> None:
    summary = label(replace(PLAN, shard_size=40), tmp_path)
    assert summary.rows == ledger.Counts(feasible=9, infeasible=7)
    assert 0.1 < summary.solve_ms_median < summary.solve_ms_p99
    (timing,) = Dataset.open(tmp_path).ledger.timings()
    assert len(timing.solve_ms) == summary.drawn.total
    assert min(timing.solve_ms) > 0.0
    assert summary.solve_ms_median == np.median(timing.solve_ms)
    assert summary.cpu_s_per_1000 == pytest.approx(1e3 * timing.cpu_s / summary.drawn.total)
    for file in tmp_path.glob("timing-*.json"):
        file.unlink()
    untimed = Dataset.open(tmp_path).summary()
    assert math.isnan(untimed.cpu_s_per_1000)
    assert untimed.to_json()["solve_ms_p99"] is None
    assert untimed.rows == summary.rows


def test_every_stored_witness_and_certificate_passes_the_verifier_again(
    balanced: Path, natural: Path
) -> None:
    for path in (balanced, natural):
        data = Dataset.open(path)
        report = recheck(data)
        assert report.accepted
        assert (report.witnesses, report.certificates) == (
            len(data.feasible),
            len(data) - len(data.feasible),
        )
        assert report.worst_residual <= PLAN.tolerance
        assert report.smallest_bound > PLAN.gap
        assert json.loads(json.dumps(report.to_json()))["refused"] == []


@pytest.mark.parametrize("column", ["label", "forces_n", "multipliers", "lower_bound", "point"])
def test_a_row_that_was_changed_is_refused(tmp_path: Path, column: str) -> None:
    label(replace(PLAN, feasible=2, infeasible=2, shard_size=4), tmp_path)
    data = Dataset.open(tmp_path)
    victim = int(
        (data.infeasible if column in ("multipliers", "lower_bound") else data.feasible)[1]
    )
    table = data.ledger.read(0)
    values = table.column(column).to_pylist()
    values[victim] = (
        "infeasible" if column == "label" else (1.5 * np.array(values[victim]) + 0.01).tolist()
    )
    if column == "multipliers":
        values[victim] = np.zeros_like(values[victim]).tolist()
    kind = table.schema.field(column).type
    storage = pa.array(
        values, kind.storage_type if isinstance(kind, pa.BaseExtensionType) else kind
    )
    changed = (
        pa.ExtensionArray.from_storage(kind, storage)
        if isinstance(kind, pa.BaseExtensionType)
        else storage
    )
    table = table.set_column(
        table.schema.get_field_index(column), table.schema.field(column), changed
    )
    (timing,) = data.ledger.timings()
    ledger.write_shard(tmp_path, table, data.ledger.tallies[0], timing)
    assert recheck(data.select(np.arange(4))).accepted is False
    assert recheck(Dataset.open(tmp_path)).refused == (victim,)


def test_points_of_s_balance_and_points_of_s_bar_do_so_but_for_the_moment(balanced: Path) -> None:
    looked_at = 0
    for row in Dataset.open(balanced).rows():
        position, force = row.point[:, :3], row.point[:, 3:]
        frames = np.array([contact.patch.frame for contact in row.problem.contacts])
        world = np.einsum("njk,nk->nj", frames, force)
        moment = np.abs(np.cross(position, world).sum(axis=0)).max()
        friction = np.array([contact.patch.friction for contact in row.problem.contacts])
        np.testing.assert_allclose(world.sum(axis=0), [0.0, 0.0, 1.0], atol=1e-6)
        assert np.all(np.hypot(force[:, 1], force[:, 2]) <= friction * force[:, 0] + 1e-6)
        if row.status is Status.FEASIBLE:
            assert moment <= 1e-6
        else:
            assert (
                moment >= row.lower_bound - 1e-6
            )  # no answer of P̄ has less than the certificate proves
            looked_at += 1
    assert looked_at == PLAN.infeasible
