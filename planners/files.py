"""Reading and writing the house's JSON files: clear errors on the way in, atomic on the way out."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from .outcome import Certificate, InvalidInput, Outcome, Posture
from .relaxation.envelope import EnvelopeSet
from .scene import PostureProblem, Robot

UNBOUNDED = 1e6
"""Stands in files for a lower bound of infinity: the problem has no answer even without its moment balance."""


def read_text(path: str | Path) -> str:
    """Return a file's text. Raises InvalidInput for a file that is missing, no file, empty or not UTF-8."""
    path = Path(path)
    try:
        content = path.read_bytes()
    except IsADirectoryError:
        raise InvalidInput(f"{path}: expected a file, found a folder") from None
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG):
            raise InvalidInput(f"{path}: expected a file, found nothing there") from None
        raise InvalidInput(f"{path}: cannot be read: {error.strerror}") from None
    text = decoded(content, str(path))
    if not text.strip():
        raise InvalidInput(f"{path}: expected some text, the file is empty")
    return text


def decoded(content: bytes, where: str) -> str:
    """Return UTF-8 bytes as text, without the byte order mark that some editors begin a file with.

    Raises InvalidInput for anything else.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{where}: expected UTF-8 text, byte {error.start} is not") from None


def parse_json(text: str, where: str) -> Any:
    """Parse one JSON document. Raises InvalidInput with line and column, and for a key that an object has twice."""
    try:
        return json.loads(text, object_pairs_hook=_object)
    except json.JSONDecodeError as error:
        raise InvalidInput(
            f"{where}: expected JSON, broken at line {error.lineno} column {error.colno}: {error.msg}"
        ) from None
    except InvalidInput as error:
        raise InvalidInput(f"{where}: {error}") from None
    except (RecursionError, ValueError) as error:
        raise InvalidInput(f"{where}: expected JSON: {error}") from None


def json_records(text: str, where: str) -> Iterator[tuple[str, Any | InvalidInput]]:
    """Yield (where, value) for every record in a text that is one JSON object, an array of them, or JSON lines.

    A record that cannot be parsed is yielded as its InvalidInput, and the rest still come. A text that is no JSON as a
    whole is taken for JSON lines where a line that is not indented is an object, unless it begins as an array does.
    """
    try:
        whole = parse_json(text, where)
    except InvalidInput as error:
        lines = [(f"{where} line {n}", line) for n, line in enumerate(text.split("\n"), 1) if line.strip()]
        objects = (line for _, line in lines if line[0] == "{" and isinstance(_parsed(line, where), dict))
        if len(lines) < 2 or text.lstrip()[0] == "[" or not any(objects):
            yield where, error
            return
        for place, line in lines:
            yield place, _parsed(line, place)
        return
    if not isinstance(whole, list):
        yield where, whole
        return
    if not whole:
        yield where, InvalidInput(f"{where}: expected one or more problems, got an empty array")
    for index, item in enumerate(whole):
        yield f"{where}[{index}]", item


def read_problems(
    text: str, where: str, *, robot: Robot | None = None
) -> Iterator[tuple[str, PostureProblem | InvalidInput]]:
    """Yield (where, problem or its InvalidInput) for every posture problem in a text, in order."""
    for place, item in json_records(text, where):
        if isinstance(item, InvalidInput):
            yield place, item
            continue
        try:
            yield place, PostureProblem.from_json(item, robot=robot)
        except InvalidInput as error:
            yield place, InvalidInput(f"{place}: {error}")


def read_envelopes(path: str | Path) -> EnvelopeSet:
    """Read an envelope file. Raises InvalidInput."""
    return _located(path, lambda: EnvelopeSet.from_json(parse_json(read_text(path), str(path))))


def outcome_to_json(outcome: Outcome, *, proof: bool = False) -> dict[str, Any]:
    """One line of answers: see ``stancekit solve --help``. proof: with the certificate of an infeasible verdict."""
    record: dict[str, Any] = {
        "status": outcome.status.value,
        "method": outcome.method,
        "residual_nm": _finite(outcome.residual_nm),
        "residual": _finite(outcome.residual),
        "lower_bound": min(outcome.lower_bound, UNBOUNDED),
        "seconds": outcome.seconds,
        "solves": outcome.solves,
    }
    if outcome.posture is not None:
        record |= outcome.posture.to_json()
    if outcome.claim:
        record["claim"] = outcome.claim
    if outcome.message:
        record["message"] = outcome.message
    if outcome.details:
        record["details"] = {name: _finite(value) for name, value in outcome.details.items()}
    if proof and outcome.certificate is not None:
        record["certificate"] = outcome.certificate.to_json()
    return record


def answer_from_json(data: Any) -> Posture | Certificate | None:
    """Read what a line of answers claims: a posture, a certificate, or nothing to check. Raises InvalidInput."""
    if not isinstance(data, dict):
        raise InvalidInput(f"expected a JSON object, got {type(data).__name__}")
    if data.get("certificate") is not None:
        return Certificate.from_json(data["certificate"])
    names = ("com_m", "rotation_rad", "toes_m", "forces_n")
    if not any(name in data for name in names):
        return None
    missing = [name for name in names if name not in data]
    if missing:
        raise InvalidInput(f"{missing[0]}: expected this key, got nothing")
    try:
        return Posture(**{name: data[name] for name in names})
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(f"{', '.join(names)}: expected lists of numbers") from None


def write_text(path: str | Path, text: str) -> None:
    """Write a file whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write a file whole or not at all, also when the machine stops: beside it first, then renamed.

    What a killed process leaves beside it is named ``.NAME.PID.tmp``. A link stays a link, and a device or a pipe is
    written to as it is. Raises InvalidInput where nothing can be written.
    """
    path = Path(path)
    target = check_writable(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(content)
            return
        with open(temporary, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, target)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def check_writable(path: str | Path) -> Path:
    """The file behind a path, asked for before the work whose result goes there. Raises InvalidInput if none can be."""
    path = Path(path)
    try:
        target = path.resolve()
        if path.is_dir():
            raise InvalidInput(f"{path}: cannot be written: {os.strerror(errno.EISDIR)}")
        if not path.parent.is_dir():
            raise InvalidInput(f"{path}: expected an existing folder {path.parent}")
        if not os.access(path if path.exists() and not path.is_file() else target.parent, os.W_OK):
            raise InvalidInput(f"{path}: cannot be written: {os.strerror(errno.EACCES)}")
    except (OSError, RuntimeError) as error:  # RuntimeError: links that lead back to themselves
        raise InvalidInput(f"{path}: cannot be written: {getattr(error, 'strerror', '') or error}") from None
    return target


def write_envelopes(path: str | Path, envelopes: EnvelopeSet) -> None:
    """Write an envelope file."""
    write_text(path, json.dumps(envelopes.to_json(), indent=1) + "\n")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InvalidInput(f"{twice}: expected this key once, got it {names.count(twice)} times")
    return found


def _parsed(text: str, where: str) -> Any | InvalidInput:
    try:
        return parse_json(text, where)
    except InvalidInput as error:
        return error


def _located(path: str | Path, read: Callable[[], EnvelopeSet]) -> EnvelopeSet:
    try:
        return read()
    except InvalidInput as error:
        text = str(error)
        raise InvalidInput(text if text.startswith(str(path)) else f"{path}: {text}") from None


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None
