"""Install wheels and sdists into empty environments of every Python at hand, and try what a
newcomer types first.

    python .ci/smoke.py [--pins constraints.txt] dist/*.whl dist/*.tar.gz

A Python is at hand where ``python3.11`` and so on are on the path or pyenv has them. Only the core
is installed: what needs an extra has to say so in one line. The command that `stancekit play` names
is then run as it stands, and the playground has to be served. Prints a line per artefact and exits
with 1 if anything fails, or no Python is at hand.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

VERSIONS = ("3.11", "3.12", "3.13")
TRIES = (
    ("--version",),
    ("--help",),
    ("sample", "wall-3", "--count", "2", "--out", "postures.jsonl"),
    ("solve", "postures.jsonl", "--certificate", "--out", "answers.jsonl"),
    ("verify", "postures.jsonl", "answers.jsonl", "--explain"),
    ("plan", "walls", "--out", "plan.json"),
    ("about", "--no-measure"),
    ("picture", "postures.jsonl", "--out", "posture.png"),
)
LIBRARY = """
import gymnasium, stancekit
problem = stancekit.sample("wall-3", rng=8)[0]
outcome = stancekit.solve(problem)
assert stancekit.verify(outcome.certificate).accepted
env = gymnasium.make("stancekit.envs:stancekit/EnvelopeSelection-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
print(stancekit.__version__)
"""
LACKING = (
    ("robot", "robot.urdf"),
    ("label", "wall-3", "rows"),
    ("simulate", "plan.json"),
    ("plan", "walls", "--video", "film.mp4"),
    ("robot", "go1"),
    ("play", "walls"),
)
"""Commands that need an extra: one line that names it, exit code 2. What the last one names is
installed."""
PLAY = "play", "walls", "--no-browser", "--port", "0"
SERVED_S = 120


def pythons() -> dict[str, str]:
    """By version: an interpreter that runs."""
    found = {}
    for version in VERSIONS:
        pyenv = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
        for path in [*map(str, pyenv), shutil.which(f"python{version}")]:
            if path is None:
                continue
            asked = subprocess.run(
                [path, "-c", "import ensurepip, ssl"], capture_output=True, check=False
            )
            if asked.returncode == 0:
                found[version] = path
                break
    return found


def tried(python: str, artefact: Path, pins: Path | None) -> str:
    """Install and try; empty, or what went wrong."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
        mine = folder / "venv" / "bin" / "python"
        pinned = [] if pins is None else ["-c", str(pins.resolve())]
        install = [
            mine,
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            *pinned,
            artefact.resolve(),
        ]
        environment = {
            key: value
            for key, value in os.environ.items()
            if key not in ("PYTHONPATH", "VIRTUAL_ENV")
        }
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "80"}
        for what, command in [
            ("pip install", install),
            *(
                (f"stancekit {' '.join(words)}", [mine.with_name("stancekit"), *words])
                for words in TRIES
            ),
            ("import stancekit", [mine, "-c", LIBRARY]),
        ]:
            ran = subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True, check=False
            )
            if ran.returncode != 0:
                return f"{what}: {(ran.stderr or ran.stdout).strip()[-600:]}"
        (folder / "robot.urdf").write_text("<robot/>")
        command = ""
        for words in LACKING:
            ran = subprocess.run(
                [mine.with_name("stancekit"), *words],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
            )
            named = re.search(r'pip install "(stancekit\[\w+\])"\n$', ran.stderr)
            if ran.returncode != 2 or named is None:
                return f"stancekit {' '.join(words)}: expected exit code 2 and a package to install, got {ran.stderr}"
            command = named[1]
        pip = [
            mine,
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            *pinned,
            command,
        ]
        ran = subprocess.run(
            pip, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        if ran.returncode != 0:
            return f"pip install {command}: {(ran.stderr or ran.stdout).strip()[-600:]}"
        return served([str(mine.with_name("stancekit")), *PLAY], folder, environment)


def served(command: list[str], folder: Path, environment: dict[str, str]) -> str:
    """Start the playground and open its page; empty, or what went wrong."""
    with subprocess.Popen(
        command,
        cwd=folder,
        env=environment | {"PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as page:
        patience = threading.Timer(SERVED_S, page.kill)
        patience.start()
        assert page.stdout is not None
        said = ""
        try:
            for line in page.stdout:
                said += line
                if address := re.match(r"(http://\S+) shows walls", line):
                    with urllib.request.urlopen(address[1], timeout=SERVED_S) as answer:
                        return "" if answer.status == 200 else f"{address[1]}: got {answer.status}"
            return f"stancekit play walls: expected an address, got {said[-600:]}"
        finally:
            patience.cancel()
            page.kill()


def main() -> int:
    """Every artefact in every Python."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("artefacts", nargs="+", type=Path)
    parser.add_argument("--pins", type=Path)
    asked = parser.parse_args()
    at_hand = pythons()
    wrong = not at_hand
    for version in VERSIONS:
        if version not in at_hand:
            print(f"Python {version}: none at hand")
            continue
        for artefact in asked.artefacts:
            begin = time.monotonic()
            message = tried(at_hand[version], artefact, asked.pins)
            wrong = wrong or bool(message)
            seconds = time.monotonic() - begin
            print(
                f"Python {version}, {artefact.name}: {message or 'works'} ({seconds:.0f} s)",
                flush=True,
            )
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
