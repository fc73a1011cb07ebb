"""The command ``stancekit``."""

from __future__ import annotations

import gc
import io
import os
import re
import sys
import textwrap
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout
from importlib import import_module
from itertools import dropwhile, takewhile
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

_DESCRIPTION = """Legged robots learn and plan on hard terrain.

A session, from terrain to a picture:
  stancekit sample wall-3 --count 3 > postures.jsonl
  stancekit solve postures.jsonl
  stancekit label wall-3 data/train
  stancekit label wall-3 data/test --seed 1
  stancekit fit data/train --method gmm --out envelope.json
  stancekit evaluate data/test --envelopes envelope.json
  stancekit picture postures.jsonl --out posture.png

Key frames over a course, and a gait over curved ground:
  stancekit plan walls --out plan.json --picture plan.png
  stancekit verify plan.json
  stancekit simulate plan.json --world bullet
  stancekit run plan.json --world mujoco --log run.mcap
  stancekit gait ripple --goal 1.5,1 --out gait.json --picture gait.png
And on a page, to be dragged while one looks: stancekit play walls

Exit code: 0 done; 1 ran, but a check failed; 2 bad input; 70 a mistake in the
program itself (STANCEKIT_TRACE=1 shows where).
With --json, one JSON object per line on standard output, and nothing else."""

INTERNAL = 70
"""Exit code of a mistake in the program itself (EX_SOFTWARE of sysexits.h): neither bad input nor a
refusal."""
_TRACE = "STANCEKIT_TRACE"
_RARELY = (200_000, 20, 20)
"""Objects made between two searches for those that only hold each other, and how many searches make
one of older objects."""

COMMANDS = MappingProxyType(
    {
        "sample": "label:Sample",
        "solve": "solve:SolvePostures",
        "verify": "verify:Verify",
        "label": "label:LabelPostures",
        "fit": "fit:Fit",
        "evaluate": "fit:Evaluate",
        "picture": "verify:Picture",
        "export": "verify:Export",
        "plan": "plan:PlanCourse",
        "play": "play:Play",
        "simulate": "run:Simulate",
        "terrain": "terrain:ShowTerrain",
        "map": "terrain:MapTerrain",
        "run": "run:RunMotion",
        "replay": "run:Replay",
        "robot": "terrain:ShowRobot",
        "warp": "terrain:Warp",
        "gait": "gait:PlanGait",
        "bench": "bench:Bench",
        "demo": "about:Demo",
        "about": "about:About",
    }
)
"""The module and the class of every command; it is imported when it is asked for."""
ENTRY_POINTS = "stancekit.commands"
"""The group of entry points by which other packages bring commands: NAME = "module:CLASS". They
are looked for where a name is none of ours, since to look for them takes as long as all of
``--help``."""


_BRIEF = r'(?ms)^class {}\b[^\n]*:\n    """(.*?)(?:\n\n|""")'
"""A class of this name and the first paragraph of its docstring, in the text of a file."""


class _Command(Protocol):
    """Base of all commands: the fields are the options, the docstring is the help."""

    def run(self) -> int:
        """Do it; the exit code."""
        ...


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command and exit with its code."""
    alone, arguments = arguments is None, list(sys.argv[1:] if arguments is None else arguments)
    os.environ.setdefault(
        "PYDANTIC_DISABLE_PLUGINS", "__all__"
    )  # to look for some it reads every package's metadata
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks a letter shows another one
    if arguments in (["--version"], ["-V"]):
        from importlib.metadata import version

        print(f"stancekit {version('stancekit')}")
        return
    try:
        if arguments in ([], ["--help"], ["-h"]):
            print(_overview(), flush=True)
            return
        gc.set_threshold(*_RARELY)  # most of what commands make is modules, which stay
        command = parse(arguments)
    except BrokenPipeError:  # `stancekit COMMAND --help | head`
        _close_output()
        sys.exit(0)
    code = run(command)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:  # nobody reads it any more
        _close_output()
    if alone:
        gc.freeze()  # the process ends: nobody looks for what only holds itself
    sys.exit(code)


def _overview() -> str:
    """Text of ``stancekit --help``: one or two lines per command."""
    usage = "usage: stancekit COMMAND [OPTIONS]; stancekit COMMAND --help says more"
    briefs = [f"  {name:9} {brief(name)}" for name in COMMANDS]
    lines = (textwrap.fill(brief, width=80, subsequent_indent=" " * 12) for brief in briefs)
    return "\n".join([usage, "", _DESCRIPTION, "", "Commands:", *lines])


def brief(name: str) -> str:
    """The first paragraph of a command's docstring, read from its file: to import all of them takes
    a second.
    """
    module, _, command = COMMANDS[name].partition(":")
    source = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    if match := re.search(_BRIEF.format(command), source):
        return " ".join(match[1].split())
    raise LookupError(f"{module}.py: expected class {command}")


def commands() -> dict[str, type[_Command]]:
    """The class of every command."""
    return {name: _command(name) for name in COMMANDS}


def parse(arguments: Sequence[str]) -> _Command:
    """The command that the arguments name, with its options.

    Exits with 2 after one line where they are wrong.
    """
    import tyro

    from .console import complain
    from .options import flowing, rules

    if arguments[0] not in COMMANDS and arguments[0] not in _others():
        known = ", ".join((*COMMANDS, *_others()))
        complain(f"stancekit: error: COMMAND: expected one of {known}, got {arguments[0]!r}")
        sys.exit(2)
    for name, count in Counter(
        each.split("=")[0] for each in arguments[1:] if each.startswith("--")
    ).items():
        if count > 1:  # else the last one would silently count alone
            complain(
                f"stancekit: error: {name}: expected once, got it {count} times; see stancekit "
                f"{arguments[0]} --help"
            )
            sys.exit(2)
    command, page, box = _command(arguments[0]), _Page(), io.StringIO()
    try:
        with redirect_stderr(box), redirect_stdout(page):
            return tyro.cli(
                command,
                prog=f"stancekit {arguments[0]}",
                description=flowing(command.__doc__ or ""),
                args=arguments[1:],
                config=(tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
                registry=rules(helps=not {"--help", "-h"}.isdisjoint(arguments)),
            )
    except SystemExit as end:
        print(page.broken(), end="", flush=True)
        if end.code:
            complain(
                f"stancekit: error: {slip(box.getvalue())}; see stancekit {arguments[0]} --help"
            )
        raise


class _Page(io.StringIO):
    """A help text on its way to standard output, in its letters, and its colours if a terminal."""

    def __init__(self) -> None:
        super().__init__()
        self._output = sys.stdout

    def isatty(self) -> bool:
        """Tell whether standard output is a terminal."""
        return self._output is not None and self._output.isatty()

    @property
    def encoding(self) -> str:  # type: ignore[override]  # typeshed has an attribute
        """Standard output's."""
        return getattr(self._output, "encoding", None) or "ascii"

    def broken(self) -> str:
        """The text, the lines ahead of its tables broken between words."""
        import shutil

        width = min(80, shutil.get_terminal_size().columns)
        text, table, rest = self.getvalue().partition("╭")
        lines = [
            line
            if line.startswith(" ")
            else textwrap.fill(line, width, break_long_words=False, break_on_hyphens=False)
            for line in re.sub(r"\n\n\n+", "\n\n", text).split("\n")
        ]
        return "\n".join(lines) + table + rest


_KINDS = {"int": "an integer", "float": "a number"}


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
    return f"{match[1]}: expected {_KINDS[kind[1] or kind[2]]}, got {came[2] or repr(came[1])}"


def _unknown(said: str, body: list[str]) -> str:
    name, colon, rest = said.partition("Unrecognized options: ")
    if name or not colon:
        return ""
    meant = dropwhile(lambda row: row != "Perhaps you meant:", body)
    hints = [row.split()[0] for row in meant if re.match("--[a-z]", row)]
    perhaps = f"; perhaps {' or '.join(dict.fromkeys(hints))}" if hints else ""
    what = (
        f"no such option{perhaps}" if rest.startswith("-") else "expected no further argument here"
    )
    return f"{rest.split(', ')[0]}: {what}"


def _without(said: str) -> str:
    match = re.fullmatch(r"Missing value for argument '(\S+)'\. Expected 1 values", said)
    return "" if match is None else f"{match[1]}: expected a value after it, got none"


def _missing(said: str) -> str:
    match = re.match(r"Missing from stancekit [a-z -]+: (--[\w-]+|[A-Z_]+)", said)
    return "" if match is None else f"{match[1]}: expected a value for it, got none"


def _command(name: str) -> type[_Command]:
    if name not in COMMANDS:
        from stancekit.planners.plugins import foreign

        with foreign(f"command {name}"):
            theirs: type[_Command] = _others()[name].load()
        return theirs
    module, _, command = COMMANDS[name].partition(":")
    ours: type[_Command] = getattr(import_module(f".{module}", __package__), command)
    return ours


def _others() -> dict[str, Any]:
    """The entry points of commands of other packages, by name; none takes over one of ours."""
    from stancekit.planners.plugins import entry_points_of

    return {
        point.name: point for point in entry_points_of(ENTRY_POINTS) if point.name not in COMMANDS
    }


def run(command: _Command) -> int:
    """Run a command; what goes wrong on purpose becomes one line and an exit code."""
    from stancekit.planners.errors import InvalidInput, StancekitError

    from .console import complain, results_alone

    try:
        with (
            _without_warnings(),
            results_alone() if getattr(command, "json", False) else nullcontext(),
        ):
            return command.run()
    except InvalidInput as error:
        complain(f"stancekit: error: {error}")
        return 2
    except StancekitError as error:
        complain(f"stancekit: failed: {error}")
        return 1
    except KeyboardInterrupt:
        complain("stancekit: interrupted")
        return 130
    except BaseException as error:  # whatever ends a command is told in one line, and its exit code
        return _ended_by(error)


_OF_GROUND = ".* closed parts narrower than .* are inside out|.*: no ground: |mesh .*: its hull "
"""How this package's warnings begin of a ground that was mended, or that is not all of its file."""


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Keep what libraries warn of away from standard error, which is for one line, unless the trace
    is wanted.

    A mesh that was mended is worth a line of its own.
    """
    from .console import complain

    messages = set[str]()

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if str(message) not in messages:
            messages.add(str(message))
            complain(f"stancekit: warning: {message}")

    with warnings.catch_warnings():
        if not os.environ.get(_TRACE):
            warnings.simplefilter("ignore")
            warnings.filterwarnings("always", _OF_GROUND, UserWarning)
            warnings.showwarning = show
        yield


def _ended_by(error: BaseException) -> int:
    """The exit code for what was not raised on purpose, after one line.

    Raises what is no error, as SystemExit.
    """
    from stancekit.planners.plugins import blamed

    from .console import complain

    theirs = blamed(error)
    if os.environ.get(_TRACE) and (theirs or not isinstance(error, OSError | MemoryError)):
        raise error
    if theirs:
        complain(f"stancekit: failed: {theirs}; {_TRACE}=1 shows more")
        return 1
    if isinstance(error, BrokenPipeError):
        _close_output()
        return 0
    if isinstance(error, OSError | MemoryError):  # a full disk, a file that went away
        complain(f"stancekit: failed: {type(error).__name__}: {error}")
        _close_output()
        return 1
    if not isinstance(error, Exception):
        raise error
    complain(f"stancekit: internal error: {type(error).__name__}: {error}; {_TRACE}=1 shows where")
    return INTERNAL  # our own mistake, and no verdict on anything


def _close_output() -> None:
    """Send what is still in the buffer of standard output nowhere, or Python complains of it at the
    end.
    """
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
