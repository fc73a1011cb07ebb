"""``stancekit export`` and ``verify`` of motions: what comes back is judged, and bad input is one
line and exit 2.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import stancekit
from stancekit.cli.main import main


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a walk, and its CSV beside it."""
    path = tmp_path_factory.mktemp("motions") / "walk.json"
    level = stancekit.HeightField.from_array(np.zeros((41, 41)), spacing_m=0.1)
    found = stancekit.walk(level, (0.2, 0.0), duration_s=2.0, chart="decoupled").solution
    assert found is not None
    stancekit.save(found, path)
    stancekit.export(path, to="csv")
    return path


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(list(map(str, arguments)))
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_a_motion_is_judged_by_the_command(walk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("verify", walk.with_suffix(".csv"), "--terrain", walk, "--json") == 0
    record = json.loads(capsys.readouterr().out)
    assert (record["kind"], record["verdict"], record["not_checked"]) == ("motion", "accepted", [])
    assert run("verify", walk.with_suffix(".csv"), "--terrain", walk) == 0
    assert "contact_gap" in capsys.readouterr().out


def test_mujocos_key_frames_are_judged(walk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("export", walk, "--to", "mujoco") == 0
    assert (
        run("verify", walk.with_suffix(".xml"), "--robot", "anymal", "--terrain", walk, "--json")
        == 0
    )
    record = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert record["not_checked"] == ["torque", "contact_gap", "forces", "cone", "swing_force"]


def spoiled(text: str, how: str) -> str:
    """A CSV with something wrong."""
    head, *rows = text.splitlines()
    if how == "nan":
        return "\n".join([head, ",".join(["nan", *rows[0].split(",")[1:]]), *rows[1:]])
    if how == "gap":
        return "\n".join([head, *rows[:50], *rows[60:]])
    if how == "backwards":
        return "\n".join([head, *reversed(rows)])
    if how == "short":
        return "\n".join([head, rows[0], rows[1][:100], *rows[2:]])
    if how == "column":
        return "\n".join([head.replace("body.qw", "body.q0"), *rows])
    if how == "joint":
        return "\n".join([head.replace("LF_HAA", "arm"), *rows])
    if how == "axis":
        return "\n".join([head.replace("body.x", "com_v.q"), *rows])
    return head


@pytest.mark.parametrize(
    ("how", "line"),
    [
        ("nan", "row 1, column t: expected a finite number, got nan"),
        (
            "gap",
            "time_s: row 50: expected a uniform grid, got a gap of 0.11 s at 0.49 s where others are 0.01 s",
        ),
        ("backwards", "expected times that increase"),
        ("short", "row 2: expected "),
        (
            "column",
            "expected columns as t, q.JOINT, force.LIMB.x, got 'body.q0', did you mean 'body.qz'?",
        ),
        ("joint", "joints: expected those of anymal"),
        ("axis", "got 'com_v.q'"),
        ("empty", "expected rows below the header, got none"),
    ],
)
def test_a_bad_motion_is_one_line(
    how: str, line: str, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(spoiled(walk.with_suffix(".csv").read_text(), how))
    assert run("verify", path, "--terrain", walk) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert line in said


def test_options_that_do_not_fit_are_one_line(
    walk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = walk.with_suffix(".csv")
    for arguments, line in (
        ((table,), "--terrain: expected it or a course with the motion"),
        ((table, "--terrain", walk, "--course", "walls"), "got both"),
        ((walk, "--terrain", walk), "--terrain: expected a motion with it"),
        ((table, "--terrain", walk, "--robot", "nobody"), "--robot: expected"),
        (
            (table, "--terrain", walk, "--tolerance", "0.1"),
            "--tolerance: expected none with a motion",
        ),
        ((table, "--terrain", "nowhere"), "--terrain: expected a file, one of"),
    ):
        assert run("verify", *arguments) == 2
        said = capsys.readouterr().err
        assert (said.count("\n"), line in said) == (1, True), said


def test_exports_that_cannot_be_are_one_line(
    walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "other.json").write_text("{}")
    for arguments, line in (
        (
            (walk,),
            "--to: expected one of csv, npz, jointtrajectory, mujoco, reference, foxglove, got none",
        ),
        ((walk, "--to", "svg"), "--to: expected one of csv"),
        ((walk, "--to", "minari"), "expected the folder of a data set"),
        (
            (walk, "--to", "csv", "--out", tmp_path / "file" / "walk.csv"),
            "expected an existing folder",
        ),
        (
            (walk, "--to", "csv", "--out", tmp_path / "walk.txt"),
            "--out: expected a name that ends in .csv",
        ),
        (
            (walk, "--to", "csv", "--rate-hz", "-1"),
            "--rate-hz: expected a number in (0, 10000], got -1",
        ),
        ((walk, "--to", "csv", "--count", "2"), "--count: expected a family's level with it"),
        (
            ("rough:0.1", "--to", "csv"),
            "--count: expected how many motions over rough:0.1, got none",
        ),
        (("rough:0.1", "--to", "csv", "--count", "0"), "--count: expected"),
        (("rough:0.1:3", "--count", "2"), "expected FAMILY:LEVEL with count"),
        (
            ("rough:0.1", "--count", "2", "--out", tmp_path / "file"),
            "expected a folder or room for one",
        ),
        (
            (tmp_path / "other.json", "--to", "csv"),
            "expected a plan, a walk, a leap, or the folder of a data set",
        ),
    ):
        assert run("export", *arguments) == 2
        said = capsys.readouterr().err
        assert (said.count("\n"), line in said) == (1, True), said
    assert not (tmp_path / "walk.txt").exists()


def test_drawn_motions_are_gone_on_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "drawn"
    assert run("export", "rough:0.05", "--count", "1", "--to", "csv", "--out", folder) == 0
    assert "1 motions of 1 grounds, 0 refused (0%)" in capsys.readouterr().out
    before = (folder / "rough-0.05-0.csv").stat().st_mtime_ns
    assert run("export", "rough:0.05", "--count", "1", "--to", "csv", "--out", folder) == 0
    assert (folder / "rough-0.05-0.csv").stat().st_mtime_ns == before
    assert run("export", "rough:0.05", "--count", "1", "--to", "npz", "--out", folder) == 2
    assert "to: expected 'npz', found motions of another one there" in capsys.readouterr().err


def test_two_processes_do_not_draw_into_one_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from stancekit.planners.files.writing import alone_in

    folder = tmp_path / "drawn"
    folder.mkdir()
    arguments = ("export", "rough:0.05", "--count", "1", "--to", "csv", "--out", folder)
    with alone_in(folder):
        assert run(*arguments) == 2
    said = capsys.readouterr().err
    assert (said.count("\n"), "in which no other process is at work" in said) == (1, True), said
    assert list(folder.iterdir()) == []
    assert run(*arguments) == 0


def test_a_folder_whose_writer_was_killed_in_its_first_motion_is_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from stancekit import exports

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    folder, walked = tmp_path / "drawn", exports.walk
    monkeypatch.setattr(exports, "walk", killed)
    assert run("export", "rough:0.05", "--count", "1", "--to", "csv", "--out", folder) != 0
    (folder / ".rough-0.05-0.csv.999999-01234567.tmp").write_text("half")
    monkeypatch.setattr(exports, "walk", walked)
    assert run("export", "rough:0.05", "--count", "1", "--to", "csv", "--out", folder) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["motions.jsonl", "rough-0.05-0.csv"]
    capsys.readouterr()
    for text in ("", "[]", '{"format": 1}', "\n3", '\n{"ground": 1}', '\n{"file": 3}'):
        head = (folder / "motions.jsonl").read_text().splitlines()[0]
        (folder / "bad").mkdir(exist_ok=True)
        (folder / "bad" / "motions.jsonl").write_text(
            head + text if text.startswith("\n") else text
        )
        assert (
            run("export", "rough:0.05", "--count", "1", "--to", "csv", "--out", folder / "bad") == 2
        )
        assert capsys.readouterr().err.count("\n") == 1
