"""Draws the pictures of docs/images with the commands that its pages give for them; its films are
docs/gallery.py's.

They are in the repository, since they are shown where nothing is built, too. A build draws those
anew that are older than the code. By hand: python docs/extensions/pictures.py [NAME ...]
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parents[1]
IMAGES, ROOT = HERE / "images", HERE.parent
PICTURES = {
    "gait.png": ("stancekit", "gait", "cone", "--start=-2,0", "--goal", "2,0", "--picture"),
    "leap.png": ("stancekit", "plan", "leap-stones:3", "--picture"),
    "playground.png": (
        "python",
        "benchmarks/playground.py",
        "--courses",
        "icy-walls",
        "--size-px",
        "1500",
        "900",
        "--picture",
    ),
    "standing-map.png": (
        "stancekit",
        "map",
        "configs/demo/stones.obj",
        "--robot",
        "configs/demo/ant.yaml",
        "--spacing-m",
        "0.1",
        "--headings",
        "4",
        "--picture",
    ),
}
"""Their names, and the command whose last option takes the file."""
TABLE_I = (
    "stancekit bench gait --terrain ripple --seeds 0 --tasks 2 --out FOLDER "
    "--chart ambient-lbfgs,warped-lbfgs,ambient,warped"
)
STUDIES = {
    "directions-ripple.png": TABLE_I,
    "times-ripple.png": TABLE_I,
    "crossing.png": "stancekit plan gaps:0.5:0 --start=-0.5,0 --goal=1,0 --robot laikago "
    "--time-limit-s 300 --picture crossing.png",
    "fitness.png": "python benchmarks/fitness.py FILE --picture fitness.png",
    "robots.png": "python docs/named_robots.py",
}
"""Pictures that take longer than a build, and the command that writes them or their folder."""
BROWSER = {"playground.png"}
"""Those for which a browser is needed; without one they stay as they are."""


def stale(name: str, folder: Path = IMAGES) -> bool:
    """Whether a picture is older than some file of the code that draws it."""
    code = (
        path
        for part in ("planners", "views", "cli", "configs")
        for path in (ROOT / part).rglob("*.*")
    )
    newest = max(path.stat().st_mtime for path in code if path.suffix in (".py", ".yaml"))
    return not (folder / name).exists() or (folder / name).stat().st_mtime < newest


def draw(name: str, folder: Path = IMAGES) -> str:
    """Draw one picture into a folder, whole or not at all; the command's complaint where it fails,
    else empty.
    """
    with tempfile.TemporaryDirectory() as work:
        drawn = Path(work) / name
        program, *words = PICTURES[name]
        tool = sys.executable if program == "python" else str(Path(sys.executable).parent / program)
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
        ran = subprocess.run(
            [tool, *words, str(drawn)],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        if ran.returncode or not drawn.exists():
            return f"{name}: {' '.join(PICTURES[name])}: {ran.stderr.strip()[-500:]}"
        (folder / name).write_bytes(drawn.read_bytes())
    return ""


def write(_: Sphinx) -> None:
    """Draw those that are older than the code; a command that fails is a warning, which fails the
    build.
    """
    from sphinx.util import logging

    from tests.emulators.chromium import CHROMIUM

    logger = logging.getLogger(__name__)
    for name in filter(stale, PICTURES):
        if name in BROWSER and not CHROMIUM:
            logger.info("%s: no browser to draw it with: left as it is", name)
        elif failed := draw(name):
            logger.warning(failed)


def setup(app: Sphinx) -> dict[str, bool]:
    """Hook it in."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    sys.exit("; ".join(filter(None, map(draw, sys.argv[1:] or PICTURES))) or 0)
