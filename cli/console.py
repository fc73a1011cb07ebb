"""Console of the command line: results on standard output, everything else on standard error."""

from __future__ import annotations

import io
import json
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, TextIO

from rich.console import (
    Console,
    ConsoleOptions,
    ConsoleRenderable,
    RenderableType,
    RenderHook,
    RenderResult,
)
from rich.segment import Segment

from stancekit.planners.errors import InvalidInput

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table
    from rich.text import Text

    from stancekit import Motion
    from stancekit.planners.gait.method.attempt import Attempt
    from stancekit.runner.report import Execution


class _Plain:
    """Shows anything without the letters that a terminal takes for orders; those that rich itself
    sends stay.
    """

    def __init__(self, shown: RenderableType) -> None:
        self._shown = shown

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for part in console.render(self._shown, options):
            yield part if part.control else Segment(_printable(part.text), part.style)


class _PlainText(RenderHook):
    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        return [_Plain(each) for each in renderables]


def _console(**options: Any) -> Console:
    """A console to which names are but text: no markup, no emoji, no orders to the terminal."""
    console = Console(soft_wrap=True, markup=False, emoji=False, **options)
    console.push_render_hook(_PlainText())
    return console


def _printable(text: str) -> str:
    """The text with a question mark for every letter that is none."""
    return "".join(letter if letter.isprintable() or letter in "\n\t" else "?" for letter in text)


_LONGEST_COMPLAINT = 2000
EVERY_S = 10.0
"""Where standard error is no terminal, long work says so often where it is."""
out = _console()
err = _console(stderr=True, highlight=False)


class _Aside(io.TextIOBase):
    """Stands for standard output while only results may go there: what is written to it goes to
    standard error.
    """

    def __init__(self, results: TextIO) -> None:
        self.results = results

    def write(self, text: str) -> int:
        return len(text) if sys.stderr is None else sys.stderr.write(text)

    def flush(self) -> None:
        self.results.flush()


@contextmanager
def results_alone() -> Iterator[None]:
    """All that code prints, that of one's own files, too, goes to standard error; what is
    emitted does not.
    """
    if sys.stdout is None:
        yield
        return
    with redirect_stdout(_Aside(sys.stdout)):
        yield


def emit(record: Mapping[str, Any]) -> None:
    """Print one JSON object on one line of standard output, at once."""
    results = sys.stdout.results if isinstance(sys.stdout, _Aside) else sys.stdout
    print(json.dumps(record, allow_nan=False), file=results, flush=True)


def tell(as_json: bool, record: Mapping[str, Any], *words: RenderableType) -> None:
    """Print what came of a command: one JSON object, or these lines and tables."""
    if as_json:
        emit(record)
    for each in () if as_json else words:
        out.print(each)


def complain(message: str) -> None:
    """Print one plain line on standard error, cut where it is longer than is read."""
    cut = message[:_LONGEST_COMPLAINT] + (" …" if len(message) > _LONGEST_COMPLAINT else "")
    plain = "".join(
        letter if letter.isprintable() else " " if letter.isspace() else "?" for letter in cut
    )
    with suppress(OSError):  # nobody is there to read it; the exit code says it, too
        err.print(" ".join(plain.split()))


def text_of(name: str | Path) -> str:
    """The text of a file, or of standard input where the name is -.

    Raises InvalidInput.
    """
    from stancekit.planners.files.documents import MOST_BYTES, decoded, read_text

    if str(name) != "-":
        return read_text(name)
    content = b"" if sys.stdin is None else sys.stdin.buffer.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise InvalidInput(f"-: expected {MOST_BYTES} bytes or fewer, got more")
    text = decoded(content, "-")
    if not text.strip():
        raise InvalidInput("-: expected JSON on standard input, got nothing")
    return text


@contextmanager
def as_options(*names: str, **called: str) -> Iterator[None]:
    """Let an InvalidInput that names settings name the options that gave them.

    Arguments:
        names: of settings; where none, whatever the message begins with.
        called: settings whose option has another name.
    """

    def option(part: str) -> str:
        name, colon, rest = part.partition(":")
        name = called.get(name, name if not names or name in names else "")
        return f"--{name.replace('_', '-')}{colon}{rest}" if name else part

    try:
        yield
    except InvalidInput as error:
        parts = str(error).split("; ") if names else [str(error)]
        raise type(error)("; ".join(map(option, parts))) from None


def grid(
    columns: Mapping[str, Mapping[str, Any]] | Iterable[tuple[str, Mapping[str, Any]]],
    rows: Iterable[Iterable[Any]],
    **look: Any,
) -> Table:
    """A table.

    Arguments:
        columns: by their heads, how rich shows each.
        look: of the table itself, as rich has it.
    """
    from rich.table import Table

    table = Table(**look)
    for name, how in columns.items() if isinstance(columns, Mapping) else columns:
        table.add_column(name, **how)
    for row in rows:
        table.add_row(*row)
    return table


def results(
    sides: Mapping[str, str], rows: Iterable[Iterable[Any]], *, folds: Sequence[str]
) -> Table:
    """A table of results, with columns by the side that they are set to.

    Arguments:
        folds: columns whose words may be broken.
    """
    how = {
        name: {"justify": side, "overflow": "fold", "no_wrap": name not in folds}
        for name, side in sides.items()
    }
    return grid(how, rows, box=None, header_style="bold")


def facts(
    rows: Iterable[tuple[str, str | Text]], overflow: Literal["fold", "ellipsis"] = "fold"
) -> Table:
    """A table of names and what there is to say of each; rows without words are left out."""
    columns = ("", {"style": "bold"}), ("", {"overflow": overflow})
    return grid(columns, [row for row in rows if row[1]], box=None, show_header=False)


def draw_to_file(figure: Figure, path: Path) -> None:
    """Write a picture."""
    from stancekit.views.sheet import save  # loads matplotlib

    save(figure, path)


def say(lines: Iterable[object], word: str = "{}") -> None:
    """Print lines, or names of files, those that there are, each in these words."""
    for line in filter(None, lines):
        out.print(word.format(line), highlight=False)


class _Lines:
    """Progress of long work where standard error is no terminal: a plain line now and then, nothing
    elsewhere.
    """

    def __init__(self, title: str) -> None:
        self._title, self._asks = title, not err.is_terminal
        self._began_s = self._said_s = time.monotonic()

    def say(self, where: str) -> None:
        """Print where the work is, unless that was said a moment ago."""
        now_s = time.monotonic()
        if self._asks and now_s - self._said_s >= EVERY_S:
            self._said_s = now_s
            with suppress(OSError, ValueError):  # nobody is there to read it, or not any more
                err.print(
                    f"{self._title}: "
                    f"{', '.join(filter(None, (where, f'{now_s - self._began_s:.0f} s')))}"
                )


class Show(Protocol):
    """Shows how far work is."""

    def __call__(self, done: int, total: int, stage: str = "", /) -> None:
        """Show that so much of a total is done.

        Arguments:
            stage: what is being done, where that says more.
        """
        ...


@contextmanager
def progress(title: str) -> Iterator[Show]:
    """A progress bar on standard error; call it with (done, total), and what is being done where
    that says more.

    Where standard error is no terminal, lines: now and then, whether it was called meanwhile or
    not.
    """
    with _bar(title) as bar:
        lines, ended, where = _Lines(title), threading.Event(), [""]

        def show(done: int, total: int, stage: str = "", /) -> None:
            bar(done, total, stage)
            where[0] = stage or f"{done} of {total}"
            lines.say(where[0])

        def watch() -> None:
            while not ended.wait(0.1 * EVERY_S or None):
                lines.say(where[0])

        watcher = threading.Thread(target=watch, name=title, daemon=True)
        if not err.is_terminal:
            watcher.start()
        try:
            yield show
        finally:
            ended.set()
            if watcher.ident is not None:
                watcher.join()


@contextmanager
def _bar(title: str) -> Iterator[Show]:
    """A progress bar on standard error; nothing where that is no terminal."""
    if not err.is_terminal:
        yield lambda *_: None
        return
    from rich.progress import (  # of terminals alone
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(title, total=None)

        def show(done: int, total: int, stage: str = "", /) -> None:
            described = f"{title}: {stage}" if stage else title
            bar.update(task, completed=done, total=total or None, description=described)

        yield show


@contextmanager
def stages(title: str) -> Iterator[Callable[[str, int, int], None]]:
    """One bar, told the stage; where standard error is no terminal, a line when a stage begins."""
    seen: list[str] = []
    with progress(title) as bar:

        def on_progress(stage: str, done: int, total: int) -> None:
            if not seen or seen[-1] != stage:
                seen.append(stage)
                if not err.is_terminal:
                    err.print(stage)
            bar(done, total)

        yield on_progress


@contextmanager
def watching(title: str) -> Iterator[Callable[[Attempt, int, float, float, str], None]]:
    """Yields what shows an iteration (attempt, number, violation, cost, phase) on standard error.

    One line with the time that has passed, or one now and then where standard error is no terminal.
    """
    with _bar(title) as bar:
        lines = _Lines(title)

        def show(
            attempt: Attempt, iteration: int, violation: float, cost: float, phase: str
        ) -> None:
            text = f"{attempt.name}, {phase}: iteration {iteration}, violation {violation:.1e}, cost {cost:.3g}"
            bar(iteration, 0, text)
            lines.say(text)

        yield show


def show(
    motion: Motion[Any],
    executed: Execution | None = None,
    *,
    picture: Path | None = None,
    video: Path | None = None,
    html: Path | None = None,
) -> list[Path]:
    """Write the picture, the film and the page that were asked for; their names.

    Arguments:
        executed: how a world had the motion, which is then shown.
    """
    written = [path for path in (picture, video, html) if path is not None]
    if not written:
        return []
    from stancekit import draw, film

    if picture is not None:
        draw(motion, executed=executed, out=picture)
    for path in (video, html):
        if path is not None:
            with progress(f"film {path}") as bar:
                film(motion, path, executed, progress=bar)
    return written
