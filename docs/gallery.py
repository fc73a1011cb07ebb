"""Makes what docs/gallery.md shows: runs the commands of the page and keeps their pictures, films
and pages.

    python docs/gallery.py                          # all of them
    python docs/gallery.py "Between icy walls"      # those of these headings

They are run in out/gallery, and what is seen is copied to docs/gallery.
What a block's comment `<!-- file: NAME -->` names is written first. Films need a GL library.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).parent
PAGE, FOLDER, WORK = HERE / "gallery.md", HERE / "gallery", HERE.parent / "out" / "gallery"
BLOCK = re.compile(r"(?:<!-- file: (\S+) -->\n)?```(\w+)\n(.*?)```", re.DOTALL)
KEPT = (".mp4", ".png", ".html")
"""Files that the page shows; what leads to them is thrown away."""
FIRST = "stones.mp4"
"""The film of the first page, which README shows as a picture that moves, since it cannot show a
video."""


def sections(page: str) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Each heading with its blocks: file, language, text. What stands before the first heading of
    two signs is "".
    """
    _, *parts = re.split(r"^##? (.*)$", page, flags=re.MULTILINE)
    return [(head, BLOCK.findall(text)) for head, text in zip(parts[::2], parts[1::2], strict=True)]


def make(blocks: list[tuple[str, str, str]], folder: Path) -> None:
    """Write the files and run the commands of a section in a folder. Raises CalledProcessError."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    for name, language, text in blocks:
        if name:
            (folder / name).write_text(text, encoding="utf-8")
        elif language == "sh":
            print(text.rstrip(), flush=True)
            subprocess.run(
                ["bash", "-ec", text], cwd=folder, env={**os.environ, "PATH": path}, check=True
            )


def moving_picture(film: Path, picture: Path) -> None:
    """Write a film as an animated WebP of 720 pixels and 6 frames per second. Raises
    CalledProcessError.
    """
    from imageio_ffmpeg import get_ffmpeg_exe

    options = ("-vf", "fps=6,scale=720:-2", "-loop", "0", "-c:v", "libwebp_anim", "-quality", "35")
    subprocess.run(
        [get_ffmpeg_exe(), "-y", "-loglevel", "error", "-i", film, *options, picture], check=True
    )


def smaller(film: Path, path: Path) -> None:
    """Write a film 960 pixels wide and compressed for the repository. Raises CalledProcessError."""
    from imageio_ffmpeg import get_ffmpeg_exe

    options = ("-vf", "scale=960:-2", "-c:v", "libx264", "-crf", "31", "-preset", "slow", "-an")
    subprocess.run(
        [get_ffmpeg_exe(), "-y", "-loglevel", "error", "-i", film, *options, path], check=True
    )


def main(wanted: list[str]) -> int:
    """Make what these headings show, or all; what every section needs stands before the first of
    them.
    """
    (_, shared), *rest = sections(PAGE.read_text(encoding="utf-8"))
    unknown = set(wanted) - {head for head, _ in rest}
    if unknown:
        print(
            f"gallery.py: expected headings of {PAGE.name}, got {', '.join(sorted(unknown))}",
            file=sys.stderr,
        )
        return 2
    WORK.mkdir(parents=True, exist_ok=True)
    make(shared, WORK)
    for head, blocks in rest:
        if not wanted or head in wanted:
            began_s = time.monotonic()
            make(blocks, WORK)
            print(f"{head}: {time.monotonic() - began_s:.0f} s", flush=True)
    FOLDER.mkdir(exist_ok=True)
    for path in sorted(WORK.iterdir()):
        if path.name == FIRST:
            moving_picture(path, HERE / "images" / f"{path.stem}.webp")
        elif path.suffix == ".mp4":
            smaller(path, FOLDER / path.name)
        elif path.suffix in KEPT:
            shutil.copy(path, FOLDER)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
