"""The reference of the command: what every command's ``--help`` says, as it says it."""

from __future__ import annotations

import io
import os
import re
from contextlib import redirect_stdout
from textwrap import fill

from stancekit.cli.main import COMMANDS, main

SUBCOMMANDS = {"bench": ("envelopes", "planner", "room", "gait")}
WIDTH = 100


def said(*arguments: str) -> str:
    """What the command prints for these arguments, without colours and without defaults that are
    none.
    """
    box = io.StringIO()
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = str(WIDTH)
    try:
        with redirect_stdout(box):
            main(arguments)
    except SystemExit as end:
        if end.code:
            raise RuntimeError(f"stancekit {' '.join(arguments)} ended with {end.code}") from end
    finally:
        del os.environ["COLUMNS"]
        if before is not None:
            os.environ["COLUMNS"] = before
    text = re.sub(r"\x1b\[[0-9;]*m", "", box.getvalue()).strip()
    text = re.sub(
        r"^ +-h, --help +show this help message and exit *\n", "", text, flags=re.MULTILINE
    )
    text = re.sub(r" +$", "", text, flags=re.MULTILINE)
    return re.sub(r"\s*\(default:\s*(?:None|False)?\)", "", text)


GROUP = re.compile(
    r"^( [^\n]+\n -{20,} *\n(?:  [^\n]+\n  -{20,} *\n)?)((?:(?! [^\n]+\n -{20,})[^\n]*\n)*)",
    re.MULTILINE,
)
"""A group of options in what ``--help`` says: its name, a rule, and lines up to the next one."""
ENTRY = re.compile(r"^  (?=\S)", re.MULTILINE)
LONG = 9
"""An option of so many words is not said twice."""
FURTHER = re.compile(r"\n\n {17}\S.*(?:\n {17}.*)*")
"""What a list of subcommands says of each beyond its first paragraph: their own sections have it."""


def once(help_text: str, command: str, first: dict[str, str]) -> str:
    """What a command's ``--help`` says, without the options that another one has in the same
    words: ``first`` has the command that did, by the option's words.
    """

    def group(found: re.Match[str]) -> str:
        kept, elsewhere = "", dict[str, list[str]]()
        entries = [each for each in ENTRY.split(found[2]) if each.strip()]
        for entry in entries:
            words = entry.split()
            owner = first.setdefault(" ".join(words), command)
            if owner == command or len(words) < LONG:
                kept += f"  {entry.rstrip()}\n"
            else:
                elsewhere.setdefault(owner, []).append(words[0])
        pointers = [
            f"{', '.join(names)}: see stancekit {owner}" for owner, names in elsewhere.items()
        ]
        title = found[1].partition("\n")[0].strip()
        head = found[1] if kept else f" {title}\n"
        below = "".join(
            fill(each, WIDTH, initial_indent="  ", subsequent_indent="    ") + "\n"
            for each in pointers
        )
        return head + kept + below + "\n"

    return GROUP.sub(group, FURTHER.sub("", help_text) + "\n").rstrip()


def page() -> str:
    """The page, Markdown."""
    first: dict[str, str] = {}
    lines = [
        "# The command",
        "",
        "What `stancekit --help` and `stancekit COMMAND --help` print, but for defaults that are none. What two",
        "commands say in the same words stands once.",
        "",
        "| exit code | of every command |",
        "|---|---|",
        "| 0 | done: there is a plan, a file is accepted, a run went as planned, files are written |",
        "| 1 | ran, and the answer is no: no plan, a file refused, a run stopped or off its goal |",
        "| 2 | input that cannot be used, said in one line; nothing was done |",
        "| 70 | a mistake in the program itself |",
        "",
        "`solve` and `label` answer many problems: 0 whatever the answers are.",
        "",
    ]
    lines += ["```text", said("--help"), "```", ""]
    for command in COMMANDS:
        lines += [
            f"## stancekit {command}",
            "",
            "```text",
            once(said(command, "--help"), command, first),
            "```",
            "",
        ]
        for what in SUBCOMMANDS.get(command, ()):
            lines += [
                f"### stancekit {command} {what}",
                "",
                "```text",
                once(said(command, what, "--help"), f"{command} {what}", first),
                "```",
                "",
            ]
    return "\n".join(lines)
