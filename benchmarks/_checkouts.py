"""Other checkouts of the project, which a table is measured or compared against.

Nothing of the package is imported here, so that a script that runs in another checkout can.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]


@contextmanager
def checkout(name: str) -> Iterator[Path]:
    """A checkout with its links made: the folder of that name, or a commit, which is written out
    for as long as it is used.

    Exits with 2 after one line where it is neither.
    """
    if Path(name, ".editable", "stancekit").is_dir():
        yield Path(name).resolve()
        return
    asked = ["git", "rev-parse", "--verify", "--quiet", "--end-of-options", f"{name}^{{commit}}"]
    found = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False)
    if found.returncode:
        print(
            "--against: expected a commit, or a folder in which `python setup.py links` was run, "
            f"got {name!r}",
            file=sys.stderr,
        )
        sys.exit(2)
    with TemporaryDirectory(prefix="stancekit-") as made:
        written = subprocess.run(
            ["git", "archive", found.stdout.strip()], cwd=ROOT, capture_output=True, check=True
        )
        with tarfile.open(fileobj=io.BytesIO(written.stdout)) as tree:
            tree.extractall(made, filter="data")
        subprocess.run([sys.executable, "setup.py", "--quiet", "links"], cwd=made, check=True)
        yield Path(made)


def checkouts(against: Path | None) -> dict[str, Path]:
    """This tree, and another before it, in which `python setup.py links` was run."""
    return {"after": ROOT} if against is None else {"before": against.resolve(), "after": ROOT}


def of_checkout(folder: Path) -> dict[str, str]:
    """The environment of a process that runs a checkout's package, compiled modules kept as a
    user's are, and that finds its tests.
    """
    paths = f"{folder / '.editable'}{os.pathsep}{folder}"
    own = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return {**own, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
