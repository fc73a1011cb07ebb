"""What pydantic refused in a file, in the house's words: one line a key, what was expected and what came."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import ValidationError

from .outcome import InvalidInput


def refusals(error: ValidationError) -> Iterator[str]:
    """One "key: what was expected, got what" for everything wrong in a file.

    Where a dataclass refused its values (InvalidInput), what it said, with its place before it.
    """
    for item in error.errors():
        key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in item["loc"]).lstrip(".")
        cause = item.get("ctx", {}).get("error")
        if isinstance(cause, InvalidInput):
            yield f"{key}.{cause}" if key else str(cause)
        elif item["type"] in ("missing", "missing_argument"):
            yield f"{key}: expected this key, got nothing"
        elif item["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            yield f"{key}: unknown key"
        else:
            yield f"{key}: {item['msg']}, got {item['input']!r:.60}"
