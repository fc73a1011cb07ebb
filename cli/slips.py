"""Refusals of the parser of options, as one line: what was expected, what came, where."""

from __future__ import annotations

import re
from itertools import dropwhile, takewhile

KINDS = {"int": "an integer", "float": "a number"}


def slip(box: str) -> str:
    """Refusal that a box with a title holds, up to the first line that is ruled in it, and the
    option that it means.
    """
    rows = [row.strip().strip("│").strip() for row in box.splitlines()[1:]]
    body = list(dropwhile(_is_rule, rows))
    text = " ".join(takewhile(lambda row: not _is_rule(row), body)).rstrip(". ")
    return (
        _choice(text)
        or _number(text)
        or _unknown(text, body)
        or _without(text)
        or _missing(text)
        or text
    )


def _is_rule(row: str) -> bool:
    return row != "" and not row.strip("─-╰╯")


def _choice(said: str) -> str:
    match = re.fullmatch(
        r"invalid choice (.+) for argument '(\S+)'\. Expected one of \((.+)\)", said
    )
    if match is None:
        return ""
    names = sorted(
        set(re.findall(r"'([^']*)'", match[3])) - {"None"}
    )  # a set's order differs from run to run
    return f"{match[2]}: expected one of {', '.join(names)}, got {match[1]}"


def _number(said: str) -> str:
    match = re.match(r"Error parsing (\S+): ", said)
    kind = re.search(r"invalid literal for (int)\(\)|could not convert string to (float)", said)
    came = re.search(r"\['(.*?)'\]|: ('.*')$", said)
    if match is None or kind is None or came is None:
        return ""
    return f"{match[1]}: expected {KINDS[kind[1] or kind[2]]}, got {came[2] or repr(came[1])}"


def _unknown(said: str, body: list[str]) -> str:
    name, colon, rest = said.partition("Unrecognized options: ")
    if name or not colon:
        return ""
    meant = dropwhile(lambda row: row != "Perhaps you meant:", body)
    hints = [row.split()[0] for row in meant if re.match("--[a-z]", row)]
    return f"{rest.split(', ')[0]}: {_hinted(rest, list(dict.fromkeys(hints)))}"


def _hinted(rest: str, hints: list[str]) -> str:
    if not rest.startswith("-"):
        return "expected no further argument here"
    return f"no such option{'; perhaps ' + ' or '.join(hints) if hints else ''}"


def _without(said: str) -> str:
    match = re.fullmatch(r"Missing value for argument '(\S+)'\. Expected 1 values", said)
    return "" if match is None else f"{match[1]}: expected a value after it, got none"


def _missing(said: str) -> str:
    match = re.match(r"Missing from stancekit [a-z -]+: (--[\w-]+|[A-Z_]+)", said)
    return "" if match is None else f"{match[1]}: expected a value for it, got none"
