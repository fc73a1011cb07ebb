"""Files are replaced whole or not at all: under a full disk or a kill at every call, and with two
writers.
"""

from __future__ import annotations

import copy
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.writing import (
    SAME,
    TEMPORARY,
    check_writable,
    first_difference,
    make_folder,
    replaced,
    write_text,
)
from stancekit.planners.formats.motion_file import check_file, write_motion
from stancekit.planners.verify import check_plan
from tests.emulators.faulty_disk import ended
from tests.refusals import refuses

VALUE: dict[str, Any] = {
    "name": "walls",
    "rows": [[1.0, 2.0], [3.0, 4.0]],
    "robot": {"mass_kg": 10.0, "legs": None},
}


def changed(*path: str | int, to: Any) -> dict[str, Any]:
    found = copy.deepcopy(VALUE)
    part: Any = found
    for step in path[:-1]:
        part = part[step]
    part[path[-1]] = to
    return found


def test_equal_values_have_no_difference_and_roundings_are_none() -> None:
    assert first_difference(VALUE, VALUE) == ""
    assert first_difference(changed("robot", "mass_kg", to=10.0 * (1.0 + 0.5 * SAME)), VALUE) == ""
    assert first_difference(changed("rows", to=((1, 2.0), (3.0, 4.0))), VALUE) == ""


@pytest.mark.parametrize(
    ("said", "message"),
    [
        (changed("name", to="stairs"), "name: expected"),
        (changed("rows", 1, 0, to=3.0 + 1e-6), "rows[1][0]: expected"),
        (changed("rows", 0, to=[1.0]), "rows[0]: expected 2, got 1"),
        (changed("robot", "mass_kg", to="10"), "robot.mass_kg: expected"),
        (changed("robot", "legs", to=0), "robot.legs: expected"),
        (changed("robot", "mass_kg", to=True), "robot.mass_kg: expected"),
        (changed("robot", to=[]), "robot: expected"),
        (changed("speed", to=1.0), "speed: expected nothing, got 1.0"),
        ({key: VALUE[key] for key in ("name", "rows")}, "robot: expected this key, got nothing"),
    ],
)
def test_the_first_difference_is_named_by_its_place(said: dict[str, Any], message: str) -> None:
    assert first_difference(said, VALUE).startswith(message)


FULL = "No space left on device"


def leftovers(folder: Path) -> list[str]:
    return [name for name in os.listdir(folder) if TEMPORARY.fullmatch(name)]


def on_progress(work) -> int:
    """What the command does with bad input."""
    try:
        work()
    except InvalidInput as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


@pytest.fixture
def planned(walk, tmp_path):
    """``planned(4)`` writes a plan of four key frames over climb.json, whose plan has three."""
    file = tmp_path / "climb.json"

    def write(frames):
        plan = walk(frames)
        write_motion(file, plan, check_plan(plan))

    write(3)
    return file, lambda: on_progress(lambda: write(4))


def test_a_plan_is_one_file_with_few_calls(planned):
    file, write = planned
    clean = ended(write, file.parent)
    assert clean.code == 0
    calls = ["open", "reopen", "write", "fsync", "rename", "fsync", "remove"]
    assert [call.split()[0] for call in clean.calls] == calls
    assert os.listdir(file.parent) == ["climb.json"]


@pytest.mark.parametrize("call", range(1, 8))
def test_a_disk_that_is_full_from_any_call_on_harms_no_older_plan(planned, call):
    file, write = planned
    before = file.read_bytes()
    done = ended(write, file.parent, call)
    assert os.listdir(file.parent) == ["climb.json"]
    if call <= 5:  # up to the rename; the folder's own fsync may fail
        assert (done.code, done.said) == (2, f"{file}: cannot be written: {FULL}\n")
        assert file.read_bytes() == before
    else:
        assert (done.code, done.said) == (0, "")
        assert file.read_bytes() != before
    assert check_file(file, joints=False).accepted


@pytest.mark.parametrize("call", range(1, 8))
def test_a_kill_before_any_call_leaves_the_older_plan_or_the_new_one_and_the_next_run_clears_up(
    planned, call
):
    file, write = planned
    before = file.read_bytes()
    assert ended(write, file.parent, call, "killed").code == -signal.SIGKILL
    assert (file.read_bytes() == before) == (call <= 5)
    assert check_file(file, joints=False).accepted
    assert len(leftovers(file.parent)) == (2 <= call <= 5)
    assert ended(write, file.parent).code == 0
    assert os.listdir(file.parent) == ["climb.json"]
    assert file.read_bytes() != before


@pytest.mark.parametrize("call", [1, 2])
def test_a_kill_while_leftovers_are_removed_leaves_them_to_the_next_run(planned, call):
    file, write = planned
    ended(write, file.parent, 4, "killed")
    sweep = ended(write, file.parent, call, "killed")
    assert [line.split()[0] for line in sweep.calls] == ["reopen", "remove"][:call]
    assert len(leftovers(file.parent)) == 1
    assert ended(write, file.parent).code == 0
    assert os.listdir(file.parent) == ["climb.json"]


def test_what_a_living_writer_writes_stays(tmp_path):
    file = tmp_path / "a.json"
    with replaced(file) as temporary:
        temporary.write_text("mine")
        done = ended(
            lambda: on_progress(lambda: write_text(file, "theirs")), tmp_path
        )  # another process, at the same time
        assert (done.code, file.read_text()) == (0, "theirs")
        assert os.listdir(tmp_path).count(temporary.name) == 1
    assert file.read_text() == "mine"
    assert os.listdir(tmp_path) == ["a.json"]


def test_two_processes_that_write_one_file_all_the_time_leave_it_whole(tmp_path):
    file = tmp_path / "a.txt"
    code = (
        "import sys\nfrom stancekit.planners.files.writing import write_text\n"
        "for _ in range(150): write_text(sys.argv[1], sys.argv[2] * 20000)\n"
    )
    both = [subprocess.Popen([sys.executable, "-c", code, str(file), letter]) for letter in "ab"]
    seen = set()
    while any(process.poll() is None for process in both):
        if file.exists():
            text = file.read_text()
            seen.add((text[:1], text == text[:1] * 20000))
        time.sleep(0.001)
    assert [process.returncode for process in both] == [0, 0]
    assert {letter for letter, _ in seen} == {"a", "b"}
    assert all(whole for _, whole in seen)
    assert os.listdir(tmp_path) == ["a.txt"]


def test_leftovers_of_other_targets_and_files_of_other_kinds_stay(tmp_path):
    others = [
        ".b.json.99-0123abcd.tmp",
        ".a.json.tmp",
        ".a.json.x-0123abcd.tmp",
        "a.json.99-0123abcd.tmp",
        ".a.json",
    ]
    for name in [*others, ".a.json.99-0123abcd.tmp", ".a.json.99.tmp"]:
        (tmp_path / name).write_text("half")
    write_text(tmp_path / "a.json", "whole")
    assert sorted(os.listdir(tmp_path)) == sorted([*others, "a.json"])


def test_a_leftover_that_is_a_link_a_pipe_or_locked_harms_nothing(tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".a.1-00000000.tmp").symlink_to("mine")
    os.mkfifo(tmp_path / ".a.2-00000000.tmp")
    write_text(tmp_path / "a", "whole")
    assert (tmp_path / "mine").read_text() == "mine"
    assert os.path.lexists(tmp_path / ".a.1-00000000.tmp")
    assert (tmp_path / "a").read_text() == "whole"


@pytest.mark.parametrize(
    "name", ["a b.json", "ä\n.json", "-a.json", "[a]*.json", "..json", "\udcff.json"]
)
def test_odd_names_are_written_and_cleared_up(tmp_path, name):
    file = tmp_path / name
    write = lambda: on_progress(lambda: write_text(file, "new"))  # noqa: E731
    assert ended(write, tmp_path, 4, "killed").code == -signal.SIGKILL
    assert len(leftovers(tmp_path)) == 1
    assert ended(write, tmp_path).code == 0
    assert os.listdir(tmp_path) == [name]


def test_the_longest_name_is_written_and_one_letter_more_refused_before_any_work(tmp_path):
    longest = "n" * (255 - len("..4194304-01234567.tmp"))
    write_text(tmp_path / longest, "x")
    for of, name in ((check_writable, f"{longest}n"), (check_writable, "a\0"), (make_folder, "\0")):
        with refuses():
            of(tmp_path / name)


def test_a_device_is_no_target_of_what_is_put_in_its_place(tmp_path):
    (tmp_path / "film.mp4").symlink_to("/dev/null")
    film = tmp_path / "film.mp4"
    with (
        refuses(),
        replaced(film),
    ):
        pass
    assert os.path.exists("/dev/null")
    assert not os.path.isfile("/dev/null")


def test_a_full_device_is_told_in_one_line():
    with refuses("/dev/full", FULL):
        write_text("/dev/full", "text")


def test_a_folder_that_takes_no_files_is_one_line_and_no_endless_search():
    if not Path("/proc/self").is_dir():
        return
    with refuses("/proc/stancekit.json"):
        write_text("/proc/stancekit.json", "x")
