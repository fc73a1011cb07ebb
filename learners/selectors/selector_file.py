"""Files of selectors, whatever kind: read by what they say that they are."""

from __future__ import annotations

from pathlib import Path

from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.documents import decoded, file_or_named, open_file, parse_json
from stancekit.planners.formats.answer_file import read_envelopes

from ..zoo import shipped
from .own import is_own, own_selector
from .selector import Learned


def load_selector(path: str | Path) -> Learned:
    """Read any selector's file: an envelope file (JSON), or weights (safetensors).

    Nothing is unpickled.

    Or, of a selector that ships (``shipped``), or that another package registered under
    ``stancekit.selectors``, its name; or "FILE.py:NAME". Raises InvalidInput for what is missing,
    damaged or foreign.
    """
    if is_own(str(path)):
        return own_selector(str(path))
    path = file_or_named(path, shipped("selectors"))
    kind = safetensors_format(path) if path.is_file() else None
    if kind is None and path.suffix == ".safetensors" and path.is_file():
        raise InvalidInput(f"{path}: expected a whole safetensors file, got something else")
    if kind is None:
        return Learned.fixed(path.stem, read_envelopes(path))
    try:
        return _network(kind, path)
    except ImportError as error:
        raise not_installed(str(path), error.name, kind, "rl") from None


def _network(kind: str, path: Path) -> Learned:
    """A selector that needs torch."""
    if kind == "stancekit/neural/1":
        from .neural import NeuralSelector

        neural = NeuralSelector.load(path)
        return Learned.of(neural, kind, neural.problem_class)
    if kind == "stancekit/chooser/1":
        from .chooser import Chooser

        chooser = Chooser.load(path)
        return Learned(selector=chooser, problem_class=chooser.envelopes.problem_class)
    if kind == "stancekit/policy/1":
        from .policy import TrainedPolicy

        policy = TrainedPolicy.load(path)
        if not policy.shape.selects:
            got = policy.shape.environment
            raise InvalidInput(
                f"{path}: expected a policy that chooses envelopes, got one for {got}"
            )
        return Learned(selector=policy, problem_class=policy.shape.problem)
    known = "stancekit/envelope/1, stancekit/neural/1, stancekit/chooser/1 or stancekit/policy/1"
    raise InvalidInput(f"{path}: expected format {known}, got {kind:.60}")


def safetensors_format(path: Path) -> str | None:
    """The format that a safetensors file says it has; None for a file of another kind."""
    with open_file(path) as file:
        size = int.from_bytes(file.read(8), "little")
        if not 2 <= size <= min(path.stat().st_size, 10_000_000) or file.read(1) != b"{":
            return None
        header = b"{" + file.read(size - 1)
    try:
        head = parse_json(decoded(header, "header"), "header")
        return str(parse_json(str(head["__metadata__"]["stancekit"]), "header")["format"])
    except (ValueError, TypeError, KeyError):
        return "a safetensors file of something else"
