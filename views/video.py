"""Videos: frames of pixels written as MP4 by ffmpeg, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from itertools import chain
from pathlib import Path
from subprocess import PIPE, Popen
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import NDArray

from stancekit.planners.errors import InvalidInput, not_installed
from stancekit.planners.files.writing import check_writable, failure_of, replaced

Frame = NDArray[np.uint8]


def check_video(path: str | Path) -> Path:
    """The file behind the name of a video, asked for before the work whose result goes there.

    Raises InvalidInput for a name that does not end in .mp4, where nothing can be written, and
    without ffmpeg.
    """
    if Path(path).suffix.lower() != ".mp4":
        raise InvalidInput(
            f"{path}: expected a name that ends in .mp4, got {Path(path).suffix or 'no suffix'}"
        )
    _ffmpeg()
    return check_writable(path)


def write_video(path: str | Path, frames: Iterable[Frame], fps: float) -> None:
    """Write frames, one or more, uint8 of shape (H, W, 3) and all of one size, as H.264 in MP4.

    Frames are taken one by one, so a generator needs little memory; an odd last row or column is
    left out, as the format has none. Raises InvalidInput as ``check_video``.
    """
    check_video(path)
    remaining = iter(frames)
    first = next(remaining)
    rows, columns, _ = first.shape
    with replaced(path) as temporary, _encoder(temporary, first, fps) as write:
        for frame in chain([first], remaining):
            write(frame[: rows // 2 * 2, : columns // 2 * 2])


@contextmanager
def _encoder(path: Path, first: Frame, fps: float) -> Iterator[Callable[[Frame], object]]:
    """A function that ffmpeg gets frames by.

    Raises OSError where not all of them are in the file at the end.

    imageio_ffmpeg, which brings ffmpeg, keeps its exit status to itself, and so a disk that is full
    at the last block.
    """
    rows, columns = (side // 2 * 2 for side in first.shape[:2])
    options = [
        "-y",
        "-v",
        "error",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        f"{columns}x{rows}",
        "-r",
        f"{fps:g}",
    ]
    options += [
        "-i",
        "-",
        "-an",
        "-vcodec",
        "libx264",
        "-preset",
        "veryfast",
        "-pix_fmt",
        "yuv420p",
        "-crf",
        "16",
        "-f",
        "mp4",
    ]
    failed = True
    with TemporaryFile() as sink, path.open("r+b") as film:
        # by its descriptor: an ffmpeg that outlives this process makes no file of that name again
        arguments, descriptors = [_ffmpeg(), *options, f"/dev/fd/{film.fileno()}"], (film.fileno(),)
        with Popen(
            arguments, stdin=PIPE, stderr=sink, pass_fds=descriptors, start_new_session=True
        ) as process:
            assert process.stdin is not None
            stream = process.stdin
            try:
                yield lambda frame: stream.write(np.ascontiguousarray(frame).data)
                stream.close()
                failed = process.wait() != 0
            except BrokenPipeError:  # it ended early, and says why
                pass
            except BaseException:  # no encoder is left behind; it is raised again
                process.kill()
                raise
            finally:
                with suppress(OSError):
                    stream.close()
        if failed:
            sink.seek(0)
            raise failure_of("ffmpeg", sink.read().decode(errors="replace"))


def _ffmpeg() -> str:
    """The path of ffmpeg."""
    try:
        return str(import_module("imageio_ffmpeg").get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise not_installed("video", "ffmpeg", "films", "viz") from None
