"""Documents in bounds: YAML, JSON and what is shown of a value, each against what it must cost and
say.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from stancekit.planners.errors import InvalidInput
from stancekit.planners.files.documents import (
    DEEPEST,
    MOST_YAML_VALUES,
    open_file,
    parse_json,
    parse_yaml,
    read_bytes,
    shown,
)
from tests.damage import bombs
from tests.damage.cases import cases, command
from tests.refusals import assert_names, at_once


def refusal(call, *arguments):
    with pytest.raises(InvalidInput) as caught:
        call(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_yaml_with_a_few_aliases_is_read_as_ever():
    text = "a: &a {x: 1, y: [1, 2]}\nb: *a\nc: {<<: *a, x: 3}\n"
    assert parse_yaml(text, "f") == yaml.safe_load(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            bombs.aliases().decode(),
            f"f: expected {MOST_YAML_VALUES} values or fewer, aliases replaced, got more",
        ),
        (bombs.endless_yaml().decode(), "f: expected an anchor before its alias, got *a"),
        (bombs.deep_yaml().decode(), f"f: expected {DEEPEST} levels of nesting or fewer, got more"),
        (
            "a: &a0 [[[[[[[[[[]]]]]]]]]]\n"
            + "".join(f"b{k}: &a{k + 1} [[[[[[*a{k}]]]]]]\n" for k in range(20)),
            f"f: expected {DEEPEST} levels of nesting or fewer, got more",
        ),
        ("[1, 2]", "f: expected keys and values, got list"),
    ],
)
def test_yaml_that_grows_is_refused_at_once(text, said):
    with at_once(10_000):
        assert refusal(parse_yaml, text, "f") == said


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\na: 2\n",
        "a: 2001-99-99\n",
        "a: !!int ''\n",
        "a: !!timestamp x\n",
        "{[1]: 2}",
        "? {}\n: 1\n",
        "a: *b\n",
        "a: !!python/object:os.system {}\n",
        "a: 1\n---\nb: 2\n",
        "a: " + "9" * 9999,
        "\x00",
        'a: "b\\0c"\n',
        '"b\\0": c\n',
    ],
)
def test_yaml_that_is_broken_in_any_way_is_one_line(text):
    assert_names(refusal(parse_yaml, text, "f"), "f")


def test_what_is_as_deep_as_may_be_is_read_and_no_deeper():
    assert parse_json("[" * DEEPEST + "]" * DEEPEST, "f")
    assert "levels of nesting" in refusal(
        parse_json, "[" * (DEEPEST + 2) + "]" * (DEEPEST + 2), "f"
    )
    assert parse_yaml("a: " + "[" * (DEEPEST - 1) + "]" * (DEEPEST - 1), "f")
    assert "levels of nesting" in refusal(parse_yaml, "a: " + "[" * DEEPEST + "]" * DEEPEST, "f")


@pytest.mark.parametrize(
    "text",
    [
        '{"a": NaN}',
        "[Infinity]",
        "-Infinity",
        '"\\ud800"',
        '{"\\udc00": 1}',
        "1" * 5000,
        '{"a": "b\\u0000"}',
    ],
)
def test_what_is_no_json_for_others_is_none_here(text):
    assert_names(refusal(parse_json, text, "f"), "f")


def test_pairs_of_surrogates_are_a_letter_and_an_escaped_backslash_is_one():
    assert parse_json('["\\\\u0000"]', "f") == ["\\u0000"]
    assert parse_json('"\\ud83d\\ude00"', "f") == "\U0001f600"


def test_a_file_without_end_is_refused():
    assert_names(refusal(read_bytes, "/dev/zero", 1000), "/dev/zero")


def test_a_file_of_more_bytes_than_are_read_is_refused(tmp_path):
    path = tmp_path / "long.bin"
    path.write_bytes(bytes(1001))
    assert_names(refusal(read_bytes, path, 1000), path)
    assert read_bytes(path, 1001) == bytes(1001)


@pytest.mark.parametrize(
    "value", [[1, 2], {"a": [1.5, None]}, "text", ("a", {1}), [], {}, -3, None]
)
def test_a_small_value_is_shown_as_python_writes_it(value):
    assert shown(value) == repr(value)


def test_what_is_cut_off_costs_nothing():
    value = ["x" * 10_000] * 10
    for _ in range(30):
        value = [value] * 10
    with at_once(10_000):
        assert len(shown(value)) == 60
        assert shown([[10**5000] * 3] * 3, 30) == "[[an integer of 16610 bits, an"


NO_FILES = ("pipe", "folder", "device", "socket", "loop", "nothing", "to a pipe", "to a folder")


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    """A folder with one of each."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name, target in (
        ("device", "/dev/zero"),
        ("loop", "loop"),
        ("to a pipe", "pipe"),
        ("to a folder", "folder"),
    ):
        (tmp_path / name).symlink_to(target)
    with socket.socket(socket.AF_UNIX) as listener:
        before = Path.cwd()
        os.chdir(tmp_path)  # names of sockets are short
        listener.bind("socket")
        os.chdir(before)
        yield tmp_path


@pytest.mark.parametrize("name", NO_FILES)
def test_what_is_no_file_is_said_at_once(place: Path, name: str) -> None:
    with pytest.raises(InvalidInput) as error:
        read_bytes(place / name)
    said = str(error.value).removeprefix(f"{place / name}: ")
    wanted = {
        "loop": "cannot be read: Too many levels of symbolic links",
        "nothing": "expected a file, found nothing there",
        **dict.fromkeys(("folder", "to a folder"), "expected a file, found a folder"),
    }
    assert said == wanted.get(name, "expected a file, found a pipe, a socket or a device")


def test_a_file_behind_a_link_is_read_and_nothing_stays_open(place: Path) -> None:
    (place / "file").write_bytes(b"text")
    (place / "link").symlink_to("file")
    before = len(os.listdir("/proc/self/fd"))
    assert read_bytes(place / "link") == b"text"
    for name in NO_FILES:
        with pytest.raises(InvalidInput), open_file(place / name):
            pytest.fail("opened")
    assert len(os.listdir("/proc/self/fd")) == before


COMMANDS = {
    case.arguments: case.file
    for case in cases()
    if "/" not in case.file and case.arguments[0] != "label"
}
"""Those of the readers whose file the command itself names; what those files name are meshes and
URDFs."""


@pytest.mark.parametrize(
    "arguments", [each for each, file in COMMANDS.items() if file in each], ids=" ".join
)
@pytest.mark.parametrize("name", ["pipe", "folder"])
def test_a_command_that_is_given_no_file_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / COMMANDS[arguments]
    os.mkfifo(file) if name == "pipe" else file.mkdir()
    code, _, err = command(arguments)
    assert (code, err.count("\n")) == (2, 1)
    assert err.startswith("stancekit: error: ")
