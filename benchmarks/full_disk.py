"""A full disk at every write of every verb, and a kill between any two: does what was there before
stay?

    python benchmarks/full_disk.py [--case plan …] [--most 24] [--json]

Every case is a verb that writes over files of an earlier run. It is run again and again, each time
in a process of its own (``tests/emulators/faulty_disk.py``): with a disk that is full from its k-th
call on, for every k; killed before its k-th call, for every k; and, where this process may mount a
tmpfs, on a real disk with 0, 1, 2, … pages left (else with RLIMIT_FSIZE). A case with more than
``--most`` calls is sampled: its beginning, its end, and some between.

Wanted after a full disk: exit code 1 or 2 and one line with the reason and the path; after every
fault, each file is byte by byte what it was, or whole and new; after a full disk nothing else is
there; after a kill, the same command runs, and nothing else is there then. What is new is read
back, plans, walks and proofs by ``stancekit verify``.
"""

from __future__ import annotations

import io
import os
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from _bench import Options, launch

from stancekit.cli.main import main as stancekit
from tests.emulators.disk_cases import CASES, Case, made_inputs
from tests.emulators.faulty_disk import Ended, Fault, ended
from tests.emulators.whole_files import broken

PAGE = 4096
FOLDER = b"an empty folder"
ROOM = 192 << 20
REASONS = ("No space left on device", "File too large")


@dataclass(kw_only=True)
class Found:
    """What came of a case. tried: by fault; wrong: one line a fault that harmed something."""

    case: str
    calls: int
    tried: dict[str, int] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Arguments(Options):
    """Which cases, and how many calls of each."""

    case: tuple[str, ...] = tuple(case.name for case in CASES)
    most: int = 16


def main(arguments: Arguments) -> int:
    """Measure and print."""
    tried, wrong = 0, 0
    with tempfile.TemporaryDirectory() as spare, disk() as (root, limited):
        inputs = made_inputs(Path(spare) / "inputs")
        for case in CASES:
            if case.name in arguments.case:
                found = Trial(case, root, inputs, Path(spare) / case.name).found(
                    arguments.most, limited
                )
                tried, wrong = tried + sum(found.tried.values()), wrong + len(found.wrong)
                arguments.say(vars(found))
    arguments.say({"tried": tried, "wrong": wrong})
    return int(wrong > 0)


@contextmanager
def disk() -> Iterator[tuple[Path, bool]]:
    """A folder on a small file system of its own, and whether it is one."""
    with tempfile.TemporaryDirectory() as folder:
        mount = ["mount", "-t", "tmpfs", "-o", f"size={ROOM}", "tmpfs", folder]
        mounted = os.geteuid() == 0 and not subprocess.run(mount, capture_output=True).returncode
        try:
            yield Path(folder), mounted
        finally:
            os.chdir("/")
            if mounted:
                subprocess.run(["umount", folder], check=True)


class Trial:
    """One case on a disk. kept: where the state before every run is kept, off that disk."""

    def __init__(self, case: Case, root: Path, inputs: Path, kept: Path) -> None:
        self._case, self._root, self._work, self._kept = case, root, root / "work", kept
        self._inputs, self._whole = str(inputs), dict[bytes, str]()
        self._work.mkdir(exist_ok=True)
        kept.mkdir(parents=True)
        self.restore()
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()), suppress(SystemExit):
            self.work(case.verb)  # in this process: its children need not import anything
        self.restore()
        for verb in case.before:
            if (made := self.run(verb)).code != case.code:
                raise SystemExit(
                    f"{case.name}: {' '.join(verb)}: exit code {made.code}: {made.said}"
                )
        for pattern in case.dropped:
            for path in self._work.glob(pattern):
                path.unlink()
        shutil.copytree(self._work, kept, dirs_exist_ok=True)
        self._before = contents(kept)

    def found(self, most: int, limited: bool) -> Found:
        """All faults."""
        clean = self.again()
        found = Found(case=self._case.name, calls=len(clean.calls))
        self._names = set(contents(self._work))
        if clean.code != self._case.code or set(self._before) - self._names:
            raise SystemExit(f"{self._case.name}: exit code {clean.code}: {clean.said}")
        found.wrong += [f"without a fault: {line}" for line in self.harm()]
        for fault in ("full", "killed"):
            calls = some(len(clean.calls), most)
            found.tried[fault] = len(calls)
            for at in calls:
                place = f"{fault} at call {at} ({clean.calls[at - 1]})"
                found.wrong += [f"{place}: {line}" for line in self.faulted(at, fault)]
        pages = self.pages(limited)
        found.tried["with pages left" if limited else "with a limit of size"] = len(pages)
        found.wrong += [line for lines in pages for line in lines]
        self.restore()
        return found

    def faulted(self, at: int, fault: Fault) -> list[str]:
        """What is wrong after a fault at a call."""
        struck = self.again(at, fault)
        if fault == "full":
            return self.judged(struck)
        wrong = self.harm(left=True)
        if struck.code != -9:
            wrong.append(f"exit code {struck.code}, expected to be killed")
        after = self.run(self._case.verb)
        if after.code != self._case.code:
            wrong.append(f"the next run: exit code {after.code}: {after.said.strip()[-300:]}")
        return wrong + [f"after the next run: {line}" for line in self.harm()]

    def pages(self, limited: bool) -> list[list[str]]:
        """What is wrong with so much room left on the disk, from none to enough; a list each."""
        found: list[list[str]] = []
        room, last = 0, False
        while not last and len(found) < 200:
            self.restore()
            with full_but(room, self._root) if limited else sized(room):
                done = self.run(self._case.verb)
                last = done.code == self._case.code
                found.append([f"{room} bytes left: {line}" for line in self.judged(done)])
            room = room + PAGE if room < 4 * PAGE else 2 * room
        return found

    def judged(self, done: Ended) -> list[str]:
        """What is wrong after a full disk."""
        wrong = self.harm()
        if done.code == self._case.code and not any(reason in done.said for reason in REASONS):
            return wrong
        lines = [line for line in done.said.splitlines() if line.strip()]
        if done.code not in (1, 2):
            wrong.append(f"exit code {done.code}")
        if len(lines) != 1 or not any(reason in lines[0] for reason in REASONS):
            wrong.append(f"said {done.said.strip()[-400:]!r}")
        elif not any(Path(name).name in lines[0] for name in [*self._names, *self._case.paths]):
            wrong.append(f"names no path: {lines[0]}")
        return wrong

    def harm(self, left: bool = False) -> list[str]:
        """What is wrong with the files. left: what is being written may be there."""
        now = contents(self._work)
        wrong = [f"{name} is gone" for name in set(self._before) - set(now)]
        for name, content in now.items():
            known = name in self._before or name in self._names or name in self._case.partial
            if (
                not known
                and not (left and ".tmp" in name)
                and not (content == FOLDER and name in self._case.paths)
            ):
                wrong.append(f"{name} is left")
            if known and name not in self._case.partial and self._before.get(name) != content:
                said = self._whole.get(content) if content in self._whole else self.read(name)
                self._whole[content] = said
                wrong += [f"{name}: {said}"] if said else []
        return wrong

    def read(self, name: str) -> str:
        """Why a new file is not whole, "" where it is."""
        return broken(self._work / name, lambda *verb: self.run(verb).code)

    def again(self, at: int = 0, fault: Fault = "full") -> Ended:
        """The verb, over what was there before."""
        self.restore()
        return self.run(self._case.verb, at, fault)

    def restore(self) -> None:
        """What was there before."""
        for path in self._work.iterdir():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        shutil.copytree(self._kept, self._work, dirs_exist_ok=True)

    def run(self, verb: Sequence[str], at: int = 0, fault: Fault = "full") -> Ended:
        """The command in the folder."""
        return ended(lambda: self.work(verb), self._work, at, fault)

    def work(self, verb: Sequence[str]) -> int:
        """The command in the folder, in this process."""
        os.chdir(self._work)
        stancekit([word.replace("{in}", self._inputs) for word in verb])
        return 0


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, and every folder that is empty, under its name."""
    found = {}
    for path in folder.rglob("*"):
        if path.is_file() or not any(path.iterdir()):
            found[str(path.relative_to(folder))] = path.read_bytes() if path.is_file() else FOLDER
    return found


def some(count: int, most: int) -> list[int]:
    """1 … count, or the first and last and some between."""
    if count <= most:
        return list(range(1, count + 1))
    third = most // 3
    between = np.linspace(third + 1, count - third, most - 2 * third).astype(int).tolist()
    return sorted({*range(1, third + 1), *between, *range(count - third + 1, count + 1)})


@contextmanager
def full_but(room: int, root: Path) -> Iterator[None]:
    """The disk with so many bytes left."""
    filler = root / "filler"
    free = os.statvfs(root).f_bavail * os.statvfs(root).f_frsize
    with filler.open("wb") as stream:
        os.posix_fallocate(stream.fileno(), 0, max(free - room, 1))
    try:
        yield
    finally:
        filler.unlink()


@contextmanager
def sized(room: int) -> Iterator[None]:
    """Files of so many bytes at most."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (max(room, PAGE), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


if __name__ == "__main__":
    launch(main, Arguments, __doc__)
